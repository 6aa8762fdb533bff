//! Bearing defect: impacts as rolling elements pass a spall, each ringing a housing mode, with slip jitter.
//!
//! The interval between impacts is a share of the turn with a random deviation each time (1-2 %): the train is
//! cyclostationary, not periodic, and smears at high harmonics. Added to the measured channel, since the mode
//! that rings is the housing's at the sensor. Signature: bursts at a fixed high frequency whose envelope has
//! a line at the (non-integer) passage order.

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
        parameter("frequency", "Hz", 3200.0, [1.0, 1e6], "of the mode that rings"),
        parameter("damping", "", 0.03, [1e-4, 0.9], "ratio of the mode"),
        CHANNEL,
        GEAR,
    ],
    build: |v| {
        let [peak, order, jitter, frequency_hz, damping] =
            ["peak", "order", "jitter", "frequency", "damping"].map(|n| v.get(n));
        let (channels, body) = (v.channels(), v.body());
        Box::new(BearingImpacts { peak, order, jitter, frequency_hz, damping, channels, body })
    },
    hypotheses: &[Hypothesis {
        name: "bearing-impacts",
        plain: "impacts repeating at an order of no shaft",
        seats: &[Seat::Record],
        ..Hypothesis::PLAIN
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
        ..Hidden::PLAIN
    }],
};

struct BearingImpacts {
    peak: f64,
    order: f64,
    jitter: f64,
    frequency_hz: f64,
    damping: f64,
    channels: std::ops::Range<usize>,
    body: usize,
}

impl Effect for BearingImpacts {
    fn measure(&self, sampled: &mut Sampled) {
        let mut random = random(sampled.seed, 101);
        let [z1, z2] = sampled.facts.teeth.map(f64::from);
        let per_pinion_turn = if self.body == 0 { self.order } else { self.order * z1 / z2 };
        let mut next = sampled.turns[0] + rand::RngExt::random::<f64>(&mut random) / per_pinion_turn;
        let decay = self.damping * TAU * self.frequency_hz;
        // A burst ends where it has fallen to a millionth.
        let length = (14.0 / decay * sampled.rate_hz).ceil() as usize;
        for i in 1..sampled.turns.len() {
            let (before, now) = (sampled.turns[i - 1], sampled.turns[i]);
            while now >= next && now > before {
                let late = (now - next) / (now - before) / sampled.rate_hz;
                for channel in &mut sampled.channels[self.channels.clone()] {
                    for (n, x) in channel[i..].iter_mut().take(length).enumerate() {
                        let t = late + n as f64 / sampled.rate_hz;
                        *x += self.peak * (-decay * t).exp() * (TAU * self.frequency_hz * t).sin();
                    }
                }
                let wander: f64 = StandardNormal.sample(&mut random);
                next += (1.0 + self.jitter * wander).max(0.1) / per_pinion_turn;
            }
        }
    }
}
