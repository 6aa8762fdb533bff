//! GFD: a two-stage box driven by an induction motor at 30 Hz supply, ten loads, healthy (h) and with a broken tooth (b).
//!
//! The model without slip and supply expects the mesh at teeth x 30 Hz and no line at twice the supply. Shaft speed per file
//! comes from the mesh and shaft comb (32 teeth), the supply from the line near 60 Hz that does not follow the shaft. Slip as a law of load is fitted
//! on some loads and predicts the others. All frequencies rest on an inferred sampling rate of 12,800 Hz. Limits: no
//! tach, no units; mesh lines hold little of the power, so line positions are scored, not waveforms.

use super::comb::{Power, mean_excess};
use crate::spectral::line_near;
use crate::{Error, Result, terminal};
use rayon::prelude::*;
use serde::Serialize;
use std::path::Path;

const RATE_HZ: f64 = 12_800.0;
const TEETH: f64 = 32.0;
const POLE_PAIRS_SYNC_HZ: f64 = 30.0;
const FIT_LOADS: [u32; 4] = [0, 20, 50, 70];
const HELD_OUT_LOADS: [u32; 4] = [10, 30, 60, 90];

/// What one file says.
#[derive(Debug, Clone, Serialize)]
pub struct Measured {
    /// h or b, and load in percent.
    pub series: String,
    /// Load, %.
    pub load_percent: u32,
    /// Input shaft, Hz.
    pub shaft_hz: f64,
    /// Line of twice the supply, Hz.
    pub electric_hz: f64,
    /// Its amplitude, file units, mean of the channels.
    pub electric_amplitude: f64,
    /// Amplitudes at 1x and 3x of the input shaft.
    pub shaft_amplitudes: [f64; 2],
    /// Slip against half the supply line fitted on the fitting loads.
    pub slip: f64,
}

/// Prediction of a held-out load.
#[derive(Debug, Clone, Serialize)]
pub struct Predicted {
    /// h or b.
    pub series: String,
    /// Load, %.
    pub load_percent: u32,
    /// Mesh frequency measured on this load, Hz.
    pub mesh_hz: f64,
    /// Error of the mesh frequency without slip, %.
    pub mesh_error_before_percent: f64,
    /// Error with the slip law, %.
    pub mesh_error_after_percent: f64,
    /// Slip measured and predicted, %.
    pub slip_percent: [f64; 2],
    /// Error of the slip in percent of synchronous speed.
    pub slip_error_percent: f64,
    /// Electric line measured, and the error of the prediction, Hz.
    pub electric_hz: [f64; 2],
    /// Median distance of standing shaft and sideband lines from their predicted place, Hz: without slip, with it.
    pub line_error_hz: [f64; 2],
    /// Shaft and sideband lines that stand out, of those looked for.
    pub lines_standing: [usize; 2],
}

/// Result.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// Fitting and held-out files.
    pub measured: Vec<Measured>,
    /// Slip law chosen: coefficients of powers of load (share of full load), slip as a share.
    pub slip_law: Vec<f64>,
    /// Leave-one-load-out error of the fitting loads, % of mesh frequency: constant, linear, quadratic law.
    pub leave_one_out_percent: [f64; 3],
    /// Electric line fitted, Hz.
    pub electric_hz: f64,
    /// Predictions.
    pub predicted: Vec<Predicted>,
    /// What must not be concluded.
    pub caution: &'static str,
}

/// Runs the analysis on `data/gfd`.
///
/// # Errors
/// Absent or unreadable files, no comb near 30 Hz.
pub fn run(data: &Path) -> Result<Outcome> {
    let all: Vec<(char, u32)> =
        ['h', 'b'].into_iter().flat_map(|s| FIT_LOADS.iter().chain(&HELD_OUT_LOADS).map(move |&l| (s, l))).collect();
    let mut files: Vec<(Measured, Vec<Power>)> =
        all.par_iter().map(|&(series, load)| measure(data, series, load)).collect::<Result<Vec<_>>>()?;
    files.sort_by_key(|f| (f.0.series.clone(), f.0.load_percent));
    let fitting = |m: &Measured| FIT_LOADS.contains(&m.load_percent);
    let electric_hz = files.iter().filter(|f| fitting(&f.0)).map(|f| f.0.electric_hz).sum::<f64>()
        / files.iter().filter(|f| fitting(&f.0)).count() as f64;
    // One supply for all files: its line is weak at low load, so slip is counted from the fitted supply.
    files.iter_mut().for_each(|f| f.0.slip = 1.0 - 2.0 * f.0.shaft_hz / electric_hz);
    let fit: Vec<&Measured> = files.iter().map(|f| &f.0).filter(|m| fitting(m)).collect();
    let leave_one_out = [0, 1, 2].map(|degree| leave_one_out(&fit, degree));
    let degree = (0..3).min_by(|&a, &b| leave_one_out[a].total_cmp(&leave_one_out[b])).unwrap_or(1);
    let law = polynomial(&fit, degree);
    let predicted = files
        .iter()
        .filter(|f| HELD_OUT_LOADS.contains(&f.0.load_percent))
        .map(|(m, power)| predict(m, power, &law, electric_hz))
        .collect();
    Ok(Outcome {
        slip_law: law,
        leave_one_out_percent: leave_one_out.map(|e| 100.0 * e),
        electric_hz,
        predicted,
        measured: files.into_iter().map(|f| f.0).collect(),
        caution: "the box was taken apart between the two series: differences between h and b are no proof of a tooth effect",
    })
}

fn measure(data: &Path, series: char, load: u32) -> Result<(Measured, Vec<Power>)> {
    let name = format!("{series}30hz{load}.csv.gz");
    let columns = super::file(data, "gfd", &name)?;
    let power: Vec<Power> = columns.channels.iter().map(|c| Power::new(c, RATE_HZ)).collect();
    let shaft_hz = shaft(&power).ok_or_else(|| Error::impossible(&name, "no mesh comb below 30 Hz x 32"))?;
    // The shaft's second harmonic lies half a hertz below: taken out first.
    let cleaned: Vec<Vec<f64>> = columns.channels.par_iter().map(|c| without(c, 2.0 * shaft_hz)).collect();
    let electric = strongest(&cleaned, 2.0 * POLE_PAIRS_SYNC_HZ, 0.2)
        .ok_or_else(|| Error::impossible(&name, "no line near twice the supply"))?;
    let amplitude = |hz: f64| {
        let lines = columns.channels.iter().filter_map(|c| line_near(c, RATE_HZ, hz, 0.3));
        lines.map(|l| l.amplitude).sum::<f64>() / columns.channels.len() as f64
    };
    let measured = Measured {
        series: series.to_string(),
        load_percent: load,
        shaft_hz,
        electric_hz: electric,
        electric_amplitude: amplitude(electric),
        shaft_amplitudes: [amplitude(shaft_hz), amplitude(3.0 * shaft_hz)],
        slip: 1.0 - 2.0 * shaft_hz / electric,
    };
    Ok((measured, power))
}

/// The signal less its line near `hz`.
fn without(signal: &[f64], hz: f64) -> Vec<f64> {
    let Some(line) = line_near(signal, RATE_HZ, hz, 0.15) else { return signal.to_vec() };
    let step = std::f64::consts::TAU * line.frequency_hz / RATE_HZ;
    signal.iter().enumerate().map(|(i, x)| x - line.amplitude * (step * i as f64 + line.phase_rad).cos()).collect()
}

/// Amplitude-weighted frequency over the channels.
fn strongest(channels: &[Vec<f64>], hz: f64, width: f64) -> Option<f64> {
    let (mut sum, mut weight) = (0.0, 0.0);
    for line in channels.iter().filter_map(|c| line_near(c, RATE_HZ, hz, width)) {
        sum += line.amplitude * line.frequency_hz;
        weight += line.amplitude;
    }
    (weight > 0.0).then(|| sum / weight)
}

/// Orders of the input shaft that speak for its speed: mesh harmonics, their shaft sidebands, 1x and 3x.
fn orders() -> Vec<f64> {
    let mut orders = vec![1.0, 3.0];
    for h in 1..=3 {
        for k in [-3.0, -1.0, 0.0, 1.0, 3.0] {
            orders.push(f64::from(h) * TEETH + k);
        }
    }
    orders
}

/// Input shaft between 3 % slip and synchronous speed whose comb stands highest.
fn shaft(power: &[Power]) -> Option<f64> {
    let excess = mean_excess(power);
    let bin = power.first()?.bin;
    let orders = orders();
    let height = |hz: f64| -> f64 {
        let at = |o: f64| {
            let x = o * hz / bin;
            let i = x as usize;
            let value = |i: usize| excess.get(i).copied().unwrap_or(1.0).clamp(0.1, 300.0).ln();
            value(i) + (x - i as f64) * (value(i + 1) - value(i))
        };
        orders.iter().map(|&o| at(o)).sum()
    };
    let step = 0.1 * bin / (3.0 * TEETH);
    let count = (0.03 * POLE_PAIRS_SYNC_HZ / step) as usize;
    let coarse = (0..count)
        .map(|i| 0.97 * POLE_PAIRS_SYNC_HZ + step * i as f64)
        .max_by(|a, b| height(*a).total_cmp(&height(*b)))?;
    // Centroid of the standing lines, each weighted by its height and order.
    let (mut sum, mut weight) = (0.0, 0.0);
    for &o in &orders {
        let i = (o * coarse / bin).round() as usize;
        let near = excess.get(i.saturating_sub(2)..i + 3)?;
        if near.iter().all(|e| *e < 10.0) {
            continue;
        }
        let total: f64 = near.iter().sum();
        let centre = near.iter().enumerate().map(|(k, e)| (i as f64 - 2.0 + k as f64) * e).sum::<f64>() / total;
        let w = o * o * total.min(1000.0);
        sum += w * centre * bin / o;
        weight += w;
    }
    Some(if weight > 0.0 { sum / weight } else { coarse })
}

/// Least squares of slip on powers of load up to `degree`.
fn polynomial(files: &[&Measured], degree: usize) -> Vec<f64> {
    let rows = nalgebra::DMatrix::from_fn(files.len(), degree + 1, |i, k| {
        (f64::from(files[i].load_percent) / 100.0).powi(k as i32)
    });
    let slips = nalgebra::DVector::from_fn(files.len(), |i, _| files[i].slip);
    let solved = rows.svd(true, true).solve(&slips, 1e-12);
    solved.map_or_else(|_| vec![0.0], |x| x.iter().copied().collect())
}

fn slip(law: &[f64], load_percent: u32) -> f64 {
    law.iter().rev().fold(0.0, |sum, c| sum * f64::from(load_percent) / 100.0 + c)
}

/// RMS error of the slip of each fitting load from the others.
fn leave_one_out(files: &[&Measured], degree: usize) -> f64 {
    let errors: Vec<f64> = FIT_LOADS
        .iter()
        .flat_map(|&left| {
            let others: Vec<&Measured> = files.iter().filter(|m| m.load_percent != left).copied().collect();
            let law = polynomial(&others, degree);
            let own: Vec<f64> =
                files.iter().filter(|m| m.load_percent == left).map(|m| slip(&law, left) - m.slip).collect();
            own
        })
        .collect();
    (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt()
}

fn predict(m: &Measured, power: &[Power], law: &[f64], electric_hz: f64) -> Predicted {
    let slip = slip(law, m.load_percent);
    let shaft = 0.5 * electric_hz * (1.0 - slip);
    let excess = mean_excess(power);
    let bin = power[0].bin;
    let orders = orders();
    let mut errors = [Vec::new(), Vec::new()];
    for &o in &orders {
        // The measured line is looked for where the file's own speed puts it.
        let i = (o * m.shaft_hz / bin).round() as usize;
        let Some(near) = excess.get(i.saturating_sub(2)..i + 3) else { continue };
        let total: f64 = near.iter().sum();
        if near.iter().any(|e| *e > 10.0) {
            let centre = near.iter().enumerate().map(|(k, e)| (i as f64 - 2.0 + k as f64) * e).sum::<f64>() / total;
            errors[0].push((centre * bin - o * POLE_PAIRS_SYNC_HZ).abs());
            errors[1].push((centre * bin - o * shaft).abs());
        }
    }
    let standing = errors[0].len();
    let line_error_hz = errors.map(|mut e| {
        e.sort_by(f64::total_cmp);
        e.get(e.len() / 2).copied().unwrap_or(f64::NAN)
    });
    Predicted {
        series: m.series.clone(),
        load_percent: m.load_percent,
        mesh_hz: TEETH * m.shaft_hz,
        mesh_error_before_percent: 100.0 * (POLE_PAIRS_SYNC_HZ / m.shaft_hz - 1.0),
        mesh_error_after_percent: 100.0 * (shaft / m.shaft_hz - 1.0),
        slip_percent: [100.0 * m.slip, 100.0 * slip],
        slip_error_percent: 100.0 * (slip - m.slip),
        electric_hz: [m.electric_hz, electric_hz - m.electric_hz],
        line_error_hz,
        lines_standing: [standing, orders.len()],
    }
}

impl Outcome {
    /// Tables for the terminal.
    pub fn summary(&self) -> String {
        let rows: Vec<Vec<String>> = self
            .measured
            .iter()
            .map(|m| {
                vec![
                    format!("{} {:>2} %", m.series, m.load_percent),
                    format!("{:.3}", TEETH * m.shaft_hz),
                    format!("{:.4}", m.shaft_hz),
                    format!("{:.3}", 100.0 * m.slip),
                    format!("{:.4}", m.electric_hz),
                    format!("{:.4}", m.electric_amplitude),
                    format!("{:.3}", m.shaft_amplitudes[0]),
                    format!("{:.3}", m.shaft_amplitudes[1]),
                ]
            })
            .collect();
        let head = ["file", "mesh, Hz", "shaft, Hz", "slip, %", "2 x supply, Hz", "its size", "1x", "3x"];
        let mut text = terminal::table(&head, &rows);
        text += &format!(
            "slip law by powers of load {:?}; leave-one-load-out error {:?} % for constant, linear, quadratic\n",
            self.slip_law, self.leave_one_out_percent
        );
        let rows: Vec<Vec<String>> = self
            .predicted
            .iter()
            .map(|p| {
                vec![
                    format!("{} {:>2} %", p.series, p.load_percent),
                    format!("{:.3}", p.mesh_error_before_percent),
                    format!("{:.4}", p.mesh_error_after_percent),
                    format!("{:.3} / {:.3}", p.slip_percent[0], p.slip_percent[1]),
                    format!("{:.4}", p.electric_hz[1]),
                    format!("{:.3} -> {:.3}", p.line_error_hz[0], p.line_error_hz[1]),
                    format!("{} of {}", p.lines_standing[0], p.lines_standing[1]),
                ]
            })
            .collect();
        let head =
            ["held out", "mesh before, %", "after, %", "slip / predicted, %", "supply, Hz", "lines, Hz", "standing"];
        text += &terminal::table(&head, &rows);
        text + "caution: " + self.caution + "\n"
    }
}
