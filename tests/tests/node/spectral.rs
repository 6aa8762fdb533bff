//! The f64 reference spectra against closed forms.

use meshband_host::spectral::{
    AngleMap, Window, amplitude_spectrum, bessel_i0, line_near, noise_power, order_spectrum, power_density,
    running_median, synchronous_average,
};
use rand::SeedableRng;
use rand_distr::{Distribution, Normal, StandardNormal};
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;

const RATE: f64 = 8192.0;

fn tone(n: usize, hz: f64, amplitude: f64, phase: f64) -> Vec<f64> {
    (0..n).map(|i| amplitude * (TAU * hz * i as f64 / RATE + phase).cos()).collect()
}

#[test]
fn theory_amplitude_spectrum_shows_peak_amplitudes() {
    let signal = tone(8192, 500.0, 3.0, 0.4);
    for window in [Window::Rectangular, Window::Hann, Window::BlackmanHarris, Window::FlatTop] {
        let spectrum = amplitude_spectrum(&signal, RATE, window);
        assert!((spectrum.values[500] - 3.0).abs() < 1e-6, "{window:?} {}", spectrum.values[500]);
        assert!(spectrum.values[1000] < 1e-4);
    }
    // The flat top reads a line between bins right to 0.04 %.
    let between = amplitude_spectrum(&tone(8192, 500.5, 3.0, 0.4), RATE, Window::FlatTop);
    assert!((between.values[500] / 3.0 - 1.0).abs() < 5e-4);
}

#[test]
fn theory_window_noise_bandwidths() {
    for (window, bins) in
        [(Window::Rectangular, 1.0), (Window::Hann, 1.5), (Window::BlackmanHarris, 2.0044), (Window::FlatTop, 3.8112)]
    {
        assert!((window.enbw_bins() - bins).abs() < 1e-4, "{window:?}");
        let w = window.weights(1000);
        let direct = 1000.0 * w.iter().map(|x| x * x).sum::<f64>() / w.iter().sum::<f64>().powi(2);
        assert!((window.enbw_bins() - direct).abs() < 1e-9);
    }
}

#[test]
fn theory_density_of_white_noise_integrates_to_its_variance() {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    let normal = Normal::new(0.0, 2.0).unwrap();
    let noise: Vec<f64> = (0..1 << 17).map(|_| normal.sample(&mut random)).collect();
    let density = power_density(&noise, RATE, 1024, Window::Hann);
    let total: f64 = density.values.iter().sum::<f64>() * density.bin;
    assert!((total / 4.0 - 1.0).abs() < 0.02, "{total}");
    let level = density.median_between(500.0, 3500.0);
    assert!((level / (4.0 / (0.5 * RATE)) - 1.0).abs() < 0.03, "{level}");
}

#[test]
fn theory_line_is_found_far_below_the_bin_width() {
    for (hz, phase) in [(766.6003, 0.3), (33.33012, -2.0), (4000.777, 3.0)] {
        let mut signal = tone(16_384, hz, 2.5, phase);
        // A line ten bins away and an offset must not pull it.
        for (x, y) in signal.iter_mut().zip(tone(16_384, hz + 6.0, 2.0, 1.0)) {
            *x += y + 5.0;
        }
        let line = line_near(&signal, RATE, hz + 1.0, 3.0).unwrap();
        // -92 dB of the neighbour remain.
        assert!((line.frequency_hz - hz).abs() < 3e-5, "{} for {hz}", line.frequency_hz);
        assert!((line.amplitude - 2.5).abs() < 5e-4, "{}", line.amplitude);
        assert!((line.phase_rad - phase).abs() < 1e-3, "{}", line.phase_rad);
    }
    assert!(line_near(&[0.0; 8], RATE, 100.0, 1.0).is_none());
}

/// A shaft speeding up as turns(t) = 10 t + 2 t^2, one pulse per turn.
fn run_up() -> (Vec<f64>, AngleMap) {
    let samples = 4 * 8192;
    let turns = |t: f64| 10.0 * t + 2.0 * t * t;
    let signal = (0..samples)
        .map(|i| {
            let angle = TAU * turns(i as f64 / RATE);
            1.5 * (19.0 * angle + 0.2).cos() + 0.25 * (38.0 * angle).cos() + 0.1 * (7.3 * angle).cos()
        })
        .collect();
    let edges: Vec<f64> = (0..72).map(|k| (-10.0 + (100.0 + 8.0 * f64::from(k)).sqrt()) / 4.0).collect();
    (signal, AngleMap::new(&edges, 1, 0.0).unwrap())
}

#[test]
fn theory_order_spectrum_holds_lines_still_in_a_run_up() {
    let (signal, map) = run_up();
    let orders = order_spectrum(&signal, RATE, &map, Window::FlatTop).unwrap();
    let at = |order: f64| orders.values[(order / orders.bin).round() as usize];
    assert!((at(19.0) - 1.5).abs() < 1.5e-2, "{}", at(19.0));
    assert!((at(38.0) - 0.25).abs() < 5e-3, "{}", at(38.0));
    // The plain spectrum smears the same line to less than a fifth.
    let plain = amplitude_spectrum(&signal, RATE, Window::FlatTop);
    assert!(plain.values.iter().fold(0.0_f64, |a, &b| a.max(b)) < 0.3);
}

#[test]
fn theory_synchronous_average_keeps_integer_orders_only() {
    let (signal, map) = run_up();
    let (average, turns) = synchronous_average(&signal, RATE, &map).unwrap();
    assert_eq!(turns, 71);
    let n = average.len() as f64;
    let part = |order: f64| {
        let (mut c, mut s) = (0.0, 0.0);
        for (i, x) in average.iter().enumerate() {
            let (sin, cos) = (TAU * order * i as f64 / n).sin_cos();
            c += 2.0 * x * cos / n;
            s += 2.0 * x * sin / n;
        }
        f64::hypot(c, s)
    };
    assert!((part(19.0) - 1.5).abs() < 1e-2, "{}", part(19.0));
    assert!(part(7.0) < 0.01, "{}", part(7.0));
}

#[test]
fn theory_angle_map_is_exact_for_constant_speed_and_goes_straight_on_beyond() {
    let edges: Vec<f64> = (0..10).map(|k| 0.3 + 0.05 * f64::from(k)).collect();
    let map = AngleMap::new(&edges, 2, 1.0).unwrap();
    assert_eq!(map.range(), (1.0, 5.5));
    for turns in [0.0, 1.0, 2.37, 5.5, 7.0] {
        assert!((map.time_at(turns) - (0.3 + 0.1 * (turns - 1.0))).abs() < 1e-12);
    }
    assert!(AngleMap::new(&[1.0], 1, 0.0).is_none());
}

#[test]
fn ref_bessel_i0_is_that_of_the_tables() {
    // Abramowitz, Stegun, table 9.8 (e^-x I0), and I0(5) = 27.239871823604...
    for (x, scaled) in [(0.0, 1.0), (1.0, 0.465_759_607_6), (5.0, 0.183_540_812_6), (10.0, 0.127_833_337_2)] {
        assert!((bessel_i0(x) * f64::exp(-x) - scaled).abs() < 1e-10, "{x}");
    }
}

#[test]
fn theory_local_noise_is_its_mean_between_lines_and_follows_a_slope() {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    let mut draw = || -> f64 { StandardNormal.sample(&mut random) };
    let level = |b: usize| 1.0 + b as f64 / 6000.0;
    let mut bins: Vec<Complex64> =
        (0..12_000).map(|b| Complex64::new(draw(), draw()) * (0.5 * level(b)).sqrt()).collect();
    let ratio = |bins: &[Complex64]| {
        let noise = noise_power(bins);
        (0..bins.len()).map(|b| noise[b] / level(b)).sum::<f64>() / bins.len() as f64
    };
    assert!((ratio(&bins) - 1.0).abs() < 0.03, "{}", ratio(&bins));
    // Lines on every tenth bin lift the quantile a little, not to their own height.
    bins.iter_mut().step_by(10).for_each(|bin| *bin += 1e3);
    assert!((1.0..1.25).contains(&ratio(&bins)), "{}", ratio(&bins));
    let values: Vec<f64> = (0..1000).map(|i| if i % 3 == 0 { 1e6 } else { 2.0 }).collect();
    assert!(running_median(&values, 16).iter().all(|m| *m == 2.0));
}
