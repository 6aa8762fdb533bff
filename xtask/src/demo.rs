//! `cargo xtask demo`: from a clean clone to a table of what the node measured, and a report with pictures.

use crate::node_build;
use crate::setup;
use crate::shell::{Outcome, cargo, root, say, timed};
use std::path::Path;

/// The paper's rig with an eccentric pinion, which gives the mesh lines their sidebands.
const MACHINE: &str = "machines/paper-rig.toml";
const EFFECT: &str = "eccentricity:amplitude=20e-6";

/// Sets up, builds, simulates the paper's rig, runs the firmware in QEMU on it (or on a given record folder), prints the
/// tables and leaves reports in `demo-out/`.
pub fn run(args: &[String]) -> Outcome {
    let given = match args {
        [] => None,
        [record] => Some(std::env::current_dir().map_err(|e| e.to_string())?.join(record)),
        _ => return Err("demo takes at most one argument, a record folder to replay".into()),
    };
    setup::run()?;
    node_build::build()?;
    timed("the meshband command", || {
        crate::shell::run(&mut cargo(&["build", "--quiet", "--release", "--package", "meshband-host"]))
    })?;
    let output = root().join("demo-out");
    std::fs::create_dir_all(&output).map_err(|e| format!("{}: {e}", output.display()))?;
    let record = match given {
        Some(record) => record,
        None => {
            let record = output.join("paper-rig");
            timed("simulating the paper's rig, 4 s at 14.5 Hz and 12 N m", || {
                let words =
                    ["--speed", "14.5", "--torque", "12", "--duration", "4", "--rate", "204800", "--pulses", "8"];
                meshband("simulate", &root().join(MACHINE), &words, &["--effect", EFFECT, "-o"], &record)
            })?;
            record
        }
    };
    let report = output.join("node.html");
    timed("the node in QEMU on this record, twice", || {
        let json = output.join("node.json");
        meshband("node", &record, &["--runs", "2"], &["--json", &json.display().to_string(), "--report"], &report)
    })?;
    say(format!("report: {}", report.display()));
    if args.is_empty() {
        let report = output.join("run-up.html");
        timed("the node in QEMU on a run-up from 3 to 25 Hz", || {
            meshband("node", &root().join(MACHINE), &["--run-up", "3,25"], &["--effect", EFFECT, "--report"], &report)
        })?;
        say(format!("report: {}", report.display()));
    }
    Ok(())
}

/// One subcommand of `meshband` on an input, with an output path at the end.
fn meshband(subcommand: &str, input: &Path, words: &[&str], more: &[&str], output: &Path) -> Outcome {
    let mut command = cargo(&["run", "--quiet", "--release", "--package", "meshband-host", "--bin", "meshband", "--"]);
    // The folder is the demo's own: a second demo replaces what the first one left.
    crate::shell::run(command.arg(subcommand).arg(input).args(words).arg("--force").args(more).arg(output))
}
