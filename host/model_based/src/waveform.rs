//! Time signals of the declared machine's steady state, and two faults of a record that are judged on them: a clipped
//! channel and a speed that moves within the run.
//!
//! The mesh orders are summed by powers of one phasor per sample; with the tachometer's own angle instead of a
//! straight line the same sum gives a slowly frequency-modulated prediction (quasi-steady: the machine is taken to
//! follow at once). Cost: orders times samples.

use super::accept;
use super::base_fit::{Base, RunState};
use super::least_squares::Data;
use super::outcome::{Effect, Evidence, Value};
use crate::model::forward::Line;
use crate::observation::input::{Record, Run};
use crate::observation::spectrum::Analyser;
use rayon::prelude::*;
use rustfft::num_complex::Complex64 as C;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Both channels of `lines`, a comb of orders about 0, at a pinion angle per sample; orders beyond half the sampling
/// rate at `shaft_hz`, which a filter takes off a measurement, do not fold.
fn waveform(analyser: &Analyser, lines: &[Line], shaft_hz: f64, angle: impl Fn(f64) -> f64) -> [Vec<f64>; 2] {
    let centre = lines.len() / 2;
    let step = lines[centre + 1].order;
    let within = (0.5 * analyser.rate_hz / (step * shaft_hz)) as usize;
    // Both signs of an order add up to one positive order.
    let amplitude: Vec<[C; 2]> = (1..=centre.min(within))
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

/// Prediction at the straight-line angle.
pub fn steady(analyser: &Analyser, run: &RunState) -> [Vec<f64>; 2] {
    at_straight_line(analyser, run, &run.inner.lines)
}

/// The same with every order of the machine's steady state.
pub fn complete(analyser: &Analyser, run: &RunState) -> [Vec<f64>; 2] {
    at_straight_line(analyser, run, &run.own.lines)
}

/// Both channels of `lines` at the straight-line angle of a run.
pub fn at_straight_line(analyser: &Analyser, run: &RunState, lines: &[Line]) -> [Vec<f64>; 2] {
    let (offset, speed) = (run.angle.offset_rad, TAU * run.angle.shaft_hz);
    waveform(analyser, lines, run.angle.shaft_hz, |t| offset + speed * t)
}

fn effect(name: &str, family: &str, gain: f64) -> Effect {
    Effect {
        verdict: "named".into(),
        name: name.into(),
        family: family.into(),
        shaft: "none".into(),
        order_of_pinion: None,
        frequency_hz: None,
        parameters: BTreeMap::new(),
        evidence: Evidence { held_out_gain: gain, ..Evidence::default() },
        ..Effect::default()
    }
}

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

/// Multiples of the edge rate about which aliases of an order are tried.
const MOST_ALIASES: u32 = 4;

/// Limit at which a channel's samples pile up, m/s2, if they do.
fn limit(runs: &[Run], channel: usize) -> Option<f64> {
    let peak = runs.iter().flat_map(|r| &r.channels[channel]).fold(0.0_f64, |m, x| m.max(x.abs()));
    let near = |run: &Run, low: f64, high: f64| {
        run.channels[channel].iter().filter(|x| (low * peak..=high * peak).contains(&x.abs())).count()
    };
    // A free signal thins out towards its peak; a limited one piles up there.
    let (at, below) = runs.iter().fold((0, 0), |(a, b), run| (a + near(run, 0.998, 1.0), b + near(run, 0.99, 0.998)));
    // Noise-free peaks repeat, too, but are round: only a limit holds three samples in a row.
    let flat: usize = runs
        .iter()
        .map(|run| run.channels[channel].windows(3).filter(|w| w.iter().all(|x| x.abs() >= 0.998 * peak)).count())
        .sum();
    // A signal that stands still is no limited one.
    let all: usize = runs.iter().map(|run| run.channels[channel].len()).sum();
    (at > 40 && at > 3 * below && flat > 10 && 2 * at < all).then_some(peak)
}

/// A channel whose samples stop at a limit; replaces the model by its limited waveform.
pub fn clipping(base: &mut Base, record: &Record, data: &Data, held_out: &[usize]) -> Option<Effect> {
    let limits = [0, 1].map(|c| limit(&record.runs, c));
    if limits == [None, None] {
        return None;
    }
    let analyser = &base.analyser;
    let models: Vec<[Vec<C>; 2]> = base
        .runs
        .par_iter()
        .map(|run| {
            let full = steady(analyser, run);
            [0, 1].map(|c| match limits[c] {
                None => run.model[c].clone(),
                Some(limit) => {
                    let cut: Vec<f64> = full[c].iter().map(|x| x.clamp(-limit, limit) - x).collect();
                    analyser.bins_of(&cut).iter().zip(&run.model[c]).map(|(d, m)| d + m).collect()
                }
            })
        })
        .collect();
    let gain = chi_change(data, &models, base, held_out);
    for (run, model) in base.runs.iter_mut().zip(models) {
        run.model = model;
    }
    let mut found = effect("clipping", "path", gain.signum() * 1e-6);
    for (c, who) in [(0, "pinion"), (1, "gear")] {
        if let Some(value) = limits[c] {
            let v = Value { value, ci95: [0.998 * value, 1.002 * value], unit: "m/s2".into() };
            found.parameters.insert(format!("limit_of_the_{who}_channel"), v);
        }
    }
    Some(found)
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

/// The rate, fixed (Hz) or at an order, at which one sinusoid leaves least at the edges of all runs; runs at several
/// speeds tell a rate from its aliases at the edge rate.
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

/// Speed that moves within the runs by more than the tachometer's jitter; replaces the model by one at the moving
/// angle.
///
/// One sinusoid at a rate common to all runs where that explains the edges, else a spline through them.
pub fn speed_fluctuation(base: &mut Base, record: &Record, data: &Data, held_out: &[usize]) -> Option<Effect> {
    let limit = 5.0 * record.jitter_s + 2e-6;
    let moving = base.runs.iter().filter(|r| r.angle.edge_scatter_s > limit).count();
    if 2 * moving <= base.runs.len() {
        return None;
    }
    let (at, fixed, left) = rate(base, record);
    let scatter =
        |r: &RunState, run: &Run| (TAU * r.angle.shaft_hz * r.angle.edge_scatter_s).powi(2) * run.edges_s.len() as f64;
    let whole: f64 = base.runs.iter().zip(&record.runs).map(|(r, run)| scatter(r, run)).sum();
    let sinusoid = left < 0.05 * whole;
    let analyser = &base.analyser;
    let (ratio, all): (f64, Vec<usize>) = (f64::from(record.pulses_per_rev), (0..base.runs.len()).collect());
    let seen: Vec<usize> = all.iter().copied().filter(|r| !held_out.contains(r)).collect();
    // Edges once a turn cannot tell an order from its aliases: the vibration does.
    let aliases: Vec<f64> = if sinusoid && !fixed {
        let near = (0..=MOST_ALIASES).flat_map(|k| [f64::from(k) * ratio + at, f64::from(k) * ratio - at]);
        near.filter(|o| *o > 0.05).collect()
    } else {
        vec![at]
    };
    let at_rate = |at: f64| -> Vec<([Vec<C>; 2], f64)> {
        base.runs
            .par_iter()
            .zip(&record.runs)
            .map(|(run, source)| {
                let hz = if fixed { at } else { at * run.angle.shaft_hz };
                let sway = Sway::fit(source, record.pulses_per_rev, hz);
                let (signal, size) = if sinusoid {
                    (waveform(analyser, &run.inner.lines, run.angle.shaft_hz, |t| sway.at(t)), sway.amplitude_rad())
                } else {
                    let spline = EdgeAngle::new(source, record.pulses_per_rev);
                    let rms = TAU * run.angle.shaft_hz * run.angle.edge_scatter_s;
                    (waveform(analyser, &run.inner.lines, run.angle.shaft_hz, |t| spline.at(t)), rms)
                };
                (signal.map(|s| analyser.bins_of(&s)), size)
            })
            .collect()
    };
    let tried = aliases.into_iter().map(|at| {
        let made = at_rate(at);
        let models: Vec<[Vec<C>; 2]> = made.iter().map(|m| m.0.clone()).collect();
        let gain = chi_change(data, &models, base, &seen);
        (at, models, made.iter().map(|m| m.1).collect::<Vec<f64>>(), gain)
    });
    let (at, models, sizes, _) = tried.max_by(|a, b| a.3.total_cmp(&b.3))?;
    let gain = chi_change(data, &models, base, held_out);
    if !accept::speed_moves(gain, chi_change(data, &models, base, &all)) {
        return None;
    }
    let mut found = effect("speed-fluctuation", "non-stationary", 1e-6);
    if sinusoid && fixed {
        found.frequency_hz = Some(at);
    } else if sinusoid {
        found.order_of_pinion = Some(at);
    }
    let mean = sizes.iter().sum::<f64>() / sizes.len() as f64;
    let spread = (sizes.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / sizes.len() as f64).sqrt();
    let half = (1.96 * spread / (sizes.len() as f64).sqrt()).hypot(0.01 * mean);
    let value = Value { value: mean, ci95: [mean - half, mean + half], unit: "rad".into() };
    let what = if sinusoid { "angle_amplitude" } else { "angle_departure_rms" };
    found.parameters.insert(what.into(), value);
    for (run, model) in base.runs.iter_mut().zip(models) {
        run.model = model;
    }
    Some(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use meshband_analysis::drawn;
    use meshband_analysis::generate::{self, Scenario};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// A machine with 67 teeth: 24 harmonics, solved for at least, reach beyond half the sampling rate.
    #[test]
    fn regress_a_time_signal_holds_the_prediction_and_nothing_folded() {
        let mut random = ChaCha8Rng::seed_from_u64(960_101);
        let declared = drawn::machine(&mut random).unwrap();
        let mut scenario = Scenario::null(&declared.shafts, random.random());
        scenario.duration_s = 1.0;
        drawn::layout(&declared, &mut scenario, &mut random);
        let record = generate::record(&declared.pair, &declared.shafts, &declared.curve, &scenario).unwrap();
        let base = Base::new(&record);
        let beyond = |run: &RunState| {
            let top = run.own.lines.last().map_or(0.0, |line| line.order);
            top * run.angle.shaft_hz > 0.5 * base.analyser.rate_hz
        };
        assert!(base.runs.iter().any(beyond), "no order of this machine folds");
        let power = |bins: &[C]| bins.iter().skip(8).map(|x| x.norm_sqr()).sum::<f64>();
        for run in &base.runs {
            for (signal, model) in complete(&base.analyser, run).iter().zip(&run.model) {
                let bins = base.analyser.bins_of(signal);
                let off: Vec<C> = bins.iter().zip(model).map(|(a, b)| a - b).collect();
                assert!(power(&off) < 1e-8 * power(model), "{:.1e}", power(&off) / power(model));
            }
        }
    }
}
