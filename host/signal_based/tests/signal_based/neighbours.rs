//! What stands beside something else: an order next to a shaft's own, knocks beside mesh lines that swing, a tone
//! over as long a stretch as there is.

use super::generator::{BENCH, Bench, Impacts, Line};
use super::{IMPACTS, expect, loop_of, order, tone, view};
use meshband_host::analysis::search::Level;
use meshband_host::signal_based::baseline::Baseline;
use meshband_host::signal_based::candidate::{Candidate, Domain, Kind, Place};
use meshband_host::signal_based::residual_spectra::views;
use meshband_host::signal_based::scene::Scene;
use meshband_host::signal_based::search::{Adopted, nothing, search};
use meshband_host::signal_based::second_pass::search_after_veto;
use meshband_host::signal_based::split::{Split, Stretch};

/// A pair whose gear has many whole orders near those of the pinion, in a run-up of short stretches.
const NEAR_UNITY_BENCH: Bench = Bench { teeth: [39, 42], speed_hz: 10.0, run_up: 1.7, seconds: 10.0, ..BENCH };
/// The order 67 of its gear, next to the order 62 of its pinion.
const GHOST: f64 = 67.0 * 39.0 / 42.0;

fn of_fit(split: &Split) -> &[Stretch] {
    &split.fit
}

fn of_held_out(split: &Split) -> &[Stretch] {
    &split.held_out
}

fn scene(bench: &Bench) -> Scene {
    let record = bench.record(&[], &[]);
    Scene::of(&record, record.require_tach().expect("a tach"), bench.teeth).expect("a scene")
}

#[test]
fn fault_a_ghost_of_the_gear_within_the_lobe_of_a_quiet_order_of_the_pinion_is_found() {
    let scene = scene(&NEAR_UNITY_BENCH);
    let away = GHOST - GHOST.round();
    assert!(away < scene.resolution() && away > scene.beside_a_shaft(), "{away} {}", scene.resolution());
    let outcome = loop_of(&NEAR_UNITY_BENCH, &[order(GHOST, 0.1)], &[]);
    expect(&outcome, "named", "shaft-order", "gear", "gear-ghost-order");
    assert!((outcome.effects[0].order_of_pinion.expect("an order") - GHOST).abs() < 1e-6);
}

#[test]
fn theory_what_the_window_shows_beside_a_strong_order_of_the_pinion_is_no_ghost_of_the_gear() {
    for amplitude in [0.1, 1.0] {
        let outcome = loop_of(&NEAR_UNITY_BENCH, &[order(GHOST.round(), amplitude)], &[]);
        let shafts: Vec<&str> = outcome.effects.iter().map(|effect| effect.shaft.as_str()).collect();
        assert_eq!(shafts, ["pinion"], "{amplitude}: {}", view::text(&outcome));
    }
}

#[test]
fn fault_an_order_of_neither_shaft_within_the_lobe_of_a_quiet_order_of_the_gear_is_found() {
    let bench = BENCH;
    let scene = scene(&bench);
    let beside = 0.5 * (scene.resolution() + scene.beside_a_shaft());
    let own = 14.0 * bench.gear_order() + beside;
    let outcome = loop_of(&bench, &[order(own, 0.1), order(2.0 * own, 0.1)], &[]);
    expect(&outcome, "generic", "non-integer-order", "none", &format!("unexplained order {own:.2}"));
}

/// What makes every mesh line swell and turn without a period, faster than its course over the speed and slower than
/// the slower shaft.
fn restless(bench: &Bench, share: f64) -> Vec<Line> {
    let sideband = |m: &Line, i: i32| Line {
        hz: 0.217 * f64::from(i),
        amplitude: share * m.amplitude,
        phase: f64::from(i * i) + m.phase * f64::from(i),
        ..*m
    };
    bench.mesh().iter().flat_map(|m| (-8..=8).filter(|i| *i != 0).map(|i| sideband(m, i))).collect()
}

#[test]
fn fault_knocks_are_found_beside_restless_mesh_lines_that_would_fill_their_envelope() {
    for (amplitude, share) in [(0.06, 0.01), (0.12, 0.03)] {
        let bench = Bench { noise: 0.05, ..BENCH };
        let outcome = loop_of(&bench, &restless(&bench, share), &[Impacts { amplitude, ..IMPACTS }]);
        expect(&outcome, "named", "non-integer-order", "none", "bearing-impacts");
    }
}

#[test]
fn theory_spectra_over_frequency_take_all_of_a_stretch_but_a_quarter_of_a_second_and_keep_its_power() {
    let scene = scene(&BENCH);
    let baseline = Baseline::of(&scene);
    let run = &scene.runs[0];
    let power = |level: &Level| level.density.values.iter().sum::<f64>() * level.density.bin;
    for chosen in [of_fit as fn(&Split) -> &[Stretch], of_held_out] {
        let at = |turn: usize| run.angle.map.time_at(run.angle.from_turn + turn as f64);
        let length = |s: &Stretch| at(s.from + s.turns) - at(s.from);
        let shortest = chosen(&run.split).iter().map(length).fold(f64::INFINITY, f64::min);
        let own = views(&scene, &baseline.calibrated, chosen, None);
        let read = 1.0 / own.frequency.bin(0);
        assert!(read <= shortest + 1e-3 && read > shortest - 0.26, "{read} of {shortest}");
        let [of_time, of_angle] = [&own.frequency, &own.orders].map(|spectra| power(&spectra.levels[0][0][0]));
        assert!((of_time / of_angle - 1.0).abs() < 0.15, "{of_time} {of_angle}");
    }
}

#[test]
fn theory_a_lone_tone_of_few_nats_is_named_where_the_held_out_turns_agree_or_not_at_all() {
    for amplitude in [2e-3, 3e-3, 4e-3] {
        let outcome = loop_of(&BENCH, &[tone(777.0, amplitude)], &[]);
        assert!(outcome.effects.is_empty(), "{amplitude}: {}", view::text(&outcome));
    }
    for amplitude in [7.6e-3, 8.4e-3, 1e-2] {
        let outcome = loop_of(&BENCH, &[tone(777.0, amplitude)], &[]);
        expect(&outcome, "named", "fixed-frequency", "none", "fixed-tone");
    }
}

#[test]
fn fault_a_tone_that_a_vetoed_order_has_spoken_for_is_found_when_the_search_is_made_again() {
    let record = BENCH.record(&[tone(777.0, 3e-2)], &[]);
    let scene = Scene::of(&record, record.require_tach().expect("a tach"), BENCH.teeth).expect("a scene");
    let calibrated = Baseline::of(&scene).calibrated;
    let fit = views(&scene, &calibrated, of_fit, None);
    let held = views(&scene, &calibrated, of_held_out, Some(&fit));
    let tone = search(&scene, &fit).adopted.remove(0);
    assert_eq!(tone.candidate.kind, Kind::FixedFrequency);
    let base = 777.0 / BENCH.speed_hz;
    let place = Place { order: base, spacing: base, label: "1 o".into() };
    let candidate =
        Candidate { kind: Kind::Passage, base, domain: Domain::Orders, places: vec![place], ..tone.candidate.clone() };
    let mut order = Adopted { candidate, ..tone.clone() };
    order.verdict.score.of_places = vec![9.0];
    let mut found = nothing(&scene, &fit);
    found.take(&scene, &fit, order.clone());
    assert!(found.next(&scene, &fit).is_none(), "the order has the tone's frequencies");
    let candidate = order.candidate.clone();
    assert!(search_after_veto(&mut found, [Vec::new(), vec![order]], &[], &scene, [&fit, &held]));
    let bases: Vec<f64> = found.adopted.iter().map(|own| own.candidate.base).collect();
    assert!(bases.len() == 1 && (bases[0] - 777.0).abs() < 0.1, "{bases:?}");
    assert!(found.knows(&candidate, &scene), "it is not asked for again");
}

#[test]
fn theory_what_holds_stays_when_the_search_is_made_again_and_what_was_vetoed_does_not() {
    let record = BENCH.record(&[order(14.0, 0.1), order(3.37, 0.1), order(6.74, 0.1)], &[]);
    let scene = Scene::of(&record, record.require_tach().expect("a tach"), BENCH.teeth).expect("a scene");
    let calibrated = Baseline::of(&scene).calibrated;
    let fit = views(&scene, &calibrated, of_fit, None);
    let held = views(&scene, &calibrated, of_held_out, Some(&fit));
    let mut found = search(&scene, &fit);
    let is_ghost = |own: &Adopted| own.candidate.kind == Kind::Ghost;
    let (vetoed, kept): (Vec<_>, Vec<_>) = found.adopted.iter().cloned().partition(is_ghost);
    assert_eq!([vetoed.len(), kept.len()], [1, 1]);
    assert!(found.taken[0].near(14.0, 1e-9));
    let base = kept[0].candidate.base;
    assert!(!search_after_veto(&mut found, [kept, vetoed], &[], &scene, [&fit, &held]));
    assert_eq!(found.adopted.iter().map(|own| own.candidate.base).collect::<Vec<_>>(), [base]);
    assert!(!found.taken[0].near(14.0, 1e-9) && found.taken[0].near(base, 1e-9));
}
