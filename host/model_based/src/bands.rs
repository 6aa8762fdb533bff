//! Band levels of record, declared and corrected model: what a node with the model's law would expect against what it
//! would report.
//!
//! A band is a mesh harmonic 1 to 5 with all sidebands nearer to it than to the next harmonic, RMS, as the node's
//! mesh-band spectra sum it. Held-out runs only. Levels in dB re 1 m/s2. The occupied bandwidth (99 % of the power
//! from 8 Hz to 15 kHz) says the same of the rate that the node would ask for.

use super::outcome::Outcome;
use super::replay::Replay;
use crate::spectral::noise_power;
use serde::Serialize;

/// One band, mean over the held-out runs.
#[derive(Debug, Clone, Serialize)]
pub struct Band {
    /// Channel, from 0.
    pub channel: usize,
    /// Mesh harmonic.
    pub harmonic: usize,
    /// RMS level of the record, dB re 1 m/s2.
    pub record_db: f64,
    /// Declared model less record, dB, RMS over the runs.
    pub declared_error_db: f64,
    /// Corrected model less record, dB, RMS over the runs.
    pub corrected_error_db: f64,
}

/// Levels of all bands.
pub fn bands(replay: &Replay, outcome: &Outcome) -> Vec<Band> {
    let base = &replay.declared;
    let z = f64::from(base.machine.teeth[0]);
    let unit = base.analyser.bin_power_of_unit_variance();
    let mut all = Vec::new();
    for channel in 0..2 {
        for harmonic in 1..=5 {
            let (mut level, mut squares, mut count) = (0.0, [0.0; 2], 0.0);
            for r in outcome.held_out_places() {
                let run = &base.runs[r];
                let mesh = z * run.angle.shaft_hz * base.analyser.duration_s();
                let from = ((harmonic as f64 - 0.5) * mesh) as usize;
                let to = ((harmonic as f64 + 0.5) * mesh) as usize;
                if to >= base.analyser.bins {
                    continue;
                }
                let decibel = |power: &dyn Fn(usize) -> f64| {
                    10.0 * ((from..to).map(power).sum::<f64>() / unit).max(f64::MIN_POSITIVE).log10()
                };
                let measured = &run.measured[channel];
                let record = decibel(&|b| measured[b].norm_sqr());
                let before = decibel(&|b| (measured[b] - replay.declared_residual[r][channel][b]).norm_sqr());
                let after = decibel(&|b| (measured[b] - replay.corrected_residual[r][channel][b]).norm_sqr());
                level += record;
                squares[0] += (before - record).powi(2);
                squares[1] += (after - record).powi(2);
                count += 1.0;
            }
            if count > 0.0 {
                let [declared_error_db, corrected_error_db] = squares.map(|s| (s / count).sqrt());
                all.push(Band { channel, harmonic, record_db: level / count, declared_error_db, corrected_error_db });
            }
        }
    }
    all
}

/// Bandwidth that holds 99 % of the power, mean over the held-out runs.
#[derive(Debug, Clone, Serialize)]
pub struct Occupied {
    /// Channel, from 0.
    pub channel: usize,
    /// Record, Hz.
    pub record_hz: f64,
    /// Declared model less record, Hz, RMS over the runs.
    pub declared_error_hz: f64,
    /// Corrected model less record, Hz, RMS over the runs.
    pub corrected_error_hz: f64,
}

/// Occupied bandwidths of both channels.
///
/// Noise is in the record only; the models are compared with its power taken off, which the lower quantile of the
/// corrected residual gives.
pub fn occupied(replay: &Replay, outcome: &Outcome) -> [Occupied; 2] {
    let base = &replay.declared;
    let lowest = (8.0 * base.analyser.duration_s()) as usize;
    [0, 1].map(|channel| {
        let (mut mean, mut squares) = (0.0, [0.0; 2]);
        for r in outcome.held_out_places() {
            let noise = noise_power(&replay.corrected_residual[r][channel]);
            let measured = &base.runs[r].measured[channel];
            let width = |power: &dyn Fn(usize) -> f64| {
                let whole: f64 = (lowest..noise.len()).map(power).sum();
                let mut held = 0.0;
                let at = (lowest..noise.len()).find(|&b| {
                    held += power(b);
                    held >= 0.99 * whole
                });
                at.unwrap_or(0) as f64 / base.analyser.duration_s()
            };
            let record = width(&|b| measured[b].norm_sqr() - noise[b]);
            let errors = [&replay.declared_residual, &replay.corrected_residual]
                .map(|rest| width(&|b| (measured[b] - rest[r][channel][b]).norm_sqr()) - record);
            mean += record / outcome.split[2].len() as f64;
            squares[0] += errors[0].powi(2);
            squares[1] += errors[1].powi(2);
        }
        let [declared_error_hz, corrected_error_hz] = squares.map(|s| (s / outcome.split[2].len() as f64).sqrt());
        Occupied { channel, record_hz: mean, declared_error_hz, corrected_error_hz }
    })
}
