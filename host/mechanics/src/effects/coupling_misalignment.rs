//! Misaligned coupling: radial force at twice the shaft rate, and the torque ripple of a joint at an angle.
//!
//! Signature: a line at twice the shaft rate, sidebands at twice the shaft rate around the mesh (by the
//! torque); hardly any change with speed.

use super::hypothesis::{Hidden, Hypothesis, Seat, Site, Wave, Where, one};
use super::{Entry, GEAR, PHASE, parameter};
use crate::dynamics::excitation::{Effect, Forces, Moment, Place, Recurrence};

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "coupling-misalignment",
    meaning: "radial force and torque ripple at twice the rate of one shaft",
    signature: "a line at twice the shaft rate; sidebands 2x around the mesh by the torque part",
    example: "force=40,torque=0.3",
    span_hz: 500.0,
    parameters: &[
        parameter("force", "N", 20.0, [0.0, 1e6], "rotating radial force on the gear body"),
        parameter("torque", "", 0.0, [0.0, 10.0], "amplitude of the torque over the shaft's mean torque"),
        PHASE,
        GEAR,
    ],
    build: |v| {
        let [force_n, torque, phase_rad] = ["force", "torque", "phase"].map(|n| v.get(n));
        Box::new(CouplingMisalignment { force_n, torque, phase_rad, body: v.body() })
    },
    hypotheses: &[
        RADIAL_FORCE,
        Hypothesis {
            seats: &[
                Seat::Wave(Wave::Force { at: Site::Along(1), speed: 0, torque: 0 }),
                Seat::Wave(Wave::Force { at: Site::Along(1), speed: 0, torque: 1 }),
            ],
            at: Where::Multiple(1, 2.0),
            ..RADIAL_FORCE
        },
    ],
    hidden: &[Hidden {
        name: "coupling-misalignment",
        right_names: &["coupling-misalignment"],
        reference: 20.0,
        parameter: "radial_force",
        draw: |size, draw| {
            let gear = draw.side();
            vec![format!("coupling-misalignment:force={size},phase={},gear={gear}", draw.phase())]
        },
        ..Hidden::DEFAULTS
    }],
};

const RADIAL_FORCE: Hypothesis = Hypothesis {
    name: "coupling-misalignment",
    seats: &[
        Seat::Wave(Wave::Force { at: Site::Along(0), speed: 0, torque: 0 }),
        Seat::Wave(Wave::Force { at: Site::Along(0), speed: 0, torque: 1 }),
    ],
    at: Where::Multiple(0, 2.0),
    quantity: "radial_force",
    unit: "N",
    // A force that goes with torque has no counterpart.
    carry: |f| {
        let keys = [("force", f.size), f.phase(0.0), f.gear()];
        (f.torque_exponent == 0.0).then(|| one("coupling-misalignment", keys))
    },
    ..Hypothesis::DEFAULTS
};

struct CouplingMisalignment {
    force_n: f64,
    torque: f64,
    phase_rad: f64,
    body: usize,
}

impl Effect for CouplingMisalignment {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Turn(self.body)
    }

    fn force(&self, moment: &Moment, forces: &mut Forces) {
        let mut angle = moment.angle_rad[self.body].scaled(2.0);
        angle.add_constant(self.phase_rad);
        let (sin, cos) = angle.sin_cos();
        forces.add(Place::Along(self.body), cos.scaled(self.force_n));
        forces.add(Place::Across(self.body), sin.scaled(self.force_n));
        if self.torque > 0.0 {
            let [z1, z2] = moment.facts.teeth.map(f64::from);
            let mean = moment.facts.input_torque_n_m;
            let (place, mean) = if self.body == 0 { (Place::Motor, mean) } else { (Place::Load, -mean * z2 / z1) };
            forces.add(place, cos.scaled(self.torque * mean));
        }
    }
}
