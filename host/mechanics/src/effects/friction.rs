//! Coulomb friction of the sliding flanks, reversing at the pitch point.
//!
//! Each pair's friction force is a constant share of its mesh force, across the line of action; its moments about
//! both gears follow the contact point. A positive coefficient takes energy from a pinion that drives; where the gear
//! drives the pinion in the same sense the flanks slide the other way, which is a negative one. Next to the pitch
//! point, where nothing slides, a lubricant film carries the load and the force passes zero smoothly: `tanh` of the
//! distance over `transition` (0: at once). Signature: mesh harmonics across the line of action, proportional to
//! torque.

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
    parameters: &[
        Parameter {
            name: "coefficient",
            unit: "",
            default: 0.05,
            range: [-0.5, 0.5],
            meaning: "friction force over normal force; negative: flanks that slide the other way",
        },
        Parameter {
            name: "transition",
            unit: "base pitches",
            default: 0.0,
            range: [0.0, 1.0],
            meaning: "distance from the pitch point at which 0.76 of that force is reached; 0: at once",
        },
    ],
    build: |v| Box::new(Friction { coefficient: v.get("coefficient"), transition: v.get("transition") }),
    hypotheses: &[Hypothesis {
        name: "friction",
        seats: &[Seat::Sliding],
        quantity: "coefficient",
        carry: |f| Some(one("friction", [("coefficient", f.size), ("transition", f.shape[0])])),
        ..Hypothesis::DEFAULTS
    }],
    hidden: &[],
};

/// Distance from the pitch point, in transitions, beyond which the force has its full size: 4e-16 of it are missing.
const FULL_FORCE_TRANSITIONS: f64 = 18.0;
/// Least transition that is not taken as a jump, base pitches: a hundredth of a sample at usual rates.
const LEAST_TRANSITION: f64 = 1e-3;

struct Friction {
    coefficient: f64,
    transition: f64,
}

impl Friction {
    /// Share of the full force, with its sign, over a step `ahead` of the pitch point, base pitches.
    fn share(&self, ahead: &Series) -> Series {
        let middle = ahead.value(0.5);
        let nearest = [0.0, 1.0].map(|tau| ahead.value(tau) * middle.signum()).into_iter().fold(f64::MAX, f64::min);
        if self.transition < LEAST_TRANSITION || nearest > FULL_FORCE_TRANSITIONS * self.transition {
            return Series::constant(middle.signum());
        }
        // tanh z = 1 - 2 / (1 + exp 2z), on the side where the exponential is small.
        let mut below = ahead.scaled(-2.0 * middle.signum() / self.transition).exp();
        below.add_constant(1.0);
        let mut share = Series::constant(-2.0).quotient(&below).scaled(-1.0);
        share.add_constant(-1.0);
        share.scaled(middle.signum())
    }
}

impl Effect for Friction {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Mesh
    }

    fn friction(&self, moment: &Moment, pair: &PairOnPath) -> Option<Series> {
        // Before the pitch point the gear's flank slides ahead. The middle of the step is never a knot.
        let mut ahead = pair.position;
        ahead.add_constant(-moment.facts.pitch_point_base_pitches);
        Some(self.share(&ahead).scaled(self.coefficient))
    }

    fn path_knots(&self, facts: &Facts) -> Vec<f64> {
        if self.transition < LEAST_TRANSITION { vec![facts.pitch_point_base_pitches] } else { Vec::new() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_the_force_follows_tanh_on_both_sides_of_the_pitch_point() {
        let friction = Friction { coefficient: 1.0, transition: 0.1 };
        for start in [-1.9_f64, -0.3, -0.01, 0.0, 0.2, 1.9] {
            let mut ahead = Series::linear(0.0, 0.02);
            ahead.add_constant(start);
            let share = friction.share(&ahead);
            for tau in [0.0, 0.3, 1.0] {
                let expected = ((start + 0.02 * tau) / 0.1).tanh();
                assert!((share.value(tau) - expected).abs() < 1e-12, "{start} {tau}: {}", share.value(tau));
            }
        }
    }
}
