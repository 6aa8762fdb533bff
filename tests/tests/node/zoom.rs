//! Mesh bands against known lines and an f64 transform: steady, in noise, in a run-up, across a fixed line.

use meshband::order::OrderTracker;
use meshband::window::Window;
use meshband::zoom::{Averaging, MeshZoom, SAMPLES_PER_PITCH, ZoomConfig, ZoomError, common_turns, orders_swept};
use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

const TEETH: u16 = 55;
const WHEEL: u16 = 75;
const POINTS: usize = 256;
const HARMONICS: usize = 5;

type Zoom = MeshZoom<POINTS, HARMONICS>;

fn zoom(turns: u16, window: Window, records: u16) -> Box<Zoom> {
    let averaging = Averaging::Linear { records };
    Box::new(Zoom::new(ZoomConfig { teeth: TEETH, turns, window, averaging }).unwrap())
}

/// A line of the test signal: order of the pinion, amplitude, phase.
#[derive(Clone, Copy)]
struct Component {
    order: f64,
    amplitude: f64,
    phase: f64,
}

/// Harmonics 1..5 with sidebands +-1..3 of pinion and (unless empty) wheel, all of different height.
fn gear_signal(wheel_sidebands: bool) -> Vec<Component> {
    let mut lines = Vec::new();
    let wheel = f64::from(TEETH) / f64::from(WHEEL);
    for h in 1..=5 {
        let carrier = 10.0 / f64::from(h);
        let centre = f64::from(h) * f64::from(TEETH);
        lines.push(Component { order: centre, amplitude: carrier, phase: f64::from(h) });
        for k in 1..=3 {
            for side in [-1.0, 1.0] {
                let amplitude = carrier * 0.3 / f64::from(k) * (1.0 + 0.2 * side);
                let phase = 0.7 * f64::from(k) + side;
                lines.push(Component { order: centre + side * f64::from(k), amplitude, phase });
                if wheel_sidebands {
                    let order = centre + side * f64::from(k) * wheel;
                    lines.push(Component { order, amplitude: 0.6 * amplitude, phase: phase + 1.0 });
                }
            }
        }
    }
    lines
}

fn at(lines: &[Component], turns: f64) -> f64 {
    lines.iter().map(|l| l.amplitude * (TAU * (l.order * turns).fract() + l.phase).cos()).sum()
}

fn gaussian(rng: &mut ChaCha8Rng) -> f64 {
    (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
}

/// Feeds exact angle-domain samples, plus noise of the given RMS.
fn feed_angle(zoom: &mut Zoom, lines: &[Component], turns: usize, noise: f64) {
    let per_turn = zoom.samples_per_turn() as usize;
    assert_eq!(per_turn, usize::from(TEETH) * SAMPLES_PER_PITCH);
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    for n in 0..turns * per_turn {
        let x = at(lines, n as f64 / per_turn as f64) + noise * gaussian(&mut rng);
        let _ = zoom.push(&[x as f32]);
    }
}

/// Feeds time samples and turn marks through the order tracker. `angle(t)` in turns, `time(turns)` its inverse.
fn feed_time(
    zoom: &mut Zoom,
    signal: impl Fn(f64) -> f64,
    time: impl Fn(f64) -> f64,
    turns: usize,
    rate_hz: f64,
) -> f64 {
    const CLOCK_HZ: f64 = 84e6;
    let period_ticks = (CLOCK_HZ / rate_hz).round() as u32;
    let period = f64::from(period_ticks) / CLOCK_HZ;
    let mut tracker = Box::new(OrderTracker::<16384>::new());
    let offset = u32::MAX - 5_000_000;
    let tick = |t: f64| offset.wrapping_add((t * CLOCK_HZ).round() as u64 as u32);
    let (mut sample, mut mark, mut done) = (0u64, 0usize, 0usize);
    let mut chunk = [0.0f32; 256];
    while done < turns {
        let first = sample;
        let block: Vec<f32> = (0..64).map(|i| signal((first + i) as f64 * period) as f32).collect();
        sample += 64;
        tracker
            .push_samples(&block, offset.wrapping_add((first * u64::from(period_ticks)) as u32), period_ticks)
            .unwrap();
        while time(mark as f64) <= sample as f64 * period {
            tracker.push_mark(tick(time(mark as f64)));
            mark += 1;
        }
        while let Ok(Some(turn)) = tracker.next_turn() {
            let per_turn = zoom.samples_per_turn();
            let mut index = 0;
            while index < per_turn {
                let count = (per_turn - index).min(256) as usize;
                tracker.resample(&turn, index, per_turn, &mut chunk[..count]);
                let _ = zoom.push(&chunk[..count]);
                index += count as u32;
            }
            done += 1;
        }
    }
    sample as f64 * period
}

/// Largest errors over all lines: decibels and bins.
fn errors(zoom: &Zoom, lines: &[Component]) -> (f64, f64) {
    let (mut level, mut place) = (0.0f64, 0.0f64);
    for line in lines {
        let harmonic = (line.order / f64::from(TEETH)).round();
        let offset = line.order - harmonic * f64::from(TEETH);
        let found = zoom.line(harmonic as usize, offset as f32).expect("inside the band");
        level = level.max((20.0 * (f64::from(found.amplitude) / line.amplitude).log10()).abs());
        place = place.max((f64::from(found.bin) - offset * f64::from(zoom.config().turns)).abs());
    }
    (level, place)
}

#[test]
fn theory_resolution_is_at_least_an_eighth_of_the_shaft_frequency() {
    assert!(zoom(8, Window::Hann, 1).order_per_bin() <= 0.125);
    let config =
        ZoomConfig { teeth: TEETH, turns: 7, window: Window::Hann, averaging: Averaging::Linear { records: 1 } };
    assert_eq!(Zoom::new(config).unwrap_err(), ZoomError::Turns);
    assert_eq!(Zoom::new(ZoomConfig { teeth: 11, turns: 16, ..config }).unwrap_err(), ZoomError::Teeth);
    let none = ZoomConfig { turns: 16, averaging: Averaging::Linear { records: 0 }, ..config };
    assert_eq!(Zoom::new(none).unwrap_err(), ZoomError::Averaging);
}

#[test]
fn theory_harmonics_and_sidebands_of_both_shafts_on_common_turns() {
    let turns = common_turns(TEETH, WHEEL).unwrap();
    assert_eq!(turns, 15);
    let lines = gear_signal(true);
    let mut zoom = zoom(turns, Window::Rectangular, 1);
    feed_angle(&mut zoom, &lines, 18, 0.0);
    let (level, place) = errors(&zoom, &lines);
    println!("common turns: {level} dB, {place} bin");
    assert!(level < 0.01 && place < 1e-3, "{level} dB, {place} bin");
}

#[test]
fn theory_pinion_sidebands_with_every_window() {
    let lines = gear_signal(false);
    for window in [Window::Hann, Window::BlackmanHarris, Window::FlatTop] {
        let mut zoom = zoom(16, window, 1);
        feed_angle(&mut zoom, &lines, 18, 0.0);
        let (level, place) = errors(&zoom, &lines);
        println!("{window:?}: {level} dB, {place} bin");
        assert!(level < 0.01 && place < 0.02, "{window:?}: {level} dB, {place} bin");
    }
}

#[test]
fn theory_a_coarser_grid_gives_the_same_lines_and_folds_nothing_into_them() {
    for grid in [18, 20, 22, 26, 30] {
        let mut lines = gear_signal(false);
        let mut zoom = zoom(16, Window::Hann, 1);
        zoom.set_samples_per_pitch(grid);
        assert_eq!(zoom.samples_per_turn(), u32::from(TEETH) * grid as u32);
        // Whatever the input may hold up to half a pitch below the highest harmonic's image.
        let wanted = lines.len();
        for harmonic in [6.0, 7.5, grid as f64 - 5.5] {
            lines.push(Component { order: harmonic * f64::from(TEETH), amplitude: 10.0, phase: harmonic });
        }
        let per_turn = zoom.samples_per_turn() as usize;
        for n in 0..18 * per_turn {
            let _ = zoom.push(&[at(&lines, n as f64 / per_turn as f64) as f32]);
        }
        let (level, place) = errors(&zoom, &lines[..wanted]);
        println!("{grid} per pitch: {level} dB, {place} bin");
        assert!(level < 0.02 && place < 0.02, "{grid} per pitch: {level} dB, {place} bin");
    }
}

#[test]
fn theory_lines_between_bins_within_a_tenth_of_a_decibel_and_bin() {
    for step in 0..10 {
        let mut lines = Vec::new();
        for h in 1..=5 {
            for (k, side) in [(0.0, 0.0), (3.3, 0.037), (-2.6, 0.019)] {
                let order = f64::from(h * i32::from(TEETH)) + k + side * f64::from(step) / 10.0;
                lines.push(Component { order, amplitude: 1.0 / f64::from(h), phase: f64::from(step) });
            }
        }
        let mut zoom = zoom(16, Window::Hann, 1);
        feed_angle(&mut zoom, &lines, 18, 0.0);
        let (level, place) = errors(&zoom, &lines);
        assert!(level < 0.05 && place < 0.05, "{step}: {level} dB, {place} bin");
    }
}

#[test]
fn theory_strong_lines_outside_the_bands_do_not_leak_in() {
    // Everywhere else: strong lines halfway between harmonics, high harmonics that do not fold, and the fold places of
    // the decimator (16 orders and its multiples away).
    let mut lines = Vec::new();
    for order in [27.5, 82.3, 137.6, 192.4, 55.0 + 16.0, 55.0 + 13.0, 110.0 - 16.4, 165.0 + 32.2, 385.0, 660.0] {
        lines.push(Component { order, amplitude: 1.0, phase: order });
    }
    let mut zoom = zoom(16, Window::BlackmanHarris, 1);
    feed_angle(&mut zoom, &lines, 18, 0.0);
    let mut worst = 0.0f32;
    for harmonic in 1..=5 {
        for bin in -(4 * 16)..=(4 * 16) {
            worst = worst.max(zoom.amplitude(harmonic, bin).unwrap());
        }
    }
    println!("leakage into the bands: {} dB", 20.0 * worst.log10());
    assert!(worst < 3e-4, "{} dB", 20.0 * worst.log10());
}

/// Noisy angle-domain samples, noise RMS given.
fn noisy(lines: &[Component], turns: usize, per_turn: usize, noise: f64) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    (0..turns * per_turn).map(|n| at(lines, n as f64 / per_turn as f64) + noise * gaussian(&mut rng)).collect()
}

#[test]
fn ref_noise_20_db_below_the_signal_against_an_f64_transform_of_the_same_samples() {
    let lines = gear_signal(true);
    let power: f64 = lines.iter().map(|l| 0.5 * l.amplitude * l.amplitude).sum();
    let records = 16;
    let mut zoom = zoom(15, Window::Rectangular, records);
    let per_turn = zoom.samples_per_turn() as usize;
    let samples = noisy(&lines, 16 * usize::from(records), per_turn, (power / 100.0).sqrt());
    let mut completed = 0;
    for &x in &samples {
        if completed < u32::from(records) {
            completed += zoom.push(&[x as f32]);
        }
    }
    assert_eq!(completed, u32::from(records));
    // Engagements per output value, engagements per record, and where the record's 15 turns lie in it.
    let spacing = 15.0 * f64::from(TEETH) / POINTS as f64;
    let per_record = ((POINTS as f64 + 5.0) * spacing).ceil() as usize + 1;
    let start = ((2.5 * spacing + 3.0) * SAMPLES_PER_PITCH as f64).round() as usize;
    let (mut against_f64, mut against_truth) = (0.0f64, 0.0f64);
    for line in &lines {
        let mut mean_power = 0.0;
        for record in 0..usize::from(records) {
            let first = record * per_record * SAMPLES_PER_PITCH + start;
            let (mut re, mut im) = (0.0, 0.0);
            for (n, x) in samples[first..first + 15 * per_turn].iter().enumerate() {
                let (s, c) = (TAU * (line.order * n as f64 / per_turn as f64).fract()).sin_cos();
                re += x * c;
                im += x * s;
            }
            let scale = 2.0 / (15 * per_turn) as f64;
            mean_power += (re * re + im * im) * scale * scale / f64::from(records);
        }
        let harmonic = (line.order / 55.0).round();
        let found = zoom.line(harmonic as usize, (line.order - 55.0 * harmonic) as f32).unwrap().amplitude;
        let level = 20.0 * (f64::from(found) / mean_power.sqrt()).log10();
        against_f64 = against_f64.max(level.abs());
        if line.order == 55.0 * harmonic {
            against_truth = against_truth.max((20.0 * (f64::from(found) / line.amplitude).log10()).abs());
        }
    }
    println!("noise 20 dB below: {against_f64} dB against f64, harmonics {against_truth} dB against the truth");
    assert!(against_f64 < 0.1 && against_truth < 0.1, "{against_f64} dB, {against_truth} dB");
}

#[test]
fn theory_noise_20_db_below_the_smallest_line_with_hann() {
    let lines = gear_signal(false);
    let smallest = lines.iter().map(|l| l.amplitude).fold(f64::MAX, f64::min);
    let mut zoom = zoom(16, Window::Hann, 4);
    feed_angle(&mut zoom, &lines, 67, 0.1 * smallest / 2f64.sqrt());
    let (level, place) = errors(&zoom, &lines);
    println!("noise 20 dB below the smallest line: {level} dB, {place} bin");
    assert!(level < 0.1 && place < 0.1, "{level} dB, {place} bin");
}

#[test]
fn theory_speed_from_1_to_25_hz_through_the_order_tracker() {
    let lines = gear_signal(true);
    for speed_hz in [1.0, 4.7, 14.5, 25.0] {
        let mut zoom = zoom(15, Window::Rectangular, 1);
        let rate_hz = speed_hz * f64::from(TEETH) * 21.3;
        feed_time(&mut zoom, |t| at(&lines, speed_hz * t), |turns| turns / speed_hz, 17, rate_hz);
        let (level, place) = errors(&zoom, &lines);
        println!("{speed_hz} Hz: {level} dB, {place} bin");
        assert!(level < 0.1 && place < 0.1, "{speed_hz} Hz: {level} dB, {place} bin");
    }
}

#[test]
fn theory_run_up_of_5_percent_per_second_within_two_tenths_of_a_decibel() {
    let lines = gear_signal(true);
    for start_hz in [1.0, 5.0, 20.0] {
        // Speed grows by 5 % of its start value per second.
        let acceleration = 0.05 * start_hz;
        let angle = |t: f64| start_hz * t + 0.5 * acceleration * t * t;
        let time = |turns: f64| {
            let ratio = start_hz / acceleration;
            -ratio + (ratio * ratio + 2.0 * turns / acceleration).sqrt()
        };
        let mut zoom = zoom(15, Window::Rectangular, 1);
        let rate_hz = start_hz * f64::from(TEETH) * 30.0;
        feed_time(&mut zoom, |t| at(&lines, angle(t)), time, 17, rate_hz);
        let (level, place) = errors(&zoom, &lines);
        println!("run-up from {start_hz} Hz: {level} dB, {place} bin");
        assert!(level < 0.2 && place < 0.1, "{start_hz} Hz: {level} dB, {place} bin");
    }
}

#[test]
fn theory_a_fixed_100_hz_line_swept_through_orders_stays_where_it_is_announced() {
    let start_hz = 1.6;
    let acceleration = 0.05 * start_hz;
    let angle = |t: f64| start_hz * t + 0.5 * acceleration * t * t;
    let time = |turns: f64| {
        let ratio = start_hz / acceleration;
        -ratio + (ratio * ratio + 2.0 * turns / acceleration).sqrt()
    };
    let lines = gear_signal(true);
    let signal = |t: f64| at(&lines, angle(t)) + 1.0 * (TAU * 100.0 * t).cos();
    let mut zoom = zoom(15, Window::Rectangular, 1);
    let end = feed_time(&mut zoom, signal, time, 17, start_hz * f64::from(TEETH) * 30.0);
    let fastest = start_hz + acceleration * end;
    let (low, high) = orders_swept(100.0, start_hz as f32, fastest as f32, 0.5).unwrap();
    assert!(low < 55.0 && high > 60.0, "the test must sweep the first harmonic's band: {low}..{high}");
    let mut touched = 0;
    for line in &lines {
        let harmonic = (line.order / 55.0).round();
        let found = zoom.line(harmonic as usize, (line.order - 55.0 * harmonic) as f32).unwrap();
        let level = (20.0 * (f64::from(found.amplitude) / line.amplitude).log10()).abs();
        if line.order as f32 >= low && line.order as f32 <= high {
            touched += 1;
        } else {
            assert!(level < 0.2, "order {} outside the announced range is off by {level} dB", line.order);
        }
    }
    assert!(touched > 0);
}

#[test]
fn theory_exponential_average_follows_a_step() {
    let config =
        ZoomConfig { teeth: TEETH, turns: 8, window: Window::Hann, averaging: Averaging::Exponential { weight: 0.5 } };
    let mut zoom = Box::new(MeshZoom::<128, 1>::new(config).unwrap());
    let per_turn = zoom.samples_per_turn() as usize;
    let mut seen = Vec::new();
    let mut n = 0usize;
    while seen.len() < 3 {
        let amplitude = if seen.is_empty() { 0.0 } else { 2.0 };
        let x = amplitude * (TAU * (n as f64 * f64::from(TEETH) / per_turn as f64).fract()).cos();
        if zoom.push(&[x as f32]) > 0 {
            seen.push(zoom.amplitude(1, 0).unwrap());
        }
        n += 1;
    }
    // Power 0, then half of 4, then three quarters of 4 (the first step's edges lie in the window's tails).
    assert!(seen[0] < 1e-6 && (seen[1] - 2f32.sqrt()).abs() < 0.02 && (seen[2] - 3f32.sqrt()).abs() < 0.02, "{seen:?}");
}

#[test]
fn theory_sideband_energy_ratio_of_known_lines() {
    let lines = gear_signal(false);
    let mut zoom = zoom(16, Window::Hann, 1);
    feed_angle(&mut zoom, &lines, 18, 0.0);
    // Each pair sums to 2 x 0.3 / k of the carrier.
    let exact = 0.6 * (1.0 + 0.5 + 1.0 / 3.0);
    for harmonic in 1..=5 {
        let ratio = zoom.sideband_energy_ratio(harmonic, 1.0).unwrap();
        assert!((ratio / exact - 1.0).abs() < 1e-3, "{ratio}");
        let table = zoom.sidebands::<3>(harmonic, 1.0);
        assert!(table.upper[0].unwrap().amplitude > table.lower[0].unwrap().amplitude);
    }
}
