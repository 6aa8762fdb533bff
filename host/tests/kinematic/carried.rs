//! Further harmonics and sidebands of a passage, further orders of a shaft, speed against load, and a rig without gears, on generated records.

use crate::generator::{BENCH, Bench, Line};
use crate::{of_record, only, order};
use meshband_host::kinematic::outcome::Judged;
use meshband_host::kinematic::view;
use meshband_host::record::Record;

/// Several benches as runs of one record, each with a load.
fn with_loads(runs: &[(Bench, f64)], lines: &[Line]) -> Record {
    let mut records: Vec<Record> = runs.iter().map(|(bench, _)| bench.record(lines, &[])).collect();
    for (record, (_, load)) in records.iter_mut().zip(runs) {
        record.runs[0].declaration.other.insert("load".into(), (*load).into());
    }
    let mut all = records.remove(0);
    all.runs.extend(records.into_iter().flat_map(|record| record.runs));
    all.declaration.runs = all.runs.iter().map(|run| run.declaration.clone()).collect();
    all
}

#[test]
fn fault_a_passage_modulated_by_a_shaft_is_one_family_with_its_sidebands() {
    let z = f64::from(BENCH.teeth[0]);
    let gear = BENCH.gear_order();
    let mut lines = Vec::new();
    for (k, j) in [(1.0, 1.0), (1.0, -1.0), (2.0, 1.0), (2.0, -1.0), (1.0, 2.0), (3.0, 1.0)] {
        let carrier = k * z + j * 3.587;
        lines.push(order(carrier, 0.2));
        lines.extend([-1.0, 1.0].map(|side| order(carrier + side * gear, 0.1)));
    }
    let outcome = of_record(&BENCH.record(&lines, &[]));
    let passage = outcome.effects.iter().find(|e| e.order_of_pinion.is_some_and(|o| (o - 3.587).abs() < 0.01));
    let passage = passage.unwrap_or_else(|| panic!("{}", view::text(&outcome)));
    assert!(passage.carries.iter().any(|c| c.contains("by gear")), "{}", view::text(&outcome));
    // What moved copies of the same lines would take is far less than what these explain.
    for channel in &outcome.error.errors.per_channel {
        let explained = channel.waveform.corrected.powi(2) - channel.unexplained_share;
        assert!(explained > 0.0 && channel.control[0] < 0.2 * explained, "{channel:?}");
    }
}

#[test]
fn fault_harmonics_of_a_passage_beyond_the_middle_between_mesh_lines_are_its_own() {
    let z = f64::from(BENCH.teeth[0]);
    let far: Vec<f64> =
        [(0.0, 7.0), (1.0, 6.0), (1.0, 7.0), (2.0, 6.0), (3.0, 7.0)].map(|(k, j)| k * z + j * 3.587).to_vec();
    let near =
        [(1.0, 1.0), (1.0, -1.0), (2.0, 1.0), (2.0, -1.0), (1.0, 2.0), (3.0, 1.0)].map(|(k, j)| k * z + j * 3.587);
    let lines: Vec<Line> = near.iter().chain(&far).map(|at| order(*at, 0.2)).collect();
    let outcome = of_record(&BENCH.record(&lines, &[]));
    let passage = only(&outcome);
    assert!(passage.order_of_pinion.is_some_and(|o| (o - 3.587).abs() < 0.01), "{}", view::text(&outcome));
    assert!(passage.carries.iter().any(|c| c.contains("further harmonics: 5")), "{}", view::text(&outcome));
    for order in far {
        assert!(passage.lines.iter().any(|(_, at)| (at - order).abs() < 0.02), "{order}: {:?}", passage.lines);
    }
}

#[test]
fn fault_further_orders_of_a_shaft_belong_to_its_runout_and_are_no_effect_of_their_own() {
    let (z, gear) = (f64::from(BENCH.teeth[0]), BENCH.gear_order());
    let mut lines = BENCH.modulation(gear, 0.1, 1);
    for (k, n) in [(1.0, 6.0), (1.0, -7.0), (2.0, 7.0), (2.0, -6.0), (3.0, 6.0)] {
        lines.push(order(k * z + n * gear, 0.1));
    }
    let outcome = of_record(&BENCH.record(&lines, &[]));
    assert_eq!(only(&outcome).shaft, "gear", "{}", view::text(&outcome));
    let further = outcome.surrogates.iter().find(|row| row.family == "further orders of the gear's shaft");
    assert!(further.is_some_and(|row| row.refused.is_none()), "{}", view::text(&outcome));
    let held = outcome.held_out;
    assert!(held.corrected < 1.2 * held.noise_floor, "{held:?}");
    // Without such lines there is nothing to take in.
    let outcome = of_record(&BENCH.record(&BENCH.modulation(gear, 0.1, 1), &[]));
    let adopted = |row: &&Judged| row.family.starts_with("further orders") && row.refused.is_none();
    assert!(outcome.surrogates.iter().find(adopted).is_none(), "{}", view::text(&outcome));
}

#[test]
fn theory_the_slip_of_every_second_load_predicts_the_others_and_the_supply_is_found() {
    let slip = |load: f64| 0.008 + 0.006 * load / 100.0;
    let loads = [0.0, 15.0, 30.0, 45.0, 60.0, 80.0, 100.0];
    let bench = |load: f64| Bench {
        speed_hz: 25.0 * (1.0 - slip(load)),
        wander: 0.0,
        seconds: 10.0,
        rate_hz: 4096.0,
        channels: 1,
        seed: 5 + load as u64,
        ..BENCH
    };
    let runs: Vec<(Bench, f64)> = loads.iter().map(|&load| (bench(load), load)).collect();
    let supply = Line { order: 0.0, hz: 50.0, amplitude: 0.05, phase: 0.0 };
    let outcome = of_record(&with_loads(&runs, &[supply]));
    let law = outcome.slip.as_ref().unwrap_or_else(|| panic!("{}", view::text(&outcome)));
    let (hz, multiple, _) = law.supply.expect("a supply line");
    assert!((hz - 50.0).abs() < 0.02 && multiple == 2, "{}", law.sentence());
    for run in &law.runs {
        assert_eq!(run.fitted, [0.0, 30.0, 60.0, 100.0].contains(&run.load));
        let [own, by_law] = run.slip.expect("a slip");
        assert!((own - slip(run.load)).abs() < 3e-4 && (by_law - slip(run.load)).abs() < 3e-4, "{run:?}");
    }
    let none = of_record(&with_loads(&runs, &[])).slip.expect("a law of the speed alone");
    assert!(none.supply.is_none(), "{}", none.sentence());
}
