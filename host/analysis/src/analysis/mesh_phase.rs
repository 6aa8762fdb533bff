//! The angle as the mesh lines themselves have it: what a slow or virtual tachometer does not follow.
//!
//! Every mesh line's phase, read over two turns of the slower shaft at a time, departs from its mean by `k z` times
//! what the angle is off; the departure common to all lines and channels, weighted by power and order, is that of the
//! angle (maximum likelihood for small departures). A Hann window of two turns is blind to sidebands of that shaft,
//! so a runout stays what it is. Repeated, because a window takes only part of a fast departure at once. Applied
//! where the lines get sharper by it. A departure of half a cycle of a high harmonic is a small one of the first, so
//! where the first is clear it is followed by itself before the others are asked. Limits: what swings the phase of
//! all lines alike and slowly is taken for the angle; in a run-up the path turns the lines, so a measured tachometer
//! is left alone there.

use super::angle::Angle;
use crate::record::{Run, Tach};
use crate::spectral::{AngleMap, interpolated};
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
const MAX_SIDE_POWER_SHARE: f64 = 0.8;
/// Share of a first harmonic's power that repeats a window later, from which it is followed by itself.
const MIN_REPEATED_POWER_SHARE: f64 = 0.9;
/// Rounds: mesh harmonics used, and least power of a line's mean over that of its departures. A departure of half a
/// cycle of a high harmonic is a small one of the first, so low ones that are clear come first: else the harmonics
/// agree on a wrong cycle.
const ROUNDS: [(f64, f64); 8] =
    [(1.0, 1.0), (1.0, 1.0), (2.0, 1.0), (4.0, 0.5), (8.0, 0.05), (8.0, 0.05), (8.0, 0.05), (8.0, 0.05)];
/// Fewest windows.
const MIN_WINDOWS: usize = 8;
/// Most channels whose lines an analysis follows, and rounds of it.
const MAX_FOLLOWED_CHANNELS: usize = 4;
const FOLLOW_ROUNDS: usize = 2;
/// Samples after which a turning factor is made anew.
const RENEWAL_SAMPLES: usize = 1024;

/// A line read over windows: its order and value in each.
struct Read {
    order: f64,
    values: Vec<Complex64>,
}

/// Departure of the angle, turns, at equally spaced places on the grid.
pub struct Departure {
    /// First place, and from one to the next, turns of the pinion from the grid's first.
    first: f64,
    hop: f64,
    turns: Vec<f64>,
}

/// Windows over which lines are read.
pub struct Windows {
    /// Length and distance, turns of the pinion.
    length: f64,
    hop: f64,
    /// How many.
    pub count: usize,
}

impl Windows {
    /// Of a run; nothing where it is short.
    pub fn of(angle: &Angle) -> Option<Self> {
        let length = WINDOW_TURNS / angle.slower_order();
        let hop = 1.0 / (PER_TURN * angle.slower_order());
        let count = ((angle.turns as f64 - 0.5 * length) / hop).floor().max(0.0) as usize + 1;
        (count >= MIN_WINDOWS).then_some(Self { length, hop, count })
    }

    /// A line's value in each.
    pub fn read(&self, samples: &[f64], per_turn: usize, order: f64) -> Vec<Complex64> {
        windowed(samples, per_turn, order, (self.length, self.hop), self.count)
    }

    /// A departure that was read in them; its mean, which no line can show, is none.
    pub fn departure(&self, mut turns: Vec<f64>) -> Departure {
        let mean = turns.iter().sum::<f64>() / turns.len() as f64;
        turns.iter_mut().for_each(|t| *t -= mean);
        // The outer windows are cut in half by the ends.
        Departure { first: 0.25 * self.length, hop: self.hop, turns }
    }
}

/// The angle of an analysis with the mesh lines' departure taken out: of one mark per turn whose jitter is phase at the
/// highest order, what smoothing leaves is more than the lines themselves say. Cost: the channels are resampled once
/// or twice more.
pub fn followed(mut angle: Angle, run: &Run, tach: &Tach, mesh_order: f64) -> Angle {
    if tach.pulses_per_rev > 1 || angle.runs_up() || !angle.is_blurred_by(tach) {
        return angle;
    }
    let moving = (0..run.channels()).filter(|c| run.moves(*c)).take(MAX_FOLLOWED_CHANNELS);
    let signals: Vec<Vec<f64>> = moving.map(|c| run.signal_m_s2(c)).collect();
    for _ in 0..FOLLOW_ROUNDS {
        let samples: Vec<Vec<f64>> = signals.par_iter().map(|s| angle.resampled(s, run.sample_rate_hz())).collect();
        let found = departure(&samples, &angle, mesh_order, angle.highest_order);
        let Some(map) = found.and_then(|departure| departure.taken_out(&angle)) else { break };
        angle.map = map;
    }
    angle
}

/// What the lines say the angle is off; nothing where they do not get sharper.
pub fn departure(samples: &[Vec<f64>], angle: &Angle, mesh_order: f64, highest_order: f64) -> Option<Departure> {
    let count = ((highest_order / mesh_order) as usize).min(HARMONICS);
    let windows = Windows::of(angle).filter(|_| count > 0)?;
    let reads: Vec<Read> = samples
        .par_iter()
        .flat_map_iter(|samples| (1..=count).map(move |k| (samples, k as f64 * mesh_order)))
        .map(|(samples, order)| Read { order, values: windows.read(samples, angle.per_turn[0], order) })
        .collect();
    let mut turns = unwrapped(&reads, mesh_order).unwrap_or_else(|| vec![0.0; windows.count]);
    for (upto, clear) in ROUNDS {
        let own: Vec<&Read> = reads.iter().filter(|read| read.order < (upto + 0.5) * mesh_order).collect();
        let change = common(&own, &turns, clear);
        turns.iter_mut().zip(&change).for_each(|(t, c)| *t += c);
    }
    let departure = windows.departure(turns);
    let none = vec![0.0; windows.count];
    (beside(&reads, &departure.turns) < MAX_SIDE_POWER_SHARE * beside(&reads, &none)).then_some(departure)
}

/// A line turned to zero under Hann windows, from running sums of it and of its neighbours one window's width away,
/// which make the window exactly: sums over parts of a window are few values per turn, beside which the other mesh
/// lines fold into the window and beat.
fn windowed(samples: &[f64], per_turn: usize, order: f64, (length, hop): (f64, f64), windows: usize) -> Vec<Complex64> {
    let per_turn = per_turn as f64;
    let of_window = 1.0 / length;
    let sums = [order, order - of_window, order + of_window].map(|order| running_sums(samples, order / per_turn));
    let value = |i: usize| {
        let start = (i as f64 * hop - 0.25 * length) * per_turn;
        let end = start + length * per_turn;
        let range = [start, end].map(|place| (place.ceil().max(0.0) as usize).min(samples.len()));
        let [mid, below, above] = [0, 1, 2].map(|s: usize| sums[s][range[1]] - sums[s][range[0]]);
        // 0.5 - 0.5 cos: the neighbours' phases are those at the window's start.
        let turn = Complex64::from_polar(1.0, TAU * start * of_window / per_turn);
        0.5 * mid - 0.25 * (below * turn.conj() + above * turn)
    };
    (0..windows).map(value).collect()
}

/// Sums of the samples turned back by `cycles` per sample, up to each of them.
pub fn running_sums(samples: &[f64], cycles: f64) -> Vec<Complex64> {
    let mut sums = Vec::with_capacity(samples.len() + 1);
    let mut sum = Complex64::default();
    let step = Complex64::from_polar(1.0, -TAU * cycles);
    let mut turn = Complex64::default();
    sums.push(sum);
    for (i, x) in samples.iter().enumerate() {
        if i % RENEWAL_SAMPLES == 0 {
            turn = Complex64::from_polar(1.0, -TAU * (cycles * i as f64).fract());
        }
        sum += turn * x;
        turn *= step;
        sums.push(sum);
    }
    sums
}

/// Mean square of the values up to `beside` places on either side of each.
pub fn running_power(values: &[Complex64], beside: usize) -> Vec<f64> {
    let mut sums = vec![0.0];
    for value in values {
        sums.push(sums[sums.len() - 1] + value.norm_sqr());
    }
    let mean = |i: usize| {
        let (from, to) = (i.saturating_sub(beside), (i + beside + 1).min(values.len()));
        (sums[to] - sums[from]) / (to - from) as f64
    };
    (0..values.len()).map(mean).collect()
}

/// The departure by the first mesh harmonic alone, followed from window to window, in the channel that shows it best:
/// a tachometer that counts another harmonic's cycles may have lost one. Nothing where no channel shows it clearly.
fn unwrapped(reads: &[Read], mesh_order: f64) -> Option<Vec<f64>> {
    let first = reads.iter().filter(|read| read.order < 1.5 * mesh_order);
    let apart = (WINDOW_TURNS * PER_TURN) as usize;
    let steadiness = |read: &Read| {
        let of = |pair: (&Complex64, &Complex64)| pair.1 * pair.0.conj();
        let together: Complex64 = read.values.iter().zip(read.values.iter().skip(apart)).map(of).sum();
        together.norm() / read.values.iter().skip(apart).map(|v| v.norm_sqr()).sum::<f64>().max(f64::MIN_POSITIVE)
    };
    let (steady, best) = first.map(|read| (steadiness(read), read)).max_by(|a, b| a.0.total_cmp(&b.0))?;
    if steady < MIN_REPEATED_POWER_SHARE {
        return None;
    }
    let mut turns = Vec::with_capacity(best.values.len());
    let (mut phase, mut before) = (0.0, *best.values.first()?);
    for value in &best.values {
        phase += (value * before.conj()).arg();
        before = *value;
        turns.push(phase / (TAU * best.order));
    }
    Some(turns)
}

/// Mean of a line's values with a departure taken out, and what is left beside it.
fn split(read: &Read, turns: &[f64]) -> (Complex64, f64) {
    let turned = || read.values.iter().zip(turns).map(|(v, t)| v * Complex64::from_polar(1.0, -TAU * read.order * t));
    let mean = turned().sum::<Complex64>() / turns.len() as f64;
    (mean, turned().map(|v| (v - mean).norm_sqr()).sum::<f64>() / turns.len() as f64)
}

/// The departure common to all lines that is left.
fn common(reads: &[&Read], turns: &[f64], clear: f64) -> Vec<f64> {
    let (mut up, mut down) = (vec![0.0; turns.len()], vec![1e-300; turns.len()]);
    for read in reads {
        let (mean, left) = split(read, turns);
        if mean.norm_sqr() < clear * left {
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
    /// The departure at a place, level beyond the outer windows.
    fn at(&self, place: f64) -> f64 {
        interpolated(&self.turns, (place - self.first) / self.hop)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_neighbouring_mesh_lines_do_not_beat_with_the_windows() {
        // 20 and 31 teeth: the other lines stand within a window's width of what a coarser sum folds.
        let (per_turn, turns, z, slower) = (500, 100, 20.0, 20.0 / 31.0);
        let line = |i: usize, k: f64| (TAU * k * z * i as f64 / per_turn as f64).cos();
        let samples: Vec<f64> =
            (0..per_turn * turns).map(|i| line(i, 7.0) + line(i, 6.0) + 0.5 * line(i, 8.0)).collect();
        let (length, hop) = (WINDOW_TURNS / slower, 1.0 / (PER_TURN * slower));
        let values = windowed(&samples, per_turn, 7.0 * z, (length, hop), 400);
        let whole = &values[8..392];
        let mean = whole.iter().sum::<Complex64>() / whole.len() as f64;
        assert!((mean.norm() / (0.25 * length * per_turn as f64) - 1.0).abs() < 1e-6);
        let off = whole.iter().map(|v| (v / mean).arg().abs()).fold(0.0, f64::max);
        assert!(off < 1e-5, "{off:e} rad");
    }

    #[test]
    fn theory_a_lost_cycle_of_the_second_harmonic_is_half_a_period_of_the_first() {
        let (per_turn, turns, z, slower) = (200, 150, 20.0, 20.0 / 56.0);
        // Between turns 70 and 80 the angle falls behind by half a period of the mesh, which the second harmonic
        // alone does not see.
        let behind = |turn: f64| 0.5 / z * ((turn - 70.0) / 10.0).clamp(0.0, 1.0);
        let samples: Vec<f64> = (0..per_turn * turns)
            .map(|i| i as f64 / per_turn as f64)
            .map(|turn| TAU * z * (turn + behind(turn)))
            .map(|phase| 0.3 * phase.cos() + (2.0 * phase).cos())
            .collect();
        let (length, hop) = (WINDOW_TURNS / slower, 1.0 / (PER_TURN * slower));
        let read = |k: f64| Read { order: k * z, values: windowed(&samples, per_turn, k * z, (length, hop), 400) };
        let departure = unwrapped(&[read(1.0), read(2.0)], z).expect("a clear first harmonic");
        let at = |turn: f64| departure[((turn - 0.25 * length) / hop) as usize];
        assert!((at(120.0) - at(40.0) - 0.5 / z).abs() < 1e-3 / z, "{} {}", at(40.0), at(120.0));
        assert!((at(60.0) - at(40.0)).abs() < 1e-3 / z);
        assert!(unwrapped(&[read(2.0)], z).is_none());
    }
}
