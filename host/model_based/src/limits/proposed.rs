//! Whether the scans of the residual would have proposed an order or a frequency.
//!
//! An order is proposed where a line of its comb `n z + o`, `n z - o` stands in all runs alike ([`detect`]), or
//! another one in every run ([`combs`]). Lines of the residual and of an effect add, so that of each only the
//! amplitudes at these places are needed. Limit: that nothing else takes one of the few places of the scans is taken
//! for granted.

use super::super::base_fit::Base;
use super::super::candidate::Candidate;
use super::super::combs;
use super::super::detect::{self, CAP};
use super::super::least_squares::Data;
use nalgebra::DVector;
use rustfft::num_complex::Complex64 as C;

/// One line in one run: what the residuals hold there, and each template of the effect, in units of the noise, in
/// both channels.
struct Line {
    hz: f64,
    residuals: Vec<[C; 2]>,
    templates: Vec<[C; 2]>,
}

/// The lines of an effect that the scans may see.
pub struct Lines<'a> {
    base: &'a Base,
    seen: Vec<usize>,
    /// Order of each line; none for a fixed frequency.
    orders: Vec<Option<f64>>,
    /// By run seen, then line.
    lines: Vec<Vec<Line>>,
}

impl<'a> Lines<'a> {
    /// Of a candidate at an order or a fixed frequency.
    pub fn new(base: &'a Base, residuals: &[Data], seen: &[usize], candidate: &Candidate) -> Self {
        let z = f64::from(base.machine.teeth[0]);
        let slowest = seen.iter().map(|&r| base.runs[r].angle.shaft_hz).fold(f64::INFINITY, f64::min);
        let orders: Vec<Option<f64>> = match candidate.order {
            Some(order) => {
                let last = (combs::HIGHEST_HZ / (z * slowest)) as i32;
                let both = (0..=last).map(|n| f64::from(n) * z).flat_map(|mesh| [mesh + order, mesh - order]);
                both.filter(|o| *o > 0.0).map(Some).collect()
            }
            None => vec![None],
        };
        let lines = seen.iter().map(|&r| {
            let shaft_hz = base.runs[r].angle.shaft_hz;
            let hz = |order: &Option<f64>| order.map_or(candidate.frequency_hz.unwrap_or(0.0), |o| o * shaft_hz);
            of_run(base, residuals, candidate, r, orders.iter().map(hz))
        });
        Self { base, seen: seen.to_vec(), lines: lines.collect(), orders }
    }

    /// Whether a scan of this residual would have proposed the effect at the unknowns `x` of every run.
    pub fn are_proposed(&self, residual: usize, x: &[DVector<f64>]) -> bool {
        let powers: Vec<Vec<f64>> = self
            .seen
            .iter()
            .zip(&self.lines)
            .map(|(&r, lines)| lines.iter().map(|line| line.power(residual, &x[r])).collect())
            .collect();
        self.stand_in_all_runs(&powers) || self.stand_in_turn(&powers)
    }

    fn stand_in_all_runs(&self, powers: &[Vec<f64>]) -> bool {
        let grid @ [top, _, guard] = detect::grid_of_orders(self.base, &self.seen);
        let z = f64::from(self.base.machine.teeth[0]);
        let places = match self.orders[0] {
            Some(_) => detect::places_of_orders(grid),
            None => detect::grid_of_frequencies(self.base).2,
        };
        self.orders.iter().enumerate().any(|(i, order)| {
            let scanned = order.is_none_or(|o| o < top && (o - z * (o / z).round()).abs() > guard);
            let sum: f64 = powers.iter().map(|run| run[i].min(CAP)).sum();
            scanned && detect::is_line(sum, self.seen.len(), places)
        })
    }

    fn stand_in_turn(&self, powers: &[Vec<f64>]) -> bool {
        let Some(first) = self.orders[0] else { return false };
        let z = f64::from(self.base.machine.teeth[0]);
        let [_, step, guard] = detect::grid_of_orders(self.base, &self.seen);
        let from_mesh = (first - z * (first / z).round()).abs();
        let sum: f64 = powers
            .iter()
            .zip(&self.lines)
            .map(|(run, lines)| {
                let within = run.iter().zip(lines).filter(|(_, line)| line.hz < combs::HIGHEST_HZ);
                let (most, count) = within.fold((0.0_f64, 0.0), |(most, count), (p, _)| (most.max(*p), count + 1.0));
                combs::evidence_of(most, count)
            })
            .sum();
        from_mesh > guard && combs::is_comb(sum, self.seen.len(), combs::places(z, step))
    }
}

impl Line {
    /// Power over noise, both channels.
    fn power(&self, residual: usize, x: &DVector<f64>) -> f64 {
        let of = |c: usize| {
            let own: C = self.templates.iter().zip(x.iter()).map(|(t, x)| t[c] * *x).sum();
            (self.residuals[residual][c] + own).norm_sqr()
        };
        of(0) + of(1)
    }
}

/// Lines of one run at these frequencies.
fn of_run(
    base: &Base,
    residuals: &[Data],
    candidate: &Candidate,
    r: usize,
    hz: impl Iterator<Item = f64>,
) -> Vec<Line> {
    let dense: Vec<[Vec<C>; 2]> = candidate
        .templates
        .iter()
        .map(|template| {
            [0, 1].map(|c| {
                let mut bins = vec![C::ZERO; if template.runs[r][c].is_empty() { 0 } else { base.analyser.bins }];
                template.runs[r][c].iter().for_each(|(b, t)| bins[b] = t);
                bins
            })
        })
        .collect();
    hz.map(|hz| Line {
        hz,
        residuals: residuals.iter().map(|data| [0, 1].map(|c| detect::amplitude(base, data, r, c, hz))).collect(),
        templates: dense
            .iter()
            .map(|bins| {
                [0, 1].map(|c| match bins[c].as_slice() {
                    [] => C::ZERO,
                    bins => detect::amplitude_in(bins, base, &residuals[0], r, c, hz),
                })
            })
            .collect(),
    })
    .collect()
}
