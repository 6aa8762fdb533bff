//! Mesh stiffness varying at an order of the pinion: what many causes have in common, none of which it names.
//!
//! Signature: sidebands of the order around the mesh harmonics, proportional to torque.

use super::hypothesis::{Hidden, Hypothesis, Seat, Wave, Where, one};
use super::{Entry, PHASE, parameter};
use crate::dynamics::excitation::{Effect, Moment, PairOnPath, Recurrence};
use crate::dynamics::series::Series;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "mesh-stiffness-modulation",
    meaning: "stiffness of all pairs varying at an order of the pinion",
    signature: "sidebands of the order around the mesh harmonics; proportional to torque",
    example: "share=0.1,order=3.57",
    span_hz: 1000.0,
    parameters: &[
        parameter("share", "", 0.02, [0.0, 0.9], "amplitude over the mean"),
        parameter("order", "", 1.0, [0.0, 2000.0], "per turn of the pinion"),
        PHASE,
    ],
    build: |v| {
        let [share, order, phase_rad] = ["share", "order", "phase"].map(|n| v.get(n));
        Box::new(MeshStiffness { share, order, phase_rad })
    },
    hypotheses: &[Hypothesis {
        name: "mesh-stiffness-modulation",
        seats: &[Seat::Wave(Wave::MeshStiffness)],
        at: Where::Nowhere,
        quantity: "share_of_stiffness",
        bends: true,
        carry: |f| Some(one("mesh-stiffness-modulation", [("share", f.size), ("order", f.order?), f.phase(0.0)])),
        ..Hypothesis::DEFAULTS
    }],
    hidden: &[Hidden {
        name: "mesh-stiffness-modulation",
        right_names: &["mesh-stiffness-modulation"],
        families: &["non-integer-order", "shaft-order", "sideband"],
        reference: 0.02,
        parameter: "share_of_stiffness",
        draw: |size, draw| {
            let order = draw.odd_order();
            vec![format!("mesh-stiffness-modulation:share={size},order={order},phase={}", draw.phase())]
        },
        ..Hidden::DEFAULTS
    }],
};

struct MeshStiffness {
    share: f64,
    order: f64,
    phase_rad: f64,
}

impl Effect for MeshStiffness {
    fn recurrence(&self) -> Recurrence {
        Recurrence::of_order(0, self.order, 0.0)
    }

    fn pair_stiffness(&self, moment: &Moment, _pair: &PairOnPath, stiffness: &mut Series) {
        let mut phase = moment.angle_rad[0].scaled(self.order);
        phase.add_constant(self.phase_rad);
        let mut factor = phase.sin_cos().1.scaled(self.share);
        factor.add_constant(1.0);
        *stiffness = stiffness.product(&factor);
    }
}
