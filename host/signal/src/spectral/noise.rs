//! Local noise floors: the level between the lines of a spectrum.
//!
//! A quantile over neighbouring bins, which lines on fewer bins than lie above it do not lift: a median for combs of
//! lines that stand apart, a lower quantile where sidebands fill up to half of the bins. The power of Gaussian noise
//! in a bin is exponentially distributed, so its quantile `q` is `-ln(1 - q)` times its mean. Limit: noise that
//! changes within the window's width is flattened.

use rustfft::num_complex::Complex64 as C;

/// Quantile of the values in a window of `width` bins that begins `reach` before the middle of each block of `hop`
/// bins.
struct LocalQuantile {
    hop: usize,
    reach: usize,
    width: usize,
    quantile: f64,
}

impl LocalQuantile {
    /// One value per block.
    fn levels(&self, values: &[f64]) -> Vec<f64> {
        let blocks = values.len().div_ceil(self.hop);
        let level = |block: usize| {
            let centre = block * self.hop + self.hop / 2;
            let end = (centre + self.width - self.reach).min(values.len());
            let mut window = values[centre.saturating_sub(self.reach)..end].to_vec();
            let rank = ((window.len() - 1) as f64 * self.quantile) as usize;
            *window.select_nth_unstable_by(rank, f64::total_cmp).1
        };
        (0..blocks).map(level).collect()
    }

    /// Quantile of exponentially distributed values over their mean.
    fn quantile_over_mean(&self) -> f64 {
        -(1.0 - self.quantile).ln()
    }
}

/// Noise power per bin from the lower 30 % quantile over 120 bins, interpolated between block centres.
pub fn noise_power(bins: &[C]) -> Vec<f64> {
    const FLOOR: LocalQuantile = LocalQuantile { hop: 60, reach: 60, width: 120, quantile: 0.30 };
    let power: Vec<f64> = bins.iter().map(|x| x.norm_sqr()).collect();
    let scale = FLOOR.quantile_over_mean();
    let level: Vec<f64> = FLOOR.levels(&power).into_iter().map(|x| (x / scale).max(1e-24)).collect();
    (0..bins.len())
        .map(|b| {
            let x = (b as f64 / FLOOR.hop as f64 - 0.5).clamp(0.0, (level.len() - 1) as f64);
            let i = (x as usize).min(level.len().saturating_sub(2));
            let next = level[(i + 1).min(level.len() - 1)];
            level[i] + (x - i as f64) * (next - level[i])
        })
        .collect()
}

/// Median over 129 bins, per bin, taken anew every `hop` bins.
pub fn running_median(values: &[f64], hop: usize) -> Vec<f64> {
    let medians = LocalQuantile { hop, reach: 64, width: 129, quantile: 0.5 }.levels(values);
    (0..values.len()).map(|i| medians[i / hop]).collect()
}
