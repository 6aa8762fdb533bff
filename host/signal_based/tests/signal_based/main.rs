//! Signal-based inference on generated records of the measured kind: what is in them is found and named, what is
//! not is not.

mod adverse;
mod bearing_slip;
mod carried;
mod gate;
mod generator;
mod names;
mod neighbours;
mod run_up;
mod stages;
mod strength;
mod trains;

use generator::{BENCH, Bench, Impacts, Line};
use meshband_host::record::Record;
use meshband_host::signal_based::baseline::Baseline;
use meshband_host::signal_based::outcome::{Effect, Outcome};
use meshband_host::signal_based::preflight::Preflight;
use meshband_host::signal_based::scene::Scene;
use meshband_host::signal_based::{self, view};

/// A record that takes a fraction of a second.
const SMALL_BENCH: Bench = Bench { seconds: 6.0, rate_hz: 4096.0, speed_hz: 16.0, channels: 1, ..BENCH };

fn of_record(record: &Record) -> Outcome {
    signal_based::run(record, &Preflight::of(record)).expect("signal-based inference")
}

fn loop_of(bench: &Bench, lines: &[Line], impacts: &[Impacts]) -> Outcome {
    of_record(&bench.record(lines, impacts))
}

fn only(outcome: &Outcome) -> &Effect {
    assert_eq!(outcome.effects.len(), 1, "{}", view::text(outcome));
    &outcome.effects[0]
}

/// The only effect: verdict, family and shaft, and a part of its name.
fn expect(outcome: &Outcome, verdict: &str, family: &str, shaft: &str, name: &str) {
    let effect = only(outcome);
    assert_eq!([&effect.verdict, &effect.family, &effect.shaft], [verdict, family, shaft], "{}", view::text(outcome));
    assert!(effect.name.contains(name), "{} lacks {name}", effect.name);
}

fn order(order: f64, amplitude: f64) -> Line {
    Line { order, hz: 0.0, amplitude, phase: 1.0 }
}

fn tone(hz: f64, amplitude: f64) -> Line {
    Line { order: 0.0, hz, amplitude, phase: 1.0 }
}

const IMPACTS: Impacts = Impacts { order: 3.583, amplitude: 2.0, slip: 0.01, modulation: None };

#[test]
fn fault_runout_of_either_gear_is_a_modulation_by_its_shaft_and_predicts_the_waveform() {
    for (own, shaft) in [(BENCH.gear_order(), "gear"), (1.0, "pinion")] {
        let outcome = loop_of(&BENCH, &BENCH.modulation(own, 0.1, 1), &[]);
        expect(&outcome, "ambiguous", "sideband", shaft, &format!("{shaft}-eccentricity"));
        let held = outcome.held_out;
        assert!(held.corrected < 0.5 * held.calibrated && held.corrected < 1.2 * held.noise_floor, "{held:?}");
    }
}

#[test]
fn fault_a_runout_is_found_in_a_run_up() {
    let bench = Bench { speed_hz: 12.0, run_up: 2.0, ..BENCH };
    let outcome = loop_of(&bench, &bench.modulation(bench.gear_order(), 0.1, 1), &[]);
    expect(&outcome, "ambiguous", "sideband", "gear", "gear-eccentricity");
    assert!(outcome.speed_functions[0] > 3 && outcome.split.runs[0].1.held_out.len() > 1);
}

#[test]
fn fault_low_shaft_orders_and_ghosts_are_told_apart() {
    expect(&loop_of(&BENCH, &[order(1.0, 0.3)], &[]), "ambiguous", "shaft-order", "pinion", "pinion-imbalance");
    expect(&loop_of(&BENCH, &[order(37.0, 0.1)], &[]), "named", "shaft-order", "pinion", "pinion-ghost-order");
}

#[test]
fn fault_one_tooth_of_either_gear_is_one_tooth() {
    for (own, shaft) in [(1.0, "pinion"), (BENCH.gear_order(), "gear")] {
        let pulse = Impacts { order: own, slip: 0.0, ..IMPACTS };
        let outcome = loop_of(&BENCH, &[], &[pulse]);
        expect(&outcome, "ambiguous", "impulsive", shaft, &format!("{shaft}-tooth-crack"));
    }
}

#[test]
fn fault_passages_are_read_from_their_envelope_the_inner_ring_with_its_shaft() {
    let outer = loop_of(&BENCH, &[], &[IMPACTS]);
    expect(&outer, "named", "non-integer-order", "none", "bearing-impacts");
    assert!((only(&outer).order_of_pinion.expect("an order") / 3.583 - 1.0).abs() < 2e-3);
    let inner = loop_of(&BENCH, &[], &[Impacts { order: 5.413, modulation: Some((1.0, 0.9)), ..IMPACTS }]);
    expect(&inner, "named", "non-integer-order", "pinion", "inner ring");
    assert!((only(&inner).order_of_pinion.expect("an order") / 5.413 - 1.0).abs() < 2e-3);
}

#[test]
fn fault_an_order_of_nothing_is_not_named() {
    let outcome = loop_of(&BENCH, &[order(2.10, 0.3), order(4.20, 0.2)], &[]);
    expect(&outcome, "generic", "non-integer-order", "none", "unexplained order 2.100");
}

#[test]
fn fault_what_stands_at_a_frequency_is_told_from_an_order() {
    expect(
        &loop_of(&BENCH, &[tone(50.0, 0.3), tone(100.0, 0.3)], &[]),
        "named",
        "fixed-frequency",
        "none",
        "mains-hum",
    );
    expect(&loop_of(&BENCH, &[tone(777.0, 0.1)], &[]), "named", "fixed-frequency", "none", "fixed-tone");
}

#[test]
fn fault_a_slow_swing_of_the_load_is_said() {
    let sideband = |m: Line, side: f64| Line { hz: 2.0 * side, amplitude: 0.1 * m.amplitude, ..m };
    let lines: Vec<Line> = BENCH.mesh().into_iter().flat_map(|m| [-1.0, 1.0].map(|side| sideband(m, side))).collect();
    expect(&loop_of(&BENCH, &lines, &[]), "ambiguous", "non-stationary", "none", "load-fluctuation");
}

#[test]
fn fault_a_limited_channel_is_clipping() {
    let outcome = of_record(&BENCH.limited(&BENCH.record(&[], &[]), 0, 0.7));
    expect(&outcome, "named", "other", "none", "clipping");
}

#[test]
fn fault_a_wrong_tach_or_tooth_count_is_said_and_nothing_named() {
    let off = loop_of(&Bench { tach_off: 1.01, ..BENCH }, &BENCH.modulation(1.0, 0.1, 1), &[]);
    assert!(off.headline.contains("0.990") && off.effects.is_empty() && off.limits.is_empty(), "{}", off.headline);
    let mut record = BENCH.record(&[], &[]);
    record.declaration = Bench { teeth: [24, 61], ..BENCH }.record(&[], &[]).declaration;
    let outcome = of_record(&record);
    assert!(outcome.headline.contains("as 23 teeth") && outcome.effects.is_empty(), "{}", outcome.headline);
}

#[test]
fn theory_nothing_is_added_to_forty_nulls_with_wander_runs_up_and_coloured_noise() {
    for seed in 200..240_u32 {
        let run_up = if seed % 4 == 0 { 1.5 } else { 1.0 };
        let wander = 0.002 * f64::from(seed % 5);
        let noise = [0.05, 0.2, 0.5][seed as usize % 3];
        let outcome = loop_of(&Bench { seed: u64::from(seed), run_up, wander, noise, ..SMALL_BENCH }, &[], &[]);
        assert!(outcome.effects.is_empty(), "seed {seed}: {}", view::text(&outcome));
    }
}

/// Orders with amplitudes of their own in each channel, as the limits state strengths.
fn at_strength(bench: &Bench, record: &Record, orders: &[f64], strength: f64, beside: bool) -> Record {
    let tach = record.require_tach().expect("a tach");
    let scene = Scene::of(record, tach, bench.teeth).expect("a scene");
    let baseline = Baseline::of(&scene);
    let amplitude = |c: usize, order: f64| match beside {
        true => strength * baseline.nearest_mesh(&scene, 0, c, order),
        false => strength * baseline.strongest_mesh(&scene, 0, c),
    };
    let line = |c: usize, o: f64| Line { phase: 7.0 * o + c as f64, ..order(o, amplitude(c, o)) };
    let lines: Vec<Vec<Line>> = (0..bench.channels).map(|c| orders.iter().map(|o| line(c, *o)).collect()).collect();
    bench.injected(record, &lines)
}

#[test]
fn ref_limits_agree_with_real_injections_into_the_record() {
    let bench = Bench { seconds: 10.0, ..BENCH };
    let record = bench.record(&[], &[]);
    let limits = of_record(&record).limits;
    let gear = bench.gear_order();
    let sidebands: Vec<f64> = (1..=6).flat_map(|k| [-gear, gear].map(|side| 23.0 * f64::from(k) + side)).collect();
    let harmonics: Vec<f64> = (1..=8).map(|j| 3.637 * f64::from(j)).collect();
    for (family, orders, beside) in
        [("modulation of the mesh by the gear", sidebands, true), ("harmonics of an order", harmonics, false)]
    {
        let limit = limits.iter().find(|l| l.family.starts_with(family)).expect("a limit");
        let half = limit.found_in_half.expect("found at some strength");
        let found =
            |strength: f64| !of_record(&at_strength(&bench, &record, &orders, strength, beside)).effects.is_empty();
        assert!(!found(half / 2.0), "{family}: found at half of {half}");
        assert!(found(half * 2.0), "{family}: missed at twice {half}");
    }
}

#[test]
fn theory_volts_are_used_as_they_are_and_the_preflight_lists_all_that_is_missing() {
    let record = Bench { unit: Some("V".into()), ..SMALL_BENCH }.record(&SMALL_BENCH.modulation(1.0, 0.1, 1), &[]);
    let preflight = Preflight::of(&record);
    let missing = preflight.for_model_based.join("; ");
    for part in
        ["angle 0", "machine", "stiffness", "two channels", "acceleration", "'V'", "torque of run 0", "3 speeds"]
    {
        assert!(missing.contains(part), "{part} not in: {missing}");
    }
    let outcome = of_record(&record);
    assert_eq!((outcome.unit.as_str(), outcome.level), ("V", "signal-based"));
    assert_eq!(only(&outcome).parameters["strongest_line"].unit, "V");
}
