//! Condition indicators against an independent f64 computation with rustfft.

use meshband::envelope::envelope;
use meshband::indicators::{Moments, RunEnsemble, fm0};
use meshband::spectrum;
use meshband::tsa::{RegularLines, difference, residual};
use meshband::window::Window;
use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use reference::{Complex64, forward, inverse};
use std::f64::consts::TAU;

/// f64 transforms by rustfft.
mod reference {
    use rustfft::FftPlanner;
    pub use rustfft::num_complex::Complex64;

    pub fn forward(samples: &[f64]) -> Vec<Complex64> {
        let mut bins: Vec<Complex64> = samples.iter().map(|&x| Complex64::new(x, 0.0)).collect();
        FftPlanner::new().plan_fft_forward(bins.len()).process(&mut bins);
        bins
    }

    pub fn inverse(mut bins: Vec<Complex64>) -> Vec<Complex64> {
        let count = bins.len() as f64;
        FftPlanner::new().plan_fft_inverse(bins.len()).process(&mut bins);
        bins.iter().map(|z| z / count).collect()
    }
}

const TEETH: usize = 19;

/// A synchronous average with harmonics, sidebands, broadband content and a local fault of the given height.
fn average(count: usize, seed: u64, fault: f64) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..count)
        .map(|n| {
            let a = n as f64 / count as f64;
            let mesh: f64 = (1..=6)
                .map(|h| {
                    let h = f64::from(h);
                    4.0 / h * (1.0 + 0.1 * (TAU * a).cos()) * (TAU * h * TEETH as f64 * a + h).cos()
                })
                .sum();
            let local = fault * (-((a - 0.4) * 60.0).powi(2)).exp() * (TAU * 130.0 * a).cos();
            let noise = (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
            1.5 + mesh + 0.3 * (TAU * a).sin() + local + 0.2 * noise
        })
        .collect()
}

fn single(x: &[f64]) -> Vec<f32> {
    x.iter().map(|&x| x as f32).collect()
}

fn central(x: &[f64], power: i32) -> f64 {
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    x.iter().map(|x| (x - mean).powi(power)).sum::<f64>() / x.len() as f64
}

/// Removes shaft orders 0..=2 and, around each mesh harmonic, lines up to `sidebands` away.
fn strip(x: &[f64], sidebands: usize) -> Vec<f64> {
    let count = x.len();
    let mut bins = forward(x);
    for k in 0..=count / 2 {
        let near = (1..=count / TEETH).any(|h| (h * TEETH).abs_diff(k) <= sidebands);
        if k <= 2 || near {
            bins[k] = Complex64::default();
            bins[(count - k) % count] = Complex64::default();
        }
    }
    inverse(bins).iter().map(|z| z.re).collect()
}

/// |analytic signal| of orders `first..=last`.
fn band_envelope(x: &[f64], first: usize, last: usize) -> Vec<f64> {
    let bins = forward(x);
    let mut kept = vec![Complex64::default(); x.len()];
    for k in first..=last {
        kept[k] = 2.0 * bins[k];
    }
    inverse(kept).iter().map(|z| z.norm()).collect()
}

#[track_caller]
fn close(name: &str, found: f32, exact: f64) {
    let error = (f64::from(found) / exact - 1.0).abs();
    assert!(error < 1e-4, "{name}: {found}, exact {exact}, relative error {error:e}");
}

#[test]
fn ref_indicators_within_1e_4_of_f64() {
    let lines = RegularLines { teeth: TEETH as u16, shaft_orders: 2, sidebands: 1 };
    for count in [256, 1024, 4096] {
        for (seed, fault) in [(1, 0.0), (2, 1.0), (3, 6.0)] {
            let exact = average(count, seed, fault);
            let samples = single(&exact);
            // The reference takes the same rounded samples.
            let exact: Vec<f64> = samples.iter().map(|&x| f64::from(x)).collect();
            let (mut work, mut out) = (vec![0.0f32; count], vec![0.0f32; count]);

            let moments = Moments::of(&samples);
            let mean = exact.iter().sum::<f64>() / count as f64;
            let rms = central(&exact, 2).sqrt();
            let peak = exact.iter().map(|x| (x - mean).abs()).fold(0.0, f64::max);
            close("mean", moments.mean, mean);
            close("RMS", moments.rms(), rms);
            close("peak", moments.peak(), peak);
            close("crest", moments.crest(), peak / rms);
            close("kurtosis", moments.kurtosis, central(&exact, 4) / rms.powi(4));

            let bins = forward(&exact);
            let mesh: f64 = (1..)
                .map(|h| h * TEETH)
                .take_while(|&k| k < count / 2)
                .map(|k| 2.0 * bins[k].norm() / count as f64)
                .sum();
            let highest = exact.iter().copied().fold(f64::MIN, f64::max);
            let lowest = exact.iter().copied().fold(f64::MAX, f64::min);
            close("FM0", fm0(&samples, TEETH as u16, &mut work).unwrap().unwrap(), (highest - lowest) / mesh);

            difference(&samples, &lines, &mut work, &mut out).unwrap();
            let exact_difference = strip(&exact, 1);
            let moments = Moments::of(&out);
            let m2 = central(&exact_difference, 2);
            close("FM4", moments.kurtosis, central(&exact_difference, 4) / m2.powi(2));
            close("M6A", moments.sixth, central(&exact_difference, 6) / m2.powi(3));
            close("M8A", moments.eighth, central(&exact_difference, 8) / m2.powi(4));
        }
    }
}

#[test]
fn ref_na4_and_nb4_over_runs_within_1e_4_of_f64() {
    let count = 1024;
    let lines = RegularLines { teeth: TEETH as u16, shaft_orders: 2, sidebands: 1 };
    let (mut na4, mut nb4) = (RunEnsemble::default(), RunEnsemble::default());
    let (mut residual_variances, mut envelope_variances) = (Vec::new(), Vec::new());
    for run in 0..10u32 {
        let fault = if run < 6 { 0.0 } else { f64::from(run - 5) };
        let samples = single(&average(count, u64::from(run), fault));
        let exact: Vec<f64> = samples.iter().map(|&x| f64::from(x)).collect();
        let (mut work, mut out) = (vec![0.0f32; count], vec![0.0f32; count]);

        residual(&samples, &lines, &mut work, &mut out).unwrap();
        let exact_residual = strip(&exact, 0);
        residual_variances.push(central(&exact_residual, 2));
        let mean = residual_variances.iter().sum::<f64>() / residual_variances.len() as f64;
        close("NA4", na4.add(&Moments::of(&out)), central(&exact_residual, 4) / mean.powi(2));

        // Envelope of the first harmonic +-6 orders, at every sample of the average.
        let mut bins = vec![Default::default(); count];
        work.copy_from_slice(&samples);
        envelope(&mut work, TEETH - 6, TEETH + 6, &mut bins, &mut out).unwrap();
        let exact_envelope = band_envelope(&exact, TEETH - 6, TEETH + 6);
        envelope_variances.push(central(&exact_envelope, 2));
        let mean = envelope_variances.iter().sum::<f64>() / envelope_variances.len() as f64;
        close("NB4", nb4.add(&Moments::of(&out)), central(&exact_envelope, 4) / mean.powi(2));
    }
    assert_eq!(na4.runs(), 10);
}

#[test]
fn theory_gaussian_noise_has_kurtosis_3_and_a_sine_1_5() {
    let sine: Vec<f32> = (0..4096).map(|n| (TAU * f64::from(n) * 16.0 / 4096.0).sin() as f32).collect();
    let moments = Moments::of(&sine);
    assert!((moments.kurtosis - 1.5).abs() < 1e-5);
    assert!((moments.crest() - 2f32.sqrt()).abs() < 1e-5);
    assert!((moments.sixth - 2.5).abs() < 1e-5 && (moments.eighth - 4.375).abs() < 1e-5);
    let flat = Moments::of(&[2.5; 100]);
    assert_eq!((flat.kurtosis, flat.crest(), flat.rms()), (0.0, 0.0, 0.0));
    assert_eq!(Moments::of(&[]), Moments::default());
}

#[test]
fn theory_envelope_spectrum_shows_the_modulation() {
    // Carrier at line 300, modulated 40 % at line 7.
    let count = 2048;
    let mut samples: Vec<f32> = (0..count)
        .map(|n| {
            let a = f64::from(n) / f64::from(count);
            (2.0 * (1.0 + 0.4 * (TAU * 7.0 * a).cos()) * (TAU * 300.0 * a + 0.3).cos()) as f32
        })
        .collect();
    let (mut work, mut magnitude) = (vec![Default::default(); 128], vec![0.0f32; 128]);
    envelope(&mut samples, 270, 330, &mut work, &mut magnitude).unwrap();
    let mut amplitudes = vec![0.0f32; 65];
    spectrum::amplitude_spectrum(&mut magnitude, Window::Rectangular, &mut amplitudes).unwrap();
    assert!((amplitudes[7] - 0.8).abs() < 1e-4, "{}", amplitudes[7]);
    let rest = amplitudes.iter().enumerate().filter(|(k, _)| *k != 7).map(|(_, a)| *a).fold(0.0, f32::max);
    assert!(rest < 1e-4, "{rest}");
    assert!(envelope(&mut samples, 0, 330, &mut work, &mut magnitude).is_err());
}

#[test]
fn theory_a_local_fault_raises_fm4_m6a_m8a_of_the_difference_signal() {
    let lines = RegularLines { teeth: TEETH as u16, shaft_orders: 2, sidebands: 1 };
    let indicators = |seed: u64, fault: f64| {
        let samples = single(&average(1024, seed, fault));
        let (mut work, mut out) = (vec![0.0f32; 1024], vec![0.0f32; 1024]);
        difference(&samples, &lines, &mut work, &mut out).unwrap();
        let moments = Moments::of(&out);
        [moments.kurtosis, moments.sixth, moments.eighth]
    };
    let healthy: Vec<[f32; 3]> = (0..40).map(|seed| indicators(seed, 0.0)).collect();
    let faulty = indicators(99, 3.0);
    for i in 0..3 {
        let values: Vec<f64> = healthy.iter().map(|h| f64::from(h[i])).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let deviation = central(&values, 2).sqrt();
        assert!(f64::from(faulty[i]) > mean + 5.0 * deviation, "{i}: {} against {mean} +- {deviation}", faulty[i]);
    }
}
