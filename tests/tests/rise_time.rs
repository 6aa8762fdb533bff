//! Rise times of edges with known shape, over samples per edge and sampling phase.

use meshband::rise_time::{Polarity, PreEdge, RiseTime, RiseTimeConfig, RiseTimeRefusal};
use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Unit edge as a function of time in units of its width.
type Shape = fn(f64) -> f64;

fn linear(u: f64) -> f64 {
    u.clamp(0.0, 1.0)
}

fn raised_cosine(u: f64) -> f64 {
    0.5 * (1.0 - (std::f64::consts::PI * u.clamp(0.0, 1.0)).cos())
}

/// Step response of a second-order system with 50 % damping.
fn second_order(u: f64) -> f64 {
    if u <= 0.0 {
        return 0.0;
    }
    let (w, zeta) = (4.0, 0.5f64);
    let damped = (1.0 - zeta * zeta).sqrt();
    1.0 - (-zeta * w * u).exp() * ((damped * w * u).cos() + zeta / damped * (damped * w * u).sin())
}

/// Exact 10-90 % duration between rest and the first maximum, in widths.
fn exact_rise(shape: Shape) -> f64 {
    let grid: Vec<f64> = (0..2_000_000).map(|i| shape(f64::from(i) * 1e-6)).collect();
    let top = grid.iter().copied().fold(0.0, f64::max);
    let first = |level: f64| grid.iter().position(|&y| y >= level * top).unwrap() as f64 * 1e-6;
    first(0.9) - first(0.1)
}

fn config(pre_edge: PreEdge, hysteresis: f32) -> RiseTimeConfig {
    RiseTimeConfig { pre_edge, polarity: Polarity::Rising, hysteresis, minimum_height: 4.0 }
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
    let mut estimator = RiseTime::<4096>::new(config, pitch as f32);
    for &x in samples {
        let _ = estimator.push(x as f32);
    }
    let result = estimator.result()?;
    Ok((f64::from(result.samples_per_edge), f64::from(result.deviation_samples), result.count))
}

#[test]
fn theory_exact_factors_of_the_shapes() {
    assert!((exact_rise(linear) - 0.8).abs() < 1e-5);
    assert!((exact_rise(raised_cosine) - 0.590).abs() < 5e-4);
}

#[test]
fn theory_rise_time_within_2_percent_at_10_samples_and_5_percent_at_5() {
    for (name, shape) in [("linear", linear as Shape), ("raised cosine", raised_cosine), ("second order", second_order)]
    {
        let factor = exact_rise(shape);
        for (samples_per_edge, limit) in
            [(5.2, 0.05), (7.0, 0.05), (10.0, 0.02), (14.3, 0.02), (40.0, 0.005), (101.0, 0.002)]
        {
            for pre_edge in [PreEdge::LocalExtremum, PreEdge::Median] {
                let (samples, pitch) = train(shape, samples_per_edge / factor, 70);
                let (found, deviation, count) = measure(&samples, pitch, config(pre_edge, 0.1)).unwrap();
                let error = found / samples_per_edge - 1.0;
                println!("{name} {pre_edge:?} {samples_per_edge}: {:+.2} % MAD {:.3}", 100.0 * error, deviation);
                assert!(error.abs() < limit, "{name} {pre_edge:?} at {samples_per_edge}: {error}");
                assert!(count >= 60, "{count}");
            }
        }
    }
}

#[test]
fn theory_too_coarse_sampling_is_refused() {
    let (samples, pitch) = train(linear, 2.0, 70);
    match measure(&samples, pitch, config(PreEdge::LocalExtremum, 0.1)) {
        Err(RiseTimeRefusal::TooCoarse { samples_per_edge }) => assert!(samples_per_edge < 5.0),
        other => panic!("accepted: {other:?}"),
    }
    assert_eq!(measure(&[0.0; 500], 50.0, config(PreEdge::Median, 0.1)).unwrap_err(), RiseTimeRefusal::NoEdges);
}

#[test]
fn theory_noise_on_the_rest_level_is_bridged_by_the_median() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let (mut samples, pitch) = train(raised_cosine, 40.0 / 0.590, 70);
    for x in &mut samples {
        *x += 0.05 * ((0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0);
    }
    let (found, deviation, _) = measure(&samples, pitch, config(PreEdge::Median, 0.4)).unwrap();
    assert!((found / 40.0 - 1.0).abs() < 0.03, "{found} with MAD {deviation}");
}

#[test]
fn theory_falling_edges_are_rising_edges_upside_down() {
    let (samples, pitch) = train(second_order, 30.0, 40);
    let mirrored: Vec<f64> = samples.iter().map(|x| -x).collect();
    let rising = config(PreEdge::LocalExtremum, 0.1);
    let falling = RiseTimeConfig { polarity: Polarity::Falling, ..rising };
    assert_eq!(measure(&samples, pitch, rising), measure(&mirrored, pitch, falling));
}

#[test]
fn theory_the_highest_upstroke_per_pitch_is_timed() {
    // A second, slower and lower pulse per pitch must not enter the median.
    let (mut samples, pitch) = train(raised_cosine, 20.0 / 0.590, 70);
    let width = 20.0 / 0.590;
    for (n, x) in samples.iter_mut().enumerate() {
        let since = (n as f64) % pitch;
        *x += 6.0 * raised_cosine(since / (2.0 * width)) * (1.0 - raised_cosine((since / width - 3.0) / 2.0));
    }
    let (found, deviation, _) = measure(&samples, pitch, config(PreEdge::LocalExtremum, 0.1)).unwrap();
    assert!((found / 20.0 - 1.0).abs() < 0.01, "{found}");
    assert!(deviation < 0.2, "{deviation}");
}
