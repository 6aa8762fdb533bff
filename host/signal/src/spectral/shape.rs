//! Signals, noise above all, given another spectrum.

use realfft::RealFftPlanner;

/// Multiplies every bin of the signal's spectrum, from 0 to half the rate, by `gain`, and the signal by its length:
/// transforms forth and back are not scaled, so that the caller's gain can be. The signal is taken as periodic: for
/// noise, not for what must not wrap round.
pub fn shaped(signal: &mut [f64], gain: impl Fn(usize) -> f64) {
    let total = signal.len();
    let mut planner = RealFftPlanner::<f64>::new();
    let (forward, inverse) = (planner.plan_fft_forward(total), planner.plan_fft_inverse(total));
    let mut spectrum = forward.make_output_vec();
    forward.process(signal, &mut spectrum).expect("matching lengths");
    spectrum.iter_mut().enumerate().for_each(|(bin, value)| *value *= gain(bin));
    // A real signal has real ends of its spectrum.
    spectrum[0].im = 0.0;
    if total.is_multiple_of(2) {
        spectrum[total / 2].im = 0.0;
    }
    inverse.process(&mut spectrum, signal).expect("matching lengths");
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn theory_a_line_in_a_shaped_signal_has_its_bin_s_gain() {
        for total in [64, 65] {
            let line = |k: usize| TAU * 5.0 * k as f64 / total as f64;
            let mut signal: Vec<f64> = (0..total).map(|k| 1.0 + line(k).cos()).collect();
            shaped(&mut signal, |bin| if bin == 5 { 3.0 / total as f64 } else { 0.0 });
            for (k, x) in signal.iter().enumerate() {
                assert!((x - 3.0 * line(k).cos()).abs() < 1e-12, "{total}: sample {k}");
            }
        }
    }
}
