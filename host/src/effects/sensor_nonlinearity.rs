//! Nonlinear sensor: `y + quadratic y^2 + cubic y^3`.
//!
//! Signature: sums and differences of all strong lines, growing with the square (cube) of the signal.

use super::{CHANNEL, Entry, parameter};
use crate::dynamics::excitation::{Effect, Sampled};

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "sensor-nonlinearity",
    meaning: "a sensor whose gain depends on the signal",
    signature: "a mean value, sums and differences of strong lines; grows with the signal's square",
    example: "quadratic=0.05",
    span_hz: 2000.0,
    parameters: &[
        parameter("quadratic", "s2/m", 1e-3, [-1.0, 1.0], "factor of the square"),
        parameter("cubic", "s4/m2", 0.0, [-1.0, 1.0], "factor of the cube"),
        CHANNEL,
    ],
    build: |v| {
        let [quadratic, cubic] = ["quadratic", "cubic"].map(|n| v.get(n));
        Box::new(Nonlinearity { quadratic, cubic, channels: v.channels() })
    },
};

struct Nonlinearity {
    quadratic: f64,
    cubic: f64,
    channels: std::ops::Range<usize>,
}

impl Effect for Nonlinearity {
    fn measure(&self, sampled: &mut Sampled) {
        for x in sampled.channels[self.channels.clone()].iter_mut().flatten() {
            *x += *x * *x * (self.quadratic + self.cubic * *x);
        }
    }
}
