//! A speed that moves within the runs: its verdict from the tachometer and the vibration, and the record as it would be at a steady speed.
//!
//! One sinusoid at a rate common to all runs where that explains the edges, else a spline through them. The record is then taken at equal steps of that angle instead of
//! time, after which the search goes on as with any other. Limits: quasi-steady: modes, which stay at their frequencies, are smeared by the share that the speed moves; the torque that
//! accelerates the inertias is no part of the model and stands as a torque at the same order.

use super::accept;
use super::base_fit::{Base, RunState};
use super::least_squares::Data;
use super::outcome::{Effect, Value};
use super::waveform::waveform;
use crate::observation::input::{Record, Run};
use crate::spectral::Kaiser;
use rayon::prelude::*;
use rustfft::num_complex::Complex64 as C;
use std::f64::consts::TAU;

/// Multiples of the edge rate about which aliases of an order are tried.
const MOST_ALIASES: u32 = 4;

fn chi_change(data: &Data, model: &[[Vec<C>; 2]], base: &Base, runs: &[usize]) -> f64 {
    let mut sum = 0.0;
    for &r in runs {
        for c in 0..2 {
            for (b, w) in data.weight[r][c].iter().enumerate() {
                let residual = base.runs[r].measured[c][b] - model[r][c][b];
                sum += (data.residual[r][c][b].norm_sqr() - residual.norm_sqr()) * w;
            }
        }
    }
    sum
}

/// Natural cubic spline through the tachometer's edges: angle (rad) as a function of time.
struct EdgeAngle {
    t: Vec<f64>,
    y: Vec<f64>,
    bend: Vec<f64>,
}

impl EdgeAngle {
    fn new(run: &Run, pulses_per_rev: u32) -> Self {
        let t = run.edges_s.clone();
        let n = t.len();
        let turns = |i: usize| (i as f64 + f64::from(run.first_pulse_index)) / f64::from(pulses_per_rev);
        let y: Vec<f64> = (0..n).map(|i| TAU * turns(i)).collect();
        let (mut bend, mut u) = (vec![0.0; n], vec![0.0; n]);
        for i in 1..n - 1 {
            let s = (t[i] - t[i - 1]) / (t[i + 1] - t[i - 1]);
            let p = s * bend[i - 1] + 2.0;
            bend[i] = (s - 1.0) / p;
            let d = (y[i + 1] - y[i]) / (t[i + 1] - t[i]) - (y[i] - y[i - 1]) / (t[i] - t[i - 1]);
            u[i] = (6.0 * d / (t[i + 1] - t[i - 1]) - s * u[i - 1]) / p;
        }
        for i in (0..n - 1).rev() {
            bend[i] = bend[i] * bend[i + 1] + u[i];
        }
        Self { t, y, bend }
    }

    fn at(&self, t: f64) -> f64 {
        let i = self.t.partition_point(|x| *x <= t).clamp(1, self.t.len() - 1);
        let h = self.t[i] - self.t[i - 1];
        let (a, b) = ((self.t[i] - t) / h, (t - self.t[i - 1]) / h);
        let line = a * self.y[i - 1] + b * self.y[i];
        if !(0.0..=1.0).contains(&a) {
            return line;
        }
        line + ((a * a * a - a) * self.bend[i - 1] + (b * b * b - b) * self.bend[i]) * h * h / 6.0
    }
}

/// Straight line and one sinusoid through a run's edges.
struct Sway {
    /// Angle at mid-run (rad), speed (rad/s), cosine and sine amplitudes (rad).
    x: [f64; 4],
    middle_s: f64,
    omega: f64,
    /// Sum of squared departures left, rad^2.
    left: f64,
}

impl Sway {
    fn fit(run: &Run, pulses_per_rev: u32, hz: f64) -> Self {
        let omega = TAU * hz;
        let n = run.edges_s.len();
        let middle_s = run.edges_s.iter().sum::<f64>() / n as f64;
        let row = |t: f64| [1.0, t - middle_s, (omega * t).cos(), (omega * t).sin()];
        let angle = |i: usize| TAU * (i as f64 + f64::from(run.first_pulse_index)) / f64::from(pulses_per_rev);
        let mut gram = nalgebra::Matrix4::<f64>::zeros();
        let mut right = nalgebra::Vector4::<f64>::zeros();
        for (i, &t) in run.edges_s.iter().enumerate() {
            let r = nalgebra::Vector4::from(row(t));
            gram += r * r.transpose();
            right += r * angle(i);
        }
        // Too few edges for four unknowns leave the sinusoid small.
        (0..4).for_each(|k| gram[(k, k)] += 1e-9 * n as f64);
        let x: [f64; 4] = gram.cholesky().map_or([0.0; 4], |c| c.solve(&right).into());
        let at = |t: f64| row(t).iter().zip(&x).map(|(r, x)| r * x).sum::<f64>();
        let left = run.edges_s.iter().enumerate().map(|(i, &t)| (at(t) - angle(i)).powi(2)).sum();
        Self { x, middle_s, omega, left }
    }

    fn at(&self, t: f64) -> f64 {
        let [angle, speed, a, b] = self.x;
        angle + speed * (t - self.middle_s) + a * (self.omega * t).cos() + b * (self.omega * t).sin()
    }

    fn amplitude_rad(&self) -> f64 {
        self.x[2].hypot(self.x[3])
    }
}

/// The rate, fixed (Hz) or at an order, at which one sinusoid leaves least at the edges of all runs; runs at several speeds tell a rate
/// from its aliases at the edge rate.
fn rate(base: &Base, record: &Record) -> (f64, bool, f64) {
    let left = |at: f64, fixed: bool| -> f64 {
        let hz = |r: &RunState| if fixed { at } else { at * r.angle.shaft_hz };
        record.runs.iter().zip(&base.runs).map(|(run, r)| Sway::fit(run, record.pulses_per_rev, hz(r)).left).sum()
    };
    let best = |grid: Vec<(f64, bool)>| {
        grid.into_par_iter()
            .map(|(at, fixed)| (at, fixed, left(at, fixed)))
            .min_by(|a, b| a.2.total_cmp(&b.2))
            .unwrap_or((1.0, true, f64::INFINITY))
    };
    let step = 0.1 / base.analyser.duration_s();
    let per_turn = 0.95 * f64::from(record.pulses_per_rev);
    let fixed = (5..(25.0 / step) as usize).map(|i| (i as f64 * step, true));
    let orders = (10..(per_turn / 0.01) as usize).map(|i| (0.01 * i as f64, false));
    let (mut at, which, _) = best(fixed.chain(orders).collect());
    let mut size = if which { step } else { 0.01 };
    for _ in 0..3 {
        at = best((-10..=10).map(|i| (at + 0.1 * size * f64::from(i), which)).collect()).0;
        size *= 0.1;
    }
    (at, which, left(at, which))
}

/// The pinion's angle over a run.
enum Track {
    /// A straight line and a sinusoid.
    Sway(Sway),
    /// A spline through the edges.
    Edges(EdgeAngle),
}

impl Track {
    fn at(&self, t: f64) -> f64 {
        match self {
            Self::Sway(sway) => sway.at(t),
            Self::Edges(spline) => spline.at(t),
        }
    }
}

/// A moving speed.
pub struct Moving {
    /// The verdict.
    pub effect: Effect,
    /// What it takes off chi-square on all runs.
    pub gain: f64,
    tracks: Vec<Track>,
}

/// Departure of the edges from a straight line that jitter does not explain, s.
fn edges_move(base: &Base, record: &Record) -> bool {
    let limit = 5.0 * record.jitter_s + 2e-6;
    let moving = base.runs.iter().filter(|r| r.angle.edge_scatter_s > limit).count();
    2 * moving > base.runs.len()
}

/// Share of the squared departures that one sinusoid may leave.
const MOST_LEFT: f64 = 0.05;

/// Speed that moves within the runs by more than the tachometer's jitter, where the vibration follows.
pub fn moving(base: &Base, record: &Record, data: &Data, held_out: &[usize]) -> Option<Moving> {
    if !edges_move(base, record) {
        return None;
    }
    let (at, fixed, left) = rate(base, record);
    let scatter =
        |r: &RunState, run: &Run| (TAU * r.angle.shaft_hz * r.angle.edge_scatter_s).powi(2) * run.edges_s.len() as f64;
    let whole: f64 = base.runs.iter().zip(&record.runs).map(|(r, run)| scatter(r, run)).sum();
    let sinusoid = left < MOST_LEFT * whole;
    let (ratio, all): (f64, Vec<usize>) = (f64::from(record.pulses_per_rev), (0..base.runs.len()).collect());
    let seen: Vec<usize> = all.iter().copied().filter(|r| !held_out.contains(r)).collect();
    // Edges once a turn cannot tell an order from its aliases: the vibration does.
    let aliases: Vec<f64> = if sinusoid && !fixed {
        let near = (0..=MOST_ALIASES).flat_map(|k| [f64::from(k) * ratio + at, f64::from(k) * ratio - at]);
        near.filter(|o| *o > 0.05).collect()
    } else {
        vec![at]
    };
    let tried = aliases.into_iter().map(|at| {
        let tracks = tracks(base, record, at, fixed, sinusoid);
        let models = models(base, &tracks);
        let gain = chi_change(data, &models, base, &seen);
        (at, tracks, models, gain)
    });
    let (at, tracks, models, _) = tried.max_by(|a, b| a.3.total_cmp(&b.3))?;
    let gain = chi_change(data, &models, base, &all);
    if !accept::speed_moves(chi_change(data, &models, base, held_out), gain) {
        return None;
    }
    Some(Moving { effect: verdict(base, &tracks, at, fixed, sinusoid), gain, tracks })
}

/// Angle of every run with a swing at `at`, or through its edges.
fn tracks(base: &Base, record: &Record, at: f64, fixed: bool, sinusoid: bool) -> Vec<Track> {
    let of = |(run, source): (&RunState, &Run)| {
        let hz = if fixed { at } else { at * run.angle.shaft_hz };
        if sinusoid {
            Track::Sway(Sway::fit(source, record.pulses_per_rev, hz))
        } else {
            Track::Edges(EdgeAngle::new(source, record.pulses_per_rev))
        }
    };
    base.runs.iter().zip(&record.runs).map(of).collect()
}

/// Predictions at these angles.
fn models(base: &Base, tracks: &[Track]) -> Vec<[Vec<C>; 2]> {
    let of = |(run, track): (&RunState, &Track)| {
        waveform(&base.analyser, &run.inner.lines, |t| track.at(t)).map(|signal| base.analyser.bins_of(&signal))
    };
    base.runs.par_iter().zip(tracks).map(of).collect()
}

fn verdict(base: &Base, tracks: &[Track], at: f64, fixed: bool, sinusoid: bool) -> Effect {
    let size = |(track, run): (&Track, &RunState)| match track {
        Track::Sway(sway) => sway.amplitude_rad(),
        Track::Edges(_) => TAU * run.angle.shaft_hz * run.angle.edge_scatter_s,
    };
    let sizes: Vec<f64> = tracks.iter().zip(&base.runs).map(size).collect();
    let mean = sizes.iter().sum::<f64>() / sizes.len() as f64;
    let spread = (sizes.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / sizes.len() as f64).sqrt();
    let half = 1.96 * spread / (sizes.len() as f64 - 1.0).max(1.0).sqrt();
    let value = Value { value: mean, ci95: [mean - half, mean + half], unit: "rad".into() };
    let what = if sinusoid { "angle_amplitude" } else { "angle_departure_rms" };
    Effect {
        verdict: "named".into(),
        name: "speed-fluctuation".into(),
        family: "non-stationary".into(),
        shaft: "none".into(),
        frequency_hz: (sinusoid && fixed).then_some(at),
        order_of_pinion: (sinusoid && !fixed).then_some(at),
        parameters: [(what.into(), value)].into(),
        ..Effect::default()
    }
}

impl Moving {
    /// The record at the mean speed of every run: samples at the times when the moving angle passes the straight line's, and edges likewise.
    pub fn straightened(&self, record: &Record, base: &Base) -> Record {
        let mut straight = record.clone();
        let kernel = Kaiser::new();
        straight.runs.par_iter_mut().zip(&base.runs).zip(&self.tracks).for_each(|((run, state), track)| {
            let (offset, speed) = (state.angle.offset_rad, TAU * state.angle.shaft_hz);
            let ahead = |t: f64| (track.at(t) - offset - speed * t) / speed;
            // The departure is far below a turn and slow: the fixed point is reached at once.
            let when = |t: f64| (0..4).fold(t, |guess, _| t - ahead(guess));
            run.edges_s.iter_mut().for_each(|t| *t += ahead(*t));
            run.channels.iter_mut().for_each(|channel| {
                let places = (0..channel.len()).map(|i| record.sample_rate_hz * when(i as f64 / record.sample_rate_hz));
                *channel = places.map(|place| kernel.interpolate(channel, place)).collect();
            });
        });
        straight
    }
}
