//! The declared machine against the record: prediction per run, declared parameters and angle offsets as nuisances.
//!
//! Every declared number is uncertain by a stated tolerance. Two Gauss-Newton steps with these as priors centre the
//! model; afterwards the sensitivities stay in every fit, so that an undeclared effect is credited only with what
//! tolerances cannot explain.

use super::candidate::Template;
use super::least_squares::{Column, Data, normal};
use crate::machine::Shafts;
use crate::model::forward::{ForwardModel, Line, Operating};
use crate::model::harmonic_balance::{Balanced, Machine, Solution};
use crate::model::pieces::smooth;
use crate::observation::angle::Angle;
use crate::observation::input::Record;
use crate::observation::spectrum::{Analyser, Bins, OVERDISPERSION, REACH, STRONG_HALF_WIDTH_BINS, Sparse};
use crate::piecewise::PiecewisePolynomial;
use crate::spectral::noise_power;
use nalgebra::{DMatrix, SymmetricEigen};
use rayon::prelude::*;
use rustfft::num_complex::Complex64 as C;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Largest error of the prediction, as a share of a line, that is never held against the declared machine: by this
/// much independent programs differ.
pub const MODEL_SLACK: f64 = 6e-4;
/// The same as a share of a whole signal, more than twice what two programs for the same equations leave of each
/// other's records without noise (4e-4 at most: the check records of the closed loop's tests).
pub const WHOLE_SLACK: f64 = 1e-3;
/// Largest error of what the terms found say, as a share of it, that is no matter of further effects: damage and its
/// idealisation differ by a per cent. A second effect on the same lines that is smaller than this is not looked for.
const EFFECT_SLACK: f64 = 1e-2;
/// Least such error: the bound of the solver and of the smooth pieces that stand for a stiffness table.
const SOLVER_SLACK: f64 = 1e-5;
/// Rounding of transforms, as a share of a channel's strongest line.
const ROUNDING: f64 = 1e-7;
/// Share of a bin's own residual treated as model-form error of whatever explains it.
const FORM_SLACK: f64 = 0.03;

/// Tolerances beyond which a declared parameter is not moved.
pub const MAX_MOVE_TOLERANCES: f64 = 3.0;

/// Half width of a sensitivity's kernel, bins: tolerances times the tail stay below noise beyond it.
const NUISANCE_REACH: i64 = 40;

/// Declared parameters with their one-sigma tolerances.
pub const TOLERANCES: [(&str, f64); 15] = [
    ("mesh stiffness", 0.03),
    ("mesh damping", 0.15),
    ("pinion bearing stiffness", 0.03),
    ("gear bearing stiffness", 0.03),
    ("pinion bearing damping", 0.15),
    ("gear bearing damping", 0.15),
    ("input coupling stiffness", 0.03),
    ("output coupling stiffness", 0.03),
    ("pinion inertia", 0.02),
    ("gear inertia", 0.02),
    ("pinion mass", 0.02),
    ("gear mass", 0.02),
    ("input coupling damping", 0.15),
    ("output coupling damping", 0.15),
    ("torque", 0.02),
];

/// One run with its measured bins and the declared machine's steady state.
pub struct RunState {
    /// Angle of the pinion.
    pub angle: Angle,
    /// Declared torque, N m.
    pub torque_n_m: f64,
    /// Measured bins, both channels.
    pub measured: [Bins; 2],
    /// Model bins, both channels.
    pub model: [Bins; 2],
    /// The machine's steady state.
    pub own: Solution,
    /// The part of it on the orders used for small effects ([`Machine::comb`]).
    pub inner: Solution,
}

/// A machine with other parameters, on every run.
pub struct Trial {
    machine: Machine,
    /// Relative changes from the declaration, by [`TOLERANCES`].
    pub change: Vec<f64>,
    runs: Vec<RunOnTrial>,
}

struct RunOnTrial {
    angle: Angle,
    own: Balanced,
    model: [Bins; 2],
}

/// Record, model and sensitivities.
pub struct Base {
    /// Window and kernel.
    pub analyser: Analyser,
    /// Machine at the adopted parameters.
    pub machine: Machine,
    /// Stiffness of the declared pair, as the simulator takes it.
    smooth: Arc<PiecewisePolynomial>,
    /// Whether that stands for the table.
    pub is_close: bool,
    /// What the table's roughness adds to the signals of the machine as it stands; empty where its pieces stand for it.
    pub roughness: Vec<[Vec<f64>; 2]>,
    /// Error of the prediction as a share of a line, as estimated from what the fit leaves at mesh orders.
    pub discrepancy: f64,
    /// Error of what the terms found so far say, as a share of it in every bin, as estimated from what they leave.
    pub inexact: f64,
    /// Runs.
    pub runs: Vec<RunState>,
    /// Simulated signals of every run with everything found so far; empty where nothing was simulated yet.
    pub signals: Vec<[Vec<f64>; 2]>,
    /// Tachometer pulses per turn of the pinion.
    pub pulses_per_rev: u32,
    /// Relative changes adopted so far, by [`TOLERANCES`].
    pub change: Vec<f64>,
    /// Templates of the nuisances: declared parameters, then angle offset and speed error of every run.
    pub nuisances: Vec<Template>,
    /// Prior precision and mean of every nuisance.
    pub priors: Vec<(f64, f64)>,
}

/// What is left of a power.
#[derive(Default)]
struct Share {
    left: f64,
    whole: f64,
}

impl Share {
    fn add(&mut self, left: f64, whole: f64) {
        self.left += left;
        self.whole += whole;
    }

    /// As a share of the amplitude.
    fn root(&self) -> f64 {
        (self.left / self.whole.max(f64::MIN_POSITIVE)).max(0.0).sqrt()
    }
}

fn changed(machine: &Machine, change: &[f64]) -> (Machine, f64) {
    let mut m = machine.clone();
    let f = |i: usize| 1.0 + change[i];
    let s: &mut Shafts = &mut m.shafts;
    m.tau_s *= f(1);
    for side in 0..2 {
        s.bearing_stiffness_n_per_m[side] *= f(2 + side);
        s.bearing_damping_n_s_per_m[side] *= f(4 + side);
        s.coupling_stiffness_n_m_per_rad[side] *= f(6 + side);
        s.mass_kg[side] *= f(10 + side);
        s.coupling_damping_n_m_s_per_rad[side] *= f(12 + side);
    }
    s.inertia_pinion_kg_m2 *= f(8);
    s.inertia_gear_kg_m2 *= f(9);
    m.stiffen(f(0));
    (m, f(14))
}

fn bins(analyser: &Analyser, angle: &Angle, lines: &[Line]) -> [Bins; 2] {
    [0, 1].map(|c| analyser.bins_of_lines(lines, angle.offset_rad, angle.shaft_hz, c, STRONG_HALF_WIDTH_BINS))
}

impl Base {
    /// Declared machine on every run; nothing fitted yet.
    pub fn new(record: &Record) -> Self {
        let samples = record.runs.iter().map(|r| r.channels[0].len()).min().unwrap_or(0);
        let mut analyser = Analyser::new(samples, record.sample_rate_hz);
        analyser.up_to(record.top_hz);
        let machine = Machine::new(&record.pair, &record.shafts, &record.curve);
        let (runs, balanced): (Vec<RunState>, Vec<Balanced>) = record
            .runs
            .par_iter()
            .map(|run| {
                let angle = Angle::fit(run, record.pulses_per_rev, record.jitter_s);
                let balanced = machine.run(Operating { shaft_hz: angle.shaft_hz, torque_n_m: run.input_torque_n_m });
                let measured = [0, 1].map(|c| analyser.bins_of(&run.channels[c][..samples]));
                let model = bins(&analyser, &angle, machine.prediction(&balanced));
                let inner = balanced.solution.within(machine.harmonics(angle.shaft_hz) as usize);
                let (torque_n_m, own) = (run.input_torque_n_m, balanced.solution.clone());
                (RunState { angle, torque_n_m, measured, model, own, inner }, balanced)
            })
            .unzip();
        let change = vec![0.0; TOLERANCES.len()];
        let (pulses_per_rev, nuisances, priors) = (record.pulses_per_rev, Vec::new(), Vec::new());
        let (smooth, is_close) = smooth(&record.curve);
        let smooth = Arc::new(smooth);
        let signals = Vec::new();
        let discrepancy = MODEL_SLACK;
        let roughness = Vec::new();
        let mut base = Self {
            analyser,
            machine,
            smooth,
            is_close,
            roughness,
            discrepancy,
            inexact: 0.0,
            runs,
            signals,
            pulses_per_rev,
            change,
            nuisances,
            priors,
        };
        base.linearise(&balanced);
        base
    }

    /// Sensitivities of all runs to each declared parameter, and to each run's angle offset and speed error: all that
    /// the factorised combs of the runs are needed for.
    fn linearise(&mut self, balanced: &[Balanced]) {
        let (machine, analyser) = (&self.machine, &self.analyser);
        let per_run: Vec<Vec<[Sparse; 2]>> = self
            .runs
            .par_iter()
            .zip(balanced)
            .map(|(run, balanced)| {
                let angle = &run.angle;
                machine
                    .jacobian(balanced)
                    .iter()
                    .map(|lines| analyser.templates_of_lines(lines, angle.offset_rad, angle.shaft_hz, NUISANCE_REACH))
                    .collect()
            })
            .collect();
        self.nuisances =
            (0..TOLERANCES.len()).map(|p| Template::new(per_run.iter().map(|run| run[p].clone()))).collect();
        self.priors =
            TOLERANCES.iter().zip(&self.change).map(|((_, sigma), done)| (1.0 / (sigma * sigma), -done)).collect();
        for r in 0..self.runs.len() {
            let run = &self.runs[r];
            let lines = &run.own.lines;
            let turned: Vec<_> = lines
                .iter()
                .map(|line| Line { order: line.order, amplitude: line.amplitude.map(|a| a * C::new(0.0, line.order)) })
                .collect();
            let parts = self.analyser.templates_of_lines(&turned, run.angle.offset_rad, run.angle.shaft_hz, REACH);
            let alone = |parts: [Sparse; 2]| {
                let mut all = vec![<[Sparse; 2]>::default(); self.runs.len()];
                all[r] = parts;
                Template::new(all)
            };
            self.nuisances.push(alone(parts));
            self.priors.push((run.angle.sigma_rad.powi(-2), 0.0));
            // A wrong speed turns every line about mid-run; in units of its standard error.
            let half_step = 0.01 / self.analyser.duration_s();
            let shifted = |hz: f64, c: usize| {
                let top = lines.last().map_or(1.0, |l| l.order);
                let change = hz / top;
                let offset = run.angle.offset_rad - 0.5 * TAU * change * self.analyser.duration_s();
                self.analyser.bins_of_lines(lines, offset, run.angle.shaft_hz + change, c, REACH)
            };
            let per_sigma = run.angle.sigma_hz * lines.last().map_or(1.0, |l| l.order) / (2.0 * half_step);
            let parts = [0, 1].map(|c| {
                let (up, down) = (shifted(half_step, c), shifted(-half_step, c));
                let slope: Bins = up.iter().zip(&down).map(|(u, d)| (u - d) * per_sigma).collect();
                Sparse::of(&slope)
            });
            self.nuisances.push(alone(parts));
            self.priors.push((1.0, 0.0));
        }
    }

    /// Residual of the current model with weights: local noise, model slack and form slack.
    pub fn data(&self) -> Data {
        let residual: Vec<[Bins; 2]> = self
            .runs
            .iter()
            .map(|run| [0, 1].map(|c| run.measured[c].iter().zip(&run.model[c]).map(|(m, p)| m - p).collect()))
            .collect();
        let weight = self.weights(&residual, &residual);
        Data { residual, weight }
    }

    /// Weights from the noise of `quiet` (the best current residual) and slack in proportion to `raw` (the model's
    /// residual).
    pub fn weights(&self, quiet: &[[Bins; 2]], raw: &[[Bins; 2]]) -> Vec<[Vec<f64>; 2]> {
        // The lowest bins hold window leakage of the mean and wander of sensors: below 8 Hz nothing is compared.
        let lowest = (8.0 * self.analyser.duration_s()) as usize;
        (0..self.runs.len())
            .map(|r| {
                [0, 1].map(|c| {
                    let noise = noise_power(&quiet[r][c]);
                    let rounding = self.rounding(r, c);
                    (0..noise.len())
                        .map(|b| {
                            if b < lowest {
                                return 0.0;
                            }
                            // Kernel-wide maximum: a line's slack covers its whole main lobe.
                            let near = b.saturating_sub(2)..(b + 3).min(noise.len());
                            let form = raw[r][c][near].iter().map(|x| x.norm_sqr()).fold(0.0, f64::max);
                            let model = self.runs[r].model[c][b];
                            let found = (self.runs[r].measured[c][b] - model - quiet[r][c][b]).norm_sqr();
                            let slack = self.discrepancy.powi(2) * model.norm_sqr()
                                + self.inexact.powi(2) * found
                                + FORM_SLACK * FORM_SLACK * form
                                + rounding;
                            2.0 / ((noise[b] + slack) * OVERDISPERSION)
                        })
                        .collect()
                })
            })
            .collect()
    }

    /// Local noise of a run's residual in a channel, and the model error that is never held against the machine, by
    /// bin.
    pub fn unexplainable(&self, run: usize, channel: usize, residual: &[C]) -> Vec<f64> {
        let model = &self.runs[run].model[channel];
        let noise = noise_power(residual);
        let slack = self.discrepancy.powi(2);
        noise.iter().zip(model).map(|(noise, model)| noise + slack * model.norm_sqr()).collect()
    }

    /// Power that rounding leaves in a bin.
    fn rounding(&self, run: usize, channel: usize) -> f64 {
        let strongest = self.runs[run].measured[channel].iter().map(|x| x.norm_sqr()).fold(0.0, f64::max);
        ROUNDING * ROUNDING * strongest
    }

    /// Estimates the error of the prediction from what the fit leaves, `rest`, beyond the local noise: at the machine's
    /// own lines, no less than the solver's and no more than by what independent programs differ, and where the terms
    /// found say most. What is more is a matter of effects.
    pub fn estimate_discrepancy(&mut self, rest: &[[Bins; 2]], runs: &[usize]) {
        let mut own = Share::default();
        let mut of_terms = Share::default();
        for &r in runs {
            for (c, rest) in rest[r].iter().enumerate() {
                let (measured, model) = (&self.runs[r].measured[c], &self.runs[r].model[c]);
                for ((b, x), noise) in rest.iter().enumerate().zip(noise_power(rest)) {
                    let found = (measured[b] - model[b] - x).norm_sqr();
                    if model[b].norm_sqr() * SOLVER_SLACK > noise {
                        own.add(x.norm_sqr() - noise, model[b].norm_sqr());
                    }
                    if found * EFFECT_SLACK * EFFECT_SLACK > noise {
                        of_terms.add(x.norm_sqr() - noise, found);
                    }
                }
            }
        }
        self.discrepancy = own.root().clamp(SOLVER_SLACK, MODEL_SLACK);
        self.inexact = of_terms.root().min(EFFECT_SLACK);
    }

    /// Power that one standard error of a run's angle and one of its speed, by the declared jitter of edges, put into
    /// every bin.
    pub fn timing_power(&self, run: usize) -> [Vec<f64>; 2] {
        let first = TOLERANCES.len() + 2 * run;
        let columns = self.nuisances.iter().zip(&self.priors).skip(first).take(2);
        let mut power = [0, 1].map(|_| vec![0.0; self.analyser.bins]);
        for (template, (precision, _)) in columns {
            for (power, part) in power.iter_mut().zip(template.runs[run].iter()) {
                for (bin, value) in part.iter() {
                    power[bin] += value.norm_sqr() / precision;
                }
            }
        }
        power
    }

    /// Power that the uncertainty of the declared parameters, of this covariance of all unknowns, gives to a
    /// prediction of `run`, by channel and bin.
    pub fn parameter_power(&self, run: usize, covariance: &DMatrix<f64>) -> [Vec<f64>; 2] {
        let count = TOLERANCES.len();
        let own = SymmetricEigen::new(covariance.view((0, 0), (count, count)).into_owned());
        let mut power = [0, 1].map(|_| vec![0.0; self.analyser.bins]);
        for (c, power) in power.iter_mut().enumerate() {
            for (vector, value) in own.eigenvectors.column_iter().zip(&own.eigenvalues) {
                let mut moved = vec![C::ZERO; power.len()];
                for (template, share) in self.nuisances.iter().zip(&vector) {
                    template.runs[run][c].iter().for_each(|(bin, t)| moved[bin] += t * *share);
                }
                power.iter_mut().zip(&moved).for_each(|(p, m)| *p += value.max(0.0) * m.norm_sqr());
            }
        }
        power
    }

    /// Runs by speed, slowest first: those within 2 % of the slowest of a group have the same.
    pub fn speeds(&self) -> Vec<Vec<usize>> {
        let mut by_speed: Vec<usize> = (0..self.runs.len()).collect();
        by_speed.sort_by(|&a, &b| self.runs[a].angle.shaft_hz.total_cmp(&self.runs[b].angle.shaft_hz));
        let mut groups: Vec<Vec<usize>> = Vec::new();
        for r in by_speed {
            let speed = self.runs[r].angle.shaft_hz;
            match groups.last_mut() {
                Some(group) if (speed / self.runs[group[0]].angle.shaft_hz - 1.0).abs() < 0.02 => group.push(r),
                _ => groups.push(vec![r]),
            }
        }
        groups
    }

    /// The machine with its parameters moved by `delta`, and the factor on declared torques that goes with it.
    pub fn moved(&self, delta: &[f64]) -> (Machine, f64) {
        let (machine, factor) = changed(&self.machine, delta);
        (machine, factor * (1.0 + self.change[14]))
    }

    /// Stiffness of a pair with the parameters moved by `delta`, in few smooth pieces.
    pub fn stiffness(&self, delta: &[f64]) -> PiecewisePolynomial {
        self.smooth.scaled((1.0 + self.change[0]) * (1.0 + delta[0]))
    }

    /// Takes what a simulation of the machine at its present parameters gives for its prediction.
    pub fn take_prediction(&mut self, simulated: Vec<[Bins; 2]>) {
        self.runs.iter_mut().zip(simulated).for_each(|(run, bins)| run.model = bins);
    }

    /// Nuisance columns with their priors.
    pub fn columns(&self) -> Vec<Column<'_>> {
        self.nuisances.iter().zip(&self.priors).map(|(template, &prior)| Column { template, prior }).collect()
    }

    /// The machine with its declared parameters moved by `delta` (relative to the present ones) and the vibration
    /// later by `lag_s`, on every run.
    pub fn tried(&self, delta: &[f64], lag_s: f64) -> Trial {
        let (machine, _) = changed(&self.machine, delta);
        let change: Vec<f64> = self.change.iter().zip(delta).map(|(c, d)| (1.0 + c) * (1.0 + d) - 1.0).collect();
        let torque = 1.0 + change[14];
        let of_run = |run: &RunState| {
            let mut angle = run.angle;
            angle.offset_rad -= TAU * angle.shaft_hz * lag_s;
            let own = machine.run(Operating { shaft_hz: angle.shaft_hz, torque_n_m: run.torque_n_m * torque });
            let model = bins(&self.analyser, &angle, machine.prediction(&own));
            RunOnTrial { angle, own, model }
        };
        let runs = self.runs.par_iter().map(of_run).collect();
        Trial { machine, change, runs }
    }

    /// The machine on trial on every run, without what was measured and without sensitivities.
    pub fn alone(&self, trial: Trial) -> Self {
        let Trial { machine, change, runs } = trial;
        let of_run = |(run, RunOnTrial { angle, own, model }): (&RunState, RunOnTrial)| RunState {
            angle,
            torque_n_m: run.torque_n_m,
            measured: Default::default(),
            model,
            inner: own.solution.within(machine.harmonics(angle.shaft_hz) as usize),
            own: own.solution,
        };
        let runs = self.runs.iter().zip(runs).map(of_run).collect();
        let (analyser, pulses_per_rev) = (self.analyser.clone(), self.pulses_per_rev);
        let smooth = Arc::clone(&self.smooth);
        Self {
            analyser,
            machine,
            smooth,
            is_close: self.is_close,
            roughness: Vec::new(),
            discrepancy: self.discrepancy,
            inexact: self.inexact,
            runs,
            signals: Vec::new(),
            pulses_per_rev,
            change,
            nuisances: Vec::new(),
            priors: Vec::new(),
        }
    }

    /// What such a machine leaves of the record.
    pub fn residual_of(&self, trial: &Trial) -> Vec<[Bins; 2]> {
        let left = |(run, trial): (&RunState, &RunOnTrial)| {
            [0, 1].map(|c| run.measured[c].iter().zip(&trial.model[c]).map(|(m, p)| m - p).collect())
        };
        self.runs.iter().zip(&trial.runs).map(left).collect()
    }

    /// Takes a machine tried for its own.
    pub fn take(&mut self, trial: Trial) {
        let Trial { machine, change, runs } = trial;
        let mut balanced = Vec::new();
        for (run, RunOnTrial { angle, own, model }) in self.runs.iter_mut().zip(runs) {
            run.inner = own.solution.within(machine.harmonics(angle.shaft_hz) as usize);
            (run.angle, run.own, run.model) = (angle, own.solution.clone(), model);
            balanced.push(own);
        }
        (self.machine, self.change) = (machine, change);
        self.linearise(&balanced);
    }

    /// Moves the declared parameters by `delta` (relative to the present ones) and recomputes everything.
    pub fn adopt(&mut self, delta: &[f64]) {
        self.take(self.tried(delta, 0.0));
    }

    /// Estimate of what linear sensitivities miss, as a gain, when the declared parameters move by `delta`: second
    /// order, ten times the squared move near a resonance.
    pub fn departure(&self, data: &Data, runs: &[usize], delta: &[f64]) -> f64 {
        let gram = normal(data, runs, &self.columns()[..delta.len()]).gram;
        delta.iter().enumerate().map(|(i, d)| gram[(i, i)] * (10.0 * d * d).powi(2)).sum()
    }

    /// The move `delta` cut so that no parameter leaves [`MAX_MOVE_TOLERANCES`] tolerances.
    pub fn within_reach(&self, delta: &[f64]) -> Vec<f64> {
        let cut = |(i, d): (usize, &f64)| {
            let far = MAX_MOVE_TOLERANCES * TOLERANCES[i].1;
            (self.change[i] + d).clamp(-far, far) - self.change[i]
        };
        delta.iter().enumerate().map(cut).collect()
    }
}
