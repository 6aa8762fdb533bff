//! What the fitted turns foretell of lines whose phases cannot be known: their power on other turns.
//!
//! The prior is the one that the lines were found with ([`Reading`]): what a place reads on the fitted turns says how
//! strong its line is, and whether there is one in that run and channel at all. The worth of the family is the
//! logarithm of the likelihood ratio of the other turns' readings so predicted against a floor without lines, at the
//! places that stood. Empty places of the family ask for nothing there, and a line weaker than it should be speaks
//! against it. A shorter stretch shows a line lower by the ratio of the lengths; in a run-up, where the path swells a
//! line, it is as much higher as the mesh line that swept its frequencies. Limit: a line that stands on one part
//! alone, as a short disturbance does, is refused however strong it is.

use super::baseline::Baseline;
use super::basis_selection::carrier;
use super::candidate::{Domain, Place, own_level};
use super::evidence::{Reading, Shares, ln_sum};
use super::residual_spectra::Views;
use super::scene::Scene;
use super::search::Adopted;
use super::spectra::Spectra;
use super::split::Stretch;

/// Most that a path is believed to swell a line from one part to the other, of its power.
const MAX_SWELL_POWER_RATIO: f64 = 30.0;

/// Logarithm of the likelihood ratio of the second views' readings, predicted from the first; the best level, coarser
/// ones too, since slip moves between the two.
pub fn ln_bayes(scene: &Scene, baseline: &Baseline, views: [&Views; 2], own: &Adopted) -> f64 {
    let depth = views.map(|view| view.of(own.candidate.domain).depth()).into_iter().min().unwrap_or(0);
    if depth == 0 {
        return 0.0;
    }
    let finest = if own.candidate.locked { 0..1 } else { own.verdict.score.level.min(depth - 1)..depth };
    let choices = (finest.len() as f64).ln();
    finest.map(|level| at_level(scene, baseline, views, own, level)).fold(f64::NEG_INFINITY, f64::max)
        - choices
        - own.slip.cost
}

fn at_level(scene: &Scene, baseline: &Baseline, views: [&Views; 2], own: &Adopted, level: usize) -> f64 {
    let [fit, other] = views.map(|view| view.of(own.candidate.domain));
    let reach = usize::from(!own.candidate.locked);
    let read = |place: &Place| {
        let (order, level, off) = (place.order, own_level(place, level, fit), own.off(place));
        let places = (0..scene.runs.len()).flat_map(|run| (0..scene.searched).map(move |channel| (run, channel)));
        places.filter_map(move |(run, channel)| {
            let fitted = fit.reading(run, channel, level, order, reach)?;
            let near = (0..=2 * reach).filter_map(move |i| {
                let order = order + off + (i as f64 - reach as f64) * other.bin(level);
                other.reading(run, channel, level, order, 0)
            });
            let over = |view: &Spectra| view.floor(run, channel, level, order);
            let swelled = match own.candidate.domain {
                Domain::Orders => swelled(scene, baseline, (run, channel), order),
                _ => None,
            };
            let higher = swelled.map_or(1.0, |swelled| {
                (swelled * over(fit) / over(other)).clamp(1.0 / MAX_SWELL_POWER_RATIO, MAX_SWELL_POWER_RATIO)
            });
            Some((fitted, near.collect::<Vec<Reading>>(), higher * fit.bin(level) / other.bin(level)))
        })
    };
    let all = own.candidate.places.iter().flat_map(read).map(|(fitted, ..)| fitted.ln_bayes());
    let shares = Shares::of(&all.collect::<Vec<f64>>());
    let predicted = |(fitted, near, length): (Reading, Vec<Reading>, f64)| {
        let chance = shares.chance(fitted.ln_bayes());
        ln_sum([(1.0 - chance).ln(), chance.ln() + fitted.ln_predictive(&near, length)].into_iter())
    };
    own.standing().flat_map(read).filter(|(_, near, _)| !near.is_empty()).map(predicted).sum()
}

/// Power that the path gives a line of this order on the held-out turns of a run-up over that on the fitted ones, by
/// the mesh line that swept its frequencies, where one did.
fn swelled(scene: &Scene, baseline: &Baseline, (run, channel): (usize, usize), order: f64) -> Option<f64> {
    let own = &scene.runs[run];
    let swept = (own.angle.speed.fastest_hz / own.angle.speed.slowest_hz).ln();
    let line = carrier(&baseline.lines[run][channel], order, swept).filter(|_| own.runs_up())?;
    let of = |stretches: &[Stretch]| {
        let turns = stretches.iter().flat_map(|s| s.from..s.from + s.turns);
        let powers = turns.map(|turn| line.at(own.states[turn].scaled(order / line.order)).norm_sqr());
        let (count, sum) = powers.fold((0, 0.0), |(count, sum), power| (count + 1, sum + power));
        (sum / f64::from(count.max(1))).max(f64::MIN_POSITIVE)
    };
    Some(of(&own.split.held_out) / of(&own.split.fit))
}
