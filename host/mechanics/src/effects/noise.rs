//! Measurement noise, white or coloured by a first-order low-pass.
//!
//! Signature: a floor, flat (white) or falling with frequency (coloured); independent of speed and torque.

use super::{CHANNEL, Entry, parameter, random};
use crate::dynamics::excitation::{Effect, Recurrence, Sampled};
use rand_distr::{Distribution, StandardNormal};

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "noise",
    meaning: "random noise of the measuring chain",
    signature: "a floor, flat or falling with frequency; independent of speed and torque",
    example: "rms=0.5,colour=0.9",
    span_hz: 5120.0,
    parameters: &[
        parameter("rms", "m/s2", 0.1, [0.0, 1e5], "of the noise"),
        parameter("colour", "", 0.0, [0.0, 0.9999], "correlation of neighbouring samples: 0 white"),
        CHANNEL,
    ],
    build: |v| Box::new(Noise { rms: v.get("rms"), colour: v.get("colour"), channels: v.channels() }),
    hypotheses: &[],
    hidden: &[],
};

struct Noise {
    rms: f64,
    colour: f64,
    channels: std::ops::Range<usize>,
}

impl Effect for Noise {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Mesh
    }

    fn measure(&self, sampled: &mut Sampled) {
        let mut random = random(sampled.seed, 104);
        let share = (1.0 - self.colour * self.colour).sqrt();
        for channel in &mut sampled.channels[self.channels.clone()] {
            // Stationary from the first sample on.
            let mut state: f64 = StandardNormal.sample(&mut random);
            for x in channel.iter_mut() {
                *x += self.rms * state;
                let white: f64 = StandardNormal.sample(&mut random);
                state = self.colour * state + share * white;
            }
        }
    }
}
