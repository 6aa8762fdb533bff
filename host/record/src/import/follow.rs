//! A mesh frequency that changes: followed through short spectra by all its harmonics at once.
//!
//! One line alone is lost where it crosses a resonance or another line. Each time slice therefore gives every
//! possible mesh frequency the sum of what stands at its harmonics, over the local floor, in dB (less half of what
//! stands halfway between: those are harmonics of half the frequency), over all channels; the course is the path
//! through the slices that gathers most, changes of speed paid for (dynamic programming; Leclere, Andre and Antoni
//! 2016 multiply probabilities of all expected orders per slice and smooth over time, which is the same in
//! logarithms). Slices last a few turns of the pinion: longer ones smear a changing line, shorter ones cannot tell
//! lines apart.
//!
//! The result is rough (a few tenths of a per cent); the signal read at the angle it gives is steady enough for
//! longer slices, and then for the phase of the lines. Cost: one transform of some ten thousand points per slice and
//! channel.

use crate::budget::VALUES;
use crate::spectral::{AngleMap, Window, resample_by_angle};
use crate::{Error, Result};
use rayon::prelude::*;
use realfft::RealFftPlanner;
use std::sync::Arc;

/// Harmonics that count.
const HARMONICS: u32 = 6;
/// Most and least that one line counts, dB.
const CAP_DB: f64 = 30.0;
const LEAST_DB: f64 = -5.0;
/// Zeros added to a slice, in its length: bins closer than lines are wide.
const PADDING: usize = 4;
/// Slices that begin within one slice's length.
const OVERLAP: usize = 4;
/// Change of speed that costs half a unit per slice, share per second; a unit is 10 dB in one line.
const USUAL_CHANGE_PER_S: f64 = 0.15;
/// Largest change of speed, share per second.
const MOST_CHANGE_PER_S: f64 = 1.5;
/// Floor: median within this share of the mesh frequency to either side.
const FLOOR_REACH: f64 = 0.75;
/// Points per turn of the map from angle to time.
const POINTS_PER_TURN: u32 = 2;
/// Fewest slices that make a course.
const MIN_SLICES: usize = 8;
/// Slices of both passes, turns of the pinion, and the steps of the mesh frequency, shares of it.
const PASSES: [(f64, f64); 2] = [(3.0, 1e-3), (10.0, 2e-4)];
/// What the first pass may be off by, which the second one searches.
const FIRST_PASS_ERROR_SHARE: f64 = 0.012;

/// Channels read at the angle of a rough course.
pub(super) struct Followed {
    /// Channels at equal angles of the pinion.
    pub channels: Vec<Vec<f64>>,
    /// Their samples per second if the mesh stood at `mesh_hz`.
    pub rate_hz: f64,
    /// Mean mesh frequency of the course.
    pub mesh_hz: f64,
    map: AngleMap,
    from_turn: f64,
    teeth: f64,
}

impl Followed {
    /// Time in the record, s, of a time in the channels at equal angles.
    pub fn time_s(&self, steady_s: f64) -> f64 {
        self.map.time_at(self.from_turn + steady_s * self.mesh_hz / self.teeth)
    }
}

/// Follows a mesh frequency that stays within `range_hz`.
///
/// # Errors
/// A record too short, or too slow a rate, for the slices.
pub(super) fn follow(
    place: &str,
    channels: &[Vec<f64>],
    rate_hz: f64,
    pinion_teeth: u32,
    range_hz: [f64; 2],
) -> Result<Followed> {
    let teeth = f64::from(pinion_teeth);
    let mut range_hz = range_hz;
    let mut known: Option<Followed> = None;
    for (turns, step) in PASSES {
        let (seen, seen_hz) = known.as_ref().map_or((channels, rate_hz), |f| (&f.channels[..], f.rate_hz));
        let slices = Slices::new(place, seen, seen_hz, turns * teeth / range_hz[0])?;
        let places = slices.count as f64 * ((range_hz[1] / range_hz[0]).ln() / step).ceil();
        VALUES.check(place, places, "narrow the range of --mesh, or cut the record into parts")?;
        let course = slices.course(seen, range_hz, step);
        let duration_s = seen[0].len() as f64 / seen_hz;
        let mut edges_s = even_turns(&course, duration_s, teeth);
        if let Some(before) = &known {
            edges_s.iter_mut().for_each(|t| *t = before.time_s(*t));
        }
        let Some(map) = AngleMap::new(&edges_s, POINTS_PER_TURN, 0.0) else {
            return Err(Error::impossible(place, "too short to follow the mesh frequency"));
        };
        let followed = at_equal_angles(channels, rate_hz, map, teeth);
        range_hz =
            [(1.0 - FIRST_PASS_ERROR_SHARE) * followed.mesh_hz, (1.0 + FIRST_PASS_ERROR_SHARE) * followed.mesh_hz];
        known = Some(followed);
    }
    known.ok_or_else(|| Error::impossible(place, "no pass over the mesh frequency"))
}

fn at_equal_angles(channels: &[Vec<f64>], rate_hz: f64, map: AngleMap, teeth: f64) -> Followed {
    let end_s = (channels[0].len() - 1) as f64 / rate_hz;
    let (from_turn, to_turn) = (map.turns_at(0.0), map.turns_at(end_s));
    let slowest_hz = map.speeds_hz().into_iter().fold(f64::INFINITY, f64::min);
    let per_turn = (rate_hz / slowest_hz).ceil() as usize;
    let turns = (to_turn - from_turn).floor() as usize;
    let read = |channel: &Vec<f64>| resample_by_angle(channel, rate_hz, &map, from_turn, turns, per_turn);
    let mesh_hz = teeth * (to_turn - from_turn) / end_s;
    let rate_of_angle = per_turn as f64 * mesh_hz / teeth;
    let channels = channels.par_iter().map(read).collect();
    Followed { channels, rate_hz: rate_of_angle, mesh_hz, map, from_turn, teeth }
}

/// Times at which the pinion has turned by [`POINTS_PER_TURN`] equal parts, from a course of (time, mesh frequency).
fn even_turns(course: &[(f64, f64)], duration_s: f64, teeth: f64) -> Vec<f64> {
    let at = |t: f64| {
        let i = course.partition_point(|p| p.0 <= t).clamp(1, course.len() - 1);
        let ((t0, f0), (t1, f1)) = (course[i - 1], course[i]);
        f0 + (f1 - f0) * ((t - t0) / (t1 - t0)).clamp(0.0, 1.0)
    };
    let part = teeth / f64::from(POINTS_PER_TURN);
    let (mut t, mut times) = (0.0, vec![0.0]);
    while t < duration_s {
        // The midpoint rule on a course that is straight over half a turn.
        let half = 0.5 * part / at(t);
        t += part / at(t + half);
        times.push(t);
    }
    times
}

/// Short spectra of a record.
struct Slices {
    rate_hz: f64,
    length: usize,
    hop: usize,
    count: usize,
}

impl Slices {
    fn new(place: &str, channels: &[Vec<f64>], rate_hz: f64, length_s: f64) -> Result<Self> {
        let samples = channels.first().map_or(0, Vec::len);
        let length = (length_s * rate_hz).round() as usize;
        let hop = (length / OVERLAP).max(1);
        if length < 64 || samples < length + MIN_SLICES * hop {
            let what = format!("{:.2} s are too short to follow the mesh frequency", samples as f64 / rate_hz);
            return Err(Error::impossible(place, what));
        }
        Ok(Self { rate_hz, length, hop, count: (samples - length) / hop + 1 })
    }

    fn time_s(&self, slice: usize) -> f64 {
        (slice * self.hop) as f64 / self.rate_hz + 0.5 * self.length as f64 / self.rate_hz
    }

    /// The best course within `range_hz`, on a grid of equal ratios.
    fn course(&self, channels: &[Vec<f64>], range_hz: [f64; 2], step: f64) -> Vec<(f64, f64)> {
        let states = ((range_hz[1] / range_hz[0]).ln() / step).ceil() as usize + 1;
        let grid: Vec<f64> = (0..states).map(|i| range_hz[0] * (step * i as f64).exp()).collect();
        let total = (PADDING * self.length).next_power_of_two();
        let window = Window::Hann.weights(self.length);
        let plan = RealFftPlanner::<f64>::new().plan_fft_forward(total);
        let scores: Vec<Vec<f64>> = (0..self.count)
            .into_par_iter()
            .map(|slice| {
                let mut sum = vec![0.0; states];
                for channel in channels {
                    let part = &channel[slice * self.hop..][..self.length];
                    let excess = excess_db(part, &window, &plan, total, range_hz[0] * total as f64 / self.rate_hz);
                    for (sum, hz) in sum.iter_mut().zip(&grid) {
                        *sum += score(&excess, hz * total as f64 / self.rate_hz) / channels.len() as f64;
                    }
                }
                sum
            })
            .collect();
        let path = best_path(&scores, self.hop as f64 / self.rate_hz, step);
        path.iter().enumerate().map(|(i, state)| (self.time_s(i), range_hz[0] * (step * state).exp())).collect()
    }
}

/// Spectrum of one slice over its floor, dB.
fn excess_db(
    part: &[f64],
    window: &[f64],
    plan: &Arc<dyn realfft::RealToComplex<f64>>,
    total: usize,
    mesh_bins: f64,
) -> Vec<f64> {
    let mut signal = vec![0.0; total];
    let mean = part.iter().sum::<f64>() / part.len() as f64;
    signal.iter_mut().zip(part).zip(window).for_each(|((s, x), w)| *s = (x - mean) * w);
    let mut spectrum = plan.make_output_vec();
    plan.process(&mut signal, &mut spectrum).expect("matching lengths");
    let power: Vec<f64> = spectrum.iter().map(|z| z.norm_sqr().max(f64::MIN_POSITIVE)).collect();
    let reach = ((FLOOR_REACH * mesh_bins) as usize).max(4);
    let hop = (reach / 2).max(1);
    let floors: Vec<f64> = (0..=power.len() / hop)
        .map(|i| {
            let mut near = power[(i * hop).saturating_sub(reach)..(i * hop + reach + 1).min(power.len())].to_vec();
            let middle = near.len() / 2;
            *near.select_nth_unstable_by(middle, f64::total_cmp).1
        })
        .collect();
    let over = |(i, power): (usize, &f64)| {
        (10.0 * (power / floors[((i + hop / 2) / hop).min(floors.len() - 1)]).log10()).clamp(LEAST_DB, CAP_DB)
    };
    power.iter().enumerate().map(over).collect()
}

/// What stands at the harmonics of a mesh frequency given in bins, units of 10 dB.
fn score(excess: &[f64], bins: f64) -> f64 {
    let at = |bins: f64| excess.get(bins.round() as usize).copied();
    let most = 0.9 * excess.len() as f64;
    let harmonics = (1..=HARMONICS).map(f64::from).take_while(|h| h * bins < most);
    harmonics.filter_map(|h| Some(0.1 * (at(h * bins)? - 0.5 * at((h - 0.5) * bins)?.max(0.0)))).sum()
}

/// The path through `scores` (slices x states) that gathers most, as places between states.
fn best_path(scores: &[Vec<f64>], hop_s: f64, step: f64) -> Vec<f64> {
    let states = scores[0].len();
    let most = ((MOST_CHANGE_PER_S * hop_s / step).ceil() as usize).clamp(1, states);
    let cost: Vec<f64> = (0..=most).map(|d| 0.5 * (d as f64 * step / hop_s / USUAL_CHANGE_PER_S).powi(2)).collect();
    let mut gathered = scores[0].clone();
    let mut before: Vec<Vec<u32>> = Vec::with_capacity(scores.len());
    for own in &scores[1..] {
        let from = |state: usize| {
            let near = state.saturating_sub(most)..(state + most + 1).min(states);
            let values = near.map(|other| (other, gathered[other] - cost[other.abs_diff(state)]));
            values.fold((state, f64::NEG_INFINITY), |best, value| if value.1 > best.1 { value } else { best })
        };
        let steps: Vec<(usize, f64)> = (0..states).into_par_iter().map(from).collect();
        before.push(steps.iter().map(|s| s.0 as u32).collect());
        gathered = steps.iter().zip(own).map(|(s, own)| s.1 + own).collect();
    }
    let mut state = (0..states).max_by(|a, b| gathered[*a].total_cmp(&gathered[*b])).unwrap_or(0);
    let mut path = vec![state];
    for steps in before.iter().rev() {
        state = steps[state] as usize;
        path.push(state);
    }
    path.reverse();
    smooth(path.iter().zip(scores).map(|(state, own)| between(own, *state)).collect())
}

/// Crest of the parabola through a state and its neighbours.
fn between(scores: &[f64], state: usize) -> f64 {
    let (Some(below), Some(above)) = (state.checked_sub(1).map(|i| scores[i]), scores.get(state + 1)) else {
        return state as f64;
    };
    let bend = below - 2.0 * scores[state] + above;
    let off = if bend < 0.0 { 0.5 * (below - above) / bend } else { 0.0 };
    state as f64 + off.clamp(-0.5, 0.5)
}

/// Means over five slices, straight on at the ends: slices overlap, so neighbours know the same.
fn smooth(path: Vec<f64>) -> Vec<f64> {
    let last = path.len() - 1;
    let mean = |i: usize| {
        let reach = 2.min(i).min(last - i);
        path[i - reach..=i + reach].iter().sum::<f64>() / (2 * reach + 1) as f64
    };
    (0..path.len()).map(mean).collect()
}
