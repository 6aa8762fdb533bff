//! `cargo xtask damage`: the campaign of attacks on the command, into `docs/damage.md`.

use crate::shell::{Outcome, cargo, root, run, timed};
use std::path::PathBuf;

const PACKAGES: [&str; 2] = ["meshband-host", "meshband-tests"];
const PROGRAMS: [&str; 2] = ["meshband", "damage"];

/// A whole campaign writes the page of the documentation; with `--only` nothing is written. Further arguments are the
/// campaign's (`--cases N`, `--seed S`, `--only FAMILY[:NUMBER]`, `--keep FOLDER`, `--json FILE`).
pub fn run_task(args: &[String]) -> Outcome {
    timed("the command and its campaign", || {
        let mut build = cargo(&["build", "--quiet", "--release"]);
        build.args(PACKAGES.iter().flat_map(|package| ["--package", package]));
        build.args(PROGRAMS.iter().flat_map(|program| ["--bin", program]));
        run(&mut build)
    })?;
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), PathBuf::from);
    let [program, campaign] = PROGRAMS.map(|name| target.join("release").join(name));
    let mut command = std::process::Command::new(campaign);
    command.arg("--program").arg(program).args(args);
    if !args.iter().any(|arg| arg == "--only") {
        command.arg("--markdown").arg(root().join("docs/damage.md"));
    }
    run(&mut command)
}
