//! Failures in a row, and what ends them.

use meshband::safe_start::{FAILURES, GOOD_RUN_S, GoodRun, Start, failures_at, is_safe_start};
use meshband::units::TicksPerSecond;

/// Starts one after the other, with a page that survives; true where the default configuration is taken.
fn starts(kept: &mut Option<u32>, sequence: &[Start]) -> Vec<bool> {
    let mut safe = vec![];
    for &start in sequence {
        // What the node records of itself it counts before it restarts.
        if start == Start::Recorded {
            *kept = Some(kept.unwrap_or(0) + 1);
        }
        let failures = failures_at(start, *kept);
        *kept = Some(failures);
        safe.push(is_safe_start(failures));
    }
    safe
}

#[test]
fn fault_a_configuration_that_fails_for_ever_is_left_at_the_fourth_failure() {
    use Start::{Fresh, Recorded, Unrecorded};
    for failure in [Recorded, Unrecorded] {
        // Nothing known in memory, as after power came.
        let mut kept = None;
        assert_eq!(starts(&mut kept, &[Fresh, failure, failure, failure]), [false; 4]);
        assert_eq!(starts(&mut kept, &[failure, failure, failure]), [true; 3], "{failure:?}");
        // A person at the reset pin tries the stored configuration again.
        assert_eq!(starts(&mut kept, &[Fresh, failure]), [false; 2]);
    }
    let mut kept = None;
    let mixed = [Fresh, Recorded, Unrecorded, Recorded, Unrecorded];
    assert_eq!(starts(&mut kept, &mixed), [false, false, false, false, true]);
    assert_eq!(FAILURES, 4, "book/src/reference/node.md says so");
    // Memory that never held a record, after a restart of a node that did not fail.
    assert_eq!(failures_at(Recorded, None), 0);
    assert_eq!(failures_at(Unrecorded, Some(u32::MAX)), u32::MAX);
}

#[test]
fn theory_an_hour_of_good_running_is_told_once_across_wraps_of_the_counter() {
    const CLOCK: u32 = 84_000_000;
    let mut run = GoodRun::new(TicksPerSecond(CLOCK));
    let start = 4_000_000_000u32;
    let mut told = vec![];
    for second in 0..2 * GOOD_RUN_S {
        if run.is_reached(start.wrapping_add(second.wrapping_mul(CLOCK))) {
            told.push(second);
        }
    }
    assert_eq!(told, [GOOD_RUN_S]);
}
