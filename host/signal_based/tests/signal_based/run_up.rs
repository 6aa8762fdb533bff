//! Run-ups: mesh lines swept through the path's resonances are predicted where they were not fitted, and what stands
//! beside them is found.

use super::generator::{BENCH, Bench, Impacts};
use super::strength::swing;
use super::{IMPACTS, expect, loop_of, order, tone, view};
use meshband_host::signal_based::baseline::Baseline;
use meshband_host::signal_based::mesh_amplitude_demodulation::Strength;
use meshband_host::signal_based::nonsynchronous::power;
use meshband_host::signal_based::path_angle;
use meshband_host::signal_based::scene::Scene;
use std::f64::consts::TAU;

/// Twice the speed at the end: every mesh line crosses several of the six modes.
fn run_up() -> Bench {
    Bench { speed_hz: 12.0, run_up: 2.0, ..BENCH }
}

#[test]
fn theory_mesh_lines_are_predicted_through_resonances_in_turns_that_were_not_fitted() {
    for seed in 1..4 {
        let outcome = loop_of(&Bench { seed, noise: 0.03, ..run_up() }, &[], &[]);
        let held = outcome.held_out;
        assert!(held.calibrated < 0.35 * held.declared && held.calibrated < 3.0 * held.noise_floor, "{seed}: {held:?}");
        assert!(outcome.effects.is_empty(), "{}", view::text(&outcome));
    }
}

#[test]
fn fault_harmonics_that_are_folded_at_some_speeds_only_are_found() {
    // Whole mesh orders: at 12 turns/s hardly beyond half the rate, at 24 beyond all of it.
    let outcome = loop_of(&run_up(), &[order(17.0 * 23.0, 0.1), order(18.0 * 23.0, 0.1)], &[]);
    expect(&outcome, "named", "mesh-order", "pinion", "aliasing");
}

#[test]
fn fault_a_tone_among_the_frequencies_that_mesh_lines_sweep_is_found() {
    expect(&loop_of(&run_up(), &[tone(777.0, 0.1)], &[]), "named", "fixed-frequency", "none", "fixed-tone");
}

#[test]
fn fault_one_tooth_is_found_though_the_path_turns_its_lines() {
    let pulse = Impacts { order: 1.0, slip: 0.0, ..IMPACTS };
    expect(&loop_of(&run_up(), &[], &[pulse]), "ambiguous", "impulsive", "pinion", "pinion-tooth-crack");
}

#[test]
fn fault_a_low_order_of_a_shaft_is_found() {
    expect(&loop_of(&run_up(), &[order(1.0, 0.3)], &[]), "ambiguous", "shaft-order", "pinion", "pinion-imbalance");
}

#[test]
fn theory_sidebands_are_predicted_where_they_were_not_fitted() {
    for (own, shaft) in [(BENCH.gear_order(), "gear"), (1.0, "pinion")] {
        let outcome = loop_of(&Bench { noise: 0.05, ..run_up() }, &BENCH.modulation(own, 0.1, 1), &[]);
        expect(&outcome, "ambiguous", "sideband", shaft, &format!("{shaft}-eccentricity"));
        let held = outcome.held_out;
        assert!(held.corrected < 0.35 * held.calibrated, "{held:?}");
    }
}

#[test]
fn fault_a_swing_of_the_load_is_found_where_the_tach_has_pulses_and_not_asked_for_where_it_has_none() {
    let lines = swing(&run_up(), 0.01, false);
    expect(&loop_of(&run_up(), &lines, &[]), "ambiguous", "non-stationary", "none", "load-fluctuation");
    let mut record = run_up().record(&lines, &[]);
    record.declaration.tach.as_mut().expect("a tach").source = Some("virtual".into());
    let scene = Scene::of(&record, record.require_tach().expect("a tach"), BENCH.teeth).expect("a scene");
    let spectra = Strength::of(&scene, &Baseline::of(&scene).calibrated).spectra;
    assert!(spectra.levels[0].iter().all(|levels| levels[0].density.values.iter().all(|x| *x == 1.0)));
}

#[test]
fn theory_an_angle_that_wriggles_as_mesh_lines_turn_is_told_from_the_path_that_turns_them() {
    let bench = Bench { noise: 0.03, ..run_up() };
    let of = |wriggle: f64| {
        let mut record = bench.record(&[], &[]);
        // A thousandth of a turn, a radian at the seventh harmonic: what a virtual tach leaves beside a resonance.
        for edge in &mut record.runs[0].edges_s {
            *edge += wriggle * (TAU * 0.7 * *edge).sin() / 18.0;
        }
        record.declaration.tach.as_mut().expect("a tach").source = Some("virtual".into());
        let mut scene = Scene::of(&record, record.require_tach().expect("a tach"), BENCH.teeth).expect("a scene");
        let before = Baseline::of(&scene);
        let left = |scene: &Scene, baseline: &Baseline| -> f64 {
            let run = &scene.runs[0];
            let power = |samples: &[f64]| power(samples, run.angle.per_turn[0], &run.split.fit);
            baseline.calibrated[0].iter().zip(&run.samples).map(|(left, all)| power(left) / power(all)).sum()
        };
        let own = left(&scene, &before);
        let fitted = path_angle::fitted(&mut scene);
        [own, left(&scene, &fitted)]
    };
    let ([_, clean], [before, after]) = (of(0.0), of(1e-3));
    assert!(before > 100.0 * clean && after < 0.05 * before, "{clean} {before} {after}");
}
