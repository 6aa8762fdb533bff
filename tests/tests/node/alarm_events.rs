//! Alarm bands, event ring and configuration checks.

use meshband::alarm::{Alarm, AlarmBand, AlarmChange, AlarmHolding, AlarmMode, Put, Severity, Side, Use, Watched};
use meshband::config::{Configuration, ConfigurationError, SecondSensor};
use meshband::events::{EventKind, EventLog, MAX_EVENTS, QUOTA};
use meshband::units::{Acceleration, Hertz, TicksPerSecond};

fn band() -> AlarmBand {
    AlarmBand { watched: Watched::Rms, from: Hertz(5.0), to: Hertz(20.0), raise: 2.0, clear: 1.5, persistence: 3 }
}

/// A value that may do everything, put to an alarm.
fn put(
    alarm: &mut Alarm,
    band: &AlarmBand,
    holding: &AlarmHolding,
    persistence_ticks: u64,
    [tick, value]: [f64; 2],
) -> Option<AlarmChange> {
    let put = Put { tick: tick as u64, value: value as f32, may: Use::Both };
    alarm.update(band, Side::Above, holding, [persistence_ticks, 1], put)
}

#[test]
fn theory_what_may_only_raise_clears_nothing_and_ends_no_row() {
    let (band, holding, mut alarm) = (band(), AlarmHolding::default(), Alarm::default());
    let mut put = |value: f32, may| alarm.update(&band, Side::Above, &holding, [0, 1], Put { tick: 0, value, may });
    assert_eq!([put(3.0, Use::RaiseOnly), put(1.0, Use::RaiseOnly), put(3.0, Use::LowerBound)], [None; 3]);
    assert_eq!(put(9.0, Use::Neither), None);
    assert_eq!(put(3.0, Use::RaiseOnly), Some(AlarmChange::Raised), "the third above, the lower bound is no evidence");
    assert!((0..10).all(|_| put(1.0, Use::RaiseOnly).is_none() && put(1.0, Use::Neither).is_none()));
    assert_eq!([put(1.0, Use::Both), put(1.0, Use::Both)], [None; 2]);
    assert_eq!(put(3.0, Use::RaiseOnly), None, "beyond the limit: the row of clear values ends");
    assert_eq!([put(1.0, Use::Both), put(1.0, Use::Both)], [None; 2]);
    assert_eq!(put(1.0, Use::Both), Some(AlarmChange::Cleared));
}

#[test]
fn theory_a_low_limit_is_raised_below_it_and_never_by_a_lower_bound() {
    let band = AlarmBand { raise: 1.0, clear: 1.5, persistence: 2, ..band() };
    assert!(band.is_sane(Side::Below) && !band.is_sane(Side::Above));
    let (holding, mut alarm) = (AlarmHolding::default(), Alarm::default());
    let mut put = |value: f32, may| alarm.update(&band, Side::Below, &holding, [0, 1], Put { tick: 0, value, may });
    assert_eq!([put(0.5, Use::LowerBound), put(0.5, Use::LowerBound)], [None; 2]);
    assert_eq!([put(0.5, Use::Both), put(0.5, Use::Both)], [None, Some(AlarmChange::Raised)]);
    assert_eq!([put(1.2, Use::Both), put(1.2, Use::Both)], [None; 2], "inside the hysteresis");
    assert_eq!([put(2.0, Use::Both), put(2.0, Use::Both)], [None, Some(AlarmChange::Cleared)]);
}

#[test]
fn theory_a_rise_is_measured_against_the_value_s_own_mean() {
    let band = AlarmBand { raise: 1.0, clear: 0.5, persistence: 2, ..band() };
    let (holding, mut alarm) = (AlarmHolding::default(), Alarm::default());
    let mut put =
        |tick, value: f32| alarm.update(&band, Side::Rise, &holding, [0, 600], Put { tick, value, may: Use::Both });
    // An hour at 5, then slowly up by 0.001 a tick: 0.6 in the mean's time, below the limit.
    assert!((0..3600).all(|tick| put(tick, 5.0).is_none()));
    assert!((3600..7200).all(|tick| put(tick, 5.0 + 0.001 * (tick - 3600) as f32).is_none()));
    assert_eq!([put(7200, 10.0), put(7201, 10.0)], [None, Some(AlarmChange::Raised)]);
    let cleared =
        (7202..20_000).find(|&tick| put(tick, 10.0) == Some(AlarmChange::Cleared)).expect("it has become usual");
    assert!((7900..9900).contains(&cleared), "{cleared}");
}

#[test]
fn theory_a_second_sensor_needs_a_second_converter_and_a_rate_that_both_keep() {
    use meshband::board::Timing;
    let mut config = Configuration { second: Some(SecondSensor::default()), ..Configuration::default() };
    assert_eq!(config.validate(Timing::STM32F405), Err(ConfigurationError::HighestOfTwo), "420 kHz is of one channel");
    config.limits.highest_adc = Timing::STM32F405.highest_of_two.expect("two converters");
    assert_eq!(config.validate(Timing::STM32F405), Ok(()));
    assert_eq!(config.validate(Timing::AN386), Err(ConfigurationError::OneConverter));
    config.alarms.push(AlarmBand { watched: Watched::SecondVelocityRms, ..band() }).expect("room");
    assert_eq!(config.validate(Timing::STM32F405), Ok(()));
    // What an older image promised is lowered, the rest kept.
    config.limits.highest_adc = Hertz(420_000.0);
    config.lower_to(Timing::STM32F405);
    assert_eq!(config.validate(Timing::STM32F405), Ok(()));
}

#[test]
fn theory_alarms_need_persistence_and_clear_below_their_hysteresis() {
    let (band, mut alarm) = (band(), Alarm::default());
    let mut put = |x| put(&mut alarm, &band, &AlarmHolding::default(), 0, [0.0, x]);
    let changes: Vec<_> = [2.1, 2.1, 1.9, 2.1, 2.1, 2.1].map(&mut put).into();
    assert_eq!(changes, [None, None, None, None, None, Some(AlarmChange::Raised)]);
    assert!((0..10).all(|_| put(1.7).is_none()), "inside the hysteresis");
    assert!((0..10).all(|_| put(f64::NAN).is_none()), "undefined");
    let changes: Vec<_> = [1.0, 1.0, 1.0].map(put).into();
    assert_eq!(changes, [None, None, Some(AlarmChange::Cleared)]);
}

#[test]
fn theory_an_alarm_waits_for_its_time_too() {
    let band = AlarmBand { persistence: 1, ..band() };
    let mut alarm = Alarm::default();
    let mut put = |tick, x| put(&mut alarm, &band, &AlarmHolding::default(), 100, [tick, x]);
    assert_eq!([put(10.0, 3.0), put(60.0, 3.0), put(109.0, 3.0)], [None; 3]);
    assert_eq!(put(110.0, 3.0), Some(AlarmChange::Raised));
    assert_eq!(
        [put(120.0, 1.0), put(130.0, 3.0), put(140.0, 1.0), put(239.0, 1.0)],
        [None; 4],
        "one value above starts the time anew"
    );
    assert_eq!(put(240.0, 1.0), Some(AlarmChange::Cleared));
}

#[test]
fn theory_a_latched_alarm_stands_until_it_is_acknowledged() {
    let band = AlarmBand { persistence: 1, ..band() };
    let holding = AlarmHolding { latching: true, ..AlarmHolding::default() };
    let mut alarm = Alarm::default();
    assert_eq!(alarm.acknowledge(), None);
    assert_eq!(put(&mut alarm, &band, &holding, 0, [0.0, 3.0]), Some(AlarmChange::Raised));
    assert_eq!(put(&mut alarm, &band, &holding, 0, [1.0, 1.0]), None);
    assert!(alarm.stands() && alarm.is_unseen() && !alarm.is_raised());
    assert_eq!(put(&mut alarm, &band, &holding, 0, [2.0, 3.0]), None, "it has stood all the time");
    assert_eq!(alarm.acknowledge(), None, "the value is still beyond its limit");
    assert!(alarm.stands() && !alarm.is_unseen());
    assert_eq!(put(&mut alarm, &band, &holding, 0, [3.0, 1.0]), Some(AlarmChange::Cleared), "seen, and well again");
    assert_eq!(put(&mut alarm, &band, &holding, 0, [4.0, 3.0]), Some(AlarmChange::Raised));
    assert_eq!(put(&mut alarm, &band, &holding, 0, [5.0, 1.0]), None);
    assert_eq!(alarm.acknowledge(), Some(AlarmChange::Cleared));
    assert!(!alarm.stands());
}

#[test]
fn theory_bands_apply_inside_their_speeds_and_outside_or_without_one_the_least_strict() {
    let slow = band();
    let fast = AlarmBand { from: Hertz(20.0), to: Hertz(60.0), raise: 5.0, ..slow };
    let other = AlarmBand { watched: Watched::Crest, raise: 9.0, ..slow };
    let all = [slow, fast, other];
    let applies = |speed: Option<f32>| [0, 1, 2].map(|n| AlarmBand::applies(n, speed.map(Hertz), &all, &[], &[]));
    assert_eq!(applies(Some(10.0)), [true, false, true]);
    assert_eq!(applies(Some(30.0)), [false, true, true]);
    assert_eq!(applies(Some(70.0)), [false, true, true]);
    assert_eq!(applies(None), [false, true, true]);
    // Of a severity of its own each is the least strict; at the low side that is the lowest.
    let alert = AlarmMode { severity: Severity::Alert, ..AlarmMode::default() };
    assert!(AlarmBand::applies(0, None, &all, &[alert], &[]) && AlarmBand::applies(1, None, &all, &[alert], &[]));
    let low = AlarmMode { side: Side::Below, ..AlarmMode::default() };
    let lows = [low; 3];
    assert!(AlarmBand::applies(0, None, &all, &lows, &[]) && !AlarmBand::applies(1, None, &all, &lows, &[]));
}

/// A time base of 1000 ticks per second.
fn log() -> EventLog {
    EventLog::new(TicksPerSecond(1000))
}

fn kept(log: &EventLog) -> Vec<(EventKind, u32, u32, u64, u64)> {
    log.iter().map(|e| (e.kind, e.detail, e.count, e.first_tick, e.last_tick)).collect()
}

fn reported(log: &mut EventLog) -> Vec<(EventKind, u32)> {
    std::iter::from_fn(|| log.take_unreported()).map(|e| (e.kind, e.detail)).collect()
}

#[test]
fn theory_a_stuck_input_is_one_event_however_long_it_lasts() {
    let mut log = log();
    log.record(EventKind::TachLocked, 0, 5);
    for tick in 0..10_000 {
        log.record(EventKind::Stuck, 77, 100 + tick);
    }
    assert_eq!(log.count(EventKind::Stuck), 10_000);
    assert_eq!(kept(&log), [(EventKind::TachLocked, 0, 1, 5, 5), (EventKind::Stuck, 77, 10_000, 100, 10_099)]);
    // An hour later it is another occurrence, and said as such.
    assert_eq!(reported(&mut log).len(), 2);
    log.record(EventKind::Stuck, 77, 3_600_000);
    assert_eq!(reported(&mut log), [(EventKind::Stuck, 77)]);
}

#[test]
fn regress_two_events_in_turn_are_two_entries_and_no_storm() {
    let mut log = log();
    log.record(EventKind::AlarmRaised, 3, 1);
    for block in 0..100_000u64 {
        log.record(EventKind::Saturated, 1000, 10 + block);
        log.record(EventKind::Stuck, 65_535, 10 + block);
    }
    assert_eq!(
        kept(&log),
        [
            (EventKind::AlarmRaised, 3, 1, 1, 1),
            (EventKind::Saturated, 1000, 100_000, 10, 100_009),
            (EventKind::Stuck, 65_535, 100_000, 10, 100_009)
        ]
    );
    assert_eq!(reported(&mut log).len(), 3);
}

#[test]
fn fault_details_that_never_repeat_are_bounded_in_rate_and_places() {
    let mut log = log();
    log.record(EventKind::AlarmRaised, 3, 1);
    let mut said = 0;
    // Ten seconds of overruns, each with a number of its own, one per tick.
    for tick in 0..10_000 {
        log.record(EventKind::Overrun, tick, 10 + u64::from(tick));
        said += reported(&mut log).len();
    }
    assert!((11..=1 + 11 * QUOTA).contains(&said), "{said} reports in ten seconds");
    assert_eq!(log.count(EventKind::Overrun), 10_000);
    assert_eq!(kept(&log)[0], (EventKind::AlarmRaised, 3, 1, 1, 1), "the history is still there");
    assert_eq!(kept(&log).len(), 1 + QUOTA);
    let newest = kept(&log)[QUOTA];
    assert_eq!((newest.1, newest.4), (9_999, 10_009), "the newest entry carries the latest detail");
}

#[test]
fn theory_all_alarms_can_speak_at_once() {
    let mut log = log();
    (0..QUOTA as u32).for_each(|index| log.record(EventKind::AlarmRaised, index, 7));
    let expected: Vec<_> = (0..QUOTA as u32).map(|index| (EventKind::AlarmRaised, index)).collect();
    assert_eq!(reported(&mut log), expected);
}

#[test]
fn fault_a_full_history_keeps_the_newest_of_each_kind_and_reports_each_once() {
    use EventKind as K;
    let mut log = log();
    let rare = [K::Started, K::ConfigurationRefused, K::SelfTestFailed, K::AlarmRaised];
    for (n, kind) in rare.into_iter().enumerate() {
        log.record(kind, 7, n as u64);
    }
    let storm = [K::RateChanged, K::BlocksLost, K::TimeJump, K::UnexpectedPeriod, K::Overrun, K::Board];
    for round in 0..1000u64 {
        for kind in storm {
            log.record(kind, round as u32, 10_000 * (1 + round));
        }
    }
    assert_eq!(kept(&log).len(), MAX_EVENTS);
    for kind in rare.into_iter().chain(storm) {
        assert!(kept(&log).iter().any(|e| e.0 == kind), "{kind:?} is gone");
    }
    let all: Vec<_> = kept(&log).iter().map(|e| (e.0, e.1)).collect();
    assert_eq!(reported(&mut log), all, "what is kept was not reported yet");
    log.record(K::Saturated, 1, 20_000_000);
    assert_eq!(reported(&mut log), [(K::Saturated, 1)]);
    log.report_all();
    assert_eq!(reported(&mut log).len(), MAX_EVENTS);
    assert!(reported(&mut log).is_empty());
}

#[test]
fn fault_each_absurd_field_is_named() {
    type Spoil = fn(&mut Configuration);
    let cases: [(Spoil, ConfigurationError); 19] = [
        (|c| c.tach.pulses_per_turn = 1024, ConfigurationError::TachTooManyPulses),
        (|c| c.modes.push(AlarmMode::default()).expect("room"), ConfigurationError::Modes),
        (|c| (c.range.lowest, c.range.highest) = (2000, 1000), ConfigurationError::Sensor),
        (|c| c.sensor_check.bias_v = [8.0, 14.0], ConfigurationError::Sensor),
        (|c| c.velocity_from = Hertz(0.5), ConfigurationError::Sensor),
        (|c| c.schema = 99, ConfigurationError::Schema),
        (|c| c.gears.pinion_teeth = 3, ConfigurationError::PinionTeeth),
        (|c| c.gears.gear_teeth = 60_000, ConfigurationError::GearTeeth),
        (|c| c.tach.pulses_per_turn = 0, ConfigurationError::PulsesPerTurn),
        (|c| c.tach.missing = 1, ConfigurationError::MissingTeeth),
        (|c| c.tach.pinion_per_tach = f32::NAN, ConfigurationError::PinionPerTach),
        (|c| c.sensor.acceleration_per_code = Acceleration(0.0), ConfigurationError::Sensitivity),
        (|c| c.mesh.harmonics = 0, ConfigurationError::Harmonics),
        (|c| c.alarms.push(AlarmBand { clear: 3.0, ..band() }).expect("room"), ConfigurationError::Alarm(0)),
        (|c| c.holding.persistence_s = f32::NAN, ConfigurationError::Holding),
        (|c| c.pass.analogue = Hertz(200_000.0), ConfigurationError::PassBand),
        (|c| c.second = Some(SecondSensor { band: Hertz(5.0), ..SecondSensor::default() }), ConfigurationError::Second),
        (
            |c| c.second = Some(SecondSensor { acceleration_per_code: Acceleration(0.0), ..SecondSensor::default() }),
            ConfigurationError::Second,
        ),
        (
            |c| c.alarms.push(AlarmBand { watched: Watched::SecondRms, ..band() }).expect("room"),
            ConfigurationError::Alarm(0),
        ),
    ];
    assert_eq!(Configuration::default().validate(meshband::board::Timing::STM32F405), Ok(()));
    for (spoil, error) in cases {
        let mut config = Configuration::default();
        spoil(&mut config);
        assert_eq!(config.validate(meshband::board::Timing::STM32F405), Err(error));
    }
}

#[test]
fn regress_a_rate_whose_blocks_outlast_the_watchdog_is_refused() {
    use meshband::config::{BLOCK_SAMPLES, LOWEST_ADC_HZ};
    use meshband::rate_plan::RatePolicy;
    // The main loop counts as dead after a second without a block; half of it is left.
    assert!(BLOCK_SAMPLES as f32 / LOWEST_ADC_HZ <= 0.5);
    let lowest = |config: &Configuration| {
        let session = meshband::node::Node::new(config.clone(), TicksPerSecond(84_000_000)).expect("valid");
        84.0e6 / session.requested_period_ticks() as f32
    };
    let mut config = Configuration::default();
    config.limits.analogue_stop = Hertz(10.0);
    assert_eq!(config.validate(meshband::board::Timing::STM32F405), Err(ConfigurationError::AnalogueStop));
    let said = ConfigurationError::AnalogueStop.to_string();
    assert!(said.contains("limits.analogue_stop") && said.contains("watchdog"), "{said}");
    config.limits.analogue_stop = Hertz(LOWEST_ADC_HZ / 2.0);
    config.limits.highest_adc = Hertz(LOWEST_ADC_HZ);
    config.policy = RatePolicy::Forced { rate: Hertz(LOWEST_ADC_HZ / 2.0) };
    assert_eq!(config.validate(meshband::board::Timing::STM32F405), Err(ConfigurationError::Policy));
    config.policy = RatePolicy::Spectrum;
    assert_eq!(config.validate(meshband::board::Timing::STM32F405), Ok(()));
    assert!(lowest(&config) >= 0.999 * LOWEST_ADC_HZ);
    config.limits.highest_adc = Hertz(100.0);
    assert_eq!(config.validate(meshband::board::Timing::STM32F405), Err(ConfigurationError::HighestAdc));
}
