//! Orders of neither shaft that stand elsewhere on the turns not used, or not at all, on generated records.

use crate::generator::{BENCH, Line};
use crate::{of_record, order};
use meshband_host::signal_based::outcome::{Effect, Outcome};
use meshband_host::signal_based::view;

const BASE: f64 = 4.487;
/// Most of the middle quarter, which is held out.
const HELD_OUT_RANGE: std::ops::Range<f64> = 0.36..0.64;

fn lines(base: f64) -> Vec<Line> {
    let z = f64::from(BENCH.teeth[0]);
    let at = [(1.0, 1.0), (1.0, -1.0), (2.0, 1.0), (2.0, -1.0), (1.0, 2.0), (2.0, 2.0), (3.0, 1.0)];
    at.iter().map(|(k, j)| order(k * z + j * base, 0.15)).collect()
}

/// The loop on a record whose lines are others on the held-out turns.
fn with_others_held_out(others: &[Line]) -> Outcome {
    let [record, other] = [&lines(BASE), others].map(|lines| BENCH.record(lines, &[]));
    of_record(&BENCH.spliced(&record, &other, HELD_OUT_RANGE))
}

/// A family of lines; a comb of squared envelopes holds other turns out, which nobody changed.
fn at_the_base(outcome: &Outcome) -> Option<&Effect> {
    let is_at = |effect: &&Effect| effect.order_of_pinion.is_some_and(|own| (own - BASE).abs() < 0.02);
    outcome.effects.iter().filter(is_at).find(|effect| effect.evidence.domain != Some("envelope"))
}

#[test]
fn fault_an_order_that_slips_by_a_hundredth_is_read_where_it_stands_on_the_held_out_turns() {
    let still = with_others_held_out(&lines(BASE));
    for slip in [-0.011, 0.011] {
        let outcome = with_others_held_out(&lines(BASE * (1.0 + slip)));
        let effect = at_the_base(&outcome).unwrap_or_else(|| panic!("{slip}: {}", view::text(&outcome)));
        let read = &effect.parameters["slip_on_held_out_turns"];
        assert!((read.value - 100.0 * slip).abs() < 0.15, "{slip} is read as {} %", read.value);
        let left = |outcome: &Outcome| outcome.error.errors.held_out_power.corrected;
        let (own, none) = (left(&outcome), outcome.error.errors.held_out_power.calibrated);
        assert!(none - own > 0.8 * (none - left(&still)), "{slip}: {own} of {none}, {} without slip", left(&still));
    }
}

#[test]
fn theory_an_order_that_stays_has_no_slip_and_one_that_has_gone_is_refused() {
    let outcome = with_others_held_out(&lines(BASE));
    let effect = at_the_base(&outcome).unwrap_or_else(|| panic!("{}", view::text(&outcome)));
    assert!(!effect.parameters.contains_key("slip_on_held_out_turns"), "{:?}", effect.parameters);
    let outcome = with_others_held_out(&[]);
    assert!(at_the_base(&outcome).is_none(), "{}", view::text(&outcome));
}

#[test]
fn theory_an_order_farther_off_than_bearings_slip_is_not_the_same() {
    let outcome = with_others_held_out(&lines(1.04 * BASE));
    assert!(at_the_base(&outcome).is_none(), "{}", view::text(&outcome));
}
