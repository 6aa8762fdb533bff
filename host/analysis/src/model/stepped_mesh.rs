//! The mesh and the simulator's effects at the nodes of fixed steps.
//!
//! Effects are asked once per block of a few steps for their Taylor series, as the Taylor solver asks them; the
//! series are sampled at the nodes of the steps, and the stiffness table is looked up there.

use super::harmonic_balance::Machine;
use crate::dynamics::excitation::{Effect, Facts, Forces, Moment, PairOnPath, Place};
use crate::dynamics::mesh::moment_of;
use crate::dynamics::sample::evaluate;
use crate::dynamics::series::Series;
use crate::stiffness::pair_curve::PairCurve;
use std::f64::consts::TAU;

/// Most steps of a block: a quarter of a mesh period at the highest speeds, over which series of all orders converge.
const STEPS: usize = 48;
/// Nodes of a block: ends and middles of its steps.
const NODES: usize = 2 * STEPS + 1;
/// Cells in which a stiffness table of uneven steps is looked up; an even one is looked up in its own, since drawing
/// it again by straight lines would take harmonic `k` down by `(pi k h)^2 / 3`, 0.3 % of the 77th with 4096 cells.
const FINE: usize = 16_384;
/// Departure of positions from even steps, base pitches, below which a table is even: what a printed table's last
/// digit does.
const EVEN: f64 = 1e-8;
/// Base pitches beside the path within which a pair may enter it between the places looked at.
const BESIDE: f64 = 0.05;

/// Where and how one run is taken.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// Angle of the pinion at the first sample, rad.
    pub start_rad: f64,
    /// Pinion speed, Hz.
    pub speed_hz: f64,
    /// Input torque, N m.
    pub torque_n_m: f64,
}

/// What acts at one node: `F = k (d + tau d') - g` in the mesh, `k` and `g` of the friction's torques, the rest by
/// place.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Node {
    pub k: f64,
    pub g: f64,
    pub friction: [[f64; 2]; 2],
    pub bearing: [f64; 2],
    pub torque: [f64; 2],
    pub force: [f64; 2],
}

/// The mesh and its effects, block by block.
pub(super) struct SteppedMesh<'a> {
    effects: &'a [Box<dyn Effect>],
    facts: Facts,
    stiffness: Vec<f64>,
    knots: Vec<f64>,
    tau_s: f64,
    at: Point,
    h: f64,
    start_s: f64,
    nodes: Vec<Node>,
    /// Steps that the nodes reach from `start_s` on, and how many of them were taken.
    filled: usize,
    taken: usize,
}

impl<'a> SteppedMesh<'a> {
    /// Steps of length `h` (s) from `start_s` on.
    pub fn new(machine: &Machine, effects: &'a [Box<dyn Effect>], at: Point, h: f64, start_s: f64) -> Self {
        let facts = machine.facts(at.torque_n_m);
        let stiffness = cells(&machine.curve);
        let knots = effects.iter().flat_map(|e| e.path_knots(&facts)).collect();
        let nodes = vec![Node::default(); NODES];
        Self { effects, facts, stiffness, knots, tau_s: machine.tau_s, at, h, start_s, nodes, filled: 0, taken: 0 }
    }

    /// Nodes at the start, middle and end of the next step; at a jump the end is what was before it.
    pub fn next_step(&mut self) -> &[Node; 3] {
        if self.taken == self.filled {
            self.start_s += self.filled as f64 * self.h;
            self.filled = self.fill(self.start_s);
            self.taken = 0;
        }
        let first = 2 * self.taken;
        self.taken += 1;
        self.nodes[first..].first_chunk().expect("a step has three nodes")
    }

    fn pair_stiffness(&self, u: f64) -> f64 {
        let cells = self.stiffness.len() - 1;
        let x = u / self.facts.path_base_pitches * cells as f64;
        let i = x as usize;
        if u < 0.0 || i >= cells {
            return 0.0;
        }
        self.stiffness[i] + (x - i as f64) * (self.stiffness[i + 1] - self.stiffness[i])
    }

    fn turns(&self, start_s: f64, length_s: f64) -> Series {
        let mut turns =
            Series::linear(self.at.start_rad / TAU + self.at.speed_hz * start_s, self.at.speed_hz * length_s);
        self.effects.iter().for_each(|e| e.turns(start_s, length_s, &mut turns));
        turns
    }

    /// Fills the nodes from `start_s` on; the number of steps filled.
    fn fill(&mut self, start_s: f64) -> usize {
        let steps = self.until_knot(start_s);
        let length_s = steps as f64 * self.h;
        let turns = self.turns(start_s, length_s);
        let facts = self.facts;
        let moment = moment_of(&facts, start_s, length_s, &turns);
        let mut position = turns.scaled(f64::from(facts.teeth[0]));
        self.effects.iter().for_each(|e| e.shift(&moment, &mut position));
        self.nodes[..=2 * steps].fill(Node::default());
        let ends = [0.0, 0.5, 1.0].map(|x| position.value(x));
        let lowest = ends.iter().fold(f64::INFINITY, |m, x| m.min(*x)) - facts.path_base_pitches;
        let highest = ends.iter().fold(f64::NEG_INFINITY, |m, x| m.max(*x));
        for number in lowest.floor() as i64..=highest.ceil() as i64 {
            self.add_pair(number, &moment, &position, steps);
        }
        self.add_places(&moment, steps);
        steps
    }

    /// Steps until a pair crosses a place on its path where an effect is not smooth, or an effect breaks in time.
    fn until_knot(&self, start_s: f64) -> usize {
        let per_step = self.at.speed_hz * f64::from(self.facts.teeth[0]) * self.h;
        // From half a step on, so that a knot just passed is not met again.
        let from = self.turns(start_s + 0.5 * self.h, self.h).coefficient(0) * f64::from(self.facts.teeth[0]);
        let to_knot = |knot: &f64| ((knot - from).rem_euclid(1.0) / per_step + 1.0) as usize;
        let breaks = self.effects.iter().map(|e| ((e.next_break_s(start_s) - start_s) / self.h) as usize);
        self.knots.iter().map(to_knot).chain(breaks).fold(STEPS, usize::min).max(1)
    }

    fn add_pair(&mut self, number: i64, moment: &Moment<'_>, position: &Series, steps: usize) {
        let mut place = *position;
        place.add_constant(-(number as f64));
        let ends = [0.0, 0.5, 1.0].map(|x| place.value(x));
        let path = self.facts.path_base_pitches;
        if ends.iter().all(|s| *s < -BESIDE) || ends.iter().all(|s| *s > path + BESIDE) {
            return;
        }
        let tooth = self.facts.teeth.map(|z| number.rem_euclid(i64::from(z)) as u32);
        let pair = PairOnPath { number, tooth, position: place };
        let (mut factor, mut error) = (Series::constant(1.0), Series::ZERO);
        let mut friction: Option<Series> = None;
        for effect in self.effects {
            effect.pair_stiffness(moment, &pair, &mut factor);
            effect.pair_error(moment, &pair, &mut error);
            if let Some(coefficient) = effect.friction(moment, &pair) {
                friction.get_or_insert(Series::ZERO).add_scaled(&coefficient, 1.0);
            }
        }
        let [places, factors] = [&place, &factor].map(|series| sampled(series, steps));
        error.add_scaled(&error.derivative(), self.tau_s / moment.length_s);
        let errors = (!error.is_zero()).then(|| sampled(&error, steps));
        let arms = friction.map(|coefficient| {
            [0, 1].map(|body| sampled(&coefficient.product(&self.facts.roll_distance_m(body, &place)), steps))
        });
        for i in 0..=2 * steps {
            let k = self.pair_stiffness(places[i]) * factors[i];
            if k == 0.0 {
                continue;
            }
            let g = errors.as_ref().map_or(0.0, |errors| k * errors[i]);
            let node = &mut self.nodes[i];
            node.k += k;
            node.g += g;
            if let Some(arms) = &arms {
                for body in 0..2 {
                    node.friction[body][0] += arms[body][i] * k;
                    node.friction[body][1] += arms[body][i] * g;
                }
            }
        }
    }

    fn add_places(&mut self, moment: &Moment<'_>, steps: usize) {
        for body in 0..2 {
            for change in self.effects.iter().filter_map(|e| e.bearing(moment, body)) {
                self.nodes.iter_mut().zip(sampled(&change, steps)).for_each(|(n, x)| n.bearing[body] += x);
            }
        }
        let mut forces = Forces::default();
        self.effects.iter().for_each(|e| e.force(moment, &mut forces));
        for (place, series) in forces.0 {
            let slot: fn(&mut Node) -> &mut f64 = match place {
                Place::Motor => |n| &mut n.torque[0],
                Place::Load => |n| &mut n.torque[1],
                Place::Along(0) => |n| &mut n.force[0],
                Place::Along(_) => |n| &mut n.force[1],
                Place::Across(_) => continue,
            };
            self.nodes.iter_mut().zip(sampled(&series, steps)).for_each(|(n, x)| *slot(n) += x);
        }
    }
}

/// Stiffness at even steps over the path.
fn cells(curve: &PairCurve) -> Vec<f64> {
    let (path, rows) = (curve.contact_ratio(), curve.u.len() - 1);
    let is_even = |(i, u): (usize, &f64)| (u - path * i as f64 / rows as f64).abs() < EVEN;
    if curve.u.iter().enumerate().all(is_even) {
        return curve.k.clone();
    }
    (0..=FINE).map(|i| curve.at(path * i as f64 / FINE as f64)).collect()
}

/// A series at the nodes of a block.
fn sampled(series: &Series, steps: usize) -> Vec<f64> {
    let mut values = vec![0.0; 2 * steps + 1];
    if series.degree() == 0 {
        values.fill(series.coefficient(0));
    } else {
        evaluate(series, 0.0, 0.5 / steps as f64, &mut values);
    }
    values
}
