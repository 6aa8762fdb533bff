//! Overall values, velocity and shaft orders of the node against references in double precision, over the very turns
//! they name.

use meshband::config::{Configuration, SecondSensor};
use meshband::message::{Indicators, Message};
use meshband::node::{Block, Node};
use meshband::shaft_lines::ShaftOrders;
use meshband::units::{Acceleration, Hertz, TicksPerSecond};
use std::f64::consts::TAU;

const BLOCK: usize = 512;
const CLOCK: f64 = 25.0e6;
const M_S2_PER_CODE: f64 = 0.002;
/// The second sensor hears the same, the other way round, another scale and another zero; from this time on, s.
const PER_CODE_OF_SECOND: f64 = -0.003;
const ZERO_OF_SECOND: f64 = 31_000.0;
const SECOND_JOINS: f64 = 0.5;
/// Step of the reference, s.
const STEP: f64 = 4.0e-6;
const PINION: f64 = 19.0;
const GEAR: f64 = 48.0;

/// Turns of the pinion over time: steady, or 5 % per second from the start.
#[derive(Clone, Copy)]
pub struct Run {
    pub speed: f64,
    pub growth: f64,
}

impl Run {
    pub fn turns(&self, t: f64) -> f64 {
        if self.growth == 0.0 { self.speed * t } else { self.speed * (self.growth * t).exp_m1() / self.growth }
    }

    fn time_of(&self, turns: f64) -> f64 {
        if self.growth == 0.0 { turns / self.speed } else { (self.growth * turns / self.speed).ln_1p() / self.growth }
    }
}

/// Amplitude, order of the pinion, lag in degrees.
const LINES: [(f64, f64, f64); 6] = [
    (2.0, 1.0, 40.0),
    (1.0, 2.0, -110.0),
    (0.5, 3.0, 15.0),
    (0.8, PINION / GEAR, 75.0),
    (3.0, PINION, 0.0),
    (1.0, PINION + 1.0, 0.0),
];
/// Amplitude and frequency, Hz, of what does not follow the speed.
const TONES: [(f64, f64); 3] = [(4.0, 123.0), (6.0, 411.7), (5.0, 2_345.0)];

fn signal(t: f64, turns: f64) -> f64 {
    let orders = LINES.iter().map(|(a, order, lag)| a * (TAU * (order * turns).fract() - lag.to_radians()).cos());
    let tones = TONES.iter().map(|(a, hz)| a * (TAU * (hz * t).fract()).sin());
    // Once per turn, a millisecond long.
    let since = turns.fract();
    let impulse = if since < 0.02 { 25.0 * (TAU * since / 0.04).sin() } else { 0.0 };
    orders.sum::<f64>() + tones.sum::<f64>() + impulse
}

pub fn configuration() -> Configuration {
    let mut config = Configuration::default();
    (config.gears.pinion_teeth, config.gears.gear_teeth) = (PINION as u16, GEAR as u16);
    config.sensor.acceleration_per_code = Acceleration(M_S2_PER_CODE as f32);
    config
}

/// What a node says of a signal.
pub fn listen(
    config: Configuration,
    run: Run,
    seconds: f64,
    with_tach: bool,
    signal: impl Fn(f64, f64) -> f64,
) -> Vec<Indicators> {
    let mut node = Box::new(Node::new(config, TicksPerSecond(CLOCK as u32)).expect("a sound configuration"));
    let mut heard = Vec::new();
    let (mut first, mut turn, mut sequence) = (0u64, 0.0, 0);
    let (mut codes, mut second) = ([0u16; BLOCK], [0u16; BLOCK]);
    while (first as f64) < seconds * CLOCK {
        let period = node.requested_period_ticks();
        for (n, (code, of_second)) in codes.iter_mut().zip(&mut second).enumerate() {
            let t = (first + n as u64 * u64::from(period)) as f64 / CLOCK;
            let value = signal(t, run.turns(t));
            *code = ((value / M_S2_PER_CODE).round() + 32_768.0).clamp(0.0, 65_535.0) as u16;
            *of_second = ((value / PER_CODE_OF_SECOND).round() + ZERO_OF_SECOND).clamp(0.0, 65_535.0) as u16;
        }
        // A sensor that joins late lacks what came before.
        let heard_of_second = first as f64 >= SECOND_JOINS * CLOCK;
        let end = first + BLOCK as u64 * u64::from(period);
        while with_tach && run.time_of(turn) * CLOCK < end as f64 {
            node.on_tach_edge((run.time_of(turn) * CLOCK).round() as u32);
            turn += 1.0;
        }
        node.on_block(Block {
            codes: &codes,
            second: if heard_of_second { &second } else { &[] },
            first_tick: first as u32,
            period_ticks: period,
            sequence,
            overrun: false,
        });
        (first, sequence) = (end, sequence + 1);
        while let Some(message) = node.poll(end as u32) {
            if let Message::Indicators(indicators) = message {
                heard.push(indicators);
            }
        }
    }
    heard
}

/// A biquad in direct form, coefficients by the bilinear transform.
struct Biquad {
    b: [f64; 3],
    a: [f64; 2],
    x: [f64; 2],
    y: [f64; 2],
}

impl Biquad {
    fn new(hz: f64, q: f64, high: bool) -> Self {
        let w = TAU * hz * STEP;
        let (alpha, c) = (w.sin() / (2.0 * q), w.cos());
        let a0 = 1.0 + alpha;
        let b = if high {
            [(1.0 + c) / 2.0, -(1.0 + c), (1.0 + c) / 2.0]
        } else {
            [(1.0 - c) / 2.0, 1.0 - c, (1.0 - c) / 2.0]
        };
        Self { b: b.map(|b| b / a0), a: [-2.0 * c / a0, (1.0 - alpha) / a0], x: [0.0; 2], y: [0.0; 2] }
    }

    fn pass(&mut self, x: f64) -> f64 {
        let y = self.b[0] * x + self.b[1] * self.x[0] + self.b[2] * self.x[1]
            - self.a[0] * self.y[0]
            - self.a[1] * self.y[1];
        (self.x, self.y) = ([x, self.x[0]], [y, self.y[0]]);
        y
    }
}

/// Acceleration and velocity of the whole run in double precision.
struct Reference {
    acceleration: Vec<f64>,
    velocity: Vec<f64>,
}

impl Reference {
    fn new(run: Run, seconds: f64, signal: impl Fn(f64, f64) -> f64) -> Self {
        let sections = [(10.0, 0.541_196_1, true), (10.0, 1.306_563, true)];
        let sections = sections.into_iter().chain([(1e3, 0.541_196_1, false), (1e3, 1.306_563, false)]);
        let mut filters: Vec<Biquad> = sections.map(|(hz, q, high)| Biquad::new(hz, q, high)).collect();
        let (mut sum, mut before) = (0.0, 0.0);
        let (mut acceleration, mut velocity) = (Vec::new(), Vec::new());
        for n in 0..(seconds / STEP) as usize {
            let t = n as f64 * STEP;
            let a = signal(t, run.turns(t));
            acceleration.push(a);
            let filtered = filters.iter_mut().fold(a, |x, filter| filter.pass(x));
            sum += 0.5 * STEP * (filtered + before);
            before = filtered;
            velocity.push(sum);
        }
        Self { acceleration, velocity }
    }

    /// RMS, peak, kurtosis about the mean and RMS velocity from `from` to `to`, s.
    fn values(&self, from: f64, to: f64) -> [f64; 4] {
        let range = (from / STEP).round() as usize..(to / STEP).round() as usize;
        let a = &self.acceleration[range.clone()];
        let count = a.len() as f64;
        let mean = a.iter().sum::<f64>() / count;
        let moment = |power: i32| a.iter().map(|x| (x - mean).powi(power)).sum::<f64>() / count;
        let (m2, m4) = (moment(2), moment(4));
        let peak = a.iter().map(|x| (x - mean).abs()).fold(0.0, f64::max);
        let velocity = &self.velocity[range];
        let velocity = (velocity.iter().map(|v| v * v).sum::<f64>() / count).sqrt();
        [m2.sqrt(), peak, m4 / (m2 * m2), velocity]
    }
}

/// Begin of a record, s; the node counts its ticks beyond 32 bits from another origin.
fn since_start(indicators: &Indicators) -> f64 {
    f64::from(indicators.tag.first_tick as u32) / CLOCK
}

fn assert_close(what: &str, found: f32, wanted: f64, relative: f64) {
    let error = f64::from(found) / wanted - 1.0;
    assert!(error.abs() <= relative, "{what}: {found} for {wanted}, {:.3} %", 100.0 * error);
}

/// Every value of the signal with an impulse once per turn, which is in every record.
fn assert_values(config: Configuration, run: Run, seconds: f64) {
    let least = assert_values_of(config, run, seconds, SMOOTH_TOLERANCE, signal);
    assert!(least > 20.0, "impulse of {least} m/s2 at {} Hz", run.speed);
}

/// What else than its own thousandth a value may be off by.
#[derive(Clone, Copy)]
pub struct Tolerance {
    /// Of peak and crest: a sharp peak between two samples is another one to the reference.
    pub peaks: f64,
    /// Of the velocity, as a share of what the whole acceleration would be at the band's upper edge: what the band's
    /// skirts leave.
    pub skirts: f64,
}

const SMOOTH_TOLERANCE: Tolerance = Tolerance { peaks: 2e-3, skirts: 0.0 };

/// RMS, peak, crest, kurtosis and velocity of every good record against the reference; the least peak of all.
pub fn assert_values_of(
    config: Configuration,
    run: Run,
    seconds: f64,
    tolerance: Tolerance,
    signal: impl Fn(f64, f64) -> f64 + Copy,
) -> f32 {
    let has_second = config.second.is_some();
    let heard = listen(config, run, seconds, true, signal);
    let mut least = f32::INFINITY;
    let (first_record, later) = heard.split_first().expect("records");
    let joined_within = since_start(first_record) < SECOND_JOINS;
    assert!(first_record.second.is_none_or(|second| second.quality.gap == joined_within), "joined at {SECOND_JOINS} s");
    assert!(later.iter().all(|record| record.second.is_some() == has_second));
    let reference = Reference::new(run, seconds + 1.0, signal);
    let (mut judged, mut of_second) = (0, 0);
    for indicators in heard.iter().filter(|i| i.quality.is_good() && i.quality.turns > 0) {
        let quality = indicators.quality;
        let from = since_start(indicators);
        let to = from + f64::from(quality.duration_s);
        let turns = run.turns(to) - run.turns(from);
        assert!(
            quality.duration_s >= 0.9999 && (turns - f64::from(quality.turns)).abs() < 2e-3,
            "{quality:?}, {turns}"
        );
        let what = |name: &str| format!("{name} at {:.2} Hz, {from:.3} s", run.speed);
        let [rms, peak, kurtosis, velocity] = reference.values(from, to);
        assert_close(&what("RMS"), indicators.rms, rms, 1e-3);
        assert_close(&what("peak"), indicators.peak, peak, tolerance.peaks);
        assert_close(&what("crest"), indicators.crest, peak / rms, tolerance.peaks);
        assert_close(&what("kurtosis"), indicators.kurtosis, kurtosis, 1e-2);
        let of_velocity = 1e-3 + tolerance.skirts * rms / (TAU * 1e3) / velocity;
        assert_close(&what("velocity"), indicators.velocity_rms, velocity, of_velocity);
        least = least.min(indicators.peak);
        if let Some(second) = indicators.second.filter(|second| second.quality.is_good()) {
            assert_eq!(second.quality.turns, quality.turns);
            assert_close(&what("second RMS"), second.rms, rms, 1e-3);
            assert_close(&what("second peak"), second.peak, peak, tolerance.peaks);
            assert_close(&what("second crest"), second.crest, peak / rms, tolerance.peaks);
            assert_close(&what("second kurtosis"), second.kurtosis, kurtosis, 1e-2);
            assert_close(&what("second velocity"), second.velocity_rms, velocity, of_velocity);
            assert_eq!(second.passed_hz, 8_000.0);
            of_second += 1;
        }
        judged += 1;
    }
    assert!(
        f64::from(judged) >= ((seconds - 1.5 - 4.0 / run.speed) / (1.0 + 1.0 / run.speed)).floor(),
        "{judged} records at {}",
        run.speed
    );
    assert!(of_second + 1 >= if has_second { judged } else { 0 }, "{of_second} of {judged}");
    least
}

fn with_second() -> Configuration {
    let second = SecondSensor {
        acceleration_per_code: Acceleration(PER_CODE_OF_SECOND as f32),
        zero_code: ZERO_OF_SECOND as u16,
        band: Hertz(8_000.0),
    };
    Configuration { second: Some(second), ..configuration() }
}

#[test]
fn ref_overall_values_are_those_of_whole_turns_at_every_speed() {
    for speed in [1.0, 5.0, 25.0, 60.0] {
        assert_values(configuration(), Run { speed, growth: 0.0 }, 8.0);
    }
}

#[test]
fn ref_the_second_sensors_values_are_of_the_same_turns_and_in_its_own_scale() {
    for (speed, growth) in [(1.0, 0.0), (25.0, 0.0), (60.0, 0.0), (5.0, 0.05), (36.4, 0.05)] {
        assert_values(with_second(), Run { speed, growth }, 8.0);
    }
}

#[test]
fn ref_overall_values_hold_in_a_run_up_of_5_percent_per_second() {
    // The last one ends at 60 turns a second.
    for speed in [1.0, 5.0, 25.0, 36.4] {
        assert_values(configuration(), Run { speed, growth: 0.05 }, 10.0);
    }
}

fn assert_orders(found: &ShaftOrders, wanted: &[(f64, f64)], what: &str) {
    for (order, (line, &(amplitude, lag))) in (1..).zip(found.lines.iter().zip(wanted)) {
        let what = format!("{what} {order}x {line:?}");
        assert!((f64::from(line.amplitude) / amplitude - 1.0).abs() < 5e-3, "{what} for {amplitude}");
        let off = (f64::from(line.phase_deg) - lag + 180.0).rem_euclid(360.0) - 180.0;
        assert!(off.abs() < 0.5, "{what} for {lag} degrees");
    }
}

/// Orders alone: what is no multiple of the shaft's leaks into any average over a second.
fn orders_only(_: f64, turns: f64) -> f64 {
    LINES.iter().map(|(a, order, lag)| a * (TAU * (order * turns).fract() - lag.to_radians()).cos()).sum()
}

/// As many turns of the pinion as make whole turns of the gear: then neither shaft's lines leak into the other's.
fn shaft_orders(growth: f64) {
    for speed in [1.0, 5.0, 25.0, 60.0] {
        let pinion = |_: f64, turns: f64| {
            let own = LINES.iter().filter(|(_, order, _)| order.fract() == 0.0);
            own.map(|(a, order, lag)| a * (TAU * (order * turns).fract() - lag.to_radians()).cos()).sum()
        };
        let heard = listen(configuration(), Run { speed, growth }, 8.0 + 4.0 / speed, true, pinion);
        let found: Vec<_> = heard.iter().filter_map(|i| i.pinion).collect();
        assert!(found.len() >= 3, "{} at {speed} Hz", found.len());
        for orders in &found {
            assert!(f64::from(orders.turns) >= speed.floor().max(1.0) * 0.99);
            assert_orders(orders, &[(2.0, 40.0), (1.0, -110.0), (0.5, 15.0)], &format!("pinion at {speed} Hz"));
        }
        let gear = |_: f64, turns: f64| 0.8 * (TAU * (turns * PINION / GEAR).fract() - 75f64.to_radians()).cos();
        let heard = listen(configuration(), Run { speed, growth }, 8.0 + 6.0 / speed, true, gear);
        let found: Vec<_> = heard.iter().filter_map(|i| i.wheel).collect();
        assert!(found.len() >= 2, "{} of the gear at {speed} Hz", found.len());
        let first = found[0].lines[0].phase_deg;
        for orders in &found {
            assert!((f64::from(orders.lines[0].amplitude) / 0.8 - 1.0).abs() < 5e-3, "{orders:?}");
            // The angle counts from the lock, so one phase holds for all records.
            assert!((orders.lines[0].phase_deg - first).abs() < 0.5, "{found:?}");
        }
    }
}

#[test]
fn ref_shaft_orders_have_their_amplitude_and_phase_at_every_speed() {
    shaft_orders(0.0);
}

#[test]
fn ref_shaft_orders_hold_in_a_run_up_of_5_percent_per_second() {
    shaft_orders(0.05);
}

#[test]
fn theory_lines_of_both_shafts_at_once_are_told_apart_over_whole_turns_of_both() {
    let heard = listen(configuration(), Run { speed: 60.0, growth: 0.0 }, 6.0, true, orders_only);
    let pinion: Vec<_> = heard.iter().filter_map(|i| i.pinion).collect();
    assert!(pinion.len() >= 3);
    for orders in &pinion {
        // 60 turns of the pinion are no whole turns of the gear: what leaks is bounded by the window's side lobe.
        assert!((orders.lines[0].amplitude - 2.0).abs() < 0.8 / (60.0 * 0.3), "{orders:?}");
    }
}

#[test]
fn theory_values_go_on_by_the_clock_without_a_tach() {
    let heard = listen(configuration(), Run { speed: 20.0, growth: 0.0 }, 5.0, false, signal);
    assert!(heard.len() >= 4, "{}", heard.len());
    let good: Vec<_> = heard.iter().filter(|i| i.quality.is_good()).collect();
    assert!(good.len() >= 3);
    for indicators in good {
        assert_eq!(indicators.quality.turns, 0);
        assert!((1.0..1.1).contains(&indicators.quality.duration_s));
        assert_close("RMS", indicators.rms, 7.0, 0.1);
        assert!(indicators.pinion.is_none());
    }
}

#[test]
fn fault_a_clipped_record_says_so() {
    let loud = |t: f64, turns: f64| signal(t, turns) + if (3.0..3.01).contains(&t) { 200.0 } else { 0.0 };
    let heard = listen(configuration(), Run { speed: 20.0, growth: 0.0 }, 6.0, true, loud);
    let clipped: Vec<_> = heard.iter().filter(|i| i.quality.overload).collect();
    assert_eq!(clipped.len(), 1);
    let from = since_start(clipped[0]);
    assert!(from <= 3.0 && 3.0 < from + f64::from(clipped[0].quality.duration_s));
    assert!(heard.iter().filter(|i| i.quality.is_good()).all(|i| i.peak < 60.0));
}

#[test]
fn theory_a_shaft_speed_from_half_a_turn_to_sixty_is_served() {
    let mut config = configuration();
    config.law.highest = Hertz(60.0);
    for speed in [0.5, 60.0] {
        let heard = listen(config.clone(), Run { speed, growth: 0.0 }, 14.0, true, signal);
        let last = heard.last().expect("values");
        assert!(f64::from(last.quality.turns) >= (speed as u16).max(1).into());
        assert!(last.quality.is_good() && last.pinion.is_some() || speed < 1.0, "{last:?}");
    }
}
