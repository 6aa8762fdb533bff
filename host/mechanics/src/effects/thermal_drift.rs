//! Thermal drift: a sensor's gain changes linearly over the run.
//!
//! Signature: every line keeps its place and widens by less than a bin; the end is stronger than the start.

use super::hypothesis::{Hidden, Hypothesis, Path, Seat, one};
use super::{CHANNEL, Entry, parameter};
use crate::dynamics::excitation::{Effect, Recurrence, Sampled};

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "thermal-drift",
    meaning: "a sensor's gain changing linearly over the run",
    signature: "the signal's level changes over the run, all lines alike",
    example: "share=0.5",
    span_hz: 2000.0,
    parameters: &[parameter("share", "", 0.05, [-2.0, 2.0], "change of the gain from start to end"), CHANNEL],
    build: |v| Box::new(ThermalDrift { share: v.get("share"), channels: v.channels() }),
    hypotheses: &[Hypothesis {
        name: "thermal-drift",
        seats: &[Seat::Path(Path::Drift)],
        quantity: "gain_change_over_run",
        carry: |f| Some(one("thermal-drift", [("share", f.size), f.on()])),
        ..Hypothesis::DEFAULTS
    }],
    hidden: &[Hidden {
        name: "thermal-drift",
        right_names: &["thermal-drift"],
        families: &["non-stationary", "path"],
        reference: 0.05,
        draw: |size, draw| vec![format!("thermal-drift:share={size},channel={}", draw.side())],
        ..Hidden::DEFAULTS
    }],
};

struct ThermalDrift {
    share: f64,
    channels: std::ops::Range<usize>,
}

impl Effect for ThermalDrift {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Mesh
    }

    fn measure(&self, sampled: &mut Sampled) {
        for channel in &mut sampled.channels[self.channels.clone()] {
            let n = channel.len() as f64;
            for (i, x) in channel.iter_mut().enumerate() {
                *x *= 1.0 + self.share * (i as f64 / n - 0.5);
            }
        }
    }
}
