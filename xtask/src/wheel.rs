//! The Python package: built as a wheel, installed into a clean environment, tested there with both notebooks.
//!
//! `host/python` is a workspace of its own, so that plain cargo needs no Python; it shares the project's target
//! folder, with the project's profile and versions, so that of its dependencies only the host crate is built again.
//! Environment and wheel lie in `target/python`. `cargo xtask test` runs it last, when the command it is compared
//! with is built; what this machine lacks makes it skipped there, a test that fails makes it fail.

use crate::shell::{Outcome, capture, cargo, last_line, on_path, programs, root, run, say, timed};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Oldest Python that the wheel is for.
const MIN_PYTHON_VERSION: (u32, u32) = (3, 10);
/// What the tests need beside the wheel.
const TEST_NEEDS: [&str; 8] = ["numpy", "scipy", "pytest", "nbclient", "nbformat", "ipykernel", "matplotlib", "pandas"];
/// Libraries whose files the import must read as they do: newest that install, so that a change of theirs is seen.
const FORMATS: [&str; 8] = ["h5py", "mat73", "npTDMS", "pyuff", "soundfile", "lvm_read", "asammdf", "pyarrow"];

/// `cargo xtask wheel`: builds and tests; says "skipped" where it cannot.
pub fn run_task() -> Outcome {
    if let Some(reason) = test(false)? {
        println!("skipped: {reason}");
    }
    Ok(())
}

/// Builds and tests; gives the reason where this machine cannot: no Python with environments, or packages that cannot
/// be had. The tests compare with the command, which is built unless `command_is_built`.
pub fn test(command_is_built: bool) -> Outcome<Option<String>> {
    let Some(python) = python() else {
        return Ok(Some(format!(
            "no Python {}.{} or newer with venv on the path",
            MIN_PYTHON_VERSION.0, MIN_PYTHON_VERSION.1
        )));
    };
    let folder = root().join("target/python");
    let environment = folder.join("environment");
    let own = environment.join(if cfg!(windows) { "Scripts" } else { "bin" }).join("python");
    if let Err(reason) = timed("environment", || fresh_environment(&python, &environment, &own)) {
        return Ok(Some(format!("no environment with {}: {}", TEST_NEEDS.join(", "), last_line(&reason))));
    }
    let fetch = ["fetch", "--quiet", "--locked", "--manifest-path", "host/python/Cargo.toml"];
    if let Err(reason) = capture(&mut cargo(&fetch)) {
        return Ok(Some(format!("crates of the package cannot be had: {}", last_line(&reason))));
    }
    let wheels = folder.join("wheels");
    if wheels.exists() {
        std::fs::remove_dir_all(&wheels).map_err(|e| format!("{}: {e}", wheels.display()))?;
    }
    timed("wheel", || {
        let mut maturin = Command::new(&own);
        maturin.args(["-m", "maturin", "build", "--release", "--locked", "--interpreter"]).arg(&own);
        run(maturin.arg("--out").arg(&wheels).current_dir(package()))
    })?;
    let wheel = only_wheel(&wheels)?;
    timed("installation", || pip(&own, &["--force-reinstall", "--no-deps", &wheel.display().to_string()]))?;
    if !command_is_built {
        programs(["meshband"])?;
    }
    timed("tests and notebooks", || {
        let mut tests = Command::new(&own);
        tests.args(["-m", "pytest", "-q", "-p", "no:cacheprovider"]).current_dir(package());
        run(tests.env("PYTHONDONTWRITEBYTECODE", "1"))
    })?;
    say(format!("wheel: {}", wheel.display()));
    Ok(None)
}

fn package() -> PathBuf {
    root().join("host/python")
}

/// The first Python that is new enough and can make environments.
fn python() -> Option<PathBuf> {
    let names = ["python3", "python"];
    names.iter().filter_map(|name| on_path(name)).find(|path| {
        let check = format!("import sys, venv; sys.exit(sys.version_info < {MIN_PYTHON_VERSION:?})");
        Command::new(path).args(["-c", &check]).output().is_ok_and(|output| output.status.success())
    })
}

/// An environment with what building and testing need, and without any former wheel. What it holds is noted in it:
/// asking pip again for what is there takes a minute on a slow disk.
fn fresh_environment(python: &Path, environment: &Path, own: &Path) -> Outcome {
    let needs = [&["maturin>=1.7,<2"][..], &TEST_NEEDS[..], &FORMATS[..]].concat();
    let (note, held) = (environment.join("holds.txt"), format!("{}\n{}\n", python.display(), needs.join("\n")));
    if !own.is_file() || std::fs::read_to_string(&note).is_ok_and(|noted| noted != held) {
        capture(Command::new(python).args(["-m", "venv", "--clear"]).arg(environment))?;
    }
    if !note.is_file() {
        pip(own, &needs)?;
        std::fs::write(&note, held).map_err(|e| format!("{}: {e}", note.display()))?;
    }
    let uninstall = ["-m", "pip", "--quiet", "--disable-pip-version-check", "uninstall", "-y", "meshband"];
    capture(Command::new(own).args(uninstall)).map(drop)
}

fn pip(own: &Path, what: &[&str]) -> Outcome {
    let quiet = ["-m", "pip", "--quiet", "--disable-pip-version-check", "install"];
    capture(Command::new(own).args(quiet).args(what)).map(drop)
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
