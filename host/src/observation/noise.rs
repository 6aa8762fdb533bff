//! Noise of a record without any model of its machine: what is tied to neither shaft.
//!
//! Lines at all whole orders of both shafts, each with its own complex amplitude, are taken out of the measured bins by least squares, stretch
//! by stretch; those of the mesh may drift linearly over the run. That is the difference of even and odd turns carried to two shafts whose common period is far longer
//! than a run. What remains is divided by the degrees of freedom that the lines left in each bin, and its local median is the noise. The residual that a
//! model is judged by takes no part. The kernel's phase is the same for all lines but for a factor of each, so that the matrix is real.
//! Cost: 0.2 s for eight runs of 2 s. Limits: shafts whose orders stand closer than 2.5 bins are left in (the gear of a short run); what fills more than half of
//! a neighbourhood and is locked to no shaft (dense impacts, a tone's wide skirts, a moving speed) counts as noise.

use super::angle::Angle;
use super::spectrum::Analyser;
use nalgebra::DVector;
use rustfft::num_complex::Complex64 as C;

/// Bins of a stretch.
const STRETCH: usize = 96;
/// Bins beside a stretch from which lines still reach into it.
const BESIDE: f64 = 8.0;
/// The same for mesh lines, which are far stronger.
const BESIDE_MESH: f64 = 100.0;
/// Least distance of a shaft's orders, bins, at which they can be told from noise.
const LEAST_SPACING: f64 = 2.5;
/// Largest share of a bin that the lines may have taken.
const MOST_TAKEN: f64 = 0.8;
/// Bins on either side over which the median is taken.
const REACH: usize = 60;
/// Least power, of records without noise.
const LEAST: f64 = 1e-24;

/// Noise power per bin of one channel of a run with this angle; `teeth` of pinion and gear.
pub fn noise(analyser: &Analyser, angle: &Angle, teeth: [u32; 2], bins: &[C]) -> Vec<f64> {
    let free = untied(analyser, angle, teeth, bins);
    let blocks: Vec<f64> = (0..bins.len().div_ceil(REACH)).map(|i| level(&free, i * REACH + REACH / 2)).collect();
    (0..bins.len())
        .map(|b| {
            let x = (b as f64 / REACH as f64 - 0.5).clamp(0.0, (blocks.len() - 1) as f64);
            let i = (x as usize).min(blocks.len().saturating_sub(2));
            let next = blocks[(i + 1).min(blocks.len() - 1)];
            blocks[i] + (x - i as f64) * (next - blocks[i])
        })
        .collect()
}

/// Median about `centre` of exponentially distributed power, as its mean; wider where lines leave few bins.
fn level(free: &[Option<f64>], centre: usize) -> f64 {
    for reach in [REACH, 4 * REACH, free.len()] {
        let near = centre.saturating_sub(reach)..(centre + reach).min(free.len());
        let mut values: Vec<f64> = free[near].iter().flatten().copied().collect();
        if values.len() >= REACH / 2 {
            let middle = values.len() / 2;
            let median = *values.select_nth_unstable_by(middle, f64::total_cmp).1;
            return (median / std::f64::consts::LN_2).max(LEAST);
        }
    }
    LEAST
}

/// Power per bin that no line of the shafts explains, per degree of freedom; none where they explain any.
fn untied(analyser: &Analyser, angle: &Angle, teeth: [u32; 2], bins: &[C]) -> Vec<Option<f64>> {
    let mut all = vec![None; bins.len()];
    let mut first = 0;
    while first < bins.len() {
        let count = STRETCH.min(bins.len() - first);
        let columns = columns(analyser, angle, teeth, first, count);
        for (bin, (power, taken)) in remaining(analyser, &columns, &bins[first..first + count], first).enumerate() {
            all[first + bin] = (taken < MOST_TAKEN).then(|| power / (1.0 - taken));
        }
        first += count;
    }
    all
}

/// Real shapes of all lines that reach into a stretch.
fn columns(analyser: &Analyser, angle: &Angle, teeth: [u32; 2], first: usize, count: usize) -> Vec<DVector<f64>> {
    let per_order = angle.shaft_hz * analyser.duration_s();
    let [z1, z2] = teeth.map(f64::from);
    let last = (first + count) as f64;
    let lines = |spacing: f64, beside: f64| {
        let from = ((first as f64 - beside) / spacing).ceil().max(1.0) as i64;
        let to = ((last + beside) / spacing).floor() as i64;
        (from..=to).map(move |k| (k, k as f64 * spacing))
    };
    let shape = |at: f64| DVector::from_fn(count, |i, _| analyser.magnitude_at((first + i) as f64 - at));
    let mesh: Vec<f64> = lines(per_order * z1, BESIDE_MESH).map(|(_, at)| at).collect();
    let mut all: Vec<DVector<f64>> = mesh.iter().map(|&at| shape(at)).collect();
    // An amplitude that drifts: the kernel's slope.
    all.extend(mesh.iter().map(|&at| shape(at + 0.25) - shape(at - 0.25)));
    for (z, spacing) in [(z1, per_order), (z2, per_order * z1 / z2)] {
        if spacing >= LEAST_SPACING {
            let own = lines(spacing, BESIDE).filter(|(k, _)| k % z as i64 != 0);
            all.extend(own.map(|(_, at)| shape(at)));
        }
    }
    all.retain(|column| column.norm_squared() > 1e-12);
    all
}

/// Power of every bin after the columns were fitted, and the share of it that they took.
fn remaining(
    analyser: &Analyser,
    columns: &[DVector<f64>],
    bins: &[C],
    first: usize,
) -> impl Iterator<Item = (f64, f64)> {
    let turned: Vec<C> = bins.iter().enumerate().map(|(i, x)| x * analyser.phase_at(first + i).conj()).collect();
    let parts = [0, 1].map(|part| DVector::from_fn(bins.len(), |i, _| [turned[i].re, turned[i].im][part]));
    let basis = orthonormal(columns);
    let left = parts.map(|part| {
        let mut left = part;
        for column in &basis {
            let share = column.dot(&left);
            left.axpy(-share, column, 1.0);
        }
        left
    });
    let taken = DVector::from_fn(bins.len(), |i, _| basis.iter().map(|column| column[i] * column[i]).sum::<f64>());
    (0..bins.len()).map(move |i| (left[0][i].powi(2) + left[1][i].powi(2), taken[i]))
}

/// Gram and Schmidt, twice for the rounding; columns that others make up are left out.
fn orthonormal(columns: &[DVector<f64>]) -> Vec<DVector<f64>> {
    let mut basis: Vec<DVector<f64>> = Vec::new();
    for column in columns {
        let mut own = column / column.norm();
        for _ in 0..2 {
            for other in &basis {
                let share = other.dot(&own);
                own.axpy(-share, other, 1.0);
            }
        }
        let size = own.norm();
        if size > 1e-3 && basis.len() < own.len() {
            basis.push(own / size);
        }
    }
    basis
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;
    use rand::{RngExt, SeedableRng};
    use std::f64::consts::TAU;

    const RATE_HZ: f64 = 12_800.0;
    const SAMPLES: usize = 25_600;
    const TEETH: [u32; 2] = [19, 48];

    fn angle() -> Angle {
        Angle { offset_rad: 0.3, shaft_hz: 18.37, edge_scatter_s: 0.0, sigma_rad: 0.0, sigma_hz: 0.0 }
    }

    /// White noise of variance 1/3, and lines of both shafts of `size`.
    fn signal(size: f64) -> Vec<f64> {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let noise = |_: usize| 2.0 * rng.random::<f64>() - 1.0;
        let mut x: Vec<f64> = (0..SAMPLES).map(noise).collect();
        let lines = (1..200).flat_map(|k| [f64::from(k), f64::from(k) * 19.0 / 48.0]);
        for (i, order) in lines.enumerate() {
            let size = if order % 19.0 == 0.0 { 30.0 * size } else { size / (1.0 + i as f64).sqrt() };
            let step = C::cis(TAU * order * angle().shaft_hz / RATE_HZ);
            let mut turn = C::cis(i as f64) * size;
            for x in &mut x {
                *x += turn.re;
                turn *= step;
            }
        }
        x
    }

    #[test]
    fn theory_lines_of_both_shafts_leave_the_noise_as_it_is() {
        let analyser = Analyser::new(SAMPLES, RATE_HZ);
        let expected = analyser.bin_power_of_unit_variance() / 3.0;
        for size in [0.0, 1.0] {
            let all = noise(&analyser, &angle(), TEETH, &analyser.bins_of(&signal(size)));
            let mean = all[40..].iter().sum::<f64>() / (all.len() - 40) as f64 / expected;
            assert!((mean - 1.0).abs() < 0.08, "lines of {size}: {mean}");
        }
    }

    #[test]
    fn theory_a_stretch_fitted_by_its_lines_is_divided_by_what_they_leave() {
        let analyser = Analyser::new(SAMPLES, RATE_HZ);
        let columns = columns(&analyser, &angle(), TEETH, 960, STRETCH);
        let taken: f64 = remaining(&analyser, &columns, &[C::ONE; STRETCH], 960).map(|(_, taken)| taken).sum();
        let rank = orthonormal(&columns).len() as f64;
        assert!((taken - rank).abs() < 1e-9 && rank > 4.0, "{taken} {rank}");
        let matrix = DMatrix::from_columns(&columns);
        assert!(matrix.rank(1e-3) <= rank as usize + 3);
    }
}
