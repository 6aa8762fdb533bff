//! Tip relief (or its deviation from the declared one): flanks stand back towards both ends of the path.
//!
//! With permanent contact (no `backlash`) the relieved pair follows `k (delta - e)` even where that pulls; the
//! declaration's `[engagement]` kind `tip-relief` gives the loaded ramp instead. Signature: mesh harmonics
//! change, best at one torque only: the displacement does not grow with torque, the stiffness force does.

use super::hypothesis::{Hidden, Hypothesis, Seat, one};
use super::{Entry, parameter};
use crate::dynamics::excitation::{Effect, Facts, Moment, PairOnPath, Recurrence};
use crate::dynamics::series::Series;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "tip-relief",
    meaning: "flanks that stand back towards both ends of the path of contact",
    signature: "mesh harmonics change; no sidebands; the change does not grow with torque",
    example: "amount=5e-6",
    span_hz: 2000.0,
    parameters: &[
        parameter("amount", "m", 5e-6, [-1e-3, 1e-3], "at the ends of the path, along the line of action"),
        parameter("length", "", 0.25, [0.01, 0.5], "share of the path over which each relief lies"),
        parameter("exponent", "", 1.0, [1.0, 4.0], "1 linear, 2 parabolic; whole numbers"),
    ],
    build: |v| {
        let [amount_m, share, exponent] = ["amount", "length", "exponent"].map(|n| v.get(n));
        Box::new(TipRelief { amount_m, share, exponent: exponent.round() as u32 })
    },
    hypotheses: &[Hypothesis {
        name: "tip-relief",
        seats: &[Seat::Ends],
        quantity: "amount",
        never_negative: true,
        unit: "m",
        carry: |f| Some(one("tip-relief", [("amount", f.size), ("length", f.shape[0]), ("exponent", f.shape[1])])),
        ..Hypothesis::DEFAULTS
    }],
    hidden: &[Hidden {
        name: "tip-relief",
        right_names: &["tip-relief"],
        families: &["mesh-order"],
        reference: 5e-6,
        parameter: "amount",
        draw: |size, draw| vec![format!("tip-relief:amount={size},length={}", 0.15 + 0.25 * draw.share())],
        ..Hidden::DEFAULTS
    }],
};

struct TipRelief {
    amount_m: f64,
    share: f64,
    exponent: u32,
}

impl Effect for TipRelief {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Mesh
    }

    fn pair_error(&self, moment: &Moment, pair: &PairOnPath, error: &mut Series) {
        let path = moment.facts.path_base_pitches;
        let length = self.share * path;
        // The middle of a step is never a knot.
        let middle = pair.position.value(0.5);
        let mut depth = if middle < length {
            pair.position.scaled(-1.0 / length)
        } else if middle > path - length {
            let mut from_end = pair.position.scaled(1.0 / length);
            from_end.add_constant(-path / length);
            from_end
        } else {
            return;
        };
        depth.add_constant(1.0);
        let power = (1..self.exponent).fold(depth, |product, _| product.product(&depth));
        error.add_scaled(&power, self.amount_m);
    }

    fn path_knots(&self, facts: &Facts) -> Vec<f64> {
        let path = facts.path_base_pitches;
        vec![self.share * path, (1.0 - self.share) * path]
    }
}
