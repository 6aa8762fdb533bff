//! What the loop says of chance and of worth: tails, degrees of freedom, trials, and errors in three stages.

use meshband_host::generate::{self, Scenario};
use meshband_host::model_based::base_fit::Base;
use meshband_host::model_based::candidate::Candidate;
use meshband_host::model_based::detect::Found;
use meshband_host::model_based::judge::{Judge, Judged, Split};
use meshband_host::model_based::library::{Bench, order};
use meshband_host::model_based::outcome::Evidence;
use meshband_host::model_based::probability::Probability;
use meshband_host::model_based::{Options, close_loop};
use meshband_host::observation::input::{self, Record};
use std::path::Path;

/// A record with nothing hidden but what `change` makes different.
fn generated(seed: u64, change: impl FnOnce(&mut Scenario)) -> Record {
    let declared = input::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("vectors/check-19-48")).unwrap();
    let mut scenario = Scenario::null(&declared.shafts, seed);
    change(&mut scenario);
    generate::record(&declared.pair, &declared.shafts, &declared.curve, &scenario).unwrap()
}

#[test]
fn ref_chi_square_tails_are_right_however_far_out() {
    // mpmath, 40 digits: log10 of the regularised upper incomplete gamma function.
    for (x, degrees, log10) in [
        (3.841_458_820_694_124, 1.0, -1.301_029_995_663_98),
        (18.307_038_053_275_146, 10.0, -1.301_029_995_663_98),
        (100.0, 2.0, -21.714_724_095_162_6),
        (700.0, 4.0, -149.457_761_549_672),
        (2000.0, 600.0, -149.149_144_815_563),
        (1500.0, 3.0, -324.230_586_495_745),
        (1e4, 2.0, -2_171.472_409_516_26),
        (1e5, 30.0, -21_659.878_801_836_9),
        (1e5, 480.0, -21_057.897_340_727_2),
    ] {
        let chance = Probability::chi_square_above(x, degrees);
        assert!((chance.log10() / log10 - 1.0).abs() < 1e-9, "{x} {degrees}: {}", chance.log10());
        assert!(chance.value() > 0.0);
    }
}

#[test]
fn theory_a_probability_is_never_zero_and_never_above_one() {
    let far = Probability::chi_square_above(1e4, 2.0);
    assert_eq!(far.to_string(), "< 1e-300");
    let json = serde_json::to_value(far).unwrap();
    assert!(json["p_value"].as_f64().unwrap() > 0.0 && json["log10_p"].as_f64().unwrap() < -2171.0, "{json}");
    assert_eq!(Probability::of(0.5).among(10.0_f64.ln()).value(), 1.0);
    assert_eq!(Probability::chi_square_above(0.0, 3.0).value(), 1.0);
    assert!((Probability::of(1e-4).among(10.0_f64.ln()).value() / 1e-3 - 1.0).abs() < 1e-12);
    assert_eq!(Probability::of(2e-7).to_string(), "2.0e-7");
    // Beside the other evidence, or absent where none is counted.
    let json = |chance| {
        serde_json::to_value(Evidence { chance, score_over_next: Some(900.0), ..Evidence::default() }).unwrap()
    };
    assert!((json(Some(far))["log10_p"].as_f64().unwrap() - far.log10()).abs() < 1e-9);
    assert_eq!(
        (&json(None)["p_value"], json(None)["score_over_next"].as_f64()),
        (&serde_json::Value::Null, Some(900.0))
    );
}

/// A force of fixed frequency, with a phase in every run, judged on a record with these torques at three speeds.
fn fixed_tone(torques_n_m: &[f64]) -> Judged {
    let record = generated(5, |scenario| {
        scenario.duration_s = 0.5;
        scenario.speeds_hz = vec![9.1, 16.3, 24.2];
        scenario.torques_n_m = torques_n_m.to_vec();
    });
    let base = Base::new(&record);
    let (data, bench) = (base.data(), Bench::new(&base));
    let all: Vec<usize> = (0..record.runs.len()).collect();
    let split = Split { fit: all.clone(), select: Vec::new(), held_out: Vec::new() };
    let found = Found { at: 100.0, statistic: 10.0, places: 1e4, modulation: false };
    let tone = order::at_frequency(&bench, &data, &all, found).remove(0);
    assert!(tone.phase_free);
    let judge = Judge::new(&base, &data, &split, &[]);
    let judged = judge.judge(tone.clone());
    judge.judge(tone);
    assert_eq!(judge.tried(), 2, "every score counts");
    Judged { gain: 60.0, ..judged }
}

#[test]
fn theory_chance_follows_the_runs_and_the_trials_of_the_record() {
    let [few, many] = [&[8.0][..], &[8.0, 20.0]].map(fixed_tone);
    assert_eq!((few.unknowns, many.unknowns), (4.0, 7.0), "one amplitude, and a phase per run");
    let log10 = |judged: &Judged, tests: f64| judged.chance(tests).log10();
    assert!(log10(&many, 100.0) > log10(&few, 100.0) + 1.0, "the same gain from more unknowns says less");
    assert!((log10(&few, 1000.0) - log10(&few, 10.0) - 2.0).abs() < 1e-9, "a hundred times as many trials");
    let scanned = |places: f64| Judged {
        candidate: Candidate { searched: 1.0, scanned: places, ..few.candidate.clone() },
        ..few.clone()
    };
    assert!((log10(&scanned(1e4), 10.0) - log10(&scanned(1.0), 10.0) - 4.0).abs() < 1e-9, "chosen from more places");
}

#[test]
fn loop_credits_wrong_parameters_to_the_calibration_and_no_effect() {
    let record = generated(61, |scenario| {
        scenario.duration_s = 1.0;
        scenario.stiffness_factor = 1.03;
        scenario.actual.bearing_stiffness_n_per_m[0] *= 1.03;
        scenario.actual.inertia_gear_kg_m2 *= 0.98;
    });
    let outcome = close_loop(&record, &Options::default()).unwrap();
    print!("{}", outcome.summary());
    assert!(outcome.effects.is_empty() && outcome.candidates_tried > 150, "{}", outcome.candidates_tried);
    for errors in [&outcome.error.fit_runs, &outcome.error.held_out_runs] {
        for (part, stages) in errors.parts() {
            assert!(stages.corrected == stages.calibrated, "{part}: {stages:?}");
            assert!(stages.calibrated < 1.1 * stages.noise_floor, "{part}: {stages:?}");
        }
        let sync = errors.shaft_synchronous;
        assert!(sync.calibrated < 0.7 * sync.declared, "{sync:?}");
    }
}
