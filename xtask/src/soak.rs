//! `cargo xtask soak`: the node for a day of virtual time, into `docs/soak.md`. Arguments go to the program
//! (`--hours H`, `--seed S`).

use crate::shell::{Outcome, capture, programs, root, timed};

/// Builds and runs the program `soak` of the tests.
pub fn run_task(args: &[String]) -> Outcome {
    let [program] = programs(["soak"])?;
    let page = timed("soak", || capture(std::process::Command::new(program).args(args)))?;
    print!("{page}");
    let path = root().join("docs/soak.md");
    std::fs::write(&path, page).map_err(|e| format!("{}: {e}", path.display()))
}
