//! Pulses of an encoder above half the sampling rate: what they would be if they were folded.
//!
//! A train of f pulses per second sampled at r looks like |f - k r|: clean edges of a small, steady speed, with the
//! wander of the real one in it. The channels know better: for every k and either sign the speed of every frame
//! follows, and with it where the mesh comb stands there. The fold that puts a comb where there is one, and where
//! the pulses as they look put none, is named. Cost: spectra of half-second frames, then a few reads per fold and
//! frame.

use super::comb::{Combs, excess_db};
use super::pulsed::Pulsed;
use serde::Serialize;

/// Length of a frame, s.
const FRAME_S: f64 = 0.5;
/// Most folds that are tried, and fastest shaft, turns/s.
const MOST_FOLDS: u32 = 40;
const FASTEST_HZ: f64 = 300.0;
/// Fewest marks of an encoder: a wheel of fewer would turn at more than half the rate over that.
const LEAST_MARKS: u32 = 16;
/// Height of the comb over its surroundings, dB per line, and over that of the pulses as they look.
const LEAST_DB: f64 = 8.0;
const BETTER_DB: f64 = 6.0;
/// Samples per pulse from which edges are followed.
const SAMPLES_PER_PULSE: f64 = 3.0;

/// What the pulses really are.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Fold {
    /// Speed of the tach's shaft, turns per second.
    pub shaft_speed_hz: f64,
    /// Pulses per second.
    pub pulses_hz: f64,
    /// Rate at which they were sampled, Hz.
    pub sampled_at_hz: f64,
    /// Excess of the comb that says so, dB per line.
    pub excess_db: f64,
}

impl Fold {
    /// Lowest sampling rate that would do, Hz.
    pub fn needed_hz(&self) -> f64 {
        SAMPLES_PER_PULSE * self.pulses_hz
    }

    /// For people.
    pub fn sentence(&self, marks: u32) -> String {
        format!(
            "the pulses are folded: the mesh line puts the shaft at {:.3} turns/s, where {marks} marks make {:.0} \
             pulses per second, more than half of the {:.0} Hz they were sampled at; sample them at {:.0} Hz or \
             faster (three samples per pulse), or use fewer marks",
            self.shaft_speed_hz,
            self.pulses_hz,
            self.sampled_at_hz,
            self.needed_hz()
        )
    }
}

/// The fold that explains the channels, where the pulses as they look (`as_it_looks_db`) do not.
pub(super) fn find(pulsed: &Pulsed<'_>, as_it_looks_db: f64) -> Option<Fold> {
    let sampled_at_hz = pulsed.sampled_at_hz?;
    if pulsed.pulses < LEAST_MARKS {
        return None;
    }
    let marks = f64::from(pulsed.pulses);
    let length = (FRAME_S * pulsed.rate_hz) as usize;
    let samples = pulsed.channels.first()?.len();
    if length < 256 || samples < 4 * length {
        return None;
    }
    // Every frame with the pulses per second that it shows.
    let frames: Vec<(Combs, f64)> = (0..samples / length)
        .filter_map(|m| {
            let (from, to) = (m * length, (m + 1) * length);
            let seen_hz = pulses_between(pulsed.edges_s, from as f64 / pulsed.rate_hz, to as f64 / pulsed.rate_hz)?;
            let part: Vec<Vec<f64>> = pulsed.channels.iter().map(|channel| channel[from..to].to_vec()).collect();
            let excess = excess_db(&part, pulsed.rate_hz, length);
            Some((Combs::of(excess, pulsed.teeth, pulsed.rate_hz), seen_hz))
        })
        .collect();
    if frames.len() < 4 {
        return None;
    }
    let mean_seen_hz = frames.iter().map(|frame| frame.1).sum::<f64>() / frames.len() as f64;
    let mut best: Option<(f64, f64)> = None;
    for k in 1..=MOST_FOLDS {
        for sign in [1.0, -1.0] {
            let pulses_hz = |seen_hz: f64| f64::from(k) * sampled_at_hz + sign * seen_hz;
            let mean_hz = pulses_hz(mean_seen_hz);
            if mean_hz / marks > FASTEST_HZ {
                continue;
            }
            let mesh_hz = |seen_hz: f64| pulses_hz(seen_hz) / marks / pulsed.ratio * f64::from(pulsed.teeth[0]);
            if !frames.iter().all(|(combs, seen_hz)| combs.can_see(mesh_hz(*seen_hz))) {
                continue;
            }
            let scores = frames.iter().map(|(combs, seen_hz)| combs.score(mesh_hz(*seen_hz)));
            let db = scores.sum::<f64>() / frames.len() as f64;
            if best.is_none_or(|(_, before)| db > before) {
                best = Some((mean_hz, db));
            }
        }
    }
    let (pulses_hz, excess_db) = best?;
    let clear = excess_db >= LEAST_DB && excess_db >= as_it_looks_db + BETTER_DB;
    clear.then_some(Fold { shaft_speed_hz: pulses_hz / marks, pulses_hz, sampled_at_hz, excess_db })
}

/// Pulses per second between two times, by the pulses next to them; `None` where there are none.
fn pulses_between(edges_s: &[f64], from_s: f64, to_s: f64) -> Option<f64> {
    let first = edges_s.partition_point(|t| *t < from_s);
    let last = edges_s.partition_point(|t| *t < to_s).checked_sub(1)?;
    (last > first + 1).then(|| (last - first) as f64 / (edges_s[last] - edges_s[first]))
}
