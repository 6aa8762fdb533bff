//! Plain transfer path of a channel: gain, delay and a first-order roll-off.
//!
//! Signature: the channel's lines keep their places; their phases fall linearly with frequency (delay) and
//! their amplitudes scale (gain, roll-off).

use super::filter::pass;
use super::hypothesis::{Hidden, Hypothesis, Path, Seat, one};
use super::{CHANNEL, Entry, parameter};
use crate::dynamics::excitation::{Effect, Recurrence, Sampled};
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "transfer-path",
    meaning: "gain, delay and roll-off between bearing and record",
    signature: "amplitudes scale, phases fall linearly with frequency; no new lines",
    example: "gain=0.7,corner=1000",
    span_hz: 5120.0,
    parameters: &[
        parameter("gain", "", 1.0, [-100.0, 100.0], "factor on the signal"),
        parameter("delay", "s", 0.0, [-1e-2, 1e-2], "time the signal comes later"),
        parameter("corner", "Hz", 1e9, [1.0, 1e9], "of the first-order roll-off"),
        CHANNEL,
    ],
    build: |v| {
        let [gain, delay_s, corner_hz] = ["gain", "delay", "corner"].map(|n| v.get(n));
        Box::new(TransferPath { gain, delay_s, corner_hz, channels: v.channels() })
    },
    hypotheses: &[Hypothesis {
        name: "channel-delay",
        plain: "delay or all-pass in the path of a channel",
        seats: &[Seat::Path(Path::Delay)],
        quantity: "share_of_a_delay",
        carry: |f| Some(one("transfer-path", [("delay", f.shape[0] * f.size), f.on()])),
        ..Hypothesis::DEFAULTS
    }],
    hidden: &[Hidden {
        name: "channel-delay",
        right_names: &["channel-delay"],
        families: &["path"],
        reference: 1e-6,
        draw: |size, draw| vec![format!("transfer-path:delay={size},channel={}", draw.side())],
        ..Hidden::DEFAULTS
    }],
};

struct TransferPath {
    gain: f64,
    delay_s: f64,
    corner_hz: f64,
    channels: std::ops::Range<usize>,
}

impl Effect for TransferPath {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Mesh
    }

    fn measure(&self, sampled: &mut Sampled) {
        pass(sampled, self.channels.clone(), |hz| {
            let later = Complex64::from_polar(self.gain, -TAU * hz * self.delay_s);
            later / Complex64::new(1.0, hz / self.corner_hz)
        });
    }
}
