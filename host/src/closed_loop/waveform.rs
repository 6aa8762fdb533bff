//! Time signals of the declared machine's steady state.
//!
//! The mesh orders are summed by powers of one phasor per sample; at another angle than a straight line the same sum gives a slowly
//! frequency-modulated prediction (quasi-steady: the machine is taken to follow at once). Cost: orders times samples.

use super::base_fit::RunState;
use crate::model::forward::Line;
use crate::observation::spectrum::Analyser;
use rustfft::num_complex::Complex64 as C;
use std::f64::consts::TAU;

/// Prediction of both channels from the lines of one comb about order 0, at a pinion angle per sample.
pub fn waveform(analyser: &Analyser, lines: &[Line], angle: impl Fn(f64) -> f64) -> [Vec<f64>; 2] {
    let centre = lines.len() / 2;
    let step = lines[centre + 1].order;
    // Both signs of an order add up to one positive order.
    let amplitude: Vec<[C; 2]> = (1..=centre)
        .map(|n| {
            let (up, down) = (&lines[centre + n], &lines[centre - n]);
            [0, 1].map(|c| up.amplitude[c] + down.amplitude[c].conj())
        })
        .collect();
    let mut channels = [vec![0.0; analyser.samples], vec![0.0; analyser.samples]];
    for k in 0..analyser.samples {
        let turn = C::cis(step * angle(k as f64 / analyser.rate_hz));
        let mut phasor = C::ONE;
        for a in &amplitude {
            phasor *= turn;
            channels[0][k] += a[0].re * phasor.re - a[0].im * phasor.im;
            channels[1][k] += a[1].re * phasor.re - a[1].im * phasor.im;
        }
    }
    channels
}

/// Prediction at the straight-line angle, on the orders used for small effects.
pub fn steady(analyser: &Analyser, run: &RunState) -> [Vec<f64>; 2] {
    let (offset, speed) = (run.angle.offset_rad, TAU * run.angle.shaft_hz);
    waveform(analyser, &run.inner.lines, |t| offset + speed * t)
}

/// The same on all orders.
pub fn complete(analyser: &Analyser, run: &RunState) -> [Vec<f64>; 2] {
    let (offset, speed) = (run.angle.offset_rad, TAU * run.angle.shaft_hz);
    waveform(analyser, &run.own.solution.lines, |t| offset + speed * t)
}
