//! Imbalance of one gear: a force rotating with its shaft, growing with the square of speed.

use super::{Entry, GEAR, PHASE, Parameter};
use crate::dynamics::excitation::{Effect, Forces, Moment, Place};

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
};

struct Imbalance {
    moment_kg_m: f64,
    phase_rad: f64,
    body: usize,
}

impl Effect for Imbalance {
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
