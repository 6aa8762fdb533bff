//! Shapes found by search: how far they leave a strength open.
//!
//! The share of the path that a relief covers, and whether it is linear or parabolic, come from the same record as
//! its depth. About the shape found the share is one more unknown of the fit ([`slopes`]). Other shapes may explain
//! the record nearly as well, with another depth ([`others`]): high mesh orders swing with the share, so the
//! likelihood has several peaks. The interval of the depth covers all of them that could not be told from the one
//! taken. Cost: a scan of some two hundred shapes per relief found.

use super::accept;
use super::base_fit::Base;
use super::candidate::{Candidate, Template, Tuning};
use super::judge::{Judge, Split};
use super::least_squares::Data;
use super::library::{Responses, mesh};

/// Change of a relief's share of the path for a derivative.
const STEP: f64 = 0.002;
/// Distance of two shares of the path within which they are one peak's.
const SAME_PEAK_DISTANCE: f64 = 0.003;

/// What the share of the path does to the responses of the reliefs among `terms` at their `unknowns`.
pub fn slopes(base: &Base, terms: &[&Candidate], unknowns: &[f64]) -> Vec<Template> {
    let machine = Responses::new(base);
    let mut at = 0;
    let mut slopes = Vec::new();
    for term in terms {
        if let Some(Tuning::Relief { share, exponent }) = term.tuning {
            let factor = unknowns[at] / (2.0 * STEP);
            let [more, less] = [share + STEP, share - STEP].map(|s| mesh::relief(&machine, s, exponent));
            slopes.push(more.templates[0].mixed(factor, &less.templates[0], -factor));
        }
        at += term.templates.len();
    }
    slopes
}

/// Least and largest strength of the shapes that cannot be told from that of `term`, next to the `company` of other
/// terms; `None` where there is no other.
pub fn others(base: &Base, data: &Data, split: &Split, company: &[&Candidate], term: &Candidate) -> Option<[f64; 2]> {
    let Some(Tuning::Relief { share, exponent }) = term.tuning else { return None };
    let machine = Responses::new(base);
    let judge = Judge::new(base, data, split, company);
    let own = judge.judge(term.clone()).gain;
    let gain = |c: Candidate| {
        let judged = judge.judge(c);
        if judged.candidate.is_possible(&judged.x) { judged.gain } else { f64::NEG_INFINITY }
    };
    let like = [1, 2].into_iter().flat_map(|of| {
        let mut peaks = mesh::relief_peaks(&machine, of, gain);
        peaks.retain(|(gain, at)| {
            accept::is_rival(0.5 * (own - gain)) && !(of == exponent && (at - share).abs() < SAME_PEAK_DISTANCE)
        });
        let strength = |(_, at): (f64, f64)| judge.judge(mesh::relief(&machine, at, of)).x[0];
        peaks.into_iter().map(strength).collect::<Vec<_>>()
    });
    like.fold(None, |range: Option<[f64; 2]>, x| Some(range.map_or([x; 2], |[low, high]| [low.min(x), high.max(x)])))
}
