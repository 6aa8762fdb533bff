//! Calibration: the declared parameters moved, within their tolerances, to where the machine explains the record best.
//!
//! A lightly damped mode that stands a half width beside its declared frequency changes its lines by their whole
//! size, so that from the declaration the sensitivities point anywhere; and where noise is a ten-thousandth of a
//! line, nothing holds them back. The fit is therefore a continuation: lines are first asked to agree within a third
//! of their size, where the tolerances decide, then ever closer, and in every stage a damped step (Levenberg 1944,
//! Marquardt 1963) is only taken if the machine that has it explains more. A run's angle and speed are solved for at
//! every trial; a lag of the tachometer is a further unknown where one is asked for. Cost: one steady state of every
//! run per trial and its sensitivities per step taken, some twenty of each. Limit: parameters so far off that two
//! modes trade places end in the wrong valley; what is left then is for the search.

use super::base_fit::{Base, MODEL_SLACK, TOLERANCES, Trial};
use super::candidate::Template;
use super::least_squares::{Column, Data, Normal, chi_square, normal, solve};
use crate::observation::spectrum::{OVERDISPERSION, Sparse};
use crate::spectral::noise_power;
use std::f64::consts::TAU;

/// Share of a line's size within which it is asked to agree, by stage.
const AGREEMENT: [f64; 6] = [0.3, 0.1, 0.03, 0.01, 0.003, 0.001];
/// Steps taken in every stage at most.
const MOST_STEPS: usize = 6;
/// Trials of a step at most, each damped ten times as much as the one before.
const MOST_TRIALS: usize = 5;
/// Damping of the first step, as a share of the diagonal, and the least.
const DAMPING: [f64; 2] = [1e-3, 1e-6];
/// Fall of the objective below which a stage is at its end.
const LEAST_FALL: f64 = 3.0;
/// Standard deviation of a lag where one is asked for, s: that of measuring chains, and far above what parameters
/// pass for.
const LAG_SIGMA_S: f64 = 1e-4;

/// Moves the declared parameters of `base`, within their reach, to where `runs` are explained best.
pub fn calibrate(base: &mut Base, runs: &[usize]) {
    settle(base, runs, false);
}

/// The same with a lag of the vibration against the tachometer, common to all runs; returns it, s.
pub fn calibrate_with_lag(base: &mut Base, runs: &[usize]) -> f64 {
    settle(base, runs, true)
}

/// A machine on trial, what it leaves, and what the record says against it.
struct Tried {
    trial: Trial,
    data: Data,
    objective: f64,
}

fn settle(base: &mut Base, runs: &[usize], with_lag: bool) -> f64 {
    let mut lag_s = 0.0;
    for agreement in AGREEMENT {
        let mut data = base.data();
        data.weight = weights(base, &data, agreement);
        let mut now = objective(base, &data, runs, &base.change, lag_s);
        let mut damping = DAMPING[0];
        for _ in 0..MOST_STEPS {
            let lag = with_lag.then(|| lag_column(base));
            let mut columns = base.columns();
            columns.extend(lag.iter().map(|template| Column { template, prior: (1.0, -lag_s / LAG_SIGMA_S) }));
            let equations = normal(&data, runs, &columns);
            let Some((Tried { trial, data: left, objective }, moved_s)) =
                descend(base, &data, runs, &equations, (&mut damping, lag_s), now)
            else {
                break;
            };
            let fall = now - objective;
            base.take(trial);
            (data, now, lag_s) = (left, objective, lag_s + moved_s);
            if fall < LEAST_FALL {
                break;
            }
        }
    }
    lag_s
}

/// The first of ever shorter steps that explains more than `now`, with what it moves the lag by.
fn descend(
    base: &Base,
    data: &Data,
    runs: &[usize],
    equations: &Normal,
    (damping, lag_s): (&mut f64, f64),
    now: f64,
) -> Option<(Tried, f64)> {
    let own = TOLERANCES.len() + 2 * base.runs.len();
    for _ in 0..MOST_TRIALS {
        let mut damped = equations.clone();
        for i in (0..TOLERANCES.len()).chain(own..equations.right.len()) {
            damped.gram[(i, i)] *= 1.0 + *damping;
        }
        let step = solve(&damped).x;
        let moved_s = if step.len() > own { step[own] * LAG_SIGMA_S } else { 0.0 };
        let step: Vec<f64> = step.iter().take(TOLERANCES.len()).copied().collect();
        let trial = base.tried(&base.within_reach(&step), moved_s);
        let data = Data { residual: base.residual_of(&trial), weight: data.weight.clone() };
        let objective = objective(base, &data, runs, &trial.change, lag_s + moved_s);
        if objective < now {
            *damping = (0.2 * *damping).max(DAMPING[1]);
            return Some((Tried { trial, data, objective }, moved_s));
        }
        *damping *= 10.0;
    }
    None
}

/// What the record says against a machine, with each run's own angle and speed at their best.
fn objective(base: &Base, data: &Data, runs: &[usize], change: &[f64], lag_s: f64) -> f64 {
    let own = base.columns().split_off(TOLERANCES.len());
    let prior: f64 = TOLERANCES.iter().zip(change).map(|((_, sigma), done)| (done / sigma).powi(2)).sum();
    chi_square(data, runs) - solve(&normal(data, runs, &own)).gain + prior + (lag_s / LAG_SIGMA_S).powi(2)
}

/// Change of all runs with a lag, in units of its standard deviation: the vibration comes later, at an earlier angle.
fn lag_column(base: &Base) -> Template {
    let of_run = |(r, run): (usize, &super::base_fit::RunState)| {
        let turned = &base.nuisances[TOLERANCES.len() + 2 * r].runs[r];
        let per_sigma = -TAU * run.angle.shaft_hz * LAG_SIGMA_S;
        [0, 1].map(|c| Sparse::mixed(&turned[c], per_sigma, &Sparse::default(), 0.0))
    };
    Template::new(base.runs.iter().enumerate().map(of_run))
}

/// Weights of a stage: local noise, and the size of what was measured near by.
fn weights(base: &Base, data: &Data, agreement: f64) -> Vec<[Vec<f64>; 2]> {
    let lowest = (8.0 * base.analyser.duration_s()) as usize;
    let slack = agreement.max(MODEL_SLACK).powi(2);
    let one = |r: usize, c: usize| -> Vec<f64> {
        let noise = noise_power(&data.residual[r][c]);
        let measured = &base.runs[r].measured[c];
        (0..noise.len())
            .map(|b| {
                if b < lowest {
                    return 0.0;
                }
                let near = &measured[b.saturating_sub(2)..(b + 3).min(measured.len())];
                let size = near.iter().map(|x| x.norm_sqr()).fold(0.0, f64::max);
                2.0 / ((noise[b] + slack * size) * OVERDISPERSION)
            })
            .collect()
    };
    (0..base.runs.len()).map(|r| [one(r, 0), one(r, 1)]).collect()
}
