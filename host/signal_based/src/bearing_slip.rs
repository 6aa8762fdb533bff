//! Where a base of neither shaft stands on the turns not used: bearings slip.
//!
//! Load and lubrication let rolling elements slide: their orders move by a hundredth from one stretch of a record to
//! the next, several bins of a harmonic. Held to its fitted place such a family is refused by turns on which it
//! stands as high as ever. So at a steady speed its base is read there anew, within what bearings slip, on the
//! channels searched: one number, taken only where it says more than its choice costs, and charged again by the veto
//! ([`super::predicted_power`]). Channels held out take no part, so what the lines hold there stays a prediction; moved
//! copies may slip by the same rule. Limits: of sidebands about the family's lines nothing is known, they stay; where
//! others' lines are dense nothing is left to read; in a run-up, where stretches are short and lines broad, nothing
//! is asked.

use super::candidate::{Domain, Taken};
use super::excluded_lines::mesh_taken;
use super::residual_spectra::Views;
use super::scene::{Scene, SceneRun};
use super::search::{Adopted, Slip};
use crate::analysis::lines::LOBE_BINS;

/// Most that a base is believed to slip between two stretches of a record, share of it: rolling bearings slip by one
/// to two hundredths (Randall and Antoni 2011, a tutorial).
const MAX_SLIP_SHARE: f64 = 0.015;
/// Logarithm of the likelihood ratio that a slip has to gain beyond that of the number of choices.
const MIN_LN_RATIO: f64 = 5.0;

/// Whether the base of a family is read anew.
pub fn may_slip(own: &Adopted, scene: &Scene) -> bool {
    let in_the_signal = own.candidate.is_base() && own.candidate.domain == Domain::Orders;
    in_the_signal && !scene.runs.iter().any(SceneRun::runs_up)
}

/// Reads the slips of all families that may; `rest` are families beside them.
pub fn read(found: &mut [Adopted], rest: &[&Adopted], scene: &Scene, views: [&Views; 2]) {
    for i in 0..found.len() {
        if !may_slip(&found[i], scene) {
            continue;
        }
        let others = found.iter().enumerate().filter(|(other, _)| *other != i).map(|(_, other)| other);
        let others: Vec<&Adopted> = others.chain(rest.iter().copied()).collect();
        let lines: Vec<[f64; 2]> =
            found[i].standing().map(|place| [place.order, found[i].candidate.lever(place)]).collect();
        found[i].slip = slip(&lines, &found[i], &excluded(&others, scene, views[1]), scene, views[1]);
    }
}

/// Orders of the mesh and of families' lines on the turns not used.
pub fn excluded(families: &[&Adopted], scene: &Scene, held: &Views) -> Taken {
    let mut taken = mesh_taken(scene, held)[Domain::Orders as usize].clone();
    let in_the_signal = families.iter().filter(|own| own.candidate.domain == Domain::Orders);
    taken.extend(in_the_signal.flat_map(|own| own.standing().map(|place| place.order + own.off(place))));
    taken
}

/// The slip that the readings of lines (order and [`super::candidate::Candidate::lever`]) of a family, or of a moved
/// copy of it, ask for.
pub fn slip(lines: &[[f64; 2]], own: &Adopted, excluded: &Taken, scene: &Scene, held: &Views) -> Slip {
    let spectra = held.of(own.candidate.domain);
    let level = own.verdict.score.level.min(spectra.depth().saturating_sub(1));
    let widest = lines.iter().map(|[_, lever]| lever.abs()).fold(0.0, f64::max);
    if widest == 0.0 {
        return Slip::default();
    }
    let bin = spectra.bin(level);
    let strength = |share: f64| -> f64 {
        let at = lines.iter().filter(|[_, lever]| *lever != 0.0).map(|[order, lever]| order + share * lever);
        let free = at.filter(|order| !excluded.near(*order, LOBE_BINS * bin));
        let of = |order: f64| -> f64 {
            let places = (0..scene.runs.len()).flat_map(|r| (0..scene.searched).map(move |c| (r, c)));
            places.filter_map(|(r, c)| spectra.reading(r, c, level, order, 0)).map(|reading| reading.ln_bayes()).sum()
        };
        free.map(of).sum()
    };
    // Half a bin of the line that moves most.
    let step = 0.5 * bin / widest;
    let steps = (MAX_SLIP_SHARE / step).floor() as i64;
    let cost = ((2 * steps + 1) as f64).ln();
    let shares = (-steps..=steps).map(|i| i as f64 * step).map(|share| (share, strength(share)));
    let (share, highest) = shares.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or_default();
    if highest > strength(0.0).max(0.0) + cost + MIN_LN_RATIO { Slip { share, step, cost } } else { Slip::default() }
}
