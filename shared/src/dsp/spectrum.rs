//! Real and complex FFT by length, amplitude spectra in the signal's unit, line interpolation, noise floor.
//!
//! Scaling, stated once: a line A cos(2 pi f t) on a bin reads A (peak value, m/s^2), whatever the window. The lines at
//! 0 and at the Nyquist frequency appear once in a real spectrum and carry no factor 2; `microfft` packs the Nyquist
//! line into the imaginary part of bin 0, which is taken apart here.
//!
//! Cost on a Cortex-M4F: `rfft` 9.5 k / 22 k / 50 k / 113 k / 246 k instructions for 256 / 512 / 1024 / 2048 / 4096
//! points (in QEMU); a Hann-windowed amplitude spectrum of 1024 points 117 k.

use crate::math;
use crate::window::Window;
use microfft::Complex32;
use microfft::{complex, inverse, real};

/// Why a spectrum was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SpectrumError {
    /// The length is not a supported power of two.
    Length,
    /// An output slice does not have the length that belongs to the input.
    Output,
}

/// Real FFT in place; lengths 32 to 4096, powers of two. Returns N/2 bins, the Nyquist line in `[0].im`, not scaled.
pub fn real_fft(samples: &mut [f32]) -> Result<&mut [Complex32], SpectrumError> {
    macro_rules! by_length {
        ($($n:literal => $f:path),*) => {
            match samples.len() {
                $($n => {
                    let fixed: &mut [f32; $n] = samples.try_into().map_err(|_| SpectrumError::Length)?;
                    Ok(&mut $f(fixed)[..])
                })*
                _ => Err(SpectrumError::Length),
            }
        };
    }
    by_length!(32 => real::rfft_32, 64 => real::rfft_64, 128 => real::rfft_128, 256 => real::rfft_256,
        512 => real::rfft_512, 1024 => real::rfft_1024, 2048 => real::rfft_2048, 4096 => real::rfft_4096)
}

/// Complex FFT in place; lengths 32 to 2048, powers of two, not scaled.
pub fn complex_fft(samples: &mut [Complex32]) -> Result<(), SpectrumError> {
    macro_rules! by_length {
        ($($n:literal => $f:path),*) => {
            match samples.len() {
                $($n => {
                    let fixed: &mut [Complex32; $n] = samples.try_into().map_err(|_| SpectrumError::Length)?;
                    let _ = $f(fixed);
                    Ok(())
                })*
                _ => Err(SpectrumError::Length),
            }
        };
    }
    by_length!(32 => complex::cfft_32, 64 => complex::cfft_64, 128 => complex::cfft_128, 256 => complex::cfft_256,
        512 => complex::cfft_512, 1024 => complex::cfft_1024, 2048 => complex::cfft_2048)
}

/// Inverse complex FFT in place with the factor 1/N; lengths 32 to 2048, powers of two.
pub fn complex_ifft(bins: &mut [Complex32]) -> Result<(), SpectrumError> {
    macro_rules! by_length {
        ($($n:literal => $f:path),*) => {
            match bins.len() {
                $($n => {
                    let fixed: &mut [Complex32; $n] = bins.try_into().map_err(|_| SpectrumError::Length)?;
                    let _ = $f(fixed);
                    Ok(())
                })*
                _ => Err(SpectrumError::Length),
            }
        };
    }
    by_length!(32 => inverse::ifft_32, 64 => inverse::ifft_64, 128 => inverse::ifft_128, 256 => inverse::ifft_256,
        512 => inverse::ifft_512, 1024 => inverse::ifft_1024, 2048 => inverse::ifft_2048)
}

/// Inverse of [`real_fft`] (packed Nyquist line): overwrites `bins`, writes the 2 x `bins.len()` samples.
///
/// One complex inverse FFT of half the length: the even samples are its real, the odd ones its imaginary parts.
pub fn real_ifft(bins: &mut [Complex32], samples: &mut [f32]) -> Result<(), SpectrumError> {
    let half = bins.len();
    if samples.len() != 2 * half {
        return Err(SpectrumError::Output);
    }
    let (zero, nyquist) = match bins.first() {
        Some(first) => (first.re, first.im),
        None => return Err(SpectrumError::Length),
    };
    bins[0] = Complex32::new(0.5 * (zero + nyquist), 0.5 * (zero - nyquist));
    let step = crate::window::phase_step(2 * half);
    for k in 1..=half / 2 {
        let (Some(&x), Some(y)) = (bins.get(k), bins.get(half - k)) else { return Err(SpectrumError::Length) };
        let y = y.conj();
        let (c, s) = math::cossin(step.wrapping_mul(k as u32));
        let even = (x + y) * 0.5;
        let odd = (x - y) * 0.5 * Complex32::new(c, s);
        // even + j odd at k; the mirrored bin holds the conjugates of both parts.
        if let Some(bin) = bins.get_mut(k) {
            *bin = Complex32::new(even.re - odd.im, even.im + odd.re);
        }
        if let Some(bin) = bins.get_mut(half - k) {
            *bin = Complex32::new(even.re + odd.im, odd.re - even.im);
        }
    }
    complex_ifft(bins)?;
    for (pair, z) in samples.chunks_exact_mut(2).zip(bins.iter()) {
        pair[0] = z.re;
        pair[1] = z.im;
    }
    Ok(())
}

/// Amplitude spectrum (peak values, unit of the samples) of one record with its mean removed.
///
/// `samples` (32 to 4096, a power of two) is used as work space and lost. `amplitudes` takes N/2 + 1 lines at 0, fs/N,
/// ... fs/2.
pub fn amplitude_spectrum(samples: &mut [f32], window: Window, amplitudes: &mut [f32]) -> Result<(), SpectrumError> {
    let count = samples.len();
    if amplitudes.len() != count / 2 + 1 {
        return Err(SpectrumError::Output);
    }
    let mean = mean(samples);
    window.apply(samples, mean);
    let scale = 2.0 / (count as f32 * window.coherent_gain());
    let bins = real_fft(samples)?;
    let Some((packed, bins)) = bins.split_first() else { return Err(SpectrumError::Length) };
    let [zero, inner @ .., nyquist] = amplitudes else { return Err(SpectrumError::Output) };
    *zero = 0.5 * scale * packed.re.abs();
    *nyquist = 0.5 * scale * packed.im.abs();
    for (amplitude, bin) in inner.iter_mut().zip(bins) {
        *amplitude = scale * math::sqrt(bin.norm_sqr());
    }
    Ok(())
}

/// Arithmetic mean, 0 for an empty slice. Sums runs of 64 first, so rounding stays at 1e-7 for 4096 samples.
pub fn mean(samples: &[f32]) -> f32 {
    if samples.is_empty() {
        return 0.0;
    }
    let total: f32 = samples.chunks(64).map(|run| run.iter().sum::<f32>()).sum();
    total / samples.len() as f32
}

/// A line read between the bins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Position in bins.
    pub bin: f32,
    /// Amplitude, peak, unit of the spectrum.
    pub amplitude: f32,
}

/// Reads the line whose highest bin is `peak`: window-aware interpolation on the higher neighbour.
///
/// Exact for one stationary line in the main lobe's absence of others; a second line nearer than twice
/// [`Window::main_lobe_bins`] biases it by the leakage ratio. `None` at the ends of the spectrum or for an empty bin.
pub fn read_line(amplitudes: &[f32], peak: usize, window: Window) -> Option<Line> {
    let (left, centre, right) =
        (*amplitudes.get(peak.checked_sub(1)?)?, *amplitudes.get(peak)?, *amplitudes.get(peak + 1)?);
    if !(centre > 0.0 && centre.is_finite()) {
        return None;
    }
    let offset = window.offset_from_ratio(left.max(right) / centre);
    let signed = if right >= left { offset } else { -offset };
    Some(Line { bin: peak as f32 + signed, amplitude: centre / window.response(offset) })
}

/// Highest bin within `reach` bins of `expected`.
pub fn highest_near(amplitudes: &[f32], expected: usize, reach: usize) -> Option<usize> {
    let first = expected.saturating_sub(reach);
    let last = (expected + reach).min(amplitudes.len().checked_sub(1)?);
    (first..=last).max_by(|&a, &b| amplitudes[a].total_cmp(&amplitudes[b]))
}

/// Amplitude density of the broadband noise under the lines, unit / sqrt(Hz), RMS, one-sided.
///
/// The median of the line amplitudes ignores lines as long as they fill less than a few per cent of the bins. For
/// Gaussian noise A^2 is exponentially distributed, so its mean is median^2 / ln 2. `scratch` receives a copy of the
/// inner lines (at least `amplitudes.len() - 2` long). `None` for fewer than 8 inner lines, a short scratch or a
/// line spacing that is not positive.
pub fn noise_density(amplitudes: &[f32], window: Window, line_spacing_hz: f32, scratch: &mut [f32]) -> Option<f32> {
    let inner = amplitudes.get(1..amplitudes.len().checked_sub(1)?)?;
    let scratch = scratch.get_mut(..inner.len())?;
    if inner.len() < 8 || line_spacing_hz.is_nan() || line_spacing_hz <= 0.0 {
        return None;
    }
    scratch.copy_from_slice(inner);
    let median = math::median(scratch)?;
    let mean_square = 0.5 * median * median / core::f32::consts::LN_2;
    Some(math::sqrt(mean_square / (window.enbw_bins() * line_spacing_hz)))
}
