//! Edges of a single mark per turn, less the errors that neighbouring edges do not share.
//!
//! A voltage with steep edges is known to half a sample, 11 us at 25.6 kHz: at the tenth mesh harmonic that is
//! phase, and lines beside it. The times are taken for a sum of three: a smooth course (third differences white), a
//! speed that differs from turn to turn (first differences white), and independent errors of the edges. Their three
//! powers come from the spectrum of the third differences by maximum likelihood (Whittle 1953); the errors' part is
//! taken off (Wiener), as the exact answer for the edges there are: with periodic ends the errors of a nearly even
//! speed, which has no power at the lowest frequencies, ran away. What of the times is course and what is error is so
//! asked of the record, and nothing is taken off where the errors are small, nor where a turn would become faster or
//! slower than its neighbours are measured to be. Cost: one transform and one pass. Limit: an error that repeats over
//! many turns (a steady speed in step with the sampling) cannot be told from a wander.

use realfft::RealFftPlanner;
use std::f64::consts::PI;

/// Fewest edges whose errors can be told.
const MIN_EDGES: usize = 32;
/// Bands that the spectrum is averaged to for the likelihood.
const BANDS: usize = 256;
/// Powers tried, over that of the errors: smooth course and speed from turn to turn, as powers of ten.
const SMOOTHNESS_EXPONENTS: std::ops::RangeInclusive<i32> = -24..=12;
const TURNS: std::ops::RangeInclusive<i32> = -17..=12;
/// Steps per power of ten.
const STEPS: f64 = 3.0;
/// Turns to either side that a turn is compared with, and by how much it may lie outside what those are measured to
/// last, share of a turn beside their own range: a speed changes with the shaft's inertia, not in one turn alone.
const NEIGHBOURS: usize = 2;
const MAX_EXCESS_SHARE: f64 = 0.005;

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
    if n < MIN_EDGES {
        return edges_s.to_vec();
    }
    let thirds: Vec<f64> = edges_s.windows(4).map(|w| w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]).collect();
    // As long again of zeros: the ends do not see each other.
    let length = (2 * thirds.len()).next_power_of_two();
    let forth = RealFftPlanner::<f64>::new().plan_fft_forward(length);
    let mut input = thirds.clone();
    input.resize(length, 0.0);
    let mut spectrum = forth.make_output_vec();
    if forth.process(&mut input, &mut spectrum).is_err() {
        return edges_s.to_vec();
    }
    let powers: Vec<f64> = spectrum.iter().map(|c| c.norm_sqr() / thirds.len() as f64).collect();
    let Some(weighted) = likeliest(&powers).and_then(|parts| weighted(&thirds, parts)) else {
        return edges_s.to_vec();
    };
    // The errors: the transposed third difference of the weighted ones.
    let mut smooth = edges_s.to_vec();
    for (k, weight) in weighted.iter().enumerate() {
        for (edge, factor) in [-1.0, 3.0, -3.0, 1.0].into_iter().enumerate() {
            smooth[k + edge] -= factor * weight;
        }
    }
    if keeps_to(&smooth, edges_s) { smooth } else { edges_s.to_vec() }
}

/// The third differences over their covariance, which is a band: that of [`model`], its three parts' own covariances
/// (1; 6, -4, 1; 20, -15, 6, -1) summed. `None` where it cannot be solved for.
fn weighted(thirds: &[f64], parts: Parts) -> Option<Vec<f64>> {
    let Parts { smooth, turns, .. } = parts;
    let band = [smooth + 6.0 * turns + 20.0, -4.0 * turns - 15.0, turns + 6.0, -1.0];
    // Rows of the lower factor of L D L': its three entries before the diagonal, nearest first.
    let (mut rows, mut pivots) = (Vec::<[f64; 3]>::with_capacity(thirds.len()), Vec::<f64>::new());
    for i in 0..thirds.len() {
        let mut row = [0.0; 3];
        let mut pivot = band[0];
        for d in (1..=3.min(i)).rev() {
            // Entry (i, i - d), less what the columns before it have taken.
            let taken: f64 = (d + 1..=3.min(i)).map(|e| row[e - 1] * rows[i - d][e - d - 1] * pivots[i - e]).sum();
            row[d - 1] = (band[d] - taken) / pivots[i - d];
            pivot -= row[d - 1] * row[d - 1] * pivots[i - d];
        }
        if pivot.is_nan() || pivot <= 0.0 {
            return None;
        }
        rows.push(row);
        pivots.push(pivot);
    }
    let mut solution = thirds.to_vec();
    for (i, row) in rows.iter().enumerate() {
        for d in 1..=3.min(i) {
            solution[i] -= row[d - 1] * solution[i - d];
        }
    }
    solution.iter_mut().zip(&pivots).for_each(|(x, pivot)| *x /= pivot);
    for i in (0..solution.len()).rev() {
        for d in 1..=3.min(solution.len() - 1 - i) {
            solution[i] -= rows[i + d][d - 1] * solution[i + d];
        }
    }
    Some(solution)
}

/// Whether every turn lasts as long as one of its neighbours is measured to, within their range and a share beside
/// it: what was taken off is an error of edges, not a speed of its own.
fn keeps_to(smooth: &[f64], measured: &[f64]) -> bool {
    let lasts = |edges: &[f64]| edges.windows(2).map(|w| w[1] - w[0]).collect::<Vec<f64>>();
    let (smooth, measured) = (lasts(smooth), lasts(measured));
    smooth.iter().enumerate().all(|(i, turn)| {
        let near = &measured[i.saturating_sub(NEIGHBOURS)..(i + NEIGHBOURS + 1).min(measured.len())];
        let (least, most) = near.iter().fold((f64::INFINITY, 0.0_f64), |(l, m), t| (l.min(*t), m.max(*t)));
        let beside = most - least + MAX_EXCESS_SHARE * measured[i];
        *turn > 0.0 && (least - beside..=most + beside).contains(turn)
    })
}

/// The spectrum of third differences at a share of the highest frequency, over the errors' power.
fn model(share: f64, parts: Parts) -> f64 {
    let difference = 2.0 - 2.0 * (PI * share).cos();
    parts.smooth + parts.turns * difference * difference + difference.powi(3)
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
    for smooth in SMOOTHNESS_EXPONENTS.map(power_of) {
        for turns in TURNS.map(power_of) {
            let parts = Parts { smooth, turns, sigma_s: 0.0 };
            let (mut logs, mut ratios) = (0.0, 0.0);
            for (share, power) in &bands {
                let whole = model(*share, parts);
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

    #[test]
    fn fault_a_few_edges_one_sample_off_at_an_even_speed_do_not_make_it_wander() {
        for late in [&[10, 30, 31, 60][..], &[50], &[1, 72]] {
            let mut edges: Vec<f64> = (1..75).map(|k| f64::from(k) / 25.0).collect();
            late.iter().for_each(|i: &usize| edges[*i] += 78e-6);
            let smooth = smoothed(&edges);
            assert!(smooth.windows(2).all(|w| (0.04 / (w[1] - w[0]) - 1.0).abs() < 0.003), "{late:?}: {smooth:?}");
        }
    }

    #[test]
    fn theory_the_band_is_solved_exactly() {
        let thirds: Vec<f64> = (0..40).map(|i| (0.7 * f64::from(i)).sin() + f64::from(i % 5)).collect();
        let parts = Parts { smooth: 1e-3, turns: 0.2, sigma_s: 1.0 };
        let solved = weighted(&thirds, parts).expect("a covariance");
        let band = [1e-3 + 1.2 + 20.0, -0.8 - 15.0, 0.2 + 6.0, -1.0];
        for (i, expected) in thirds.iter().enumerate() {
            let near = i.saturating_sub(3)..(i + 4).min(thirds.len());
            let sum: f64 = near.map(|j| band[i.abs_diff(j)] * solved[j]).sum();
            assert!((sum - expected).abs() < 1e-9, "{i}: {sum} for {expected}");
        }
    }
}
