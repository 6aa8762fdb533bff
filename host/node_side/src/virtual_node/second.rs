//! A second sensor's values against its own signal in f64, over the very stretches that the node took them from.

use super::board::Clock;
use super::frames::Received;
use super::signal::Signal;
use meshband::message::{Indicators, Message};
use serde::Serialize;

/// Values of a record. Amplitudes in the signal's unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SecondRow {
    /// First sample, s from the signal's start.
    pub start_s: f64,
    /// Length, s.
    pub length_s: f64,
    /// Whole turns of the pinion in it.
    pub turns: u16,
    /// Root mean square about the mean, as reported.
    pub rms: f64,
    /// The same of the signal.
    pub reference_rms: f64,
    /// Largest distance from the mean, as reported.
    pub peak: f64,
    /// The same of the signal's samples; what lies between them may be higher.
    pub reference_peak: f64,
    /// As reported.
    pub kurtosis: f64,
    /// The same of the signal's samples.
    pub reference_kurtosis: f64,
    /// Root mean square of the velocity, m/s, as reported.
    pub velocity_rms: f64,
}

impl SecondRow {
    /// Relative error of the root mean square.
    pub fn rms_error(&self) -> f64 {
        self.rms / self.reference_rms - 1.0
    }
}

/// All good records that lie within the signal.
pub fn rows(signal: &Signal, received: &Received, clock: Clock) -> Vec<SecondRow> {
    let Some(second) = &signal.second else { return Vec::new() };
    let values =
        received.messages().filter_map(|m| if let Message::Indicators(values) = m { Some(values) } else { None });
    values.filter_map(|values| row(values, &second.samples, signal, clock)).collect()
}

fn row(values: &Indicators, samples: &[f64], signal: &Signal, clock: Clock) -> Option<SecondRow> {
    let second = values.second.filter(|second| second.quality.is_good())?;
    let start_s = (values.tag.first_tick as f64 - clock.start) / clock.ticks_per_second;
    let length_s = f64::from(second.quality.duration_s);
    if start_s < 0.0 {
        return None;
    }
    let first = (start_s * signal.rate_hz).round() as usize;
    let stretch = samples.get(first..first + (length_s * signal.rate_hz).round() as usize)?;
    let count = stretch.len() as f64;
    let mean = stretch.iter().sum::<f64>() / count;
    let moment = |power: i32| stretch.iter().map(|x| (x - mean).powi(power)).sum::<f64>() / count;
    let scale = signal.unit.scale();
    Some(SecondRow {
        start_s,
        length_s,
        turns: second.quality.turns,
        rms: f64::from(second.rms) / scale,
        reference_rms: moment(2).sqrt(),
        peak: f64::from(second.peak) / scale,
        reference_peak: stretch.iter().fold(0.0, |peak: f64, x| peak.max((x - mean).abs())),
        kurtosis: f64::from(second.kurtosis),
        reference_kurtosis: moment(4) / moment(2).powi(2),
        velocity_rms: f64::from(second.velocity_rms),
    })
}
