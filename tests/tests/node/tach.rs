//! Tach tracker: seeded pulse trains of known motion, limits on the worst and the mean error.

use meshband::config::TachWheel;
use meshband::tach::{Speed, TachTracker, Validity};
use meshband::units::{Hertz, TicksPerSecond};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use std::f64::consts::TAU;

/// Seeds of the damaged trains; 200 of them were run once, with the same limits.
const SEEDS: u64 = 6;

/// One simulated pulse train.
#[derive(Clone)]
struct Train {
    wheel: TachWheel,
    clock: u32,
    jitter_s: f64,
    missed: f64,
    spurious: f64,
    seed: u64,
}

/// A speed reported at a pulse, and the truth.
struct Sample {
    turn: f64,
    speed: Speed,
    truth: f64,
}

fn wheel(pulses_per_turn: u16, missing: u16) -> TachWheel {
    TachWheel { pulses_per_turn, missing, pinion_per_tach: 1.0, highest: Hertz(100.0), lowest: Hertz(0.25) }
}

impl Train {
    fn steady(pulses: u16, missing: u16, clock: u32) -> Self {
        Self { wheel: wheel(pulses, missing), clock, jitter_s: 1.0e-6, missed: 0.0, spurious: 0.0, seed: 1 }
    }

    /// Feeds positions 0..turns of a motion; `instant` gives the time of a shaft angle in turns, NaN for no pulse.
    fn run(
        &self,
        tracker: &mut TachTracker,
        turns: f64,
        instant: impl Fn(f64) -> f64,
        rate: impl Fn(f64) -> f64,
    ) -> Vec<Sample> {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let jitter = Normal::new(0.0, self.jitter_s).expect("jitter");
        let positions = u32::from(self.wheel.pulses_per_turn);
        let mut times: Vec<(f64, f64)> = Vec::new();
        for k in 0..(turns * f64::from(positions)) as u32 {
            let angle = f64::from(k) / f64::from(positions);
            let t = instant(angle);
            if k % positions >= positions - u32::from(self.wheel.missing) || t.is_nan() {
                continue;
            }
            if !random.random_bool(self.missed) {
                times.push((t + jitter.sample(&mut random), angle));
            }
            if random.random_bool(self.spurious) {
                let part: f64 = random.random();
                let next = instant(angle + 1.0 / f64::from(positions));
                if !next.is_nan() {
                    times.push((t + part * (next - t), angle + part / f64::from(positions)));
                }
            }
        }
        times.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut samples = Vec::new();
        for (t, angle) in times {
            let tick = (1u64 << 33) + (t * f64::from(self.clock)).round() as u64;
            tracker.on_pulse(tick);
            samples.push(Sample { turn: angle, speed: tracker.speed(tick), truth: rate(t) });
        }
        samples
    }

    fn tracker(&self) -> TachTracker {
        TachTracker::new(self.wheel, TicksPerSecond(self.clock))
    }
}

fn error(sample: &Sample) -> f64 {
    (f64::from(sample.speed.pinion.0) / sample.truth - 1.0).abs()
}

/// Worst error of the locked samples after a number of turns, and the share of samples that were not locked.
fn worst_locked(samples: &[Sample], from_turn: f64) -> (f64, f64) {
    let after: Vec<&Sample> = samples.iter().filter(|s| s.turn >= from_turn).collect();
    let locked: Vec<&&Sample> = after.iter().filter(|s| s.speed.validity == Validity::Locked).collect();
    let worst = locked.iter().map(|s| error(s)).fold(0.0, f64::max);
    (worst, 1.0 - locked.len() as f64 / after.len().max(1) as f64)
}

#[test]
fn theory_steady_speed_within_a_hundredth_of_a_percent_at_1_us_jitter() {
    for clock in [84_000_000, 25_000_000] {
        for (pulses, missing) in [(1, 0), (4, 0), (60, 2), (36, 1)] {
            for hz in [1.0, 2.5, 8.0, 16.665, 25.0, 60.0] {
                let train = Train::steady(pulses, missing, clock);
                let samples = train.run(&mut train.tracker(), 300.0, |turn| turn / hz, |_| hz);
                let (worst, unlocked) = worst_locked(&samples, 20.0);
                let mean = samples.iter().filter(|s| s.turn > 20.0).map(error).sum::<f64>() / samples.len() as f64;
                println!(
                    "{clock} {pulses}-{missing} {hz} Hz: worst {worst:.1e} mean {mean:.1e} unlocked {unlocked:.1e}"
                );
                assert!(worst < 1.0e-4, "{pulses}-{missing} at {hz} Hz: {worst}");
                assert!(unlocked < 0.01, "{pulses}-{missing} at {hz} Hz: {unlocked} not locked");
            }
        }
    }
}

#[test]
fn fault_missed_and_spurious_pulses_never_give_a_wrong_speed_unflagged() {
    for (pulses, missing, turns) in [(1, 0, 20_000.0), (4, 0, 4_000.0), (60, 2, 600.0), (36, 1, 600.0)] {
        for seed in 0..SEEDS {
            let train = Train { missed: 0.05, spurious: 0.02, seed, ..Train::steady(pulses, missing, 84_000_000) };
            let hz = 14.5;
            let samples = train.run(&mut train.tracker(), turns, |turn| turn / hz, |_| hz);
            let (worst, unlocked) = worst_locked(&samples, 0.0);
            println!("{pulses}-{missing} seed {seed}: worst {worst:.1e}, not locked {unlocked:.3}");
            assert!(worst < 0.01, "{pulses}-{missing} seed {seed}: {worst}");
            assert!(unlocked < 0.15, "{pulses}-{missing} seed {seed}: {unlocked} of the samples not locked");
        }
    }
}

/// Turns after the first pulse behind `event_turn` until the speed is locked and within 1 %.
fn turns_to_lock(samples: &[Sample], event_turn: f64) -> f64 {
    let first = samples.iter().find(|s| s.turn >= event_turn).expect("a pulse after the event").turn;
    let good = |s: &&Sample| s.turn >= first && s.speed.validity == Validity::Locked && error(s) < 0.01;
    samples.iter().find(good).expect("locked again").turn - first
}

#[test]
fn fault_locks_again_within_three_turns() {
    for (pulses, missing) in [(1, 0), (4, 0), (60, 2), (36, 1)] {
        let train = Train::steady(pulses, missing, 84_000_000);
        let hz = 10.0;
        // Drop-out of 6.3 turns, the shaft keeps turning.
        let dropout = |turn: f64| if (40.0..46.3).contains(&turn) { f64::NAN } else { turn / hz };
        let samples = train.run(&mut train.tracker(), 80.0, dropout, |_| hz);
        let turns = turns_to_lock(&samples, 46.3);
        println!("{pulses}-{missing}: drop-out {turns}");
        assert!(turns <= 3.0, "{pulses}-{missing}: drop-out {turns} turns");
        // Stop for 20 s and restart at another speed.
        let restart = |turn: f64| if turn < 40.0 { turn / hz } else { 24.0 + (turn - 40.0) / 3.7 };
        let rate = |t: f64| if t < 4.0 { hz } else { 3.7 };
        let turns = turns_to_lock(&train.run(&mut train.tracker(), 80.0, restart, rate), 40.0);
        println!("{pulses}-{missing}: restart {turns}");
        assert!(turns <= 3.0, "{pulses}-{missing}: restart {turns} turns");
        for factor in [4.0, 0.25, 2.0, 0.5, 3.0] {
            let step = |turn: f64| if turn < 40.0 { turn / hz } else { 4.0 + (turn - 40.0) / (hz * factor) };
            let rate = |t: f64| if t <= 4.0 + 1.0e-4 { hz } else { hz * factor };
            let samples = train.run(&mut train.tracker(), 80.0, step, rate);
            // The pulse at turn 40 is the last of the old speed.
            let turns = turns_to_lock(&samples, 40.0 + 1.0e-9) + 1.0 / f64::from(pulses);
            let unflagged = samples.iter().filter(|s| s.speed.validity == Validity::Locked && error(s) > 0.01).count();
            println!("{pulses}-{missing}: step {factor} {turns}, wrong unflagged pulses {unflagged}");
            let limit = if factor == 4.0 || factor == 0.25 { 3.0 } else { 12.0 };
            assert!(turns <= limit, "{pulses}-{missing}: step {factor}: {turns} turns");
        }
    }
}

#[test]
fn theory_run_up_from_1_to_25_hz_in_5_s_within_two_thousandths() {
    let acceleration = 24.0 / 5.0;
    // 10 turns at 1 Hz, then constant acceleration.
    let instant = |turn: f64| {
        if turn < 10.0 {
            turn
        } else {
            10.0 + (-1.0 + f64::sqrt(1.0 + 2.0 * acceleration * (turn - 10.0))) / acceleration
        }
    };
    let rate = |t: f64| if t < 10.0 { 1.0 } else { 1.0 + acceleration * (t - 10.0) };
    for (pulses, missing) in [(1, 0), (4, 0), (60, 2), (36, 1)] {
        let train = Train::steady(pulses, missing, 84_000_000);
        let samples = train.run(&mut train.tracker(), 75.0, instant, rate);
        let (worst, unlocked) = worst_locked(&samples, 14.0);
        let (worst_all, _) = worst_locked(&samples, 2.0);
        println!("{pulses}-{missing}: worst {worst:.1e}, with the corner {worst_all:.1e}, not locked {unlocked:.3}");
        assert!(worst < 2.0e-3, "{pulses}-{missing}: {worst}");
        assert!(unlocked < 0.05, "{pulses}-{missing}: {unlocked}");
    }
}

/// Time of an angle in turns, by bisection of a motion that ascends until `end`.
fn inverse(angle: impl Fn(f64) -> f64, turn: f64, end: f64) -> f64 {
    let (mut low, mut high) = (0.0, end);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if angle(middle) < turn { low = middle } else { high = middle }
    }
    high
}

#[test]
fn theory_a_wandering_speed_is_followed_without_losing_the_lock() {
    for (pulses, missing) in [(1, 0), (4, 0), (60, 2), (36, 1)] {
        for (hz, depth, wander_hz) in [(20.0, 0.02, 0.7), (20.0, 0.02, 2.0), (5.0, 0.02, 0.3), (25.0, 0.05, 0.5)] {
            let omega = TAU * wander_hz;
            let angle = |t: f64| hz * t + hz * depth / omega * (1.0 - (omega * t).cos());
            let rate = |t: f64| hz * (1.0 + depth * (omega * t).sin());
            let train = Train::steady(pulses, missing, 84_000_000);
            let mut tracker = train.tracker();
            let samples = train.run(&mut tracker, 30.0 * hz, |turn| inverse(angle, turn, 35.0), rate);
            let (worst, unlocked) = worst_locked(&samples, 6.0);
            println!(
                "{pulses}-{missing} {hz} Hz +-{depth} at {wander_hz} Hz: worst {worst:.1e}, unlocked {unlocked:.4}"
            );
            assert!(unlocked < 0.005 && tracker.counters().relocks == 1, "{pulses}-{missing} at {hz} Hz: {unlocked}");
            // Against the instantaneous speed, which changes by this much from one pulse to the next.
            let per_pulse = omega * depth / (hz * f64::from(pulses));
            assert!(worst < 4.0e-3 + 1.5 * per_pulse, "{pulses}-{missing} at {hz} Hz: {worst}, {per_pulse} per pulse");
        }
    }
}

#[test]
fn theory_any_steady_run_up_or_down_is_tracked_also_between_the_pulses() {
    for (pulses, missing) in [(1, 0), (4, 0), (60, 2), (36, 1)] {
        for (from, acceleration) in [(3.0, 3.9), (1.0, 4.8), (1.0, 0.05), (5.0, 0.25), (25.0, -2.0), (25.0, -4.0)] {
            // Ten turns of steady speed first.
            let steady = 10.0 / from;
            let angle = |t: f64| from * t + 0.5 * acceleration * (t - steady).max(0.0).powi(2);
            let rate = |t: f64| from + acceleration * (t - steady).max(0.0);
            let train = Train::steady(pulses, missing, 84_000_000);
            let mut tracker = train.tracker();
            let end = steady + f64::max(5.0, 15.0 / from);
            let samples = train.run(&mut tracker, angle(end), |turn| inverse(angle, turn, end + 0.5), rate);
            let (worst, _) = worst_locked(&samples, 14.0);
            // The corner costs a new lock at most; with one pulse per turn that takes some turns.
            let (_, unlocked) = worst_locked(&samples, 18.0);
            println!(
                "{pulses}-{missing} from {from} Hz by {acceleration} Hz/s: worst {worst:.1e}, unlocked {unlocked:.3}"
            );
            assert!(worst < 0.01 && unlocked < 0.01, "{pulses}-{missing} from {from} Hz: {worst}, {unlocked}");
            // Until shortly before the next pulse the speed is still believed.
            let (instant, _) = tracker.latest_pulse();
            let pulse_hz = f64::from(tracker.speed(instant).pinion.0) * f64::from(pulses);
            let later = tracker.speed(instant + (0.95 / pulse_hz * 84.0e6) as u64);
            assert_eq!(later.validity, Validity::Locked, "{pulses}-{missing} from {from} Hz");
        }
    }
}

#[test]
fn theory_counter_wrap_leaves_no_trace() {
    use meshband::time::TickExtender;
    let mut extender = TickExtender::new(u32::MAX - 50_000_000);
    let mut tracker = TachTracker::new(wheel(1, 0), TicksPerSecond(84_000_000));
    let mut tick = u32::MAX - 40_000_000;
    let mut before = None;
    for _ in 0..2_000 {
        let instant = extender.extend(tick);
        assert!(before.is_none_or(|before| instant == before + 8_400_000));
        before = Some(instant);
        tracker.on_pulse(instant);
        tick = tick.wrapping_add(8_400_000);
    }
    let speed = tracker.speed(before.expect("pulses"));
    assert_eq!((speed.pinion.0, speed.validity), (10.0, Validity::Locked));
    assert_eq!(tracker.counters().missed + tracker.counters().spurious, 0);
}

#[test]
fn theory_angle_counts_from_the_first_tooth_after_the_gap() {
    let train = Train::steady(60, 2, 84_000_000);
    let mut tracker = train.tracker();
    let hz = 7.0;
    train.run(&mut tracker, 20.0, |turn| (turn + 0.35) / hz, |_| hz);
    assert!(tracker.is_indexed());
    let at = 19.73;
    let angle = tracker.tach_angle((1 << 33) + ((at + 0.35) / hz * 84.0e6) as u64).turns();
    assert!((angle - 0.73).abs() < 1.0e-4, "{angle}");
}
