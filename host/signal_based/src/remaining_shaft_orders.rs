//! What else stands at the orders of a shaft of which a family was found: its further lines, without a name of their
//! own.
//!
//! A family of a shaft is adopted in the shape that stood out when it was looked for, and the lines near the mesh are
//! its own whether they were listed or not, so that no second family is made of them. At the end of the search, with
//! the lines of all families spoken for, everything else at that shaft's whole orders is asked for at once, by the
//! same gate, and held to the held-out turns. It adds lines to the model and no effect: that the shaft has a family
//! was decided before. Limit: a gear's order on a whole order of the pinion is left to the pinion, as everywhere.
//! Cost: one judgement per shaft.

use super::accept::Verdict;
use super::candidate::{Candidate, Domain, Kind, Shaft, Taken};
use super::families::tooth;
use super::holdout_test::HoldoutResult;
use super::residual_spectra::Views;
use super::scene::Scene;
use super::search::{Adopted, Search, Slip, context};

/// Whole orders of a shaft that no family has read; none where the shaft has no family.
pub fn candidate(search: &Search, scene: &Scene, views: &Views, shaft: Shaft) -> Option<Candidate> {
    let of_shaft = search.adopted.iter().any(|own| is_of(own, shaft));
    let mut rest = of_shaft.then(|| tooth::candidate(&context(scene, views, &search.taken, &search.feet), shaft))?;
    let read = read(search.adopted.iter().filter(|own| own.candidate.domain == Domain::Orders));
    rest.places.retain(|place| !read.near(place.order, 0.5 * views.orders.bin(0)));
    Some(rest)
}

/// Whether a family is of a shaft and locked to it.
fn is_of(own: &Adopted, shaft: Shaft) -> bool {
    match own.candidate.kind {
        Kind::Modulation(other) | Kind::ShaftOrders(other) | Kind::SingleTooth(other) | Kind::Pattern(other) => {
            other == shaft
        }
        _ => false,
    }
}

/// Whether a family is one of these.
pub fn is_among(rest: &[Adopted], own: &Adopted) -> bool {
    rest.iter().any(|other| std::ptr::eq(other, own))
}

/// The families that have a name, without further lines.
pub fn families<'a>(kept: &[(&'a Adopted, HoldoutResult)], rest: &[Adopted]) -> Vec<(&'a Adopted, HoldoutResult)> {
    kept.iter().copied().filter(|(own, _)| !is_among(rest, own)).collect()
}

/// Whether a family has a name, or is further lines of a shaft that has kept one.
pub fn is_wanted(own: &Adopted, rest: &[Adopted], families: &[(&Adopted, HoldoutResult)]) -> bool {
    let of_kept = |shaft: &Shaft| is_of(own, *shaft) && families.iter().any(|(family, _)| is_of(family, *shaft));
    !is_among(rest, own) || Shaft::PAIR_SHAFTS.iter().any(of_kept)
}

/// Orders that a family has read: there it has decided.
fn read<'a>(adopted: impl Iterator<Item = &'a Adopted>) -> Taken {
    let mut taken = Taken::default();
    for own in adopted {
        let places = own.candidate.places.iter().zip(&own.verdict.score.of_places);
        taken.extend(places.filter(|(_, ln)| **ln != 0.0).map(|(place, _)| place.order));
    }
    taken
}

/// They as a family without a name.
pub fn part(candidate: Candidate, verdict: Verdict) -> Adopted {
    Adopted {
        candidate,
        verdict,
        pulse: None,
        carries: Vec::new(),
        either_hz: None,
        slip: Slip::default(),
        or_else: Vec::new(),
    }
}
