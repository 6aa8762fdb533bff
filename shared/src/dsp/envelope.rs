//! Envelope of a frequency band and its spectrum.
//!
//! The band's lines are taken from a real FFT, shifted to zero and transformed back with as many points as the band
//! needs: the magnitude is the envelope |b + j H(b)| of the band-passed signal b, already decimated. Its spectrum shows
//! the rates at which the band is modulated (bearing damage, a local tooth fault).
//!
//! The record is taken as periodic: exact for a synchronous average; for a running record, window it first and read the
//! edges with care. Cost (Cortex-M4F in QEMU): 93 k for 1024
//! samples and an envelope of 256.

use crate::math;
use crate::spectrum::{self, SpectrumError};
use microfft::Complex32;

/// Envelope of lines `first..=last` (bins of a real FFT of `samples`).
///
/// `samples` is work space and lost. `work` and `envelope` are equally long, a power of two from 32 to 2048 and at
/// least the number of lines (twice that keeps the envelope's own spectrum free of folding). The envelope's sampling
/// rate is that of the samples times `envelope.len() / samples.len()`.
pub fn envelope(
    samples: &mut [f32],
    first: usize,
    last: usize,
    work: &mut [Complex32],
    envelope: &mut [f32],
) -> Result<(), SpectrumError> {
    let points = envelope.len();
    let half = samples.len() / 2;
    if first == 0 || first > last || last >= half || last - first >= points || work.len() != points {
        return Err(SpectrumError::Output);
    }
    let scale = points as f32 / half as f32;
    let bins = spectrum::real_fft(samples)?;
    let centre = (first + last) / 2;
    work.fill(Complex32::new(0.0, 0.0));
    for line in first..=last {
        if let (Some(place), Some(bin)) = (work.get_mut((line + points - centre) % points), bins.get(line)) {
            *place = *bin * scale;
        }
    }
    spectrum::complex_ifft(work)?;
    for (y, z) in envelope.iter_mut().zip(work.iter()) {
        *y = math::sqrt(z.norm_sqr());
    }
    Ok(())
}
