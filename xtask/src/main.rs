//! Project tasks: `cargo xtask TASK`, listed by `cargo xtask help`.
//!
//! Plain Rust without dependencies, so that the first task on a clean machine starts after seconds and
//! behaves the same on every host. Each task is one module with a `run` that returns one clear line on
//! failure; exit code 1 then.

mod bench;
mod damage;
mod demo;
mod elf;
mod flash;
mod fuzz;
mod gateway;
mod modbus;
mod mutants;
mod node_build;
mod pace;
mod prove;
mod release;
mod screenshots;
mod setup;
mod shell;
mod soak;
mod stack_use;
mod suite;
mod supply;
mod wheel;

use std::process::ExitCode;

const HELP: &str = "\
cargo xtask TASK

  setup        compiler target, QEMU and Unicorn; does nothing where all are present
  demo         sets up, simulates a gear pair, runs the firmware in QEMU on it (or on a given record folder)
  prove        the loop's proof campaign on generated records, resumable, into target/proof
  prove-field  the same of signal-based inference on generated records of the measured kind, into target/proof/field
  blind        the loop's answers on the blind records that have none yet, into docs/evidence/blind
  damage       6600 attacks on the command (damaged inputs, interrupts, full disks, ...), into target/damage.md;
               --cases N --seed S, or --only FAMILY:NUMBER to make one again
  test         everything the project claims: style, lints, documentation, host tests, QEMU tests
  test-long    the tests that `test` leaves out because of their length, into target/long-tests.md
  node-build   all firmware images, with their sizes
  size         text, data and bss of the images against limits and snapshots, and where they can panic
  pace         with which sampling rates the emulated STM32F405 keeps up, by cycles per instruction, into target/pace.md
  bench        kernels beside SciPy and ROSS, whole commands, node stages, into target/benchmarks.md (--without-ross)
  bench-node   instructions of the node's stages in QEMU against the committed counts (--overwrite)
  wheel        the Python package: wheel, clean environment, its tests and notebooks (skipped without Python)
  modbus       the released image as a Modbus station, read by pymodbus (skipped without Python)
  screenshots  pictures of the reports and of the live view, into book/src/pictures (names of pictures may follow)
  gateway      the gateway against a real broker: faults, kills, every frame once (--full: ten minutes, committed;
               --readers: one folder, five programs; --year: a year of 100 nodes)
  fleet-spark  `meshband loop` over generated records by PySpark, a pool and one by one, compared; committed
  fuzz         every target of tests/src/fuzz under libFuzzer for MESHBAND_FUZZ_SECONDS each (600), into \
  target/fuzzing.md;
               names of targets may follow (then only printed), MESHBAND_FUZZ_JOBS run at a time
  mutants      cargo-mutants on every N-th mutant: `mutants shared 40`, `mutants inference 16`, into target/mutation.md
  soak         the node for --hours H of virtual time (24) with random speeds, faults and noise on the line, into \
  target/soak.md
  soak-image   the released image in the emulator for --hours H (1), likewise, into target/soak-image.md
  supply-chain bill of materials, and cargo-deny where it is installed
  reproducible all images twice in two folders, compared byte by byte, into target/reproducible.md
  flash        writes the STM32F405 image with probe-rs (or `flash --dfu` through dfu-util)
";

fn main() -> ExitCode {
    let mut args = std::env::args().skip(1);
    let task = args.next().unwrap_or_default();
    let rest: Vec<String> = args.collect();
    let result = match task.as_str() {
        "setup" => setup::run(),
        "demo" => demo::run(&rest),
        "test" => suite::run(),
        "test-long" => suite::run_long(),
        "prove" => prove::campaign(&rest),
        "prove-field" => prove::field(&rest),
        "blind" => prove::blind(),
        "damage" => damage::run_task(&rest),
        "node-build" => node_build::run(),
        "size" => node_build::size(&rest),
        "pace" => pace::run_task(&rest),
        "screenshots" => screenshots::run_task(&rest),
        "wheel" => wheel::run_task(),
        "modbus" => modbus::run_task(),
        "bench" => bench::run_task(&rest),
        "bench-node" => bench::node::run_task(&rest),
        "fuzz" => fuzz::run_task(&rest),
        "mutants" => mutants::run_task(&rest),
        "soak" => soak::run_task(&rest),
        "soak-image" => soak::run_image(&rest),
        "supply-chain" => supply::chain(&rest),
        "reproducible" => supply::reproducible(&rest),
        "flash" => flash::run(&rest),
        "gateway" => gateway::proof(&rest),
        "fleet-spark" => gateway::spark(&rest),
        "" | "help" | "--help" | "-h" => {
            print!("{HELP}");
            return ExitCode::SUCCESS;
        }
        other => Err(format!("unknown task `{other}`\n\n{HELP}")),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("xtask: {message}");
            ExitCode::FAILURE
        }
    }
}
