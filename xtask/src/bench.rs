//! `cargo xtask bench`: our solver and SciPy's on the same pair, one after the other on the same machine.
//!
//! The peer is `tests/compare/scipy_gear_baseline.py` (DOP853 at 1e-9 with a compiled right-hand side,
//! restarted at every jump of the stiffness). Its Python environment is made once under `target/`; the variable
//! `MESHBAND_PEER_PYTHON` names another interpreter that has numpy, scipy and numba. Timings want a quiet machine.

use crate::shell::{Outcome, capture, cargo, command, root, run, say, timed, with_retries};
use std::path::PathBuf;

/// Simulated seconds per iteration of the benches in `tests/benches/dynamics.rs`.
const BENCH_SECONDS: [(&str, f64); 3] = [("integrate", 0.1), ("steady_state", 1.0), ("channel_100_mhz", 0.01)];

/// Runs both and prints the ratios first.
pub fn bench() -> Outcome {
    let python = timed("the peer's Python", peer_python)?;
    timed("our benches", || {
        // The profile that users run; it shares its dependencies with the tests.
        run(&mut cargo(&[
            "bench",
            "--profile",
            "release",
            "--quiet",
            "--package",
            "meshband-tests",
            "--bench",
            "dynamics",
        ]))
    })?;
    let mut ours = Vec::new();
    for (name, seconds) in BENCH_SECONDS {
        ours.push(median_s(name)? / seconds);
    }
    say("the peer ...");
    let script = root().join("tests/compare/scipy_gear_baseline.py");
    let text =
        capture(command(&[&python.to_string_lossy(), &script.to_string_lossy()]).args(["--brief", "--reps", "2"]))?;
    let (peer, error) = peer_cost(&text).ok_or_else(|| format!("no DOP853 line in the peer's output:\n{text}"))?;
    let [integrate, steady, sampled] = ours[..] else { return Err("three benches are expected".into()) };
    println!("19/48 pair, 30 turns/s, 8 coordinates, one thread\n");
    println!("{:.0} times faster than SciPy DOP853 restarted at 1e-9\n", peer / integrate);
    println!("integration at 1e-9                 {:10.4} s per simulated second", integrate);
    println!("SciPy DOP853 at 1e-9, restarted     {peer:10.4} s per simulated second (error {error})");
    println!("periodic steady state               {:10.4} ms per operating point", 1e3 * steady);
    println!("one channel at 100 MHz              {:10.4} s per simulated second", sampled);
    Ok(())
}

/// Median time of one iteration, from criterion's estimates.
fn median_s(name: &str) -> Outcome<f64> {
    let path = root().join("target/criterion").join(name).join("new/estimates.json");
    let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let value = text.split("\"median\"").nth(1).and_then(|rest| rest.split("\"point_estimate\":").nth(1));
    let number = value.and_then(|rest| rest.split([',', '}']).next()).and_then(|n| n.trim().parse::<f64>().ok());
    number.map(|ns| 1e-9 * ns).ok_or_else(|| format!("{}: no median", path.display()))
}

/// Seconds per simulated second and error of the restarted DOP853 at 1e-9.
fn peer_cost(text: &str) -> Option<(f64, String)> {
    let line = text.lines().find(|l| {
        let words: Vec<&str> = l.split_whitespace().collect();
        matches!(words[..], ["DOP853", rtol, "segment", ..] if rtol.parse() == Ok(1e-9))
    })?;
    let words: Vec<&str> = line.split_whitespace().collect();
    Some((words.get(3)?.parse().ok()?, (*words.get(6)?).to_string()))
}

fn peer_python() -> Outcome<PathBuf> {
    if let Some(python) = std::env::var_os("MESHBAND_PEER_PYTHON") {
        return Ok(python.into());
    }
    let folder = root().join("target/peer-python");
    let python = folder.join("bin/python");
    let ready = |python: &PathBuf| {
        capture(&mut command(&[&python.to_string_lossy(), "-c", "import numpy, scipy, numba"])).is_ok()
    };
    if !ready(&python) {
        capture(&mut command(&["python3", "-m", "venv", &folder.to_string_lossy()]))?;
        with_retries("numpy, scipy, numba", || {
            let install = ["-m", "pip", "install", "--quiet", "numpy", "scipy", "numba"];
            capture(command(&[&python.to_string_lossy()]).args(install)).map(|_| ())
        })?;
    }
    Ok(python)
}
