//! Faults of a train: the families that follow from its declaration ([`crate::train::families`]), and who else has
//! the same lines.
//!
//! Unknowns: one complex amplitude per line. What decides between gears: which mesh the sidebands stand about, at
//! which rate. Where another seat's family holds nearly all of the evidence and scores as well, both are named.

use super::Context;
use crate::accept::Verdict;
use crate::candidate::{Candidate, Domain, Kind, Place, Taken, TakenOf, score};
use crate::gearing::Gearing;
use crate::residual_spectra::Views;
use crate::train::families::What;

/// Share of the evidence that another seat's lines must hold, and nats by which it may score less, to be named as well.
const MIN_EVIDENCE_SHARE: f64 = 0.8;
const MAX_DEFICIT_NATS: f64 = 10.0;
/// Bins within which two lines are one here: half a main lobe.
const ONE_LINE: f64 = 2.0;

/// Every family of the train.
pub fn candidates(context: &Context) -> Vec<Candidate> {
    let Some(gearing) = &context.scene.gearing else { return Vec::new() };
    (0..gearing.families().len())
        .map(|own| candidate(context, gearing, own as u16))
        .filter(|c| !c.places.is_empty())
        .collect()
}

/// One of them.
pub fn candidate(context: &Context, gearing: &Gearing, own: u16) -> Candidate {
    let family = gearing.family(own);
    let range = context.orders.lowest..context.orders.highest;
    let lines = family.lines.iter().filter(|line| range.contains(&line.order));
    let place = |line: &crate::train::families::FaultLine| Place {
        order: line.order,
        spacing: line.spacing,
        label: line.label.clone(),
    };
    Candidate {
        kind: Kind::Train(own),
        base: family.base,
        domain: Domain::Orders,
        places: lines.map(place).collect(),
        locked: true,
        alternatives: gearing.families().len() as f64,
    }
}

/// One family of every fault at every seat, with its words, for limits.
pub fn typical(context: &Context) -> Vec<(String, Candidate)> {
    let Some(gearing) = &context.scene.gearing else { return Vec::new() };
    let mut seen = Vec::new();
    let mut all = Vec::new();
    for own in 0..gearing.families().len() as u16 {
        let family = gearing.family(own);
        if !seen.contains(&(family.what, family.seat)) {
            seen.push((family.what, family.seat));
            all.push((gearing.words(own), candidate(context, gearing, own)));
        }
    }
    all
}

/// Families of other seats that say the same of the record, the best of each seat.
pub fn rivals(candidate: &Candidate, verdict: &Verdict, context: &Context, views: &Views, taken: &TakenOf) -> Vec<u16> {
    let (Kind::Train(own), Some(gearing)) = (candidate.kind, &context.scene.gearing) else { return Vec::new() };
    let seat = gearing.family(own).seat;
    let lines = candidate.places.iter().zip(&verdict.score.of_places);
    let standing: Vec<(f64, f64)> = lines.filter(|(_, ln)| **ln > 0.0).map(|(p, ln)| (p.order, *ln)).collect();
    let all: f64 = standing.iter().map(|(_, ln)| ln).sum();
    let field = views.field(taken, Domain::Orders, 0..context.scene.searched);
    let near = ONE_LINE * context.orders.bin(0);
    let mut found: Vec<(f64, u16)> = Vec::new();
    for other in (0..gearing.families().len() as u16).filter(|other| gearing.family(*other).seat != seat) {
        let rival = self::candidate(context, gearing, other);
        let mut orders = Taken::default();
        orders.extend(rival.places.iter().map(|place| place.order));
        let shared: f64 = standing.iter().filter(|(order, _)| orders.near(*order, near)).map(|(_, ln)| ln).sum();
        if shared < MIN_EVIDENCE_SHARE * all {
            continue;
        }
        let nats = score(&rival, &field, 0.0).ln_bayes - rival.alternatives.ln();
        if nats > verdict.ln_bayes - MAX_DEFICIT_NATS {
            found.push((nats, other));
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut seats = Vec::new();
    found.retain(|(_, other)| {
        let seat = gearing.family(*other).seat;
        let is_new = !seats.contains(&seat);
        seats.push(seat);
        is_new
    });
    found.into_iter().map(|(_, other)| other).collect()
}

/// Modulations of the same gear, of which a tooth's pattern may be one; none for any other family.
pub fn modulations(context: &Context, found: &Candidate) -> Vec<Candidate> {
    let (Kind::Train(own), Some(gearing)) = (found.kind, &context.scene.gearing) else { return Vec::new() };
    let family = gearing.family(own);
    if family.what != What::Local {
        return Vec::new();
    }
    let is_modulation = |other: &u16| {
        let other = gearing.family(*other);
        other.seat == family.seat && other.what == What::Modulation
    };
    let all = 0..gearing.families().len() as u16;
    all.filter(is_modulation).map(|other| candidate(context, gearing, other)).collect()
}
