//! Stiffness of all pairs changing linearly with time: a tooth contact that warms up, wears in or loses its oil
//! within a run.
//!
//! `k (1 + rate t)` from the first sample on. Signature: mesh harmonics whose amplitude and phase move over the run,
//! most beside resonances. Assumes a share common to all pairs and the whole path; what changes over hours, from run
//! to run, is another machine.

use super::hypothesis::{Hidden, Hypothesis, Seat, one};
use super::{Entry, parameter};
use crate::dynamics::excitation::{Effect, Moment, PairOnPath};
use crate::dynamics::series::Series;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "stiffness-drift",
    meaning: "stiffness of all pairs changing linearly with time within a run",
    signature: "mesh harmonics that move over the run, most beside resonances; proportional to torque",
    example: "rate=0.1",
    span_hz: 5120.0,
    parameters: &[parameter("rate", "1/s", 0.02, [-0.4, 0.4], "share of the stiffness per second")],
    build: |v| Box::new(StiffnessDrift { rate_per_s: v.get("rate") }),
    hypotheses: &[Hypothesis {
        name: "stiffness-drift",
        plain: "mesh stiffness changing over the run",
        seats: &[Seat::MeshDrift],
        quantity: "rate",
        unit: "1/s",
        bends: true,
        carry: |f| Some(one("stiffness-drift", [("rate", f.size)])),
        ..Hypothesis::DEFAULTS
    }],
    hidden: &[Hidden {
        name: "stiffness-drift",
        right_names: &["stiffness-drift"],
        families: &["non-stationary", "mesh-order"],
        reference: 0.02,
        parameter: "rate",
        draw: |size, _| vec![format!("stiffness-drift:rate={size}")],
        ..Hidden::DEFAULTS
    }],
};

struct StiffnessDrift {
    rate_per_s: f64,
}

impl Effect for StiffnessDrift {
    fn pair_stiffness(&self, moment: &Moment, _pair: &PairOnPath, stiffness: &mut Series) {
        let mut factor = moment.time_s().scaled(self.rate_per_s);
        factor.add_constant(1.0);
        *stiffness = stiffness.product(&factor);
    }
}
