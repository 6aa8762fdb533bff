//! Errors in three stages worked out here once more from the samples, and the functions of the speed that a line is
//! given.

use crate::generator::Bench;
use crate::{SMALL_BENCH, tone};
use meshband_host::signal_based::accept::Surrogates;
use meshband_host::signal_based::accept::Verdict;
use meshband_host::signal_based::amplitudes::{Weighted, subtract};
use meshband_host::signal_based::baseline::{Baseline, Grids, unknowns};
use meshband_host::signal_based::basis::{Basis, FittedLine, State};
use meshband_host::signal_based::basis_selection::Choice;
use meshband_host::signal_based::candidate::{Candidate, Domain, Kind, Place, Score};
use meshband_host::signal_based::errors::{self, Corrected, Stages};
use meshband_host::signal_based::evidence::{Reading, Shares};
use meshband_host::signal_based::nonsynchronous::{controls, nonsynchronous_share};
use meshband_host::signal_based::residual_spectra::{Views, views};
use meshband_host::signal_based::scene::{Scene, SceneRun};
use meshband_host::signal_based::search::{Adopted, Slip};
use meshband_host::signal_based::split::Stretch;
use meshband_host::signal_based::swept_mode::resonance;
use meshband_host::signal_based::{mesh_order_check, search};
use rustfft::num_complex::Complex64;
use std::sync::Arc;

/// Six channels, of which three are searched; a runout, and a tone that follows no shaft.
const SIX_CHANNEL_BENCH: Bench = Bench { channels: 6, ..SMALL_BENCH };

struct Case {
    scene: Scene,
    baseline: Baseline,
    views: [Views; 2],
    adopted: Vec<Adopted>,
}

fn case() -> Case {
    let lines =
        [SIX_CHANNEL_BENCH.modulation(1.0, 0.15, 1), [400.0, 777.0, 1210.0].map(|hz| tone(hz, 1.5)).to_vec()].concat();
    let record = SIX_CHANNEL_BENCH.record(&lines, &[]);
    let scene = Scene::of(&record, record.require_tach().expect("a tach"), SIX_CHANNEL_BENCH.teeth).expect("a scene");
    let baseline = Baseline::of(&scene);
    let fit = views(&scene, &baseline.calibrated, |split| &split.fit, None);
    let held = views(&scene, &baseline.calibrated, |split| &split.held_out, Some(&fit));
    let adopted = search::search(&scene, &fit).adopted;
    Case { scene, baseline, views: [fit, held], adopted }
}

fn mean_square(run: &SceneRun, samples: &[f64], stretches: &[Stretch]) -> f64 {
    let per_turn = run.angle.per_turn[0];
    let chosen: Vec<f64> = stretches
        .iter()
        .flat_map(|s| (s.from..s.from + s.turns).flat_map(|turn| &samples[turn * per_turn..(turn + 1) * per_turn]))
        .copied()
        .collect();
    chosen.iter().map(|x| x * x).sum::<f64>() / chosen.len() as f64
}

fn assert_near(ours: f64, reference: f64, what: &str) {
    assert!((ours - reference).abs() <= 1e-9 * reference.abs().max(1e-3), "{what}: {ours} for {reference}");
}

/// Shares of the power that a residual leaves, channel by channel of the only run.
fn left(case: &Case, residual: &Grids, held: bool) -> Vec<f64> {
    let run = &case.scene.runs[0];
    let stretches = if held { &run.split.held_out } else { &run.split.fit };
    let share = |c: usize| mean_square(run, &residual[0][c], stretches) / mean_square(run, &run.samples[c], stretches);
    (0..case.scene.channels.len()).map(share).collect()
}

fn mean(shares: &[f64]) -> f64 {
    shares.iter().sum::<f64>() / shares.len() as f64
}

#[test]
fn ref_errors_are_roots_of_the_shares_of_power_that_each_stage_leaves() {
    let case = case();
    let (scene, baseline) = (&case.scene, &case.baseline);
    let all: Vec<&Adopted> = case.adopted.iter().collect();
    assert!(
        all.iter().any(|a| a.candidate.locked) && all.iter().any(|a| !a.candidate.locked),
        "{:?}",
        all.iter().map(|a| a.candidate.kind).collect::<Vec<_>>()
    );
    let corrected = errors::correct(scene, baseline, &case.views[0], &all);
    let own = mesh_order_check::spectra(scene, |split| &split.fit);
    let both = [&case.views[0], &case.views[1]];
    let found = errors::errors(scene, baseline, &corrected, (both, &own), &all);
    let run = &scene.runs[0];
    let floors = |held: bool| -> Vec<f64> {
        let stretches = if held { &run.split.held_out } else { &run.split.fit };
        let floor = |c: usize| own.floor_power(0, c) / mean_square(run, &run.samples[c], stretches);
        (0..scene.channels.len()).map(floor).collect()
    };
    let predicted = &nonsynchronous_share(scene, both, &all, 0.0)[0];
    assert!(predicted[0] > 1e-3, "the tone takes something: {predicted:?}");
    for (stages, held) in [(found.fit, false), (found.held_out, true)] {
        let Stages { declared, calibrated, corrected: with, noise_floor } = stages;
        assert_near(declared, mean(&left(&case, &baseline.declared, held)).sqrt(), "declared");
        assert_near(calibrated, mean(&left(&case, &baseline.calibrated, held)).sqrt(), "calibrated");
        assert_near(with, mean(&left(&case, &corrected.residual, held)).sqrt(), "corrected");
        assert_near(noise_floor, mean(&floors(held)).sqrt(), "noise floor");
    }
    let (held, power) = (found.held_out, found.held_out_power);
    assert_near(power.declared, held.declared.powi(2), "power, declared");
    assert_near(power.calibrated, held.calibrated.powi(2), "power, calibrated");
    assert_near(power.corrected, held.corrected.powi(2) - mean(predicted), "power, corrected");
    assert_near(power.noise_floor, held.noise_floor.powi(2), "power, noise floor");
    let moved = controls(scene, both, &all);
    assert_eq!(found.per_channel.len(), 6);
    for (c, channel) in found.per_channel.iter().enumerate() {
        assert_eq!((channel.searched, channel.channel), (c < 3, [0, 2, 4, 1, 3, 5][c]));
        let waveform = channel.waveform;
        assert_near(waveform.corrected, left(&case, &corrected.residual, true)[c].sqrt(), "of a channel");
        assert_near(waveform.noise_floor, floors(true)[c].sqrt(), "floor of a channel");
        assert_near(channel.unexplained_share, waveform.corrected.powi(2) - predicted[c], "unexplained");
        assert_eq!(channel.control, moved[c]);
    }
}

#[test]
fn ref_a_corrected_line_is_the_fitted_one_as_far_as_it_is_trusted_and_nothing_else_is_taken_off() {
    let case = case();
    let (scene, baseline, fit) = (&case.scene, &case.baseline, &case.views[0]);
    let locked = case.adopted.iter().find(|a| a.candidate.locked).expect("the runout");
    let mut corrected = Corrected::none(scene, baseline);
    assert_eq!((corrected.unknowns, corrected.residual == baseline.calibrated), (0, true));
    let orders = corrected.add(scene, baseline, fit, locked);
    let places = &locked.candidate.places;
    let read = |c: usize, order: f64| fit.orders.reading(0, c, 0, order, 0);
    let of_all = (0..6).flat_map(|c| places.iter().filter_map(move |p| read(c, p.order)));
    let shares = Shares::of(&of_all.map(Reading::ln_bayes).collect::<Vec<_>>());
    let mut unknown = 0;
    for (c, orders) in orders[0].iter().enumerate() {
        let mut trusted: Vec<(f64, f64)> = places
            .iter()
            .map(|p| (read(c, p.order).map_or(0.0, |r| shares.trust(r)), p.order))
            .filter(|(trust, _)| *trust > 0.05)
            .collect();
        trusted.sort_by(|a, b| b.0.total_cmp(&a.0));
        assert!(!trusted.is_empty());
        let expected: Vec<f64> = trusted.iter().map(|(_, order)| *order).collect();
        assert_eq!(*orders, expected);
        let mut rest = baseline.calibrated[0][c].clone();
        let run = &scene.runs[0];
        let lines = Weighted::new(run).fit(&mut rest, &expected, Some(&baseline.choices[0]), &[]);
        unknown += unknowns(&lines);
        let mut taken_off = baseline.calibrated[0][c].clone();
        for ((line, ours), (trust, _)) in lines.iter().zip(&corrected.lines[0][c]).zip(&trusted) {
            assert_eq!((line.order, line.basis.len()), (ours.order, ours.basis.len()));
            for (a, b) in line.coefficients.iter().zip(&ours.coefficients) {
                assert!((a * trust - b).norm() <= 1e-12 * a.norm(), "{a} {b} {trust}");
            }
            subtract(&mut taken_off, run, ours);
        }
        let scale = mean_square(run, &taken_off, &run.split.fit).sqrt();
        let away = taken_off.iter().zip(&corrected.residual[0][c]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(away < 1e-9 * scale, "{away} of {scale}");
    }
    assert_eq!(corrected.unknowns, unknown);
    let nonsynchronous = case.adopted.iter().find(|a| !a.candidate.locked).expect("the tone");
    let before = corrected.residual.clone();
    assert!(corrected.add(scene, baseline, fit, nonsynchronous).is_empty());
    assert_eq!((corrected.unknowns, corrected.residual == before), (unknown, true));
}

#[test]
fn claim_of_a_family_of_many_lines_the_surest_are_fitted() {
    let case = case();
    // Every half order, most of them empty.
    let places: Vec<Place> =
        (1..400).map(|i| Place { order: 0.5 * f64::from(i), spacing: 1.0, label: String::new() }).collect();
    let score = Score { of_places: vec![1.0; places.len()], ..Score::default() };
    let surrogates = Surrogates::of(vec![0.0; 48], 1.0);
    let own = Adopted {
        candidate: Candidate {
            kind: Kind::Ghost,
            base: 0.5,
            domain: Domain::Orders,
            places,
            locked: true,
            alternatives: 1.0,
        },
        verdict: Verdict { score, ln_bayes: 1.0, surrogates, refused: None, is_close: false },
        pulse: None,
        carries: Vec::new(),
        either_hz: None,
        slip: Slip::default(),
        or_else: Vec::new(),
    };
    let mut corrected = Corrected::none(&case.scene, &case.baseline);
    let orders = corrected.add(&case.scene, &case.baseline, &case.views[0], &own);
    assert!(orders[0].iter().all(|orders| !orders.is_empty() && orders.len() <= 150));
}

#[test]
fn ref_another_signal_has_its_share_of_the_power() {
    let case = case();
    let run = &case.scene.runs[0];
    let mut signals = vec![Vec::new(); 6];
    for (c, channel) in case.scene.channels.iter().enumerate() {
        // The channels by number of the record, each at its own part of itself.
        signals[channel.index] = run.signals[c].iter().map(|x| x * 0.1 * (c + 1) as f64).collect();
    }
    // The angle was taken from the mesh lines after the grid's first reading, and the grid's edges belong to no
    // stretch.
    let expected = (1..=6).map(|i| (0.1 * f64::from(i)).powi(2)).sum::<f64>() / 6.0;
    let share = errors::share_of(&case.scene, &signals);
    assert!((share / expected - 1.0).abs() < 1e-9, "{share} for {expected}");
    assert_eq!(errors::share_of(&Scene { runs: Vec::new(), ..case.scene.clone() }, &signals), 0.0);
}

const TURNS: usize = 192;
const BLOCK: usize = 2;

/// A speed from 10 to 22 Hz that swings, and weights that differ.
fn turning() -> (Vec<State>, Vec<f64>) {
    let swing = |i: usize| (0.7 * i as f64).sin();
    let state = |i: usize| State { swing: swing(i), ..State::steady(10.0 + 12.0 * i as f64 / TURNS as f64) };
    ((0..TURNS).map(state).collect(), (0..TURNS).map(|i| 1.0 + 0.3 * (i % 5) as f64).collect())
}

/// Weighted sums of an amplitude, with a little of what nothing explains.
fn sums(amplitude: impl Fn(State) -> Complex64, noise: f64) -> Vec<Complex64> {
    let (states, weights) = turning();
    let jitter = |i: usize| Complex64::from_polar(noise, 2.4 * (i * i) as f64);
    states.iter().zip(&weights).enumerate().map(|(i, (s, w))| (amplitude(*s) + jitter(i)) * *w).collect()
}

fn choice() -> Choice {
    let (states, weights) = turning();
    Choice::new(&states, &weights, BLOCK, 24)
}

#[test]
fn theory_a_line_gets_the_functions_of_the_speed_that_predict_stretches_left_out() {
    const ORDER: f64 = 20.0;
    let poles = vec![[300.0, 0.05], [900.0, 0.05]];
    let choice = choice().with_poles(poles.clone());
    let (one, turned) = (Complex64::new(1.0, 0.0), Complex64::new(0.4, -0.3));
    let chosen = |sums: &[Complex64]| choice.of(ORDER, sums, &[]);
    let fitted = |sums: &[Complex64], amplitude: &dyn Fn(State) -> Complex64| {
        let basis = chosen(sums);
        let course = choice.sweep.course(ORDER, sums);
        let sweep = &choice.sweep;
        let coefficients = basis.fit(ORDER, &sweep.states, &sweep.weights, &course.sums);
        let line = FittedLine { order: ORDER, basis, coefficients };
        let away = |s: &State| (line.at(*s) - amplitude(*s)).norm();
        (line.basis.len(), sweep.states.iter().map(away).fold(0.0, f64::max))
    };
    let constant = |_: State| one;
    let (functions, away) = fitted(&sums(constant, 0.1), &constant);
    assert!(functions == 1 && away < 0.05, "{functions} {away}");
    let straight = |s: State| one + turned * (s.speed_hz - 16.0);
    let (functions, away) = fitted(&sums(straight, 0.05), &straight);
    assert!((2..=4).contains(&functions) && away < 0.05, "{functions} {away}");
    let swinging = |s: State| straight(s) + turned * 0.8 * s.swing;
    let (functions, away) = fitted(&sums(swinging, 0.05), &swinging);
    assert!((3..=5).contains(&functions) && away < 0.1, "{functions} {away}");
    let curved = |s: State| one * (0.5 * (s.speed_hz - 16.0)).cos();
    let (functions, away) = fitted(&sums(curved, 0.05), &curved);
    assert!((4..=14).contains(&functions) && away < 0.1, "{functions} {away}");
    // The first pole lies within the line's frequencies, the second one beyond.
    let ringing = |s: State| 3.0 * resonance(poles[0], ORDER * s.speed_hz, 0.0) + turned;
    let (functions, away) = fitted(&sums(ringing, 0.05), &ringing);
    assert!(functions == 2 && away < 0.05, "{functions} {away}");
}

#[test]
fn theory_a_weak_sideband_is_carried_through_a_resonance_by_its_mesh_line() {
    let pole = [330.0, 0.03];
    let truth = |order: f64, s: State| 3.0 * resonance(pole, order * s.speed_hz, 0.0) + 0.2;
    let coefficients = vec![Complex64::new(0.2, 0.0), Complex64::new(3.0, 0.0)];
    let mesh = Arc::new(FittedLine { order: 20.0, basis: Basis::of_pole(pole), coefficients });
    let part = Complex64::from_polar(0.1, 1.0);
    let sideband = |s: State| part * truth(20.4, s);
    let (choice, sums) = (choice(), sums(sideband, 0.1));
    let fitted = |carriers: &[Arc<FittedLine>]| {
        let basis = choice.of(20.4, &sums, carriers);
        let course = choice.sweep.course(20.4, &sums);
        let coefficients = basis.fit(20.4, &choice.sweep.states, &choice.sweep.weights, &course.sums);
        let line = FittedLine { order: 20.4, basis, coefficients };
        let errors = choice.sweep.states.iter().map(|s| (line.at(*s) - sideband(*s)).norm_sqr());
        (line.basis.is_carried(), line.basis.len(), errors.sum::<f64>())
    };
    let (alone, carried) = (fitted(&[]), fitted(std::slice::from_ref(&mesh)));
    assert!(!alone.0 && carried.0 && carried.1 == 1, "{alone:?} {carried:?}");
    assert!(carried.2 < 0.1 * alone.2, "{alone:?} {carried:?}");
    // A line at twice the order had these frequencies at speeds that the record does not have.
    let far = FittedLine { order: 41.0, ..FittedLine::clone(&mesh) };
    assert_eq!(fitted(&[Arc::new(far)]), alone);
}

#[test]
fn theory_stretches_are_weighted_means_and_plain_sums() {
    let (states, weights) = turning();
    let choice = choice();
    let all = sums(|s| Complex64::new(s.speed_hz, s.swing), 0.2);
    let course = choice.sweep.course(7.0, &all);
    assert_eq!((course.order, course.sums.len(), choice.sweep.states.len()), (7.0, TURNS / BLOCK, TURNS / BLOCK));
    for i in 0..TURNS / BLOCK {
        let [a, b] = [BLOCK * i, BLOCK * i + 1];
        assert!((course.sums[i] - all[a] - all[b]).norm() < 1e-12);
        assert_near(choice.sweep.weights[i], weights[a] + weights[b], "weight");
        let mean = |of: fn(&State) -> f64| {
            (of(&states[a]) * weights[a] + of(&states[b]) * weights[b]) / (weights[a] + weights[b])
        };
        let State { speed_hz: speed, swing, .. } = choice.sweep.states[i];
        assert_near(speed, mean(|s| s.speed_hz), "speed");
        assert_near(swing, mean(|s| s.swing), "swing");
    }
}

#[test]
fn fault_a_line_with_few_stretches_stays_simple() {
    let states: Vec<State> = (0..6).map(|i| State::steady(10.0 + f64::from(i))).collect();
    let choice = Choice::new(&states, &[1.0; 6], 1, 2);
    // Straight, but two functions of each of so few stretches are the most that is tried.
    let steep: Vec<Complex64> = states.iter().map(|s| Complex64::new(s.speed_hz, 0.0)).collect();
    assert!(choice.of(3.0, &steep, &[]).len() <= 3);
    let one = Choice::new(&states[..1], &[1.0], 0, 0);
    assert_eq!(one.of(3.0, &steep[..1], &[]).len(), 1, "a block of no turns is one of one");
}
