//! Ghost order: an undulation left by the gear-cutting machine's index wheel, at any order of one shaft.
//!
//! Signature: a line at that order (no mesh multiple), order-locked, hardly dependent on torque.

use super::hypothesis::{Hidden, Hypothesis, Seat, Wave, Where, one};
use super::{Entry, GEAR, PHASE, Parameter};
use crate::dynamics::excitation::{Effect, Moment, PairOnPath, Recurrence};
use crate::dynamics::series::Series;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "ghost-order",
    meaning: "machining undulation of one gear",
    signature: "one line at an order that is no mesh multiple; independent of torque",
    example: "amplitude=2e-6,order=31",
    span_hz: 500.0,
    parameters: &[
        Parameter { name: "amplitude", unit: "m", default: 1e-6, range: [0.0, 1e-3], meaning: "of the undulation" },
        Parameter {
            name: "order",
            unit: "",
            default: 31.0,
            range: [0.0, 2000.0],
            meaning: "waves per turn of the gear",
        },
        PHASE,
        GEAR,
    ],
    build: |v| {
        let [amplitude_m, order, phase_rad] = ["amplitude", "order", "phase"].map(|n| v.get(n));
        Box::new(Ghost { amplitude_m, order, phase_rad, body: v.body() })
    },
    hypotheses: &[Hypothesis {
        name: "ghost-order",
        seats: &[Seat::Wave(Wave::Displacement)],
        at: Where::WholeOrdersAbove(3.5),
        unit: "m",
        carry: |f| {
            let keys = [("amplitude", f.size), f.rate(f.body).filter(|_| f.order.is_some())?, f.phase(0.0), f.gear()];
            Some(one("ghost-order", keys))
        },
        ..Hypothesis::DEFAULTS
    }],
    hidden: &[Hidden {
        name: "ghost-order",
        right_names: &["ghost-order"],
        reference: 1e-6,
        parameter: "amplitude",
        draw: |size, draw| {
            let order = 5 + draw.below(draw.teeth[0] - 6);
            vec![format!("ghost-order:amplitude={size},order={order},phase={}", draw.phase())]
        },
        ..Hidden::DEFAULTS
    }],
};

struct Ghost {
    amplitude_m: f64,
    order: f64,
    phase_rad: f64,
    body: usize,
}

impl Effect for Ghost {
    fn recurrence(&self) -> Recurrence {
        Recurrence::of_order(self.body, self.order, 0.0)
    }

    fn pair_error(&self, moment: &Moment, _pair: &PairOnPath, error: &mut Series) {
        let mut phase = moment.angle_rad[self.body].scaled(self.order);
        phase.add_constant(self.phase_rad);
        error.add_scaled(&phase.sin_cos().1, self.amplitude_m);
    }
}
