//! Fuzzing: the targets of `meshband_tests::fuzz` with inputs that grow out of sound ones, a fixed number of them.
//!
//! There is no coverage here; what an input is told (the kind of result, the words of the refusal without its
//! numbers) stands in for it: an input with a new answer joins the corpus and is changed further. Seeds are fixed and
//! printed, so that a case is found again. Found cases lie in `tests/vectors/fuzz/TARGET` and run first.
//! `cargo xtask fuzz` runs the same targets guided by coverage.

mod corpus;

use meshband_tests::fuzz::{TARGETS, target};

macro_rules! campaigns {
    ($($test:ident: $name:literal),* $(,)?) => {
        $(#[test]
        fn $test() {
            corpus::Campaign::new(target($name).expect("a target")).run();
        })*

        #[test]
        fn theory_every_target_is_tried() {
            assert!(TARGETS.iter().map(|target| target.name).eq([$($name),*]));
        }
    };
}

/// Inputs grow out of sound ones only if these are read as such: a refusal names a place before a colon.
#[test]
fn theory_sound_inputs_are_accepted() {
    for name in ["record", "import", "machine", "effects", "settings"] {
        let target = target(name).expect("a target");
        for (number, seed) in (target.seeds)().iter().enumerate() {
            let said = (target.run)(seed);
            assert!(!said.contains(": "), "{name}, sound input {number}: {said}");
        }
    }
}

campaigns! {
    fault_frames_of_any_bytes: "frames",
    fault_stored_configurations_of_any_bytes: "store",
    fault_sessions_under_any_sequence_of_edges_blocks_and_bytes: "session",
    fault_modbus_lines_of_any_bytes_at_any_times: "modbus",
    fault_pulses_at_any_instants: "tach",
    fault_records_with_any_damage: "record",
    fault_measurement_files_with_any_damage: "import",
    fault_machines_with_any_damage: "machine",
    fault_effects_with_any_damage: "effects",
    fault_laws_with_any_damage: "law",
    fault_settings_with_any_damage: "settings",
}
