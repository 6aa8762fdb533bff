//! Lost and doubled pulses: found against the pulses around them, repaired where only one reading fits.
//!
//! The period at a pulse is the median line (Theil and Sen) through the logarithms of the fifteen intervals around
//! it, which a few wrong ones do not move, and which follows a run-up. From a pulse that counts, the next one that
//! lies a whole number of periods ahead counts, too; what lies between them is too many, whole periods without a
//! pulse are too few. Both are repaired where the speed is steady and the number of periods cannot be another one; a
//! pulse put in lies on the cubic through its neighbours. Everything else is left as it is and said: behind such a
//! place the count of pulses, and with it the angle, may be off.
//!
//! What a record holds is read in the same way as what is imported: this is the one place of it.
//!
//! Limits: a pulse lost or doubled before the first or behind the last that counts is not seen; two faults that make
//! up for each other in one period (a pulse moved to a place where it could be) are a moved pulse, left in place.

use crate::spectral::through;
use serde::Serialize;

/// Intervals to either side from which the period is taken.
const REACH: usize = 7;
/// Two intervals that differ from the one before by less count without further question.
const ALIKE: f64 = 0.03;
/// A pulse counts within five standard deviations of the intervals of a whole number of periods, and within no more
/// than this share of a period.
const MOST_OFF: f64 = 0.2;
/// No less than this share is allowed: one mark per turn is always at the same place, several may be uneven.
const LEAST_OFF: [f64; 2] = [0.05, 0.15];
/// Scatter of the intervals around, over the period, up to which the speed is steady; with one mark, and with several.
const STEADY: [f64; 2] = [0.03, 0.08];
/// Change of speed per pulse up to which it is steady.
const STEADY_CHANGE: f64 = 0.05;
/// What the speed may do from one pulse to the next within a gap without being seen, at least.
const UNSEEN: f64 = 0.002;
/// Most that a period may be off in sum over a gap whose pulses are counted.
const COUNTABLE: f64 = 0.15;

/// Pulses that were lost, doubled or out of step at one place.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Place {
    /// Time of the last pulse that counted, s from the first sample.
    pub time_s: f64,
    /// How many pulses.
    pub pulses: usize,
}

/// Pulses in order, repaired where that is unambiguous.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Pulses {
    /// Times, s, ascending.
    pub times_s: Vec<f64>,
    /// Whether the pulse was measured, or put in.
    pub measured: Vec<bool>,
    /// Pulses put in.
    pub lost: Vec<Place>,
    /// Pulses taken out.
    pub doubled: Vec<Place>,
    /// Pulses out of step, left as they are.
    pub irregular: Vec<Place>,
    /// Indices of pulses behind which the count is not sure.
    pub breaks: Vec<usize>,
}

/// Counts the pulses of at least one edge at `edges_s` (s, ascending), of a wheel with one mark or with several.
///
/// # Panics
/// Without any edge.
pub fn counted(edges_s: &[f64], several_marks: bool) -> Pulses {
    let n = edges_s.len();
    let Some(start) = (0..n.saturating_sub(2)).find(|&i| is_regular(edges_s, i, several_marks)) else {
        let irregular = vec![Place { time_s: edges_s[0], pulses: n }];
        let breaks = (0..n).collect();
        return Pulses { times_s: edges_s.to_vec(), measured: vec![true; n], irregular, breaks, ..Pulses::default() };
    };
    let mut pulses = Walk::new(edges_s, start, several_marks).run();
    if start > 0 {
        // The pulses before the first regular one, walked backwards.
        let backwards: Vec<f64> = edges_s.iter().rev().map(|t| -t).collect();
        let ahead = Walk::new(&backwards, n - 1 - start, several_marks).run();
        pulses.put_before(ahead);
    }
    fill(&mut pulses);
    pulses
}

impl Pulses {
    /// Median time from one pulse to the next, s; 0 of fewer than two.
    pub fn median_interval_s(&self) -> f64 {
        median(self.times_s.windows(2).map(|w| w[1] - w[0]).collect())
    }

    /// Joins what was walked backwards from this one's first pulse.
    fn put_before(&mut self, ahead: Pulses) {
        let added = ahead.times_s.len() - 1;
        let turned = |places: Vec<Place>| places.into_iter().rev().map(|p| Place { time_s: -p.time_s, ..p });
        self.times_s.splice(0..0, ahead.times_s[1..].iter().rev().map(|t| -t));
        self.measured.splice(0..0, ahead.measured[1..].iter().rev().copied());
        self.lost.splice(0..0, turned(ahead.lost));
        self.doubled.splice(0..0, turned(ahead.doubled));
        self.irregular.splice(0..0, turned(ahead.irregular));
        self.breaks.iter_mut().for_each(|index| *index += added);
        self.breaks.splice(0..0, ahead.breaks.into_iter().rev().map(|index| (added - index).saturating_sub(1)));
    }

    /// Pulses left although they are out of step.
    pub fn out_of_step(&self) -> usize {
        self.irregular.iter().map(|place| place.pulses).sum()
    }

    /// Longest stretch of pulses whose count is sure, as a range of indices.
    pub fn longest_stretch(&self) -> std::ops::Range<usize> {
        let ends = self.breaks.iter().map(|index| index + 1).chain([self.times_s.len()]);
        let mut from = 0;
        let stretches = ends.map(|end| {
            let stretch = from..end.max(from);
            from = end.max(from);
            stretch
        });
        stretches.max_by_key(ExactSizeIterator::len).unwrap_or(0..0)
    }
}

/// Whether the two intervals behind pulse `i` are as long as those around say.
fn is_regular(edges_s: &[f64], i: usize, several_marks: bool) -> bool {
    let period = Period::around(edges_s, i, several_marks);
    let near = |a: usize| ((edges_s[a + 1] - edges_s[a]) / period.length_s - 1.0).abs() < period.tolerance();
    near(i) && near(i + 1)
}

/// Period at a pulse.
struct Period {
    length_s: f64,
    /// Relative change per interval.
    change: f64,
    /// Standard deviation of the intervals around over the period.
    scatter: f64,
    /// Whether the marks of a wheel add to that.
    several_marks: bool,
}

impl Period {
    /// Of the interval that begins at pulse `at`.
    fn around(edges_s: &[f64], at: usize, several_marks: bool) -> Self {
        let last = edges_s.len() - 2;
        let from = at.saturating_sub(REACH).min(last.saturating_sub(2 * REACH));
        let to = (at + REACH).max(2 * REACH).min(last);
        let logs: Vec<(f64, f64)> =
            (from..=to).map(|i| (i as f64 - at as f64, (edges_s[i + 1] - edges_s[i]).ln())).collect();
        let mut slopes = Vec::new();
        for (i, a) in logs.iter().enumerate() {
            slopes.extend(logs[i + 1..].iter().map(|b| (b.1 - a.1) / (b.0 - a.0)));
        }
        let slope = median(slopes);
        let middle = median(logs.iter().map(|p| p.1 - slope * p.0).collect());
        let away = logs.iter().map(|p| (p.1 - slope * p.0 - middle).abs()).collect();
        Self { length_s: middle.exp(), change: slope, scatter: 1.4826 * median(away), several_marks }
    }

    /// Share of a period within which a pulse is in its place.
    fn tolerance(&self) -> f64 {
        (5.0 * self.scatter).clamp(LEAST_OFF[usize::from(self.several_marks)], MOST_OFF)
    }

    /// Whole periods nearest to a time ahead, and how far it is from there, in periods.
    fn whole(&self, ahead_s: f64) -> (usize, f64) {
        let (mut reached, mut length, mut count) = (0.0, self.length_s, 0);
        while ahead_s - reached > 0.5 * length && count < 10_000 {
            reached += length;
            // Beyond the reach of the line the last period stands.
            length *= if count < REACH { self.change.exp() } else { 1.0 };
            count += 1;
        }
        (count, (ahead_s - reached) / length)
    }

    /// Whether the pulses of a gap of `count` periods can be counted.
    fn counts(&self, count: usize) -> bool {
        let steady = self.scatter <= STEADY[usize::from(self.several_marks)] && self.change.abs() <= STEADY_CHANGE;
        steady && count as f64 * (self.scatter / 3.0).max(UNSEEN) <= COUNTABLE
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Goes from pulse to pulse.
struct Walk<'a> {
    edges_s: &'a [f64],
    at: usize,
    several_marks: bool,
    pulses: Pulses,
}

impl<'a> Walk<'a> {
    fn new(edges_s: &'a [f64], from: usize, several_marks: bool) -> Self {
        let pulses = Pulses { times_s: vec![edges_s[from]], measured: vec![true], ..Pulses::default() };
        Self { edges_s, at: from, several_marks, pulses }
    }

    fn run(mut self) -> Pulses {
        let mut before: Option<f64> = None;
        while self.at + 1 < self.edges_s.len() {
            let ahead = self.edges_s[self.at..].windows(2).take(2).map(|w| w[1] - w[0]);
            if before.is_some_and(|before| ahead.clone().all(|interval| (interval / before - 1.0).abs() < ALIKE)) {
                before = ahead.clone().next();
                self.take(self.at + 1);
                continue;
            }
            let period = Period::around(self.edges_s, self.at, self.several_marks);
            before = Some(period.length_s);
            self.step(&period);
        }
        self.pulses
    }

    /// From the pulse that counts to the next one that does.
    fn step(&mut self, period: &Period) {
        let Some((next, count)) = self.next_in_place(period) else {
            self.leave_counted(self.at + 1, false);
            return;
        };
        let (between, missing) = (next - self.at - 1, count - 1);
        if between == 0 && missing == 0 {
            self.take(next);
            return;
        }
        let sure = period.counts(count) && self.goes_on(next, period);
        if !sure || (between > 0 && missing > 0) {
            // As many pulses as periods: some are moved, but the count holds.
            self.leave_counted(next, sure && between == missing);
            return;
        }
        let here = self.edges_s[self.at];
        if between > 0 {
            self.pulses.doubled.push(Place { time_s: here, pulses: between });
        }
        if missing > 0 {
            self.pulses.lost.push(Place { time_s: here, pulses: missing });
            // Their times follow when the pulses behind the gap are known.
            let step = (self.edges_s[next] - here) / count as f64;
            self.pulses.times_s.extend((1..count).map(|i| here + step * i as f64));
            self.pulses.measured.resize(self.pulses.times_s.len(), false);
        }
        self.take(next);
    }

    /// The next edge a whole number of periods ahead, the best of those near the same place, and that number.
    fn next_in_place(&self, period: &Period) -> Option<(usize, usize)> {
        let ahead = |index: usize| period.whole(self.edges_s[index] - self.edges_s[self.at]);
        let fits = |index: usize| {
            let (count, off) = ahead(index);
            (count > 0 && off.abs() <= period.tolerance()).then_some((index, count, off.abs()))
        };
        let edges = self.at + 1..self.edges_s.len().min(self.at + 2 + 2 * REACH);
        let (index, count, off) = edges.clone().find_map(fits)?;
        let rivals = edges.skip_while(|other| *other <= index).map_while(fits).take_while(|rival| rival.1 == count);
        let best = rivals.fold((index, off), |best, rival| if rival.2 < best.1 { (rival.0, rival.2) } else { best });
        Some((best.0, count))
    }

    /// Whether the pulses go on in step behind `next`: some edge lies one period ahead, or the record ends.
    fn goes_on(&self, next: usize, period: &Period) -> bool {
        let Some(last) = self.edges_s.last() else { return false };
        let one = |t: &f64| ((t - self.edges_s[next]) / period.length_s - 1.0).abs() <= 2.0 * period.tolerance();
        self.edges_s[next + 1..].iter().take(REACH).any(one) || last - self.edges_s[next] < period.length_s
    }

    fn take(&mut self, index: usize) {
        self.pulses.times_s.push(self.edges_s[index]);
        self.pulses.measured.push(true);
        self.at = index;
    }

    /// Takes the edges up to `index` as they are and says so; whether their count holds all the same.
    fn leave_counted(&mut self, index: usize, counted: bool) {
        let here = self.pulses.times_s.len() - 1;
        let time_s = self.edges_s[self.at];
        let pulses = index - self.at;
        match self.pulses.irregular.last_mut().filter(|_| self.pulses.breaks.last().is_some_and(|b| b + 1 == here)) {
            Some(place) => place.pulses += pulses,
            None => self.pulses.irregular.push(Place { time_s, pulses }),
        }
        for edge in self.at + 1..=index {
            if !counted {
                self.pulses.breaks.push(self.pulses.times_s.len() - 1);
            }
            self.pulses.times_s.push(self.edges_s[edge]);
            self.pulses.measured.push(true);
        }
        self.at = index;
    }
}

/// Puts the pulses that were not measured on the cubic through the two measured ones at either side.
pub fn fill(pulses: &mut Pulses) {
    let measured: Vec<usize> = (0..pulses.times_s.len()).filter(|&i| pulses.measured[i]).collect();
    for gap in measured.windows(2).enumerate().filter(|(_, pair)| pair[1] > pair[0] + 1) {
        let (position, pair) = gap;
        let from = position.saturating_sub(1).min(measured.len().saturating_sub(4));
        let nodes = &measured[from..(from + 4).min(measured.len())];
        for index in pair[0] + 1..pair[1] {
            pulses.times_s[index] = through(nodes.iter().copied(), &pulses.times_s, index as f64);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 200 pulses of a speed that rises by half.
    fn run_up() -> Vec<f64> {
        (0..200).map(|k| 0.2 * f64::from(k) - 1.7e-4 * f64::from(k * k)).collect()
    }

    fn near(a: &[f64], b: &[f64], tolerance: f64) {
        assert_eq!(a.len(), b.len());
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < tolerance), "{a:?} for {b:?}");
    }

    #[test]
    fn theory_lost_and_doubled_pulses_of_a_run_up_are_repaired() {
        let truth = run_up();
        let mut edges = truth.clone();
        edges.drain(120..123);
        edges.remove(60);
        edges.insert(31, truth[30] + 0.04);
        let pulses = counted(&edges, false);
        near(&pulses.times_s, &truth, 2e-4);
        assert_eq!(pulses.lost.iter().map(|p| p.pulses).collect::<Vec<_>>(), [1, 3]);
        assert!((pulses.lost[0].time_s - truth[59]).abs() < 1e-12);
        assert_eq!(pulses.doubled, [Place { time_s: truth[30], pulses: 1 }]);
        assert!(pulses.irregular.is_empty() && pulses.breaks.is_empty());
        assert_eq!(pulses.measured.iter().filter(|m| !**m).count(), 4);
    }

    #[test]
    fn theory_faults_at_the_first_pulses_are_repaired_backwards() {
        let truth = run_up();
        let mut edges = truth.clone();
        edges.remove(2);
        edges.insert(1, truth[0] + 0.03);
        let pulses = counted(&edges, false);
        near(&pulses.times_s, &truth, 1e-3);
        assert_eq!((pulses.lost.len(), pulses.doubled.len()), (1, 1));
    }

    #[test]
    fn theory_a_step_that_no_whole_number_explains_is_left_and_said() {
        let truth = run_up();
        let shifted: Vec<f64> = truth.iter().enumerate().map(|(i, t)| if i < 90 { *t } else { t + 0.09 }).collect();
        let pulses = counted(&shifted, false);
        near(&pulses.times_s, &shifted, 1e-12);
        assert_eq!((pulses.lost.len(), pulses.doubled.len()), (0, 0));
        assert_eq!(pulses.irregular.len(), 1, "{:?}", pulses.irregular);
        assert!((pulses.irregular[0].time_s - truth[89]).abs() < 0.21);
        assert!(pulses.longest_stretch().len() >= 105);
    }
    /// Uniform numbers from 0 to 1.
    fn draw(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 33) as f64 / f64::from(1_u32 << 31)
    }

    /// Pulses of a wandering speed, some running up, with jitter, half of them of an uneven wheel of several marks
    /// (up to 4 % of the pitch); the period, and whether there are several marks.
    fn drawn(state: &mut u64) -> (Vec<f64>, f64, bool) {
        let count = 120 + (300.0 * draw(state)) as usize;
        let (hz, swing, swing_hz) = (5.0 + 20.0 * draw(state), 0.01 * draw(state), 0.1 + draw(state));
        let growth = if draw(state) < 0.3 { 0.1 * hz * draw(state) } else { 0.0 };
        let (several, jitter) = (draw(state) < 0.5, 0.002 * draw(state));
        let (uneven, marks) = if several { (0.04 * draw(state), 2 + (60.0 * draw(state)) as usize) } else { (0.0, 1) };
        let mut t = 0.0;
        let mut pulse = |k: usize| {
            t += 1.0 / (hz + growth * t + hz * swing * (6.3 * swing_hz * t).sin());
            t + (uneven * (2.3 * ((k % marks) * (k % marks)) as f64).sin() + jitter * (draw(state) - 0.5)) / hz
        };
        ((0..count).map(&mut pulse).collect(), 1.0 / hz, several)
    }

    #[test]
    fn theory_uneven_marks_are_in_step() {
        let mut state = 11;
        for _ in 0..300 {
            let (truth, _, several) = drawn(&mut state);
            let pulses = counted(&truth, several);
            assert!(pulses.irregular.is_empty() && pulses.lost.is_empty() && pulses.doubled.is_empty(), "{pulses:?}");
        }
    }

    #[test]
    fn theory_of_many_faults_none_is_repaired_wrongly() {
        let mut state = 7;
        let (mut repaired, mut said) = (0, 0);
        for trial in 0..1500 {
            let (truth, period, several) = drawn(&mut state);
            let mut edges = truth.clone();
            for _ in 0..=(3.0 * draw(&mut state)) as usize {
                let at = 1 + (draw(&mut state) * (edges.len() - 8) as f64) as usize;
                if draw(&mut state) < 0.5 {
                    edges.drain(at..=at + (3.0 * draw(&mut state)) as usize);
                } else {
                    let share = 0.05 + 0.9 * draw(&mut state);
                    edges.insert(at + 1, edges[at] + share * (edges[at + 1] - edges[at]));
                }
            }
            let pulses = counted(&edges, several);
            let near = |(a, b): (&f64, &f64)| (a - b).abs() < 0.2 * period;
            let right = pulses.times_s.len() == truth.len() && pulses.times_s.iter().zip(&truth).all(near);
            assert!(right || !pulses.irregular.is_empty(), "trial {trial}: {:?} {:?}", pulses.lost, pulses.doubled);
            repaired += usize::from(right);
            said += usize::from(!right);
        }
        println!("{repaired} repaired, {said} said");
        assert!(repaired > 1400, "{repaired} of 1500");
    }
}
