//! Clipping: the signal stops at a limit of sensor or converter.
//!
//! Signature: flat crests; odd sums and differences of lines once the peaks reach the limit, nothing before.

use super::{CHANNEL, Entry, parameter};
use crate::dynamics::excitation::{Effect, Sampled};

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "clipping",
    meaning: "a signal cut off at a limit",
    signature: "nothing below the limit; beyond it flat crests and a raised floor",
    example: "limit=3",
    span_hz: 5120.0,
    parameters: &[parameter("limit", "m/s2", 50.0, [1e-6, 1e6], "largest magnitude"), CHANNEL],
    build: |v| Box::new(Clipping { limit: v.get("limit"), channels: v.channels() }),
};

struct Clipping {
    limit: f64,
    channels: std::ops::Range<usize>,
}

impl Effect for Clipping {
    fn measure(&self, sampled: &mut Sampled) {
        for x in sampled.channels[self.channels.clone()].iter_mut().flatten() {
            *x = x.clamp(-self.limit, self.limit);
        }
    }
}
