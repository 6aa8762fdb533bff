//! `cargo xtask demo`: from a clean clone to an analysis of a simulated gear pair, then to a table of what the node
//! measured on it.
//!
//! Only what the demo needs is built: the command once, with few optimisations (profile `demo`), and one firmware
//! image. The first result, a record and its report, comes before QEMU and the firmware are touched.

use crate::node_build;
use crate::setup;
use crate::shell::{Outcome, cargo, root, say, timed, watched};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The paper's rig with an eccentric pinion, which gives the mesh lines their sidebands.
const MACHINE: &str = "machines/paper-rig.toml";
const EFFECT: &str = "eccentricity:amplitude=20e-6";
/// Profile of the command.
const PROFILE: &str = "demo";
/// Minutes of one core that building takes, command and image, and that the rest takes.
const BUILD_MIN: f64 = 16.0;
const REST_MIN: f64 = 2.0;

/// Builds, simulates the paper's rig and analyses it (or a given record folder), then runs the firmware in QEMU on
/// it; prints the tables and leaves reports in `demo-out/`.
pub fn run(args: &[String]) -> Outcome {
    let given = match args {
        [] => None,
        [record] => Some(std::env::current_dir().map_err(|e| e.to_string())?.join(record)),
        _ => return Err("demo takes at most one argument, a record folder to replay".into()),
    };
    foretell();
    let mut build = cargo(&["build", "--profile", PROFILE, "--package", "meshband-host", "--bin", "meshband"]);
    watched("building the command", &mut build)?;
    let output = root().join("demo-out");
    std::fs::create_dir_all(&output).map_err(|e| format!("{}: {e}", output.display()))?;
    let record = match given {
        Some(record) => record,
        None => simulated(&output)?,
    };
    let report = output.join("analyse.html");
    meshband("analysing the record", "analyse", &record, &[], &["--report"], &report)?;
    say(format!("first result: {}", report.display()));
    setup::run()?;
    node_build::build_one("an386")?;
    let report = output.join("node.html");
    let json = output.join("node.json").display().to_string();
    let words = ["--runs", "2"];
    meshband("the node in QEMU, twice", "node", &record, &words, &["--json", &json, "--report"], &report)?;
    say(format!("report: {}", report.display()));
    if args.is_empty() {
        let report = output.join("run-up.html");
        let machine = root().join(MACHINE);
        let more = ["--effect", EFFECT, "--report"];
        meshband("the node on a run-up from 3 to 25 Hz", "node", &machine, &["--run-up", "3,25"], &more, &report)?;
        say(format!("report: {}", report.display()));
    }
    Ok(())
}

/// How long it will take, from whether the command is there and how many cores are.
fn foretell() {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let built = program().is_file();
    let minutes = if built { REST_MIN } else { REST_MIN + BUILD_MIN / cores as f64 };
    let what = if built { "the command is built already" } else { "most of it is building, once" };
    say(format!("this takes about {minutes:.0} min on {cores} idle cores ({what}); progress comes every 15 s"));
}

fn program() -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), PathBuf::from);
    target.join(PROFILE).join(format!("meshband{}", std::env::consts::EXE_SUFFIX))
}

fn simulated(output: &Path) -> Outcome<PathBuf> {
    let record = output.join("paper-rig");
    let words = ["--speed", "14.5", "--torque", "12", "--duration", "4", "--rate", "204800", "--pulses", "8"];
    let what = "simulating the paper's rig, 4 s at 14.5 Hz and 12 N m";
    meshband(what, "simulate", &root().join(MACHINE), &words, &["--effect", EFFECT, "-o"], &record)?;
    Ok(record)
}

/// One subcommand of `meshband` on an input, with an output path at the end.
fn meshband(what: &str, subcommand: &str, input: &Path, words: &[&str], more: &[&str], output: &Path) -> Outcome {
    let mut command = Command::new(program());
    command.current_dir(root());
    // The folder is the demo's own: a second demo replaces what the first one left.
    command.arg(subcommand).arg(input).args(words).arg("--force").args(more).arg(output);
    timed(what, || watched(what, &mut command))
}
