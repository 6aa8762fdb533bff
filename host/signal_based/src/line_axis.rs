//! Whether a line stands at a frequency or at an order: where it is sharper, and that it cannot be told where the
//! speed hardly moves.
//!
//! A line at a frequency is narrow there and smeared over the orders that the speed sweeps, an order the other way
//! round. The strongest line of a family is looked at in the channel that shows it best over its floor: a noisy
//! channel's highest bins would outweigh it. Power in its bins over one axis against the highest that it could have
//! over the other: by a third more, it stands there. Where neither is, it can be either if the speed sweeps it over
//! less than four bins; if it sweeps more, it is a hump on both, as a wander makes of weak lines: only where a
//! supply's harmonics are is a frequency as likely as an order then.

use super::accept::Verdict;
use super::candidate::{Candidate, Domain};
use super::residual_spectra::Views;
use super::scene::Scene;
use super::spectra::Spectra;
use crate::analysis::search::{self, Level};

/// Power over one axis against the other from which a line stands there (set on generated tones and orders).
const MIN_AXIS_POWER_RATIO: f64 = 1.3;
/// Bins over which the speed must sweep a line for the two to differ.
const SWEPT_BINS: f64 = 4.0;
/// Bins about a place within which its peak is looked for.
const PEAK_BINS: f64 = 2.0;

/// On which axis a line is sharper.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sharper {
    /// It stands at a frequency.
    OverFrequency,
    /// It stands at an order.
    OverOrders,
    /// The speed moves enough to tell, and neither is.
    Hump,
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
    read(candidate, verdict, scene, views).0
}

/// The same, and the speed at which that line stands at its frequency, Hz: one where it is read over frequency.
pub fn read(candidate: &Candidate, verdict: &Verdict, scene: &Scene, views: &Views) -> (Sharper, f64) {
    let strongest = candidate
        .places
        .iter()
        .zip(&verdict.score.of_places)
        .max_by(|a, b| a.1.total_cmp(b.1))
        .map_or(candidate.base, |(place, _)| place.order);
    let (own, other) = match candidate.domain {
        Domain::Orders => (&views.orders, &views.frequency),
        Domain::Frequency => (&views.frequency, &views.orders),
        _ => return (Sharper::OverOrders, 1.0),
    };
    let all = (0..scene.runs.len()).flat_map(|r| (0..scene.searched).map(move |c| (r, c)));
    let shown = |&(r, c): &(usize, usize)| own.reading(r, c, 0, strongest, 1).map_or(0.0, |reading| reading.ratio);
    let Some((r, c)) = all.max_by(|a, b| shown(a).total_cmp(&shown(b))) else { return (Sharper::OverOrders, 1.0) };
    let speed = scene.runs[r].angle.speed;
    let is_frequency = candidate.domain == Domain::Frequency;
    // What stands at one frequency in several stretches of a run-up is no order; what mesh lines leave at the orders
    // that it crosses may be higher.
    if is_frequency && scene.runs[r].runs_up() {
        return (Sharper::OverFrequency, 1.0);
    }
    let [slow, fast] = match is_frequency {
        true => [strongest / speed.fastest_hz, strongest / speed.slowest_hz],
        false => [strongest * speed.slowest_hz, strongest * speed.fastest_hz],
    };
    let here = own.excess(r, c, 0, strongest, 1).max(0.0);
    let (there, place) = highest(other, (r, c), [slow, fast]);
    let (over_frequency, over_orders) = if is_frequency { (here, there) } else { (there, here) };
    let hz = if is_frequency { strongest } else { between_bins(&views.frequency.levels[r][c][0], place) };
    let swept = hz * (speed.fastest_hz - speed.slowest_hz) / speed.mean_hz / views.frequency.bin(0);
    let sharper = if over_frequency > MIN_AXIS_POWER_RATIO * over_orders {
        Sharper::OverFrequency
    } else if over_orders >= MIN_AXIS_POWER_RATIO * over_frequency {
        Sharper::OverOrders
    } else if swept < SWEPT_BINS {
        Sharper::Neither
    } else {
        Sharper::Hump
    };
    (sharper, if is_frequency { 1.0 } else { hz / strongest })
}

/// Where the peak next to a place stands, to a fraction of a bin; the place where there is none.
fn between_bins(level: &Level, place: f64) -> f64 {
    search::peak(level, place, PEAK_BINS).map_or(place, |(place, _)| place)
}

/// Most power that a line has at any place of a range, and that place.
fn highest(spectra: &Spectra, (r, c): (usize, usize), [from, to]: [f64; 2]) -> (f64, f64) {
    let bin = spectra.bin(0);
    let steps = ((to - from) / bin).ceil().max(0.0) as usize;
    let places = (0..=steps).map(|i| (from + i as f64 * bin).min(to));
    let of = |place: f64| (spectra.excess(r, c, 0, place, 1).max(0.0), place);
    places.map(of).max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, from))
}
