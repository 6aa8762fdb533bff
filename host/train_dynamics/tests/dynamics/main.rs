//! The train's dynamics against the pair's simulator, independent integrations and the theory of planetary sets.

mod independent;
mod pair;
mod planetary;
mod record;
mod scipy;

use meshband_train_dynamics::TrainMachine;
use meshband_train_dynamics::integrate::{Course, Options, Step, options};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// A file of the project's machines.
fn machine_path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../machines").join(format!("{name}.toml"))
}

/// One of the project's train machines.
fn machine(name: &str) -> TrainMachine {
    TrainMachine::read(&machine_path(name)).expect("a machine")
}

/// Values of quantities at evenly spaced times from 0 on, after a run from `from_s` with a static start.
fn waveform(
    course: &Course,
    from_s: f64,
    (rate_hz, count): (f64, usize),
    of: &dyn Fn(&Step, usize) -> meshband_mechanics::dynamics::Series,
    quantities: usize,
) -> Vec<Vec<f64>> {
    let mut signals = vec![Vec::with_capacity(count); quantities];
    // Short steps: the powers of a long one cancel and leave some 1e-11 of the largest acceleration.
    let options = Options { tolerance: 1e-13, ..options() };
    let mut state = course.start().expect("a start");
    let mut next = 0;
    let sink = |step: &Step| {
        let until = ((step.start_s + step.end * step.length_s) * rate_hz).ceil().max(0.0) as usize;
        let times: Vec<f64> =
            (next..until.min(count)).map(|i| (i as f64 / rate_hz - step.start_s) / step.length_s).collect();
        if times.is_empty() {
            return;
        }
        next = until.min(count);
        for (quantity, signal) in signals.iter_mut().enumerate() {
            let series = of(step, quantity);
            signal.extend(times.iter().map(|&tau| series.value(tau)));
        }
    };
    course.integrate(&mut state, (from_s, (count as f64 + 0.5) / rate_hz), &options, sink).expect("a run");
    signals
}

/// Amplitude of a line, Hz, in a whole number of its periods.
fn line(signal: &[f64], rate_hz: f64, hz: f64) -> f64 {
    let (mut re, mut im) = (0.0, 0.0);
    for (i, x) in signal.iter().enumerate() {
        let (sin, cos) = (TAU * (hz * i as f64 / rate_hz).fract()).sin_cos();
        re += x * cos;
        im += x * sin;
    }
    2.0 * f64::hypot(re, im) / signal.len() as f64
}

fn rms(signal: &[f64]) -> f64 {
    (signal.iter().map(|x| x * x).sum::<f64>() / signal.len() as f64).sqrt()
}
