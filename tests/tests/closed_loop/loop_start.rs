//! Where a run starts in the hunting period: an unknown of the record that the loop finds together with the effect.

use meshband_host::generate::{self, Scenario};
use meshband_host::machine::{Freedom, Hunting};
use meshband_host::model_based::base_fit::Base;
use meshband_host::model_based::library::{Bench, order};
use meshband_host::model_based::start::{self, Products, Start};
use meshband_host::model_based::{Options, Outcome, close_loop};
use meshband_host::observation::input;
use meshband_host::observation::spectrum::Sparse;
use rustfft::num_complex::Complex64 as C;
use std::f64::consts::TAU;
use std::path::Path;

fn declared(machine: &str) -> input::Record {
    input::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("vectors").join(machine)).unwrap()
}

fn outcome(machine: &str, effect: String, seed: u64) -> Outcome {
    let declared = declared(machine);
    let mut scenario = Scenario::null(&declared.shafts, seed);
    scenario.duration_s = 1.0;
    scenario.effects = vec![effect];
    let record = generate::record(&declared.pair, &declared.shafts, &declared.curve, &scenario).unwrap();
    let outcome = close_loop(&record, &Options::default()).unwrap();
    print!("seed {seed}: {}", outcome.summary());
    outcome
}

#[test]
fn theory_only_orders_of_the_pinion_do_not_depend_on_the_start() {
    let hunting = Hunting::of([19, 48]);
    assert_eq!((hunting.turns, Hunting::of([55, 75]).turns, Hunting::of([20, 40]).turns), (48, 15, 2));
    let ratio = 19.0 / 48.0;
    assert_eq!(hunting.freedom(&[31.0]), Freedom::None);
    assert_eq!(hunting.freedom(&[ratio]), Freedom::Turns);
    assert_eq!(hunting.freedom(&[ratio, 2.0 * ratio, 48.0 * ratio]), Freedom::Turns);
    assert_eq!(hunting.freedom(&[3.57]), Freedom::Phase);
    assert_eq!(Hunting::of([20, 20]).freedom(&[1.0]), Freedom::None);
}

#[test]
fn theory_turned_templates_are_those_of_a_later_start() {
    let declared = declared("check-19-48");
    let mut scenario = Scenario::null(&declared.shafts, 3);
    scenario.duration_s = 0.5;
    scenario.speeds_hz = vec![14.1];
    let record = generate::record(&declared.pair, &declared.shafts, &declared.curve, &scenario).unwrap();
    let (base, mut later) = (Base::new(&record), Base::new(&record));
    let turns = vec![5, 31];
    for (run, k) in later.runs.iter_mut().zip(&turns) {
        run.angle.offset_rad += TAU * f64::from(*k);
    }
    let (bench, later) = (Bench::new(&base), Bench::new(&later));
    let ratio = bench.ratio();
    for (at, start) in [
        (ratio, Start::Turns(turns.clone())),
        (2.0 * ratio, Start::Given(turns.clone())),
        (3.57, Start::Phases(turns.iter().map(|k| TAU * 3.57 * f64::from(*k)).collect())),
    ] {
        let all = order::at_order(&bench, at, 1.0).into_iter().zip(order::at_order(&later, at, 1.0));
        for (candidate, expected) in all {
            let turned = candidate.started(start.clone());
            for (own, other) in turned.templates.iter().zip(&expected.templates) {
                for (run, (a, b)) in own.runs.iter().zip(&other.runs).enumerate() {
                    for channel in 0..2 {
                        let dense = |list: &Sparse| {
                            let mut bins = vec![C::ZERO; base.analyser.bins];
                            list.iter().for_each(|(bin, value)| bins[bin] = value);
                            bins
                        };
                        let (a, b) = (dense(&a[channel]), dense(&b[channel]));
                        let off: f64 = a.iter().zip(&b).map(|(a, b)| (a - b).norm_sqr()).sum();
                        let size: f64 = b.iter().map(|b| b.norm_sqr()).sum();
                        // Rounding to single precision, twice.
                        assert!(off <= 1e-13 * size, "{} at {at}, run {run}: {off} of {size}", candidate.name);
                    }
                }
            }
        }
    }
}

#[test]
fn theory_turns_are_found_from_products_in_noise() {
    let hunting = Hunting::of([19, 48]);
    let orders: Vec<f64> = (1..=24).map(|m| f64::from(m) * hunting.ratio).collect();
    let truth = [0, 17, 4, 33, 47, 20, 11, 8];
    // A table of teeth; the noise is a fixed sequence of a third of its size.
    let table: Vec<C> = (0..24).map(|m| C::cis(1.7 * f64::from(m * m)) * (1.0 + 0.3 * f64::from(m % 5))).collect();
    let mut state = 1_u64;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / f64::from(1_u32 << 24) - 0.5
    };
    let runs: Vec<Products> = truth
        .iter()
        .map(|&k: &u32| Products {
            right: table
                .iter()
                .zip(&orders)
                .map(|(x, o)| x * C::cis(TAU * o * f64::from(k)) + C::new(noise(), noise()))
                .collect(),
            energy: vec![1.0; orders.len()],
        })
        .collect();
    // The last two runs are held out: they follow what the others gave.
    assert_eq!(start::turns(&runs, &orders, &[0, 1, 2, 3, 4, 5], hunting), Start::Turns(truth.to_vec()));
}

fn names_a_gear_pitch_error(machine: &str) {
    let outcome = outcome(machine, "pitch-error:single=0.4e-6,tooth=11,gear=1".into(), 21);
    let [found] = &outcome.effects[..] else { panic!("one effect: {:?}", outcome.effects) };
    assert_eq!((found.verdict.as_str(), found.name.as_str()), ("named", "gear-pitch-error"));
    let turns = found.pinion_turns_of_runs.as_ref().expect("runs start at different turns");
    assert!(turns.len() == 8 && turns[0] == 0 && turns.iter().any(|k| *k > 0), "{turns:?}");
    // Beside the noise stays what the tachometer's jitter does to the mesh orders, which grows with the number of
    // teeth.
    let held = outcome.error.held_out_runs.shaft_synchronous;
    assert!(held.corrected < 1.8 * held.noise_floor && held.declared > 1.8 * held.corrected, "{held:?}");
}

#[test]
fn loop_names_a_gear_pitch_error_of_runs_started_anywhere() {
    names_a_gear_pitch_error("check-19-48");
}

#[test]
#[ignore = "long: cargo xtask test-long"]
fn loop_names_a_gear_pitch_error_of_another_pair() {
    names_a_gear_pitch_error("check-55-75");
}

#[test]
fn loop_names_a_bearing_that_modulates_at_an_order_of_neither_shaft() {
    let (order, share) = (3.5713, 0.02);
    let per_turn = order * 48.0 / 19.0;
    let effect = format!("bearing-stiffness-modulation:share={share},order={per_turn},phase=0.4,gear=1");
    let outcome = outcome("check-19-48", effect, 22);
    let [found] = &outcome.effects[..] else { panic!("one effect: {:?}", outcome.effects) };
    assert_eq!((found.verdict.as_str(), found.name.as_str()), ("named", "bearing-stiffness-modulation"));
    assert!((found.order_of_pinion.unwrap() - order).abs() < 1e-3, "{:?}", found.order_of_pinion);
    let value = &found.parameters["share_of_stiffness"];
    assert!(value.ci95[0] < share && share < value.ci95[1], "{value:?}");
    assert_eq!(found.phase_of_runs_rad.as_ref().expect("a phase per run").len(), 8);
}
