//! The node's sampled estimator against the polynomial: error over samples per edge, and the waveform's rate.
//!
//! Two questions. How many samples must an edge have before the estimator agrees (it refuses below five)? And how
//! much bandwidth must the chain before it pass: the acceleration's Fourier series is cut off at half the
//! rate `k B`, as an ideal anti-alias filter would, and the edge is timed on a fine grid. The larger of
//! both `k` is the multiple at which a waveform should be sampled.

use super::edges::Edge;
use super::forms::RISE_TIME_PRODUCT;
use super::operating::{Event, Periodic};
use crate::{Error, Result};
use meshband::rise_time::{Polarity, RiseTime, RiseTimeConfig, RiseTimeRefusal};
use rayon::prelude::*;
use serde::Serialize;

/// Agreement asked for.
pub const AGREEMENT: f64 = 0.02;
/// Teeth timed per rate.
const TEETH: usize = 66;
/// Longest edge, samples.
const WINDOW: usize = 2048;
/// Grid points of a mesh period for the cut-off series.
const GRID: usize = 1 << 14;

/// One sampling rate.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct SampledRow {
    /// Samples within the edge's 10-90 % time.
    pub samples_per_edge: f64,
    /// Rate as a multiple of the edge's bandwidth.
    pub multiple: f64,
    /// Relative error of the median rise time; absent where the estimator refused.
    pub error: Option<f64>,
    /// Median absolute deviation over teeth, relative.
    pub scatter: Option<f64>,
}

/// One cut-off.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct CutOffRow {
    /// Rate as a multiple of the edge's bandwidth; the cut-off is at half of it.
    pub multiple: f64,
    /// Relative error of the rise time.
    pub error: Option<f64>,
}

/// The estimator's convergence at one operating point.
#[derive(Debug, Clone, Serialize)]
pub struct Convergence {
    /// Rise time by the polynomial, s.
    pub rise_time_s: f64,
    /// Error over samples per edge.
    pub sampled: Vec<SampledRow>,
    /// Fewest samples per edge from which on the error stays within two per cent.
    pub samples_needed: f64,
    /// Error over the cut-off.
    pub cut_off: Vec<CutOffRow>,
    /// Smallest multiple of B from which on a cut-off at half the rate keeps the rise time within two per cent.
    pub cut_off_multiple: f64,
    /// Multiple of B for the waveform: satisfies both.
    pub waveform_multiple: f64,
}

fn estimator(edge: &Edge, pitch_samples: f64, rate_hz: f64) -> Box<RiseTime<WINDOW>> {
    let minimum_height = (0.25 * edge.height()) as f32;
    let config = RiseTimeConfig { polarity: Polarity::Rising, minimum_height };
    let mut estimator = Box::new(RiseTime::new(config, pitch_samples as f32));
    estimator.expect((edge.rise_time_s * rate_hz) as f32);
    estimator
}

/// Times the response sampled at a rate; the estimator's own refusal where it refuses.
pub fn sampled(response: &Periodic, edge: &Edge, rate_hz: f64) -> std::result::Result<(f64, f64), RiseTimeRefusal> {
    let pitch = response.mesh_period_s * rate_hz;
    let mut estimator = estimator(edge, pitch, rate_hz);
    let offset = edge.ends_s[0] - 0.5 * response.mesh_period_s;
    for i in 0..(pitch * TEETH as f64) as usize {
        estimator.push(response.value(offset + i as f64 / rate_hz) as f32);
    }
    let result = estimator.result()?;
    Ok((f64::from(result.samples_per_edge), f64::from(result.deviation_samples)))
}

/// Convergence of the estimator to the polynomial on this response.
///
/// # Errors
/// A response without a timed exit edge.
pub fn convergence(response: &Periodic) -> Result<Convergence> {
    let edge = response.edge(0, Event::Exit);
    let edge = edge.ok_or_else(|| Error::impossible("estimator study", "the response has no exit edge to time"))?;
    // Not whole numbers: every tooth is then met at another phase.
    let counts: Vec<f64> = (0..48).map(|i| 2.0137 * 1.07_f64.powi(i)).collect();
    let sampled_rows: Vec<SampledRow> = counts
        .into_par_iter()
        .map(|n| {
            let found = sampled(response, &edge, n / edge.rise_time_s).ok();
            SampledRow {
                samples_per_edge: n,
                multiple: n / RISE_TIME_PRODUCT,
                error: found.map(|f| f.0 / n - 1.0),
                scatter: found.map(|f| f.1 / n),
            }
        })
        .collect();
    let spectrum = Spectrum::new(response);
    let bandwidth = RISE_TIME_PRODUCT / edge.rise_time_s;
    let cut_off: Vec<CutOffRow> = (4..=80)
        .into_par_iter()
        .map(|i| {
            let multiple = 0.5 * f64::from(i);
            let error = spectrum.rise_time_s(response, &edge, 0.5 * multiple * bandwidth);
            CutOffRow { multiple, error: error.map(|t| t / edge.rise_time_s - 1.0) }
        })
        .collect();
    let bad = |error: Option<f64>| error.is_none_or(|e| e.abs() > AGREEMENT);
    let first_good = |bad: Vec<bool>| bad.iter().rposition(|&b| b).map_or(0, |i| i + 1);
    let at = first_good(sampled_rows.iter().map(|r| bad(r.error)).collect());
    let samples_needed = sampled_rows.get(at).map_or(f64::INFINITY, |r| r.samples_per_edge);
    let at = first_good(cut_off.iter().map(|r| bad(r.error)).collect());
    let cut_off_multiple = cut_off.get(at).map_or(f64::INFINITY, |r| r.multiple);
    Ok(Convergence {
        rise_time_s: edge.rise_time_s,
        sampled: sampled_rows,
        samples_needed,
        cut_off,
        cut_off_multiple,
        waveform_multiple: cut_off_multiple.max(samples_needed / RISE_TIME_PRODUCT),
    })
}

/// The response's Fourier series over a mesh period.
struct Spectrum(Vec<realfft::num_complex::Complex<f64>>);

impl Spectrum {
    fn new(response: &Periodic) -> Self {
        let step = response.mesh_period_s / GRID as f64;
        let mut signal: Vec<f64> = (0..GRID).map(|i| response.value(i as f64 * step)).collect();
        let forward = realfft::RealFftPlanner::new().plan_fft_forward(GRID);
        let mut lines = forward.make_output_vec();
        forward.process(&mut signal, &mut lines).expect("lengths come from the plan");
        Self(lines)
    }

    /// Rise time of the edge after everything above `cut_hz` is taken away, s.
    fn rise_time_s(&self, response: &Periodic, edge: &Edge, cut_hz: f64) -> Option<f64> {
        let mut lines = self.0.clone();
        let last = (cut_hz * response.mesh_period_s) as usize;
        lines.iter_mut().skip(last + 1).for_each(|c| *c *= 0.0);
        let inverse = realfft::RealFftPlanner::new().plan_fft_inverse(GRID);
        let mut signal = inverse.make_output_vec();
        inverse.process(&mut lines, &mut signal).expect("lengths come from the plan");
        let rate_hz = GRID as f64 / response.mesh_period_s;
        let mut estimator = estimator(edge, GRID as f64, rate_hz);
        let offset = ((edge.ends_s[0] / response.mesh_period_s - 0.5).rem_euclid(1.0) * GRID as f64) as usize;
        for i in 0..4 * GRID {
            estimator.push((signal[(offset + i) % GRID] / GRID as f64) as f32);
        }
        estimator.result().ok().map(|r| f64::from(r.samples_per_edge) / rate_hz)
    }
}
