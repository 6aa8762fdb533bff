//! Order tracking and synchronous averages against signals known as functions of angle.

use meshband::indicators::Moments;
use meshband::order::{Discontinuity, OrderTracker};
use meshband::spectrum::real_fft;
use meshband::tsa::{RegularLines, SynchronousAverage, difference, regular, regular_rms, residual, residual_of};
use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

const CLOCK_HZ: f64 = 84e6;
const N: usize = 1024;

/// Drives a tracker with `signal(angle)` under `angle(t)` and hands every finished turn to `each`.
fn drive<const C: usize>(
    angle: impl Fn(f64) -> f64,
    time: impl Fn(f64) -> f64,
    signal: impl Fn(f64) -> f64,
    rate_hz: f64,
    turns: usize,
    jitter_s: f64,
    mut each: impl FnMut(&OrderTracker<C>, &meshband::order::Turn, usize),
) {
    let period_ticks = (CLOCK_HZ / rate_hz).round() as u32;
    let period = f64::from(period_ticks) / CLOCK_HZ;
    let origin = u32::MAX - 1000;
    let mut tracker = Box::new(OrderTracker::<C>::new());
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let (mut sample, mut mark, mut done) = (0u64, 0usize, 0usize);
    while done < turns {
        let block: Vec<f32> = (0..32).map(|i| signal(angle((sample + i) as f64 * period)) as f32).collect();
        let first_tick = origin.wrapping_add((sample * u64::from(period_ticks)) as u32);
        tracker.push_samples(&block, first_tick, period_ticks).unwrap();
        sample += 32;
        while time(mark as f64) <= sample as f64 * period {
            let jitter = jitter_s * ((0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0);
            let tick = ((time(mark as f64) + jitter).max(0.0) * CLOCK_HZ).round() as u64;
            tracker.push_mark(origin.wrapping_add(tick as u32));
            mark += 1;
        }
        while let Ok(Some(turn)) = tracker.next_turn() {
            // The first turn lies between marks 1 and 2.
            each(&tracker, &turn, done + 1);
            done += 1;
        }
    }
}

fn run_up(start_hz: f64, rate_per_s: f64) -> (impl Fn(f64) -> f64 + Copy, impl Fn(f64) -> f64 + Copy) {
    let a = start_hz * rate_per_s;
    (
        move |t: f64| start_hz * t + 0.5 * a * t * t,
        move |turns: f64| {
            if a == 0.0 { turns / start_hz } else { ((start_hz * start_hz + 2.0 * a * turns).sqrt() - start_hz) / a }
        },
    )
}

#[test]
fn theory_resampling_error_up_to_a_quarter_of_the_rate() {
    // An order at f / rate: the stated amplitude error of the interpolator.
    for (ratio, limit) in [(0.05f64, 1.2e-3), (0.125, 1.2e-3), (0.2, 1.2e-3), (0.25, 1.2e-3), (0.3, 0.03)] {
        let (speed_hz, rate_hz) = (10.0f64, 25_000.0f64);
        let order = (ratio * rate_hz / speed_hz).round();
        let mut worst = 0.0f64;
        let (angle, time) = run_up(speed_hz, 0.0);
        drive::<16384>(
            angle,
            time,
            |a| (TAU * order * a).cos(),
            rate_hz,
            3,
            0.0,
            |tracker, turn, start| {
                let mut out = vec![0.0f32; N];
                tracker.resample(turn, 0, N as u32, &mut out);
                for (n, &x) in out.iter().enumerate() {
                    let exact = (TAU * order * (start as f64 + n as f64 / N as f64)).cos();
                    worst = worst.max((f64::from(x) - exact).abs());
                }
            },
        );
        println!("f / rate {ratio}: {worst:e}");
        assert!(worst < limit, "f / rate {ratio}: {worst:e}");
    }
}

#[test]
fn theory_angle_error_of_a_run_up_stays_below_the_bound() {
    for start_hz in [1.0, 3.0, 25.0] {
        let (angle, time) = run_up(start_hz, 0.05);
        let mut worst = 0.0f64;
        let mut change = 0.0;
        // One line per turn: the phase of order 20 read back as an angle.
        drive::<16384>(
            angle,
            time,
            |a| (TAU * 20.0 * a).sin(),
            1000.0 * start_hz,
            4,
            0.0,
            |tracker, turn, _| {
                let mut out = vec![0.0f32; N];
                tracker.resample(turn, 0, N as u32, &mut out);
                for (n, &x) in out.iter().enumerate() {
                    let phase = TAU * 20.0 * n as f64 / N as f64;
                    // Near a zero crossing the value is the phase error.
                    if phase.cos().abs() > 0.98 {
                        worst = worst.max(((f64::from(x) - phase.sin()) / phase.cos()).abs() / TAU / 20.0);
                    }
                }
                change = f64::from(turn.speed_change);
            },
        );
        let relative_per_turn = 0.05 / start_hz;
        let bound = 0.35 * relative_per_turn.powi(3) + 1e-5;
        println!("run-up from {start_hz} Hz: angle error {worst:e} turns, bound {bound:e}");
        assert!(worst < bound, "{start_hz} Hz: {worst:e} > {bound:e}");
        assert!((change / relative_per_turn - 1.0).abs() < 0.35, "speed change {change}");
    }
}

#[test]
fn theory_parts_of_a_turn_equal_the_whole() {
    let (angle, time) = run_up(2.0, 0.05);
    drive::<8192>(
        angle,
        time,
        |a| (TAU * 33.0 * a).sin(),
        2000.0,
        1,
        0.0,
        |tracker, turn, _| {
            let mut whole = vec![0.0f32; 960];
            tracker.resample(turn, 0, 960, &mut whole);
            let mut part = vec![0.0f32; 320];
            for first in [0u32, 320, 640] {
                tracker.resample(turn, first, 960, &mut part);
                let first = first as usize;
                assert_eq!(&whole[first..first + 320], &part[..]);
            }
        },
    );
}

#[test]
fn fault_lost_samples_and_short_buffers_are_told() {
    let mut tracker = OrderTracker::<256>::new();
    tracker.push_samples(&[0.0; 100], 0, 10).unwrap();
    assert_eq!(tracker.push_samples(&[0.0; 100], 1200, 10), Err(Discontinuity::Samples));
    assert_eq!(tracker.push_samples(&[0.0; 10], 2200, 11), Err(Discontinuity::Samples));
    for tick in [0, 500, 1000, 1500] {
        tracker.push_mark(2200 + tick * 11);
    }
    for block in 1..30u32 {
        tracker.push_samples(&[0.0; 100], 2200 + 110 + (block - 1) * 1100, 11).unwrap();
    }
    // The turn of 500 samples is longer than the buffer.
    assert_eq!(tracker.next_turn().unwrap_err(), Discontinuity::Overrun);
    assert_eq!(tracker.turns_dropped, 1);
    assert!(tracker.next_turn().unwrap().is_none());
}

/// Order lines of the pinion and an asynchronous line.
fn gear(angle: f64) -> f64 {
    3.0 * (TAU * 19.0 * angle).cos()
        + 1.0 * (TAU * 38.0 * angle + 0.4).cos()
        + 0.5 * (TAU * 20.0 * angle + 0.1).cos()
        + 0.2 * (TAU * 26.0 * angle).sin()
        + 0.7 * (TAU * 1.0 * angle).cos()
        + 2.0
}

fn average(turns: usize, wheel_line: f64, noise: f64, jitter_s: f64) -> Vec<f32> {
    let (angle, time) = run_up(10.0, 0.02);
    let rng = std::cell::RefCell::new(ChaCha8Rng::seed_from_u64(1));
    let signal = |a: f64| {
        let gaussian = (0..12).map(|_| rng.borrow_mut().random::<f64>()).sum::<f64>() - 6.0;
        gear(a) + wheel_line * (TAU * a * 19.0 / 48.0).cos() + noise * gaussian
    };
    let mut tsa = Box::new(SynchronousAverage::<N>::new());
    drive::<16384>(angle, time, signal, 10_000.0, turns, jitter_s, |tracker, turn, _| {
        if tsa.turns() < turns as u32 {
            tsa.add_turn(|first, out| tracker.resample(turn, first, N as u32, out));
        }
    });
    let mut out = [0.0f32; N];
    tsa.average(&mut out).unwrap();
    out.to_vec()
}

fn rms_error(average: &[f32]) -> f64 {
    let sum: f64 = average.iter().enumerate().map(|(n, &x)| (f64::from(x) - gear(n as f64 / N as f64)).powi(2)).sum();
    (sum / N as f64).sqrt()
}

#[test]
fn theory_average_over_the_hunting_period_removes_the_wheel() {
    // 19 and 48 teeth: the wheel makes 19 whole turns in 48 of the pinion.
    assert_eq!(meshband::zoom::common_turns(19, 48), Some(48));
    let whole = rms_error(&average(48, 1.0, 0.0, 0.0));
    let half = rms_error(&average(23, 1.0, 0.0, 0.0));
    println!("wheel left after 48 turns {whole:e}, after 23 turns {half:e}");
    assert!(whole < 2e-3, "{whole}");
    assert!(half > 10.0 * whole, "a broken period leaves the wheel: {half}");
}

#[test]
fn theory_average_lowers_noise_by_the_root_of_the_turns() {
    let error = rms_error(&average(96, 0.0, 1.0, 0.0));
    // Interpolation filters the noise at half the sampling rate a little, never amplifies it.
    let exact = 1.0 / 96f64.sqrt();
    println!("noise after 96 turns: {error}, {exact} expected");
    assert!(error < 1.1 * exact && error > 0.7 * exact, "{error}");
}

#[test]
fn theory_mark_jitter_costs_little() {
    // 1 us at 10 Hz is 1e-5 turn: order 38 loses 3e-6 of its amplitude, the rest is noise.
    let error = rms_error(&average(48, 0.0, 0.0, 1e-6));
    assert!(error < 3e-3, "{error}");
}

#[test]
fn theory_split_signals_hold_exactly_their_lines() {
    let average: Vec<f32> = (0..N).map(|n| gear(n as f64 / N as f64) as f32).collect();
    let lines = RegularLines { teeth: 19, shaft_orders: 2, sidebands: 1 };
    let (mut work, mut out) = (vec![0.0f32; N], vec![0.0f32; N]);
    let worst = |out: &[f32], exact: &dyn Fn(f64) -> f64| {
        out.iter().enumerate().map(|(n, &x)| (f64::from(x) - exact(n as f64 / N as f64)).abs()).fold(0.0, f64::max)
    };
    residual(&average, &lines, &mut work, &mut out).unwrap();
    let exact = |a: f64| 0.5 * (TAU * 20.0 * a + 0.1).cos() + 0.2 * (TAU * 26.0 * a).sin();
    assert!(worst(&out, &exact) < 1e-5);
    difference(&average, &lines, &mut work, &mut out).unwrap();
    assert!(worst(&out, &|a| 0.2 * (TAU * 26.0 * a).sin()) < 1e-5);
    regular(&average, &lines, &mut work, &mut out).unwrap();
    assert!(worst(&out, &|a| gear(a) - exact(a)) < 1e-5);
    // By the spectrum alone: the regular signal's power about its mean, and the residual.
    let rms = Moments::of(&out).rms();
    work.copy_from_slice(&average);
    let bins = real_fft(&mut work).unwrap();
    let of_lines = regular_rms(bins, &lines);
    assert!((of_lines / rms - 1.0).abs() < 1e-5, "{of_lines} for {rms}");
    residual_of(bins, &lines, &mut out).unwrap();
    assert!(worst(&out, &exact) < 1e-5);
    assert!(residual(&average, &lines, &mut work[..100], &mut out).is_err());
}
