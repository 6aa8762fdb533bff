//! Borders of what is taken: of ranges of the configuration, laws and tables, edges of a replayed record, marks and
//! edges of a shaft.

use meshband::config::{Configuration, ConfigurationError};
use meshband::events::{EventKind, EventLog};
use meshband::gear_condition::of_average;
use meshband::indicators::RunEnsemble;
use meshband::law::{LawError, LawForm, LawTable};
use meshband::order::{Discontinuity, OrderTracker};
use meshband::pipeline::{BLOCK_SAMPLES, Queues};
use meshband::replay::{Header, Replay, ReplayError, image_bytes, write};
use meshband::rise_time::{Polarity, RiseTime, RiseTimeConfig};
use meshband::units::{Hertz, TicksPerSecond};
use std::f64::consts::TAU;

const CLOCK: TicksPerSecond = TicksPerSecond(84_000_000);

#[test]
fn theory_an_edge_waits_until_its_instant_and_leaves_once_across_the_clock_s_wrap() {
    let buffers = Box::leak(Box::new([[0; BLOCK_SAMPLES]; 2]));
    let (mut outlets, mut inbox) = Box::leak(Box::new(Queues::new())).split(buffers);
    let edges = [u32::MAX - 10, 5, 20];
    edges.iter().for_each(|&edge| assert!(outlets.edges.enqueue(edge).is_ok()));
    assert_eq!(inbox.edge_before(u32::MAX - 10), None, "the instant itself is not before it");
    assert_eq!([inbox.edge_before(10), inbox.edge_before(10)], [Some(u32::MAX - 10), Some(5)]);
    assert_eq!([inbox.edge_before(10), inbox.edge_before(21), inbox.edge_before(21)], [None, Some(20), None]);
}

#[test]
fn fault_a_replayed_record_takes_no_edge_twice() {
    let header = Header::new(84_000_000, 1000, 100.0);
    let mut image = vec![0; image_bytes(0, 2, 4)];
    assert_eq!(write(&header, &[], &[5, 5], &[0; 4], &mut image), Err(ReplayError::Edges));
    assert_eq!(write(&header, &[], &[5, 6], &[0; 4], &mut image), Ok(image.len()));
}

#[test]
fn fault_a_replayed_record_lasts_less_than_a_turn_of_the_counter() {
    // 3855 times 1 114 129 is one tick less than the counter's turn.
    let written = |samples: usize| {
        let samples = vec![0; samples];
        let mut image = vec![0; image_bytes(0, 0, samples.len())];
        write(&Header::new(84_000_000, 3855, 100.0), &[], &[], &samples, &mut image).map(|_| ())
    };
    assert_eq!((written(1_114_129), written(1_114_130)), (Ok(()), Err(ReplayError::Length)));
}

#[test]
fn ref_a_replayed_record_gives_what_was_written_and_rounds_half_up_between_samples() {
    for forced in [None, Some(7)] {
        let header = Header { forced_period_ticks: forced, ..Header::new(84_000_000, 4, 100.0) };
        let mut image = vec![0; image_bytes(0, 1, 3)];
        write(&header, &[], &[5], &[0, 1, -3], &mut image).expect("room for it");
        let replay = Replay::parse(&image).expect("sound");
        assert_eq!((replay.header(), replay.edge(0), replay.edge(1)), (&header, Some(5), None));
        let codes: Vec<Option<u16>> = (0..=8).map(|tick| replay.code_at(tick)).collect();
        // 0, 1/4, 1/2, 3/4; 1, 0, -1, -2; behind the last pair nothing lies.
        let expected = [0, 0, 1, 1, 1, 0, -1, -2].map(|code: i32| Some((0x8000 + code) as u16));
        assert_eq!(codes, [&expected[..], &[None]].concat());
    }
}

#[test]
fn fault_each_border_of_the_tachometer_s_range_is_held() {
    let with = |lowest: f32, highest: f32| {
        let mut config = Configuration::default();
        (config.tach.lowest, config.tach.highest) = (Hertz(lowest), Hertz(highest));
        config.validate(CLOCK)
    };
    for (lowest, highest) in [(0.001, 10.0), (20.0, 10.0), (10.0, 10.0), (1.0, 1001.0), (f32::NAN, 10.0)] {
        assert_eq!(with(lowest, highest), Err(ConfigurationError::TachRange), "{lowest} to {highest}");
    }
    assert_eq!(with(0.01, 1000.0), Ok(()));
}

#[test]
fn fault_a_law_that_falls_below_zero_inside_its_domain_is_refused() {
    let mut law = Configuration::default().law;
    (law.lowest, law.highest) = (Hertz(1.0), Hertz(9.0));
    // 100 (f - 5)^2 - 100: positive at both ends and beyond, negative from 4 to 6 Hz.
    law.form = LawForm::Quadratic { a_per_hz: 100.0, b: -1000.0, c_hz: 2400.0 };
    assert_eq!(law.validate(), Err(LawError::Bandwidth));
    law.form = LawForm::Quadratic { a_per_hz: 100.0, b: -1000.0, c_hz: 2700.0 };
    assert_eq!(law.validate(), Ok(()));
}

#[test]
fn fault_received_tables_with_any_bad_number_are_refused() {
    let table = |knots: &[[f64; 2]]| -> LawTable {
        let knots: Vec<_> = knots
            .iter()
            .map(|[speed, bandwidth]| serde_json::json!({ "speed": speed, "bandwidth": bandwidth }))
            .collect();
        serde_json::from_value(knots.into()).expect("the shape of a table")
    };
    let mut law = Configuration::default().law;
    (law.lowest, law.highest) = (Hertz(1.0), Hertz(10.0));
    let mut judged = |knots: &[[f64; 2]]| {
        law.form = LawForm::Tabulated(table(knots));
        law.validate()
    };
    assert_eq!(judged(&[[1.0, 100.0], [10.0, 900.0]]), Ok(()));
    // Beyond single precision is infinite; bad knots lie between sound ones, where no end tells.
    for bad in [[5.0, -400.0], [5.0, 0.0], [5.0, 1e300], [-5.0, 400.0], [1.0, 400.0], [10.0, 400.0]] {
        let found = judged(&[[1.0, 100.0], bad, [10.0, 900.0]]);
        assert!(matches!(found, Err(LawError::Table | LawError::NotFinite)), "{bad:?}: {found:?}");
    }
    assert_eq!(judged(&[[1.0, 100.0]]), Err(LawError::Table));
}

#[test]
fn fault_a_turn_whose_first_samples_have_gone_is_an_overrun() {
    let mut tracker = Box::new(OrderTracker::<256>::new());
    let period = 100;
    tracker.push_samples(&[0.0; 256], 0, period).expect("continues");
    // The turn between the second and the third mark: the resampler needs four samples before it.
    for mark in [-80_i32, 3, 60, 120] {
        tracker.push_mark((mark * period as i32) as u32);
    }
    assert_eq!(tracker.next_turn().map(|turn| turn.is_some()), Err(Discontinuity::Overrun));
    let mut tracker = Box::new(OrderTracker::<256>::new());
    tracker.push_samples(&[0.0; 256], 0, period).expect("continues");
    for mark in [-80_i32, 4, 60, 120] {
        tracker.push_mark((mark * period as i32) as u32);
    }
    assert_eq!(tracker.next_turn().map(|turn| turn.is_some()), Ok(true));
}

#[test]
fn fault_an_edge_longer_than_the_window_is_counted_and_not_timed() {
    let config = RiseTimeConfig { polarity: Polarity::Rising, minimum_height: 0.5 };
    let mut long = RiseTime::<64>::new(config, 400.0);
    let edges = (0..2000).filter_map(|n| long.push(f64::min((n % 400) as f64 / 200.0, 1.0) as f32)).count();
    assert_eq!(edges, 0);
    assert!(long.too_long >= 4, "{}", long.too_long);
}

#[test]
fn ref_indicators_of_a_pure_mesh_tone() {
    let teeth = 19;
    let average: Vec<f32> =
        (0..1024).map(|i| (2.0 * (TAU * f64::from(teeth) * f64::from(i) / 1024.0).sin()) as f32).collect();
    let (mut work, mut split) = (vec![0.0; 1024], vec![0.0; 1024]);
    let mut ensemble = RunEnsemble::default();
    let found =
        of_average(&average, teeth as u16, |run| ensemble.add(run), &mut work, &mut split).expect("a power of two");
    let near = |value: f32, expected: f64| assert!((f64::from(value) - expected).abs() < 1e-3, "{value} {expected}");
    near(found.rms, 2.0_f64.sqrt());
    near(found.crest, 2.0_f64.sqrt());
    near(found.kurtosis, 1.5);
    near(found.regular_rms, 2.0_f64.sqrt());
    near(found.residual_rms, 0.0);
    near(found.difference_rms, 0.0);
    // Peak to peak over the mesh line's amplitude.
    near(found.fm0, 2.0);
}

#[test]
fn theory_the_last_kind_of_event_is_counted_like_the_first() {
    let mut log = EventLog::new(CLOCK);
    for kind in [EventKind::Update, EventKind::Update, EventKind::TachLocked] {
        log.record(kind, 0, 0);
    }
    assert_eq!([log.count(EventKind::Update), log.count(EventKind::TachLocked)], [2, 1]);
}
