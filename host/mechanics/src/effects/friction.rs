//! Coulomb friction of the sliding flanks, reversing at the pitch point.
//!
//! Each pair's friction force is a constant share of its mesh force, across the line of action; its moments about
//! both gears follow the contact point. A positive coefficient takes energy from a pinion that drives; where the gear
//! drives the pinion in the same sense the flanks slide the other way, which is a negative one. Signature: mesh
//! harmonics across the line of action, proportional to torque.

use super::hypothesis::{Hypothesis, Seat, one};
use super::{Entry, Parameter};
use crate::dynamics::excitation::{Effect, Facts, Moment, PairOnPath, Recurrence};
use crate::dynamics::series::Series;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "friction",
    meaning: "sliding friction of the flanks with reversal at the pitch point",
    signature: "mesh harmonics, most across the line of action; proportional to torque",
    example: "coefficient=0.1",
    span_hz: 2000.0,
    parameters: &[Parameter {
        name: "coefficient",
        unit: "",
        default: 0.05,
        range: [-0.5, 0.5],
        meaning: "friction force over normal force; negative: flanks that slide the other way",
    }],
    build: |v| Box::new(Friction { coefficient: v.get("coefficient") }),
    hypotheses: &[Hypothesis {
        name: "friction",
        seats: &[Seat::Sliding],
        quantity: "coefficient",
        carry: |f| Some(one("friction", [("coefficient", f.size)])),
        ..Hypothesis::PLAIN
    }],
    hidden: &[],
};

struct Friction {
    coefficient: f64,
}

impl Effect for Friction {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Mesh
    }

    fn friction(&self, moment: &Moment, pair: &PairOnPath) -> Option<Series> {
        // Before the pitch point the gear's flank slides ahead. The middle of the step is never a knot.
        let ahead = pair.position.value(0.5) - moment.facts.pitch_point_base_pitches;
        Some(Series::constant(self.coefficient * ahead.signum()))
    }

    fn path_knots(&self, facts: &Facts) -> Vec<f64> {
        vec![facts.pitch_point_base_pitches]
    }
}
