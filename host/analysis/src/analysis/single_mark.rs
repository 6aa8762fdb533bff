//! Edges of a single mark per turn, less the errors that neighbouring edges do not share.
//!
//! A voltage with steep edges is known to half a sample, 11 us at 25.6 kHz: at the tenth mesh harmonic that is
//! phase, and lines beside it. The times are taken for a sum of three: a smooth course (third differences white), a
//! speed that differs from turn to turn (first differences white), and independent errors of the edges. Their three
//! powers come from the spectrum of the third differences by maximum likelihood (Whittle 1953); the errors' part is
//! taken off (Wiener). What of the times is course and what is error is so asked of the record, and nothing is taken
//! off where the errors are small. Cost: two transforms. Limit: an error that repeats over many turns (a steady
//! speed in step with the sampling) cannot be told from a wander.

use realfft::RealFftPlanner;
use rustfft::num_complex::Complex64 as C;
use std::f64::consts::PI;

/// Fewest edges whose errors can be told.
const FEWEST: usize = 32;
/// Bands that the spectrum is averaged to for the likelihood.
const BANDS: usize = 256;
/// Powers tried, over that of the errors: smooth course and speed from turn to turn, as powers of ten.
const SMOOTH: std::ops::RangeInclusive<i32> = -24..=12;
const TURNS: std::ops::RangeInclusive<i32> = -17..=12;
/// Steps per power of ten.
const STEPS: f64 = 3.0;

/// Powers of the three parts, over that of the errors, and the errors' standard deviation, s.
#[derive(Debug, Clone, Copy)]
struct Parts {
    smooth: f64,
    turns: f64,
    sigma_s: f64,
}

/// The times of `edges_s` less their independent errors; unchanged where that would go back in time or there are too
/// few.
pub fn smoothed(edges_s: &[f64]) -> Vec<f64> {
    let n = edges_s.len();
    if n < FEWEST {
        return edges_s.to_vec();
    }
    let thirds: Vec<f64> = edges_s.windows(4).map(|w| w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]).collect();
    // As long again of zeros: the ends do not see each other.
    let length = (2 * thirds.len()).next_power_of_two();
    let mut planner = RealFftPlanner::new();
    let (forth, back) = (planner.plan_fft_forward(length), planner.plan_fft_inverse(length));
    let mut input = thirds.clone();
    input.resize(length, 0.0);
    let mut spectrum = forth.make_output_vec();
    if forth.process(&mut input, &mut spectrum).is_err() {
        return edges_s.to_vec();
    }
    let powers: Vec<f64> = spectrum.iter().map(|c| c.norm_sqr() / thirds.len() as f64).collect();
    let Some(parts) = likeliest(&powers) else { return edges_s.to_vec() };
    for (i, value) in spectrum.iter_mut().enumerate() {
        let (_, model) = model(i as f64 / (powers.len() - 1) as f64, parts);
        *value /= model;
    }
    spectrum[0] = C::new(spectrum[0].re, 0.0);
    let last = spectrum.len() - 1;
    spectrum[last] = C::new(spectrum[last].re, 0.0);
    let mut weighted = back.make_output_vec();
    if back.process(&mut spectrum, &mut weighted).is_err() {
        return edges_s.to_vec();
    }
    // The errors: the transposed third difference of the weighted ones.
    let mut smooth = edges_s.to_vec();
    for (k, weight) in weighted[..thirds.len()].iter().map(|w| w / length as f64).enumerate() {
        for (edge, factor) in [-1.0, 3.0, -3.0, 1.0].into_iter().enumerate() {
            smooth[k + edge] -= factor * weight;
        }
    }
    if smooth.windows(2).all(|w| w[1] > w[0]) { smooth } else { edges_s.to_vec() }
}

/// The errors' part and the whole of the spectrum of third differences at a share of the highest frequency, over the
/// errors' power.
fn model(share: f64, parts: Parts) -> (f64, f64) {
    let difference = 2.0 - 2.0 * (PI * share).cos();
    let errors = difference.powi(3);
    (errors, parts.smooth + parts.turns * difference * difference + errors)
}

/// The parts under which the spectrum is likeliest; `None` of a spectrum of nothing.
fn likeliest(powers: &[f64]) -> Option<Parts> {
    let bands = BANDS.min(powers.len() - 1);
    let band = |b: usize| {
        let (from, to) = (1 + b * (powers.len() - 1) / bands, 1 + (b + 1) * (powers.len() - 1) / bands);
        let mean = powers[from..to].iter().sum::<f64>() / (to - from) as f64;
        (0.5 * (from + to - 1) as f64 / (powers.len() - 1) as f64, mean)
    };
    let bands: Vec<(f64, f64)> = (0..bands).map(band).filter(|(_, power)| power.is_finite()).collect();
    let power_of = |step: i32| 10.0_f64.powf(f64::from(step) / STEPS);
    let mut best: Option<(f64, Parts)> = None;
    for smooth in SMOOTH.map(power_of) {
        for turns in TURNS.map(power_of) {
            let parts = Parts { smooth, turns, sigma_s: 0.0 };
            let (mut logs, mut ratios) = (0.0, 0.0);
            for (share, power) in &bands {
                let (_, whole) = model(*share, parts);
                logs += whole.ln();
                ratios += power / whole;
            }
            // The errors' own power is the one that fits best: the mean of the ratios.
            let variance = ratios / bands.len() as f64;
            let cost = logs + bands.len() as f64 * variance.ln();
            if variance > 0.0 && best.is_none_or(|(before, _)| cost < before) {
                best = Some((cost, Parts { sigma_s: variance.sqrt(), ..parts }));
            }
        }
    }
    best.map(|(_, parts)| parts).filter(|parts| parts.sigma_s > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// Edges of a wandering speed about 18 turns/s.
    fn truth(count: usize) -> Vec<f64> {
        let swing = |t: f64, share: f64, hz: f64| share / (TAU * hz) * (1.0 - (TAU * hz * t).cos());
        (0..count)
            .map(|k| {
                let turn = k as f64 / 18.0;
                turn + swing(turn, 0.006, 0.21) + swing(turn, 0.002, 0.83)
            })
            .collect()
    }

    fn rms(a: &[f64], b: &[f64]) -> f64 {
        (a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
    }

    #[test]
    fn theory_edges_of_whole_samples_come_out_better() {
        let truth = truth(500);
        let rate_hz = 25_600.0;
        let edges: Vec<f64> = truth.iter().map(|t| ((t * rate_hz).floor() + 0.5) / rate_hz).collect();
        let (before, after) = (rms(&edges, &truth), rms(&smoothed(&edges), &truth));
        assert!(after < 0.65 * before, "{after:e} of {before:e}");
        assert!(rms(&smoothed(&truth), &truth) < 1e-9, "a smooth course is left alone");
    }

    #[test]
    fn theory_a_speed_that_differs_from_turn_to_turn_is_kept() {
        let mut state = 5_u64;
        let mut t = 0.0;
        let edges: Vec<f64> = (0..800)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                t += 0.05 * (1.0 + 0.01 * ((state >> 33) as f64 / f64::from(1_u32 << 31) - 0.5));
                t
            })
            .collect();
        let away = rms(&smoothed(&edges), &edges);
        assert!(away < 5e-5, "{away:e} of steps of {:e}", 0.05 * 0.01 / 12.0_f64.sqrt());
    }
}
