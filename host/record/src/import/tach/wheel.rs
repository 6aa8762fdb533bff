//! The places of a wheel's marks, learned from many turns and taken out of the edge times.
//!
//! A mark that stands a share d of the pitch behind its place passes d pitch times late. The mean of the edge times
//! over one whole turn holds no d at all, because the places of all marks add up to the turn: it is the smooth curve
//! against which the marks are seen. Taken twice, it follows a speed whose rate of change itself changes linearly
//! over two turns; what is left of each edge is averaged per mark over all turns, which is least squares with one
//! constant per mark and a smooth curve of few parameters per turn. Diamond, Heyns and Oberholster (2016) solve the
//! same problem by Bayesian regression with speed polynomials per turn and the sum of the places fixed; turns of a
//! wandering speed count alike there.
//!
//! How good the places are is measured twice: even and odd turns give them separately, and half the difference is
//! the error of their mean; so is the scatter of a mark from turn to turn over the root of the turns. The larger
//! counts. The places are taken out only where they stand above it by more than chance.
//!
//! Limits: what is locked to the wheel's shaft (a swing of the speed once per turn, torsional vibration at a whole
//! order) moves the edges as the marks do, cannot be told from them, and goes with them.

use serde::Serialize;

/// Turns needed: four for either half.
const LEAST_TURNS: usize = 8;
/// Standard deviations (of a chi-square with a degree per mark but one) by which the places must stand above their
/// error.
const MIN_PLACE_DEVIATIONS: f64 = 4.0;
/// Edges farther from their mark's mean than this many standard deviations are left out of the second mean.
const OUTLIER: f64 = 5.0;

/// A wheel's marks, as learned from one run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Wheel {
    /// Place of each mark behind its even place, shares of the pitch, in the order in which they pass; their sum is
    /// 0. Mark 0 is that of the run's first pulse.
    pub places: Vec<f64>,
    /// Their root mean square, per cent of the pitch.
    pub irregularity_percent: f64,
    /// The largest of them, per cent of the pitch.
    pub largest_percent: f64,
    /// Error of the places, root mean square, per cent of the pitch. It is what remains where they were taken out.
    pub remaining_percent: f64,
    /// Turns learned from.
    pub turns: usize,
    /// Whether they were taken out of the edge times.
    pub removed: bool,
}

/// Turn, mark, and lateness in shares of the pitch.
type Pulse = (usize, usize, f64);

/// Learns the places of `marks` marks from pulses that are all counted; `measured` tells those that were not put in.
///
/// The first pulse is mark `first % marks`. `None` where there are too few turns.
pub(super) fn learn(times_s: &[f64], measured: &[bool], marks: usize, first: usize) -> Option<Wheel> {
    if marks < 2 || times_s.len() < (LEAST_TURNS + 2) * marks + 1 {
        return None;
    }
    let late = lateness(times_s, marks);
    // Every pulse that has a whole turn at either side.
    let seen: Vec<Pulse> = (marks..times_s.len() - marks)
        .filter(|&k| measured[k])
        .map(|k| ((k - marks) / marks, (k + first) % marks, late[k]))
        .collect();
    let rough = means(&seen, marks, |_| true)?;
    let scatter = |from: &[f64], counts: &dyn Fn(&Pulse) -> bool| {
        let off: Vec<f64> = seen.iter().filter(|s| counts(s)).map(|s| s.2 - from[s.1]).collect();
        root_mean_square(&off)
    };
    let spread = scatter(&rough, &|_| true);
    let near = |s: &Pulse| (s.2 - rough[s.1]).abs() <= OUTLIER * spread;
    let places = means(&seen, marks, near)?;
    let even = means(&seen, marks, |s| near(s) && s.0 % 2 == 0)?;
    let odd = means(&seen, marks, |s| near(s) && s.0 % 2 == 1)?;
    let halves: Vec<f64> = even.iter().zip(&odd).map(|(a, b)| 0.5 * (a - b)).collect();
    let turns = (times_s.len() - 2 * marks) / marks;
    let irregularity = root_mean_square(&places);
    let remaining = root_mean_square(&halves).max(scatter(&places, &near) / (turns as f64).sqrt());
    let by_chance = 1.0 + MIN_PLACE_DEVIATIONS * (2.0 / (marks - 1) as f64).sqrt();
    Some(Wheel {
        irregularity_percent: 100.0 * irregularity,
        largest_percent: 100.0 * places.iter().fold(0.0, |most, d| f64::max(most, d.abs())),
        remaining_percent: 100.0 * remaining,
        turns,
        removed: irregularity > remaining * by_chance.sqrt(),
        places,
    })
}

impl Wheel {
    /// The times at which evenly placed marks would have passed.
    pub(super) fn corrected(&self, times_s: &[f64], first: usize) -> Vec<f64> {
        let marks = self.places.len();
        let pitch = pitches_s(times_s, marks);
        (0..times_s.len()).map(|k| times_s[k] - self.places[(k + first) % marks] * pitch[k]).collect()
    }

    /// Mark of `reference` that this wheel's mark 0 is, where one place fits much better than every other.
    pub(super) fn mark_of(&self, reference: &Wheel) -> Option<usize> {
        let marks = self.places.len();
        if !(self.removed && reference.removed && reference.places.len() == marks) {
            return None;
        }
        let apart = |shift: usize| {
            let pairs = self.places.iter().enumerate().map(|(m, d)| d - reference.places[(m + shift) % marks]);
            root_mean_square(&pairs.collect::<Vec<_>>())
        };
        let mut shifts: Vec<(f64, usize)> = (0..marks).map(|shift| (apart(shift), shift)).collect();
        shifts.sort_by(|a, b| a.0.total_cmp(&b.0));
        (shifts[0].0 < 0.5 * shifts[1].0).then_some(shifts[0].1)
    }
}

/// How late every pulse is against the smooth curve, in shares of the pitch; 0 within a turn of the ends.
fn lateness(times_s: &[f64], marks: usize) -> Vec<f64> {
    let n = times_s.len();
    // Without the mean speed the sums stay small and exact.
    let step = (times_s[n - 1] - times_s[0]) / (n - 1) as f64;
    let even: Vec<f64> = times_s.iter().enumerate().map(|(k, t)| t - times_s[0] - step * k as f64).collect();
    let once = less_turn_mean(&even, marks);
    let reach = marks / 2;
    let mut twice = less_turn_mean(&once[reach..n - reach], marks);
    twice.splice(0..0, vec![0.0; reach]);
    twice.resize(n, 0.0);
    twice.iter().zip(pitches_s(times_s, marks)).map(|(late, pitch)| late / pitch).collect()
}

/// Values less their mean over the turn around them; 0 within half a turn of the ends.
fn less_turn_mean(values: &[f64], marks: usize) -> Vec<f64> {
    let mut sums = vec![0.0];
    for value in values {
        sums.push(sums[sums.len() - 1] + value);
    }
    let (reach, even) = (marks / 2, marks.is_multiple_of(2));
    let mean = |k: usize| {
        let inner = sums[k + reach] - sums[k - reach + usize::from(even)];
        // An even number of marks: the first and the last count half.
        let ends = if even { 0.5 * (values[k - reach] + values[k + reach]) } else { values[k + reach] };
        (inner + ends) / marks as f64
    };
    let inside = reach..values.len().saturating_sub(reach);
    (0..values.len()).map(|k| if inside.contains(&k) { values[k] - mean(k) } else { 0.0 }).collect()
}

/// Time of one even pitch at every pulse: a turn around it over the marks.
fn pitches_s(times_s: &[f64], marks: usize) -> Vec<f64> {
    let n = times_s.len();
    let turn = |k: usize| {
        let from = k.saturating_sub(marks / 2).min(n - 1 - marks);
        (times_s[from + marks] - times_s[from]) / marks as f64
    };
    (0..n).map(turn).collect()
}

/// Mean per mark of the pulses that `counts`, less the mean of all marks; 0 for a mark that is never there, `None`
/// where none was seen.
fn means(seen: &[Pulse], marks: usize, counts: impl Fn(&Pulse) -> bool) -> Option<Vec<f64>> {
    let mut sums = vec![(0.0, 0.0); marks];
    for pulse in seen.iter().filter(|pulse| counts(pulse)) {
        sums[pulse.1].0 += pulse.2;
        sums[pulse.1].1 += 1.0;
    }
    let seen: Vec<f64> = sums.iter().filter(|(_, count)| *count > 0.0).map(|(sum, count)| sum / count).collect();
    let mean = seen.iter().sum::<f64>() / seen.len() as f64;
    let place = |(sum, count): &(f64, f64)| if *count > 0.0 { sum / count - mean } else { 0.0 };
    mean.is_finite().then(|| sums.iter().map(place).collect())
}

fn root_mean_square(values: &[f64]) -> f64 {
    (values.iter().map(|x| x * x).sum::<f64>() / values.len() as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// Places of a wheel, shares of the pitch, with their sum 0.
    fn places(marks: usize) -> Vec<f64> {
        let raw: Vec<f64> = (0..marks).map(|m| 0.004 * (7.1 * (m * m) as f64).sin()).collect();
        let mean = raw.iter().sum::<f64>() / marks as f64;
        raw.iter().map(|d| d - mean).collect()
    }

    /// Pulses of a speed of 25 turns/s that grows, swings by 1 % at 0.83 Hz and by 0.2 % at 3.1 Hz.
    fn pulses(places: &[f64], turns: usize, growth_hz_per_s: f64) -> Vec<f64> {
        let turns_at = |t: f64| {
            let swing = |share: f64, hz: f64| share * 25.0 / (TAU * hz) * (TAU * hz * t).sin();
            25.0 * t + 0.5 * growth_hz_per_s * t * t + swing(0.01, 0.83) + swing(0.002, 3.1)
        };
        let passes = |k: usize| {
            let angle = (k as f64 + places[k % places.len()]) / places.len() as f64;
            let mut t = 0.0;
            for _ in 0..60 {
                t += (angle - turns_at(t)) / (25.5 + growth_hz_per_s * t);
            }
            t
        };
        (0..turns * places.len()).map(passes).collect()
    }

    #[test]
    fn theory_places_are_learned_to_a_hundredth_of_what_they_are() {
        for (marks, growth) in [(2, 0.0), (7, 0.0), (60, 0.0), (7, 3.0), (60, 3.0)] {
            let truth = places(marks);
            let times = pulses(&truth, 200, growth);
            let wheel = learn(&times, &vec![true; times.len()], marks, 0).expect("turns");
            let error: Vec<f64> = wheel.places.iter().zip(&truth).map(|(a, b)| a - b).collect();
            assert!(root_mean_square(&error) < 0.01 * root_mean_square(&truth), "{marks}: {error:?}");
            assert!(wheel.removed, "{wheel:?}");
            let even = pulses(&vec![0.0; marks], 200, growth);
            let pitch = 0.04 / marks as f64;
            let worst = wheel.corrected(&times, 0).iter().zip(&even).fold(0.0, |w, (a, b)| f64::max(w, (a - b).abs()));
            assert!(worst < 2e-4 * pitch, "{marks}: {worst} of {pitch}");
        }
    }

    #[test]
    fn theory_a_wheel_is_told_by_its_marks_wherever_a_run_begins() {
        let times = pulses(&places(24), 60, 0.0);
        let all = vec![true; times.len()];
        let (first, later) = (learn(&times, &all, 24, 0), learn(&times[31..], &all[31..], 24, 0));
        let (first, later) = (first.expect("turns"), later.expect("turns"));
        assert_eq!(later.mark_of(&first), Some(7));
    }

    #[test]
    fn theory_an_even_wheel_is_left_alone_and_few_turns_teach_nothing() {
        let mut times = pulses(&[0.0; 8], 100, 0.0);
        // Jitter from a small generator.
        let mut state = 1_u64;
        for t in &mut times {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            *t += 1e-6 * ((state >> 40) as f64 / f64::from(1_u32 << 24) - 0.5);
        }
        let all = vec![true; times.len()];
        assert!(!learn(&times, &all, 8, 0).expect("turns").removed);
        assert!(learn(&times[..79], &all, 8, 0).is_none());
    }
}
