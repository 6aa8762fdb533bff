//! Scores of candidates next to the nuisances and the accepted terms.
//!
//! Score: whitened likelihood gain over fit and selection runs, less a penalty per unknown and twice the logarithm of
//! the search ([`accept`]). Whether one law serves all runs is asked by giving the term values of its own on the
//! selection runs: what that gains must be a small share. (To predict the selection runs from the fit runs alone is
//! no fair test: declared parameters within tolerance hide much of an effect, and a line may stand in few runs.)
//! Fixed frequencies, whose phase is free in every run, must predict those runs.

use super::accept::{self, Figures};
use super::base_fit::Base;
use super::candidate::Candidate;
use super::frame::{Border, Frame};
use super::least_squares::{Column, Data, normal, subtract};
use super::probability::Probability;
use super::start::{self, Products, Start};
use crate::machine::{Freedom, Hunting};
use nalgebra::DMatrix;
use rustfft::num_complex::Complex64 as C;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Runs by use.
pub struct Split {
    /// Values are fitted here.
    pub fit: Vec<usize>,
    /// Terms are selected here.
    pub select: Vec<usize>,
    /// No part in any fit but that of their own start; they may veto a term.
    pub held_out: Vec<usize>,
}

impl Split {
    /// Number of runs.
    pub fn count(&self) -> usize {
        self.fit.len() + self.select.len() + self.held_out.len()
    }

    /// Fit and selection runs.
    pub fn seen(&self) -> Vec<usize> {
        self.fit.iter().chain(&self.select).copied().collect()
    }
}

/// A candidate with its scores.
#[derive(Debug, Clone)]
pub struct Judged {
    /// The candidate.
    pub candidate: Candidate,
    /// Penalised gain.
    pub score: f64,
    /// Gain over fit and selection runs.
    pub gain: f64,
    /// Gain on the selection runs with values from the fit runs.
    pub select_gain: f64,
    /// Gain there if the law holds.
    pub select_promise: f64,
    /// What values of its own for the selection runs would gain on top: near its number of unknowns where one law
    /// serves all runs.
    pub apart_gain: f64,
    /// Values of the candidate's unknowns over fit and selection runs; empty where every run has its own phase.
    pub x: Vec<f64>,
    /// Logarithm of the number of starts of the runs that were tried.
    pub start_nats: f64,
    /// Unknowns fitted on fit and selection runs: degrees of freedom of the gain where nothing is there.
    pub unknowns: f64,
}

impl Judged {
    /// What the gate asks, among `tests` candidates.
    pub fn figures(&self, tests: f64) -> Figures {
        Figures {
            score: self.score,
            gain: self.gain,
            select_gain: self.select_gain,
            select_promise: self.select_promise,
            apart_gain: self.apart_gain,
            templates: self.candidate.templates.len(),
            phase_free: self.candidate.phase_free,
            chance: self.chance(tests),
        }
    }

    /// Probability of such a gain by chance, after Bonferroni over all `tests` of the search, the places that the
    /// candidate's own was chosen from, and the starts of its runs.
    pub fn chance(&self, tests: f64) -> Probability {
        let alone = Probability::chi_square_above(self.gain.max(0.0), self.unknowns);
        let own = self.candidate.searched.max(self.candidate.scanned);
        alone.among(own.ln() + tests.ln() + self.start_nats)
    }
}

/// Estimate of everything in the model.
pub struct Joint {
    /// All unknowns: nuisances first, then every term's.
    pub x: Vec<f64>,
    /// Their standard errors.
    pub sigma: Vec<f64>,
    /// Covariance of the nuisances and terms.
    pub covariance: DMatrix<f64>,
}

/// Columns of nuisances and terms.
pub fn columns<'a>(base: &'a Base, terms: &[&'a Candidate]) -> Vec<Column<'a>> {
    let mut all = base.columns();
    for term in terms {
        all.extend(term.templates.iter().map(|template| Column { template, prior: (0.0, 0.0) }));
    }
    all
}

/// Joint estimate over `runs`.
pub fn joint(base: &Base, data: &Data, runs: &[usize], terms: &[&Candidate]) -> Joint {
    let estimate = Frame::new(data, &columns(base, terms)).estimate(runs, None);
    let mut x: Vec<f64> = estimate.x.iter().copied().collect();
    let sigma = (0..x.len()).map(|i| estimate.covariance[(i, i)].max(0.0).sqrt()).collect();
    let mut at = base.nuisances.len();
    for term in terms {
        if term.phase_free {
            tie_phase_free(data, runs, term, &mut x[at..at + term.templates.len()]);
        }
        at += term.templates.len();
    }
    Joint { x, sigma, covariance: estimate.covariance }
}

/// One amplitude for all runs, taken from `runs`; each run keeps its own phase.
fn tie_phase_free(data: &Data, runs: &[usize], term: &Candidate, x: &mut [f64]) {
    let (mut sum, mut total) = (0.0, 1e-300);
    let mut own = vec![(C::ZERO, 0.0); x.len() / 2];
    for (r, own) in own.iter_mut().enumerate() {
        let pair = [2 * r, 2 * r + 1].map(|i| Column { template: &term.templates[i], prior: (0.0, 0.0) });
        let n = normal(data, &[r], &pair);
        let energy = n.gram[(0, 0)];
        let value = if runs.contains(&r) {
            C::new(x[2 * r], x[2 * r + 1])
        } else {
            C::new(n.right[0], n.right[1]) / energy.max(1e-300)
        };
        if runs.contains(&r) {
            sum += energy * value.norm();
            total += energy;
        }
        *own = (value, energy);
    }
    let amplitude = sum / total;
    for (r, (value, _)) in own.iter().enumerate() {
        let unit = if value.norm() > 0.0 { value / value.norm() } else { C::ONE };
        x[2 * r] = amplitude * unit.re;
        x[2 * r + 1] = amplitude * unit.im;
    }
}

/// Residual with the joint estimate `x` removed everywhere.
pub fn corrected(base: &Base, data: &Data, x: &[f64], terms: &[&Candidate]) -> Data {
    let mut rest = Data { residual: data.residual.clone(), weight: data.weight.clone() };
    subtract(&mut rest, &columns(base, terms), x);
    rest
}

/// Effective number of unknowns: a free phase per run costs like an unknown, one amplitude for all.
fn unknowns(candidate: &Candidate, runs: usize) -> f64 {
    if candidate.phase_free { 1.0 + runs as f64 } else { candidate.templates.len() as f64 }
}

/// Nuisances and accepted terms, fitted and ready to judge candidates.
pub struct Judge<'a> {
    frame: Frame<'a>,
    split: &'a Split,
    seen: Vec<usize>,
    common: nalgebra::DVector<f64>,
    fit_change: f64,
    gain: f64,
    hunting: Hunting,
    tried: AtomicUsize,
}

/// Scores, as [`Judged`] has them.
struct Scores {
    score: f64,
    gain: f64,
    select_gain: f64,
    select_promise: f64,
    apart_gain: f64,
    x: Vec<f64>,
    start_nats: f64,
    unknowns: f64,
}

impl<'a> Judge<'a> {
    /// Prepares the common columns.
    pub fn new(base: &Base, data: &'a Data, split: &'a Split, terms: &[&Candidate]) -> Self {
        let hunting = Hunting::of(base.machine.teeth);
        Self::of(Frame::new(data, &columns(base, terms)), split, hunting)
    }

    fn of(frame: Frame<'a>, split: &'a Split, hunting: Hunting) -> Self {
        let seen = split.seen();
        let fitted = frame.estimate(&split.fit, None);
        // Parameters led astray by an effect may predict worse than none moved: that is no gain of the effect.
        let fit_change = frame.change(&split.select, None, &fitted.x).min(0.0);
        let all = frame.estimate(&seen, None);
        Self { frame, split, seen, common: all.x, fit_change, gain: all.gain, hunting, tried: AtomicUsize::new(0) }
    }

    /// Number of scores given so far: candidates, their shapes, strengths and starts.
    pub fn tried(&self) -> usize {
        self.tried.load(Ordering::Relaxed)
    }

    /// Scores of `candidate` as it is.
    pub fn judge(&self, candidate: Candidate) -> Judged {
        let scores = self.scores(&candidate, &candidate.start, &self.frame.border(&candidate.templates));
        scores.of(candidate)
    }

    /// The better of `candidate` as it is and of the same with its runs started where they agree best, or as `given`
    /// by another effect.
    pub fn judge_started(&self, candidate: Candidate, given: Option<&[u32]>) -> Judged {
        let border = self.frame.border(&candidate.templates);
        self.judge_bordered(candidate, &border, given)
    }

    /// [`Judge::judge_started`] of a candidate whose products are at hand; of its templates only their number is asked.
    pub fn judge_bordered(&self, candidate: Candidate, border: &Border, given: Option<&[u32]>) -> Judged {
        let counted = self.scores(&candidate, &candidate.start, border);
        let best = self.best_start(&candidate, border, given).filter(|best| best.0.score > counted.score);
        match best {
            Some((scores, start)) => scores.of(candidate.started(start)),
            None => counted.of(candidate),
        }
    }

    /// `candidate` with its runs started where they agree best, whatever it scores as counted; none where it does not
    /// depend on whole turns.
    pub fn judge_turned(&self, candidate: &Candidate) -> Option<Judged> {
        if self.hunting.freedom(&candidate.pair_orders) != Freedom::Turns {
            return None;
        }
        let (scores, start) = self.best_start(candidate, &self.frame.border(&candidate.templates), None)?;
        Some(scores.of(candidate.started(start)))
    }

    /// The best start of the runs that is not as counted, with its scores.
    fn best_start(&self, candidate: &Candidate, border: &Border, given: Option<&[u32]>) -> Option<(Scores, Start)> {
        let orders = &candidate.pair_orders;
        let freedom = self.hunting.freedom(orders);
        if freedom == Freedom::None {
            return None;
        }
        let runs: Vec<Products> = (0..self.split.count())
            .map(|r| {
                let (right, gram) = (border.right_after(r, &self.common), border.gram(r));
                let pairs = 0..orders.len();
                Products {
                    right: pairs.clone().map(|j| C::new(right[2 * j], right[2 * j + 1])).collect(),
                    energy: pairs.map(|j| 0.5 * (gram[(2 * j, 2 * j)] + gram[(2 * j + 1, 2 * j + 1)])).collect(),
                }
            })
            .collect();
        let found = match freedom {
            Freedom::Phase => start::phases(&runs),
            _ => start::turns(&runs, orders, &self.seen, self.hunting),
        };
        let given = given.filter(|_| freedom == Freedom::Turns).map(|given| Start::Given(given.to_vec()));
        let scored = [Some(found), given].into_iter().flatten().map(|start| {
            let turned = border.turned(|run, pair| start.phase_rad(run, orders[pair]));
            (self.scores(candidate, &start, &turned), start)
        });
        scored.max_by(|a, b| a.0.score.total_cmp(&b.0.score))
    }

    fn scores(&self, candidate: &Candidate, start: &Start, border: &Border) -> Scores {
        self.tried.fetch_add(1, Ordering::Relaxed);
        let mut apart_gain = 0.0;
        let (gain, select_gain, select_promise, x) = if candidate.phase_free {
            // One amplitude, a phase per run: gain 2 A |s| - A^2 E of every run, A from the other runs where it must
            // predict.
            let runs: Vec<(f64, f64)> = (0..candidate.templates.len() / 2)
                .map(|r| {
                    let right = border.right_after(r, &self.common);
                    let gram = border.gram(r);
                    (right[2 * r].hypot(right[2 * r + 1]), 0.5 * (gram[(2 * r, 2 * r)] + gram[(2 * r + 1, 2 * r + 1)]))
                })
                .collect();
            let amplitude = |of: &[usize]| {
                of.iter().map(|&r| runs[r].0).sum::<f64>() / of.iter().map(|&r| runs[r].1).sum::<f64>().max(1e-300)
            };
            let gain = |of: &[usize], a: f64| of.iter().map(|&r| 2.0 * a * runs[r].0 - a * a * runs[r].1).sum::<f64>();
            let a = amplitude(&self.split.fit);
            let promise: f64 = self.split.select.iter().map(|&r| a * a * runs[r].1).sum();
            (gain(&self.seen, amplitude(&self.seen)), gain(&self.split.select, a), promise, Vec::new())
        } else {
            let fitted = self.frame.estimate(&self.split.fit, Some(border));
            let select = self.fit_change - self.frame.change(&self.split.select, Some(border), &fitted.x);
            let own = fitted.x.rows(fitted.x.len() - border.count, border.count);
            let whole = self.frame.estimate(&self.seen, Some(border));
            let x = whole.x.rows(whole.x.len() - border.count, border.count).into_owned();
            let gain = whole.gain - self.gain;
            let power = |runs: &[usize], x: &nalgebra::DVector<f64>| -> f64 {
                runs.iter().map(|&r| x.dot(&(border.gram(r) * x))).sum()
            };
            // What the common columns explain of the term without it is no promise: the same share is taken off
            // everywhere.
            let net = (gain / power(&self.seen, &x).max(1e-300)).clamp(0.0, 1.0);
            let own = own.into_owned();
            let promise = net * power(&self.split.select, &own);
            apart_gain = self.frame.estimate(&self.seen, Some(&border.apart(&self.split.select))).gain - whole.gain;
            (gain, select, promise, x.iter().copied().collect())
        };
        let further_runs = (self.seen.len() - 1) as f64;
        let start_nats = start.nats_per_run(self.hunting) * further_runs;
        let unknowns = unknowns(candidate, self.seen.len()) + start.unknowns_per_run() * further_runs;
        let score = accept::score(gain, unknowns, candidate.searched.ln() + start_nats);
        Scores { score, gain, select_gain, select_promise, apart_gain, x, start_nats, unknowns }
    }
}

/// The judge before residuals that were not measured.
impl<'a> Judge<'a> {
    /// Products of a candidate's templates.
    pub fn border(&self, candidate: &Candidate) -> Border {
        self.frame.border(&candidate.templates)
    }

    /// Before another residual with the same weights, next to the same terms.
    pub fn before<'b>(&'b self, base: &Base, data: &'b Data, terms: &[&Candidate]) -> Judge<'b> {
        Judge::of(self.frame.before(data, &columns(base, terms)), self.split, self.hunting)
    }

    /// Where the residual of every run also holds the templates of `border` at `x`, with that border.
    pub fn holding(&self, border: &Border, x: &[nalgebra::DVector<f64>]) -> (Self, Border) {
        let (frame, border) = self.frame.holding(border, x);
        (Self::of(frame, self.split, self.hunting), border)
    }

    /// Chi-square of the held-out runs without the candidate and with it, but for what both leave, as the veto asks:
    /// the columns `own` of the runs (angle and speed) are no part of the prediction and are fitted last. `border`:
    /// of the candidate as it was judged, starts included.
    pub fn held_out(&self, candidate: &Candidate, border: &Border, own: std::ops::Range<usize>) -> [f64; 2] {
        let error = |border: Option<&Border>| {
            let mut x = self.frame.estimate(&self.seen, border).x;
            x.rows_mut(own.start, own.len()).fill(0.0);
            if let Some(border) = border.filter(|_| candidate.phase_free) {
                tied(border, &self.seen, &mut x);
            }
            self.frame.change_refitted(&self.split.held_out, border, &x, own.clone())
        };
        [error(None), error(Some(border))]
    }
}

/// One amplitude for all runs, taken from `seen`, with each run's own phase.
fn tied(border: &Border, seen: &[usize], x: &mut nalgebra::DVector<f64>) {
    let first = x.len() - border.count;
    let runs = 0..border.count / 2;
    let energy = |r: usize| border.gram(r)[(2 * r, 2 * r)];
    let own: Vec<C> = runs
        .clone()
        .map(|r| match seen.contains(&r) {
            true => C::new(x[first + 2 * r], x[first + 2 * r + 1]),
            false => C::new(border.right(r)[2 * r], border.right(r)[2 * r + 1]) / energy(r).max(1e-300),
        })
        .collect();
    let sum: f64 = seen.iter().map(|&r| energy(r) * own[r].norm()).sum();
    let amplitude = sum / seen.iter().map(|&r| energy(r)).sum::<f64>().max(1e-300);
    for r in runs {
        let value = own[r] * (amplitude / own[r].norm().max(1e-300));
        (x[first + 2 * r], x[first + 2 * r + 1]) = (value.re, value.im);
    }
}

impl Scores {
    fn of(self, candidate: Candidate) -> Judged {
        let Self { score, gain, select_gain, select_promise, apart_gain, x, start_nats, unknowns } = self;
        Judged { candidate, score, gain, select_gain, select_promise, apart_gain, x, start_nats, unknowns }
    }
}
