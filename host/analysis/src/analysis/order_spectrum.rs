//! The order spectrum of a channel: peak amplitudes over all whole turns, in the record's unit.

use super::angle::Angle;
use super::lines::OrderLines;
use crate::spectral::Spectrum;
use serde::Serialize;

/// Width of the window's main lobe at half amplitude, bins.
const HALF_WIDTH_BINS: f64 = 2.72;
/// Strongest lines listed.
const MAX_LISTED_LINES: usize = 20;

/// An order spectrum.
#[derive(Debug, Clone, Serialize)]
pub struct OrderSpectrum {
    /// Window's name.
    pub window: &'static str,
    /// Turns of the pinion.
    pub turns: usize,
    /// Spacing of the bins, orders of the pinion.
    pub bin_orders: f64,
    /// Width of a line at half its amplitude, orders.
    pub resolution_orders: f64,
    /// Highest order that the record holds at every speed of the run.
    pub highest_order: f64,
    /// The strongest lines: order (to a bin), peak amplitude.
    pub strongest: Vec<(f64, f64)>,
    /// The amplitudes up to the highest order.
    #[serde(skip)]
    pub spectrum: Spectrum,
}

/// Of the `lines` of samples on the grid of `angle`.
pub fn order_spectrum(lines: &OrderLines, angle: &Angle) -> OrderSpectrum {
    let mut spectrum = lines.spectrum().clone();
    spectrum.values.truncate((angle.highest_order / spectrum.bin) as usize + 1);
    OrderSpectrum {
        window: "Blackman-Harris, 4 terms (equivalent noise bandwidth 2.0 bins)",
        turns: angle.turns,
        bin_orders: spectrum.bin,
        resolution_orders: HALF_WIDTH_BINS * spectrum.bin,
        highest_order: angle.highest_order,
        strongest: strongest(&spectrum),
        spectrum,
    }
}

fn strongest(spectrum: &Spectrum) -> Vec<(f64, f64)> {
    let values = &spectrum.values;
    let is_peak = |&i: &usize| (1..=4).all(|d| values[i] >= values[i - d] && values[i] >= values[i + d]);
    let mut peaks: Vec<usize> = (8..values.len().saturating_sub(4)).filter(is_peak).collect();
    peaks.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
    peaks.into_iter().take(MAX_LISTED_LINES).map(|i| (spectrum.frequency(i), values[i])).collect()
}
