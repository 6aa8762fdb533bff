//! Further harmonics and sidebands of a passage, further orders of a shaft, speed against load, and a rig without
//! gears, on generated records.

use crate::generator::{BENCH, Bench, Line};
use crate::{of_record, order};
use meshband_host::record::Record;
use meshband_host::signal_based::baseline::Baseline;
use meshband_host::signal_based::candidate::{Candidate, Domain, Kind, Shaft};
use meshband_host::signal_based::families::{Context, modulation, passage};
use meshband_host::signal_based::residual_spectra::views;
use meshband_host::signal_based::scene::Scene;
use meshband_host::signal_based::search::{self, Adopted};
use meshband_host::signal_based::{accept, remaining_shaft_orders, secondary_lines, view};

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
    // What surrogates of the same lines would take is far less than what these explain.
    for channel in &outcome.error.errors.per_channel {
        let explained = channel.waveform.corrected.powi(2) - channel.unexplained_share;
        assert!(explained > 0.0 && channel.control[0] < 0.2 * explained, "{channel:?}");
    }
}

/// What a record's families have besides, where the search has found just one, of this kind and shape.
fn completed(lines: &[Line], shape: impl Fn(&Context) -> Candidate) -> (Vec<Adopted>, Adopted) {
    let record = BENCH.record(lines, &[]);
    let scene = Scene::of(&record, record.require_tach().expect("a tach"), BENCH.teeth).expect("a scene");
    let views = views(&scene, &Baseline::of(&scene).calibrated, |split| &split.fit, None);
    let mut search = search::nothing(&scene, &views);
    let candidate = shape(&search::context(&scene, &views, &search.taken, &search.feet));
    let field = views.field(&search.taken, Domain::Orders, 0..scene.searched);
    let verdict = accept::judge(&candidate, &field);
    assert!(verdict.refused.is_none(), "{:?}", verdict.refused);
    search.adopted.push(remaining_shaft_orders::part(candidate, verdict));
    let rest = secondary_lines::carry(&mut search, &scene, &views);
    (rest, search.adopted.remove(0))
}

fn stands(own: &Adopted, order: f64) -> bool {
    own.standing().any(|place| (place.order - order).abs() < 0.01)
}

#[test]
fn fault_harmonics_of_a_passage_beyond_the_middle_between_mesh_lines_are_its_own() {
    let (z, base) = (f64::from(BENCH.teeth[0]), 3.587);
    let at = |(k, j): (f64, f64)| k * z + j * base;
    let near = [(1.0, 1.0), (1.0, -1.0), (2.0, 1.0), (2.0, -1.0), (3.0, -1.0), (3.0, 1.0)].map(at);
    let far = [(0.0, 7.0), (1.0, 5.0), (1.0, 7.0), (2.0, 5.0), (3.0, 7.0)].map(at);
    let lines = |orders: &[f64]| orders.iter().map(|o| order(*o, 0.2)).collect::<Vec<Line>>();
    let (rest, own) =
        completed(&lines(&[near.as_slice(), &far].concat()), |context| passage::about_mesh(context, base));
    assert!(rest.is_empty(), "no shaft has a family");
    assert!(own.carries.iter().any(|part| part.words == "further harmonics"), "{:?}", own.carries);
    let lost: Vec<&f64> = far.iter().chain(&near).filter(|order| !stands(&own, **order)).collect();
    assert!(lost.is_empty(), "{lost:?}");
    let (_, own) = completed(&lines(&near), |context| passage::about_mesh(context, base));
    assert!(own.carries.is_empty() && !far.iter().any(|order| stands(&own, *order)), "{:?}", own.carries);
}

#[test]
fn fault_further_orders_of_a_shaft_are_asked_for_where_it_has_a_family() {
    let (z, gear) = (f64::from(BENCH.teeth[0]), BENCH.gear_order());
    let far = [(1.0, 6.0), (1.0, -7.0), (2.0, 7.0), (2.0, -6.0), (3.0, 12.0)].map(|(k, n)| k * z + n * gear);
    let runout = BENCH.modulation(gear, 0.1, 1);
    let all = [runout.clone(), far.map(|o| order(o, 0.1)).to_vec()].concat();
    let shape = |context: &Context| modulation::candidate(context, Shaft::Gear, 1);
    let (rest, own) = completed(&all, shape);
    let [further] = rest.as_slice() else { panic!("{rest:?}") };
    assert_eq!((further.candidate.kind, &further.verdict.refused), (Kind::Pattern(Shaft::Gear), &None));
    assert!(far.iter().all(|order| stands(further, *order) && !stands(&own, *order)));
    assert!(!stands(further, z + gear), "the runout's own line is read twice");
    let (rest, _) = completed(&runout, shape);
    assert!(rest.iter().all(|own| own.verdict.refused.is_some()), "{rest:?}");
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
