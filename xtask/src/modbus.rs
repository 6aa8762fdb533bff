//! The Python environment with pymodbus, an independent Modbus master, under `target/modbus-python`; made once.
//!
//! The tests of the emulated board use it where it is (`emulator/tests/flashed/modbus`) and say that they are skipped
//! where it is not. The variable `MESHBAND_MODBUS_PYTHON` names another interpreter that has the package.

use crate::shell::{Outcome, capture, cargo, last_line, on_path, root, run, timed, with_retries};
use crate::{node_build, setup};
use std::process::Command;

/// The master's package, at the version that the tests were written with.
const PACKAGE: &str = "pymodbus[serial]==3.16.1";

/// `cargo xtask modbus`: the released image as a Modbus station against pymodbus.
pub fn run_task() -> Outcome {
    setup::run()?;
    if let Some(reason) = environment()? {
        println!("skipped: {reason}");
        return Ok(());
    }
    node_build::build()?;
    run(&mut cargo(&[
        "test",
        "--release",
        "--package",
        "meshband-emulator",
        "--test",
        "flashed",
        "modbus::",
        "--",
        "--nocapture",
    ]))?;
    // The served node, read by the csv map alone.
    let words = ["test", "--release", "--package", "meshband-host", "--test", "command", "modbus_serve::"];
    run(cargo(&words).args(["--", "--nocapture"]))
}

/// Makes the environment; gives the reason where this machine cannot.
pub fn environment() -> Outcome<Option<String>> {
    if std::env::var_os("MESHBAND_MODBUS_PYTHON").is_some() {
        return Ok(None);
    }
    let folder = root().join("target/modbus-python");
    let python = folder.join("bin/python");
    let version = PACKAGE.rsplit('=').next().unwrap_or_default();
    let check = format!("import pymodbus, serial, sys; sys.exit(pymodbus.__version__ != '{version}')");
    if capture(Command::new(&python).args(["-c", &check])).is_ok() {
        return Ok(None);
    }
    let Some(system) = on_path("python3") else { return Ok(Some("no python3 on the path".into())) };
    let made = timed("Python environment with pymodbus", || {
        capture(Command::new(system).args(["-m", "venv", "--clear"]).arg(&folder))?;
        with_retries("pymodbus", || {
            let install = ["-m", "pip", "--quiet", "--disable-pip-version-check", "install", PACKAGE];
            capture(Command::new(&python).args(install)).map(drop)
        })
    });
    Ok(made.err().map(|reason| format!("no environment with {PACKAGE}: {}", last_line(&reason))))
}
