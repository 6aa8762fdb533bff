//! Whether a line stands at a frequency or at an order: where it is sharper, and that it cannot be told where the speed hardly moves.
//!
//! A line at a frequency is narrow there and smeared over the orders that the speed sweeps, an order the other way round. The strongest line of a family is looked at in the channel that
//! shows it best over its floor: a noisy channel's highest bins would outweigh it. Power in its bins over one axis against the highest that it could have over the other:
//! by a third more, it stands there. Where neither is, it can be either if the speed sweeps it over less than four bins, and is neither if it sweeps more (a hump).

use super::accept::Verdict;
use super::candidate::{Candidate, Domain};
use super::residual::Views;
use super::scene::Scene;
use super::spectra::Spectra;

/// Power over one axis against the other from which a line stands there (set on generated tones and orders).
const CLEARLY: f64 = 1.3;
/// Bins over which the speed must sweep a line for the two to differ.
const SWEPT_BINS: f64 = 4.0;

/// On which axis a line is sharper.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sharper {
    /// It stands at a frequency.
    OverFrequency,
    /// It stands at an order, or it is a hump on both.
    OverOrders,
    /// The speed does not move enough to tell.
    Neither,
}

/// Bins over which the speed sweeps what stands elsewhere, from which it is no line there any more.
const SMEARED_BINS: f64 = 64.0;

/// Whether what is swept from one place to another is so wide that a sharp line between them cannot be it.
pub fn is_smeared([from, to]: [f64; 2], bin: f64) -> bool {
    (to - from).abs() > SMEARED_BINS * bin
}

/// Of the strongest line of a family, in the order spectrum or over frequency; orders in all others.
pub fn of(candidate: &Candidate, verdict: &Verdict, scene: &Scene, views: &Views) -> Sharper {
    let strongest = candidate
        .places
        .iter()
        .zip(&verdict.score.of_places)
        .max_by(|a, b| a.1.total_cmp(b.1))
        .map_or(candidate.base, |(place, _)| place.order);
    let (own, other) = match candidate.domain {
        Domain::Orders => (&views.orders, &views.frequency),
        Domain::Frequency => (&views.frequency, &views.orders),
        _ => return Sharper::OverOrders,
    };
    let all = (0..scene.runs.len()).flat_map(|r| (0..scene.searched).map(move |c| (r, c)));
    let shown = |&(r, c): &(usize, usize)| own.reading(r, c, 0, strongest, 1).map_or(0.0, |reading| reading.ratio);
    let Some((r, c)) = all.max_by(|a, b| shown(a).total_cmp(&shown(b))) else { return Sharper::OverOrders };
    let speed = scene.runs[r].angle.speed;
    let is_frequency = candidate.domain == Domain::Frequency;
    let [slow, fast] = match is_frequency {
        true => [strongest / speed.fastest_hz, strongest / speed.slowest_hz],
        false => [strongest * speed.slowest_hz, strongest * speed.fastest_hz],
    };
    let here = own.excess(r, c, 0, strongest, 1).max(0.0);
    let there = highest(other, (r, c), [slow, fast]);
    let (over_frequency, over_orders) = if is_frequency { (here, there) } else { (there, here) };
    let hz = if is_frequency { strongest } else { strongest * speed.mean_hz };
    let swept = hz * (speed.fastest_hz - speed.slowest_hz) / speed.mean_hz / views.frequency.bin(0);
    if over_frequency > CLEARLY * over_orders {
        Sharper::OverFrequency
    } else if swept < SWEPT_BINS && over_orders < CLEARLY * over_frequency {
        Sharper::Neither
    } else {
        Sharper::OverOrders
    }
}

/// Most power that a line has at any place of a range.
fn highest(spectra: &Spectra, (r, c): (usize, usize), [from, to]: [f64; 2]) -> f64 {
    let bin = spectra.bin(0);
    let steps = ((to - from) / bin).ceil().max(0.0) as usize;
    (0..=steps).map(|i| spectra.excess(r, c, 0, (from + i as f64 * bin).min(to), 1)).fold(0.0, f64::max)
}
