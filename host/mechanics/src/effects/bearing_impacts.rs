//! Bearing defect: impacts as rolling elements pass a spall, each ringing a housing mode, with slip and jitter.
//!
//! A point process: the interval between impacts is a share of the turn, longer by the cage's slip, with a random
//! deviation each time, so that the train is cyclostationary, not periodic, and its lines smear with the harmonic
//! number (Antoni, Randall 2003). Each impact's strength scatters, and follows the load where the damage turns
//! through it: `q = q0 cos(angle)^1.5` over half a turn (Harris, Rolling Bearing Analysis; clearance zero). Added to
//! the measured channel, since the mode that rings is the housing's at the sensor. Signature: bursts at a fixed high
//! frequency whose envelope has a line at the (non-integer) passage order.

use super::hypothesis::{Hidden, Hypothesis, Seat};
use super::{CHANNEL, Entry, GEAR, parameter, random};
use crate::dynamics::excitation::{Effect, Sampled};
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "bearing-impacts",
    meaning: "impacts of a bearing defect ringing a housing mode",
    signature: "a raised band at the mode; its envelope has a smeared line at the passage order",
    example: "peak=5",
    span_hz: 5120.0,
    parameters: &[
        parameter("peak", "m/s2", 5.0, [0.0, 1e5], "first crest of a burst"),
        parameter("order", "", 3.57, [0.01, 1000.0], "impacts per turn of its shaft"),
        parameter("jitter", "", 0.01, [0.0, 0.3], "standard deviation of an interval, share of it"),
        parameter("slip", "", 0.0, [0.0, 0.05], "share by which the passage is slower than the order"),
        parameter(
            "load",
            "",
            0.0,
            [0.0, 1.0],
            "share of the strength that the load gives where the ring turns through it: 1 inner ring",
        ),
        parameter("scatter", "", 0.0, [0.0, 1.0], "standard deviation of an impact's strength, share of it"),
        parameter("frequency", "Hz", 3200.0, [1.0, 1e6], "of the mode that rings"),
        parameter("damping", "", 0.03, [1e-4, 0.9], "ratio of the mode"),
        CHANNEL,
        GEAR,
    ],
    build: |v| {
        let [peak, order, jitter, slip, load, scatter, frequency_hz, damping] =
            ["peak", "order", "jitter", "slip", "load", "scatter", "frequency", "damping"].map(|n| v.get(n));
        let (channels, body) = (v.channels(), v.body());
        Box::new(BearingImpacts { peak, order, jitter, slip, load, scatter, frequency_hz, damping, channels, body })
    },
    hypotheses: &[Hypothesis {
        name: "bearing-impacts",
        plain: "impacts repeating at an order of no shaft",
        seats: &[Seat::Record],
        ..Hypothesis::DEFAULTS
    }],
    hidden: &[Hidden {
        name: "bearing-impacts",
        right_names: &["bearing-impacts"],
        families: &["impulsive", "non-integer-order"],
        reference: 5.0,
        draw: |size, draw| {
            let (channel, order) = (draw.side(), draw.odd_order());
            vec![format!("bearing-impacts:peak={size},order={order},frequency=4000,damping=0.05,channel={channel}")]
        },
        ..Hidden::DEFAULTS
    }],
};

struct BearingImpacts {
    peak: f64,
    order: f64,
    jitter: f64,
    slip: f64,
    load: f64,
    scatter: f64,
    frequency_hz: f64,
    damping: f64,
    channels: std::ops::Range<usize>,
    body: usize,
}

impl Effect for BearingImpacts {
    fn measure(&self, sampled: &mut Sampled) {
        let mut random = random(sampled.seed, 101);
        let [z1, z2] = sampled.facts.teeth.map(f64::from);
        let own = if self.body == 0 { 1.0 } else { z1 / z2 };
        let per_pinion_turn = self.order * own * (1.0 - self.slip);
        let mut next = sampled.turns[0] + rand::RngExt::random::<f64>(&mut random) / per_pinion_turn;
        let decay = self.damping * TAU * self.frequency_hz;
        // A burst ends where it has fallen to a millionth.
        let length = (14.0 / decay * sampled.rate_hz).ceil() as usize;
        for i in 1..sampled.turns.len() {
            let (before, now) = (sampled.turns[i - 1], sampled.turns[i]);
            while now >= next && now > before {
                let strength = self.peak * self.strength(next * own, &mut random);
                let late = (now - next) / (now - before) / sampled.rate_hz;
                for channel in &mut sampled.channels[self.channels.clone()] {
                    for (n, x) in channel[i..].iter_mut().take(length).enumerate() {
                        let t = late + n as f64 / sampled.rate_hz;
                        *x += strength * (-decay * t).exp() * (TAU * self.frequency_hz * t).sin();
                    }
                }
                let wander: f64 = StandardNormal.sample(&mut random);
                next += (1.0 + self.jitter * wander).max(0.1) / per_pinion_turn;
            }
        }
    }
}

impl BearingImpacts {
    /// Strength of an impact at an angle of its shaft, turns, over the strongest one's mean.
    fn strength(&self, turns: f64, random: &mut impl rand::Rng) -> f64 {
        let zone = (TAU * turns).cos().max(0.0).powf(1.5);
        let scatter: f64 = if self.scatter > 0.0 { StandardNormal.sample(random) } else { 0.0 };
        (1.0 - self.load + self.load * zone) * (1.0_f64 + self.scatter * scatter).max(0.0)
    }
}
