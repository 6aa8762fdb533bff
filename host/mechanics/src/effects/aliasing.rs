//! Missing anti-alias filter: the acquisition takes points of the signal as it is.
//!
//! A mesh excites far beyond any record's rate, so its harmonics fold. Signature: lines at
//! `|n f_mesh - m f_rate|` that move the wrong way or too fast with speed.

use super::hypothesis::{Hidden, Hypothesis, Path, Seat, one};
use super::{Entry, parameter};
use crate::dynamics::excitation::Effect;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "aliasing",
    meaning: "acquisition without anti-alias filter",
    signature: "mesh harmonics above half the rate appear folded",
    example: "",
    span_hz: 5120.0,
    parameters: &[parameter("share", "", 1.0, [0.0, 1.5], "of what lies above half the rate that folds")],
    build: |v| Box::new(Aliasing { share: v.get("share") }),
    hypotheses: &[Hypothesis {
        name: "aliasing",
        seats: &[Seat::Path(Path::Folding)],
        quantity: "share_folded",
        never_negative: true,
        carry: |f| Some(one("aliasing", [("share", f.size)])),
        ..Hypothesis::DEFAULTS
    }],
    hidden: &[Hidden {
        name: "aliasing",
        right_names: &["aliasing"],
        families: &["path"],
        parameter: "share_folded",
        draw: |size, _| vec![format!("aliasing:share={size}")],
        ..Hidden::DEFAULTS
    }],
};

struct Aliasing {
    share: f64,
}

impl Effect for Aliasing {
    fn unfiltered(&self) -> f64 {
        self.share
    }
}
