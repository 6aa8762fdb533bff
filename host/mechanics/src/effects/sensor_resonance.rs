//! Mounting resonance of a sensor: the whole signal passes a second-order section, 1 at low frequency.
//!
//! Stud-mounted beyond 20 kHz, magnet a few kHz, hand-held 1-2 kHz. Signature: everything near the resonance
//! is raised and everything above it lowered, at every speed; no new lines.

use super::filter::{mode, pass};
use super::{CHANNEL, Entry, parameter};
use crate::dynamics::excitation::{Effect, Recurrence, Sampled};

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "sensor-resonance",
    meaning: "the mounting resonance of a sensor",
    signature: "everything near the resonance is raised, above it lowered; proportional to the signal; no new lines",
    example: "frequency=3000",
    span_hz: 5120.0,
    parameters: &[
        parameter("frequency", "Hz", 8000.0, [1.0, 1e6], "of the mode"),
        parameter("damping", "", 0.05, [1e-4, 0.9], "ratio of the mode"),
        CHANNEL,
    ],
    build: |v| {
        let [frequency_hz, damping] = ["frequency", "damping"].map(|n| v.get(n));
        Box::new(Sensor { frequency_hz, damping, channels: v.channels() })
    },
    hypotheses: &[],
    hidden: &[],
};

struct Sensor {
    frequency_hz: f64,
    damping: f64,
    channels: std::ops::Range<usize>,
}

impl Effect for Sensor {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Mesh
    }

    fn measure(&self, sampled: &mut Sampled) {
        pass(sampled, self.channels.clone(), |hz| mode(hz, self.frequency_hz, self.damping));
    }
}
