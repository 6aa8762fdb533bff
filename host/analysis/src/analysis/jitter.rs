//! The angle without the jitter of its tachometer: a shaft with inertia changes its speed smoothly, an edge that
//! falls between two samples does not.
//!
//! At the hundredth order a jitter of a ten-thousandth of a turn is a phase of 0.06 rad: it lays skirts about every
//! mesh line, in which sidebands of the shafts drown. Means over whole turns (`analysis::whole_turns`) take off what
//! is faster than a turn; what is slower is mostly jitter too, where the speed wanders over tens of turns. So the
//! times of whole turns are smoothed by penalised least squares with fourth differences (Whittaker 1923, Henderson
//! 1924; an eighth-power filter), as much as generalised cross-validation asks (Craven and Wahba 1979), and the angle
//! goes through them. Trace of the smoother: from the eigenvalues of the circular problem. Cost: a banded solution
//! for each strength tried. Where cross-validation keeps most of what there is, or what it takes off is a line, the
//! speed does move that fast, and the angle stays as it is. Steady speed only: a run-up begins and ends with a kink,
//! which smoothing would turn into swings. Limit: what the speed truly does within some turns shows as modulation
//! then.

use crate::spectral::interpolated;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;

/// Strengths tried: powers of ten, halves between.
const STRENGTHS: (i32, i32) = (-2, 18);
/// Share of the turns' degrees of freedom kept from which the angle is left alone.
const MAX_KEPT_FREEDOM_SHARE: f64 = 0.7;
/// Edges per turn of the new angle: a spline through one of each turn leaves images of the wander beside the shaft's
/// sidebands.
pub const EDGES: u32 = 8;
/// Fewest turns.
const MIN_TURNS: usize = 16;
/// Share of what is taken off that stands at one frequency from which it is a swing: jitter has the logarithm of the
/// turns over half of them.
const LINE: f64 = 0.25;
/// Order of the differences, and their coefficients.
const ORDER: usize = 4;
const DIFFERENCE: [f64; ORDER + 1] = [1.0, -4.0, 6.0, -4.0, 1.0];

/// Edges, [`EDGES`] per turn, through the smoothed times of whole turns; nothing where there are few, or where the
/// speed moves too fast for it.
pub fn settled(turn_times_s: &[f64]) -> Option<Vec<f64>> {
    if turn_times_s.len() < MIN_TURNS {
        return None;
    }
    let smooth = smoothed(turn_times_s)?;
    let last = (smooth.len() - 1) * EDGES as usize;
    let edges: Vec<f64> = (0..=last).map(|i| interpolated(&smooth, i as f64 / f64::from(EDGES))).collect();
    edges.windows(2).all(|w| w[1] > w[0]).then_some(edges)
}

/// Smoothed values, by cross-validation; nothing where that keeps most of them.
fn smoothed(values: &[f64]) -> Option<Vec<f64>> {
    let n = values.len();
    // Sums of squares of departures from a straight line: those of times would lose digits.
    let slope = (values[n - 1] - values[0]) / (n - 1) as f64;
    let line = |i: usize| values[0] + slope * i as f64;
    let departures: Vec<f64> = values.iter().enumerate().map(|(i, x)| x - line(i)).collect();
    let tried = (STRENGTHS.0..=STRENGTHS.1).map(|half_decade| {
        let strength = 10.0_f64.powf(0.5 * f64::from(half_decade));
        let smooth = penalised(&departures, strength);
        let left: f64 = smooth.iter().zip(&departures).map(|(a, b)| (a - b).powi(2)).sum();
        let kept = kept(n, strength);
        (left / (1.0 - kept).powi(2), kept, smooth)
    });
    let (_, kept, smooth) = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let taken: Vec<f64> = departures.iter().zip(&smooth).map(|(a, b)| a - b).collect();
    (kept < MAX_KEPT_FREEDOM_SHARE && highest_share(&taken) < LINE)
        .then(|| smooth.iter().enumerate().map(|(i, x)| x + line(i)).collect())
}

/// Share of the degrees of freedom that the smoother of a strength keeps.
fn kept(n: usize, strength: f64) -> f64 {
    let gain = |k: usize| {
        let difference = 2.0 - 2.0 * (0.5 * TAU * k as f64 / n as f64).cos();
        1.0 / (1.0 + strength * difference.powi(ORDER as i32))
    };
    (0..n).map(gain).sum::<f64>() / n as f64
}

/// Share of the power that stands at the strongest of the frequencies.
fn highest_share(values: &[f64]) -> f64 {
    let mut bins: Vec<Complex64> = values.iter().map(|x| Complex64::new(*x, 0.0)).collect();
    FftPlanner::new().plan_fft_forward(bins.len()).process(&mut bins);
    let powers = bins[1..=values.len() / 2].iter().map(Complex64::norm_sqr);
    powers.clone().fold(0.0, f64::max) / powers.sum::<f64>().max(f64::MIN_POSITIVE)
}

/// Least squares with differences penalised: `(I + strength D'D) z = y`, by Cholesky factors within the band.
fn penalised(values: &[f64], strength: f64) -> Vec<f64> {
    let n = values.len();
    // Row i: entries (i, i) to (i, i + ORDER).
    let mut band = vec![[0.0; ORDER + 1]; n];
    band.iter_mut().for_each(|row| row[0] = 1.0);
    for first in 0..n.saturating_sub(ORDER) {
        for i in 0..=ORDER {
            for j in i..=ORDER {
                band[first + i][j - i] += strength * DIFFERENCE[i] * DIFFERENCE[j];
            }
        }
    }
    for i in 0..n {
        for k in 1..=ORDER.min(i) {
            let above = band[i - k];
            let factor = above[k] / above[0];
            for j in k..=ORDER {
                band[i][j - k] -= factor * above[j];
            }
        }
    }
    let mut solved = values.to_vec();
    for i in 0..n {
        for k in 1..=ORDER.min(i) {
            solved[i] -= band[i - k][k] / band[i - k][0] * solved[i - k];
        }
    }
    for i in (0..n).rev() {
        let ahead: f64 = (1..=ORDER).filter(|k| i + k < n).map(|k| band[i][k] * solved[i + k]).sum();
        solved[i] = (solved[i] - ahead) / band[i][0];
    }
    solved
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn truth(turns: usize, per_turn: f64) -> Vec<f64> {
        (0..turns).map(|i| 0.1 * i as f64 + 2e-3 * (TAU * per_turn * i as f64).sin() + 1e-6 * (i * i) as f64).collect()
    }

    fn error(a: &[f64], b: &[f64]) -> f64 {
        (a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
    }

    #[test]
    fn theory_jitter_goes_and_a_slow_wander_stays() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        for turns in [60, 400] {
            let truth = truth(turns, 0.02);
            let noise: Vec<f64> = StandardNormal.sample_iter(&mut random).take(turns).map(|n: f64| 2e-5 * n).collect();
            let jittered: Vec<f64> = truth.iter().zip(&noise).map(|(t, n)| t + n).collect();
            let smooth = smoothed(&jittered).expect("smooth");
            assert!(error(&smooth, &truth) < 0.6 * error(&jittered, &truth), "{turns}: {:e}", error(&smooth, &truth));
        }
    }

    #[test]
    fn theory_a_speed_that_moves_within_a_few_turns_is_left_alone() {
        assert_eq!(smoothed(&truth(200, 0.3)), None);
    }

    #[test]
    fn theory_a_parabola_passes_and_the_band_solves_the_equations() {
        let values: Vec<f64> = (0..40).map(|i| (f64::from(i) - 11.0).powi(2)).collect();
        assert!(error(&penalised(&values, 1e3), &values) < 1e-8);
        let rough: Vec<f64> = (0..40).map(|i| (1.7 * f64::from(i * i)).sin()).collect();
        let z = penalised(&rough, 2.5);
        let differences: Vec<f64> =
            z.windows(ORDER + 1).map(|w| w.iter().zip(DIFFERENCE).map(|(a, b)| a * b).sum()).collect();
        for i in 0..40 {
            let back = (0..=ORDER)
                .filter(|k| i >= *k && i - k < 40 - ORDER)
                .map(|k| DIFFERENCE[k] * differences[i - k])
                .sum::<f64>();
            assert!((z[i] + 2.5 * back - rough[i]).abs() < 1e-9, "{i}");
        }
    }
}
