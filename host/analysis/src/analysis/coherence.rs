//! Cyclic coherence by bands: how much the power of every band of frequencies swells at every order.
//!
//! Equal bands cover the record; the squared envelope of each over its mean, read at equal angles, has at order `a` the
//! amplitude that the cyclic modulation spectrum has there over the band's power (Antoni 2009, doi
//! 10.1016/j.ymssp.2008.10.010; here a bank of bands instead of a short-time transform). Impacts show as rows of equal
//! spacing in the bands of the resonances that they excite. For the eye: a column is the highest of its bins. Cost: one
//! transform of the record and two readings of it. Limit: orders above a band's width, in turns per second, fold.

use super::angle::Angle;
use super::lines::WINDOW;
use super::order_map::cells;
use crate::spectral::{amplitude_spectrum, resample_by_angle};
use rayon::prelude::*;

/// Most bands.
const BANDS: usize = 24;
/// Lowest order shown, of the slower shaft's.
const MIN_ORDER_SHARE: f64 = 0.5;

/// The map.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Coherence {
    /// Width of a band, Hz; the first begins at 0.
    pub width_hz: f64,
    /// Highest order.
    pub highest_order: f64,
    /// One row per band, lowest first: amplitude of the squared envelope over the band's mean power.
    pub rows: Vec<Vec<f64>>,
}

impl Coherence {
    /// Up to `top_hz`, of bands whose squared envelope over its mean, less one, and its sampling rate `relative` gives
    /// between two frequencies; empty where fewer than three are wide enough for `orders` turns per second.
    pub fn of(
        relative: &(dyn Fn(f64, f64) -> (Vec<f64>, f64) + Sync),
        angle: &Angle,
        (top_hz, orders): (f64, f64),
    ) -> Self {
        let fastest = angle.speed.fastest_hz;
        let width_hz = (top_hz / BANDS as f64).max(1.25 * orders * fastest);
        let count = (top_hz / width_hz) as usize;
        if count < 3 {
            return Self::default();
        }
        let row = |band: usize| {
            let low_hz = band as f64 * width_hz;
            let (swell, rate) = relative(low_hz, low_hz + width_hz);
            let per_turn = (1.25 * rate / angle.speed.slowest_hz).ceil() as usize;
            let samples = resample_by_angle(&swell, rate, &angle.map, angle.from_turn, angle.turns, per_turn);
            let mut spectrum = amplitude_spectrum(&samples, per_turn as f64, WINDOW);
            // Below the slower shaft it is the level that wanders.
            let slow = (MIN_ORDER_SHARE * angle.slower_order() / spectrum.bin) as usize;
            spectrum.values.iter_mut().take(slow).for_each(|value| *value = 0.0);
            cells(&spectrum.values, orders / spectrum.bin)
        };
        Self { width_hz, highest_order: orders, rows: (0..count).into_par_iter().map(row).collect() }
    }
}
