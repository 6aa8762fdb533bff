//! `cargo xtask demo`: from a clean clone to a table of what the node measured.

use crate::node_build;
use crate::setup;
use crate::shell::{Outcome, cargo, root, timed};

/// Sets up, builds the node and the `meshband` command, and runs the firmware in QEMU on a record folder.
pub fn run(args: &[String]) -> Outcome {
    let [record] = args else {
        return Err("demo takes one argument, the record folder to replay".into());
    };
    let record = std::env::current_dir().map_err(|e| e.to_string())?.join(record);
    setup::run()?;
    node_build::build()?;
    timed("the meshband command", || run_quiet(&["build", "--quiet", "--release", "--package", "meshband-host"]))?;
    let output = root().join("demo-out");
    std::fs::create_dir_all(&output).map_err(|e| format!("{}: {e}", output.display()))?;
    let json = output.join("node.json");
    let mut meshband = cargo(&["run", "--quiet", "--release", "--package", "meshband-host", "--bin", "meshband", "--"]);
    crate::shell::run(meshband.arg("node").arg(record).arg("--json").arg(json))
}

fn run_quiet(args: &[&str]) -> Outcome {
    crate::shell::run(&mut cargo(args))
}
