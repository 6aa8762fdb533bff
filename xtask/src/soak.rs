//! `cargo xtask soak`: the node for a day of virtual time, into `docs/soak.md`. Arguments go to the program
//! (`--hours H`, `--seed S`).

use crate::shell::{Outcome, capture, cargo, root, run, timed};

/// Builds and runs the program `soak` of the tests.
pub fn run_task(args: &[String]) -> Outcome {
    let program = ["--quiet", "--release", "--package", "meshband-tests", "--bin", "soak"];
    timed("the soak's program", || run(cargo(&["build"]).args(program)))?;
    let page = timed("soak", || capture(cargo(&["run"]).args(program).arg("--").args(args)))?;
    print!("{page}");
    let path = root().join("docs/soak.md");
    std::fs::write(&path, page).map_err(|e| format!("{}: {e}", path.display()))
}
