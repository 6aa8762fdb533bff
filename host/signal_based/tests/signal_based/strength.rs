//! The course of strength: a swing of the load stands in it, an angle that swings and a speed that wanders do not.

use super::generator::{BENCH, Bench, Line};
use super::{expect, loop_of, view};
use meshband_host::signal_based::baseline::Baseline;
use meshband_host::signal_based::mesh_amplitude_demodulation::Strength;
use meshband_host::signal_based::scene::Scene;
use std::f64::consts::PI;

const HZ: f64 = 1.9;

/// Sidebands that make every mesh line swing by twice the share: its strength, or its angle.
pub fn swing(bench: &Bench, share: f64, of_angle: bool) -> Vec<Line> {
    let sideband = |m: &Line, side: f64| {
        let turned = if of_angle { 0.5 * PI } else { 0.0 };
        Line { hz: HZ * side, amplitude: share * m.amplitude, phase: m.phase + turned, ..*m }
    };
    bench.mesh().iter().flat_map(|m| [-1.0, 1.0].map(|side| sideband(m, side))).collect()
}

fn of(bench: &Bench, lines: &[Line]) -> (Scene, Strength) {
    let record = bench.record(lines, &[]);
    let scene = Scene::of(&record, record.require_tach().expect("a tach"), bench.teeth).expect("a scene");
    let strength = Strength::of(&scene, &Baseline::of(&scene).calibrated);
    (scene, strength)
}

/// Highest power over the floor in any channel, and its order.
fn highest(strength: &Strength) -> (f64, f64) {
    let spectra = &strength.spectra;
    let bins = (spectra.lowest / spectra.bin(0)).ceil() as usize..(spectra.highest / spectra.bin(0)) as usize;
    let of_channel = |channel: usize| {
        let spectra = &spectra;
        bins.clone().filter_map(move |i| {
            let order = i as f64 * spectra.bin(0);
            spectra.reading(0, channel, 0, order, 0).map(|reading| (reading.ratio, order))
        })
    };
    (0..2).flat_map(of_channel).max_by(|a, b| a.0.total_cmp(&b.0)).expect("bins")
}

#[test]
fn theory_a_swing_of_the_strength_stands_in_it_and_one_of_the_angle_does_not() {
    for seed in 1..6 {
        let bench = Bench { seed, ..BENCH };
        let (scene, strength) = of(&bench, &swing(&bench, 0.01, false));
        let (ratio, order) = highest(&strength);
        let true_order = HZ / bench.speed_hz;
        assert!(ratio > 50.0 && (order - true_order).abs() < 1.5 * strength.spectra.bin(0), "{seed}: {ratio} {order}");
        let refined = strength.refined(&scene, 0..2, order);
        assert!((refined - true_order).abs() < 0.1 * strength.spectra.bin(0), "{seed}: {refined}");
        let [own, other] = [refined, 1.4 * refined].map(|order| strength.held_out(&scene, 0..2, order));
        assert!(own.ln_bayes > 20.0 && own.agrees() && !other.agrees(), "{seed}: {own:?} {other:?}");
        for lines in [swing(&bench, 0.01, true), Vec::new()] {
            let (ratio, order) = highest(&of(&bench, &lines).1);
            assert!(ratio < 20.0, "{seed}: {ratio} {order}");
        }
    }
}

#[test]
fn theory_what_a_fast_wander_leaves_at_the_ends_of_a_run_does_not_move_the_swing() {
    for seed in 1..4 {
        let bench = Bench { seed, wander: 0.012, ..BENCH };
        let (scene, strength) = of(&bench, &swing(&bench, 0.01, false));
        let (_, order) = highest(&strength);
        let refined = strength.refined(&scene, 0..2, order);
        let held = strength.held_out(&scene, 0..2, refined);
        let bins = (refined - HZ / bench.speed_hz).abs() / strength.spectra.bin(0);
        assert!(bins < 0.3 && held.agrees() && held.ln_bayes > 10.0, "{seed}: {bins} {held:?}");
    }
}

#[test]
fn fault_a_load_that_swings_by_a_fiftieth_is_found_though_the_speed_wanders() {
    let outcome = loop_of(&BENCH, &swing(&BENCH, 0.01, false), &[]);
    expect(&outcome, "ambiguous", "non-stationary", "none", "load-fluctuation");
    let order = outcome.effects[0].order_of_pinion.expect("an order");
    assert!((order - HZ / BENCH.speed_hz).abs() < 1e-3, "{order} {}", view::text(&outcome));
}

#[test]
fn theory_in_a_run_up_a_swing_stands_at_its_frequency_over_the_mean_speed() {
    for seed in 1..4 {
        let bench = Bench { seed, speed_hz: 12.0, run_up: 2.0, ..BENCH };
        let (scene, strength) = of(&bench, &swing(&bench, 0.01, false));
        let run = &scene.runs[0];
        let [first, last] = [0.0, run.angle.turns as f64].map(|turn| run.angle.map.time_at(run.angle.from_turn + turn));
        let true_order = HZ * (last - first) / run.angle.turns as f64;
        let (ratio, order) = highest(&strength);
        assert!(ratio > 30.0 && (order - true_order).abs() < 1.5 * strength.spectra.bin(0), "{seed}: {ratio} {order}");
        let [own, other] = [order, 1.4 * order].map(|order| {
            let refined = strength.refined(&scene, 0..2, order);
            strength.held_out(&scene, 0..2, refined)
        });
        assert!(own.ln_bayes > 10.0 && own.agrees() && !other.agrees(), "{seed}: {own:?} {other:?}");
        let (ratio, order) = highest(&of(&bench, &[]).1);
        assert!(ratio < 15.0, "{seed}: {ratio} {order}");
    }
}
