//! The angle as the mesh lines themselves have it: what a slow or virtual tachometer does not follow.
//!
//! Every mesh line's phase, read over two turns of the slower shaft at a time, departs from its mean by `k z` times what the angle is off; the departure
//! common to all lines and channels, weighted by power and order, is that of the angle (maximum likelihood for small departures). A Hann window of two
//! turns is blind to sidebands of that shaft, so a runout stays what it is. Repeated, because a window takes only part of a fast departure at once. Applied
//! where the lines get sharper by it. Limits: what swings the phase of all lines alike and slowly is taken for the angle; in a run-up
//! the path turns the lines, so a measured tachometer is left alone there.

use crate::analysis::angle::Angle;
use crate::spectral::AngleMap;
use rayon::prelude::*;
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;

/// Turns of the slower shaft in a window, and windows per turn.
const WINDOW_TURNS: f64 = 2.0;
const PER_TURN: f64 = 8.0;
/// Mesh harmonics read.
const HARMONICS: usize = 8;
/// Edges per turn of the pinion of the new angle.
const EDGES: u32 = 4;
/// Share of the power beside the lines that must go.
const SHARPER: f64 = 0.8;
/// Least power of a line's mean over that of its departures.
const STEADY: f64 = 0.05;

/// A line read over windows: its order and value in each.
struct Read {
    order: f64,
    values: Vec<Complex64>,
}

/// Departure of the angle, turns, at places on the grid, turns of the pinion from its first.
pub struct Departure {
    places: Vec<f64>,
    turns: Vec<f64>,
}

/// What the lines say the angle is off; nothing where they do not get sharper.
pub fn departure(samples: &[Vec<f64>], angle: &Angle, mesh_order: f64, highest_order: f64) -> Option<Departure> {
    let count = ((highest_order / mesh_order) as usize).min(HARMONICS);
    let length = WINDOW_TURNS / angle.slower_order();
    let hop = 1.0 / (PER_TURN * angle.slower_order());
    let windows = ((angle.turns as f64 - 0.5 * length) / hop).floor().max(0.0) as usize + 1;
    if count == 0 || windows < 8 {
        return None;
    }
    // The outer windows are cut in half by the ends.
    let places: Vec<f64> = (0..windows).map(|i| 0.25 * length + i as f64 * hop).collect();
    let reads: Vec<Read> = samples
        .par_iter()
        .flat_map_iter(|samples| (1..=count).map(move |k| (samples, k as f64 * mesh_order)))
        .map(|(samples, order)| Read {
            order,
            values: windowed(samples, angle.per_turn[0], order, (length, hop), windows),
        })
        .collect();
    let mut turns = vec![0.0; windows];
    for _ in 0..6 {
        let change = common(&reads, &turns);
        turns.iter_mut().zip(&change).for_each(|(t, c)| *t += c);
    }
    let mean = turns.iter().sum::<f64>() / windows as f64;
    turns.iter_mut().for_each(|t| *t -= mean);
    let none = vec![0.0; windows];
    (beside(&reads, &turns) < SHARPER * beside(&reads, &none)).then_some(Departure { places, turns })
}

/// A line turned to zero and averaged over Hann windows, from prefix sums over short parts.
fn windowed(samples: &[f64], per_turn: usize, order: f64, (length, hop): (f64, f64), windows: usize) -> Vec<Complex64> {
    let part = ((hop * per_turn as f64) / 4.0).max(1.0) as usize;
    let step = Complex64::from_polar(1.0, -TAU * order / per_turn as f64);
    let sums: Vec<Complex64> = samples
        .chunks(part)
        .enumerate()
        .map(|(i, values)| {
            let mut turn = Complex64::from_polar(1.0, -TAU * (order * (i * part) as f64 / per_turn as f64).fract());
            let mut sum = Complex64::default();
            for x in values {
                sum += turn * x;
                turn *= step;
            }
            sum
        })
        .collect();
    let of_window = |i: usize| {
        let (from, to) =
            ((i as f64 * hop - 0.25 * length) * per_turn as f64, (i as f64 * hop + 0.75 * length) * per_turn as f64);
        let range = (from / part as f64) as usize..((to / part as f64) as usize).min(sums.len());
        range
            .map(|j| {
                let u = (((j as f64 + 0.5) * part as f64 - from) / (to - from)).clamp(0.0, 1.0);
                sums[j] * (0.5 - 0.5 * (TAU * u).cos())
            })
            .sum()
    };
    (0..windows).map(of_window).collect()
}

/// Mean of a line's values with a departure taken out, and what is left beside it.
fn split(read: &Read, turns: &[f64]) -> (Complex64, f64) {
    let turned = || read.values.iter().zip(turns).map(|(v, t)| v * Complex64::from_polar(1.0, -TAU * read.order * t));
    let mean = turned().sum::<Complex64>() / turns.len() as f64;
    (mean, turned().map(|v| (v - mean).norm_sqr()).sum::<f64>() / turns.len() as f64)
}

/// The departure common to all lines that is left.
fn common(reads: &[Read], turns: &[f64]) -> Vec<f64> {
    let (mut up, mut down) = (vec![0.0; turns.len()], vec![1e-300; turns.len()]);
    for read in reads {
        let (mean, left) = split(read, turns);
        if mean.norm_sqr() < STEADY * left {
            continue;
        }
        let weight = TAU * read.order * TAU * read.order * mean.norm_sqr() / left.max(1e-3 * mean.norm_sqr());
        for (i, (value, t)) in read.values.iter().zip(turns).enumerate() {
            let turned = value * Complex64::from_polar(1.0, -TAU * read.order * t) * mean.conj();
            let size = (turned.norm() / mean.norm_sqr()).min(1.0);
            up[i] += weight * size * turned.arg() / (TAU * read.order);
            down[i] += weight * size;
        }
    }
    up.iter().zip(&down).map(|(u, d)| u / d).collect()
}

/// Power beside the lines over that in them, summed.
fn beside(reads: &[Read], turns: &[f64]) -> f64 {
    let of = |read: &Read| {
        let (mean, left) = split(read, turns);
        left / (left + mean.norm_sqr()).max(1e-300)
    };
    reads.iter().map(of).sum()
}

impl Departure {
    /// The departure at a place, straight between windows, level beyond the outer ones.
    fn at(&self, place: f64) -> f64 {
        let i = self.places.partition_point(|p| *p <= place).clamp(1, self.places.len() - 1) - 1;
        let u = ((place - self.places[i]) / (self.places[i + 1] - self.places[i])).clamp(0.0, 1.0);
        self.turns[i] + u * (self.turns[i + 1] - self.turns[i])
    }

    /// The map with the departure taken out.
    pub fn taken_out(&self, angle: &Angle) -> Option<AngleMap> {
        let (from, turns) = (angle.from_turn, angle.turns as f64);
        let margin = 0.5;
        let count = ((turns + 2.0 * margin) * f64::from(EDGES)) as usize + 1;
        let edge = |i: usize| {
            let turn = i as f64 / f64::from(EDGES) - margin;
            angle.map.time_at(from + turn - self.at(turn))
        };
        let edges: Vec<f64> = (0..count).map(edge).collect();
        edges.windows(2).all(|w| w[1] > w[0]).then(|| AngleMap::new(&edges, EDGES, from - margin)).flatten()
    }
}
