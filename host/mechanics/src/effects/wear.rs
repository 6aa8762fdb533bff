//! Uniform wear: every flank is worn most at root and tip, not at all near the pitch line (Archard).
//!
//! Signature: mesh harmonics rise, the second more than the first; no sidebands where all teeth wear alike.

use super::hypothesis::{Hidden, Hypothesis, Seat, one};
use super::{Entry, parameter};
use crate::dynamics::excitation::{Effect, Moment, PairOnPath, Recurrence};
use crate::dynamics::series::Series;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "wear",
    meaning: "flanks worn towards both ends of the path, alike on all teeth",
    signature: "mesh harmonics change, the higher ones most; no sidebands; independent of torque",
    example: "depth=5e-6",
    span_hz: 2000.0,
    parameters: &[parameter(
        "depth",
        "m",
        2e-6,
        [0.0, 1e-3],
        "at both ends of the path, parabolic, zero at its middle",
    )],
    build: |v| Box::new(Wear { depth_m: v.get("depth") }),
    hypotheses: &[Hypothesis {
        name: "wear",
        seats: &[Seat::EveryPair(|x| (2.0 * x - 1.0).powi(2))],
        quantity: "depth",
        never_negative: true,
        unit: "m",
        carry: |f| Some(one("wear", [("depth", f.size)])),
        ..Hypothesis::DEFAULTS
    }],
    hidden: &[Hidden {
        name: "wear",
        right_names: &["wear"],
        families: &["mesh-order"],
        reference: 1e-6,
        parameter: "depth",
        draw: |size, _| vec![format!("wear:depth={size}")],
        ..Hidden::DEFAULTS
    }],
};

struct Wear {
    depth_m: f64,
}

impl Effect for Wear {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Mesh
    }

    fn pair_error(&self, moment: &Moment, pair: &PairOnPath, error: &mut Series) {
        let mut across = pair.position.scaled(2.0 / moment.facts.path_base_pitches);
        across.add_constant(-1.0);
        error.add_scaled(&across.product(&across), self.depth_m);
    }
}
