//! The Python package: built as a wheel, installed into a clean environment, tested there with both notebooks.
//!
//! `host/python` is a workspace of its own, so that plain cargo needs no Python; it shares the project's target folder, with the project's
//! profile and versions, so that of its dependencies only the host crate is built again. Environment and wheel lie in `target/python`.
//! Not part of `cargo xtask test`: the first build of the host crate for it takes minutes.

use crate::shell::{Outcome, cargo, on_path, root, run, say, timed};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Oldest Python that the wheel is for.
const OLDEST: (u32, u32) = (3, 10);
/// What the tests need beside the wheel.
const TEST_NEEDS: [&str; 8] = ["numpy", "scipy", "pytest", "nbclient", "nbformat", "ipykernel", "matplotlib", "pandas"];

/// Builds and tests; says "skipped" where there is no Python.
pub fn run_task() -> Outcome {
    let Some(python) = python() else {
        println!("skipped: no Python {}.{} or newer on the path", OLDEST.0, OLDEST.1);
        return Ok(());
    };
    let folder = root().join("target/python");
    let environment = folder.join("environment");
    let own = environment.join(if cfg!(windows) { "Scripts" } else { "bin" }).join("python");
    timed("environment", || fresh_environment(&python, &environment, &own))?;
    let wheels = folder.join("wheels");
    if wheels.exists() {
        std::fs::remove_dir_all(&wheels).map_err(|e| format!("{}: {e}", wheels.display()))?;
    }
    timed("wheel", || {
        let mut maturin = Command::new(&own);
        maturin.args(["-m", "maturin", "build", "--release", "--interpreter"]).arg(&own).arg("--out").arg(&wheels);
        run(maturin.current_dir(package()))
    })?;
    let wheel = only_wheel(&wheels)?;
    timed("installation", || pip(&own, &["--force-reinstall", "--no-deps", &wheel.display().to_string()]))?;
    timed("command", || run(&mut cargo(&["build", "--quiet", "--release", "--bin", "meshband"])))?;
    timed("tests and notebooks", || {
        let mut tests = Command::new(&own);
        tests.args(["-m", "pytest", "-q", "-p", "no:cacheprovider"]).current_dir(package());
        run(tests.env("PYTHONDONTWRITEBYTECODE", "1"))
    })?;
    say(format!("wheel: {}", wheel.display()));
    Ok(())
}

fn package() -> PathBuf {
    root().join("host/python")
}

/// The first Python that is new enough and can make environments.
fn python() -> Option<PathBuf> {
    let names = ["python3", "python"];
    names.iter().filter_map(|name| on_path(name)).find(|path| {
        let check = format!("import sys, venv; sys.exit(sys.version_info < {OLDEST:?})");
        Command::new(path).args(["-c", &check]).output().is_ok_and(|output| output.status.success())
    })
}

/// An environment with what building and testing need, and without any former wheel.
fn fresh_environment(python: &Path, environment: &Path, own: &Path) -> Outcome {
    if !own.is_file() {
        run(Command::new(python).args(["-m", "venv"]).arg(environment))?;
    }
    pip(own, &[&["maturin>=1.7,<2"][..], &TEST_NEEDS[..]].concat())?;
    run(Command::new(own).args(["-m", "pip", "--quiet", "--disable-pip-version-check", "uninstall", "-y", "meshband"]))
}

fn pip(own: &Path, what: &[&str]) -> Outcome {
    let quiet = ["-m", "pip", "--quiet", "--disable-pip-version-check", "install"];
    run(Command::new(own).args(quiet).args(what))
}

fn only_wheel(folder: &Path) -> Outcome<PathBuf> {
    let entries = std::fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut wheels =
        entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|p| p.extension().is_some_and(|e| e == "whl"));
    match (wheels.next(), wheels.next()) {
        (Some(wheel), None) => Ok(wheel),
        _ => Err(format!("{}: not exactly one wheel", folder.display())),
    }
}
