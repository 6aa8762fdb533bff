//! Pinion angle over a run from the tachometer edges.
//!
//! Within a run the speed is nominally constant, so the angle is a straight line through the edges (least squares,
//! which divides the jitter by the root of their number). The departure of the edges from that line is kept as a
//! measure of real speed variation.

use super::input::Run;
use std::f64::consts::TAU;

/// Angle of the pinion, `offset + 2 pi f t`.
#[derive(Debug, Clone, Copy)]
pub struct Angle {
    /// Angle at the first sample, rad.
    pub offset_rad: f64,
    /// Mean shaft frequency, Hz.
    pub shaft_hz: f64,
    /// RMS departure of the edges from the line, s.
    pub edge_scatter_s: f64,
    /// One-sigma error of the angle at mid-run expected from the declared jitter, rad.
    pub sigma_rad: f64,
    /// One-sigma error of the shaft frequency from the same jitter, Hz.
    pub sigma_hz: f64,
}

impl Angle {
    /// Straight line through the edges of `run`.
    pub fn fit(run: &Run, pulses_per_rev: u32, jitter_s: f64) -> Self {
        let n = run.edges_s.len() as f64;
        let turns = |i: usize| (i as f64 + f64::from(run.first_pulse_index)) / f64::from(pulses_per_rev);
        let mean_t = run.edges_s.iter().sum::<f64>() / n;
        let mean_turn = (0..run.edges_s.len()).map(turns).sum::<f64>() / n;
        let (mut stt, mut sty) = (0.0, 0.0);
        for (i, &t) in run.edges_s.iter().enumerate() {
            stt += (t - mean_t).powi(2);
            sty += (t - mean_t) * (turns(i) - mean_turn);
        }
        let shaft_hz = sty / stt;
        let start = mean_turn - shaft_hz * mean_t;
        let squares: f64 =
            run.edges_s.iter().enumerate().map(|(i, &t)| ((turns(i) - start) / shaft_hz - t).powi(2)).sum();
        Self {
            offset_rad: TAU * start,
            shaft_hz,
            edge_scatter_s: (squares / n).sqrt(),
            sigma_rad: TAU * shaft_hz * (jitter_s / n.sqrt()).max(1e-8),
            sigma_hz: shaft_hz * jitter_s.max(1e-8) / stt.sqrt(),
        }
    }

    /// Whether the edges would show a swing of the pinion at `order` of `amplitude_rad` over a run of `duration_s`,
    /// and do not.
    pub fn refutes(&self, order: f64, amplitude_rad: f64, pulses_per_rev: u32, duration_s: f64) -> bool {
        let per_edge = order / f64::from(pulses_per_rev);
        let alias = (per_edge - per_edge.round()).abs();
        // A swing that the edges see hardly move over the run passes for a part of the straight line.
        let turns_seen = alias * duration_s * self.shaft_hz * f64::from(pulses_per_rev);
        let expected_s = amplitude_rad / 2.0_f64.sqrt() / (TAU * self.shaft_hz);
        turns_seen > 1.5 && 0.5 * expected_s > self.edge_scatter_s
    }
}
