//! Missing anti-alias filter: the acquisition takes points of the signal as it is.
//!
//! A mesh excites far beyond any record's rate, so its harmonics fold. Signature: lines at
//! `|n f_mesh - m f_rate|` that move the wrong way or too fast with speed.

use super::Entry;
use crate::dynamics::excitation::Effect;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "aliasing",
    meaning: "acquisition without anti-alias filter",
    signature: "mesh harmonics above half the rate appear folded",
    example: "",
    span_hz: 5120.0,
    parameters: &[],
    build: |_| Box::new(Aliasing),
};

struct Aliasing;

impl Effect for Aliasing {
    fn unfiltered(&self) -> bool {
        true
    }
}
