//! A tachometer wheel and the voltage of its pick-up.
//!
//! The marks' places depart from even ones by drawn shares of the pitch whose sum is zero. The wheel turns with the
//! prescribed rotation of its shaft (wander, run-up and effects on the angle included); the twist of the shafts,
//! micrometres at the rim, is left out.

use super::declaration::Wheel;
use crate::dynamics::crossings::crossings;
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};

/// Places of the marks behind their even places, shares of the pitch.
pub fn drawn_places(wheel: &Wheel, random: &mut ChaCha12Rng) -> Vec<f64> {
    let marks = wheel.pulses as usize;
    let raw: Vec<f64> = StandardNormal.sample_iter(random).take(marks).collect();
    let mean = raw.iter().sum::<f64>() / marks as f64;
    let rms = (raw.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / marks as f64).sqrt();
    // One mark is always in its place.
    let scale = if marks > 1 { 0.01 * wheel.irregularity_percent / rms } else { 0.0 };
    raw.iter().map(|x| scale * (x - mean)).collect()
}

/// Rising and falling edges in the middle of their rise, s from the first sample of `turns`.
pub struct Edges {
    /// Rising ones; the first belongs to mark `first`.
    pub rising_s: Vec<f64>,
    /// Falling ones, as many or one fewer.
    pub falling_s: Vec<f64>,
    /// Number of the mark of the first rising edge.
    pub first: usize,
}

/// Edges while the wheel turns through `turns` (at `index / rate_hz`), which `angle` gives at any time.
pub fn edges(wheel: &Wheel, places: &[f64], turns: &[f64], rate_hz: f64, angle: &impl Fn(f64) -> f64) -> Edges {
    let marks = places.len() as i64;
    let place = |k: i64| (k as f64 + places[k.rem_euclid(marks) as usize]) / marks as f64;
    let mut first = (turns[0] * marks as f64).floor() as i64 - 1;
    while place(first) <= turns[0] {
        first += 1;
    }
    let rising_s = crossings(turns, rate_hz, angle, (first..).map(place));
    let high = wheel.duty / marks as f64;
    let falling_s = crossings(turns, rate_hz, angle, (first..).map(|k| place(k) + high));
    Edges { rising_s, falling_s, first: first.rem_euclid(marks) as usize }
}

/// Voltage at `index / rate_hz`.
pub fn voltage(wheel: &Wheel, edges: &Edges, count: usize, rate_hz: f64, random: &mut ChaCha12Rng) -> Vec<f64> {
    let [low, high] = wheel.levels_v;
    let rise_s = wheel.rise_s.max(1e-9);
    let ramp = |t: f64| (t / rise_s + 0.5).clamp(0.0, 1.0);
    let noise: Vec<f64> = StandardNormal.sample_iter(random).take(count).collect();
    let mut voltage: Vec<f64> = noise.into_iter().map(|n| low + wheel.noise_v * n).collect();
    let end_s = count as f64 / rate_hz + rise_s;
    let falling = edges.falling_s.iter().copied().chain(std::iter::repeat(end_s));
    for (&up, down) in edges.rising_s.iter().zip(falling) {
        let from = ((up - 0.5 * rise_s) * rate_hz).floor().max(0.0) as usize;
        let to = ((down + 0.5 * rise_s) * rate_hz).ceil().max(0.0) as usize;
        for (i, v) in voltage.iter_mut().enumerate().take(to.saturating_add(1)).skip(from) {
            let t = i as f64 / rate_hz;
            *v += (high - low) * (ramp(t - up) - ramp(t - down));
        }
    }
    voltage
}
