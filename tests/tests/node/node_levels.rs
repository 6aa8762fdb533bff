//! Expected levels: what the table says between its points, and the departure of a running node from it.

use crate::node_alarms::{Watch, configuration};
use meshband::alarm::{AlarmBand, Watched};
use meshband::board::Timing;
use meshband::config::{Configuration, ConfigurationError};
use meshband::events::EventKind;
use meshband::levels::{ExpectedLevel, LevelPoint, LocalDepartures, LocalPoint, departure};
use meshband::mesh_band::sideband_amplitude;
use meshband::message::{MeshBand, SpectralLine};
use meshband::units::Hertz;

fn point(speed: f32, level_db: f32, uncertainty_db: f32) -> LevelPoint {
    LevelPoint { speed: Hertz(speed), rms: ExpectedLevel { level_db, uncertainty_db }, ..LevelPoint::default() }
}

/// Acceleration of 3 m/s2 amplitude is expected at every speed from 10 to 40 Hz, to 1 dB; four of them are an alarm.
fn watching() -> Configuration {
    let mut config = configuration();
    let level = 20.0 * (3.0f32 / 2.0f32.sqrt()).log10();
    config.levels = [point(10.0, level, 1.0), point(40.0, level, 1.0)].into_iter().collect();
    let band = AlarmBand {
        watched: Watched::Departure,
        from: Hertz(0.0),
        to: Hertz(100.0),
        raise: 4.0,
        clear: 3.0,
        persistence: 2,
    };
    config.alarms = [band].into_iter().collect();
    config.holding.latching = false;
    config
}

#[test]
fn theory_levels_are_linear_in_decibels_over_the_logarithm_of_the_speed() {
    let table = [point(5.0, -10.0, 1.0), point(20.0, 10.0, 2.0), point(30.0, 12.0, 0.0)];
    let at = |speed: f32, value: f32| departure(&table, Hertz(speed), 0.0, value, |p| p.rms);
    let middle = at(10.0, 1.0).expect("within the table");
    assert!(middle.departure_db.abs() < 1e-5 && (middle.uncertainty_db - 1.5).abs() < 1e-5, "{middle:?}");
    let twice = at(10.0, 2.0).expect("within the table");
    assert!((twice.departure_db - 6.0206).abs() < 1e-4 && (twice.normalised() - 4.0137).abs() < 1e-4);
    assert!((at(5.0, 1.0).expect("the first point").departure_db - 10.0).abs() < 1e-4);
    assert_eq!((at(4.9, 1.0), at(31.0, 1.0)), (None, None), "no extrapolation");
    assert_eq!(at(25.0, 1.0), None, "one neighbour expects nothing");
    assert_eq!((at(10.0, 0.0), at(10.0, f32::NAN), at(10.0, f32::INFINITY)), (None, None, None));
    assert_eq!(departure(&table, Hertz(10.0), 0.0, 1.0, |p| p.velocity_rms), None, "another quantity");
    // A tenth of uncertainty in the speed on a slope of 20 dB per ln 4.
    let slope = 20.0 / 4.0f32.ln();
    let unsure = departure(&table, Hertz(10.0), 0.1, 1.0, |p| p.rms).expect("within").uncertainty_db;
    assert!((unsure - f32::hypot(1.5, 0.1 * slope)).abs() < 1e-4, "{unsure}");
}

#[test]
fn fault_nothing_is_expected_between_a_point_that_expects_and_one_that_does_not() {
    let known = |uncertainties: [f32; 2], value: f32| {
        let [low, high] = uncertainties;
        let points = [point(10.0, 0.0, low), point(40.0, 0.0, high)];
        departure(&points, Hertz(20.0), 0.0, value, |point| point.rms).is_some()
    };
    assert!(known([1.0, 1.0], 1.0));
    for (uncertainties, value) in
        [([0.0, 1.0], 1.0), ([1.0, 0.0], 1.0), ([1.0, 1.0], 0.0), ([1.0, 1.0], f32::INFINITY), ([1.0, 1.0], -1.0)]
    {
        assert!(!known(uncertainties, value), "{uncertainties:?} {value}");
    }
}

#[test]
fn fault_tables_that_say_nothing_sound_are_refused() {
    let refused = |points: &[LevelPoint]| {
        let levels = points.iter().copied().collect();
        Configuration { levels, ..Configuration::default() }.validate(Timing::STM32F405)
            == Err(ConfigurationError::Levels)
    };
    assert!(!refused(&[point(1.0, 0.0, 1.0), point(2.0, 0.0, 0.0)]));
    let descending = [point(2.0, 0.0, 1.0), point(1.0, 0.0, 1.0)];
    let twice = [point(2.0, 0.0, 1.0), point(2.0, 0.0, 1.0)];
    let alone = [point(2.0, 0.0, 1.0)];
    assert!(refused(&descending) && refused(&twice) && refused(&alone));
    for wrong in [point(0.0, 0.0, 1.0), point(f32::NAN, 0.0, 1.0), point(1.0, f32::NAN, 1.0), point(1.0, 0.0, -1.0)] {
        assert!(refused(&[wrong, point(50.0, 0.0, 1.0)]), "{wrong:?}");
    }
    assert!(refused(&[point(1.0, 0.0, 61.0), point(50.0, 0.0, 1.0)]));
}

#[test]
fn theory_the_node_reports_the_departure_and_its_alarm_watches_it() {
    let mut watch = Watch::new(watching());
    watch.run(5.0, 3.0);
    let healthy = watch.indicators.expect("values").departures;
    let rms = healthy.rms.expect("a level is expected");
    assert!(rms.departure_db.abs() < 0.01 && (rms.uncertainty_db - 1.0).abs() < 0.01, "{rms:?}");
    assert_eq!((healthy.velocity_rms, healthy.mesh_amplitude, healthy.residual_rms), (None, None, None));
    assert!(!watch.stands());
    // 20 log10 (5 / 3) = 4.4 dB.
    watch.run(6.0, 5.0);
    let raised = watch.indicators.expect("values").departures.rms.expect("expected");
    assert!((raised.departure_db - 4.437).abs() < 0.01, "{raised:?}");
    assert_eq!(watch.said(EventKind::AlarmRaised), [0]);
    watch.run(6.0, 3.0);
    assert!(!watch.stands());
}

#[test]
fn fault_without_speed_there_is_no_departure_and_a_clipped_one_clears_no_alarm() {
    let mut watch = Watch::new(watching());
    watch.run(5.0, 3.0);
    watch.tach = false;
    watch.run(6.0, 20.0);
    assert_eq!(watch.indicators.expect("values").departures, Default::default());
    assert_eq!(watch.said(EventKind::AlarmRaised), [0u32; 0], "at which speed nobody knows");
    let mut watch = Watch::new(watching());
    watch.run(6.0, 6.0);
    assert_eq!(watch.said(EventKind::AlarmRaised), [0]);
    // Clipped: what is told is at least so far above, which clears nothing; the signal's own alarm stands as well.
    watch.run(5.0, 90.0);
    let clipped = watch.indicators.expect("values").departures.rms.expect("a lower bound");
    assert!((20.0..30.0).contains(&clipped.departure_db), "{clipped:?}");
    assert_eq!(watch.said(EventKind::AlarmCleared), [0u32; 0]);
}

#[test]
fn theory_sidebands_of_all_harmonics_count_alike() {
    let line = |amplitude: f32| SpectralLine { amplitude, ..SpectralLine::default() };
    let band = |pinion: &[f32], gear: &[f32]| MeshBand {
        line: line(100.0),
        sidebands: pinion.iter().copied().map(line).collect(),
        gear_sidebands: gear.iter().copied().map(line).collect(),
        ..MeshBand::default()
    };
    // 5 of a harmonic's own, 20 of another's: ten, whatever the harmonics themselves are.
    let all = [band(&[3.0, 0.0], &[4.0]), band(&[20.0], &[]), band(&[0.0], &[0.0])];
    assert!((sideband_amplitude(&all, [0; 2]) - 10.0).abs() < 1e-4, "{}", sideband_amplitude(&all, [0; 2]));
    assert_eq!((sideband_amplitude(&all[2..], [0; 2]), sideband_amplitude(&[], [0; 2])), (0.0, 0.0));
}

#[test]
fn theory_a_local_fault_departs_and_its_alarm_watches_it() {
    let mut config = watching();
    // A sine at the mesh frequency: peak to peak over its amplitude is 2. Only one of the two departs upwards.
    let level_db = 20.0 * 2.0f32.log10() - 10.0;
    let expected = |speed| LocalPoint {
        speed: Hertz(speed),
        sidebands: ExpectedLevel { level_db: 100.0, uncertainty_db: 1.0 },
        fm0: ExpectedLevel { level_db, uncertainty_db: 2.0 },
    };
    config.local_levels = [expected(10.0), expected(40.0)].into_iter().collect();
    let mut watch = Watch::new(config);
    watch.run(5.0, 20.0);
    let found = watch.indicators.as_ref().expect("values").local_departures;
    let (fm0, sidebands) = (found.fm0.expect("expected"), found.sidebands.expect("expected"));
    assert!((fm0.departure_db - 10.0).abs() < 0.5 && (fm0.uncertainty_db - 2.0).abs() < 0.01, "{fm0:?}");
    assert!(sidebands.departure_db < -50.0, "{sidebands:?}");
    assert_eq!(watch.said(EventKind::AlarmRaised), [0], "five standard uncertainties, four are the limit");
    // Without a tach there is neither.
    watch.tach = false;
    watch.run(5.0, 20.0);
    assert_eq!(watch.indicators.as_ref().expect("values").local_departures, LocalDepartures::NONE);
}

#[test]
fn fault_local_tables_that_say_nothing_sound_are_refused_by_their_own_name() {
    let point = |speed: f32, level_db: f32| {
        let level = ExpectedLevel { level_db, uncertainty_db: 1.0 };
        LocalPoint { speed: Hertz(speed), sidebands: level, fm0: level }
    };
    let judged = |points: &[LocalPoint]| {
        let local_levels = points.iter().copied().collect();
        Configuration { local_levels, ..Configuration::default() }.validate(Timing::STM32F405)
    };
    assert_eq!(judged(&[point(1.0, 0.0), point(2.0, 0.0)]), Ok(()));
    for wrong in
        [vec![point(1.0, 0.0)], vec![point(2.0, 0.0), point(1.0, 0.0)], vec![point(1.0, f32::NAN), point(2.0, 0.0)]]
    {
        assert_eq!(judged(&wrong), Err(ConfigurationError::LocalLevels), "{wrong:?}");
    }
    assert_eq!(ConfigurationError::LocalLevels.field(), "local_levels");
}
