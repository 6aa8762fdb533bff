//! A swing on all turns in one stretch, fitted, held out and between: nearly three times as sharp as on the fitted ones.
//!
//! There a line stands higher, and what a wandering speed leaves beside the mesh lines does not. A quarter of the turns alone would not tell a swing from its mesh line. The
//! fitted turns place a swing within some bins only, so it is looked for about there; where it stands is its rate. Cost: spectra of all turns, once. Limit: turns held out take part; that is the veto's price for what they cannot show alone.

use super::accept;
use super::baseline::Baseline;
use super::candidate::{Candidate, Field, Kind, Place, Taken, score};
use super::scene::Scene;
use super::search::Adopted;
use super::spectra::Spectra;
use super::split::Stretch;

/// Share of a bin in which its rate is looked for, and steps each way: what the fitted turns leave open. (As far as a main lobe of theirs, residue of the mesh line passes for a swing.)
const STEP: f64 = 0.5;
const STEPS: i32 = 6;

/// Takes every swing to where it stands on all turns, with what the gate says of it there.
pub fn over_all_turns(scene: &Scene, baseline: &Baseline, adopted: &mut [Adopted]) {
    let mut swings = adopted.iter_mut().filter(|own| own.candidate.kind == Kind::Swing).peekable();
    if swings.peek().is_none() {
        return;
    }
    let all = |r: usize| vec![Stretch { from: 0, turns: scene.runs[r].angle.turns }];
    let spectra = Spectra::searched(scene, &baseline.calibrated, all);
    let nothing = Taken::default();
    let field = Field { spectra: &spectra, taken: &nothing, channels: 0..scene.searched };
    for own in swings {
        let step = STEP * spectra.bin(0);
        let bases = (-STEPS..=STEPS).map(|i| own.candidate.base + f64::from(i) * step);
        let tried = bases.map(|base| based(&own.candidate, base));
        let scored = tried.map(|c| (score(&c, &field, 0.0).ln_bayes, c));
        let Some((_, best)) = scored.max_by(|a, b| a.0.total_cmp(&b.0)) else { continue };
        let mut verdict = accept::judge(&best, &field);
        if verdict.refused.is_none() && verdict.score.ln_bayes < own.verdict.score.ln_bayes {
            let [whole, fitted] = [&verdict, &own.verdict].map(|v| v.score.ln_bayes);
            verdict.refused = Some(format!("{whole:.0} nats, no more than the {fitted:.0} on the fitted turns"));
        }
        own.candidate = best;
        own.over_all_turns = Some(verdict);
    }
}

/// The swing at another distance from its mesh harmonics.
fn based(candidate: &Candidate, base: f64) -> Candidate {
    let share = base / candidate.base - 1.0;
    let moved = |p: &Place| Place {
        order: p.order + p.spacing * share,
        spacing: p.spacing * (1.0 + share),
        label: p.label.clone(),
    };
    Candidate { base, places: candidate.places.iter().map(moved).collect(), ..candidate.clone() }
}
