//! Cracked tooth by a plain loss of its pair's stiffness.
//!
//! For a crack by depth and angle declare `[crack]` in the machine: its pair then follows the curve of the
//! cracked section. Signature: low, wide comb of shaft harmonics around the mesh harmonics, once per turn for
//! about a contact ratio of mesh periods, proportional to torque.

use super::hypothesis::{Hidden, Hypothesis, Seat, Tooth, one};
use super::{Entry, GEAR, TOOTH, check_tooth, parameter};
use crate::Result;
use crate::dynamics::excitation::{Effect, Facts, Moment, PairOnPath};
use crate::dynamics::series::Series;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "tooth-crack",
    meaning: "one tooth whose pair has lost part of its stiffness",
    signature: "a wide comb of shaft harmonics around the mesh harmonics; proportional to torque",
    example: "loss=0.3",
    span_hz: 1000.0,
    parameters: &[parameter("loss", "", 0.1, [0.0, 0.95], "share of the pair's stiffness"), TOOTH, GEAR],
    build: |v| Box::new(ToothCrack { loss: v.get("loss"), tooth: v.get("tooth") as u32, body: v.body() }),
    hypotheses: &[
        SOFTENED,
        Hypothesis { name: "gear-tooth-crack", seats: &[Seat::OneTooth(1, Tooth::Softened)], ..SOFTENED },
    ],
    hidden: &[
        Hidden {
            name: "pinion-tooth-crack",
            right_names: &["pinion-tooth-crack"],
            reference: 0.05,
            parameter: "stiffness_loss",
            draw: |size, draw| vec![format!("tooth-crack:loss={size},tooth={}", draw.below(draw.teeth[0]))],
            ..Hidden::PLAIN
        },
        Hidden {
            name: "gear-tooth-crack",
            right_names: &["gear-tooth-crack"],
            reference: 0.05,
            parameter: "stiffness_loss",
            draw: |size, draw| vec![format!("tooth-crack:loss={size},tooth={},gear=1", draw.below(draw.teeth[1]))],
            ..Hidden::PLAIN
        },
    ],
};

const SOFTENED: Hypothesis = Hypothesis {
    name: "pinion-tooth-crack",
    seats: &[Seat::OneTooth(0, Tooth::Softened)],
    quantity: "stiffness_loss",
    never_negative: true,
    bends: true,
    carry: |f| Some(one("tooth-crack", [("loss", f.size), f.of_tooth()?, f.gear()])),
    ..Hypothesis::PLAIN
};

struct ToothCrack {
    loss: f64,
    tooth: u32,
    body: usize,
}

impl Effect for ToothCrack {
    fn check(&self, facts: &Facts) -> Result<()> {
        check_tooth(ENTRY.name, self.tooth, self.body, facts)
    }

    fn pair_stiffness(&self, _moment: &Moment, pair: &PairOnPath, stiffness: &mut Series) {
        if pair.tooth[self.body] == self.tooth {
            *stiffness = stiffness.scaled(1.0 - self.loss);
        }
    }
}
