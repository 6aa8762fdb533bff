//! Imbalance of one gear: a force rotating with its shaft, growing with the square of speed.

use super::hypothesis::{Hidden, Hypothesis, Seat, Site, Wave, Where, one};
use super::{Entry, GEAR, PHASE, Parameter};
use crate::dynamics::excitation::{Effect, Forces, Moment, Place, Recurrence};
use std::f64::consts::FRAC_PI_2;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "imbalance",
    meaning: "centre of mass off the axis of one shaft",
    signature: "one line at the shaft rate; force with the square of speed, acceleration with its fourth power",
    example: "moment=1e-2",
    span_hz: 500.0,
    parameters: &[
        Parameter { name: "moment", unit: "kg m", default: 1e-4, range: [0.0, 1.0], meaning: "mass times offset" },
        PHASE,
        GEAR,
    ],
    build: |v| Box::new(Imbalance { moment_kg_m: v.get("moment"), phase_rad: v.get("phase"), body: v.body() }),
    hypotheses: &[
        IMBALANCE,
        Hypothesis {
            name: "gear-imbalance",
            seats: &[Seat::Wave(Wave::Force { at: Site::Along(1), speed: 2, torque: 0 })],
            at: Where::Multiple(1, 1.0),
            ..IMBALANCE
        },
    ],
    hidden: &[
        Hidden {
            name: "pinion-imbalance",
            right_names: &["pinion-imbalance"],
            reference: 1e-3,
            parameter: "unbalance",
            draw: |size, draw| vec![format!("imbalance:moment={size},phase={}", draw.phase())],
            ..Hidden::DEFAULTS
        },
        Hidden {
            name: "gear-imbalance",
            right_names: &["gear-imbalance"],
            reference: 1e-3,
            parameter: "unbalance",
            draw: |size, draw| vec![format!("imbalance:moment={size},phase={},gear=1", draw.phase())],
            ..Hidden::DEFAULTS
        },
    ],
};

const IMBALANCE: Hypothesis = Hypothesis {
    name: "pinion-imbalance",
    seats: &[Seat::Wave(Wave::Force { at: Site::Along(0), speed: 2, torque: 0 })],
    at: Where::Multiple(0, 1.0),
    quantity: "unbalance",
    unit: "kg m",
    // Along the line of action: +sin on the pinion, -sin on the gear, which turns against it.
    carry: |f| Some(one("imbalance", [("moment", f.size), f.phase([FRAC_PI_2, -FRAC_PI_2][f.body]), f.gear()])),
    ..Hypothesis::DEFAULTS
};

struct Imbalance {
    moment_kg_m: f64,
    phase_rad: f64,
    body: usize,
}

impl Effect for Imbalance {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Turn(self.body)
    }

    fn force(&self, moment: &Moment, forces: &mut Forces) {
        let speed = moment.speed_rad_s(self.body);
        let strength = speed.product(&speed).scaled(self.moment_kg_m);
        let mut angle = moment.angle_rad[self.body];
        angle.add_constant(self.phase_rad);
        let (sin, cos) = angle.sin_cos();
        // The gear turns against the pinion.
        let sense = if self.body == 0 { 1.0 } else { -1.0 };
        forces.add(Place::Across(self.body), strength.product(&cos));
        forces.add(Place::Along(self.body), strength.product(&sin).scaled(sense));
    }
}
