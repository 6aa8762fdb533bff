//! A motion that repeats itself, as the acquisition would have sampled it.
//!
//! One period on a fine grid is all that is integrated. Its lines pass the anti-alias filter's response, and the
//! record's samples are read from the filtered period by local polynomials of degree 7: at 16 points per sample of
//! the record their error is 1e-8. What folds on the fine grid's 64 points per sample of a stiffness with kinks is 3e-6
//! of the signal (5e-5 at 16 points). What the filter lets through above half the rate folds as it does in a
//! record. Cost: two transforms of the period and 8 products per sample.

use crate::dynamics::decimate::{Decimator, OVERSAMPLING};
use crate::spectral;
use rustfft::num_complex::Complex64;
use std::sync::OnceLock;

/// Points of a local polynomial.
const POINTS: usize = 8;
/// Cells of the table of the filter's response, up to the rate.
const CELLS: usize = 2048;

/// Points of a period on the fine grid for one of the filter's own input.
const GRID_POINTS_PER_INPUT: usize = 4;
/// Points per sample of the record that the filtered period is read from: it has nothing above 0.6 of the rate.
const READ_PER_SAMPLE: usize = 16;

/// Points of a period on the fine grid.
pub fn points(period_s: f64, rate_hz: f64) -> usize {
    grid(period_s * rate_hz * (GRID_POINTS_PER_INPUT * OVERSAMPLING) as f64)
}

/// A length of at least `points` of which there are three in an octave: runs at many speeds share few plans of their
/// transforms, whose tables would be the most of what a fit holds.
fn grid(points: f64) -> usize {
    let octave = (points.ceil() as usize).max(4 * POINTS).next_power_of_two();
    [5 * octave / 8, 3 * octave / 4, octave].into_iter().find(|length| *length as f64 >= points).unwrap_or(octave)
}

/// Response of the acquisition's filter at `cycles` per sample of the record, by cubics through the cells of a table:
/// within 1e-9, where straight lines miss it by 8e-6 on its slope.
fn response(cycles: f64) -> f64 {
    static TABLE: OnceLock<Vec<f64>> = OnceLock::new();
    let table = TABLE.get_or_init(|| {
        let filter = Decimator::new();
        (0..CELLS + 3).map(|i| filter.response((i as f64 - 1.0) / CELLS as f64)).collect()
    });
    let x = cycles * CELLS as f64;
    if x >= CELLS as f64 {
        return 0.0;
    }
    let (i, f) = (x as usize, x.fract());
    // The table begins one cell below zero.
    let [a, b, c, d] = [table[i], table[i + 1], table[i + 2], table[i + 3]];
    -f * (f - 1.0) * (f - 2.0) / 6.0 * a + (f + 1.0) * (f - 1.0) * (f - 2.0) / 2.0 * b
        - (f + 1.0) * f * (f - 2.0) / 2.0 * c
        + (f + 1.0) * f * (f - 1.0) / 6.0 * d
}

/// Samples at `index / rate_hz` of a signal of which `period`, from time 0 on, repeats itself.
pub fn sampled(mut period: Vec<f64>, period_s: f64, rate_hz: f64, samples: usize) -> Vec<f64> {
    let count = period.len();
    let forward = spectral::forward(count);
    let mut lines = forward.make_output_vec();
    forward.process(&mut period, &mut lines).expect("matching lengths");
    let (per_sample, read) = filtered(&lines, count, period_s * rate_hz);
    let length = read.len();
    // The period goes on at both ends, so that no sample asks whether it is near one.
    let round: Vec<f64> = (0..length + POINTS).map(|i| read[(i + length + 1 - POINTS / 2) % length]).collect();
    (0..samples)
        .map(|n| {
            let x = (n as f64 * per_sample) % length as f64;
            let first = (x as usize).min(length - 1);
            let weights = lagrange(x - first as f64);
            weights.iter().zip(&round[first..first + POINTS]).map(|(w, at)| w * at).sum()
        })
        .collect()
}

/// A period of `count` points with these `lines` and of `in_samples` samples behind the acquisition's filter, on a
/// coarser grid, with that grid's points per sample.
fn filtered(lines: &[Complex64], count: usize, in_samples: f64) -> (f64, Vec<f64>) {
    let length = grid(in_samples * READ_PER_SAMPLE as f64).min(count);
    let backward = spectral::backward(length);
    let mut kept = backward.make_input_vec();
    for (k, (kept, line)) in kept.iter_mut().zip(lines).enumerate() {
        *kept = line * (response(k as f64 / in_samples) / count as f64);
    }
    // A real signal has real ends of its spectrum.
    kept[0].im = 0.0;
    kept.last_mut().expect("at least one line").im = 0.0;
    let mut read = backward.make_output_vec();
    backward.process(&mut kept, &mut read).expect("matching lengths");
    (length as f64 / in_samples, read)
}

/// Weights of the points -3 to 4 for a place between 0 and 1.
fn lagrange(x: f64) -> [f64; POINTS] {
    const SCALE: [f64; POINTS] = [-5040.0, 720.0, -240.0, 144.0, -144.0, 240.0, -720.0, 5040.0];
    let distance: [f64; POINTS] = std::array::from_fn(|i| x + (POINTS / 2 - 1) as f64 - i as f64);
    std::array::from_fn(|i| {
        let others: f64 = (0..POINTS).filter(|j| *j != i).map(|j| distance[j]).product();
        others / SCALE[i]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn theory_a_line_in_the_pass_band_comes_out_as_it_is() {
        let (period_s, rate_hz) = (0.0503, 25_600.0);
        let count = points(period_s, rate_hz);
        let (order, phase) = (400.0, 0.7);
        let period = (0..count).map(|i| (TAU * order * i as f64 / count as f64 + phase).cos()).collect();
        let samples = sampled(period, period_s, rate_hz, 5000);
        for (n, x) in samples.iter().enumerate() {
            let wanted = (TAU * order * n as f64 / rate_hz / period_s + phase).cos();
            assert!((x - wanted).abs() < 2e-5, "{n}: {x} for {wanted}");
        }
    }
}
