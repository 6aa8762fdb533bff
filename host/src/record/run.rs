//! One run: its codes, its tach edges and the declared conditions.

use super::{CODE_MAX, Declaration, RunDeclaration, encode, npy, read_edges};
use crate::budget::SHAFT;
use crate::confined;
use crate::{Error, Result};
use std::path::Path;

/// One run in memory.
#[derive(Debug, Clone)]
pub struct Run {
    /// Its `[[run]]` table.
    pub declaration: RunDeclaration,
    /// Tach edge times, s from the first sample, strictly ascending; empty where the run has no tach.
    pub edges_s: Vec<f64>,
    codes: Vec<i16>,
    channels: usize,
    full_scale: f64,
    sample_rate_hz: f64,
}

impl Run {
    /// Reads the files of one `[[run]]` table.
    pub(super) fn read(folder: &Path, run: &RunDeclaration, declaration: &Declaration) -> Result<Self> {
        let path = confined::inside(folder, &run.signal)?;
        let expected = declaration.acquisition.channels.len();
        let (codes, channels) = npy::read_i16(&path)?;
        if channels != expected {
            let what = format!("has {channels} channels, record.toml [acquisition] channels names {expected}");
            return Err(Error::invalid(path.display(), what));
        }
        let edges_s = match &run.tach {
            Some(tach) => read_edges(&confined::inside(folder, tach)?)?,
            None => Vec::new(),
        };
        let result = Self {
            declaration: run.clone(),
            edges_s,
            codes,
            channels,
            full_scale: declaration.acquisition.full_scale_m_s2,
            sample_rate_hz: declaration.acquisition.sample_rate_hz,
        };
        if let (Some(tach), Some(&last)) = (&run.tach, result.edges_s.last()) {
            let (first, end) = (result.edges_s[0], result.duration_s());
            // A late first or last edge is a stall; an edge far outside belongs to another run or another unit.
            if first < -end || last > 2.0 * end {
                let what = format!("edges from {first} s to {last} s do not belong to a run of {end} s");
                return Err(Error::invalid(folder.join(tach).display(), what));
            }
            let pulses = declaration.tach.as_ref().map_or(1, |tach| tach.pulses_per_rev);
            let speed_hz = result.mean_speed_hz(pulses).unwrap_or(f64::INFINITY);
            let remedy = "check the unit of the edge times and pulses_per_rev";
            SHAFT.check(folder.join(tach).display(), speed_hz, remedy)?;
        }
        Ok(result)
    }

    /// A run from signals (one vector per channel, in the record's unit).
    ///
    /// # Errors
    /// See [`encode`]: clipping, NaN, unequal lengths; edges that do not ascend; and a channel count other than the declaration's.
    pub fn from_signals(
        run: RunDeclaration,
        acquisition: &super::Acquisition,
        signals: &[Vec<f64>],
        edges_s: Vec<f64>,
    ) -> Result<Self> {
        if signals.len() != acquisition.channels.len() {
            let what = format!("{} signals for {} named channels", signals.len(), acquisition.channels.len());
            return Err(Error::invalid(&run.signal, what));
        }
        if let Some(i) = edges_s.windows(2).position(|w| w[0] >= w[1]) {
            let what =
                format!("tach edge {} at {} s does not come after the one at {} s", i + 1, edges_s[i + 1], edges_s[i]);
            return Err(Error::invalid(&run.signal, what));
        }
        let codes = encode(&run.signal, signals, acquisition.full_scale_m_s2)?;
        Ok(Self {
            declaration: run,
            edges_s,
            codes,
            channels: signals.len(),
            full_scale: acquisition.full_scale_m_s2,
            sample_rate_hz: acquisition.sample_rate_hz,
        })
    }

    /// Interleaved codes, samples x channels.
    pub fn codes(&self) -> &[i16] {
        &self.codes
    }

    /// Number of channels.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Number of samples per channel.
    pub fn samples(&self) -> usize {
        self.codes.len() / self.channels
    }

    /// Sampling rate, Hz.
    pub fn sample_rate_hz(&self) -> f64 {
        self.sample_rate_hz
    }

    /// Length, s.
    pub fn duration_s(&self) -> f64 {
        self.samples() as f64 / self.sample_rate_hz
    }

    /// Value of one code step in the record's unit.
    pub fn step(&self) -> f64 {
        self.full_scale / CODE_MAX
    }

    /// Codes of one channel.
    ///
    /// # Panics
    /// If `channel` is not below [`Run::channels`].
    pub fn channel_codes(&self, channel: usize) -> Vec<i16> {
        assert!(channel < self.channels, "channel {channel} of {}", self.channels);
        self.codes.iter().skip(channel).step_by(self.channels).copied().collect()
    }

    /// Acceleration of one channel, m/s2 (or the unit named in `[acquisition]` `unit`).
    ///
    /// # Panics
    /// If `channel` is not below [`Run::channels`].
    pub fn signal_m_s2(&self, channel: usize) -> Vec<f64> {
        assert!(channel < self.channels, "channel {channel} of {}", self.channels);
        let codes = self.codes.iter().skip(channel).step_by(self.channels);
        codes.map(|&code| f64::from(code) / CODE_MAX * self.full_scale).collect()
    }

    /// Mean speed of the tach shaft over all edges, Hz; `None` without edges.
    pub fn mean_speed_hz(&self, pulses_per_rev: u32) -> Option<f64> {
        let (first, last) = (self.edges_s.first()?, self.edges_s.last()?);
        (last > first).then(|| (self.edges_s.len() - 1) as f64 / (last - first) / f64::from(pulses_per_rev))
    }

    /// Turns of the tach shaft from its angle 0 at the edge `index` of this run.
    pub fn edge_turns(&self, index: usize, pulses_per_rev: u32) -> f64 {
        (self.declaration.first_pulse_index as f64 + index as f64) / f64::from(pulses_per_rev)
    }
}
