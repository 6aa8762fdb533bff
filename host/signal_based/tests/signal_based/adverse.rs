//! Records that are not what their owner says: said, or left unnamed, never a confident wrong name.

use super::generator::{BENCH, Bench, Line};
use super::{SMALL_BENCH, loop_of, of_record, order};
use meshband_host::signal_based::outcome::Outcome;
use meshband_host::signal_based::view;

fn nothing_named(outcome: &Outcome) {
    assert!(outcome.effects.iter().all(|e| e.verdict != "named"), "{}", view::text(outcome));
}

#[test]
fn fault_the_mesh_of_a_second_stage_is_no_ghost() {
    // Seventeen teeth on the gear's shaft drive another gear.
    let lines: Vec<Line> =
        (1..=3).map(|k| order(17.0 * f64::from(k) * BENCH.gear_order(), 0.3 / f64::from(k))).collect();
    let outcome = loop_of(&BENCH, &lines, &[]);
    nothing_named(&outcome);
    assert!(outcome.effects.iter().any(|e| e.name.contains("another stage")), "{}", view::text(&outcome));
}

#[test]
fn fault_wrong_teeth_of_the_gear_name_no_shaft() {
    let mut record = BENCH.record(&BENCH.modulation(BENCH.gear_order(), 0.1, 1), &[]);
    record.declaration = Bench { teeth: [23, 60], ..BENCH }.record(&[], &[]).declaration;
    nothing_named(&of_record(&record));
}

#[test]
fn fault_a_helical_pair_entered_as_spur_has_only_another_path() {
    // Overlap takes the high harmonics away; what is left stands at the same orders.
    let soft: Vec<Line> =
        SMALL_BENCH.mesh().into_iter().map(|m| Line { amplitude: -0.9 * m.amplitude, ..m }).skip(1).collect();
    let outcome = loop_of(&SMALL_BENCH, &soft, &[]);
    assert!(outcome.effects.is_empty(), "{}", view::text(&outcome));
}

#[test]
fn fault_a_tach_on_the_other_shaft_is_said() {
    let mut record = BENCH.record(&BENCH.modulation(1.0, 0.1, 1), &[]);
    record.declaration.tach.as_mut().expect("a tach").shaft = "gear".into();
    let outcome = of_record(&record);
    assert!(outcome.headline.starts_with("abstained") && outcome.effects.is_empty(), "{}", outcome.headline);
}
