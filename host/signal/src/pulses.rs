//! Lost and doubled pulses: the likeliest reading of all edges, and where it is not sure.
//!
//! The edges are marks that pass on a smooth course of the speed, some lost, some too many, some out of place. The
//! course (`course`) and the reading (`reading`) are found in turns until nothing changes: the course gives each
//! edge's place in periods, and where intervals are not one period long the likeliest chain of edges and whole
//! numbers of periods is taken, with the probability that its count is wrong. Below 1e-3 the count holds; otherwise
//! the place is said and the best guess is left in. Pulses put in lie on the cubic through their neighbours. What a
//! record holds is read in the same way as what is imported: this is the one place of it.
//!
//! Limits: a pulse lost before the first or behind the last that counts is not seen; marks lost in the same way all
//! along (every second one) are another wheel, which only the mesh line can tell.

mod course;
mod reading;

use crate::spectral::through;
use course::{Course, Interval};
use reading::{Chances, Reading, Stretch};
use serde::Serialize;

/// Fewest edges whose intervals can be compared.
const MIN_EDGES: usize = 6;
/// Intervals farther from one period than five spreads are read anew; no less and no more than these shares of a
/// period.
const CLEAN_SPREADS: f64 = 5.0;
const CLEAN_PERIOD_SHARES: [f64; 2] = [0.15, 0.25];
/// Clean intervals that a stretch takes with it at either end.
const CONTEXT: usize = 2;
/// Largest probability of another count with which a count is sure.
const MAX_WRONG_PROBABILITY: f64 = 1e-3;
/// Departure of an interval from whole periods that is said: five spreads, no less and no more than these, periods.
const STEP_LIMITS_PERIODS: [f64; 2] = [0.25, 0.45];
/// Turns of course and reading after which what still changes is not sure.
const ROUNDS: usize = 12;
/// Chances of a lost pulse and of an edge too many before any is seen, and the range that they stay in.
const FIRST_CHANCES: Chances = Chances { lost: 0.02, extra: 0.02 };
const CHANCE: [f64; 2] = [0.003, 0.2];
/// Most periods of an interval whose pulses are put in: what lasts longer may be a shaft that stood.
const MAX_COUNTED_PERIODS: usize = 8;
/// Fewest intervals that make a course.
const LEAST_LINKS: usize = 3;

/// Pulses that were lost, doubled or out of step at one place.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Place {
    /// Time of the last pulse that counted, s from the first sample.
    pub time_s: f64,
    /// How many pulses.
    pub pulses: usize,
}

/// Pulses in order, repaired by the likeliest reading.
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
    /// Pulses out of step: left as they are, or counted by the best guess.
    pub irregular: Vec<Place>,
    /// Indices of pulses behind which the count is not sure.
    pub breaks: Vec<usize>,
}

/// An interval of the reading, and whether its count is sure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Link {
    interval: Interval,
    sure: bool,
}

impl Link {
    fn new(from: usize, to: usize, periods: usize, sure: bool) -> Self {
        Self { interval: Interval { from, to, periods }, sure }
    }

    /// From an edge to the next one.
    fn next(from: usize) -> Self {
        Self::new(from, from + 1, 1, true)
    }

    /// Edges passed over as too many.
    fn passed(&self) -> usize {
        self.interval.to - self.interval.from - 1
    }
}

/// Counts the pulses of at least one edge at `edges_s` (s, ascending).
///
/// # Panics
/// Without any edge.
pub fn counted(edges_s: &[f64]) -> Pulses {
    let n = edges_s.len();
    if n < MIN_EDGES {
        return unread(edges_s);
    }
    let mut links: Vec<Link> = (0..n - 1).map(Link::next).collect();
    let mut chances = FIRST_CHANCES;
    for round in 1..=ROUNDS {
        let Some(mut read) = read(&course(edges_s, &links), chances).filter(|read| read.len() >= LEAST_LINKS) else {
            return unread(edges_s);
        };
        let settled = read.iter().map(|link| link.interval).eq(links.iter().map(|link| link.interval));
        if round == ROUNDS && !settled {
            read.iter_mut().filter(|link| !links.contains(link)).for_each(|link| link.sure = false);
        }
        links = read;
        if settled {
            break;
        }
        chances = chances_of(&links);
    }
    assembled(edges_s, &links, &course(edges_s, &links))
}

fn course(edges_s: &[f64], links: &[Link]) -> Course {
    Course::of(edges_s, &links.iter().map(|link| link.interval).collect::<Vec<_>>())
}

/// Edges that no steady period explains, as they are.
fn unread(edges_s: &[f64]) -> Pulses {
    let n = edges_s.len();
    let irregular = vec![Place { time_s: edges_s[0], pulses: n }];
    Pulses {
        times_s: edges_s.to_vec(),
        measured: vec![true; n],
        irregular,
        breaks: (0..n).collect(),
        ..Pulses::default()
    }
}

/// Shares of pulses lost and of edges too many.
fn chances_of(links: &[Link]) -> Chances {
    let pulses: usize = links.iter().map(|link| link.interval.periods).sum();
    let share = |count: usize| ((count + 1) as f64 / (pulses + 20) as f64).clamp(CHANCE[0], CHANCE[1]);
    Chances {
        lost: share(links.iter().map(|link| link.interval.periods - 1).sum()),
        extra: share(links.iter().map(Link::passed).sum()),
    }
}

/// The reading of all edges on a course; `None` where no two clean intervals follow each other.
fn read(course: &Course, chances: Chances) -> Option<Vec<Link>> {
    let last = course.places.len() - 1;
    let clean = |i: usize| is_clean(course, i);
    let mut links = Vec::new();
    let mut at = 0;
    let mut interval = 0;
    while interval < last {
        if clean(interval) {
            interval += 1;
            continue;
        }
        // The stretch goes on until enough clean intervals follow each other.
        let open = interval == 0;
        let from = interval.saturating_sub(CONTEXT).max(at);
        let (mut to, mut run) = (interval + 1, 0);
        while to < last && run < 2 * CONTEXT {
            run = if clean(to) { run + 1 } else { 0 };
            to += 1;
        }
        let ends = run > 0;
        to = if run == 2 * CONTEXT { to - CONTEXT } else { to };
        if open && !ends {
            return None;
        }
        links.extend((at..from).map(Link::next));
        links.extend(stretch(course, from, to, open, ends, chances));
        (at, interval) = (to, to);
    }
    links.extend((at..last).map(Link::next));
    Some(links)
}

/// Whether the next edge lies one period ahead.
fn is_clean(course: &Course, edge: usize) -> bool {
    let limit = (CLEAN_SPREADS * course.spread[edge]).clamp(CLEAN_PERIOD_SHARES[0], CLEAN_PERIOD_SHARES[1]);
    course.smooth[edge] || (course.places[edge + 1] - course.places[edge] - 1.0).abs() <= limit
}

/// Reads the edges `from..=to`; towards an open end, or towards none.
fn stretch(course: &Course, from: usize, to: usize, open: bool, ends_in_step: bool, chances: Chances) -> Vec<Link> {
    let places = &course.places[from..=to];
    if open {
        // Backwards from the end, which counts.
        let turned: Vec<f64> = places.iter().rev().map(|place| -place).collect();
        let deviation = |edge: usize, periods: usize| course.deviation(to - edge, periods);
        let reading = reading::read(&Stretch { places: &turned, deviation: &deviation, ends_in_step: false }, chances);
        let mut links = linked(&reading, |edge| is_clean(course, edge), |edge| to - edge);
        links.reverse();
        links.iter_mut().for_each(|link| std::mem::swap(&mut link.interval.from, &mut link.interval.to));
        return links;
    }
    let deviation = |edge: usize, periods: usize| course.deviation(from + edge, periods);
    let reading = reading::read(&Stretch { places, deviation: &deviation, ends_in_step }, chances);
    linked(&reading, |edge| is_clean(course, edge), |edge| from + edge)
}

fn linked(reading: &Reading, clean: impl Fn(usize) -> bool, edge: impl Fn(usize) -> usize) -> Vec<Link> {
    let mut before = 0;
    let link = |&(at, periods): &(usize, usize)| {
        // Where the count may be another one, the plain steps are not where it goes wrong.
        let plain = at == before + 1 && periods == 1 && clean(edge(before).min(edge(at)));
        let link = Link::new(edge(before), edge(at), periods, plain || reading.wrong <= MAX_WRONG_PROBABILITY);
        before = at;
        link
    };
    reading.steps.iter().map(link).collect()
}

/// The pulses of a reading.
fn assembled(edges_s: &[f64], links: &[Link], course: &Course) -> Pulses {
    let first = links[0].interval.from;
    let mut pulses = Pulses { times_s: vec![edges_s[first]], measured: vec![true], ..Pulses::default() };
    if first > 0 {
        pulses.doubled.push(Place { time_s: edges_s[0], pulses: first });
    }
    for link in links {
        let Interval { from, to, periods } = link.interval;
        let (here, index) = (edges_s[from], pulses.times_s.len() - 1);
        if link.passed() > 0 {
            pulses.doubled.push(Place { time_s: here, pulses: link.passed() });
        }
        if periods > MAX_COUNTED_PERIODS {
            pulses.say_irregular(index, here, true);
            pulses.breaks.push(index);
            pulses.times_s.push(edges_s[to]);
            pulses.measured.push(true);
            continue;
        }
        if periods > 1 {
            pulses.lost.push(Place { time_s: here, pulses: periods - 1 });
        }
        let off = (course.places[to] - course.places[from] - periods as f64).abs();
        let limit =
            (CLEAN_SPREADS * course.deviation(from, periods)).clamp(STEP_LIMITS_PERIODS[0], STEP_LIMITS_PERIODS[1]);
        if !link.sure || off > limit {
            pulses.say_irregular(index, here, !link.sure);
        }
        if !link.sure {
            pulses.breaks.extend(index..index + periods);
        }
        // Their times follow when the pulses behind the gap are known.
        let step = (edges_s[to] - here) / periods as f64;
        pulses.times_s.extend((1..periods).map(|i| here + step * i as f64));
        pulses.measured.resize(pulses.times_s.len(), false);
        pulses.times_s.push(edges_s[to]);
        pulses.measured.push(true);
    }
    let behind = edges_s.len() - 1 - links[links.len() - 1].interval.to;
    if behind > 0 {
        pulses.doubled.push(Place { time_s: edges_s[edges_s.len() - 1 - behind], pulses: behind });
    }
    fill(&mut pulses);
    pulses
}

impl Pulses {
    /// Median time from one pulse to the next, s; 0 of fewer than two.
    pub fn median_interval_s(&self) -> f64 {
        course::median(&mut self.times_s.windows(2).map(|w| w[1] - w[0]).collect::<Vec<_>>())
    }

    /// Says one more pulse out of step behind pulse `index`, at the place before where that goes on.
    fn say_irregular(&mut self, index: usize, time_s: f64, unsure: bool) {
        let goes_on = unsure && index > 0 && self.breaks.last() == Some(&(index - 1));
        match self.irregular.last_mut().filter(|_| goes_on) {
            Some(place) => place.pulses += 1,
            None => self.irregular.push(Place { time_s, pulses: 1 }),
        }
    }

    /// Pulses out of step.
    pub fn out_of_step(&self) -> usize {
        self.irregular.iter().map(|place| place.pulses).sum()
    }

    /// Stretches of at least two pulses whose count is sure, as ranges of indices.
    pub fn sure_stretches(&self) -> Vec<std::ops::Range<usize>> {
        let ends = self.breaks.iter().map(|index| index + 1).chain([self.times_s.len()]);
        let mut from = 0;
        let stretches = ends.map(|end| {
            let stretch = from..end.max(from);
            from = end.max(from);
            stretch
        });
        stretches.filter(|stretch| stretch.len() > 1).collect()
    }

    /// Longest stretch of pulses whose count is sure, as a range of indices.
    pub fn longest_stretch(&self) -> std::ops::Range<usize> {
        self.sure_stretches().into_iter().max_by_key(ExactSizeIterator::len).unwrap_or(0..0)
    }
}

/// Puts the pulses that were not measured on the cubic through the two measured ones at either side.
pub fn fill(pulses: &mut Pulses) {
    let measured: Vec<usize> = (0..pulses.times_s.len()).filter(|&i| pulses.measured[i]).collect();
    for gap in measured.windows(2).enumerate().filter(|(_, pair)| pair[1] > pair[0] + 1) {
        let (position, pair) = gap;
        let from = position.saturating_sub(1).min(measured.len().saturating_sub(4));
        let nodes = &measured[from..(from + 4).min(measured.len())];
        let on_cubic =
            (pair[0] + 1..pair[1]).map(|index| through(nodes.iter().copied(), &pulses.times_s, index as f64));
        let mut times: Vec<f64> = on_cubic.collect();
        // Beside a standstill the cubic swings past its ends: there a straight line has to do.
        let (from_s, to_s) = (pulses.times_s[pair[0]], pulses.times_s[pair[1]]);
        let ends = [&[from_s][..], &times, &[to_s]].concat();
        if ends.windows(2).any(|w| w[1] <= w[0]) {
            let step = (to_s - from_s) / (times.len() + 1) as f64;
            times.iter_mut().enumerate().for_each(|(i, time)| *time = from_s + step * (i + 1) as f64);
        }
        pulses.times_s[pair[0] + 1..pair[1]].copy_from_slice(&times);
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
        let pulses = counted(&edges);
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
        let pulses = counted(&edges);
        near(&pulses.times_s, &truth, 1e-3);
        assert_eq!((pulses.lost.len(), pulses.doubled.len()), (1, 1));
    }

    #[test]
    fn theory_a_step_that_no_whole_number_explains_is_left_and_said() {
        let truth = run_up();
        let shifted: Vec<f64> = truth.iter().enumerate().map(|(i, t)| if i < 90 { *t } else { t + 0.09 }).collect();
        let pulses = counted(&shifted);
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
    /// (up to 4 % of the pitch); the period.
    fn drawn(state: &mut u64) -> (Vec<f64>, f64) {
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
        ((0..count).map(&mut pulse).collect(), 1.0 / hz)
    }

    /// Pulses, one per turn, of a shaft whose turns are a function of time.
    fn pulses_of(turns: impl Fn(f64) -> f64, seconds: f64) -> Vec<f64> {
        let (mut edges, mut next) = (Vec::new(), turns(0.0).floor() + 1.0);
        let mut t = 0.0;
        while t < seconds {
            if turns(t + 1e-5) >= next {
                edges.push(t + 1e-5 * (next - turns(t)) / (turns(t + 1e-5) - turns(t)));
                next += 1.0;
            }
            t += 1e-5;
        }
        edges
    }

    #[test]
    fn regress_sound_pulses_of_hard_speed_changes_are_left_alone() {
        let step = |f: f64, g: f64| move |t: f64| 0.3 + if t < 4.0 { f * t } else { f * 4.0 + g * (t - 4.0) };
        let within = |t: f64| 0.2 + 10.0 * t + 10.0 * ((t - 4.0).clamp(0.0, 0.2).powi(2) / 0.4 + (t - 4.2).max(0.0));
        let cases: [(&str, Vec<f64>); 6] = [
            ("run-up from 5 to 50", pulses_of(|t| 0.7 + 5.0 * t + 2.8125 * t * t, 8.0)),
            ("coast-down", pulses_of(|t| 0.1 + 50.0 * t - 2.8125 * t * t, 8.0)),
            ("step up", pulses_of(step(10.0, 20.0), 8.0)),
            ("step down", pulses_of(step(20.0, 10.0), 8.0)),
            ("step up by half", pulses_of(step(10.0, 15.0), 8.0)),
            ("within 0.2 s", pulses_of(within, 8.0)),
        ];
        for (what, edges) in cases {
            let pulses = counted(&edges);
            assert!(pulses.lost.is_empty(), "{what}: put in {:?}", pulses.lost);
            assert!(pulses.doubled.is_empty(), "{what}: taken out {:?}", pulses.doubled);
            near(&pulses.times_s, &edges, 1e-9);
        }
    }

    #[test]
    fn regress_pulses_of_a_shaft_that_comes_to_a_stop_stay_in_order() {
        let speed = |t: f64| 20.0 * (4.0 - t).clamp(0.0, 1.0).max(((t - 5.63) / 0.87).clamp(0.0, 1.0));
        let mut turns = vec![0.0];
        (0..100_000).for_each(|i| turns.push(turns[i] + 1e-4 * speed(1e-4 * i as f64)));
        let mut edges: Vec<f64> = Vec::new();
        for i in 1..turns.len() {
            if (turns[i] + 0.3).floor() > (turns[i - 1] + 0.3).floor() {
                edges.push(1e-4 * i as f64);
            }
        }
        let pulses = counted(&edges);
        assert!(pulses.times_s.windows(2).all(|w| w[1] > w[0]), "in order");
        assert!(!pulses.breaks.is_empty(), "a stop is said");
    }

    #[test]
    fn regress_a_standstill_is_no_row_of_lost_pulses() {
        let turns = |t: f64| 0.3 + if t < 3.0 { 20.0 * t } else { 60.0 + 20.0 * (t - 5.0).max(0.0) };
        let edges = pulses_of(turns, 8.0);
        let pulses = counted(&edges);
        assert_eq!(pulses.times_s.len(), edges.len());
        assert!(!pulses.breaks.is_empty() && pulses.lost.is_empty(), "{:?}", pulses.lost);
    }

    #[test]
    fn theory_uneven_marks_are_in_step() {
        let mut state = 11;
        for _ in 0..300 {
            let (truth, _) = drawn(&mut state);
            let pulses = counted(&truth);
            assert!(pulses.irregular.is_empty() && pulses.lost.is_empty() && pulses.doubled.is_empty(), "{pulses:?}");
        }
    }

    #[test]
    fn theory_of_many_faults_none_is_repaired_wrongly() {
        let mut state = 7;
        let (mut repaired, mut said) = (0, 0);
        for trial in 0..1500 {
            let (truth, period) = drawn(&mut state);
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
            let pulses = counted(&edges);
            let near = |(a, b): (&f64, &f64)| (a - b).abs() < 0.2 * period;
            let right = pulses.times_s.len() == truth.len() && pulses.times_s.iter().zip(&truth).all(near);
            assert!(right || !pulses.breaks.is_empty(), "trial {trial}: {:?} {:?}", pulses.lost, pulses.doubled);
            repaired += usize::from(right);
            said += usize::from(!right);
        }
        println!("{repaired} repaired, {said} said");
        assert!(repaired > 1480, "{repaired} of 1500");
    }

    /// A normal variable.
    fn normal(state: &mut u64) -> f64 {
        (-2.0 * draw(state).max(1e-12).ln()).sqrt() * (std::f64::consts::TAU * draw(state)).cos()
    }

    /// A wheel on a shaft, and what is done to its pulses.
    struct Trial {
        marks: usize,
        hz: f64,
        growth: f64,
        swing: f64,
        seconds: f64,
        jitter_s: f64,
        dropped: f64,
        doubled: f64,
    }

    impl Trial {
        /// True times, and the edges that are left of them.
        fn edges(&self, state: &mut u64) -> (Vec<f64>, Vec<f64>) {
            let (mut truth, mut t) = (Vec::new(), 0.0);
            while t < self.seconds {
                let swing = self.swing * (std::f64::consts::TAU * 0.2 * t).sin();
                t += 1.0 / (self.marks as f64 * self.hz * (1.0 + swing + self.growth * t));
                truth.push(t);
            }
            let mut edges = Vec::new();
            for (i, t) in truth.iter().enumerate() {
                if draw(state) >= self.dropped {
                    edges.push(t + self.jitter_s * normal(state));
                }
                if draw(state) < self.doubled && i + 1 < truth.len() {
                    edges.push(t + draw(state) * (truth[i + 1] - t));
                }
            }
            edges.sort_by(f64::total_cmp);
            edges.dedup();
            (truth, edges)
        }
    }

    /// Whether the pulses of every sure stretch are counted as they passed, and their worst error of the speed over
    /// a turn.
    fn judged(pulses: &Pulses, truth: &[f64], marks: usize) -> (bool, f64) {
        let nearest = |t: f64| {
            let behind = truth.partition_point(|x| *x < t).min(truth.len() - 1);
            if behind > 0 && t - truth[behind - 1] < truth[behind] - t { behind - 1 } else { behind }
        };
        let (mut right, mut worst) = (true, 0.0_f64);
        for stretch in pulses.sure_stretches() {
            let times = &pulses.times_s[stretch];
            right &= nearest(times[times.len() - 1]) == nearest(times[0]) + times.len() - 1;
            for k in 0..times.len().saturating_sub(marks) {
                let (from, to) = (nearest(times[k]), nearest(times[k + marks]));
                worst = worst.max(((times[k + marks] - times[k]) / (truth[to] - truth[from]) - 1.0).abs());
            }
        }
        (right, worst)
    }

    #[test]
    fn theory_two_hundred_drawn_wheels_are_counted_right_or_said() {
        let mut state = 59;
        let (mut sure, mut said) = (0, 0);
        for trial in 0..200 {
            let marks = 1 + (60.0 * draw(&mut state)) as usize;
            let hz = (4.0 + 46.0 * draw(&mut state)).min(3000.0 / marks as f64);
            let faults = [0.01 + 0.07 * draw(&mut state), 0.01 + 0.07 * draw(&mut state)];
            let which = (3.0 * draw(&mut state)) as usize;
            let drawn = Trial {
                marks,
                hz,
                growth: if draw(&mut state) < 0.3 { 0.2 * draw(&mut state) } else { 0.0 },
                swing: 0.05 * draw(&mut state),
                seconds: (4000.0 / marks as f64 / hz).min(12.0),
                jitter_s: 20e-6 * draw(&mut state),
                dropped: if which == 1 { 0.0 } else { faults[0] },
                doubled: if which == 0 { 0.0 } else { faults[1] },
            };
            let (truth, edges) = drawn.edges(&mut state);
            let pulses = counted(&edges);
            let (right, _) = judged(&pulses, &truth, marks);
            assert!(right, "trial {trial}: {marks} marks at {hz:.1} turns/s, {:?} {:?}", pulses.lost, pulses.doubled);
            if pulses.breaks.is_empty() { sure += 1 } else { said += 1 }
        }
        println!("{sure} right and sure, {said} said to be unsure");
        assert!(sure >= 170, "{sure} of 200 sure");
    }

    #[test]
    fn theory_a_wheel_of_twenty_with_dropped_pulses_is_counted_right_in_every_trial() {
        let mut state = 24;
        for trial in 0..24 {
            let (dropped, jitter_s) = [(0.02, 20e-6), (0.05, 20e-6), (0.02, 0.0)][trial % 3];
            let wheel =
                Trial { marks: 20, hz: 20.0, growth: 0.0, swing: 0.05, seconds: 12.0, jitter_s, dropped, doubled: 0.0 };
            let (truth, edges) = wheel.edges(&mut state);
            let pulses = counted(&edges);
            let (right, speed) = judged(&pulses, &truth, 20);
            assert!(right && pulses.breaks.is_empty(), "trial {trial}: {:?}", pulses.irregular);
            assert!(speed < 2.5e-3, "trial {trial}: a turn's speed is off by {speed}");
        }
    }
}
