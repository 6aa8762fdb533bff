//! The figures behind a commissioning, each alone: mesh line, classes of speed, limits, settings as text.

use meshband::alarm::{AlarmBand, Watched};
use meshband::config::Configuration;
use meshband::levels::{ExpectedLevel, LevelPoint};
use meshband::units::{Acceleration, Hertz};
use meshband_host::commissioning::coverage::Coverage;
use meshband_host::commissioning::ear::Waveform;
use meshband_host::commissioning::limits::{MOST_FREEDOM, quantile, shape};
use meshband_host::commissioning::mesh_fit::{Fit, fit};
use meshband_host::commissioning::settings_text::{changes, to_toml};
use meshband_host::law::domain::Domain;
use meshband_host::link::settings::Settings;
use std::f64::consts::TAU;

const TEETH: f64 = 19.0;

/// Noise of half a unit, the same every time.
fn noise() -> impl FnMut() -> f64 {
    let mut state = 0x9e37_79b9_7f4a_7c15u64;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    }
}

/// A pinion of 19 teeth at 20 Hz, four harmonics with sidebands; the node takes it for `speed_hz`.
fn waveform(speed_hz: f64) -> Waveform {
    let rate_hz = 25_600.0;
    let mut noise = noise();
    let sample = |n: usize| {
        let turns = 20.0 * n as f64 / rate_hz;
        let mesh = |h: f64| (1.0 + 0.2 * (TAU * turns).cos()) * (TAU * h * TEETH * turns).cos() / h;
        (1..=4).map(|h| mesh(f64::from(h))).sum::<f64>() + 0.3 * noise()
    };
    Waveform { samples: (0..4096).map(sample).collect(), rate_hz, speed_hz }
}

#[test]
fn theory_the_declared_wheel_and_teeth_are_kept_where_they_fit() {
    let Fit::Declared { line_hz, explained } = fit(&[waveform(20.0)], [19, 48], 8) else { panic!("is there") };
    assert!((line_hz - 380.0).abs() < 1e-9 && explained > 0.8, "{line_hz} {explained}");
}

#[test]
fn fault_pulses_that_are_wrong_are_named_with_the_number_that_fits() {
    for (declared, fits) in [(2, 1), (1, 2), (8, 24), (60, 58), (8, 1), (1, 8)] {
        let taken_for = 20.0 * f64::from(fits) / f64::from(declared);
        let found = fit(&[waveform(taken_for)], [19, 48], declared);
        let Fit::Pulses { fits: named, .. } = found else { panic!("{declared} instead of {fits}: {found:?}") };
        let same = f64::from(named) / f64::from(fits);
        assert!((same - 1.0).abs() < 0.02, "{declared} instead of {fits}: {named}");
    }
}

#[test]
fn fault_interchanged_teeth_are_named() {
    let found = fit(&[waveform(20.0)], [48, 19], 8);
    assert!(matches!(found, Fit::Interchanged { line_hz } if (line_hz - 380.0).abs() < 1e-6), "{found:?}");
}

#[test]
fn theory_noise_is_no_mesh_line() {
    let mut silent = waveform(20.0);
    let mut noise = noise();
    silent.samples.iter_mut().for_each(|sample| *sample = noise());
    assert_eq!(fit(&[silent], [19, 48], 8), Fit::Nothing);
}

#[test]
fn theory_classes_cover_the_range_without_gaps_and_say_what_is_missing() {
    let mut coverage = Coverage::new(Domain { lowest_hz: 10.0, highest_hz: 25.0 }, 2);
    assert_eq!(coverage.classes.len(), 6);
    assert!(coverage.classes.windows(2).all(|pair| (pair[1].from_hz - pair[0].to_hz).abs() < 1e-9));
    assert!((coverage.classes[5].to_hz - 25.0).abs() < 1e-9);
    assert!(!coverage.take(10.5) && coverage.take(10.6) && !coverage.take(10.7) && !coverage.take(9.0));
    assert_eq!(coverage.filled().count(), 1);
    assert!(!coverage.is_complete() && coverage.missing().contains("(0 of 2)"));
    (0..150).for_each(|n| {
        coverage.take(10.0 + 0.1 * f64::from(n));
    });
    assert!(coverage.is_complete() && coverage.missing().is_empty());
    assert_eq!(coverage.covered_hz().map(|ends| ends.map(f64::round)), Some([10.0, 25.0]));
}

#[test]
fn theory_the_text_read_back_is_the_same_configuration_and_the_difference_names_what_changed() {
    let mut config = Configuration::default();
    config.sensor.acceleration_per_code = Acceleration(0.004_94);
    let level = ExpectedLevel { level_db: -12.345, uncertainty_db: 1.1 };
    let point = |speed| LevelPoint { speed: Hertz(speed), rms: level, ..LevelPoint::default() };
    config.levels = [point(10.0), point(20.0)].into_iter().collect();
    let alarm = AlarmBand {
        watched: Watched::Departure,
        from: Hertz(10.0),
        to: Hertz(20.0),
        raise: 5.3,
        clear: 4.2,
        persistence: 3,
    };
    config.alarms = [alarm].into_iter().collect();
    let text = to_toml(&config, "# head\n").expect("has a form");
    assert!(text.contains("acceleration_per_code = 0.00494\n"), "{text}");
    let mut read = Configuration::default();
    Settings::from_toml(&text, "node.toml").expect("reads").apply(&mut read).expect("applies");
    assert_eq!(read, config);
    let found = changes(&Configuration::default(), &config);
    let keys: Vec<&str> = found.iter().map(|change| change.key.as_str()).collect();
    assert_eq!(keys, ["alarms", "levels", "sensor.acceleration_per_code"]);
    assert_eq!(found[1].after, "2 entries");
    assert!(changes(&config, &config).is_empty());
}

#[test]
fn theory_quantiles_are_those_of_the_tables() {
    // Abramowitz and Stegun, table 26.10; Gauss at 1e-6.
    assert!((quantile(0.025, 10.0) - 2.2281).abs() < 1e-3);
    assert!((quantile(0.0005, 5.0) - 6.8688).abs() < 1e-3);
    assert!((quantile(1e-6, MOST_FREEDOM) - 4.7534).abs() < 0.01);
}

#[test]
fn theory_fewer_values_and_more_scatter_mean_wider_limits() {
    let alternating =
        |count: usize, by: f64| -> Vec<f64> { (0..count).map(|n| 1.0 + if n % 2 == 0 { by } else { -by }).collect() };
    let raise = |logs: &[f64]| shape(logs, 0.5, 1e-4).expect("enough")[0];
    let many = raise(&alternating(200, 0.05));
    assert!(raise(&alternating(10, 0.05)) > many && raise(&alternating(200, 0.1)) > many);
    assert!(many > 1.0f64.exp() && shape(&alternating(7, 0.1), 0.5, 1e-4).is_none());
}
