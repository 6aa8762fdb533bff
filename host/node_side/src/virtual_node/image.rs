//! Replay images from records or from any signal.

use super::analogue::Interpolator;
use crate::{Error, Result};
use meshband::config::Configuration;
use meshband::replay::{self, Header, IMAGE_CAPACITY, MAX_CONFIGURATION, ReplayError, image_bytes};
use meshband::units::Acceleration;

/// Time base of the QEMU board, Hz.
pub const TICKS_PER_SECOND: u32 = 25_000_000;
/// Finest signal made: 2.5 MHz. Finer only costs memory.
const FINEST_TICKS: u32 = 10;
/// Coarsest signal accepted as analogue: 1 MHz.
const COARSEST_TICKS: u32 = 25;
/// Share of the image's range that the signal's peak takes.
const PEAK_SHARE: f64 = 0.9;

/// Most tach edges of a replay: 1 MiB of the board's memory.
const MOST_EDGES: usize = 1 << 18;

/// A signal to be replayed.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a> {
    /// Samples, m/s^2.
    pub samples: &'a [f64],
    /// Their rate, Hz.
    pub rate_hz: f64,
    /// Tachometer edges, s from the first sample, ascending.
    pub edges_s: &'a [f64],
}

/// A replay image with what is known of its making.
#[derive(Debug, Clone)]
pub struct Image {
    /// For the board's memory.
    pub bytes: Vec<u8>,
    /// Rate of the signal in it, Hz.
    pub signal_rate_hz: f64,
    /// Acceleration of code 32767, m/s^2.
    pub full_scale_m_s2: f64,
    /// Length replayed, s; shorter than the source where the memory did not suffice.
    pub duration_s: f64,
}

impl Image {
    /// What a code of it means, m/s^2.
    pub fn acceleration_per_code(&self) -> Acceleration {
        per_code(self.full_scale_m_s2)
    }

    /// Interpolates a signal and sets the configuration's sensitivity to the image's scale.
    ///
    /// # Errors
    /// [`Error::Invalid`] for an empty, silent or undefined signal, or edges out of order.
    pub fn new(source: Source<'_>, config: &Configuration, adjust: impl FnOnce(Header) -> Header) -> Result<Self> {
        let refuse = |what: String| Error::invalid("signal for the node", what);
        if !(source.rate_hz.is_finite() && source.rate_hz > 0.0) {
            return Err(refuse(format!("a rate of {} Hz is not positive", source.rate_hz)));
        }
        if source.samples.len() < 2 || source.samples.iter().any(|x| !x.is_finite()) {
            return Err(refuse("needs at least two samples, all finite".into()));
        }
        let length_s = (source.samples.len() - 1) as f64 / source.rate_hz;
        let edges = ticks(source.edges_s, length_s);
        if edges.len() > MOST_EDGES {
            let what = format!(
                "{} tach edges, the board's memory has room for {MOST_EDGES}; shorten with --duration",
                edges.len()
            );
            return Err(refuse(what));
        }
        let room = (IMAGE_CAPACITY - image_bytes(MAX_CONFIGURATION, edges.len(), 0)) / 2;
        let clock = f64::from(TICKS_PER_SECOND);
        let needed = (length_s * clock / room as f64).ceil() as u32;
        let ticks_per_sample = needed.clamp(FINEST_TICKS, COARSEST_TICKS);
        let count = ((length_s * clock / f64::from(ticks_per_sample)) as usize).min(room);
        let step = f64::from(ticks_per_sample) / clock * source.rate_hz;
        let values = Interpolator::new().resample(source.samples, step, count);
        let peak = values.iter().fold(0.0, |peak: f64, x| peak.max(x.abs()));
        if peak == 0.0 {
            return Err(refuse("is zero throughout".into()));
        }
        let full_scale = peak / PEAK_SHARE;
        let codes: Vec<i16> = values.iter().map(|x| (x / full_scale * 32_767.0).round() as i16).collect();
        let mut config = config.clone();
        config.sensor.acceleration_per_code = per_code(full_scale);
        config.sensor.zero_code = 0x8000;
        let mut buffer = [0; MAX_CONFIGURATION];
        let config: &[u8] =
            postcard::to_slice(&config, &mut buffer).map_err(|e| refuse(format!("configuration: {e}")))?;
        let header = adjust(Header::new(TICKS_PER_SECOND, ticks_per_sample, full_scale as f32));
        let mut bytes = vec![0; image_bytes(config.len(), edges.len(), codes.len())];
        replay::write(&header, config, &edges, &codes, &mut bytes).map_err(|e| {
            refuse(match e {
                ReplayError::Edges => "tach edges do not ascend".into(),
                ReplayError::Header => format!(
                    "full scale {full_scale:e} m/s2 or {} tach edges are beyond what the board's replay can hold",
                    edges.len()
                ),
                other => format!("cannot be written ({other:?})"),
            })
        })?;
        Ok(Self {
            bytes,
            signal_rate_hz: clock / f64::from(ticks_per_sample),
            full_scale_m_s2: full_scale,
            duration_s: count as f64 * f64::from(ticks_per_sample) / clock,
        })
    }
}

/// Acceleration of a code of 16 bits, where the largest means this.
fn per_code(full_scale: f64) -> Acceleration {
    Acceleration((full_scale / 32_767.0) as f32)
}

/// Edge times in ticks; edges before the signal's start and behind its end are left out.
fn ticks(edges_s: &[f64], length_s: f64) -> Vec<u32> {
    edges_s
        .iter()
        .filter(|&&t| (0.0..=length_s).contains(&t))
        .map(|t| (t * f64::from(TICKS_PER_SECOND)).round() as u32)
        .collect()
}
