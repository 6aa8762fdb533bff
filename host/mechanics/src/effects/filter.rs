//! Linear filters of the measuring chain by their frequency response, exact below the Nyquist frequency.
//!
//! Signals are extended at both ends by odd reflection before the transform, so that they neither wrap round
//! nor jump; what remains of the ends' transients rings for a few time constants of the filter.

use crate::dynamics::excitation::Sampled;
use crate::spectral;
use rustfft::num_complex::Complex64;

/// Longest extension at either end, s.
const EXTENSION_S: f64 = 0.25;

/// Response of a second-order mode, 1 at low frequency.
pub fn mode(hz: f64, frequency_hz: f64, damping: f64) -> Complex64 {
    let ratio = hz / frequency_hz;
    1.0 / Complex64::new(1.0 - ratio * ratio, 2.0 * damping * ratio)
}

/// Passes channels through a frequency response (positive frequencies; real at 0).
pub fn pass(sampled: &mut Sampled, channels: std::ops::Range<usize>, response: impl Fn(f64) -> Complex64) {
    let rate_hz = sampled.rate_hz;
    for channel in &mut sampled.channels[channels] {
        let n = channel.len();
        if n < 2 {
            continue;
        }
        let margin = ((EXTENSION_S * rate_hz) as usize).min(n - 1);
        let (first, last) = (channel[0], channel[n - 1]);
        let mut signal: Vec<f64> = (1..=margin).rev().map(|i| 2.0 * first - channel[i]).collect();
        signal.extend_from_slice(channel);
        signal.extend((1..=margin).map(|i| 2.0 * last - channel[n - 1 - i]));
        // An even length keeps the half spectrum's last bin at the Nyquist frequency.
        if signal.len() % 2 == 1 {
            signal.push(*signal.last().expect("at least two samples"));
        }
        let total = signal.len();
        let forward = spectral::forward(total);
        let mut spectrum = forward.make_output_vec();
        forward.process(&mut signal, &mut spectrum).expect("matching lengths");
        for (i, bin) in spectrum.iter_mut().enumerate() {
            *bin *= response(i as f64 * rate_hz / total as f64) / total as f64;
        }
        // A real signal has real ends of its spectrum.
        spectrum[0].im = 0.0;
        if let Some(last) = spectrum.last_mut() {
            last.im = 0.0;
        }
        let inverse = spectral::backward(total);
        inverse.process(&mut spectrum, &mut signal).expect("matching lengths");
        channel.copy_from_slice(&signal[margin..margin + n]);
    }
}
