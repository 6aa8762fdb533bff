//! Other people's programs on the same case: SciPy's solvers and ROSS, in a Python environment made once under
//! `target/`.
//!
//! The variable `MESHBAND_PEER_PYTHON` names another interpreter that has the packages.

use crate::shell::{Outcome, capture, command, root, say, timed, with_retries};
use std::path::{Path, PathBuf};

/// A solver of SciPy on the case.
pub struct Solver {
    /// Its name there.
    pub name: String,
    /// Processor seconds per simulated second.
    pub seconds: f64,
    /// Error of the acceleration relative to its rms, as printed.
    pub error: String,
}

/// The interpreter, with what the peers need.
pub fn python(with_ross: bool) -> Outcome<PathBuf> {
    let (imports, packages) = if with_ross {
        ("import numpy, scipy, numba, ross", &["numpy", "scipy", "numba", "ross-rotordynamics", "plotly<6"][..])
    } else {
        ("import numpy, scipy, numba", &["numpy", "scipy", "numba"][..])
    };
    if let Some(python) = std::env::var_os("MESHBAND_PEER_PYTHON") {
        return Ok(python.into());
    }
    let folder = root().join("target/peer-python");
    let python = folder.join("bin/python");
    if capture(&mut command(&[&python.to_string_lossy(), "-c", imports])).is_err() {
        if !python.is_file() {
            capture(&mut command(&["python3", "-m", "venv", &folder.to_string_lossy()]))?;
        }
        with_retries("Python packages of the peers", || {
            let install = ["-m", "pip", "install", "--quiet"];
            capture(command(&[&python.to_string_lossy()]).args(install).args(packages)).map(|_| ())
        })?;
    }
    Ok(python)
}

/// SciPy's solvers, restarted at every jump, at 1e-9.
pub fn scipy(python: &Path) -> Outcome<Vec<Solver>> {
    let script = root().join("tests/compare/scipy_gear_baseline.py");
    let text = timed("SciPy", || {
        let words = [&*python.to_string_lossy(), &*script.to_string_lossy(), "--brief", "--reps", "2"];
        capture(&mut command(&words))
    })?;
    let solver = |line: &str| -> Option<Solver> {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [name, rtol, "segment", seconds, _, _, error] = words[..] else { return None };
        (rtol.parse() == Ok(1e-9)).then_some(())?;
        Some(Solver { name: name.into(), seconds: seconds.parse().ok()?, error: error.into() })
    };
    let found: Vec<Solver> = text.lines().filter_map(solver).collect();
    if found.iter().any(|s| s.name == "DOP853") {
        Ok(found)
    } else {
        Err(format!("no DOP853 in the peer's output:\n{text}"))
    }
}

/// Seconds of ROSS for the 19/48 pair's stiffness curve.
pub fn ross_s(python: &Path, program: &Path) -> Outcome<f64> {
    let script = root().join("tests/compare/ross_compare.py");
    let text = timed("ROSS", || capture(command(&[&python.to_string_lossy()]).arg(script).arg(program)))?;
    let row = text.split("## Cost").nth(1).and_then(|part| part.lines().find(|line| line.starts_with("| 19/48")));
    let seconds = row.and_then(|row| row.split('|').nth(3)).and_then(|cell| cell.trim().parse().ok());
    if seconds.is_none() {
        say("ROSS printed no cost");
    }
    seconds.ok_or_else(|| format!("no cost of 19/48 in:\n{text}"))
}
