//! A tone at a fixed frequency from another machine or the structure.
//!
//! Signature: one line, the same at every speed and torque; its phase to the shaft differs per run.

use super::hypothesis::Hidden;
use super::{CHANNEL, Entry, parameter, random};
use crate::dynamics::excitation::{Effect, Recurrence, Sampled};
use std::f64::consts::TAU;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "fixed-tone",
    meaning: "a tone from outside the machine",
    signature: "one line at a fixed frequency, the same at every speed and torque",
    example: "amplitude=0.05,frequency=333",
    span_hz: 1000.0,
    parameters: &[
        parameter("amplitude", "m/s2", 0.05, [-1e4, 1e4], "of the tone"),
        parameter("frequency", "Hz", 333.0, [0.1, 1e6], "of the tone"),
        CHANNEL,
    ],
    build: |v| {
        let [amplitude, frequency_hz] = ["amplitude", "frequency"].map(|n| v.get(n));
        Box::new(Tone { amplitude, frequency_hz, channels: v.channels() })
    },
    hypotheses: &[],
    hidden: &[Hidden {
        name: "fixed-frequency-tone",
        families: &["fixed-frequency"],
        reference: 0.1,
        draw: |size, draw| {
            let hz = 510.0 + 900.0 * draw.share();
            let on = |share: f64, channel: u32| {
                format!("fixed-tone:amplitude={},frequency={hz},channel={channel}", share * size)
            };
            vec![on(1.0, 0), on(-0.5, 1)]
        },
        ..Hidden::DEFAULTS
    }],
};

struct Tone {
    amplitude: f64,
    frequency_hz: f64,
    channels: std::ops::Range<usize>,
}

impl Effect for Tone {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Mesh
    }

    fn measure(&self, sampled: &mut Sampled) {
        let start = rand::RngExt::random::<f64>(&mut random(sampled.seed, 103));
        for channel in &mut sampled.channels[self.channels.clone()] {
            for (i, x) in channel.iter_mut().enumerate() {
                *x += self.amplitude * (TAU * (start + self.frequency_hz * i as f64 / sampled.rate_hz)).cos();
            }
        }
    }
}
