//! Coarse quantisation: the converter's steps.
//!
//! Signature: a floor of `step / sqrt(12)` RMS, independent of speed and torque while the signal spans many steps.

use super::{CHANNEL, Entry, parameter};
use crate::dynamics::excitation::{Effect, Recurrence, Sampled};

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "quantisation",
    meaning: "steps of a coarse converter",
    signature: "a floor of a step over the root of 12; nothing else while the signal spans many steps",
    example: "step=0.5",
    span_hz: 5120.0,
    parameters: &[parameter("step", "m/s2", 0.1, [1e-9, 1e6], "of the converter"), CHANNEL],
    build: |v| Box::new(Quantisation { step: v.get("step"), channels: v.channels() }),
    hypotheses: &[],
    hidden: &[],
};

struct Quantisation {
    step: f64,
    channels: std::ops::Range<usize>,
}

impl Effect for Quantisation {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Mesh
    }

    fn measure(&self, sampled: &mut Sampled) {
        for x in sampled.channels[self.channels.clone()].iter_mut().flatten() {
            *x = (*x / self.step).round() * self.step;
        }
    }
}
