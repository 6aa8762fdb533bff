//! Speed against load: the law of a motor that slips, and the supply that it slips against.
//!
//! Runs that declare a load are taken in its order; every second one is fitted, the others are predicted. Constant,
//! linear or quadratic law of the mean speed, chosen by leaving one fitted load out at a time. The supply's line is
//! one frequency common to the fitted runs, up to 4 % above a whole multiple of the shaft's rate (no slip is
//! negative, few are wider), after that multiple's own line has been taken off; every frequency tried is paid for.
//! Without such a line the law is of the speed alone. Limits: one supply; four loads or more; a frequency converter
//! that follows the load looks like slip.

use super::evidence::Reading;
use super::families::fixed_frequency::supply_hz;
use super::scene::{Scene, SceneRun};
use crate::record::Record;
use crate::spectral::{Window, amplitude_spectrum, line_near};
use serde::Serialize;

/// Fewest fitted loads.
const MIN_LOADS: usize = 3;
/// Widest slip looked for.
const MAX_SLIP: f64 = 0.04;
/// Multiples of the shaft's rate that the supply's line may be near.
const MULTIPLES: std::ops::RangeInclusive<u32> = 1..=4;
/// Step of the frequencies tried, share of a bin.
const STEP: f64 = 0.25;
/// Least logarithm of the Bayes factor after the choice.
const MIN_LN_BAYES: f64 = 5.0;
/// Power over floor that one reading counts at most.
const CAP: f64 = 300.0;
/// Bins of a main lobe (Blackman-Harris), each side.
const LOBE: f64 = 4.0;

/// One run.
#[derive(Debug, Clone, Serialize)]
pub struct Speed {
    /// Index of the run in the record.
    pub run: usize,
    /// Load as declared.
    pub load: f64,
    /// Whether the law was fitted on it.
    pub fitted: bool,
    /// Mean speed of the pinion, Hz.
    pub speed_hz: f64,
    /// Speed that the law gives, Hz.
    pub law_hz: f64,
    /// Slip measured and by the law, where a supply is found.
    pub slip: Option<[f64; 2]>,
    /// Error of the mesh without slip and with the law, shares; the first where a supply is found.
    pub mesh_error: (Option<f64>, f64),
    /// The supply's line on this run alone, Hz.
    pub supply_hz: Option<f64>,
}

/// The law.
#[derive(Debug, Clone, Serialize)]
pub struct Law {
    /// Coefficients of the powers of the load (over the largest fitted load) of the speed, Hz.
    pub coefficients_hz: Vec<f64>,
    /// Largest fitted load.
    pub full_load: f64,
    /// Error of constant, linear and quadratic law with one load left out, share of the speed.
    pub left_out: [f64; 3],
    /// The supply's line, Hz, the multiple of the shaft's rate that it is near, and its evidence, nats.
    pub supply: Option<(f64, u32, f64)>,
    /// Runs, by load.
    pub runs: Vec<Speed>,
}

/// The law of a record whose runs declare loads; none where there are too few.
pub fn law(record: &Record, scene: &Scene) -> Option<Law> {
    let load = |run: &SceneRun| record.runs[run.index].declaration.load();
    let mut runs: Vec<(f64, &SceneRun)> = scene.runs.iter().filter_map(|run| Some((load(run)?, run))).collect();
    runs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let fitted: Vec<(f64, &SceneRun)> = runs.iter().step_by(2).copied().collect();
    let full_load = fitted.last()?.0;
    if fitted.len() < MIN_LOADS || full_load <= 0.0 || fitted.windows(2).any(|w| w[0].0 == w[1].0) {
        return None;
    }
    let points: Vec<(f64, f64)> =
        fitted.iter().map(|(load, run)| (load / full_load, run.angle.speed.mean_hz)).collect();
    let left_out = [0, 1, 2].map(|degree| left_out(&points, degree));
    let degree = (0..3).min_by(|&a, &b| left_out[a].total_cmp(&left_out[b])).unwrap_or(1);
    let coefficients_hz = polynomial(&points, degree);
    let only: Vec<&SceneRun> = fitted.iter().map(|(_, run)| *run).collect();
    // Lines at other multiples of the synchronous rate may be stronger; the mains' own is the supply where it stands.
    let is_mains = |hz: f64| supply_hz(hz).is_some();
    let supply = MULTIPLES
        .filter_map(|k| supply(&only, scene.searched, k))
        .max_by(|a, b| is_mains(a.0).cmp(&is_mains(b.0)).then(a.2.total_cmp(&b.2)));
    let of_run = |(i, (load, run)): (usize, &(f64, &SceneRun))| {
        let (speed_hz, law_hz) = (run.angle.speed.mean_hz, value(&coefficients_hz, load / full_load));
        let synchronous = supply.map(|(hz, k, _)| hz / f64::from(k));
        Speed {
            run: run.index,
            load: *load,
            fitted: i % 2 == 0,
            speed_hz,
            law_hz,
            slip: synchronous.map(|s| [1.0 - speed_hz / s, 1.0 - law_hz / s]),
            mesh_error: (synchronous.map(|s| s / speed_hz - 1.0), law_hz / speed_hz - 1.0),
            supply_hz: supply.and_then(|(hz, k, _)| line(run, scene.searched, hz, k)),
        }
    };
    Some(Law { runs: runs.iter().enumerate().map(of_run).collect(), coefficients_hz, full_load, left_out, supply })
}

/// Least squares of the speed on powers of the load.
fn polynomial(points: &[(f64, f64)], degree: usize) -> Vec<f64> {
    let rows = nalgebra::DMatrix::from_fn(points.len(), degree + 1, |i, k| points[i].0.powi(k as i32));
    let speeds = nalgebra::DVector::from_fn(points.len(), |i, _| points[i].1);
    let solved = rows.svd(true, true).solve(&speeds, 1e-12);
    solved.map_or_else(|_| vec![0.0], |x| x.iter().copied().collect())
}

fn value(coefficients: &[f64], load: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * load + c)
}

/// RMS error of every load from the law of the others, share of the speed; infinite where they do not fix it.
fn left_out(points: &[(f64, f64)], degree: usize) -> f64 {
    if points.len() < degree + 2 {
        return f64::INFINITY;
    }
    let error = |i: usize| {
        let others: Vec<(f64, f64)> = (0..points.len()).filter(|j| *j != i).map(|j| points[j]).collect();
        value(&polynomial(&others, degree), points[i].0) / points[i].1 - 1.0
    };
    ((0..points.len()).map(|i| error(i).powi(2)).sum::<f64>() / points.len() as f64).sqrt()
}

/// The frequency above multiple `k` of the shaft's rate that the runs have in common, with its evidence after the
/// choice.
fn supply(runs: &[&SceneRun], channels: usize, k: u32) -> Option<(f64, u32, f64)> {
    let fastest = runs.iter().map(|run| run.angle.speed.mean_hz).fold(0.0, f64::max) * f64::from(k);
    let mut spectra = Vec::new();
    for run in runs {
        let own = f64::from(k) * run.angle.speed.mean_hz;
        for signal in &run.signals[..channels] {
            spectra.push((own, over_floor(&without(signal, run.rate_hz, own), run.rate_hz, own)));
        }
    }
    let bin = spectra.iter().map(|(_, (bin, _))| *bin).fold(f64::INFINITY, f64::min);
    let steps = (MAX_SLIP * fastest / (STEP * bin)) as usize;
    let alternatives = (steps as f64 * f64::from(*MULTIPLES.end())).max(1.0).ln();
    let score = |hz: f64| -> f64 {
        let readings = spectra.iter().filter_map(|(own, (bin, ratios))| {
            // The shaft's own line, though taken off, leaves a skirt.
            let ratio = *ratios.get((hz / bin).round() as usize)?;
            (hz > own + LOBE * bin).then(|| Reading { ratio: ratio.min(CAP), averages: 1.0 }.ln_bayes())
        });
        readings.sum()
    };
    let tried = (0..steps).map(|i| fastest + STEP * bin * i as f64);
    let (best, hz) = tried.map(|hz| (score(hz), hz)).max_by(|a, b| a.0.total_cmp(&b.0))?;
    if best - alternatives < MIN_LN_BAYES {
        return None;
    }
    let lines: Vec<f64> = runs.iter().filter_map(|run| line(run, channels, hz, k)).collect();
    let mean = lines.iter().sum::<f64>() / lines.len().max(1) as f64;
    (!lines.is_empty()).then_some((mean, k, best - alternatives))
}

/// The line nearest `hz` on one run, weighted by amplitude over the channels.
fn line(run: &SceneRun, channels: usize, hz: f64, k: u32) -> Option<f64> {
    let own = f64::from(k) * run.angle.speed.mean_hz;
    let half = 1.5 * run.rate_hz / run.signals.first()?.len() as f64;
    let lines = run.signals[..channels].iter().filter_map(|signal| {
        line_near(&without(signal, run.rate_hz, own), run.rate_hz, hz, half).map(|l| (l.amplitude, l.frequency_hz))
    });
    let (sum, weight) = lines.fold((0.0, 0.0), |(s, w), (amplitude, f)| (s + amplitude * f, w + amplitude));
    (weight > 0.0).then(|| sum / weight)
}

/// The signal less its line at the shaft's multiple.
fn without(signal: &[f64], rate_hz: f64, own_hz: f64) -> Vec<f64> {
    let half = rate_hz / signal.len().max(1) as f64;
    let Some(line) = line_near(signal, rate_hz, own_hz, half) else { return signal.to_vec() };
    let step = std::f64::consts::TAU * line.frequency_hz / rate_hz;
    signal.iter().enumerate().map(|(i, x)| x - line.amplitude * (step * i as f64 + line.phase_rad).cos()).collect()
}

/// Width of a bin and power over the median of the band around `own`, by bin.
fn over_floor(signal: &[f64], rate_hz: f64, own_hz: f64) -> (f64, Vec<f64>) {
    let spectrum = amplitude_spectrum(signal, rate_hz, Window::BlackmanHarris);
    let half = (2.0 * MAX_SLIP * own_hz / spectrum.bin) as usize;
    let centre = (own_hz / spectrum.bin) as usize;
    let band = centre.saturating_sub(half)..(centre + half).min(spectrum.values.len());
    let mut sorted: Vec<f64> = spectrum.values[band].iter().map(|a| a * a).collect();
    sorted.sort_by(f64::total_cmp);
    let median = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let floor = (median / std::f64::consts::LN_2).max(f64::MIN_POSITIVE);
    (spectrum.bin, spectrum.values.iter().map(|a| a * a / floor).collect())
}

impl Law {
    /// The law in one line.
    pub fn sentence(&self) -> String {
        let list = |values: &[f64], scale: f64| {
            values.iter().map(|v| format!("{:.4}", scale * v)).collect::<Vec<_>>().join(", ")
        };
        let errors = list(&self.left_out, 100.0);
        let powers = format!("by powers of load over {}", self.full_load);
        match self.supply {
            Some((hz, k, nats)) => {
                let synchronous = hz / f64::from(k);
                let mut slip: Vec<f64> = self.coefficients_hz.iter().map(|c| -100.0 * c / synchronous).collect();
                slip[0] += 100.0;
                format!(
                    "slip against load: {} % {powers}; supply line {hz:.4} Hz near {k} x shaft ({nats:.0} nats); \
                     leave-one-load-out error of constant, linear, quadratic law {errors} % of the speed",
                    list(&slip, 1.0)
                )
            }
            None => format!(
                "speed against load: {} Hz {powers}, no supply line found; leave-one-load-out error of constant, \
                 linear, quadratic law {errors} % of the speed",
                list(&self.coefficients_hz, 1.0)
            ),
        }
    }

    /// Run by run.
    pub fn table(&self) -> (Vec<&'static str>, Vec<Vec<String>>) {
        let percent = |share: f64| format!("{:.4}", 100.0 * share);
        let row = |s: &Speed| {
            vec![
                s.run.to_string(),
                format!("{}", s.load),
                if s.fitted { "fitted" } else { "predicted" }.to_owned(),
                format!("{:.4}", s.speed_hz),
                s.slip.map_or("-".into(), |[own, law]| format!("{} / {}", percent(own), percent(law))),
                s.mesh_error.0.map_or("-".into(), percent),
                percent(s.mesh_error.1),
                s.supply_hz.map_or("-".into(), |hz| format!("{hz:.4}")),
            ]
        };
        let head = vec![
            "run",
            "load",
            "",
            "shaft, Hz",
            "slip / by the law, %",
            "mesh without slip off by, %",
            "with the law, %",
            "supply line, Hz",
        ];
        (head, self.runs.iter().map(row).collect())
    }
}
