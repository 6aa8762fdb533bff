//! ADI rotor rig (no gears): balanced, low and high unbalance at 3000 rpm; what one speed can and cannot say about imbalance.
//!
//! The model without imbalance has no line at the shaft rate. On the first half of each record the shaft rate, and amplitude and phase at
//! its first harmonics, are fitted; they then predict the second half's waveform below 200 Hz with nothing refitted. The law `A ~ f^2`
//! needs a second speed and is not testable here. Amplitudes are volts of the sensor.

use crate::spectral::line_near;
use crate::{Result, terminal};
use serde::Serialize;
use std::f64::consts::TAU;
use std::path::Path;

const FILES: [(&str, &str); 3] = [
    ("balanced", "3000_GoB_GS_BaLo_WA_00lb.Wfm.csv"),
    ("low unbalance", "3000_GoB_GS_VLIL_WA_00lb.Wfm.csv"),
    ("high unbalance", "3000_GoB_GS_VHIL_WA_00lb.Wfm.csv"),
];
const RATE_HZ: f64 = 20_000.0;
const NOMINAL_HZ: f64 = 50.0;
/// Samples per point of the compared signal: block means of 50 samples keep what lies below 200 Hz.
const BLOCK: usize = 50;

/// One file.
#[derive(Debug, Clone, Serialize)]
pub struct Case {
    /// State of the rotor.
    pub state: String,
    /// Shaft rate, Hz.
    pub shaft_hz: f64,
    /// Amplitudes at 1x, 2x, 3x, V, x axis.
    pub amplitude_v: [f64; 3],
    /// NRMSE of the second half below 200 Hz: without imbalance, with 1x, with 1x to 3x, all from the first half.
    pub held_out_nrmse: [f64; 3],
}

/// Result.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// Files.
    pub cases: Vec<Case>,
    /// What cannot be said.
    pub caution: &'static str,
}

/// Runs the analysis on `data/adi`.
///
/// # Errors
/// Absent or unreadable files.
pub fn run(data: &Path) -> Result<Outcome> {
    let mut cases = Vec::new();
    for (state, name) in FILES {
        let columns = super::file(data, "adi", name)?;
        cases.push(case(state, &columns.channels[0]));
    }
    let caution =
        "one speed only: the exponent of speed, and so imbalance against a bent shaft or a coupling, is not decided";
    Ok(Outcome { cases, caution })
}

fn case(state: &str, signal: &[f64]) -> Case {
    let low: Vec<f64> = signal.chunks_exact(BLOCK).map(|b| b.iter().sum::<f64>() / BLOCK as f64).collect();
    let rate = RATE_HZ / BLOCK as f64;
    let half = low.len() / 2;
    let mean = low[..half].iter().sum::<f64>() / half as f64;
    let guess = line_near(&low[..half], rate, NOMINAL_HZ, 1.5).map_or(NOMINAL_HZ, |l| l.frequency_hz);
    let lines: Vec<_> =
        (1..=3).map(|k| line_near(&low[..half], rate, f64::from(k) * guess, 0.6).map(|l| (k, l))).collect();
    let nrmse = |harmonics: usize| {
        let (mut error, mut power) = (0.0, 0.0);
        for (i, x) in low.iter().enumerate().skip(half) {
            let model: f64 = lines[..harmonics]
                .iter()
                .flatten()
                .map(|(k, l)| {
                    // All harmonics ride on the fundamental's frequency; each keeps its own phase at the centre of the fit.
                    let centre = 0.5 * half as f64 / rate;
                    let phase = l.phase_rad + TAU * l.frequency_hz * centre;
                    l.amplitude * (TAU * f64::from(*k) * guess * (i as f64 / rate - centre) + phase).cos()
                })
                .sum();
            error += (x - mean - model).powi(2);
            power += (x - mean).powi(2);
        }
        (error / power).sqrt()
    };
    // Block means lower a line by the sinc of its place: given back here.
    let sinc = |hz: f64| {
        let x = std::f64::consts::PI * hz / rate;
        x.sin() / x
    };
    let amplitude = |k: usize| lines[k].as_ref().map_or(0.0, |(_, l)| l.amplitude / sinc(l.frequency_hz));
    Case {
        state: state.into(),
        shaft_hz: guess,
        amplitude_v: [amplitude(0), amplitude(1), amplitude(2)],
        held_out_nrmse: [nrmse(0), nrmse(1), nrmse(3)],
    }
}

impl Outcome {
    /// Table for the terminal.
    pub fn summary(&self) -> String {
        let rows: Vec<Vec<String>> = self
            .cases
            .iter()
            .map(|c| {
                let mut row = vec![c.state.clone(), format!("{:.3}", c.shaft_hz)];
                row.extend(c.amplitude_v.map(|a| format!("{:.2}", 1e3 * a)));
                row.extend(c.held_out_nrmse.map(|e| format!("{e:.3}")));
                row
            })
            .collect();
        let head = ["rotor", "shaft, Hz", "1x, mV", "2x, mV", "3x, mV", "NRMSE without", "with 1x", "with 1x-3x"];
        terminal::table(&head, &rows) + "caution: " + self.caution + "\n"
    }
}
