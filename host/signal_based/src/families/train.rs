//! Faults of a train: the families that follow from its declaration ([`crate::train::families`]), and who else has
//! the same lines.
//!
//! Unknowns: one complex amplitude per line. What decides between gears: which mesh the sidebands stand about, at
//! which rate. A family is found by lines that no other part is likelier to own, and compared by all that the fault
//! may have: where another seat's family holds nearly all of its evidence and scores as well, both are named.

use super::Context;
use crate::candidate::{Candidate, Domain, Field, Kind, Place, Taken, score};
use crate::gearing::Gearing;
use crate::train::families::{FaultLine, Seat, What};

/// Share of the evidence that another seat's lines must hold to be named as well.
const MIN_EVIDENCE_SHARE: f64 = 0.8;
/// Nats by which it may score less: the right gear of a shaft did by up to 20 on generated records (`prove --train`,
/// seeds 77 and 20261201), for an unknown path decides which of a pulse's lines are strong.
const MAX_DEFICIT_NATS: f64 = 25.0;
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
    of_lines(context, gearing, own, &gearing.family(own).lines)
}

/// One of them with the lines that another part is the likelier owner of.
fn complete(context: &Context, gearing: &Gearing, own: u16) -> Candidate {
    let family = gearing.family(own);
    of_lines(context, gearing, own, &[family.lines.as_slice(), &family.shared].concat())
}

fn of_lines(context: &Context, gearing: &Gearing, own: u16, lines: &[FaultLine]) -> Candidate {
    let family = gearing.family(own);
    let range = context.orders.lowest..context.orders.highest;
    let lines = lines.iter().filter(|line| range.contains(&line.order));
    let place = |line: &FaultLine| Place { order: line.order, spacing: line.spacing, label: line.label.clone() };
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

/// Families of other seats that explain the same lines within the evidence, the best of each seat. Seats are compared
/// by everything that a fault there shows, whoever is the likelier owner of a line.
pub fn rivals(found: &Candidate, of_places: &[f64], context: &Context, field: &Field) -> Vec<u16> {
    let (Kind::Train(own), Some(gearing)) = (found.kind, &context.scene.gearing) else { return Vec::new() };
    let near = ONE_LINE * context.orders.bin(0);
    let compared = |other: u16| {
        let whole = complete(context, gearing, other);
        let explains = shared_evidence(found, of_places, &whole, near) >= MIN_EVIDENCE_SHARE;
        explains.then(|| Compared { nats: score(&whole, field, 0.0).ln_bayes, seat: gearing.family(other).seat, other })
    };
    let all: Vec<Compared> = (0..gearing.families().len() as u16).filter_map(compared).collect();
    as_likely(all, gearing.family(own).seat).into_iter().map(|found| found.other).collect()
}

/// A family beside the one found: logarithm of its Bayes factor, all lines counted.
struct Compared {
    nats: f64,
    seat: Seat,
    other: u16,
}

/// The best family of every other seat that comes near the best one of this seat, best first.
fn as_likely(mut all: Vec<Compared>, seat: Seat) -> Vec<Compared> {
    all.sort_by(|a, b| b.nats.total_cmp(&a.nats));
    let highest = all.iter().find(|found| found.seat == seat).map_or(f64::INFINITY, |found| found.nats);
    let mut seats = vec![seat];
    all.retain(|found| {
        let is_new = !seats.contains(&found.seat);
        seats.push(found.seat);
        is_new && found.nats > highest - MAX_DEFICIT_NATS
    });
    all
}

/// Share of a family's evidence that is at lines of another one.
fn shared_evidence(found: &Candidate, of_places: &[f64], other: &Candidate, near: f64) -> f64 {
    let mut orders = Taken::default();
    orders.extend(other.places.iter().map(|place| place.order));
    let lines = || found.places.iter().zip(of_places).filter(|(_, ln)| **ln > 0.0);
    let all: f64 = lines().map(|(_, ln)| ln).sum();
    lines().filter(|(place, _)| orders.near(place.order, near)).map(|(_, ln)| ln).sum::<f64>() / all
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
