//! Plans of Fourier transforms, kept for the next caller of the same length.
//!
//! A plan's tables cost as much as some transforms. They are kept until lengths of `MAX_PLAN_POINTS` points have come
//! together; then all are forgotten and begun anew (plans in use live on).

use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use rustfft::{Fft, FftPlanner};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Points of all plans that are kept: about 250 MB of tables at worst.
const MAX_PLAN_POINTS: usize = 1 << 24;

/// Plans and how many points they are for.
struct Kept {
    real: RealFftPlanner<f64>,
    complex: FftPlanner<f64>,
    lengths: Vec<(Kind, usize)>,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Forward,
    Backward,
    Complex,
}

static PLAN_CACHE: Mutex<Option<Kept>> = Mutex::new(None);

fn planned<T>(kind: Kind, length: usize, plan: impl FnOnce(&mut Kept) -> T) -> T {
    // A panic elsewhere leaves nothing half made that another could see.
    let mut guard: MutexGuard<Option<Kept>> = PLAN_CACHE.lock().unwrap_or_else(PoisonError::into_inner);
    let total = guard.as_ref().map_or(0, |kept| kept.lengths.iter().map(|(_, length)| length).sum::<usize>());
    if total + length > MAX_PLAN_POINTS {
        *guard = None;
    }
    let kept = guard.get_or_insert_with(|| Kept {
        real: RealFftPlanner::new(),
        complex: FftPlanner::new(),
        lengths: Vec::new(),
    });
    if !kept.lengths.contains(&(kind, length)) {
        kept.lengths.push((kind, length));
    }
    plan(kept)
}

/// Of `length` real samples into bins.
pub fn forward(length: usize) -> Arc<dyn RealToComplex<f64>> {
    planned(Kind::Forward, length, |kept| kept.real.plan_fft_forward(length))
}

/// Of bins into `length` real samples.
pub fn backward(length: usize) -> Arc<dyn ComplexToReal<f64>> {
    planned(Kind::Backward, length, |kept| kept.real.plan_fft_inverse(length))
}

/// Of `length` bins into complex samples.
pub fn inverse(length: usize) -> Arc<dyn Fft<f64>> {
    planned(Kind::Complex, length, |kept| kept.complex.plan_fft_inverse(length))
}

/// The least length from `least` on that has no prime factor above 5: its transform costs a sixth of a prime one's.
pub fn smooth_length(least: usize) -> usize {
    (least.max(1)..).find(|length| is_smooth(*length)).unwrap_or(least)
}

/// Whether a length has no prime factor above 5.
pub fn is_smooth(mut length: usize) -> bool {
    for factor in [2, 3, 5] {
        while length.is_multiple_of(factor) {
            length /= factor;
        }
    }
    length == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smooth_lengths_are_the_next_ones() {
        let of = |least: usize| smooth_length(least);
        assert_eq!([of(0), of(7), of(11), of(1024), of(1025), of(1_536_001)], [1, 8, 12, 1024, 1080, 1_555_200]);
    }
}
