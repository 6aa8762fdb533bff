//! One run: its samples, its tach edges and the declared conditions.

use super::beside::{self, Beside};
use super::{CODE_MAX, Declaration, FLOAT_BITS, PART, RunDeclaration, encode, npy, read_edges};
use crate::budget::SHAFT;
use crate::confined;
use crate::part::Part;
use crate::{Error, Result};
use std::borrow::Cow;
use std::path::Path;

/// One run in memory.
#[derive(Debug, Clone)]
pub struct Run {
    /// Its `[[run]]` table.
    pub declaration: RunDeclaration,
    /// Tach edge times, s from the first sample, strictly ascending; empty where the run has no tach.
    pub edges_s: Vec<f64>,
    /// Values of what was recorded beside the channels, in the order of the declaration.
    pub beside: Vec<Beside>,
    samples: Samples,
    channels: usize,
    full_scale: f64,
    sample_rate_hz: f64,
}

/// Interleaved samples as the record holds them.
#[derive(Debug, Clone, PartialEq)]
enum Samples {
    /// Codes of the full scale.
    Codes(Vec<i16>),
    /// Values in the record's unit.
    Values(Vec<f32>),
}

impl Samples {
    fn read(path: &Path, bits: u32) -> Result<(Self, usize)> {
        if bits != FLOAT_BITS {
            let (codes, channels) = npy::read_i16(path)?;
            return Ok((Self::Codes(codes), channels));
        }
        let (values, channels) = npy::read_f32(path)?;
        if let Some(i) = values.iter().position(|x| !x.is_finite()) {
            return Err(Error::invalid(
                path.display(),
                format!("sample {}, channel {} is {}", i / channels, i % channels, values[i]),
            ));
        }
        Ok((Self::Values(values), channels))
    }

    /// Of signals, refused where [`encode`] refuses.
    fn of(place: &str, signals: &[Vec<f64>], full_scale: f64, bits: u32) -> Result<Self> {
        let codes = encode(place, signals, full_scale)?;
        if bits != FLOAT_BITS {
            return Ok(Self::Codes(codes));
        }
        let row = |i: usize| signals.iter().map(move |signal| signal[i] as f32);
        Ok(Self::Values((0..signals[0].len()).flat_map(row).collect()))
    }

    fn len(&self) -> usize {
        match self {
            Self::Codes(codes) => codes.len(),
            Self::Values(values) => values.len(),
        }
    }
}

impl Run {
    /// Reads the files of one `[[run]]` table.
    pub(super) fn read(folder: &Path, run: &RunDeclaration, declaration: &Declaration) -> Result<Self> {
        let path = confined::inside(folder, &run.signal)?;
        let expected = declaration.acquisition.channels.len();
        let (samples, channels) = Samples::read(&path, declaration.acquisition.code_bits)?;
        if channels != expected {
            let what = format!("has {channels} channels, record.toml [acquisition] channels names {expected}");
            return Err(Error::invalid(path.display(), what));
        }
        let edges_s = match &run.tach {
            Some(tach) => read_edges(&confined::inside(folder, tach)?)?,
            None => Vec::new(),
        };
        let beside = run.beside.iter().map(|beside| beside::read(folder, beside)).collect::<Result<Vec<_>>>()?;
        let result = Self {
            declaration: run.clone(),
            edges_s,
            beside,
            samples,
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
    /// See [`encode`]: clipping, NaN, unequal lengths; edges that do not ascend; and a channel count other than the
    /// declaration's.
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
        let (full_scale, bits) = (acquisition.full_scale_m_s2, acquisition.code_bits);
        let samples = Samples::of(&run.signal, signals, full_scale, bits)?;
        Ok(Self {
            declaration: run,
            edges_s,
            beside: Vec::new(),
            samples,
            channels: signals.len(),
            full_scale: acquisition.full_scale_m_s2,
            sample_rate_hz: acquisition.sample_rate_hz,
        })
    }

    /// A part of it; `place` names the run in errors.
    pub(super) fn part(mut self, place: &str, part: Part) -> Result<Self> {
        let (rows, cut) = part.of(place, self.samples(), self.sample_rate_hz)?;
        let values = rows.start * self.channels..rows.end * self.channels;
        self.samples = match self.samples {
            Samples::Codes(codes) => Samples::Codes(codes[values].to_vec()),
            Samples::Values(floats) => Samples::Values(floats[values].to_vec()),
        };
        let before = self.edges_s.partition_point(|edge| *edge < cut.from_s);
        self.declaration.first_pulse_index += before as u32;
        self.edges_s = cut.moved(self.edges_s);
        (self.beside, self.declaration.beside) = (Vec::new(), Vec::new());
        let whole = self.declaration.part().map_or(String::new(), |whole| format!(" ({whole})"));
        self.declaration.other.insert(PART.into(), (cut.described() + &whole).into());
        Ok(self)
    }

    /// Interleaved codes, samples x channels; of float samples those that they would have at the declared full scale.
    pub fn codes(&self) -> Cow<'_, [i16]> {
        match &self.samples {
            Samples::Codes(codes) => Cow::Borrowed(codes),
            Samples::Values(values) => Cow::Owned(values.iter().map(|x| self.code(*x)).collect()),
        }
    }

    fn code(&self, value: f32) -> i16 {
        (f64::from(value) / self.full_scale * CODE_MAX).round().clamp(-CODE_MAX, CODE_MAX) as i16
    }

    /// The file of the samples.
    pub(super) fn npy_bytes(&self) -> Vec<u8> {
        match &self.samples {
            Samples::Codes(codes) => npy::bytes_i16(codes, self.channels),
            Samples::Values(values) => npy::bytes_f32(values, self.channels),
        }
    }

    /// Whether any two samples of a channel differ.
    ///
    /// # Panics
    /// If `channel` is not below [`Run::channels`].
    pub fn moves(&self, channel: usize) -> bool {
        let signal = self.signal_m_s2(channel);
        signal.iter().any(|x| *x != signal[0])
    }

    /// Number of channels.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Number of samples per channel.
    pub fn samples(&self) -> usize {
        self.samples.len() / self.channels
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
        match &self.samples {
            Samples::Codes(codes) => codes.iter().skip(channel).step_by(self.channels).copied().collect(),
            Samples::Values(values) => {
                values.iter().skip(channel).step_by(self.channels).map(|x| self.code(*x)).collect()
            }
        }
    }

    /// Acceleration of one channel, m/s2 (or the unit named in `[acquisition]` `unit`).
    ///
    /// # Panics
    /// If `channel` is not below [`Run::channels`].
    pub fn signal_m_s2(&self, channel: usize) -> Vec<f64> {
        assert!(channel < self.channels, "channel {channel} of {}", self.channels);
        match &self.samples {
            Samples::Codes(codes) => {
                let codes = codes.iter().skip(channel).step_by(self.channels);
                codes.map(|&code| f64::from(code) / CODE_MAX * self.full_scale).collect()
            }
            Samples::Values(values) => {
                values.iter().skip(channel).step_by(self.channels).map(|x| f64::from(*x)).collect()
            }
        }
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
