//! `cargo xtask damage`: the campaign of attacks on the command, into `target/damage.md`.

use crate::shell::{Outcome, programs, root, run};

/// A whole campaign writes the page of the documentation; with `--only` nothing is written. Further arguments are the
/// campaign's (`--cases N`, `--seed S`, `--only FAMILY[:NUMBER]`, `--keep FOLDER`, `--json FILE`).
pub fn run_task(args: &[String]) -> Outcome {
    let [program, campaign] = programs(["meshband", "damage"])?;
    let mut command = std::process::Command::new(campaign);
    command.arg("--program").arg(program).args(args);
    if !args.iter().any(|arg| arg == "--only") {
        command.arg("--markdown").arg(root().join("target/damage.md"));
    }
    run(&mut command)
}
