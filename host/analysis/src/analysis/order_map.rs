//! Order spectra of short stretches one after the other: which lines follow the shaft, and when.
//!
//! Stretches of equal angle, half overlapping, each with a Blackman-Harris window; the picture keeps the highest
//! amplitude of each cell.

use super::angle::Angle;
use super::lines::WINDOW;
use crate::spectral::Windowed;

/// Turns of the slower shaft per stretch, and the least.
const TURNS: f64 = 16.0;
/// Stretches at least, where the run allows.
const STRETCHES: usize = 24;
/// Most stretches and rows of the picture.
const COLUMNS: usize = 400;
const ROWS: usize = 360;

/// Amplitudes over order and time.
#[derive(Debug, Clone)]
pub struct OrderMap {
    /// Peak amplitude by order cell (from 0) and stretch.
    pub rows: Vec<Vec<f64>>,
    /// Highest order.
    pub highest_order: f64,
    /// Time of the first stretch's and the last stretch's middle, s.
    pub time_s: (f64, f64),
    /// Turns of the pinion per stretch.
    pub turns: usize,
}

/// Of the samples on the grid of `angle`, up to `highest_order`.
pub fn order_map(samples: &[f64], angle: &Angle, highest_order: f64) -> OrderMap {
    let wanted = (TURNS / angle.slower_order()).min(2.0 * angle.turns as f64 / STRETCHES as f64);
    let turns = (wanted.ceil() as usize).clamp(1, angle.turns);
    let length = turns * angle.per_turn[0];
    let hop = (length / 2).max((samples.len() - length) / COLUMNS).max(1);
    let starts: Vec<usize> = (0..=(samples.len() - length) / hop).map(|i| i * hop).collect();
    let mut windowed = Windowed::new(length, WINDOW);
    let columns: Vec<Vec<f64>> = starts
        .iter()
        .map(|&start| {
            let spectrum = windowed.amplitudes(&samples[start..start + length], angle.per_turn[0] as f64);
            cells(&spectrum.values, highest_order / spectrum.bin)
        })
        .collect();
    let rows = (0..columns[0].len()).map(|row| columns.iter().map(|column| column[row]).collect()).collect();
    let middle = |start: usize| {
        let turn = angle.from_turn + (start + length / 2) as f64 / angle.per_turn[0] as f64;
        angle.map.time_at(turn)
    };
    let time_s = (middle(0), middle(starts[starts.len() - 1]));
    OrderMap { rows, highest_order, time_s, turns }
}

/// The highest of the first `bins` values in each of at most [`ROWS`] cells.
pub(super) fn cells(values: &[f64], bins: f64) -> Vec<f64> {
    let count = (bins as usize).clamp(1, values.len());
    let rows = count.min(ROWS);
    let part = |row: usize| &values[row * count / rows..((row + 1) * count / rows).max(row * count / rows + 1)];
    (0..rows).map(|row| part(row).iter().copied().fold(0.0, f64::max)).collect()
}
