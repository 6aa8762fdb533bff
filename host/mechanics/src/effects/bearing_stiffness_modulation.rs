//! Bearing passage: the stiffness of one bearing varies as rolling elements pass the load zone.
//!
//! Signature: a line at the passage order (not an integer) of its shaft, growing with torque (it modulates the
//! static deflection), and sidebands of it around the mesh.

use super::hypothesis::{Hidden, Hypothesis, Seat, Wave, Where, one};
use super::{Entry, GEAR, PHASE, parameter};
use crate::dynamics::excitation::{Effect, Moment, Recurrence};
use crate::dynamics::series::Series;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "bearing-stiffness-modulation",
    meaning: "stiffness of one bearing varying as its rolling elements pass",
    signature: "a line at the non-integer passage order and sidebands of it around the mesh; proportional to torque",
    example: "share=0.1,order=3.57",
    span_hz: 500.0,
    parameters: &[
        parameter("share", "", 0.02, [0.0, 0.9], "amplitude over the bearing's mean stiffness"),
        parameter("order", "", 3.57, [0.0, 1000.0], "passages per turn of its shaft"),
        PHASE,
        GEAR,
    ],
    build: |v| {
        let [share, order, phase_rad] = ["share", "order", "phase"].map(|n| v.get(n));
        Box::new(BearingStiffness { share, order, phase_rad, body: v.body() })
    },
    hypotheses: &[PASSAGE, Hypothesis { seats: &[Seat::Wave(Wave::BearingStiffness(1))], ..PASSAGE }],
    hidden: &[Hidden {
        name: "bearing-stiffness-modulation",
        right_names: &["bearing-stiffness-modulation"],
        families: &["non-integer-order", "sideband"],
        reference: 0.02,
        parameter: "share_of_stiffness",
        draw: |size, draw| {
            let (gear, order) = (draw.side(), draw.odd_order());
            let order = draw.per_turn(order, gear);
            let phase = draw.phase();
            vec![format!("bearing-stiffness-modulation:share={size},order={order},phase={phase},gear={gear}")]
        },
        ..Hidden::DEFAULTS
    }],
};

const PASSAGE: Hypothesis = Hypothesis {
    name: "bearing-stiffness-modulation",
    seats: &[Seat::Wave(Wave::BearingStiffness(0))],
    at: Where::NeitherShaft { fixed: false },
    quantity: "share_of_stiffness",
    bends: true,
    carry: |f| {
        let keys = [("share", f.size), f.rate(f.body).filter(|_| f.order.is_some())?, f.phase(0.0), f.gear()];
        Some(one("bearing-stiffness-modulation", keys))
    },
    ..Hypothesis::DEFAULTS
};

struct BearingStiffness {
    share: f64,
    order: f64,
    phase_rad: f64,
    body: usize,
}

impl Effect for BearingStiffness {
    fn recurrence(&self) -> Recurrence {
        Recurrence::of_order(self.body, self.order, 0.0)
    }

    fn bearing(&self, moment: &Moment, body: usize) -> Option<Series> {
        if body != self.body {
            return None;
        }
        let mut phase = moment.angle_rad[body].scaled(self.order);
        phase.add_constant(self.phase_rad);
        Some(phase.sin_cos().1.scaled(self.share * moment.facts.bearing_stiffness_n_per_m[body]))
    }
}
