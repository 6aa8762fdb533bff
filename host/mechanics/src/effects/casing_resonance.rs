//! A casing mode that all sensors stand on: `y (1 + gain H(f))`, `H = f^2 / (f0^2 - f^2 + 2 i z f0 f)`.
//!
//! The output form of the mode, for machines whose casing is not part of the model; model `casing` has it as
//! two coordinates instead. Signature: a fixed formant on every channel (522-528 Hz, 1.6 % on one measured
//! gearbox), none at low frequency; no new lines.

use super::filter::{mode, pass};
use super::{CHANNEL, Entry, parameter};
use crate::dynamics::excitation::{Effect, Recurrence, Sampled};

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "casing-resonance",
    meaning: "a casing mode that all sensors stand on",
    signature: "a fixed formant on every channel; proportional to the signal; no new lines",
    example: "gain=1,frequency=525",
    span_hz: 2000.0,
    parameters: &[
        parameter("gain", "", 0.3, [-100.0, 100.0], "of the mode, at high frequency"),
        parameter("frequency", "Hz", 525.0, [1.0, 1e6], "of the mode"),
        parameter("damping", "", 0.016, [1e-4, 0.9], "ratio of the mode"),
        CHANNEL,
    ],
    build: |v| {
        let [gain, frequency_hz, damping] = ["gain", "frequency", "damping"].map(|n| v.get(n));
        Box::new(Casing { gain, frequency_hz, damping, channels: v.channels() })
    },
    hypotheses: &[],
    hidden: &[],
};

struct Casing {
    gain: f64,
    frequency_hz: f64,
    damping: f64,
    channels: std::ops::Range<usize>,
}

impl Effect for Casing {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Mesh
    }

    fn measure(&self, sampled: &mut Sampled) {
        let square = |hz: f64| (hz / self.frequency_hz).powi(2);
        let response = |hz: f64| 1.0 + self.gain * square(hz) * mode(hz, self.frequency_hz, self.damping);
        pass(sampled, self.channels.clone(), response);
    }
}
