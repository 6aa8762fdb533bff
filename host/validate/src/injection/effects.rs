//! What is injected: a family of the library at a place and with phases of its own, or a limit at the end of a
//! channel's range; as samples over time and at equal angles.
//!
//! Lines are made at equal angles and read over time by the kernel that reads the record the other way; folded lines,
//! which no grid holds, are made over time with the phase that the shaft has there. Every channel gets its own
//! phases, every line the amplitude that the limits mean by a strength: a share of the channel's mesh line. Limit:
//! lines follow their shaft exactly.

use crate::analysis::envelope::not_locked;
use crate::signal_based::baseline::Baseline;
use crate::signal_based::candidate::{Candidate, Domain, Kind, Place, Shaft};
use crate::signal_based::clipping_detector::at_limit;
use crate::signal_based::families::clipping::{Side, farthest};
use crate::signal_based::scene::Scene;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;

/// Phases drawn for one position.
const PHASES: usize = 1024;

/// Most of a channel's range that is cut off, whatever the strength: beyond it no signal is left.
const MAX_CUT_SHARE: f64 = 0.95;

/// An effect at its place.
#[derive(Debug, Clone)]
pub enum Effect {
    /// Lines.
    Family(Candidate),
    /// A channel that stands still beyond a share of its range.
    Limited(usize, Side),
}

/// Phases of one position: of lines and channels, and the place of a pulse.
pub struct Phases(Vec<f64>);

impl Phases {
    /// Drawn anew.
    pub fn drawn(random: &mut ChaCha8Rng) -> Self {
        Self((0..PHASES).map(|_| TAU * random.random::<f64>()).collect())
    }

    fn of(&self, line: usize, channel: usize) -> f64 {
        self.0[(line * 7 + channel * 131) % PHASES]
    }
}

/// The scene with an effect of a strength in it; of runs and channels searched.
pub fn injected(scene: &Scene, baseline: &Baseline, effect: &Effect, strength: f64, phases: &Phases) -> Scene {
    let mut with = scene.clone();
    match effect {
        Effect::Limited(channel, side) => limit(&mut with, scene, *channel, *side, strength),
        Effect::Family(placed) => {
            for (r, c) in (0..scene.runs.len()).flat_map(|r| (0..scene.searched).map(move |c| (r, c))) {
                add(&mut with, scene, baseline, (r, c), (placed, strength, phases));
            }
        }
    }
    with
}

fn limit(with: &mut Scene, scene: &Scene, channel: usize, side: Side, strength: f64) {
    let level = (1.0 - strength.min(MAX_CUT_SHARE)) * farthest(scene, channel, side);
    for run in &mut with.runs {
        run.signals[channel].iter_mut().for_each(|x| *x = side.limited(*x, level));
        run.at_limit[channel] = at_limit(&run.signals[channel]);
        run.samples[channel] = run.on_grid(&run.signals[channel], scene.highest_order);
    }
}

fn add(
    with: &mut Scene,
    scene: &Scene,
    baseline: &Baseline,
    (r, c): (usize, usize),
    (placed, strength, phases): (&Candidate, f64, &Phases),
) {
    let run = &mut with.runs[r];
    if placed.domain == Domain::Folded {
        let amplitude = strength * baseline.strongest_mesh(scene, r, c);
        let (from, to) = run.angle.time_range();
        for (i, x) in run.signals[c].iter_mut().enumerate() {
            let time = i as f64 / run.rate_hz;
            if (from..=to).contains(&time) {
                let turns = run.angle.map.turns_at(time);
                let line = |(j, place): (usize, &Place)| (TAU * (place.order * turns).fract() + phases.of(j, c)).cos();
                *x += amplitude * placed.places.iter().enumerate().map(line).sum::<f64>();
            }
        }
        run.samples[c] = run.on_grid(&run.signals[c], scene.highest_order);
        return;
    }
    let added = at_equal_angles(scene, baseline, (r, c), placed, strength, phases);
    let silence = vec![0.0; run.signals[c].len()];
    // Nothing less what is known is its negative.
    let over_time = not_locked(&silence, run.rate_hz, &added, &run.angle);
    run.signals[c].iter_mut().zip(&over_time).for_each(|(x, a)| *x -= a);
    run.samples[c].iter_mut().zip(&added).for_each(|(x, a)| *x += a);
}

/// What a run and channel gets, on the whole grid.
fn at_equal_angles(
    scene: &Scene,
    baseline: &Baseline,
    (run, channel): (usize, usize),
    placed: &Candidate,
    strength: f64,
    phases: &Phases,
) -> Vec<f64> {
    let per_turn = scene.runs[run].angle.per_turn[0];
    let length = scene.runs[run].samples[channel].len();
    if let Kind::Pattern(shaft) = placed.kind {
        let amplitude = strength * baseline.strongest_mesh(scene, run, channel);
        return pulses(scene, run, placed, shaft, amplitude, phases);
    }
    let mut added = vec![0.0; length];
    for (line, place) in placed.places.iter().enumerate() {
        let mesh = match placed.kind {
            Kind::Modulation(_) => baseline.nearest_mesh(scene, run, channel, place.order),
            _ => baseline.strongest_mesh(scene, run, channel),
        };
        let mut turning = Complex64::from_polar(strength * mesh, phases.of(line, channel));
        let step = Complex64::from_polar(1.0, TAU * place.order / per_turn as f64);
        for x in &mut added {
            *x += turning.re;
            turning *= step;
        }
    }
    added
}

/// All orders of a shaft alike: a pulse once per turn, one turn made and repeated.
fn pulses(scene: &Scene, run: usize, placed: &Candidate, shaft: Shaft, amplitude: f64, phases: &Phases) -> Vec<f64> {
    let angle = &scene.runs[run].angle;
    let per_turn = angle.per_turn[shaft as usize];
    let own = scene.shaft_order(shaft as usize);
    let place = phases.of(0, 0);
    let mut turn = vec![0.0; per_turn];
    for line in &placed.places {
        let n = (line.order / own).round();
        let mut turning = Complex64::from_polar(amplitude, (n * place) % TAU);
        let step = Complex64::from_polar(1.0, TAU * n / per_turn as f64);
        for x in &mut turn {
            *x += turning.re;
            turning *= step;
        }
    }
    let length = angle.turns * angle.per_turn[0];
    (0..length).map(|i| turn[i % per_turn]).collect()
}
