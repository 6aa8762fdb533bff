//! What the loop says it would have found, and how it behaves behind what distorts a record.

use meshband_host::closed_loop::base_fit::Base;
use meshband_host::closed_loop::bootstrap::{NullRecords, null_record};
use meshband_host::closed_loop::generate::{self, Scenario};
use meshband_host::closed_loop::{Options, Outcome, close_loop};
use meshband_host::observation::input::{self, Record};
use std::path::Path;

fn generated(effects: &[String], seed: u64) -> Record {
    let declared = input::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("vectors/check-19-48")).unwrap();
    let mut scenario = Scenario::null(&declared.shafts, seed);
    scenario.duration_s = 0.6;
    scenario.effects = effects.to_vec();
    generate::record(&declared.pair, &declared.shafts, &declared.curve, &scenario).unwrap()
}

fn outcome(record: &Record, limits: bool) -> Outcome {
    let outcome = close_loop(record, &Options { limits, ..Options::default() }).unwrap();
    print!("{}", outcome.summary());
    outcome
}

#[test]
fn loop_finds_what_it_says_that_it_would_find_and_not_a_fifth_of_it() {
    let plain = outcome(&generated(&[], 81), true);
    assert!(plain.effects.is_empty());
    let limit = |name: &str| {
        let limit = plain.limits.iter().find(|l| l.family == name).expect(name);
        assert!(limit.found_in_half <= limit.found_in_90_percent && limit.places > 1, "{limit:?}");
        limit.found_in_half.expect(name)
    };
    for (name, effect) in [
        ("pinion-eccentricity", "eccentricity:phase=0.8,amplitude"),
        ("pinion-tooth-crack", "tooth-crack:tooth=4,loss"),
        ("wear", "wear:depth"),
    ] {
        let at = |times: f64| outcome(&generated(&[format!("{effect}={}", times * limit(name))], 82), false);
        assert!(!at(3.0).effects.is_empty(), "{name} at three times its limit");
        assert!(at(0.2).effects.is_empty(), "{name} at a fifth of its limit");
    }
}

#[test]
fn theory_a_bootstrap_counts_the_record_itself() {
    let others: Vec<f64> = (0..19).map(f64::from).collect();
    let of = |score: f64| NullRecords::of(score, &others);
    assert_eq!((of(100.0).at_least, of(100.0).probability), (0, 0.05));
    assert_eq!((of(-1.0).at_least, of(-1.0).probability), (19, 1.0));
    assert_eq!(of(9.0).probability, 0.55);
}

#[test]
fn theory_a_bootstrap_record_has_the_machine_and_the_noise_of_its_record() {
    let record = generated(&[], 83);
    let base = Base::new(&record);
    let null = Base::new(&null_record(&record, &base, 1, 0));
    let power =
        |base: &Base| -> f64 { base.data().residual.iter().flatten().flatten().map(|x| x.norm_sqr()).sum::<f64>() };
    let noise = |base: &Base| base.runs.iter().flat_map(|r| &r.noise).flatten().sum::<f64>();
    let ratio = noise(&null) / noise(&base);
    assert!((ratio - 1.0).abs() < 0.05, "noise {ratio}");
    let ratio = power(&null) / power(&base);
    assert!((ratio - 1.0).abs() < 0.1, "residual {ratio}");
    assert_ne!(record.runs[0].edges_s, null_record(&record, &base, 1, 1).runs[0].edges_s);
}

#[test]
fn loop_finds_an_effect_behind_clipping_and_behind_a_moving_speed() {
    let runout = "eccentricity:amplitude=60e-6,phase=1.1,gear=0".to_string();
    let quiet = generated(std::slice::from_ref(&runout), 84);
    let peak = quiet.runs.iter().flat_map(|r| &r.channels[0]).fold(0.0_f64, |m, x| m.max(x.abs()));
    for (name, distortion) in [
        ("clipping", format!("clipping:limit={},channel=0", 0.7 * peak)),
        ("speed-fluctuation", "speed-fluctuation:angle=0.004,order=0.3958333333".to_string()),
    ] {
        let found = outcome(&generated(&[runout.clone(), distortion], 84), false);
        let named = |name: &str| found.effects.iter().any(|e| e.name == name && e.verdict == "named");
        assert!(named(name) && named("pinion-eccentricity"), "{:?}", found.headline);
    }
}
