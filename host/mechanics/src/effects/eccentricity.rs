//! Eccentricity of one gear: runout along the line of action, and the shift of the contact it causes.
//!
//! The gear's centre circles by `amplitude`; its displacement along the line of action opens or closes the
//! mesh, its displacement also rolls the contact along its path. Signature: sidebands at the shaft rate
//! around every mesh harmonic (amplitude and phase modulation), a displacement independent of torque.

use super::hypothesis::{Carried, Fitted, Hidden, Hypothesis, Seat, Wave, Where, one};
use super::{Entry, GEAR, PHASE, Parameter};
use crate::dynamics::excitation::{Effect, Moment, PairOnPath, Recurrence};
use crate::dynamics::series::Series;
use std::f64::consts::{FRAC_PI_2, TAU};

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
    hypotheses: &[
        ECCENTRICITY,
        Hypothesis { name: "gear-eccentricity", at: Where::Multiple(1, 1.0), ..ECCENTRICITY },
        Hypothesis { seats: &[Seat::Wave(Wave::Displacement)], bends: false, ..ECCENTRICITY },
        Hypothesis {
            name: "gear-eccentricity",
            at: Where::Multiple(1, 1.0),
            seats: &[Seat::Wave(Wave::Displacement)],
            bends: false,
            ..ECCENTRICITY
        },
    ],
    hidden: &[
        Hidden {
            name: "pinion-eccentricity",
            right_names: &["pinion-eccentricity"],
            reference: 5e-6,
            parameter: "amplitude",
            draw: |size, draw| vec![format!("eccentricity:amplitude={size},phase={}", draw.phase())],
            ..Hidden::DEFAULTS
        },
        Hidden {
            name: "gear-eccentricity",
            right_names: &["gear-eccentricity"],
            reference: 5e-6,
            parameter: "amplitude",
            draw: |size, draw| vec![format!("eccentricity:amplitude={size},phase={},gear=1", draw.phase())],
            ..Hidden::DEFAULTS
        },
    ],
};

/// A displaced gear carries its contact along the path.
const ECCENTRICITY: Hypothesis = Hypothesis {
    name: "pinion-eccentricity",
    seats: &[Seat::Wave(Wave::RollingDisplacement)],
    at: Where::Multiple(0, 1.0),
    unit: "m",
    bends: true,
    carry: carried,
    ..Hypothesis::DEFAULTS
};

/// At a gear's own rate its eccentricity; a rolling displacement at any other order as its two parts.
fn carried(f: &Fitted<'_>) -> Option<Carried> {
    let order = f.order?;
    if let Some(body) = (0..2).find(|&body| Where::Multiple(body, 1.0).holds(Some(order), f.ratio())) {
        // -sin on the pinion, +sin on the gear, from the line of centres.
        let turned = [-FRAC_PI_2, FRAC_PI_2][body] - f.pressure_angle_rad;
        return Some(one("eccentricity", [("amplitude", f.size), f.phase(turned), ("gear", body as f64)]));
    }
    let angle_rad = TAU * f.size / (f.base_pitch_m * f64::from(f.teeth[0]));
    let mut carried = one("ghost-order", [("amplitude", f.size), ("order", order), f.phase(0.0)]);
    carried.tables.push(("speed-fluctuation", vec![("angle", angle_rad), ("order", order), f.phase(FRAC_PI_2)]));
    Some(carried)
}

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
    fn recurrence(&self) -> Recurrence {
        Recurrence::Turn(self.body)
    }

    fn shift(&self, moment: &Moment, position: &mut Series) {
        // A tooth displaced along the line of action carries its contact point with it.
        position.add_scaled(&self.along_line_of_action(moment), 1.0 / moment.facts.base_pitch_m);
    }

    fn pair_error(&self, moment: &Moment, _pair: &PairOnPath, error: &mut Series) {
        error.add_scaled(&self.along_line_of_action(moment), 1.0);
    }
}
