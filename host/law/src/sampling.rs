//! The same signal at 10, 100 and 1000 kHz without an anti-alias filter, as the paper samples it.
//!
//! The periodic response is sampled directly, so the three signals differ in nothing but the rate. Below twice the
//! bandwidth the mesh harmonics fold: lines appear that are no property of the machine, named here by the node's own
//! `meshband::alias`. Sidebands count as findable when they stand 6 dB above everything else in their gap.
//! Mesh frequencies: those that the paper's unknown lines imply (least squares over both lines).

use super::derive::study_torque;
use super::operating::{Bench, Periodic};
use super::paper::{RATES_HZ, UNKNOWN_LINES, UnknownLines};
use super::study::crack_of;
use crate::machine::Machine;
use crate::spectral::{Spectrum, Window, amplitude_spectrum, line_near};
use crate::{Error, Result};
use meshband::alias::{Origin, explain};
use rayon::prelude::*;
use serde::Serialize;

/// Length of the sampled signals, s; bins of 0.2 Hz, as the paper's lines suggest.
const DURATION_S: f64 = 5.0;
/// Highest mesh harmonic considered when naming lines.
const HIGHEST_HARMONIC: u32 = 120;
/// How near a harmonic must be to name a line, Hz.
const NAME_TOLERANCE_HZ: f32 = 0.15;
/// Margin at which a sideband is findable.
const FINDABLE_DB: f64 = 6.0;

/// A line of a spectrum.
#[derive(Debug, Clone, Serialize)]
pub struct NamedLine {
    /// Frequency at which it appears, Hz.
    pub hz: f64,
    /// Peak amplitude, m/s2.
    pub amplitude: f64,
    /// Mesh harmonic that explains it; absent where none does.
    pub harmonic: Option<u32>,
    /// Whether that harmonic lies above half the sampling rate.
    pub folded: bool,
}

/// One rate.
#[derive(Debug, Clone, Serialize)]
pub struct RateCase {
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Rate over twice the edge's bandwidth: below 1 the signal folds.
    pub critical_share: f64,
    /// Strongest lines up to 2.3 times the mesh frequency, strongest first.
    pub lines: Vec<NamedLine>,
    /// Strongest folded line over the mesh line, dB.
    pub strongest_folded_db: Option<f64>,
    /// Standard deviation over mean of the largest value per mesh period: 0 for a healthy pulse train well sampled.
    pub peak_scatter: f64,
    /// Margin of each sideband (first to third, both sides, of the mesh frequency and its double) over what else stands
    /// in its gap, dB; empty for the healthy gear.
    pub sideband_margins_db: Vec<f64>,
    /// Sidebands with a margin of 6 dB.
    pub sidebands_findable: usize,
    /// First mesh periods, (s, m/s2), for the picture.
    #[serde(skip)]
    pub waveform: Vec<(f64, f64)>,
    /// Spectrum up to 2.3 times the mesh frequency, for the picture.
    #[serde(skip)]
    pub spectrum: Vec<(f64, f64)>,
}

/// A gear, healthy or cracked, at the three rates.
#[derive(Debug, Clone, Serialize)]
pub struct SamplingStudy {
    /// Whether a tooth is cracked.
    pub cracked: bool,
    /// Mesh frequency, Hz.
    pub mesh_hz: f64,
    /// One case per rate.
    pub rates: Vec<RateCase>,
    /// The paper's unknown lines: quoted, found in this simulation, error, harmonic that explains it.
    pub unknown: Vec<UnknownFound>,
}

/// A line that the paper calls unknown, found again.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct UnknownFound {
    /// As quoted, Hz.
    pub quoted_hz: f64,
    /// Frequency of the line in this simulation at 10 kHz, Hz.
    pub found_hz: f64,
    /// Its amplitude, m/s2.
    pub amplitude: f64,
    /// Its amplitude over the mesh line's.
    pub over_mesh_line: f64,
    /// Harmonic named by `meshband alias`.
    pub harmonic: Option<u32>,
}

/// The study for the healthy and the cracked gear.
///
/// # Errors
/// What stops the simulation, and a mesh line that is not there.
pub fn sampling_study(machine: &Machine, bandwidth_hz: &(impl Fn(f64) -> f64 + Sync)) -> Result<Vec<SamplingStudy>> {
    let torque = study_torque(machine)?;
    let mut cracked = machine.clone();
    cracked.crack = Some(crack_of(machine, 0.75 * machine.pair.module_m));
    let bench = Bench::new(&cracked)?;
    let simulated = UNKNOWN_LINES.into_iter().filter(|l| !l.measured);
    simulated
        .map(|lines| {
            let mesh_hz = lines.implied().mesh_hz;
            let shaft_hz = mesh_hz / f64::from(bench.teeth()[0]);
            let response =
                if lines.cracked { bench.cracked(shaft_hz, torque)? } else { bench.healthy(shaft_hz, torque)? };
            study(&response, &lines, mesh_hz, shaft_hz, 2.0 * bandwidth_hz(shaft_hz))
        })
        .collect()
}

fn study(
    response: &Periodic,
    paper: &UnknownLines,
    mesh_hz: f64,
    shaft_hz: f64,
    critical_hz: f64,
) -> Result<SamplingStudy> {
    let signals: Vec<(f64, Vec<f64>)> = RATES_HZ
        .into_par_iter()
        .map(|rate| (rate, response.sampled(rate, 0.25 / mesh_hz, (DURATION_S * rate) as usize)))
        .collect();
    let rates = signals
        .par_iter()
        .map(|(rate_hz, signal)| rate_case(*rate_hz, signal, paper.cracked, mesh_hz, shaft_hz, critical_hz))
        .collect();
    let (rate_hz, signal) = &signals[0];
    let near = |hz: f64| {
        let line = line_near(signal, *rate_hz, hz, 1.0);
        line.ok_or_else(|| Error::impossible("sampling study", format!("no line near {hz} Hz at {rate_hz} Hz")))
    };
    let mesh_line = near(mesh_hz)?.amplitude;
    let unknown = paper
        .lines_hz
        .into_iter()
        .map(|quoted_hz| {
            let line = near(quoted_hz)?;
            let named = name(line.frequency_hz, mesh_hz, *rate_hz);
            Ok(UnknownFound {
                quoted_hz,
                found_hz: line.frequency_hz,
                amplitude: line.amplitude,
                over_mesh_line: line.amplitude / mesh_line,
                harmonic: named.map(|n| n.0),
            })
        })
        .collect::<Result<_>>()?;
    Ok(SamplingStudy { cracked: paper.cracked, mesh_hz, rates, unknown })
}

/// Harmonic that explains a line, and whether it is folded.
fn name(hz: f64, mesh_hz: f64, rate_hz: f64) -> Option<(u32, bool)> {
    match explain(hz as f32, mesh_hz as f32, rate_hz as f32, NAME_TOLERANCE_HZ, HIGHEST_HARMONIC) {
        Origin::Genuine(found) => Some((found.harmonic, false)),
        Origin::Folded(found) => Some((found.harmonic, true)),
        Origin::Unexplained => None,
    }
}

fn rate_case(rate_hz: f64, signal: &[f64], cracked: bool, mesh_hz: f64, shaft_hz: f64, critical_hz: f64) -> RateCase {
    let spectrum = amplitude_spectrum(signal, rate_hz, Window::BlackmanHarris);
    let lines = strongest(&spectrum, 2.3 * mesh_hz, mesh_hz, rate_hz);
    let mesh_line = spectrum.peak_between(mesh_hz - 0.5, mesh_hz + 0.5).map_or(0.0, |i| spectrum.values[i]);
    let folded = lines.iter().filter(|l| l.folded).map(|l| l.amplitude).fold(0.0, f64::max);
    let margins = if cracked { sideband_margins_db(&spectrum, mesh_hz, shaft_hz) } else { Vec::new() };
    let per_period = rate_hz / mesh_hz;
    let peak = |n: usize| {
        let (from, to) = ((n as f64 * per_period) as usize, ((n + 1) as f64 * per_period) as usize);
        signal[from..to.min(signal.len())].iter().copied().fold(f64::NEG_INFINITY, f64::max)
    };
    let peaks: Vec<f64> = (0..200).map(peak).collect();
    let mean = peaks.iter().sum::<f64>() / peaks.len() as f64;
    let deviation = (peaks.iter().map(|p| (p - mean).powi(2)).sum::<f64>() / peaks.len() as f64).sqrt();
    let shown = (6.0 * per_period) as usize;
    let bins = (2.3 * mesh_hz / spectrum.bin) as usize;
    RateCase {
        rate_hz,
        critical_share: rate_hz / critical_hz,
        strongest_folded_db: (folded > 0.0).then(|| 20.0 * (folded / mesh_line).log10()),
        peak_scatter: deviation / mean.abs(),
        sidebands_findable: margins.iter().filter(|m| **m >= FINDABLE_DB).count(),
        sideband_margins_db: margins,
        waveform: (0..shown).map(|i| (1e3 * i as f64 / rate_hz, signal[i])).collect(),
        spectrum: (0..bins.min(spectrum.values.len())).map(|i| (spectrum.frequency(i), spectrum.values[i])).collect(),
        lines,
    }
}

/// The ten strongest local maxima up to a frequency.
fn strongest(spectrum: &Spectrum, up_to_hz: f64, mesh_hz: f64, rate_hz: f64) -> Vec<NamedLine> {
    let v = &spectrum.values;
    let last = ((up_to_hz / spectrum.bin) as usize).min(v.len().saturating_sub(6));
    let largest = v.iter().take(last).copied().fold(0.0, f64::max);
    // A line is the largest value within five bins: the window's main lobe has four on each side.
    let is_line = |i: &usize| v[*i] > 1e-4 * largest && (i - 5..=i + 5).all(|j| v[j] <= v[*i]);
    let mut lines: Vec<NamedLine> = (5..last)
        .filter(is_line)
        .map(|i| {
            // Centre of the main lobe from the two neighbours (amplitude-weighted).
            let sum = v[i - 1] + v[i] + v[i + 1];
            let hz = spectrum.bin * (i as f64 + (v[i + 1] - v[i - 1]) / sum);
            let named = name(hz, mesh_hz, rate_hz);
            NamedLine { hz, amplitude: v[i], harmonic: named.map(|n| n.0), folded: named.is_some_and(|n| n.1) }
        })
        .collect();
    lines.sort_by(|a, b| b.amplitude.total_cmp(&a.amplitude));
    lines.truncate(10);
    lines
}

/// Margin of the first three sidebands on both sides of the first two mesh harmonics, dB.
fn sideband_margins_db(spectrum: &Spectrum, mesh_hz: f64, shaft_hz: f64) -> Vec<f64> {
    let bins = 6.0 * spectrum.bin;
    let highest = |from: f64, to: f64| spectrum.peak_between(from, to).map_or(0.0, |i| spectrum.values[i]);
    let mut margins = Vec::new();
    for centre in [mesh_hz, 2.0 * mesh_hz] {
        for k in [-3.0, -2.0, -1.0, 1.0, 2.0, 3.0] {
            let at = centre + k * shaft_hz;
            let line = highest(at - 2.0 * spectrum.bin, at + 2.0 * spectrum.bin);
            let half = 0.5 * shaft_hz;
            let clutter = highest(at - half, at - bins).max(highest(at + bins, at + half));
            margins.push(20.0 * (line / clutter.max(f64::MIN_POSITIVE)).log10());
        }
    }
    margins
}
