//! What is asked for once more when a search has ended: families that a surrogate came close to, and all of them
//! without what the held-out turns veto.
//!
//! *On*: what stands out of every surrogate, though not thrice, or is one line alone, passes where the held-out
//! turns alone let it; last, so that no line is taken from what is surer.
//! *Again*: a family that the held-out turns veto has spoken for its lines, and what stands close beside it, or was
//! taken for it (a tone for an order, a tooth's pattern for sidebands), was never asked for. The search is made again
//! from the families that hold, and what was vetoed is not asked for. The gate and the veto are the same. Cost: a
//! search more where something is vetoed; limit: what a vetoed base would explain, its multiples and sidebands, is
//! not asked for either.

use super::candidate::Domain;
use super::excluded_lines::mesh_taken;
use super::residual_spectra::Views;
use super::scene::Scene;
use super::search::{Adopted, Search};

/// Searches again once the held-out turns have vetoed families; `kept` and `rest`, parts of the shafts that were let
/// pass, stay as they are. Whether a family is found.
pub fn search_after_veto(
    search: &mut Search,
    [kept, vetoed]: [Vec<Adopted>; 2],
    rest: &[&Adopted],
    scene: &Scene,
    [fit, held]: [&Views; 2],
) -> bool {
    search.vetoed.extend(vetoed);
    (search.taken, search.had_close) = (mesh_taken(scene, fit), false);
    search.adopted.clear();
    let count = kept.len();
    kept.into_iter().for_each(|own| search.take(scene, fit, own));
    search.taken[0].extend(orders_of(rest.iter().copied()));
    search.rounds(scene, fit, None);
    search_marginal(search, rest, scene, [fit, held]);
    search.adopted.len() > count
}

/// Searches on with the families that stand out of every surrogate though the highest comes too near
/// ([`super::accept::Verdict::is_close`]) and that the held-out turns alone let pass the gate; last, so that no line
/// is taken from what is surer. `rest`: parts of the shafts that were let pass.
pub fn search_marginal(search: &mut Search, rest: &[&Adopted], scene: &Scene, [fit, held]: [&Views; 2]) {
    let parts = orders_of(search.adopted.iter().chain(rest.iter().copied()));
    let (before, sure) = (search.taken.clone(), search.adopted.len());
    if parts.is_empty() && !search.had_close {
        // The last round would come out as it did.
        return;
    }
    search.taken[0].extend(parts);
    let mesh = mesh_taken(scene, held);
    search.rounds(scene, fit, Some((held, &mesh)));
    if search.adopted.len() == sure {
        search.taken = before;
    }
}

/// Orders of the signal at which lines of families stand.
fn orders_of<'a>(families: impl Iterator<Item = &'a Adopted>) -> Vec<f64> {
    let of_the_signal = families.filter(|own| own.candidate.domain == Domain::Orders);
    of_the_signal.flat_map(Adopted::standing).map(|place| place.order).collect()
}
