//! A second path from the machine to the sensor: the signal once more, later and weaker.
//!
//! `y(t) + gain y(t - delay)`. Signature: every line is scaled and turned by a factor that repeats over frequency
//! with one over the delay; no new lines. Assumes one such path without a loss of its own; of several the strongest
//! is meant.

use super::filter::pass;
use super::hypothesis::{Hidden, Hypothesis, Path, Seat, one};
use super::{CHANNEL, Entry, parameter};
use crate::dynamics::excitation::{Effect, Recurrence, Sampled};
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "echo",
    meaning: "a second path to the sensor: the signal once more, later and weaker",
    signature: "amplitudes and phases swing over frequency with one over the delay; no new lines",
    example: "gain=0.3,delay=0.0013",
    span_hz: 5120.0,
    parameters: &[
        parameter("gain", "", 0.2, [-0.95, 0.95], "of the second path over the first"),
        parameter("delay", "s", 1e-3, [0.0, 0.1], "time it comes later"),
        CHANNEL,
    ],
    build: |v| Box::new(Echo { gain: v.get("gain"), delay_s: v.get("delay"), channels: v.channels() }),
    hypotheses: &[Hypothesis {
        name: "echo",
        plain: "second path to the sensor with a delay",
        seats: &[Seat::Path(Path::Echo)],
        quantity: "gain",
        carry: |f| Some(one("echo", [("gain", f.size), ("delay", f.shape[0]), f.on()])),
        ..Hypothesis::DEFAULTS
    }],
    hidden: &[Hidden {
        name: "echo",
        right_names: &["echo"],
        families: &["path"],
        reference: 0.05,
        parameter: "gain",
        draw: |size, draw| vec![format!("echo:gain={size},delay={}", 5e-4 + 2.5e-3 * draw.share())],
        ..Hidden::DEFAULTS
    }],
};

struct Echo {
    gain: f64,
    delay_s: f64,
    channels: std::ops::Range<usize>,
}

impl Effect for Echo {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Mesh
    }

    fn measure(&self, sampled: &mut Sampled) {
        pass(sampled, self.channels.clone(), |hz| 1.0 + Complex64::from_polar(self.gain, -TAU * hz * self.delay_s));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::excitation::Facts;

    #[test]
    fn theory_a_line_comes_once_more_later_and_weaker() {
        let facts = Facts {
            teeth: [19, 48],
            base_radius_m: [0.03, 0.07],
            base_pitch_m: 0.009,
            pressure_angle_rad: 0.35,
            path_base_pitches: 1.6,
            pitch_point_base_pitches: 0.8,
            mass_kg: [1.0, 3.0],
            input_torque_n_m: 10.0,
            bearing_stiffness_n_per_m: [1e8; 2],
        };
        let (rate_hz, hz, gain, delay_s) = (25_600.0, 437.0, 0.3, 0.0013);
        let line = |t: f64| (TAU * hz * t).sin();
        let direct: Vec<f64> = (0..25_600).map(|i| line(i as f64 / rate_hz)).collect();
        let mut channels = vec![direct.clone(), direct];
        let mut sampled = Sampled { channels: &mut channels, rate_hz, seed: 1, turns: &[], facts: &facts };
        Echo { gain, delay_s, channels: 0..1 }.measure(&mut sampled);
        for i in (5000..20_000).step_by(37) {
            let t = i as f64 / rate_hz;
            let wanted = line(t) + gain * line(t - delay_s);
            assert!((channels[0][i] - wanted).abs() < 1e-4, "{i}: {} for {wanted}", channels[0][i]);
            assert_eq!(channels[1][i], line(t));
        }
    }
}
