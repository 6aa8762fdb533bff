//! Time-varying mesh stiffness (TVMS): the sum over the pairs in contact, over one base pitch.
//!
//! Pairs follow one base pitch apart, so the sum repeats every unit of the abscissa. The pieces of the pair's
//! curve are moved and added exactly; a zone is the stretch between two events of any pair.

use crate::piecewise::{PiecewisePolynomial, shift_scale};

/// Total stiffness over `[0, 1]` base pitch from the start of a pair's contact.
pub fn total(pair: &PiecewisePolynomial) -> PiecewisePolynomial {
    let knots = zones(pair);
    let (first, last) = (pair.knots()[0], pair.knots()[pair.knots().len() - 1]);
    let pieces = knots
        .windows(2)
        .map(|w| {
            let (from, middle) = (w[0], 0.5 * (w[0] + w[1]));
            let mut sum: Vec<f64> = Vec::new();
            for n in (first.floor() as i32 - 1)..=(last.ceil() as i32 + 1) {
                let Some(i) = pair.locate(middle + f64::from(n)) else { continue };
                let moved = shift_scale(pair.piece(i), from + f64::from(n) - pair.knots()[i], 1.0);
                sum.resize(sum.len().max(moved.len()), 0.0);
                sum.iter_mut().zip(moved).for_each(|(s, m)| *s += m);
            }
            if sum.is_empty() { vec![0.0] } else { sum }
        })
        .collect();
    PiecewisePolynomial::new(knots, pieces)
}

/// Borders of the zones of the total, 0 to 1: every knot of the pair's curve, wrapped.
pub fn zones(pair: &PiecewisePolynomial) -> Vec<f64> {
    let mut knots: Vec<f64> = pair.knots().iter().map(|k| k.rem_euclid(1.0)).collect();
    knots.extend([0.0, 1.0]);
    knots.sort_by(f64::total_cmp);
    // Wrapping rounds: borders closer than this are one event. The period's own ends stay exact.
    let mut kept = vec![0.0];
    for k in knots {
        if k - kept[kept.len() - 1] > 1e-9 && 1.0 - k > 1e-9 {
            kept.push(k);
        }
    }
    kept.push(1.0);
    kept
}

/// Means and extremes of the total over the cycle.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Summary {
    /// Over the whole base pitch, N/m.
    pub mean: f64,
    /// Over the part with one pair more (double contact for contact ratios between 1 and 2), N/m.
    pub double_mean: f64,
    /// Over the rest (single contact), N/m.
    pub single_mean: f64,
    /// Least value, N/m.
    pub least: f64,
    /// Largest value, N/m.
    pub largest: f64,
}

/// Summary of a pair's curve; `contact_ratio` places the border between the zones.
pub fn summary(pair: &PiecewisePolynomial, contact_ratio: f64) -> Summary {
    let total = total(pair);
    let border = contact_ratio.fract();
    let samples = 4000;
    let (mut double, mut single) = ((0.0, 0u32), (0.0, 0u32));
    let (mut least, mut largest) = (f64::INFINITY, f64::NEG_INFINITY);
    for i in 0..samples {
        let s = (f64::from(i) + 0.5) / f64::from(samples);
        let k = total.value(s);
        let zone = if s < border { &mut double } else { &mut single };
        *zone = (zone.0 + k, zone.1 + 1);
        least = least.min(k);
        largest = largest.max(k);
    }
    let mean_of = |(sum, n): (f64, u32)| if n == 0 { f64::NAN } else { sum / f64::from(n) };
    Summary { mean: total.integral(), double_mean: mean_of(double), single_mean: mean_of(single), least, largest }
}

/// A pair's curve whose sum is the square wave with the same zone means: pairs in contact share equally.
pub fn square_wave(pair: &PiecewisePolynomial, contact_ratio: f64) -> PiecewisePolynomial {
    let summary = summary(pair, contact_ratio);
    let (pairs, border) = (contact_ratio.floor(), contact_ratio.fract());
    let knots = super::pair::event_knots(contact_ratio, &[]);
    let share = |s: f64| {
        if s.fract() < border { summary.double_mean / (pairs + 1.0) } else { summary.single_mean / pairs }
    };
    let pieces = knots.windows(2).map(|w| vec![share(0.5 * (w[0] + w[1]))]).collect();
    PiecewisePolynomial::new(knots, pieces)
}
