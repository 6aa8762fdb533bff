//! Rise times of edges with known shape, over samples per edge and sampling phase, and against the host's polynomial
//! definition.

use meshband::rise_time::{Polarity, RiseTime, RiseTimeConfig, RiseTimeRefusal};
use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::{PI, TAU};

/// Unit edge as a function of time in units of its width.
type Shape = fn(f64) -> f64;

fn linear(u: f64) -> f64 {
    u.clamp(0.0, 1.0)
}

fn raised_cosine(u: f64) -> f64 {
    0.5 * (1.0 - (PI * u.clamp(0.0, 1.0)).cos())
}

/// Step response of a second-order system with the given damping.
fn second_order(u: f64, zeta: f64) -> f64 {
    if u <= 0.0 {
        return 0.0;
    }
    let (w, damped) = (4.0, (1.0 - zeta * zeta).sqrt());
    1.0 - (-zeta * w * u).exp() * ((damped * w * u).cos() + zeta / damped * (damped * w * u).sin())
}

fn damped_half(u: f64) -> f64 {
    second_order(u, 0.5)
}

fn ringing(u: f64) -> f64 {
    second_order(u, 0.05)
}

/// The definition applied to a fine grid: 10-90 % between the points of one third of the greatest slope, in widths.
fn exact_rise(shape: Shape) -> f64 {
    const STEP: f64 = 1e-6;
    let at = |i: i64| shape(i as f64 * STEP);
    let slope = |i: i64| at(i + 1) - at(i);
    let steepest = (-1000..1_500_000).max_by(|&a, &b| slope(a).total_cmp(&slope(b))).unwrap();
    let third = slope(steepest) / 3.0;
    let (mut begin, mut end) = (steepest, steepest);
    while slope(begin - 1) >= third {
        begin -= 1;
    }
    while slope(end) >= third {
        end += 1;
    }
    let (low, high) = (at(begin), at(end));
    let first = |share: f64| (begin..=end).find(|&i| at(i) >= low + share * (high - low)).unwrap() as f64 * STEP;
    first(0.9) - first(0.1)
}

fn config() -> RiseTimeConfig {
    RiseTimeConfig { polarity: Polarity::Rising, minimum_height: 4.0 }
}

/// Edges of height 10 every `pitch` samples, decaying back slowly, at sampling phases spread by an irrational pitch.
fn train(shape: Shape, width_samples: f64, teeth: usize) -> (Vec<f64>, f64) {
    let pitch = 20.0 * width_samples + 0.618_033_99;
    let count = (pitch * teeth as f64) as usize;
    let samples = (0..count)
        .map(|n| {
            let since = (n as f64) % pitch - 8.0 * width_samples;
            let fall = 1.0 - raised_cosine((since / width_samples - 4.0) / 6.0);
            10.0 * shape(since / width_samples) * fall
        })
        .collect();
    (samples, pitch)
}

fn measure(samples: &[f64], pitch: f64, config: RiseTimeConfig) -> Result<(f64, f64, u16), RiseTimeRefusal> {
    let mut estimator = RiseTime::<512>::new(config, pitch as f32);
    for &x in samples {
        let _ = estimator.push(x as f32);
    }
    let result = estimator.result()?;
    Ok((f64::from(result.samples_per_edge), f64::from(result.deviation_samples), result.count))
}

#[test]
fn theory_exact_factors_of_the_shapes() {
    assert!((exact_rise(linear) - 0.8).abs() < 1e-5);
    // Between the third-slope points of a half sine the levels are +-sqrt(8)/3 of the amplitude.
    let quarter = 2.0 * (0.8 * 8f64.sqrt() / 3.0).asin() / PI;
    assert!((exact_rise(raised_cosine) - quarter).abs() < 1e-5, "{quarter}");
}

#[test]
fn theory_rise_time_within_2_percent_at_10_samples_and_5_percent_at_5() {
    let shapes: [(&str, Shape); 4] =
        [("linear", linear), ("raised cosine", raised_cosine), ("damped", damped_half), ("ringing", ringing)];
    for (name, shape) in shapes {
        let factor = exact_rise(shape);
        for (samples_per_edge, limit) in
            [(5.2, 0.05), (7.0, 0.05), (10.0, 0.02), (14.3, 0.02), (40.0, 0.02), (101.0, 0.02)]
        {
            let (samples, pitch) = train(shape, samples_per_edge / factor, 70);
            let (found, deviation, count) = measure(&samples, pitch, config()).unwrap();
            let error = found / samples_per_edge - 1.0;
            println!("{name} {samples_per_edge}: {:+.2} % MAD {:.3} of {count}", 100.0 * error, deviation);
            assert!(error.abs() < limit, "{name} at {samples_per_edge}: {error}");
            assert!(count >= 60, "{count}");
        }
    }
}

#[test]
fn theory_a_linear_ramp_on_a_ring_gives_0_8_of_its_width() {
    // Ring slopes up to a fifth of the ramp's, as in the host's test on polynomials.
    for (samples_per_edge, limit) in [(5.2, 0.05), (10.0, 0.02), (20.0, 0.02)] {
        for ring_period in [12.0, 17.0, 31.0] {
            let width = samples_per_edge / 0.8;
            let (mut samples, pitch) = train(linear, width, 70);
            let omega = TAU / (ring_period * width);
            let amplitude = 0.2 * 10.0 / width / omega;
            for (n, x) in samples.iter_mut().enumerate() {
                *x += amplitude * (omega * n as f64).cos();
            }
            let (found, _, _) = measure(&samples, pitch, config()).unwrap();
            let error = found / samples_per_edge - 1.0;
            println!("ramp on ring {ring_period}, {samples_per_edge}: {:+.2} %", 100.0 * error);
            assert!(error.abs() < limit, "{samples_per_edge} on {ring_period}: {error}");
        }
    }
}

#[test]
fn ref_samples_of_polynomials_time_as_the_polynomials_do() {
    use meshband_host::law::edges::{Step, edge_in_window};
    // A smooth edge between two parabolas, continuous with its slope.
    let steps = [
        Step { start_s: -4.0, length_s: 4.0, coefficients: vec![0.0, 0.0, 0.0] },
        Step { start_s: 0.0, length_s: 1.0, coefficients: vec![0.0, 0.0, 3.0, -2.0] },
        Step { start_s: 1.0, length_s: 4.0, coefficients: vec![1.0, 0.0, 0.0] },
    ];
    let exact = edge_in_window(&steps, [0.2, 0.8]).unwrap().rise_time_s;
    for (samples_per_edge, limit) in [(5.2, 0.05), (10.0, 0.02), (50.0, 0.02)] {
        let (samples, pitch) = train(
            |u| {
                let u = u.clamp(0.0, 1.0);
                u * u * (3.0 - 2.0 * u)
            },
            samples_per_edge / exact,
            70,
        );
        let (found, _, _) = measure(&samples, pitch, config()).unwrap();
        let error = found / samples_per_edge - 1.0;
        println!("polynomial, {samples_per_edge}: {:+.2} %", 100.0 * error);
        assert!(error.abs() < limit, "{samples_per_edge}: {error}");
    }
}

#[test]
fn theory_too_coarse_sampling_is_refused() {
    let (samples, pitch) = train(linear, 2.0, 70);
    match measure(&samples, pitch, config()) {
        Err(RiseTimeRefusal::TooCoarse { samples_per_edge }) => assert!(samples_per_edge < 5.0),
        other => panic!("accepted: {other:?}"),
    }
    assert_eq!(measure(&[0.0; 500], 50.0, config()).unwrap_err(), RiseTimeRefusal::NoEdges);
}

#[test]
fn theory_noise_of_half_a_percent_costs_at_most_5_percent() {
    // RMS of the noise for edges of height 10, and the limit.
    for (noise, limit) in [(0.05, 0.05), (0.1, 0.1)] {
        for samples_per_edge in [10.0, 20.0, 40.0, 100.0] {
            let mut rng = ChaCha8Rng::seed_from_u64(3);
            let (mut samples, pitch) = train(raised_cosine, samples_per_edge / exact_rise(raised_cosine), 70);
            for x in &mut samples {
                *x += noise * ((0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0);
            }
            let mut estimator = RiseTime::<512>::new(config(), pitch as f32);
            estimator.expect(samples_per_edge as f32);
            for &x in &samples {
                let _ = estimator.push(x as f32);
            }
            let result = match estimator.result() {
                // A noise of one per cent lies at the estimator's own limit.
                Err(RiseTimeRefusal::Noisy { .. }) if noise == 0.1 => continue,
                result => result.expect("half a per cent is a good measurement"),
            };
            let error = f64::from(result.samples_per_edge) / samples_per_edge - 1.0;
            let percent = 100.0 * error;
            println!("noise {noise}, {samples_per_edge}: {percent:+.2} % MAD {:.2}", result.deviation_samples);
            assert!(error.abs() < limit, "noise {noise}, {samples_per_edge}: {error}");
        }
    }
}

#[test]
fn regress_a15_noise_that_would_cut_edges_short_gives_no_result() {
    // RMS of the noise in per cent of the height, ten samples per edge, ten teeth as a node takes them, eight draws.
    for percent in [0.5, 1.0, 1.5, 2.0, 3.0, 5.0] {
        let mut told = Vec::new();
        for seed in 0..8 {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let (mut samples, pitch) = train(raised_cosine, 10.0 / exact_rise(raised_cosine), 12);
            for x in &mut samples {
                *x += 0.1 * percent * ((0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0);
            }
            let mut estimator = RiseTime::<256>::new(config(), pitch as f32);
            estimator.expect(10.0);
            for &x in &samples {
                let _ = estimator.push(x as f32);
            }
            if let Ok(result) = estimator.result() {
                told.push(f64::from(result.samples_per_edge) / 10.0);
                let noise = 100.0 * f64::from(result.noise);
                assert!((noise / percent - 0.9).abs() < 0.35, "{percent} % is told as {noise} %");
            }
        }
        println!("{percent} %: {told:.3?}");
        assert!(told.iter().all(|ratio| (ratio - 1.0).abs() < 0.15), "{percent} %: {told:?}");
        assert!(percent > 0.6 || told.len() == 8, "{percent} % is a good measurement");
        assert!(percent < 1.4 || told.is_empty(), "{percent} % cuts edges short: {told:?}");
    }
}

/// A low-pass that passes 0.39 and stops 0.61 of the rate like the node's decimation: windowed sinc, `over` points per
/// sample.
fn low_pass(over: usize) -> Vec<f64> {
    const HALF_SAMPLES: f64 = 13.0;
    let count = HALF_SAMPLES as usize * over;
    let taps: Vec<f64> = (0..=2 * count)
        .map(|i| {
            let t = i as f64 / over as f64 - HALF_SAMPLES;
            let sinc = if i == count { 1.0 } else { (PI * t).sin() / (PI * t) };
            // Blackman-Harris: 92 dB.
            let turn = PI * (1.0 + t / HALF_SAMPLES);
            let window = 0.35875 - 0.48829 * turn.cos() + 0.14128 * (2.0 * turn).cos() - 0.01168 * (3.0 * turn).cos();
            sinc * window
        })
        .collect();
    let sum: f64 = taps.iter().sum();
    taps.iter().map(|tap| tap / sum).collect()
}

#[test]
fn theory_a_ramp_behind_a_decimation_filter_keeps_its_rise_time() {
    // The filter turns the ramp's kinks into a slope that rings; every sampling phase in turn.
    const OVERSAMPLING: usize = 20;
    let taps = low_pass(OVERSAMPLING);
    for samples_per_edge in [5.2, 6.0, 7.25, 8.0, 10.0, 14.3, 20.0] {
        let width = samples_per_edge / 0.8;
        let pitch = (12.0 * width) as usize + 60;
        let fine = |i: usize| {
            let u = (i as f64 / OVERSAMPLING as f64 - 30.0) / width - 2.0;
            10.0 * linear(u) * (1.0 - raised_cosine((u - 1.5) / 7.0))
        };
        let raw: Vec<f64> = (0..pitch * OVERSAMPLING).map(fine).collect();
        let filtered = |i: usize| -> f64 {
            let first = (i + raw.len() - taps.len() / 2) % raw.len();
            taps.iter().enumerate().map(|(k, tap)| tap * raw[(first + k) % raw.len()]).sum()
        };
        let mut estimator = RiseTime::<512>::new(config(), pitch as f32);
        estimator.expect(samples_per_edge as f32);
        for phase in 0..OVERSAMPLING {
            for i in 0..pitch {
                let _ = estimator.push(filtered(i * OVERSAMPLING + phase) as f32);
            }
        }
        let error = f64::from(estimator.result().unwrap().samples_per_edge) / samples_per_edge - 1.0;
        println!("filtered ramp, {samples_per_edge}: {:+.2} %", 100.0 * error);
        assert!(error.abs() < 0.02, "{samples_per_edge}: {error}");
    }
}

#[test]
fn theory_falling_edges_are_rising_edges_upside_down() {
    let (samples, pitch) = train(damped_half, 30.0, 40);
    let mirrored: Vec<f64> = samples.iter().map(|x| -x).collect();
    let falling = RiseTimeConfig { polarity: Polarity::Falling, ..config() };
    let either = RiseTimeConfig { polarity: Polarity::Either, ..config() };
    let rising = measure(&samples, pitch, config()).unwrap();
    assert_eq!(Ok(rising), measure(&mirrored, pitch, falling));
    assert_eq!(Ok(rising), measure(&mirrored, pitch, either));
}

#[test]
fn theory_the_steepest_edge_per_pitch_is_timed() {
    // A second, slower pulse per pitch must not enter the median.
    let width = 20.0 / exact_rise(raised_cosine);
    let (mut samples, pitch) = train(raised_cosine, 20.0 / exact_rise(raised_cosine), 70);
    for (n, x) in samples.iter_mut().enumerate() {
        let since = (n as f64) % pitch;
        *x += 12.0 * raised_cosine(since / (2.0 * width)) * (1.0 - raised_cosine((since / width - 3.0) / 2.0));
    }
    let (found, deviation, _) = measure(&samples, pitch, config()).unwrap();
    assert!((found / 20.0 - 1.0).abs() < 0.01, "{found}");
    assert!(deviation < 0.2, "{deviation}");
}
