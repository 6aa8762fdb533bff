//! An order slower than the slower shaft on all turns in one stretch, fitted, held out and between: nearly three
//! times as sharp as on the fitted ones.
//!
//! There a line stands higher, and what a wandering speed leaves beside the mesh lines does not. A quarter of the
//! turns alone would not tell either from its mesh line. The fitted turns place it within some bins only, so it is
//! looked for about there; where it stands is its rate. Asked before it is adopted: one that is none would take the
//! lines of others with it. Limit: turns held out take part; that is the veto's price for what they cannot show
//! alone. (Searched on all turns alone, without having to stand on the fitted ones, a wander's own chance peaks
//! passed on nine of 67 nulls, some at 400 nats.)

use super::accept::{self, Verdict};
use super::candidate::{Candidate, Field, Place, Taken, score};
use super::scene::Scene;
use super::spectra::Spectra;

/// Share of a bin in which its rate is looked for, and steps each way: what the fitted turns leave open. (As far as a
/// main lobe of theirs, residue of the mesh line passes for a swing.)
const STEP: f64 = 0.5;
const STEPS: i32 = 6;

/// A slow family that the gate lets pass on the fitted turns, where it stands on all of them, beside orders spoken
/// for; or why it is none.
///
/// # Errors
/// Why the gate refuses it there, in words.
pub fn over_all_turns(
    candidate: &Candidate,
    fitted: &Verdict,
    scene: &Scene,
    taken: &Taken,
    all_turns: &Spectra,
) -> Result<Candidate, String> {
    let field = Field { spectra: all_turns, taken, channels: 0..scene.searched };
    let step = STEP * all_turns.bin(0);
    let bases = (-STEPS..=STEPS).map(|i| candidate.base + f64::from(i) * step);
    let scored = bases.map(|base| based(candidate, base)).map(|c| (score(&c, &field, 0.0).ln_bayes, c));
    let best = scored.max_by(|a, b| a.0.total_cmp(&b.0)).map_or_else(|| candidate.clone(), |(_, best)| best);
    let verdict = accept::judge(&best, &field);
    if let Some(why) = verdict.refused {
        return Err(format!("over all turns: {why}"));
    }
    let [whole, fitted] = [verdict.score.ln_bayes, fitted.score.ln_bayes];
    if whole < fitted {
        return Err(format!("over all turns: {whole:.0} nats, no more than the {fitted:.0} on the fitted turns"));
    }
    Ok(best)
}

/// The family at another distance from its mesh harmonics.
fn based(candidate: &Candidate, base: f64) -> Candidate {
    let share = base / candidate.base - 1.0;
    let moved = |p: &Place| Place {
        order: p.order + p.spacing * share,
        spacing: p.spacing * (1.0 + share),
        label: p.label.clone(),
    };
    Candidate { base, places: candidate.places.iter().map(moved).collect(), ..candidate.clone() }
}
