//! Where an effect of a family may stand in a record, for limits and for injections: drawn from where the search
//! looks for it.
//!
//! A shaft's own orders have one place, and only phases differ. A ghost may be any whole order that the search lists;
//! a passage any base of an ordinary bearing. Left out are places that a family found before has taken or explained:
//! there the search asks nothing further. What else may keep an effect from being found (surrogates without a
//! place, stronger rivals, lines on the pair's own orders) is no reason to leave a place out: it belongs to the
//! limit.

use super::candidate::{Candidate, Kind};
use super::families::{Context, ghost, passage};
use super::search::Search;
use crate::analysis::lines::LOBE_BINS;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Bases of ordinary bearings, per turn of their shaft.
const BASES: (f64, f64) = (2.5, 8.0);
/// Tries for a base that nothing explains.
const TRIES: usize = 200;
/// Share of a family's lines that must be on nothing taken.
const MIN_FREE_LINE_SHARE: f64 = 0.7;

/// The family at a place of its own; none where everything is taken.
pub fn drawn(context: &Context, found: &Search, typical: &Candidate, random: &mut ChaCha8Rng) -> Option<Candidate> {
    let mut base = || BASES.0 + (BASES.1 - BASES.0) * random.random::<f64>();
    match typical.kind {
        Kind::Ghost => {
            let ghosts: Vec<Candidate> =
                ghost::candidates(context).into_iter().filter(|c| is_free(context, found, c)).collect();
            let chosen = (random.random::<f64>() * ghosts.len() as f64) as usize;
            ghosts.into_iter().nth(chosen)
        }
        Kind::Passage => {
            first_free(context, found, typical, || passage::harmonics(context, base(), passage::LONE_HARMONICS[0]))
        }
        Kind::ModulatedPassage(shaft) => {
            let own = context.scene.shaft_order(shaft as usize);
            first_free(context, found, typical, || passage::modulated(context, own * base(), shaft))
        }
        _ => Some(typical.clone()).filter(|c| !found.knows(c, context.scene)),
    }
}

fn first_free(
    context: &Context,
    found: &Search,
    typical: &Candidate,
    mut make: impl FnMut() -> Candidate,
) -> Option<Candidate> {
    let own = (0..TRIES).map(|_| make()).find(|c| is_free(context, found, c));
    own.map(|c| Candidate { alternatives: typical.alternatives, ..c })
}

fn is_free(context: &Context, found: &Search, candidate: &Candidate) -> bool {
    let lobe = LOBE_BINS * context.orders.bin(0);
    let free = candidate.places.iter().filter(|place| !context.taken[0].near(place.order, lobe)).count();
    !found.knows(candidate, context.scene) && free as f64 >= MIN_FREE_LINE_SHARE * candidate.places.len().max(1) as f64
}
