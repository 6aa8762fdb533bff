//! Paderborn bearing rig (no gears, 6203, 1500 rpm): ring damage as a comb in the envelope.
//!
//! Squared envelope of 2 to 12 kHz (analytic signal by FFT). A model without impacts has a smooth envelope spectrum. Combs are searched on the first half and the share of
//! the envelope's variance below 500 Hz that their lines hold is read on the second half, beside combs of shifted spacing.
//! The kinematic passage frequencies of the bearing name a comb only within 2 % (rolling elements slip).

use super::comb::{Power, Search, mean_excess, refine};
use crate::{Result, terminal};
use rustfft::FftPlanner;
use rustfft::num_complex::Complex64;
use serde::Serialize;
use std::path::Path;

const RATE_HZ: f64 = 64_000.0;
const SHAFT_HZ: f64 = 25.0;
const BAND_HZ: [f64; 2] = [2_000.0, 12_000.0];
const TOP_HZ: f64 = 500.0;
const HALF_WIDTH_HZ: f64 = 1.0;
/// 6203: rolling elements, and their diameter over the pitch diameter (general knowledge of the type).
const ELEMENTS: f64 = 8.0;
const RATIO: f64 = 0.2368;
const FILES: [(&str, &str); 3] = [
    ("K001, called healthy", "N15_M07_F10_K001_1.csv"),
    ("KA04, outer ring damaged", "N15_M07_F10_KA04_1.csv"),
    ("KI04, inner ring damaged", "N15_M07_F10_KI04_1.csv"),
];

/// One comb.
#[derive(Debug, Clone, Serialize)]
pub struct Comb {
    /// Spacing, Hz.
    pub spacing_hz: f64,
    /// Height of its score, and what chance gives.
    pub sigma: [f64; 2],
    /// Share of the envelope's variance below 500 Hz on the second half, %.
    pub share_percent: f64,
    /// The same for shifted spacings: median and largest, %.
    pub control_percent: [f64; 2],
    /// What it is.
    pub reading: String,
}

/// One file.
#[derive(Debug, Clone, Serialize)]
pub struct Case {
    /// Bearing.
    pub bearing: String,
    /// Combs, strongest first.
    pub combs: Vec<Comb>,
    /// Share of the envelope's variance left outside all of them, %.
    pub left_percent: f64,
}

/// Result.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// Kinematic passage of outer and inner ring, Hz.
    pub kinematic_hz: [f64; 2],
    /// Files.
    pub cases: Vec<Case>,
}

/// Runs the analysis on `data/paderborn`.
///
/// # Errors
/// Absent or unreadable files.
pub fn run(data: &Path) -> Result<Outcome> {
    let kinematic_hz = [1.0 - RATIO, 1.0 + RATIO].map(|r| 0.5 * ELEMENTS * r * SHAFT_HZ);
    let mut cases = Vec::new();
    for (bearing, name) in FILES {
        let columns = super::file(data, "paderborn", name)?;
        cases.push(case(bearing, &columns.channels[0], kinematic_hz));
    }
    Ok(Outcome { kinematic_hz, cases })
}

/// Squared envelope of a band, from the analytic signal, thinned to 4 kHz.
fn envelope(signal: &[f64]) -> Vec<f64> {
    let n = signal.len();
    let mut planner = FftPlanner::new();
    let mut x: Vec<Complex64> = signal.iter().map(|&v| Complex64::new(v, 0.0)).collect();
    planner.plan_fft_forward(n).process(&mut x);
    for (i, value) in x.iter_mut().enumerate() {
        let hz = i as f64 * RATE_HZ / n as f64;
        *value *= if (BAND_HZ[0]..BAND_HZ[1]).contains(&hz) { 2.0 / n as f64 } else { 0.0 };
    }
    planner.plan_fft_inverse(n).process(&mut x);
    x.chunks_exact(16).map(|block| block.iter().map(|z| z.norm_sqr()).sum::<f64>() / 16.0).collect()
}

fn case(bearing: &str, signal: &[f64], kinematic_hz: [f64; 2]) -> Case {
    let squared = envelope(signal);
    let half = squared.len() / 2;
    let mut power = [&squared[..half], &squared[half..2 * half]].map(|part| Power::new(part, RATE_HZ / 16.0));
    for p in &mut power {
        let top = (TOP_HZ / p.bin) as usize;
        p.values.truncate(top);
        p.values[..(4.0 / p.bin) as usize].fill(0.0);
    }
    let [first, second] = power;
    let excess = mean_excess(std::slice::from_ref(&first));
    let mut named = first.mask(&[0.0], 4.0);
    let mut combs: Vec<Comb> = Vec::new();
    while combs.len() < 4 {
        let mut carriers = vec![0.0];
        carriers.extend(combs.iter().flat_map(|c| (1..=3).map(|k| f64::from(k) * c.spacing_hz)));
        let search = Search { spacing: [12.0, 160.0], multiples: 4, carriers: carriers.clone(), top: TOP_HZ };
        let Some(best) = search.best(first.bin, &excess, &named) else { break };
        let chance = search.chance(first.bin, &excess, &named);
        if best.sigma < chance {
            break;
        }
        let spacing = refine(first.bin, &excess, &carriers, best.spacing, 4);
        let lines = |s: f64| -> Vec<f64> {
            let around = carriers.iter().flat_map(|&c| (-4..=4).filter(|j| *j != 0).map(move |j| c + f64::from(j) * s));
            around.filter(|at| *at > 4.0).collect()
        };
        let total = second.total();
        let share = |s: f64| {
            let mut mask = second.mask(&lines(s), HALF_WIDTH_HZ);
            mask.iter_mut().zip(&named).for_each(|(m, n)| *m &= !*n);
            100.0 * second.within(&mask) / total
        };
        let mut control: Vec<f64> = (0..40)
            .map(|i| share(spacing * (1.0 + (0.02 + 0.002 * f64::from(i / 2)) * if i % 2 == 0 { 1.0 } else { -1.0 })))
            .collect();
        control.sort_by(f64::total_cmp);
        let share_percent = share(spacing);
        // A comb that holds no more of the second half than a shifted one is no finding.
        if share_percent < control[39] {
            break;
        }
        lines(spacing).iter().for_each(|&at| first.mark(&mut named, at, HALF_WIDTH_HZ));
        combs.push(Comb {
            spacing_hz: spacing,
            sigma: [best.sigma, chance],
            share_percent,
            control_percent: [control[20], control[39]],
            reading: reading(spacing, kinematic_hz),
        });
    }
    let left_percent = 100.0 - 100.0 * second.within(&named) / second.total();
    Case { bearing: bearing.into(), combs, left_percent }
}

fn reading(spacing: f64, kinematic_hz: [f64; 2]) -> String {
    let near = |hz: f64| (spacing / hz - 1.0).abs() < 0.02;
    let order = spacing / SHAFT_HZ;
    if near(kinematic_hz[0]) {
        "outer-ring passage".into()
    } else if near(kinematic_hz[1]) {
        "inner-ring passage".into()
    } else if order > 0.5 && (order - order.round()).abs() < 0.01 {
        format!("{} x shaft", order.round())
    } else {
        format!("order {order:.3} of the shaft, unexplained")
    }
}

impl Outcome {
    /// Table for the terminal.
    pub fn summary(&self) -> String {
        let [outer, inner] = self.kinematic_hz;
        let mut text = format!("kinematic passage: outer {outer:.2} Hz, inner {inner:.2} Hz\n");
        for case in &self.cases {
            text += &format!("{}: {:.1} % of the envelope's variance left\n", case.bearing, case.left_percent);
            let rows: Vec<Vec<String>> = case
                .combs
                .iter()
                .map(|c| {
                    vec![
                        format!("  {}", c.reading),
                        format!("{:.3}", c.spacing_hz),
                        format!("{:.1} ({:.1})", c.sigma[0], c.sigma[1]),
                        format!("{:.1}", c.share_percent),
                        format!("{:.1} / {:.1}", c.control_percent[0], c.control_percent[1]),
                    ]
                })
                .collect();
            text += &terminal::table(&["  comb", "Hz", "sigma (chance)", "held-out share, %", "control, %"], &rows);
        }
        text
    }
}
