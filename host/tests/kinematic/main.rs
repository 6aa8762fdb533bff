//! The loop's kinematic level on generated records of the measured kind: what is in them is found and named, what is not is not.

mod generator;

use generator::{BENCH, Bench, Impacts, Line};
use meshband_host::kinematic::outcome::{Effect, Outcome};
use meshband_host::kinematic::preflight::Preflight;
use meshband_host::kinematic;

fn loop_of(bench: &Bench, lines: &[Line], impacts: &[Impacts]) -> Outcome {
    let record = bench.record(lines, impacts);
    kinematic::run(&record, &Preflight::of(&record)).expect("the kinematic level")
}

fn only(outcome: &Outcome) -> &Effect {
    assert_eq!(outcome.effects.len(), 1, "{}", kinematic::view::text(outcome));
    &outcome.effects[0]
}

#[test]
fn fault_the_gears_runout_is_found_as_modulation_by_its_shaft() {
    let outcome = loop_of(&BENCH, &BENCH.modulation(BENCH.gear_order(), 0.1, 1), &[]);
    println!("{}", kinematic::view::text(&outcome));
    let effect = only(&outcome);
    assert_eq!((effect.family.as_str(), effect.shaft.as_str()), ("sideband", "gear"));
    assert!(outcome.held_out.corrected < 0.9 * outcome.held_out.calibrated);
}
