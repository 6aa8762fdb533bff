//! Cracked tooth by a loss of its pair's stiffness.
//!
//! The pair's stiffness is `k / (1 + c)`, `c = loss / (1 - loss) exp(growth x + bow x^2)`, `x` from -1 at the root's
//! end of the path to 1 at the tip's: `loss` is the share lost at the middle. By the energy method a root crack's own
//! compliance grows towards the tip by the square of the load's lever arm and by the thinner sections there: 27-fold
//! over the path of 55 teeth (1.4 mm at 70 degrees), which this follows within 1 %. For a crack by depth and angle
//! declare `[crack]` in the machine. Signature: low, wide comb of shaft harmonics around the mesh harmonics, once per
//! turn for about a contact ratio of mesh periods, proportional to torque.

use super::hypothesis::{Hidden, Hypothesis, Seat, Tooth, one};
use super::{Entry, GEAR, TOOTH, check_tooth, parameter};
use crate::Result;
use crate::dynamics::excitation::{Effect, Facts, Moment, PairOnPath, Recurrence};
use crate::dynamics::series::Series;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "tooth-crack",
    meaning: "one tooth whose pair has lost part of its stiffness",
    signature: "a wide comb of shaft harmonics around the mesh harmonics; proportional to torque",
    example: "loss=0.3",
    span_hz: 1000.0,
    parameters: &[
        parameter("loss", "", 0.1, [0.0, 0.95], "share of the pair's stiffness at the middle of its path"),
        parameter("growth", "", 0.0, [-4.0, 4.0], "of the loss from root to tip, as a logarithm over half the path"),
        parameter("bow", "", 0.0, [-2.0, 2.0], "of that logarithm"),
        TOOTH,
        GEAR,
    ],
    build: |v| {
        let [loss, growth, bow] = ["loss", "growth", "bow"].map(|n| v.get(n));
        Box::new(ToothCrack { loss, growth, bow, tooth: v.get("tooth") as u32, body: v.body() })
    },
    hypotheses: &[
        CRACK,
        Hypothesis { name: "gear-tooth-crack", seats: &[Seat::OneTooth(1, Tooth::Softened)], ..CRACK },
    ],
    hidden: &[
        Hidden {
            name: "pinion-tooth-crack",
            right_names: &["pinion-tooth-crack"],
            reference: 0.05,
            parameter: "stiffness_loss",
            draw: |size, draw| vec![format!("tooth-crack:loss={size},tooth={}", draw.below(draw.teeth[0]))],
            ..Hidden::DEFAULTS
        },
        Hidden {
            name: "gear-tooth-crack",
            right_names: &["gear-tooth-crack"],
            reference: 0.05,
            parameter: "stiffness_loss",
            draw: |size, draw| vec![format!("tooth-crack:loss={size},tooth={},gear=1", draw.below(draw.teeth[1]))],
            ..Hidden::DEFAULTS
        },
    ],
};

const CRACK: Hypothesis = Hypothesis {
    name: "pinion-tooth-crack",
    seats: &[Seat::OneTooth(0, Tooth::Softened)],
    quantity: "stiffness_loss",
    never_negative: true,
    bends: true,
    carry: |f| {
        let [growth, bow] = f.shape;
        let keys = [("loss", f.size), ("growth", growth), ("bow", bow), f.of_tooth()?, f.gear()];
        Some(one("tooth-crack", keys))
    },
    ..Hypothesis::DEFAULTS
};

struct ToothCrack {
    loss: f64,
    growth: f64,
    bow: f64,
    tooth: u32,
    body: usize,
}

impl Effect for ToothCrack {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Turn(self.body)
    }

    fn check(&self, facts: &Facts) -> Result<()> {
        check_tooth(ENTRY.name, self.tooth, self.body, facts)
    }

    fn pair_stiffness(&self, moment: &Moment, pair: &PairOnPath, stiffness: &mut Series) {
        if pair.tooth[self.body] != self.tooth {
            return;
        }
        if self.growth == 0.0 && self.bow == 0.0 {
            *stiffness = stiffness.scaled(1.0 - self.loss);
            return;
        }
        // The contact climbs the pinion's tooth and descends the gear's.
        let outwards = [1.0, -1.0][self.body];
        let mut x = pair.position.scaled(2.0 * outwards / moment.facts.path_base_pitches);
        x.add_constant(-outwards);
        let mut exponent = x.product(&x).scaled(self.bow);
        exponent.add_scaled(&x, self.growth);
        let mut yielding = exponent.exp().scaled(self.loss / (1.0 - self.loss));
        yielding.add_constant(1.0);
        *stiffness = stiffness.quotient(&yielding);
    }
}
