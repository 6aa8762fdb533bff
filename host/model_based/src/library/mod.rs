//! The library: every effect as physically predicted templates, to be matched with the residual.
//!
//! Effects are excitations of the declared machine (displacement error, force, stiffness change) whose response comes
//! from the harmonic balance, or changes of the measuring path applied to the prediction. Which there are, where, and
//! under which names stands with the simulator's effects ([`crate::effects::hypothesis`]); here is the response that
//! effects with the same seat share.

pub mod drift;
pub mod finite;
pub mod mesh;
pub mod order;
mod parameter;
pub mod path;
mod responses;
mod teeth;

use super::base_fit::Base;
use super::candidate::Candidate;
use super::detect::Found;
use super::judge::Split;
use super::least_squares::Data;
use super::waveform::steady;
use crate::effects::hypotheses;
use crate::effects::hypothesis::{Hypothesis, Path, Seat};
use crate::observation::spectrum::Bins;
use rayon::prelude::*;
use std::sync::OnceLock;

pub use responses::{Excitation, Responses};
pub use teeth::ToothFamilies;

/// Everything needed to build candidates.
pub struct Bench<'a> {
    /// The machine on every run.
    responses: Responses<'a>,
    /// Responses to single teeth.
    pub teeth: ToothFamilies,
    /// Predicted time signals per run and channel, with everything found so far.
    pub waveforms: Vec<[Vec<f64>; 2]>,
    /// Their bins.
    pub prediction: Vec<[Bins; 2]>,
    /// Candidates that do not depend on the residual.
    fixed: Vec<Candidate>,
    /// Declared machine integrated in time, made when first needed.
    plain: OnceLock<Vec<[Bins; 2]>>,
}

impl<'a> std::ops::Deref for Bench<'a> {
    type Target = Responses<'a>;

    fn deref(&self) -> &Responses<'a> {
        &self.responses
    }
}

impl<'a> Bench<'a> {
    /// Prepares the parts that do not depend on the residual.
    pub fn new(base: &'a Base) -> Self {
        let responses = Responses::new(base);
        let teeth = ToothFamilies::new(base, &responses.angles);
        let waveforms = match base.signals.is_empty() {
            true => base.runs.par_iter().map(|run| steady(&base.analyser, run)).collect(),
            false => base.signals.clone(),
        };
        let prediction = match base.signals.is_empty() {
            true => base.runs.iter().map(|run| run.model.clone()).collect(),
            false => waveforms.par_iter().map(|w| w.each_ref().map(|w| base.analyser.bins_of(w))).collect(),
        };
        let mut bench = Self { responses, teeth, waveforms, prediction, fixed: Vec::new(), plain: OnceLock::new() };
        let mut fixed = mesh::candidates(&bench);
        fixed.push(drift::candidate(&bench));
        fixed.extend(parameter::candidates(&bench));
        for order in bench.shaft_orders() {
            fixed.extend(order::at_order(&bench, order, 1.0));
        }
        bench.fixed = fixed;
        bench
    }

    /// Candidates that do not depend on the residual.
    pub fn fixed(&self) -> &[Candidate] {
        &self.fixed
    }

    /// Orders that are always tried: one and two per turn of either shaft.
    pub fn shaft_orders(&self) -> [f64; 4] {
        [1.0, self.ratio(), 2.0, 2.0 * self.ratio()]
    }

    /// Hands out all candidates for the present residual, part by part because of their size: fixed library, detected
    /// orders, detected frequencies.
    ///
    /// `turns`: starts of the runs in the hunting period, where an effect of the gear has told them.
    pub fn candidates(
        &self,
        data: &Data,
        split: &Split,
        orders: &[Found],
        frequencies: &[Found],
        turns: Option<&[u32]>,
        mut take: impl FnMut(Vec<Candidate>),
    ) {
        let fit = split.fit.as_slice();
        take(self.teeth.candidates(self, data, split, turns));
        take(self.fixed.clone());
        take(path::candidates(self, data, fit));
        let mut done = self.shaft_orders().to_vec();
        for found in orders {
            // A line may be a sideband of the excitation: try the comb's lowest members as its seat.
            let z = f64::from(self.base.machine.teeth[0]);
            let at = if found.modulation { found.at } else { self.peak(data, fit, found.at) };
            let nearest = (at / z).round() as i32;
            let members = [nearest, 0, 1, -1, 2, -2, nearest - 1, nearest + 1];
            // A comb's place is its distance from the mesh orders.
            let members = if found.modulation { &[0, 1, -1] } else { &members[..] };
            for &n in members {
                let raw = (at - f64::from(n) * z).abs();
                let whole = self.refined(raw);
                // Near a whole order of a shaft it may be that or its own: the latter is placed more finely later.
                let own = ((raw - whole).abs() > 0.1 * self.snapped()).then_some(raw);
                for seat in [Some(whole), own].into_iter().flatten() {
                    let near = if own.is_some() { 0.05 * self.snapped() } else { 0.01 };
                    if seat > 0.05 && seat < 6.0 * z && done.iter().all(|d| (d - seat).abs() > near) {
                        done.push(seat);
                        take(chosen_from(order::at_order(self, seat, 200.0), found));
                    }
                }
            }
        }
        for found in frequencies {
            take(chosen_from(order::at_frequency(self, data, fit, *found), found));
        }
    }

    /// Order of the largest summed line power near a detected one.
    fn peak(&self, data: &Data, fit: &[usize], order: f64) -> f64 {
        let duration = self.base.analyser.duration_s();
        let fastest = self.angles.iter().map(|a| a.1).fold(0.0, f64::max);
        let power = |o: f64| -> f64 {
            fit.iter()
                .flat_map(|&r| [0, 1].map(|c| (r, c)))
                .map(|(r, c)| {
                    let hz = o * self.angles[r].1;
                    // Unweighted: weights are tempered in proportion to the residual and would push the peak aside.
                    self.base.analyser.amplitude(&data.residual[r][c], hz).0.norm_sqr()
                })
                .sum()
        };
        let step = 0.02 / (duration * fastest);
        (-120..=120)
            .map(|i| order + f64::from(i) * step)
            .max_by(|a, b| power(*a).total_cmp(&power(*b)))
            .unwrap_or(order)
    }

    /// Distance within which an order may be a whole one: a quarter of a bin in the fastest run.
    fn snapped(&self) -> f64 {
        0.25 / (self.base.analyser.duration_s() * self.angles.iter().map(|a| a.1).fold(0.0, f64::max))
    }

    /// Snaps an order to a whole order of pinion or gear when it is one within resolution.
    fn refined(&self, order: f64) -> f64 {
        let (ratio, near) = (self.ratio(), self.snapped());
        let pinion = order.round();
        let gear = (order / ratio).round() * ratio;
        if (order - pinion).abs() < near {
            pinion
        } else if (order - gear).abs() < near {
            gear
        } else {
            order
        }
    }
}

/// The effect of the registry that changes a path in this way.
fn on_path(path: Path) -> &'static Hypothesis {
    let own = |h: &&Hypothesis| h.seats.iter().any(|seat| matches!(seat, Seat::Path(p) if *p == path));
    hypotheses().find(own).expect("every change of a path is some effect's")
}

/// Candidates at a place that was chosen from all those scanned.
fn chosen_from(mut candidates: Vec<Candidate>, found: &Found) -> Vec<Candidate> {
    candidates.iter_mut().for_each(|c| c.scanned = found.places);
    candidates
}
