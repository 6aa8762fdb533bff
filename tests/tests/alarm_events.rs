//! Alarm bands, event ring and configuration checks.

use meshband::alarm::{Alarm, AlarmBand, AlarmChange, Watched};
use meshband::config::{Configuration, ConfigurationError};
use meshband::events::{EventKind, EventLog, RING};
use meshband::units::{Acceleration, Hertz};

fn band() -> AlarmBand {
    AlarmBand { watched: Watched::Rms, from: Hertz(5.0), to: Hertz(20.0), raise: 2.0, clear: 1.5, persistence: 3 }
}

#[test]
fn theory_alarms_need_persistence_and_clear_below_their_hysteresis() {
    let (band, mut alarm) = (band(), Alarm::default());
    let speed = Hertz(10.0);
    let changes: Vec<_> = [2.1, 2.1, 1.9, 2.1, 2.1, 2.1].map(|x| alarm.update(&band, speed, x)).into();
    assert_eq!(changes, [None, None, None, None, None, Some(AlarmChange::Raised)]);
    assert!((0..10).all(|_| alarm.update(&band, speed, 1.7).is_none()), "inside the hysteresis");
    assert!((0..10).all(|_| alarm.update(&band, Hertz(30.0), 0.0).is_none()), "outside the speed band");
    assert!((0..10).all(|_| alarm.update(&band, speed, f32::NAN).is_none()), "undefined");
    let changes: Vec<_> = [1.0, 1.0, 1.0].map(|x| alarm.update(&band, speed, x)).into();
    assert_eq!(changes, [None, None, Some(AlarmChange::Cleared)]);
}

#[test]
fn theory_a_stuck_input_cannot_push_history_out_of_the_ring() {
    let mut log = EventLog::default();
    log.record(EventKind::TachLocked, 0, 5);
    for tick in 0..10_000 {
        log.record(EventKind::Stuck, 77, 100 + tick);
    }
    assert_eq!(log.count(EventKind::Stuck), 10_000);
    let kept: Vec<_> = log.iter().map(|event| (event.kind, event.count, event.first_tick, event.last_tick)).collect();
    assert_eq!(kept, [(EventKind::TachLocked, 1, 5, 5), (EventKind::Stuck, 10_000, 100, 10_099)]);
}

#[test]
fn fault_an_overfull_ring_keeps_the_newest_and_reports_each_once() {
    let mut log = EventLog::default();
    for detail in 0..(RING as u32 + 10) {
        log.record(EventKind::RateChanged, detail, u64::from(detail));
    }
    let mut reported = Vec::new();
    while let Some(event) = log.take_unreported() {
        reported.push(event.detail);
    }
    assert_eq!(reported, (10..RING as u32 + 10).collect::<Vec<_>>());
    log.record(EventKind::Saturated, 1, 99);
    assert_eq!(log.take_unreported().map(|event| event.kind), Some(EventKind::Saturated));
    assert!(log.take_unreported().is_none());
}

#[test]
fn fault_each_absurd_field_is_named() {
    type Spoil = fn(&mut Configuration);
    let cases: [(Spoil, ConfigurationError); 9] = [
        (|c| c.schema = 9, ConfigurationError::Schema),
        (|c| c.gears.pinion_teeth = 3, ConfigurationError::PinionTeeth),
        (|c| c.gears.gear_teeth = 60_000, ConfigurationError::GearTeeth),
        (|c| c.tach.pulses_per_turn = 0, ConfigurationError::PulsesPerTurn),
        (|c| c.tach.missing = 1, ConfigurationError::MissingTeeth),
        (|c| c.tach.pinion_per_tach = f32::NAN, ConfigurationError::PinionPerTach),
        (|c| c.sensor.acceleration_per_code = Acceleration(0.0), ConfigurationError::Sensitivity),
        (|c| c.mesh.harmonics = 0, ConfigurationError::Harmonics),
        (|c| c.alarms.push(AlarmBand { clear: 3.0, ..band() }).expect("room"), ConfigurationError::Alarm(0)),
    ];
    assert_eq!(Configuration::default().validate(84_000_000), Ok(()));
    for (spoil, error) in cases {
        let mut config = Configuration::default();
        spoil(&mut config);
        assert_eq!(config.validate(84_000_000), Err(error));
    }
}
