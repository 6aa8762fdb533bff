//! What is injected: a family of the library at a place and with phases of its own, as samples at equal angles.

use crate::kinematic::baseline::Baseline;
use crate::kinematic::candidate::{Candidate, Domain, Kind, Shaft};
use crate::kinematic::families::{Context, ghost, passage};
use crate::kinematic::scene::Scene;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;

/// Bases of ordinary bearings, per turn of their shaft.
const BASES: (f64, f64) = (2.5, 8.0);
/// Tries for a base whose lines are mostly free.
const TRIES: usize = 50;
/// Share of the most lines that a placed family keeps.
const FREE: f64 = 0.7;
/// Phases drawn for one position.
const PHASES: usize = 1024;

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

/// The family at a place of its own.
pub fn placed(context: &Context, typical: &Candidate, random: &mut ChaCha8Rng) -> Candidate {
    let mut base = || BASES.0 + (BASES.1 - BASES.0) * random.random::<f64>();
    match typical.kind {
        Kind::Ghost => {
            let free = |c: &Candidate| !context.taken[0].near(c.base, context.scene.resolution());
            let ghosts: Vec<Candidate> = ghost::candidates(context).into_iter().filter(free).collect();
            let chosen = (random.random::<f64>() * ghosts.len() as f64) as usize;
            ghosts.into_iter().nth(chosen).unwrap_or_else(|| typical.clone())
        }
        Kind::Passage => free(context, || passage::harmonics(context, base(), Domain::Orders, passage::ALONE[0])),
        Kind::ModulatedPassage(shaft) => {
            let own = context.scene.shaft_order(shaft as usize);
            free(context, || passage::modulated(context, own * base(), shaft, Domain::Orders))
        }
        _ => typical.clone(),
    }
}

/// The first of several tries most of whose lines stand on nothing taken, or the freest.
fn free(context: &Context, mut make: impl FnMut() -> Candidate) -> Candidate {
    let half = context.scene.resolution();
    let share = |c: &Candidate| {
        let free = c.places.iter().filter(|place| !context.taken[0].near(place.order, half)).count();
        free as f64 / c.places.len().max(1) as f64
    };
    let mut best = make();
    for _ in 0..TRIES {
        if share(&best) >= FREE {
            break;
        }
        let other = make();
        if share(&other) > share(&best) {
            best = other;
        }
    }
    best
}

/// What a run and channel gets, on the whole grid.
pub fn waveform(
    scene: &Scene,
    baseline: &Baseline,
    (run, channel): (usize, usize),
    placed: &Candidate,
    strength: f64,
    phases: &Phases,
) -> Vec<f64> {
    let per_turn = scene.runs[run].angle.per_turn[0];
    let length = scene.runs[run].samples[channel].len();
    if let Kind::Pattern(shaft) | Kind::SingleTooth(shaft) = placed.kind {
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
