//! Fuzzing: what reads foreign bytes in the node, with inputs that grow out of sound ones.
//!
//! There is no coverage instrumentation on a stable compiler without a second build of everything; what an input is told
//! (the kind of result, the words of the refusal without its numbers) stands in for it: an input with a new answer joins
//! the corpus and is changed further. Seeds are fixed and printed, so that a case is found again. Found cases lie in
//! `tests/vectors/fuzz/TARGET` and run first. `MESHBAND_FUZZ_SECONDS` makes each target go on for so long
//! (`cargo xtask fuzz`); without it the number of inputs is fixed.

mod corpus;
mod node;

use corpus::Campaign;

#[test]
fn fault_frames_of_any_bytes() {
    Campaign::new("frames", 12_000, node::frame_seeds(), node::change_frame).run(node::frames);
}

#[test]
fn fault_stored_configurations_of_any_bytes() {
    Campaign::new("store", 1_500, node::flash_seeds(), node::change_bytes).run(node::store);
}

#[test]
fn fault_sessions_under_any_sequence_of_edges_blocks_and_bytes() {
    Campaign::new("session", 250, node::session_seeds(), node::change_bytes).run(node::session);
}

#[test]
fn fault_pulses_at_any_instants() {
    Campaign::new("tach", 4_000, node::tach_seeds(), node::change_bytes).run(node::tach);
}
