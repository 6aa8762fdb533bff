//! Uniform wear: every flank is worn most at root and tip, not at all near the pitch line (Archard).
//!
//! Signature: mesh harmonics rise, the second more than the first; no sidebands where all teeth wear alike.

use super::{Entry, parameter};
use crate::dynamics::excitation::{Effect, Moment, PairOnPath};
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
};

struct Wear {
    depth_m: f64,
}

impl Effect for Wear {
    fn pair_error(&self, moment: &Moment, pair: &PairOnPath, error: &mut Series) {
        let mut across = pair.position.scaled(2.0 / moment.facts.path_base_pitches);
        across.add_constant(-1.0);
        error.add_scaled(&across.product(&across), self.depth_m);
    }
}
