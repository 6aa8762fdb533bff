//! Strong terms fitted together: two effects whose product matters are neither alone on the declared machine.
//!
//! An eccentric pinion and an eccentric gear, or either and a crack, modulate what the other does; a force or a
//! displaced tooth, in proportion to its strength on the machine as declared, meets another stiffness on one with a
//! crack. Gauss-Newton on the simulated machine with all of them: derivatives by small changes of every strength
//! become the templates, and what the machine does beyond these straight lines goes off the residual. Cost: a
//! simulation of every run per unknown, and one, per step. Limit: the declared parameters stay linear.

use super::base_fit::Base;
use super::candidate::{Candidate, Claim, Template};
use super::judge::joint;
use super::least_squares::Data;
use super::library::Bench;
use super::library::finite::{LEAST_INFORMATION, Played};
use super::strength::size;
use crate::effects::hypothesis::Seat;
use crate::observation::spectrum::{Bins, Sparse};
use rustfft::num_complex::Complex64 as C;

/// Most steps.
const MOST_STEPS: usize = 4;
/// Change of a strength, as a share of it, for a derivative.
const CHANGE: f64 = 0.03;
/// Change by a step below which all strengths are taken as found.
const SETTLED: f64 = 0.003;

/// The unknowns of every term within all unknowns of a fit, `x`.
pub fn unknowns(base: &Base, terms: &[Candidate], x: &[f64]) -> Vec<Vec<f64>> {
    let mut at = base.nuisances.len();
    terms
        .iter()
        .map(|t| {
            let own = at..at + t.templates.len();
            at = own.end;
            x[own].to_vec()
        })
        .collect()
}

/// The unknowns of every term, fitted over the runs `seen`.
pub fn fitted(base: &Base, data: &Data, seen: &[usize], terms: &[Candidate]) -> Vec<Vec<f64>> {
    let all: Vec<&Candidate> = terms.iter().collect();
    unknowns(base, terms, &joint(base, data, seen, &all).x)
}

/// Whether a term is simulated beside others: one at a strength of its own, or a single cause that goes with its
/// strength.
fn is_played(bench: &Bench<'_>, term: &Candidate, x: &[f64]) -> bool {
    let single = matches!(term.seat, Some(Seat::Wave(_) | Seat::OneTooth(..))) && term.claim == Claim::Named;
    !term.phase_free && (term.bent || single && bench.has_counterpart(term, x))
}

/// Fits those of `accepted` that the simulator can play together over the runs `seen`, from the residual `raw` of the
/// declared machine; false where there are fewer than two, all go with their strength, or they need different starts
/// of the runs.
pub fn together(
    bench: &Bench<'_>,
    data: &mut Data,
    raw: &[[Bins; 2]],
    seen: &[usize],
    accepted: &mut [Candidate],
) -> bool {
    let mut x = fitted(bench.base, data, seen, accepted);
    let list: Vec<usize> = (0..accepted.len()).filter(|&i| is_played(bench, &accepted[i], &x[i])).collect();
    if list.len() < 2 || list.iter().all(|&i| !accepted[i].bent) {
        return false;
    }
    for _ in 0..MOST_STEPS {
        let Some((templates, rest)) = straight_lines(bench, data, accepted, &list, &x) else { return false };
        for (&i, templates) in list.iter().zip(templates) {
            (accepted[i].templates, accepted[i].bent) = (templates, true);
        }
        for (r, run) in rest.iter().enumerate() {
            for c in 0..2 {
                data.residual[r][c] = raw[r][c].iter().zip(&run[c]).map(|(a, b)| a - b).collect();
            }
        }
        let next = fitted(bench.base, data, seen, accepted);
        let moved = |&i: &usize| {
            let change: Vec<f64> = next[i].iter().zip(&x[i]).map(|(a, b)| a - b).collect();
            size(&change) / size(&next[i])
        };
        let largest = list.iter().map(moved).fold(0.0, f64::max);
        x = next;
        if largest < SETTLED {
            break;
        }
    }
    true
}

/// Derivatives by every unknown of the listed terms at `x`, as templates, and what the machine does beyond them there.
fn straight_lines(
    bench: &Bench<'_>,
    data: &Data,
    accepted: &[Candidate],
    list: &[usize],
    x: &[Vec<f64>],
) -> Option<(Vec<Vec<Template>>, Vec<[Bins; 2]>)> {
    let at = |x: &[Vec<f64>]| {
        let terms: Vec<Played<'_>> = list.iter().map(|&i| (&accepted[i], x[i].as_slice())).collect();
        bench.simulated(&terms)
    };
    let here = at(x)?;
    let plain = bench.plain();
    let mut rest: Vec<[Bins; 2]> = here
        .iter()
        .zip(plain)
        .map(|(a, b)| [0, 1].map(|c| a[c].iter().zip(&b[c]).map(|(a, b)| a - b).collect()))
        .collect();
    let mut all = Vec::new();
    for &i in list {
        let step = CHANGE * size(&x[i]);
        let mut own = Vec::new();
        for u in 0..x[i].len() {
            let mut changed = x.to_vec();
            changed[i][u] += step;
            let there = at(&changed)?;
            let runs = (0..here.len()).map(|r| {
                [0, 1].map(|c| {
                    let weight = &data.weight[r][c];
                    let slope: Bins = there[r][c]
                        .iter()
                        .zip(&here[r][c])
                        .zip(weight)
                        .map(|((a, b), w)| {
                            let slope = (a - b) / step;
                            let informs = slope.norm_sqr() * size(&x[i]).powi(2) * w > LEAST_INFORMATION;
                            if informs { slope } else { C::ZERO }
                        })
                        .collect();
                    rest[r][c].iter_mut().zip(&slope).for_each(|(rest, s)| *rest -= s * x[i][u]);
                    Sparse::of(&slope)
                })
            });
            own.push(Template::new(runs));
        }
        all.push(own);
    }
    Some((all, rest))
}
