//! The node as a device: its clock against pulses per second, the time of day, the bias of its sensors, what is worth
//! an event.

use meshband::config::{Configuration, SecondSensor};
use meshband::health::{BoardHealth, HealthChange, HealthWatch};
use meshband::message::{Reply, Request};
use meshband::node::second_pulse::{LONGEST_GAP_S, PulseClock, SecondPulse};
use meshband::node::wall_time::{CORRECTED_PPM, CRYSTAL_PPM, RECEPTION_US, ToldTime, WallClock};
use meshband::node::{Block, Node};
use meshband::units::TicksPerSecond;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const CLOCK: TicksPerSecond = TicksPerSecond(84_000_000);
const HZ: f64 = 84e6;
const START: u64 = 1 << 40;

/// Tick of a true second on a clock that runs fast.
fn tick(second: f64, fast_ppm: f64) -> u64 {
    START + (second * HZ * (1.0 + fast_ppm * 1e-6)).round() as u64
}

fn followed(seconds: u64, fast_ppm: f64, jitter_ticks: f64) -> SecondPulse {
    let (mut clock, mut random) = (PulseClock::NONE, ChaCha8Rng::seed_from_u64(5));
    for second in 0..=seconds {
        let jitter = jitter_ticks * (random.random::<f64>() - 0.5);
        clock.on_pulse((tick(second as f64, fast_ppm) as f64 + jitter).round() as u64, CLOCK);
    }
    clock.report(tick(seconds as f64 + 0.5, fast_ppm), CLOCK).expect("pulses")
}

#[test]
fn theory_the_clocks_error_is_found_within_its_uncertainty() {
    for fast_ppm in [-12_000.0, -30.0, 0.0, 0.4, 25.0, 9_000.0] {
        for (seconds, jitter) in [(2, 0.0), (10, 0.0), (100, 84.0), (400, 840.0)] {
            let found = followed(seconds, fast_ppm, jitter);
            let off = (f64::from(found.fast_ppm) - fast_ppm).abs();
            let single = 1e-6 * fast_ppm.abs();
            assert!(off <= 4.0 * f64::from(found.uncertainty_ppm) + single, "{fast_ppm} ppm, {seconds} s: {found:?}");
            assert_eq!((found.pulses, found.refused), (seconds as u32 + 1, 0));
            assert!((64..=128).contains(&found.baseline_s) || u64::from(found.baseline_s) == seconds, "{found:?}");
            assert!((found.age_s - 0.5).abs() < 0.02);
        }
    }
    let (short, long) = (followed(10, 3.0, 84.0), followed(120, 3.0, 84.0));
    assert!(short.uncertainty_ppm > 5.0 * long.uncertainty_ppm, "{short:?} {long:?}");
}

#[test]
fn fault_what_is_no_whole_second_is_refused_and_missing_pulses_are_bridged() {
    let mut clock = PulseClock::NONE;
    for second in (0..60).filter(|second| !(20..25).contains(second)) {
        clock.on_pulse(tick(f64::from(second), 7.0), CLOCK);
        if second == 40 {
            clock.on_pulse(tick(40.3, 7.0), CLOCK);
        }
    }
    let found = clock.report(tick(59.0, 7.0), CLOCK).expect("pulses");
    assert_eq!((found.refused, found.pulses, found.baseline_s), (1, 55, 59));
    assert!((found.fast_ppm - 7.0).abs() < 0.01, "{found:?}");
    // Another source at another instant of the second is taken up after three of its pulses.
    for second in 60..70 {
        clock.on_pulse(tick(f64::from(second) + 0.37, 7.0), CLOCK);
    }
    let found = clock.report(tick(69.4, 7.0), CLOCK).expect("pulses");
    assert_eq!((found.refused, found.baseline_s), (4, 7));
    assert!((found.fast_ppm - 7.0).abs() < 0.01, "{found:?}");
}

#[test]
fn fault_pulses_that_stop_are_no_longer_reported() {
    let mut clock = PulseClock::NONE;
    assert_eq!(clock.report(START, CLOCK), None, "none yet");
    clock.on_pulse(tick(0.0, 0.0), CLOCK);
    assert_eq!(clock.report(tick(0.5, 0.0), CLOCK), None, "one is no interval");
    clock.on_pulse(tick(1.0, 0.0), CLOCK);
    assert!(clock.report(tick(1.0 + LONGEST_GAP_S as f64 - 0.1, 0.0), CLOCK).is_some());
    assert_eq!(clock.report(tick(1.2 + LONGEST_GAP_S as f64, 0.0), CLOCK), None);
    clock.on_pulse(tick(100.0, 0.0), CLOCK);
    assert_eq!(clock.report(tick(100.1, 0.0), CLOCK), None, "begun anew");
}

#[test]
fn theory_the_time_of_day_is_carried_on_within_the_stated_uncertainty() {
    let told = ToldTime { unix_us: 1_700_000_000_000_000, uncertainty_us: 2_000 };
    for fast_ppm in [-45.0, 0.0, 45.0] {
        let mut wall = WallClock::UNKNOWN;
        assert_eq!(wall.at(START, CLOCK, None), None);
        wall.set(tick(0.0, fast_ppm), told);
        for seconds in [0.0, 60.0, 86_400.0] {
            let at = tick(seconds, fast_ppm);
            let free = wall.at(at, CLOCK, None).expect("told");
            let truth = 1.7e15 + seconds * 1e6;
            assert!((free.unix_us as f64 - truth).abs() <= free.uncertainty_us as f64, "{seconds}: {free:?}");
            assert!(free.drift_ppm == CRYSTAL_PPM && free.told_before_s.abs_diff(seconds as u32) <= 4, "{free:?}");
            let fixed = u64::from(told.uncertainty_us) + u64::from(RECEPTION_US);
            assert!(
                free.uncertainty_us.abs_diff(fixed + (seconds * f64::from(CRYSTAL_PPM)) as u64)
                    < 50 + (seconds as u64) / 100
            );
            // Pulses say how fast the clock is: the uncertainty is a fiftieth.
            let pulses = SecondPulse { fast_ppm: fast_ppm as f32, uncertainty_ppm: 0.01, ..SecondPulse::default() };
            let steered = wall.at(at, CLOCK, Some(&pulses)).expect("told");
            assert!((steered.unix_us as f64 - truth).abs() < 50.0 + seconds * 1e-2, "{seconds}: {steered:?}");
            assert!((steered.drift_ppm - CORRECTED_PPM - 0.02).abs() < 1e-6);
        }
    }
}

fn node_of(config: Configuration) -> Node {
    Node::new(config, CLOCK).expect("valid")
}

/// So many seconds of constant codes.
fn feed(node: &mut Node, seconds: f64, codes: [u16; 2]) {
    let (period, samples) = (8_400, 256);
    let second = if node.configuration().second.is_some() { vec![codes[1]; samples] } else { Vec::new() };
    for sequence in 0..(seconds * 10_000.0 / samples as f64) as u32 {
        let first_tick = sequence.wrapping_mul(period * samples as u32);
        let of_first: Vec<u16> = (0..samples).map(|n| codes[0] + 16 * (n % 2) as u16).collect();
        let block =
            Block { codes: &of_first, second: &second, first_tick, period_ticks: period, sequence, overrun: false };
        node.on_block(block);
        while node.poll(block.end_tick()).is_some() {}
    }
}

#[test]
fn claim_a_node_tells_supply_temperature_and_the_bias_of_both_sensors_in_volts() {
    let mut node = node_of(Configuration { second: Some(SecondSensor::default()), ..Configuration::default() });
    let before = node.health();
    assert_eq!((before.supply_v, before.temperature_c, before.bias_v, before.second_bias_v), (None, None, None, None));
    feed(&mut node, 3.0, [32_760, 20_000]);
    assert_eq!(node.health().bias_v, None, "codes are shares of a supply that nobody has measured");
    node.set_board_health(BoardHealth { supply_v: Some(3.2), temperature_c: Some(41.5), sensor_bias_v: None });
    let Reply::Health(health) = node.on_request(Request::GetHealth) else { panic!("another reply") };
    assert_eq!((health.supply_v, health.temperature_c, health.uptime_s), (Some(3.2), Some(41.5), 2));
    let near = |value: Option<f32>, wanted: f32| (value.expect("known") - wanted).abs() < 1e-3;
    assert!(
        near(health.bias_v, 3.2 * 32_768.0 / 65_536.0) && near(health.second_bias_v, 3.2 * 20_000.0 / 65_536.0),
        "{health:?}"
    );
}

#[test]
fn claim_a_host_tells_the_time_and_the_node_carries_it_on() {
    let mut node = node_of(Configuration::default());
    feed(&mut node, 1.0, [32_760, 0]);
    assert_eq!(node.health().wall_time, None);
    let told = ToldTime { unix_us: 1_800_000_000_000_000, uncertainty_us: 500 };
    let Reply::Health(now) = node.on_request(Request::SetWallTime(told)) else { panic!("another reply") };
    let at_once = now.wall_time.expect("told");
    assert_eq!((at_once.unix_us, at_once.told_before_s), (told.unix_us, 0));
    let later = now.tick + 5 * 84_000_000;
    node.on_second_pulse((later - 84_000_000) as u32);
    node.on_second_pulse(later as u32);
    let health = node.health();
    let wall = health.wall_time.expect("told");
    assert_eq!(wall.unix_us, told.unix_us + 5_000_000);
    assert_eq!(health.second_pulse.expect("two pulses").fast_ppm, 0.0);
}

#[test]
fn fault_times_without_sense_neither_panic_nor_wrap() {
    let mut node = node_of(Configuration::default());
    for unix_us in [0, u64::MAX] {
        node.on_request(Request::SetWallTime(ToldTime { unix_us, uncertainty_us: u32::MAX }));
        feed(&mut node, 0.5, [32_760, 0]);
        assert!(node.health().wall_time.expect("told").unix_us >= unix_us);
    }
}

#[test]
fn fault_supply_and_temperature_out_of_range_are_said_once_until_they_have_returned() {
    let mut watch = HealthWatch::default();
    let mut say = |supply_v: f32, temperature_c: f32| {
        watch.follow(BoardHealth { supply_v: Some(supply_v), temperature_c: Some(temperature_c), sensor_bias_v: None })
    };
    assert_eq!(say(3.3, 20.0), [None, None]);
    assert_eq!(say(3.19, 20.0), [Some(HealthChange::Supply(3.19)), None]);
    assert_eq!(say(3.18, 20.0), [None, None], "said");
    assert_eq!(say(3.22, 90.0), [None, Some(HealthChange::Temperature(90.0))], "2.4 % is no return yet");
    assert_eq!(say(3.19, 84.0), [None, None], "neither is 84 degrees");
    assert_eq!(say(3.29, 80.0), [None, None]);
    assert_eq!(say(3.41, -41.0), [Some(HealthChange::Supply(3.41)), Some(HealthChange::Temperature(-41.0))]);
    assert_eq!(watch.follow(BoardHealth::default()), [None, None], "a board that measures nothing");
}
