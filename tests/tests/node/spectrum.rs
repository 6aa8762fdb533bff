//! FFT packing, amplitude scaling, line reading and noise floor.

use meshband::spectrum::{self, SpectrumError};
use meshband::window::Window;
use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use reference::{forward, tone};

/// f64 references by rustfft.
mod reference {
    use rustfft::{FftPlanner, num_complex::Complex64};

    pub fn forward(samples: &[f64]) -> Vec<Complex64> {
        let mut bins: Vec<Complex64> = samples.iter().map(|&x| Complex64::new(x, 0.0)).collect();
        FftPlanner::new().plan_fft_forward(bins.len()).process(&mut bins);
        bins
    }

    pub fn tone(count: usize, bin: f64, amplitude: f64, phase: f64) -> Vec<f64> {
        (0..count).map(|n| amplitude * (std::f64::consts::TAU * bin * n as f64 / count as f64 + phase).cos()).collect()
    }
}

fn noise(count: usize, seed: u64) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..count).map(|_| (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0).collect()
}

fn single(samples: &[f64]) -> Vec<f32> {
    samples.iter().map(|&x| x as f32).collect()
}

#[test]
fn ref_real_fft_matches_f64_at_every_length_and_bin() {
    for count in [32, 64, 128, 256, 512, 1024, 2048, 4096] {
        let signal = noise(count, count as u64);
        let exact = forward(&signal);
        let mut samples = single(&signal);
        let bins = spectrum::real_fft(&mut samples).unwrap();
        let scale = (count as f64).sqrt();
        assert!((f64::from(bins[0].im) - exact[count / 2].re).abs() < 3e-6 * scale, "Nyquist line of {count}");
        for (k, bin) in bins.iter().enumerate().skip(1) {
            let error = (f64::from(bin.re) - exact[k].re).hypot(f64::from(bin.im) - exact[k].im);
            assert!(error < 3e-6 * scale, "bin {k} of {count}: {error}");
        }
    }
    assert_eq!(spectrum::real_fft(&mut [0.0; 100]).unwrap_err(), SpectrumError::Length);
}

#[test]
fn theory_inverse_real_fft_returns_the_samples() {
    for count in [64, 256, 1024, 4096] {
        let signal = single(&noise(count, 9));
        let mut work = signal.clone();
        let mut back = vec![0.0f32; count];
        let bins = spectrum::real_fft(&mut work).unwrap();
        spectrum::real_ifft(bins, &mut back).unwrap();
        let worst = signal.iter().zip(&back).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 3e-6, "{count}: {worst}");
    }
}

#[test]
fn theory_a_line_on_a_bin_reads_its_peak_amplitude_in_every_window() {
    for window in [Window::Rectangular, Window::Hann, Window::BlackmanHarris, Window::FlatTop] {
        for count in [256usize, 1024, 4096] {
            let signal: Vec<f64> = tone(count, 40.0, 3.25, 0.7).iter().map(|x| x + 17.0).collect();
            let mut samples = single(&signal);
            let mut amplitudes = vec![0.0; count / 2 + 1];
            spectrum::amplitude_spectrum(&mut samples, window, &mut amplitudes).unwrap();
            assert!((amplitudes[40] - 3.25).abs() < 3e-5, "{window:?} {count}: {}", amplitudes[40]);
            assert!(amplitudes[0] < 3e-5, "the mean is removed");
        }
    }
    let mut nyquist: Vec<f32> = (0..256).map(|n| if n % 2 == 0 { 2.0 } else { -2.0 }).collect();
    let mut amplitudes = vec![0.0; 129];
    spectrum::amplitude_spectrum(&mut nyquist, Window::Hann, &mut amplitudes).unwrap();
    assert!((amplitudes[128] - 2.0).abs() < 1e-5);
}

#[test]
fn theory_lines_between_bins_are_read_within_a_hundredth_of_a_bin() {
    for window in [Window::Rectangular, Window::Hann, Window::BlackmanHarris, Window::FlatTop] {
        let (bin_limit, amplitude_limit) = match window {
            // Leakage of the line's own image decides for the rectangle, flatness of the ratio for the flat top.
            Window::Rectangular => (0.01, 0.01),
            _ => (0.005, 0.001),
        };
        for i in 0..40 {
            let bin = 200.0 + f64::from(i) / 40.0;
            let mut samples = single(&tone(1024, bin, 2.0, 0.3 * f64::from(i)));
            let mut amplitudes = vec![0.0; 513];
            spectrum::amplitude_spectrum(&mut samples, window, &mut amplitudes).unwrap();
            let peak = spectrum::highest_near(&amplitudes, 200, 3).unwrap();
            let line = spectrum::read_line(&amplitudes, peak, window).unwrap();
            assert!((f64::from(line.bin) - bin).abs() < bin_limit, "{window:?} {bin}: {line:?}");
            assert!((f64::from(line.amplitude) / 2.0 - 1.0).abs() < amplitude_limit, "{window:?} {bin}: {line:?}");
        }
    }
}

#[test]
fn fault_noise_is_not_told_from_fewer_than_eight_lines() {
    let of = |lines: usize| {
        let (amplitudes, mut scratch) = (vec![1.0; lines + 2], vec![0.0; lines]);
        spectrum::noise_density(&amplitudes, Window::Hann, 1.0, &mut scratch).is_some()
    };
    assert_eq!((of(7), of(8)), (false, true));
}

#[test]
fn theory_noise_density_is_read_under_lines() {
    let rate_hz = 10_000.0;
    for window in [Window::Rectangular, Window::Hann, Window::FlatTop] {
        let mut ratios = Vec::new();
        for seed in 0..10 {
            let mut signal = noise(4096, seed);
            for (x, line) in signal.iter_mut().zip(tone(4096, 700.3, 50.0, 0.0)) {
                *x += line;
            }
            let mut samples = single(&signal);
            let (mut amplitudes, mut scratch) = (vec![0.0; 2049], vec![0.0; 2047]);
            spectrum::amplitude_spectrum(&mut samples, window, &mut amplitudes).unwrap();
            // The rectangle's own leakage would fill the floor: it is for lines on bins only.
            if window == Window::Rectangular {
                samples = single(&noise(4096, seed));
                spectrum::amplitude_spectrum(&mut samples, window, &mut amplitudes).unwrap();
            }
            let density = spectrum::noise_density(&amplitudes, window, rate_hz / 4096.0, &mut scratch).unwrap();
            // Unit variance over rate/2.
            ratios.push(f64::from(density) / (1.0 / (0.5 * f64::from(rate_hz))).sqrt());
        }
        let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
        assert!((mean - 1.0).abs() < 0.03, "{window:?}: {mean}");
    }
}
