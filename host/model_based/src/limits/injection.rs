//! Effects laid over what is left of a record, and whether the search would have taken them.

use super::super::accept::{self, Adopted};
use super::super::base_fit::{Base, TOLERANCES};
use super::super::candidate::{Candidate, Template};
use super::super::frame::Border;
use super::super::judge::{Judge, Split, corrected, joint};
use super::super::least_squares::Data;
use super::super::library::Bench;
use super::super::strength::refuted;
use super::places::Seated;
use super::proposed::Lines;
use nalgebra::DVector;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rustfft::num_complex::Complex64 as C;
use std::f64::consts::TAU;

/// Further residuals beside the record's own.
const VARIANTS: usize = 3;
/// Bins that are turned by one phase: several times what a line of the window fills.
const TURNED_BINS: usize = 48;
/// Gain in chi-square that a first guess of the strength stands for.
const GUESSED_GAIN: f64 = 40.0;
/// Doublings of the strength tried, and halvings of the last doubling's logarithm (to 1 %).
const DOUBLINGS: i32 = 14;
const HALVINGS: usize = 6;
/// Doublings found one after the other from which on every stronger effect is taken to be found.
const SETTLED_DOUBLINGS: i32 = 3;

/// What the terms leave of the record, and the same with phases drawn anew, stretch by stretch: noise and remainders
/// of the same size where they were, but in another relation to what is injected.
pub fn variants(base: &Base, data: &Data, split: &Split, adopted: &Adopted) -> Vec<Data> {
    let terms: Vec<&Candidate> = adopted.iter().collect();
    let rest = corrected(base, data, &joint(base, data, &split.seen(), &terms).x, &terms);
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut turned = || {
        let mut other = Data { residual: rest.residual.clone(), weight: rest.weight.clone() };
        for stretch in other.residual.iter_mut().flatten().flat_map(|bins| bins.chunks_mut(TURNED_BINS)) {
            let turn = C::cis(TAU * random.random::<f64>());
            stretch.iter_mut().for_each(|x| *x *= turn);
        }
        other
    };
    let mut all: Vec<Data> = (0..VARIANTS).map(|_| turned()).collect();
    all.insert(0, rest);
    all
}

/// A strength at which finding begins or ceases.
#[derive(Debug, Clone, Copy)]
pub struct Turn {
    /// The simulator's strength; infinite where it is beyond what the simulator takes.
    pub strength: f64,
    /// Whether stronger effects are found and weaker ones not, or the other way round.
    pub found_above: bool,
}

/// The record's residuals, ready for effects.
pub struct Scene<'a> {
    bench: &'a Bench<'a>,
    variants: &'a [Data],
    seen: Vec<usize>,
    adopted: &'a Adopted,
    judges: Vec<Judge<'a>>,
    tests: f64,
    turns: Option<Vec<u32>>,
}

/// A candidate with its products.
struct Prepared<'a> {
    bare: Candidate,
    borders: Vec<Border>,
    lines: Option<Lines<'a>>,
}

impl<'a> Scene<'a> {
    /// Before the `variants` of a residual; `tried`: scores given in the search.
    pub fn new(
        bench: &'a Bench<'a>,
        variants: &'a [Data],
        split: &'a Split,
        adopted: &'a Adopted,
        tried: usize,
    ) -> Self {
        let terms: Vec<&Candidate> = adopted.iter().collect();
        let judges = variants.iter().map(|data| Judge::new(bench.base, data, split, &terms)).collect();
        let turns = adopted.iter().find_map(|term| term.start.turns()).map(<[u32]>::to_vec);
        Self { bench, variants, seen: split.seen(), adopted, judges, tests: tried.max(1) as f64, turns }
    }

    /// Where a growing strength begins or ceases to be found, place by place.
    pub fn turns_of_fortune(&self, seated: &Seated) -> Vec<Vec<Turn>> {
        let prepared = self.prepared(seated);
        let of = |(place, unit): (usize, &Vec<DVector<f64>>)| {
            let sizes = self.turning_sizes(&prepared, place % self.judges.len(), unit);
            let strength = |size| seated.strength(self.bench, place, size).unwrap_or(f64::INFINITY);
            sizes.into_iter().map(|(size, found_above)| Turn { strength: strength(size), found_above }).collect()
        };
        seated.unknowns.iter().enumerate().map(of).collect()
    }

    fn prepared(&self, seated: &Seated) -> Prepared<'a> {
        let candidate = &seated.candidate;
        let first = self.judges[0].border(candidate);
        let others = self.variants.iter().skip(1).map(|data| first.before(data, &candidate.templates));
        let others: Vec<Border> = others.collect();
        let mut borders = vec![first];
        borders.extend(others);
        let lines = seated.proposed.then(|| Lines::new(self.bench.base, self.variants, &self.seen, candidate));
        let templates = candidate.templates.iter().map(|_| Template::new([])).collect();
        Prepared { bare: Candidate { templates, ..candidate.clone() }, borders, lines }
    }

    /// Sizes at which the effect begins (true) or ceases to be found at a place, by doubling and halving: near the
    /// limit the held-out runs may pass a weak effect by luck and refuse a stronger one.
    fn turning_sizes(&self, prepared: &Prepared<'_>, variant: usize, unit: &[DVector<f64>]) -> Vec<(f64, bool)> {
        let border = &prepared.borders[variant];
        let information: f64 = self.seen.iter().map(|&r| unit[r].dot(&(border.gram(r) * &unit[r]))).sum();
        let first = 0.25 * (GUESSED_GAIN / information.max(1e-300)).sqrt();
        let found = |size: f64| {
            let x: Vec<DVector<f64>> = unit.iter().map(|x| x * size).collect();
            self.is_found(prepared, variant, &x)
        };
        let mut turns = Vec::new();
        let (mut now, mut settled) = (false, 0);
        for size in (0..DOUBLINGS).map(|i| first * 2.0_f64.powi(i)) {
            let next = found(size);
            if next != now {
                let (mut low, mut high) = (0.5 * size, size);
                for _ in 0..HALVINGS {
                    let middle = (low * high).sqrt();
                    if found(middle) == next { high = middle } else { low = middle }
                }
                turns.push((high, next));
            }
            (now, settled) = (next, if next { settled + 1 } else { 0 });
            if settled == SETTLED_DOUBLINGS {
                break;
            }
        }
        turns
    }

    /// Whether the search would have adopted the candidate, and the held-out runs would have confirmed it, where the
    /// record held it at the unknowns `x` of every run.
    fn is_found(&self, prepared: &Prepared<'_>, variant: usize, x: &[DVector<f64>]) -> bool {
        if prepared.lines.as_ref().is_some_and(|lines| !lines.are_proposed(variant, x)) {
            return false;
        }
        let base = self.bench.base;
        let (judge, border) = self.judges[variant].holding(&prepared.borders[variant], x);
        let judged = judge.judge_bordered(prepared.bare.clone(), &border, self.turns.as_deref());
        if self.adopted.weigh(&judged.figures(self.tests)).is_err() || refuted(base, &judged).is_err() {
            return false;
        }
        let candidate = &judged.candidate;
        let turned = border.turned(|run, pair| match candidate.pair_orders.get(pair) {
            Some(&order) => candidate.start.phase_rad(run, order),
            None => 0.0,
        });
        let border = if candidate.pair_orders.is_empty() { border } else { turned };
        accept::confirmed(judge.held_out(candidate, &border, TOLERANCES.len()..base.nuisances.len()))
    }
}
