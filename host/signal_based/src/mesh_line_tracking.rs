//! Mesh lines followed turn by turn: what families are searched in in a run-up, and what envelopes are of.
//!
//! A path turns and swells every mesh line as a run-up sweeps it through resonances. The calibrated model, which must
//! predict turns not used, leaves several times the noise of it, beside the mesh lines, where sidebands stand. For a
//! search nothing need be predicted: each line's amplitude is followed by a moving average over two turns of the
//! slower shaft (triangular: its response vanishes at every whole order of that shaft, so no sideband of it is
//! touched; of the other shaft 2 % at most), applied twice for lines that turn within it, and taken off. Order
//! spectra only in run-ups: where the speed is steady, swings and cages stand as near to the mesh lines as this
//! reaches. Envelopes always: they are of what knocks, in wide bands, and a mesh line that swings fills them. The
//! average reaches into the gap before held-out turns, not beyond it, but for the half that the second round adds; it
//! takes the mesh off and adds nothing.

use super::baseline::Grids;
use super::scene::{Scene, SceneRun};
use rayon::prelude::*;
use rustfft::num_complex::Complex64;
use std::borrow::Cow;
use std::f64::consts::TAU;

/// Rounds: what is left of a slow change falls with its square.
const ROUNDS: usize = 2;

/// What a model leaves, less what mesh lines have of it that moves slowly; a rig without gears has no mesh.
pub fn followed(scene: &Scene, left: &Grids) -> Grids {
    scene.runs.iter().zip(left).map(|(run, channels)| of_run(scene, run, channels)).collect()
}

fn of_run(scene: &Scene, run: &SceneRun, channels: &[Vec<f64>]) -> Vec<Vec<f64>> {
    if scene.teeth[0] == 1 {
        return channels.to_vec();
    }
    channels.par_iter().map(|samples| without_mesh(scene, run, samples)).collect()
}

/// In run-ups what is left of followed lines, otherwise what the model leaves.
pub fn followed_in_run_ups<'a>(scene: &Scene, left: &'a Grids) -> Vec<Cow<'a, [Vec<f64>]>> {
    let one = |(run, channels): (&SceneRun, &'a Vec<Vec<f64>>)| {
        if run.runs_up() { Cow::Owned(of_run(scene, run, channels)) } else { Cow::Borrowed(&channels[..]) }
    };
    scene.runs.iter().zip(left).map(one).collect()
}

fn without_mesh(scene: &Scene, run: &SceneRun, samples: &[f64]) -> Vec<f64> {
    let per_turn = run.angle.per_turn[0];
    let length = (per_turn as f64 / scene.gear_order.min(1.0)).round() as usize;
    if let Some(gearing) = &scene.gearing {
        return without_lines(&gearing.fitted, per_turn, length, samples);
    }
    let turn: Vec<Complex64> =
        (0..per_turn).map(|i| Complex64::from_polar(1.0, TAU * i as f64 / per_turn as f64)).collect();
    let mut left = samples.to_vec();
    let z = scene.teeth[0] as usize;
    for order in (1..).map(|k| k * z).take_while(|order| (*order as f64) < scene.highest_order) {
        // Whole orders: phases repeat with the turn.
        let phases = std::iter::successors(Some(0), |place| Some((place + order) % per_turn)).map(|place| turn[place]);
        (0..ROUNDS).for_each(|_| take_off(&mut left, length, phases.clone()));
    }
    left
}

/// The same of lines at any order: phases are turned sample by sample, anew every turn.
fn without_lines(orders: &[f64], per_turn: usize, length: usize, samples: &[f64]) -> Vec<f64> {
    let mut left = samples.to_vec();
    for order in orders {
        let step = Complex64::from_polar(1.0, TAU * order / per_turn as f64);
        let phases = (0..).flat_map(move |turn| {
            let first = Complex64::from_polar(1.0, TAU * (order * f64::from(turn)).fract());
            std::iter::successors(Some(first), move |phase| Some(phase * step)).take(per_turn)
        });
        (0..ROUNDS).for_each(|_| take_off(&mut left, length, phases.clone()));
    }
    left
}

/// Takes a line whose phases are given off the samples, as far as its amplitude moves slowly: by two moving averages
/// over `length` samples, in one pass, so that no more is held than the averages reach over.
fn take_off(left: &mut [f64], length: usize, phases: impl Iterator<Item = Complex64> + Clone) {
    let count = left.len();
    let (mut turning, mut back) = (phases.clone(), phases);
    let mut once = Moving::new(length, count);
    let mut twice = Moving::new(length, count);
    let mut done = 0;
    for i in 0..count {
        let Some(phase) = turning.next() else { return };
        once.push(phase.conj() * left[i]);
        while let Some(mean) = once.next() {
            twice.push(mean);
            while let Some((slow, phase)) = twice.next().and_then(|slow| Some((slow, back.next()?))) {
                left[done] -= 2.0 * (slow * phase).re;
                done += 1;
            }
        }
    }
}

/// Moving average over `length` values about each of `count`; over those that there are at the ends.
struct Moving {
    /// Sums of all values before each of the latest ones.
    sums: Vec<Complex64>,
    before: usize,
    after: usize,
    count: usize,
    taken: usize,
    given: usize,
}

impl Moving {
    fn new(length: usize, count: usize) -> Self {
        let kept = (length + 2).next_power_of_two();
        let (before, after) = (length / 2, length - length / 2);
        Self { sums: vec![Complex64::default(); kept], before, after, count, taken: 0, given: 0 }
    }

    fn at(&self, values: usize) -> usize {
        values & (self.sums.len() - 1)
    }

    fn push(&mut self, value: Complex64) {
        let sum = self.sums[self.at(self.taken)] + value;
        self.taken += 1;
        let at = self.at(self.taken);
        self.sums[at] = sum;
    }

    /// The next average, once all its values have come.
    fn next(&mut self) -> Option<Complex64> {
        let (from, to) = (self.given.saturating_sub(self.before), (self.given + self.after).min(self.count));
        if self.given == self.count || to > self.taken {
            return None;
        }
        self.given += 1;
        Some((self.sums[self.at(to)] - self.sums[self.at(from)]) / (to - from).max(1) as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn averaged(values: &[Complex64], length: usize) -> Vec<Complex64> {
        let mut moving = Moving::new(length, values.len());
        let mut means = Vec::new();
        for value in values {
            moving.push(*value);
            means.extend(std::iter::from_fn(|| moving.next()));
        }
        means
    }

    #[test]
    fn ref_a_pass_is_two_averages_of_all_samples() {
        let mean = |values: &[Complex64], length: usize, i: usize| {
            let part = &values[i.saturating_sub(length / 2)..(i + length - length / 2).min(values.len())];
            part.iter().sum::<Complex64>() / part.len() as f64
        };
        let all = |values: &[Complex64]| -> Vec<Complex64> { (0..values.len()).map(|i| mean(values, 30, i)).collect() };
        let samples: Vec<f64> = (0..200).map(|i| (0.37 * f64::from(i)).sin() + 0.01 * f64::from(i)).collect();
        let phases = (0..).map(|i| Complex64::cis(TAU * 0.05 * f64::from(i)));
        let turned: Vec<Complex64> = samples.iter().zip(phases.clone()).map(|(x, phase)| phase.conj() * x).collect();
        let slow = all(&all(&turned));
        let mut left = samples.clone();
        take_off(&mut left, 30, phases.clone());
        for (((x, left), slow), phase) in samples.iter().zip(&left).zip(&slow).zip(phases) {
            assert!((x - 2.0 * (slow * phase).re - left).abs() < 1e-12);
        }
    }

    #[test]
    fn averages_take_whole_orders_off_and_keep_constants() {
        let line = |i: usize, order: f64| Complex64::from_polar(1.0, TAU * order * i as f64 / 100.0);
        let kept = averaged(&(0..1000).map(|i| line(i, 0.0)).collect::<Vec<_>>(), 100);
        assert!(kept.iter().all(|a| (a - 1.0).norm() < 1e-12));
        let gone = averaged(&(0..1000).map(|i| line(i, 3.0)).collect::<Vec<_>>(), 100);
        assert!(gone[50..950].iter().all(|a| a.norm() < 1e-12));
    }
}
