//! Analysis windows with the figures that turn a spectrum into physical quantities.
//!
//! All four are cosine sums a0 - a1 cos(2 pi n / N) + a2 cos(4 pi n / N) - ..., in the periodic (DFT-even) form, so
//! every figure has a closed form and none is measured at run time:
//!
//! | window | ENBW, bins | worst scallop loss, dB | highest side lobe, dB | use |
//! | --- | --- | --- | --- | --- |
//! | rectangular | 1 | 3.92 | -13 | records of whole turns in the order domain: lines lie on bins |
//! | Hann | 1.5 | 1.42 | -31 | general |
//! | Blackman-Harris (4 terms) | 2.0044 | 0.83 | -92 | neighbours of very different height |
//! | flat-top HFT90D | 3.8832 | 0.0039 | -90 | amplitude without interpolation |
//!
//! Sources: Harris 1978 (Blackman-Harris, scallop loss); Heinzel, Ruediger, Schilling 2002 (HFT90D, ENBW).
//! Cost (Cortex-M4F in QEMU): 48 instructions per value for Hann, 123 for the flat top.

use crate::math;

/// Distance from a whole bin within which the response is summed term by term.
const POLE: f32 = 0.02;

/// A cosine-sum window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Window {
    /// All ones.
    Rectangular,
    /// Raised cosine, main lobe +-2 bins.
    Hann,
    /// Four terms, main lobe +-4 bins, side lobes below -92 dB.
    BlackmanHarris,
    /// Heinzel's HFT90D, main lobe +-5 bins, flat within 0.004 dB over +-0.5 bin.
    FlatTop,
}

impl Window {
    /// Cosine coefficients a0, a1, ... (all positive, signs alternate in the sum), normalised so that w(N/2) = 1.
    pub const fn coefficients(self) -> &'static [f32] {
        match self {
            Window::Rectangular => &[1.0],
            Window::Hann => &[0.5, 0.5],
            Window::BlackmanHarris => &[0.358_75, 0.488_29, 0.141_28, 0.011_68],
            // The published terms 1, 1.942604, 1.340318, 0.440811, 0.043097 over their sum.
            Window::FlatTop => &[0.209_783_03, 0.407_525_35, 0.281_175_96, 0.092_474_67, 0.009_041_02],
        }
    }

    /// Window value at a phase of 2^32 per window length (0 is the first sample).
    #[inline]
    pub fn at_phase(self, phase: u32) -> f32 {
        let mut value = 0.0;
        let mut sign = 1.0;
        for (k, &a) in self.coefficients().iter().enumerate() {
            value += sign * a * if k == 0 { 1.0 } else { math::cossin(phase.wrapping_mul(k as u32)).0 };
            sign = -sign;
        }
        value
    }

    /// Multiplies `samples` by the window of their length, after subtracting `mean`.
    ///
    /// The phase steps by 2^32 / N rounded down, exact for powers of two (else within N / 2^32 of a length).
    pub fn apply(self, samples: &mut [f32], mean: f32) {
        let step = phase_step(samples.len());
        let mut phase = 0u32;
        for x in samples {
            *x = (*x - mean) * self.at_phase(phase);
            phase = phase.wrapping_add(step);
        }
    }

    /// Mean of the window: the factor by which it lowers the amplitude of a line on a bin.
    pub fn coherent_gain(self) -> f32 {
        self.coefficients()[0]
    }

    /// Mean square of the window: the factor by which it lowers the power of noise.
    pub fn power(self) -> f32 {
        let a = self.coefficients();
        a[0] * a[0] + 0.5 * a[1..].iter().map(|x| x * x).sum::<f32>()
    }

    /// Equivalent noise bandwidth in bins.
    pub fn enbw_bins(self) -> f32 {
        self.power() / (self.coherent_gain() * self.coherent_gain())
    }

    /// Half width of the main lobe in bins.
    pub fn main_lobe_bins(self) -> f32 {
        self.coefficients().len() as f32
    }

    /// Response to a line `offset` bins away, relative to a line on the bin (long-window limit, positive in the main
    /// lobe).
    pub fn response(self, offset: f32) -> f32 {
        let a = self.coefficients();
        let bin = math::round(offset.abs());
        let near_a_term = bin >= 1.0 && bin < a.len() as f32 && (offset.abs() - bin).abs() < POLE;
        if near_a_term {
            let mut sum = a[0] * math::sinc(offset);
            for (k, &a) in a.iter().enumerate().skip(1) {
                sum += 0.5 * a * (math::sinc(offset - k as f32) + math::sinc(offset + k as f32));
            }
            return sum / a[0];
        }
        // Each pair of terms is the first one's sine times a rational function (as in `without_sine`), which has
        // poles at whole bins.
        let square = offset * offset;
        let (mut sum, mut sign) = (a[0], -1.0f32);
        for (k, &a) in a.iter().enumerate().skip(1) {
            sum += sign * a * square / (square - (k * k) as f32);
            sign = -sign;
        }
        math::sinc(offset) * sum / a[0]
    }

    /// Loss of a line halfway between two bins, dB (positive).
    pub fn scallop_loss_db(self) -> f32 {
        -math::decibels(self.response(0.5))
    }

    /// Offset of a line from its highest bin (0 to 0.5 bins), from the ratio of the higher neighbour to that bin.
    ///
    /// Closed form for the rectangular and Hann windows; the others bisect the monotone ratio to 1e-5 bin. Both
    /// responses have the same sine in them (that of half a turn per bin), so that their ratio is a rational
    /// function: some 40 instructions a step.
    pub fn offset_from_ratio(self, neighbour_to_peak: f32) -> f32 {
        let ratio = neighbour_to_peak.clamp(0.0, 1.0);
        match self {
            Window::Rectangular => ratio / (1.0 + ratio),
            Window::Hann => ((2.0 * ratio - 1.0) / (1.0 + ratio)).max(0.0),
            Window::BlackmanHarris | Window::FlatTop => {
                let (mut low, mut high) = (0.0f32, 0.5f32);
                for _ in 0..17 {
                    let middle = 0.5 * (low + high);
                    let [neighbour, peak] = self.without_sine(middle);
                    if neighbour < ratio * peak {
                        low = middle;
                    } else {
                        high = middle;
                    }
                }
                0.5 * (low + high)
            }
        }
    }

    /// Responses one bin less `offset` (0 to 0.5) away and `offset` away, both over the same positive factor.
    ///
    /// `sinc(x - k) + sinc(x + k)` is `sinc(x)` times `2 (-1)^k x^2 / (x^2 - k^2)`; at `1 - offset` the term of
    /// `k = 1` keeps the factor `offset` that the others are multiplied with, and nothing is divided by zero.
    fn without_sine(self, offset: f32) -> [f32; 2] {
        let a = self.coefficients();
        let (near, far) = (offset, 1.0 - offset);
        let (near2, far2) = (near * near, far * far);
        let (mut neighbour, mut peak) = (a[0] * near, a[0]);
        let mut sign = -1.0f32;
        for (k, &a) in a.iter().enumerate().skip(1) {
            let k2 = (k * k) as f32;
            neighbour += if k == 1 { a * far2 / (1.0 + far) } else { sign * a * near * far2 / (far2 - k2) };
            peak += sign * a * near2 / (near2 - k2);
            sign = -sign;
        }
        [neighbour, peak * far]
    }
}

/// Phase step that walks `length` samples in one turn; 0 for lengths below 2.
pub(crate) fn phase_step(length: usize) -> u32 {
    if length < 2 { 0 } else { ((1u64 << 32) / length as u64) as u32 }
}
