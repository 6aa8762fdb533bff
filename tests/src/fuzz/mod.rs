//! Targets of fuzzing: what reads foreign bytes, in the node and on the host.
//!
//! Each target takes any bytes, checks what must hold for all of them, and gives its answer in words; it panics where
//! something is wrong. A bounded number of inputs runs with the tests (`tests/tests/fuzz`), guided by new answers
//! alone; `cargo xtask fuzz` runs the same functions under libFuzzer (`fuzz/`), guided by coverage, which also ends
//! what takes too long or too much memory. Targets that read files write each input into a folder of their own first:
//! what is tested is what a command calls.

mod files;
mod modbus;
mod node;
mod texts;

use rand_chacha::ChaCha8Rng;

/// Changes an input so that it stays nearly sound.
pub type Change = fn(&mut Vec<u8>, &mut ChaCha8Rng);

/// One reader with what is tried on it.
pub struct Target {
    /// Name, also of the folder of its kept cases (`tests/vectors/fuzz`).
    pub name: &'static str,
    /// What it reads.
    pub reads: &'static str,
    /// Inputs of the bounded run.
    pub inputs: usize,
    /// Sound inputs.
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// How an input is changed.
    pub change: Change,
    /// The check; the answer in words.
    pub run: fn(&[u8]) -> String,
}

/// Every target.
pub const TARGETS: &[Target] = &[
    Target {
        name: "frames",
        reads: "bytes of the link, host's and node's decoder",
        inputs: 12_000,
        seeds: node::frame_seeds,
        change: node::change_frame,
        run: node::frames,
    },
    Target {
        name: "store",
        reads: "the node's flash",
        inputs: 1_500,
        seeds: node::flash_seeds,
        change: node::change_bytes,
        run: node::store,
    },
    Target {
        name: "session",
        reads: "edges, blocks and bytes in any order, as a whole node takes them",
        inputs: 250,
        seeds: node::session_seeds,
        change: node::change_bytes,
        run: node::session,
    },
    Target {
        name: "modbus",
        reads: "bytes of a Modbus line at any times",
        inputs: 4_000,
        seeds: modbus::seeds,
        change: node::change_bytes,
        run: modbus::run,
    },
    Target {
        name: "tach",
        reads: "instants of pulses and a wheel",
        inputs: 4_000,
        seeds: node::tach_seeds,
        change: node::change_bytes,
        run: node::tach,
    },
    Target {
        name: "record",
        reads: "a record's folder: record.toml, tach edges, signal",
        inputs: 1_500,
        seeds: files::record_seeds,
        change: files::change_record,
        run: files::record,
    },
    Target {
        name: "import",
        reads: "files of every import format, and full scales",
        inputs: 1_500,
        seeds: files::import_seeds,
        change: files::change_import,
        run: files::import,
    },
    Target {
        name: "machine",
        reads: "a machine file",
        inputs: 2_000,
        seeds: texts::machine_seeds,
        change: texts::change_toml,
        run: texts::machine,
    },
    Target {
        name: "effects",
        reads: "`--effect` arguments and files of effects",
        inputs: 4_000,
        seeds: texts::effect_seeds,
        change: texts::change_effect,
        run: texts::effects,
    },
    Target {
        name: "law",
        reads: "a law file",
        inputs: 3_000,
        seeds: texts::law_seeds,
        change: texts::change_toml,
        run: texts::law,
    },
    Target {
        name: "settings",
        reads: "a node's settings",
        inputs: 2_000,
        seeds: texts::settings_seeds,
        change: texts::change_toml,
        run: texts::settings,
    },
];

/// The target of a name.
pub fn target(name: &str) -> Option<&'static Target> {
    TARGETS.iter().find(|target| target.name == name)
}
