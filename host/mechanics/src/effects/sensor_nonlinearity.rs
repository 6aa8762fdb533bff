//! Nonlinear sensor: `y + quadratic y^2 + cubic y^3`.
//!
//! Signature: sums and differences of all strong lines, growing with the square (cube) of the signal.

use super::hypothesis::{Hidden, Hypothesis, Path, Seat, one};
use super::{CHANNEL, Entry, parameter};
use crate::dynamics::excitation::{Effect, Recurrence, Sampled};

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
    hypotheses: &[
        Hypothesis {
            name: "sensor-nonlinearity",
            seats: &[Seat::Path(Path::Square)],
            quantity: "quadratic",
            unit: "s2/m",
            carry: |f| Some(one("sensor-nonlinearity", [("quadratic", f.size), f.on()])),
            ..Hypothesis::DEFAULTS
        },
        Hypothesis {
            name: "sensor-nonlinearity",
            seats: &[Seat::Path(Path::Cube)],
            quantity: "cubic",
            unit: "s4/m2",
            carry: |f| Some(one("sensor-nonlinearity", [("quadratic", 0.0), ("cubic", f.size), f.on()])),
            ..Hypothesis::DEFAULTS
        },
    ],
    hidden: &[
        Hidden {
            name: "sensor-nonlinearity",
            right_names: &["sensor-nonlinearity"],
            families: &["path"],
            reference: 1e-3,
            draw: |size, draw| vec![format!("sensor-nonlinearity:quadratic={size},channel={}", draw.side())],
            ..Hidden::DEFAULTS
        },
        Hidden {
            name: "cubic-nonlinearity",
            right_names: &["sensor-nonlinearity"],
            families: &["path"],
            reference: 1e-5,
            parameter: "cubic",
            draw: |size, draw| vec![format!("sensor-nonlinearity:quadratic=0,cubic={size},channel={}", draw.side())],
            ..Hidden::DEFAULTS
        },
    ],
};

struct Nonlinearity {
    quadratic: f64,
    cubic: f64,
    channels: std::ops::Range<usize>,
}

impl Effect for Nonlinearity {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Mesh
    }

    fn measure(&self, sampled: &mut Sampled) {
        for x in sampled.channels[self.channels.clone()].iter_mut().flatten() {
            *x += *x * *x * (self.quadratic + self.cubic * *x);
        }
    }
}
