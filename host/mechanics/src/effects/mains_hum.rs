//! Mains hum: the line frequency and its double in the measured channels, in no relation to the shaft.
//!
//! Signature: lines at 50/100 (60/120) Hz at every speed and torque; the phase to the shaft differs per run.

use super::hypothesis::{Carried, Fitted, Hidden, Hypothesis, Path, Seat};
use super::{CHANNEL, Entry, parameter, random};
use crate::dynamics::excitation::{Effect, Recurrence, Sampled};
use std::f64::consts::TAU;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "mains-hum",
    meaning: "line frequency and its double picked up by the measuring chain",
    signature: "lines at the line frequency and twice it, at every speed and torque",
    example: "first=0.05,second=0.03",
    span_hz: 500.0,
    parameters: &[
        parameter("first", "m/s2", 0.05, [0.0, 1e4], "amplitude at the line frequency"),
        parameter("second", "m/s2", 0.0, [0.0, 1e4], "amplitude at twice the line frequency"),
        parameter("frequency", "Hz", 50.0, [10.0, 400.0], "line frequency"),
        CHANNEL,
    ],
    build: |v| {
        let [first, second, frequency_hz] = ["first", "second", "frequency"].map(|n| v.get(n));
        Box::new(MainsHum { amplitudes: [first, second], frequency_hz, channels: v.channels() })
    },
    hypotheses: &[Hypothesis {
        name: "mains-hum",
        plain: "additive tone at a fixed frequency",
        seats: &[Seat::Path(Path::LineTone)],
        quantity: "acceleration_of_the_larger_channel",
        unit: "m/s2",
        carry: per_channel,
        ..Hypothesis::DEFAULTS
    }],
    hidden: &[Hidden {
        name: "mains-hum",
        right_names: &["mains-hum"],
        families: &["fixed-frequency"],
        reference: 0.1,
        parameter: "acceleration",
        draw: |size, draw| {
            let hz = [50, 100, 150][draw.below(3) as usize];
            let on =
                |share: f64, channel: u32| format!("mains-hum:first={},frequency={hz},channel={channel}", share * size);
            vec![on(1.0, 0), on(0.6, 1)]
        },
        ..Hidden::DEFAULTS
    }],
};

/// One tone per channel where they differ.
fn per_channel(f: &Fitted<'_>) -> Option<Carried> {
    let (hz, larger) = (f.frequency_hz?, f.size);
    // Line frequencies only; harmonics are tones.
    let (name, key) = if hz <= 400.0 { ("mains-hum", "first") } else { ("fixed-tone", "amplitude") };
    let tone = |share: f64, on: f64| (name, vec![(key, share * larger), ("frequency", hz), ("channel", on)]);
    let tables = match f.channel_share {
        [a, b] if (a - b).abs() < 0.05 => vec![tone(0.5 * (a + b), 2.0)],
        [a, b] => vec![tone(a, 0.0), tone(b, 1.0)],
    };
    Some(Carried { tables, remark: None })
}

struct MainsHum {
    amplitudes: [f64; 2],
    frequency_hz: f64,
    channels: std::ops::Range<usize>,
}

impl Effect for MainsHum {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Mesh
    }

    fn measure(&self, sampled: &mut Sampled) {
        let start = rand::RngExt::random::<f64>(&mut random(sampled.seed, 102));
        for channel in &mut sampled.channels[self.channels.clone()] {
            for (i, x) in channel.iter_mut().enumerate() {
                let angle = TAU * (start + self.frequency_hz * i as f64 / sampled.rate_hz);
                *x += self.amplitudes[0] * angle.cos() + self.amplitudes[1] * (2.0 * angle).cos();
            }
        }
    }
}
