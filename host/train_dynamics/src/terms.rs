//! Stiffness and errors of every mesh over one step as Taylor series, and where the step has to end.
//!
//! A mesh's stiffness is one polynomial between two knots of its sum over pairs; the step ends at the nearest knot of
//! any mesh. Errors common to all pairs multiply that sum, errors of single teeth their own pair's curve, whose knots
//! are among the sum's. Cost: one short composition per mesh and step, more only where effects act.

use crate::assembly::{MeshLine, System};
use crate::effects::{Disturbance, Effect};
use meshband_mechanics::dynamics::{Motion, Series};
use std::f64::consts::TAU;

/// Position ahead of the contact, base pitches, by which a piece is chosen at a knot.
const LOOKAHEAD_PITCHES: f64 = 1e-10;
/// Share of a series' largest coefficient below which its last ones are dropped: some units of rounding.
const NEGLIGIBLE_TERM_SHARE: f64 = 1e-15;
/// Iterations of Newton's method for the time of a knot where the speed changes.
const NEWTON_ITERATIONS: usize = 8;

/// One mesh over a step.
#[derive(Debug, Clone, Default)]
pub(crate) struct MeshTerm {
    /// Stiffness, N/m, lowest power first.
    pub k: Vec<f64>,
    /// Force of errors, N; empty where there are none.
    pub g: Vec<f64>,
}

/// All meshes of a train in motion.
pub(crate) struct Terms<'a> {
    system: &'a System,
    motion: &'a Motion,
    disturbances: Vec<Disturbance>,
    /// Of the present step.
    pub meshes: Vec<MeshTerm>,
    /// Angular acceleration of shaft 0, rad/s2; empty at constant speed.
    pub acceleration: Vec<f64>,
}

impl<'a> Terms<'a> {
    /// A train in motion under effects.
    pub fn new(system: &'a System, motion: &'a Motion, effects: &[Effect]) -> Self {
        let disturbances = system.meshes.iter().map(|mesh| Disturbance::of(system, mesh, effects)).collect();
        let meshes = vec![MeshTerm::default(); system.meshes.len()];
        Self { system, motion, disturbances, meshes, acceleration: Vec::new() }
    }

    /// Sets up a step from `t` of at most `longest` seconds; gives its length, s.
    pub fn begin(&mut self, t: f64, longest: f64) -> f64 {
        let mut h = longest.min(self.motion.next_break(t) - t);
        let mut turns = self.motion.turns(t, h);
        let mut passages: Vec<Passage> = Vec::with_capacity(self.meshes.len());
        let mut part: f64 = 1.0;
        for (mesh, disturbance) in self.system.meshes.iter().zip(&self.disturbances) {
            let passage = Passage::of(&turns, mesh, disturbance);
            let (frac, piece) = self.place(mesh.stiffness, &passage.position);
            let knot = self.system.stiffnesses[mesh.stiffness].total.knots()[piece + 1];
            part = part.min(time_of(&frac, knot));
            passages.push(passage);
        }
        if part < 1.0 {
            h *= part;
            turns = turns.rescaled(part);
            passages.iter_mut().for_each(|passage| *passage = passage.rescaled(part));
        }
        let mut meshes = std::mem::take(&mut self.meshes);
        for (index, (term, passage)) in meshes.iter_mut().zip(&passages).enumerate() {
            self.collect(index, passage, h, term);
        }
        self.meshes = meshes;
        self.acceleration.clear();
        if turns.degree() > 1 {
            let second = turns.derivative().derivative().scaled(TAU / (h * h));
            self.acceleration.extend_from_slice(second.coefficients());
        }
        h
    }

    /// Position within the present base pitch, and the piece of the sum's curve there.
    fn place(&self, stiffness: usize, position: &Series) -> (Series, usize) {
        let ahead = position.coefficient(0) + LOOKAHEAD_PITCHES;
        let mut frac = *position;
        frac.add_constant(-ahead.floor());
        let total = &self.system.stiffnesses[stiffness].total;
        let last = total.knots().len() - 2;
        (frac, total.locate(ahead - ahead.floor()).unwrap_or(last))
    }

    fn collect(&self, index: usize, passage: &Passage, h: f64, term: &mut MeshTerm) {
        let mesh = &self.system.meshes[index];
        let disturbance = &self.disturbances[index];
        let curves = &self.system.stiffnesses[mesh.stiffness];
        let position = passage.position;
        let (mut local, piece) = self.place(mesh.stiffness, &position);
        local.add_constant(-curves.total.knots()[piece]);
        let mut k = local.compose(curves.total.piece(piece));
        term.g.clear();
        let mut of_teeth = Series::ZERO;
        if !disturbance.teeth.is_empty() {
            let start = position.coefficient(0) + LOOKAHEAD_PITCHES;
            let knots = curves.pair.knots();
            let (first, last) = ((start - knots[knots.len() - 1]).floor() as i64, (start - knots[0]).floor() as i64);
            for number in first..=last {
                let Some(piece) = curves.pair.locate(start - number as f64) else { continue };
                let mut local = position;
                local.add_constant(-(number as f64) - knots[piece]);
                let pair = local.compose(curves.pair.piece(piece));
                let (mut error, mut kept) = (0.0, 1.0);
                for (e, loss) in disturbance.teeth.iter().map(|teeth| teeth.of_pair(number)) {
                    error += e;
                    kept *= 1.0 - loss;
                }
                k.add_scaled(&pair, kept - 1.0);
                of_teeth.add_scaled(&pair, kept * error);
            }
        }
        if let Some(mut error) = passage.error {
            let rate = error.derivative();
            error.add_scaled(&rate, mesh.damping_s / h);
            of_teeth.add_scaled(&k.product(&error), 1.0);
        }
        put(&k, &mut term.k);
        if !of_teeth.is_zero() {
            put(&of_teeth, &mut term.g);
        }
    }
}

/// How a mesh goes through a step.
#[derive(Debug, Clone, Copy)]
struct Passage {
    /// Position of the contact of pair 0, base pitches.
    position: Series,
    /// Error of all pairs alike, m, where there is one.
    error: Option<Series>,
}

impl Passage {
    fn of(turns: &Series, mesh: &MeshLine, disturbance: &Disturbance) -> Self {
        let mut even = turns.scaled(mesh.order);
        even.add_constant(mesh.phase);
        if disturbance.waves.is_empty() {
            return Self { position: even, error: None };
        }
        let (mut position, mut error) = (even, Series::ZERO);
        for wave in &disturbance.waves {
            let mut angle = even.scaled(TAU * wave.cycles);
            angle.add_constant(wave.phase_rad);
            let sine = angle.sin_cos().0.scaled(wave.amplitude_m);
            error.add_scaled(&sine, 1.0);
            if wave.roll_per_m != 0.0 {
                position.add_scaled(&sine, wave.roll_per_m);
            }
        }
        Self { position, error: Some(error) }
    }

    fn rescaled(&self, part: f64) -> Self {
        Self { position: self.position.rescaled(part), error: self.error.map(|error| error.rescaled(part)) }
    }
}

/// Coefficients without the last ones that no sum would see.
fn put(series: &Series, into: &mut Vec<f64>) {
    let coefficients = series.coefficients();
    let largest = coefficients.iter().fold(0.0_f64, |most, c| most.max(c.abs()));
    let used = coefficients.iter().rposition(|c| c.abs() > NEGLIGIBLE_TERM_SHARE * largest).map_or(1, |last| last + 1);
    into.clear();
    into.extend_from_slice(&coefficients[..used]);
}

/// Part of the step at which an ascending series reaches a value; beyond 1 where it does not.
fn time_of(series: &Series, value: f64) -> f64 {
    let slope = series.coefficient(1);
    let mut tau = (value - series.coefficient(0)) / slope;
    // Far beyond the step its series says nothing, and the speed does not change so much.
    if series.degree() > 1 && tau < 2.0 {
        let derivative = series.derivative();
        for _ in 0..NEWTON_ITERATIONS {
            tau -= (series.value(tau) - value) / derivative.value(tau);
        }
    }
    if tau > 0.0 { tau } else { f64::INFINITY }
}
