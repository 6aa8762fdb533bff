//! Joint refinement: terms, declared parameters and angles fitted to the record with the full simulator as the
//! prediction.
//!
//! Templates propose, the simulator decides. Gauss and Newton with every adopted term that the simulator takes, unless
//! it is too weak for its templates' error to show, at once: strengths, phases, shapes (a mode's frequency, a relief's
//! length, an order) and the declared parameters within their priors. Derivatives by a term's own numbers are
//! differences of simulations, or its first-order templates where it goes with its strength; those by declared
//! parameters, angles and speeds are the harmonic balance's. A step's end does not depend on derivatives, only how
//! fast it is reached. Steps that explain less are halved. What is fitted is what `loop --apply` writes.
//!
//! Afterwards the machine stands at the parameters found, the residual is what the simulation leaves, and every
//! term's templates are those that give, at its unknowns, exactly what the machine does with it beyond what it does
//! without (Broyden's update of the derivatives, 1965). Cost: an integration of every run per step and per number of
//! a term.

use super::base_fit::{Base, TOLERANCES};
use super::candidate::{Candidate, Template};
use super::judge::joint;
use super::least_squares::{Column, Data, chi_square, normal, solve, subtract};
use super::simulation::{Played, bins, has_counterpart, signals, simulated};
use super::start::Start;
use super::strength::{first_guess, size};
use super::together::unknowns;
use crate::observation::spectrum::{Bins, Sparse};
use nalgebra::DVector;
use rustfft::num_complex::Complex64 as C;

/// Times that the weights are renewed: what a start far off leaves is form error at first.
const PASSES: usize = 5;
/// Most steps in a pass.
const MOST_STEPS: usize = 5;
/// Most halvings of a step.
const MOST_HALVINGS: usize = 4;
/// Fall of the objective below which a pass is at its end: a tenth of a standard error of one number.
const LEAST_FALL: f64 = 0.01;
/// Change of a strength, as a share of it, for a derivative.
const CHANGE: f64 = 1e-3;
/// Move of a term's strengths, as a share of them, and of its shape, in steps of its differences, from which its
/// derivatives are taken anew: till then steps shrink what is left to about that share each.
const MAX_MOVE_SHARE: f64 = 0.1;
const FAR_STEPS: f64 = 10.0;
/// Squared size over noise up to which a term enters in proportion: templates that are wrong by 3 % err by less than a
/// standard error then, and nothing is integrated for it.
const MAX_LINEAR_POWER_RATIO: f64 = 1e3;
/// Bins whose squared size times weight is below this carry no information.
const LEAST_INFORMATION: f64 = 1e-4;

/// A term on its way: the candidate with its shape and starts, and its strengths.
#[derive(Clone)]
struct Moving {
    term: Candidate,
    x: Vec<f64>,
}

impl Moving {
    /// With its numbers changed by `step`, the phases of its runs behind them.
    fn moved(&self, step: &[f64]) -> Self {
        let count = self.x.len();
        let shape = self.term.shape();
        let x = self.x.iter().zip(step).map(|(x, s)| x + s).collect();
        let values: Vec<f64> = shape.iter().zip(&step[count..]).map(|(s, d)| s.0 + d).collect();
        let mut term = self.term.with_shape(&values);
        if let (Start::Phases(phases), [a, b, ..]) = (&mut term.start, &self.x[..]) {
            // The first run's phase is that of the unknowns.
            for (phase, turn) in phases.iter_mut().skip(1).zip(&step[count + shape.len()..]) {
                *phase += turn / a.hypot(*b);
            }
        }
        Self { term, x }
    }

    /// Steps of its numbers for differences.
    fn differences(&self) -> Vec<f64> {
        let own = CHANGE * size(&self.x);
        self.x.iter().map(|_| own).chain(self.term.shape().iter().map(|s| s.1)).collect()
    }
}

/// One prediction on its way: moves of the declared parameters, and the terms that are played.
#[derive(Clone)]
struct State {
    delta: Vec<f64>,
    moving: Vec<Moving>,
}

impl State {
    fn played(&self) -> Vec<Played<'_>> {
        self.moving.iter().map(|m| (&m.term, m.x.as_slice())).collect()
    }

    fn without(&self, index: usize) -> Self {
        let mut less = self.clone();
        less.moving.remove(index);
        less
    }
}

/// Derivatives by a term's numbers, and where they were taken.
struct Slopes {
    at: Moving,
    own: Vec<Template>,
}

/// The parts of a fit that stay.
struct Fit<'a> {
    base: &'a Base,
    seen: &'a [usize],
    /// Terms that enter in proportion beside the simulation.
    linear: Vec<&'a Candidate>,
    weight: Vec<[Vec<f64>; 2]>,
}

/// What is left of the record by a prediction; empty where it was not predicted.
fn left(base: &Base, predicted: &[[Bins; 2]]) -> Vec<[Bins; 2]> {
    let of = |(run, predicted): (&super::base_fit::RunState, &[Bins; 2])| {
        [0, 1].map(|c| match predicted[c].is_empty() {
            true => vec![C::ZERO; run.measured[c].len()],
            false => run.measured[c].iter().zip(&predicted[c]).map(|(m, p)| m - p).collect(),
        })
    };
    base.runs.iter().zip(predicted).map(of).collect()
}

impl Fit<'_> {
    fn simulated(&self, state: &State, runs: &[usize]) -> Option<Vec<[Bins; 2]>> {
        simulated(self.base, &state.delta, &state.played(), runs)
    }

    /// Weights by what a prediction leaves; none where nothing was predicted.
    fn weights(&self, predicted: &[[Bins; 2]]) -> Vec<[Vec<f64>; 2]> {
        let rest = left(self.base, predicted);
        let mut weight = self.base.weights(&rest, &rest);
        for (weight, predicted) in weight.iter_mut().flatten().zip(predicted.iter().flatten()) {
            if predicted.is_empty() {
                weight.fill(0.0);
            }
        }
        weight
    }

    /// Twice the negative logarithm of the posterior, with what enters in proportion at its best.
    fn objective(&self, state: &State, predicted: &[[Bins; 2]]) -> f64 {
        let data = Data { residual: left(self.base, predicted), weight: self.weight.clone() };
        let mut own = self.base.columns().split_off(TOLERANCES.len());
        own.extend(
            self.linear.iter().flat_map(|t| &t.templates).map(|template| Column { template, prior: (0.0, 0.0) }),
        );
        let prior = |((_, sigma), (done, d)): (&(&str, f64), (&f64, &f64))| ((done + d) / sigma).powi(2);
        let moved = TOLERANCES.iter().zip(self.base.change.iter().zip(&state.delta)).map(prior).sum::<f64>();
        chi_square(&data, self.seen) - solve(&normal(&data, self.seen, &own)).gain + moved
    }

    /// Derivatives of the prediction by every number of the term `index` of those that are played, as templates.
    fn derivatives(&self, state: &State, here: &[[Bins; 2]], index: usize) -> Option<Slopes> {
        let at = state.moving[index].clone();
        let steps = at.differences();
        let mut own = Vec::with_capacity(steps.len());
        for (u, step) in steps.iter().enumerate() {
            if u < at.x.len() && !at.term.bends() {
                own.push(at.term.templates[u].clone());
                continue;
            }
            let mut change = vec![0.0; at.x.len() + at.term.shape().len() + self.base.runs.len()];
            change[u] = *step;
            let mut there = state.clone();
            there.moving[index] = at.moved(&change);
            let there = self.simulated(&there, self.seen)?;
            let scale = if u < at.x.len() { size(&at.x) } else { 1.0 };
            own.push(slope(here, &there, *step, &self.weight, scale));
        }
        if let (Start::Phases(phases), [a, b]) = (&at.term.start, &at.x[..]) {
            // A turn of one run: the strengths' own derivatives in that run alone.
            let turned = own[0].mixed(-b / a.hypot(*b), &own[1], a / a.hypot(*b));
            own.extend((1..phases.len()).map(|run| turned.only(run)));
        }
        Some(Slopes { at, own })
    }

    /// Takes those derivatives anew that no longer hold at `state`.
    fn renew(&self, state: &State, here: &[[Bins; 2]], slopes: &mut Vec<Slopes>) -> Option<()> {
        for index in 0..state.moving.len() {
            match slopes.get(index) {
                Some(old) if !is_far(&state.moving[index], &old.at) => {}
                Some(_) => slopes[index] = self.derivatives(state, here, index)?,
                None => slopes.push(self.derivatives(state, here, index)?),
            }
        }
        Some(())
    }

    /// The step of Gauss and Newton from `state`, with that of the declared parameters first.
    fn step(&self, state: &State, predicted: &[[Bins; 2]], slopes: &[Slopes]) -> (Vec<f64>, Vec<Vec<f64>>) {
        let mut data = Data { residual: left(self.base, predicted), weight: self.weight.clone() };
        let columns: Vec<Column<'_>> = self.base.columns().into_iter().take(TOLERANCES.len()).collect();
        let back: Vec<f64> = state.delta.iter().map(|d| -d).collect();
        subtract(&mut data, &columns, &back);
        let own = state.moving.iter().zip(slopes);
        let stand_ins: Vec<Candidate> =
            own.map(|(m, slopes)| Candidate { templates: slopes.own.clone(), ..m.term.clone() }).collect();
        let all: Vec<&Candidate> = stand_ins.iter().chain(self.linear.iter().copied()).collect();
        let x = joint(self.base, &data, self.seen, &all).x;
        let delta = x[..TOLERANCES.len()].iter().zip(&state.delta).map(|(to, from)| to - from).collect();
        (delta, unknowns(self.base, &stand_ins, &x))
    }

    /// The best of ever shorter steps, with its prediction and objective.
    fn descend(
        &self,
        state: &State,
        step: &(Vec<f64>, Vec<Vec<f64>>),
        now: f64,
    ) -> Option<(State, Vec<[Bins; 2]>, f64)> {
        let mut part = 1.0;
        for _ in 0..MOST_HALVINGS {
            let delta: Vec<f64> = state.delta.iter().zip(&step.0).map(|(d, s)| d + part * s).collect();
            let moved = |(m, s): (&Moving, &Vec<f64>)| m.moved(&s.iter().map(|s| part * s).collect::<Vec<_>>());
            let moving = state.moving.iter().zip(&step.1).map(moved).collect();
            let next = State { delta: self.base.within_reach(&delta), moving };
            if let Some(predicted) = self.simulated(&next, self.seen) {
                let objective = self.objective(&next, &predicted);
                if objective < now {
                    return Some((next, predicted, objective));
                }
            }
            part *= 0.5;
        }
        None
    }

    /// Steps until nothing more is to be had; the last prediction, and whether it fell at all.
    fn settle(
        &self,
        mut state: State,
        mut predicted: Vec<[Bins; 2]>,
        slopes: &mut Vec<Slopes>,
    ) -> Option<(State, Vec<[Bins; 2]>, bool)> {
        let first = self.objective(&state, &predicted);
        let mut now = first;
        for _ in 0..MOST_STEPS {
            self.renew(&state, &predicted, slopes)?;
            let step = self.step(&state, &predicted, slopes);
            let Some((next, there, objective)) = self.descend(&state, &step, now) else { break };
            let fall = now - objective;
            (state, predicted, now) = (next, there, objective);
            if fall < LEAST_FALL {
                break;
            }
        }
        Some((state, predicted, first - now > LEAST_FALL))
    }
}

/// Whether a term's numbers have moved so far that its derivatives no longer hold.
fn is_far(a: &Moving, b: &Moving) -> bool {
    let change: Vec<f64> = a.x.iter().zip(&b.x).map(|(a, b)| a - b).collect();
    let mut shapes = a.term.shape().into_iter().zip(b.term.shape());
    size(&change) > MAX_MOVE_SHARE * size(&b.x) || shapes.any(|(a, b)| (a.0 - b.0).abs() > FAR_STEPS * a.1)
}

/// A difference of predictions over `step`, where it carries information at `scale` of the number.
fn slope(here: &[[Bins; 2]], there: &[[Bins; 2]], step: f64, weight: &[[Vec<f64>; 2]], scale: f64) -> Template {
    Template::new(here.iter().zip(there).zip(weight).map(|((here, there), weight)| {
        [0, 1].map(|c| {
            let slopes: Bins = here[c]
                .iter()
                .zip(&there[c])
                .zip(&weight[c])
                .map(|((a, b), w)| {
                    let slope = (b - a) / step;
                    if slope.norm_sqr() * scale * scale * w > LEAST_INFORMATION { slope } else { C::ZERO }
                })
                .collect();
            Sparse::of(&slopes)
        })
    }))
}

/// Whether a term at `x` is so small next to the noise that its templates are right enough.
fn is_weak(data: &Data, seen: &[usize], term: &Candidate, x: &[f64]) -> bool {
    let own: Vec<Column<'_>> = term.templates.iter().map(|template| Column { template, prior: (0.0, 0.0) }).collect();
    let gram = normal(data, seen, &own).gram;
    let x = DVector::from_column_slice(x);
    (gram * &x).dot(&x) < MAX_LINEAR_POWER_RATIO
}

/// A fit at its start, by the terms' templates.
struct Started<'a> {
    fit: Fit<'a>,
    state: State,
    /// Which of the terms are played.
    list: Vec<usize>,
}

impl<'a> Started<'a> {
    fn of(base: &'a Base, data: &Data, seen: &'a [usize], terms: &'a [Candidate]) -> Self {
        let all: Vec<&Candidate> = terms.iter().collect();
        let x = joint(base, data, seen, &all).x;
        let delta = base.within_reach(&x[..TOLERANCES.len()]);
        let x = unknowns(base, terms, &x);
        let is_played = |&i: &usize| !is_weak(data, seen, &terms[i], &x[i]) && has_counterpart(base, &terms[i], &x[i]);
        let list: Vec<usize> = (0..terms.len()).filter(is_played).collect();
        let own = |&i: &usize| Moving { term: terms[i].clone(), x: first_guess(&terms[i], &x[i]) };
        let state = State { delta, moving: list.iter().map(own).collect() };
        let linear = (0..terms.len()).filter(|i| !list.contains(i)).map(|i| &terms[i]).collect();
        Self { fit: Fit { base, seen, linear, weight: Vec::new() }, state, list }
    }
}

/// Fits the declared parameters of `base` and those of `terms` that the simulator takes to the runs `seen`; the
/// residual that goes with the terms' new templates. `None` where the simulator does not take them together: nothing
/// has changed then.
pub fn refine(base: &mut Base, data: &Data, seen: &[usize], terms: &mut [Candidate]) -> Option<Vec<[Bins; 2]>> {
    let Started { mut fit, mut state, list } = Started::of(base, data, seen, terms);
    let mut predicted = fit.simulated(&state, seen)?;
    let mut slopes = Vec::new();
    for _ in 0..PASSES {
        fit.weight = fit.weights(&predicted);
        let fell;
        (state, predicted, fell) = fit.settle(state, predicted, &mut slopes)?;
        if !fell {
            break;
        }
    }
    let runs: Vec<usize> = (0..base.runs.len()).collect();
    let signals = signals(base, &state.delta, &state.played(), &runs)?;
    let whole = bins(base, &signals);
    fit.renew(&state, &predicted, &mut slopes)?;
    fit.weight = fit.weights(&whole);
    let mut residual = left(base, &whole);
    let templates = (0..list.len())
        .map(|i| {
            let without = fit.simulated(&state.without(i), &runs)?;
            let x = &state.moving[i].x;
            Some(through(&whole, &without, &slopes[i].own[..x.len()], x, &fit.weight))
        })
        .collect::<Option<Vec<_>>>()?;
    let plain = simulated(base, &state.delta, &[], &runs)?;
    drop(fit);
    for ((&i, own), templates) in list.iter().zip(&state.moving).zip(templates) {
        terms[i] = Candidate { templates, bent: true, ..own.term.clone() };
        let back: Vec<f64> = own.x.iter().map(|x| -x).collect();
        let columns: Vec<Column<'_>> =
            terms[i].templates.iter().map(|template| Column { template, prior: (0.0, 0.0) }).collect();
        let mut data = Data { residual, weight: Vec::new() };
        subtract(&mut data, &columns, &back);
        residual = data.residual;
    }
    base.adopt(&state.delta);
    base.take_prediction(plain);
    base.signals = signals;
    Some(residual)
}

/// The objective that the terms come to next to the machine with these weights, refined as [`refine`] does, or as
/// they are; `None` where the simulator does not take them together.
pub fn objective(base: &Base, data: &Data, seen: &[usize], terms: &[Candidate], refined: bool) -> Option<f64> {
    let Started { mut fit, state, .. } = Started::of(base, data, seen, terms);
    fit.weight.clone_from(&data.weight);
    let predicted = fit.simulated(&state, seen)?;
    if !refined {
        return Some(fit.objective(&state, &predicted));
    }
    let (state, predicted, _) = fit.settle(state, predicted, &mut Vec::new())?;
    Some(fit.objective(&state, &predicted))
}

/// Templates that at `x` give the difference of two predictions, and near it the `slopes`.
fn through(
    with: &[[Bins; 2]],
    without: &[[Bins; 2]],
    slopes: &[Template],
    x: &[f64],
    weight: &[[Vec<f64>; 2]],
) -> Vec<Template> {
    let square: f64 = x.iter().map(|v| v * v).sum::<f64>().max(f64::MIN_POSITIVE);
    let mut templates = slopes.to_vec();
    for r in 0..with.len() {
        for c in 0..2 {
            let mut missing: Bins = with[r][c].iter().zip(&without[r][c]).map(|(a, b)| a - b).collect();
            for (value, w) in missing.iter_mut().zip(&weight[r][c]) {
                if value.norm_sqr() * w < LEAST_INFORMATION {
                    *value = C::ZERO;
                }
            }
            for (slope, value) in slopes.iter().zip(x) {
                slope.runs[r][c].iter().for_each(|(b, t)| missing[b] -= t * value);
            }
            for (template, value) in templates.iter_mut().zip(x) {
                let mut dense: Bins = missing.iter().map(|m| m * (value / square)).collect();
                template.runs[r][c].iter().for_each(|(b, t)| dense[b] += t);
                std::sync::Arc::make_mut(&mut template.runs[r])[c] = Sparse::of(&dense);
            }
        }
    }
    templates
}
