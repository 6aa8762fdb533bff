//! From tach edges to the pinion's angle, and to samples at equal angles for both shafts at once.
//!
//! Time over angle is a natural cubic spline through the (repaired) edges, whatever shaft they are of, and through
//! values between them where they are few; the speed is never taken as constant. The grid has as many samples per
//! pinion turn as also give a whole number per gear turn, so one reading of the signal serves the averages of both.
//! It is a quarter denser than the samples lie at the slowest turn: nothing folds, and the kernel (64-tap
//! Kaiser-windowed sinc, [`crate::spectral::resample_by_angle`]) is flat to 1e-5 over what is kept. Orders are looked
//! at up to 80 % of the Nyquist frequency at the *fastest* turn, where the record holds them throughout. Edges of
//! several marks per turn are smoothed first ([`whole_turns`]), those of a single mark lose the errors that
//! neighbours do not share ([`single_mark`]); what is left of the jitter goes where the speed is steady ([`jitter`]).
//! Limits: what the speed does within a turn, or within one pulse interval, is smoothed.

use super::{jitter, single_mark, whole_turns};
use crate::budget::ANGLES;
use crate::check::edges::Repair;
use crate::machine::Hunting;
use crate::record::{Run, Tach};
use crate::spectral::{AngleMap, interpolated, is_smooth, resample_by_angle, smooth_length};
use crate::train::Train;
use crate::{Error, Result};
use serde::Serialize;
use std::f64::consts::TAU;

/// Samples that the kernel needs on each side.
const KERNEL_REACH: f64 = 32.0;
/// Density of the grid over that of the samples at the slowest turn.
const DENSITY: f64 = 1.25;
/// Share of the sampling rate up to which orders are looked at.
const PASS_SHARE: f64 = 0.4;
/// Share of the turns that may be left out for the sake of cheap transforms.
const MAX_SPARED_TURN_SHARE: f64 = 0.015;
/// Phase error of the highest line from which jitter is taken out of the angle: it lowers that line by 0.05 dB.
const PHASE_RAD: f64 = 0.1;
/// Fastest over slowest turn from which the speed runs up.
const RUNS_UP: f64 = 1.1;
/// Marks per turn from which a spline through them follows any wander.
const MIN_MARKS_PER_TURN: u32 = 8;
/// Fewest turns of the slower shaft: below them the gear's sidebands are no lines of their own.
const FEWEST_TURNS: f64 = 6.0;
/// Turns of a train's shaft from which its sidebands are looked at: a quarter is held out, and the rest still tells
/// them apart.
const MIN_SHAFT_TURNS: f64 = 24.0;

/// Speed of the pinion over a run, turn by turn, Hz.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SpeedRange {
    /// Slowest turn.
    pub slowest_hz: f64,
    /// Turns over time.
    pub mean_hz: f64,
    /// Fastest turn.
    pub fastest_hz: f64,
}

/// A run's angle and its grid.
#[derive(Debug, Clone)]
pub struct Angle {
    /// Time over turns of the pinion.
    pub map: AngleMap,
    /// First turn of the grid, from the pinion's angle 0.
    pub from_turn: f64,
    /// Whole turns of the pinion on the grid.
    pub turns: usize,
    /// Samples per turn of the pinion and of the gear.
    pub per_turn: [usize; 2],
    /// Turns of the gear per turn of the pinion.
    pub gear_order: f64,
    /// Speed of the pinion.
    pub speed: SpeedRange,
    /// Highest order that the record holds at every speed of the run.
    pub highest_order: f64,
    /// What was done to the edges, in words; empty where nothing was.
    pub repaired: String,
}

impl Angle {
    /// The angle of `run`, whose `[tach]` is `tach`.
    ///
    /// # Errors
    /// Edges that cannot be repaired, too few turns, more points than the budget; `place` names the run.
    pub fn of(run: &Run, tach: &Tach, teeth: [u32; 2], place: &str) -> Result<Self> {
        let gear_order = f64::from(teeth[0]) / f64::from(teeth[1]);
        let ratio = tach.turns_per_pinion_turn(Some(teeth)).unwrap_or(1.0);
        Self::at_ratio(run, tach, (ratio, teeth), &|_| gear_order, place)
    }

    /// The angle of a train's input, whichever of its shafts has the tach. The slower shaft is the slowest one that
    /// turns often enough.
    ///
    /// # Errors
    /// As [`Angle::of`], and a tach behind a belt, whose slip is not known.
    pub fn of_train(run: &Run, tach: &Tach, train: &Train, place: &str) -> Result<Self> {
        let exact = |shaft: usize| {
            if train.exact[shaft] {
                return Ok(train.shaft_order(shaft).value());
            }
            Err(Error::invalid(place, format!("the tach's shaft {shaft} lies behind a belt, whose slip is not known")))
        };
        let shaft = tach.train_shaft().filter(|shaft| *shaft < train.shafts.len());
        let ratio = shaft.map_or(Ok(tach.turns_per_pinion_turn.unwrap_or(1.0)), exact)?;
        let slower = |turns: f64| {
            let orders = (0..train.shafts.len()).filter(|s| train.exact[*s]).map(|s| train.shaft_order(s).value());
            orders.filter(|order| order * turns >= MIN_SHAFT_TURNS).fold(1.0, f64::min)
        };
        Self::at_ratio(run, tach, (ratio, [1, 1]), &slower, place)
    }

    /// The angle from a tach that turns `ratio` times per turn of the grid's shaft.
    fn at_ratio(
        run: &Run,
        tach: &Tach,
        (ratio, teeth): (f64, [u32; 2]),
        slower: &dyn Fn(f64) -> f64,
        place: &str,
    ) -> Result<Self> {
        let repair = Repair::of(&run.edges_s);
        if repair.is_beyond() {
            return Err(Error::invalid(place, "tach edges are too irregular to repair; `meshband check` says more"));
        }
        let first = f64::from(run.declaration.first_pulse_index) / f64::from(tach.pulses_per_rev);
        let edges_s = if tach.pulses_per_rev == 1 && tach.source.as_deref() == Some("measured") {
            single_mark::smoothed(&repair.edges_s)
        } else {
            whole_turns::smoothed(&repair.edges_s, tach.pulses_per_rev)
        };
        let (edges_s, per_rev) = finer(edges_s, tach.pulses_per_rev);
        let of_shaft = AngleMap::new(&edges_s, per_rev, first)
            .ok_or_else(|| Error::invalid(place, "fewer than two tach edges"))?;
        let map = if ratio == 1.0 { of_shaft } else { of_shaft.geared(1.0 / ratio) };
        let margin = KERNEL_REACH / run.sample_rate_hz();
        let (first, last) = map.range();
        let from_turn = (first.max(map.turns_at(margin)) - 1e-9).ceil();
        let turns = (last.min(map.turns_at(run.duration_s() - margin)) + 1e-9 - from_turn).floor().max(0.0);
        let gear_order = slower(turns);
        if turns * gear_order.min(1.0) < FEWEST_TURNS {
            let what = format!(
                "{turns} whole turns of the pinion, {:.1} of the slower shaft; at least {FEWEST_TURNS} are needed",
                turns * gear_order.min(1.0)
            );
            return Err(Error::invalid(place, what));
        }
        let speed = speed_range(&map, from_turn, turns as usize);
        let per_turn = grid(DENSITY * run.sample_rate_hz() / speed.slowest_hz, teeth);
        let points = turns * per_turn[0] as f64;
        let share = ANGLES.most / points * run.duration_s();
        ANGLES.check(
            place,
            points,
            &format!("take a part with --from and --to: {share:.0} s are as much as it allows"),
        )?;
        Ok(Self {
            map,
            from_turn,
            turns: turns as usize,
            per_turn,
            gear_order,
            speed,
            highest_order: PASS_SHARE * run.sample_rate_hz() / speed.fastest_hz,
            repaired: if repair.changes() > 0 { repair.words() } else { String::new() },
        })
    }

    /// The same with at most 1.5 % of its turns fewer, the last ones, so that transforms of all its points are
    /// cheap: whole `hunting` periods, in turns, where that suffices (lines of both shafts then stand on bins), else a
    /// number without large prime factors.
    pub fn with_cheap_turns(mut self, hunting: Option<usize>) -> Self {
        let least = self.turns - (MAX_SPARED_TURN_SHARE * self.turns as f64) as usize;
        let whole = hunting.map(|period| self.turns / period * period).filter(|turns| *turns >= least);
        let cheap = || (least..=self.turns).rev().find(|turns| is_smooth(*turns));
        self.turns = whole.or_else(cheap).unwrap_or(self.turns);
        self
    }

    /// The same without the jitter of its tachometer ([`jitter`]), where that is phase at the highest order; a virtual
    /// one has none.
    pub fn settled(mut self, tach: &Tach) -> Self {
        if self.is_blurred_by(tach)
            && let Some(map) = self.settled_map()
        {
            self.map = map;
        }
        self
    }

    /// Whether a tachometer's jitter is phase at the highest order; a virtual one has none, an unknown one may be.
    pub fn is_blurred_by(&self, tach: &Tach) -> bool {
        let highest_hz = self.highest_order * self.speed.fastest_hz;
        !tach.is_virtual() && tach.jitter_s.is_none_or(|jitter_s| TAU * highest_hz * jitter_s > PHASE_RAD)
    }

    /// The map through smoothed times of whole turns; nothing where the speed moves too fast for it, or runs up.
    pub fn settled_map(&self) -> Option<AngleMap> {
        if self.runs_up() {
            return None;
        }
        let times: Vec<f64> = (0..=self.turns).map(|i| self.map.time_at(self.from_turn + i as f64)).collect();
        AngleMap::new(&jitter::settled(&times)?, jitter::EDGES, self.from_turn)
    }

    /// Whether the speed runs up or down: it then begins and ends with a kink, which no smoothing may take.
    pub fn runs_up(&self) -> bool {
        self.speed.fastest_hz > RUNS_UP * self.speed.slowest_hz
    }

    /// The signal on the grid: `turns x per_turn` samples.
    pub fn resampled(&self, signal: &[f64], rate_hz: f64) -> Vec<f64> {
        resample_by_angle(signal, rate_hz, &self.map, self.from_turn, self.turns, self.per_turn[0])
    }

    /// Order of the slower shaft.
    pub fn slower_order(&self) -> f64 {
        self.gear_order.min(1.0)
    }

    /// Times of the grid's ends, s.
    pub fn time_range(&self) -> (f64, f64) {
        (self.map.time_at(self.from_turn), self.map.time_at(self.from_turn + self.turns as f64))
    }
}

/// Edges of a wheel of few marks with more between them: the spline through its own would leave images of a wander at
/// the orders of its marks. As they are where that goes back in time.
fn finer(edges_s: Vec<f64>, pulses: u32) -> (Vec<f64>, u32) {
    if pulses >= MIN_MARKS_PER_TURN || edges_s.len() < 2 {
        return (edges_s, pulses);
    }
    let steps = MIN_MARKS_PER_TURN.div_ceil(pulses);
    let count = (edges_s.len() - 1) * steps as usize + 1;
    let finer: Vec<f64> = (0..count).map(|i| interpolated(&edges_s, i as f64 / f64::from(steps))).collect();
    if finer.windows(2).all(|w| w[1] > w[0]) { (finer, pulses * steps) } else { (edges_s, pulses) }
}

fn speed_range(map: &AngleMap, from: f64, turns: usize) -> SpeedRange {
    let time = |i: usize| map.time_at(from + i as f64);
    let speeds = (0..turns).map(|i| 1.0 / (time(i + 1) - time(i)));
    let (slowest_hz, fastest_hz) = speeds.fold((f64::INFINITY, 0.0_f64), |(l, h), s| (l.min(s), h.max(s)));
    SpeedRange { slowest_hz, mean_hz: turns as f64 / (time(turns) - time(0)), fastest_hz }
}

/// At least `least` samples per pinion turn, whole numbers for both shafts, with small prime factors where they are
/// free.
fn grid(least: f64, teeth: [u32; 2]) -> [usize; 2] {
    let divisor = teeth[1] / Hunting::of(teeth).turns;
    let [pinion, gear] = teeth.map(|z| (z / divisor) as usize);
    let step = smooth_length((least / pinion as f64).ceil().max(1.0) as usize);
    [pinion * step, gear * step]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_one_mark_per_turn_follows_a_wander_between_its_edges() {
        // A percent of the speed over eight turns.
        let time = |turn: f64| 0.1 * turn + 1e-3 * 8.0 / TAU * (TAU * turn / 8.0).sin();
        let edges: Vec<f64> = (0..200).map(|i| time(f64::from(i))).collect();
        let worst = |edges: &[f64], pulses: u32| {
            let map = AngleMap::new(edges, pulses, 0.0).expect("edges");
            let off = |i: i32| (map.time_at(0.1 * f64::from(i)) - time(0.1 * f64::from(i))).abs() / 0.1;
            (100..1890).map(off).fold(0.0, f64::max)
        };
        let (finer, pulses) = finer(edges.clone(), 1);
        assert!(worst(&edges, 1) > 1e-6, "{:e} of a turn", worst(&edges, 1));
        assert!(worst(&finer, pulses) < 1e-8, "{:e} of a turn", worst(&finer, pulses));
    }

    #[test]
    fn edges_that_would_go_back_between_marks_stay_as_they_are() {
        let edges = vec![0.0, 0.1, 0.2, 0.2001, 0.4, 0.5, 0.6];
        assert_eq!(finer(edges.clone(), 1), (edges, 1));
        assert_eq!(finer(vec![0.0, 0.1], 8).1, 8);
    }
}
