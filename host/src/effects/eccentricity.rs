//! Eccentricity of one gear: runout along the line of action, and the shift of the contact it causes.
//!
//! The gear's centre circles by `amplitude`; its displacement along the line of action opens or closes the
//! mesh, its displacement also rolls the contact along its path. Signature: sidebands at the shaft rate
//! around every mesh harmonic (amplitude and phase modulation), a displacement independent of torque.

use super::{Entry, GEAR, PHASE, Parameter};
use crate::dynamics::excitation::{Effect, Moment, PairOnPath};
use crate::dynamics::series::Series;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "eccentricity",
    meaning: "a gear whose centre circles around its shaft's axis",
    signature: "sidebands of the shaft rate around every mesh harmonic; a displacement, independent of torque",
    example: "amplitude=50e-6",
    span_hz: 500.0,
    parameters: &[
        Parameter { name: "amplitude", unit: "m", default: 20e-6, range: [0.0, 1e-3], meaning: "centre offset" },
        PHASE,
        GEAR,
    ],
    build: |v| Box::new(Eccentricity { amplitude_m: v.get("amplitude"), phase_rad: v.get("phase"), body: v.body() }),
};

struct Eccentricity {
    amplitude_m: f64,
    phase_rad: f64,
    body: usize,
}

impl Eccentricity {
    fn along_line_of_action(&self, moment: &Moment) -> Series {
        let mut angle = moment.angle_rad[self.body];
        angle.add_constant(self.phase_rad + moment.facts.pressure_angle_rad);
        let sign = if self.body == 0 { -1.0 } else { 1.0 };
        angle.sin_cos().0.scaled(sign * self.amplitude_m)
    }
}

impl Effect for Eccentricity {
    fn shift(&self, moment: &Moment, position: &mut Series) {
        // A tooth displaced along the line of action carries its contact point with it.
        position.add_scaled(&self.along_line_of_action(moment), 1.0 / moment.facts.base_pitch_m);
    }

    fn pair_error(&self, moment: &Moment, _pair: &PairOnPath, error: &mut Series) {
        error.add_scaled(&self.along_line_of_action(moment), 1.0);
    }
}
