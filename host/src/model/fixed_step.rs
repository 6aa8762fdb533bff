//! The declared machine with the workbench's effects, integrated in fixed steps: many short simulations of a table-driven mesh.
//!
//! The Taylor solver stops at every row of a stiffness table, 1300 times per mesh period with 800 rows: 10 s for a run of 2 s with
//! an eccentricity. Here effects are asked once per block of a few steps for their Taylor series, as the Taylor solver asks them, the series are
//! sampled at the nodes of a classical Runge-Kutta step, and the table is looked up there. The equations are the
//! harmonic balance's (rotations of four bodies, two translations along the line of action); what acts across that line is left out, as nothing
//! of it reaches the channels. Decimation by a linear-phase Kaiser filter flat to 15 kHz, delay removed.
//! Cost: about 0.2 s per run of 2 s. Limits: linear contact, constant nominal speed; a jump of an effect lies within half a step (2.5 us)
//! of its place: 2 % of the response to friction, 0.8 % of an eccentricity's, whose contacts begin at other moments; others agree with the Taylor solver to 0.3 %.

use super::harmonic_balance::Machine;
use crate::dynamics::excitation::{Effect, Facts, Forces, Moment, PairOnPath, Place};
use crate::dynamics::mesh::moment_of;
use crate::dynamics::sample::evaluate;
use crate::dynamics::series::Series;
use crate::spectral::bessel_i0;
use std::f64::consts::{PI, TAU};

/// Least rate of the integration, Hz: the stiffest mode lies below a tenth of it.
const LEAST_STEP_RATE_HZ: f64 = 200_000.0;
/// Most steps of a block: a quarter of a mesh period at the highest speeds, over which series of all orders converge.
const STEPS: usize = 48;
/// Nodes of a block: ends and middles of its steps.
const NODES: usize = 2 * STEPS + 1;
/// Time that the transient is given to decay before the first sample, s.
const RUN_IN_S: f64 = 0.35;
/// Cells in which the stiffness table is looked up.
const FINE: usize = 4096;

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

/// Noise-free accelerations of both bodies, m/s2, with what `effects` do to the machine; the measuring chain's part is the caller's.
pub fn accelerations(
    machine: &Machine,
    effects: &[Box<dyn Effect>],
    at: Point,
    samples: usize,
    rate_hz: f64,
) -> [Vec<f64>; 2] {
    let over = (LEAST_STEP_RATE_HZ / rate_hz).ceil().max(1.0) as usize;
    let h = 1.0 / (rate_hz * over as f64);
    let taps = kaiser_low_pass(rate_hz, over);
    let half = taps.len() / 2;
    let settle = (RUN_IN_S / h) as usize;
    let mut mesh = SteppedMesh::new(machine, effects, at, h);
    let mut body = Bodies::new(machine, at);
    let total = settle + samples * over + half;
    let mut fine = [Vec::with_capacity(total), Vec::with_capacity(total)];
    let mut done = 0;
    while done < total {
        let start_s = (done as f64 - settle as f64) * h;
        let count = mesh.fill(start_s, STEPS.min(total - done));
        for step in 0..count {
            let a = body.step(h, &mesh.nodes, 2 * step);
            if done + step + half >= settle {
                fine[0].push(a[4]);
                fine[1].push(a[5]);
            }
        }
        done += count;
    }
    let folded = effects.iter().map(|e| e.unfiltered()).sum::<f64>();
    fine.map(|fine| {
        (0..samples)
            .map(|n| {
                let filtered = taps.iter().zip(&fine[n * over..]).map(|(a, b)| a * b).sum::<f64>();
                filtered + folded * (fine[n * over + half] - filtered)
            })
            .collect()
    })
}

/// Angle of the pinion at `t`, turns, as the effects have it.
pub fn turns(effects: &[Box<dyn Effect>], at: Point, t: f64) -> f64 {
    let mut turns = Series::linear(at.start_rad / TAU + at.speed_hz * t, at.speed_hz * 1e-6);
    effects.iter().for_each(|e| e.turns(t, 1e-6, &mut turns));
    turns.coefficient(0)
}

/// What acts at one node: `F = k (d + tau d') - g` in the mesh, `k` and `g` of the friction's torques, the rest by place.
#[derive(Debug, Clone, Copy, Default)]
struct Node {
    k: f64,
    g: f64,
    friction: [[f64; 2]; 2],
    bearing: [f64; 2],
    torque: [f64; 2],
    force: [f64; 2],
}

/// The mesh and its effects at the nodes of a block.
struct SteppedMesh<'a> {
    effects: &'a [Box<dyn Effect>],
    facts: Facts,
    stiffness: Vec<f64>,
    knots: Vec<f64>,
    tau_s: f64,
    at: Point,
    h: f64,
    nodes: Vec<Node>,
}

impl<'a> SteppedMesh<'a> {
    fn new(machine: &Machine, effects: &'a [Box<dyn Effect>], at: Point, h: f64) -> Self {
        let facts = machine.facts(at.torque_n_m);
        let path = facts.path_base_pitches;
        let stiffness = (0..=FINE).map(|i| machine.curve.at(path * i as f64 / FINE as f64)).collect();
        let knots = effects.iter().flat_map(|e| e.path_knots(&facts)).collect();
        Self { effects, facts, stiffness, knots, tau_s: machine.tau_s, at, h, nodes: vec![Node::default(); NODES] }
    }

    fn pair_stiffness(&self, u: f64) -> f64 {
        let x = u / self.facts.path_base_pitches * FINE as f64;
        let i = x as usize;
        if u < 0.0 || i >= FINE {
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

    /// Fills the nodes from `start_s` on for at most `most` steps; the number of steps filled.
    fn fill(&mut self, start_s: f64, most: usize) -> usize {
        let steps = self.until_knot(start_s, most);
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
    fn until_knot(&self, start_s: f64, most: usize) -> usize {
        let per_step = self.at.speed_hz * f64::from(self.facts.teeth[0]) * self.h;
        // From half a step on, so that a knot just passed is not met again.
        let from = self.turns(start_s + 0.5 * self.h, self.h).coefficient(0) * f64::from(self.facts.teeth[0]);
        let to_knot = |knot: &f64| ((knot - from).rem_euclid(1.0) / per_step + 1.0) as usize;
        let breaks = self.effects.iter().map(|e| ((e.next_break_s(start_s) - start_s) / self.h) as usize);
        self.knots.iter().map(to_knot).chain(breaks).fold(most, usize::min).max(1)
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

/// Coordinates: rotations of motor, pinion, gear, load; translations of pinion and gear.
type Six = [f64; 6];

/// The bodies' state and what binds them.
struct Bodies<'a> {
    machine: &'a Machine,
    torque: [f64; 2],
    q: Six,
    v: Six,
}

impl<'a> Bodies<'a> {
    /// At rest against the mean stiffness.
    fn new(machine: &'a Machine, at: Point) -> Self {
        let ratio = f64::from(machine.teeth[0]) / f64::from(machine.teeth[1]);
        let s = &machine.shafts;
        let force = at.torque_n_m / machine.base_radius_m[0];
        let (y1, y2) = (-force / s.bearing_stiffness_n_per_m[0], force / s.bearing_stiffness_n_per_m[1]);
        let twist = (force / machine.stiffness(0).re - y1 + y2) / machine.base_radius_m[0];
        let torque = [at.torque_n_m, at.torque_n_m / ratio];
        let [input, output] = [0, 1].map(|i| torque[i] / s.coupling_stiffness_n_m_per_rad[i]);
        Self { machine, torque, q: [twist + input, twist, 0.0, -output, y1, y2], v: [0.0; 6] }
    }

    fn accelerations(&self, node: &Node, q: &Six, v: &Six) -> Six {
        let s = &self.machine.shafts;
        let [rb1, rb2] = self.machine.base_radius_m;
        let approach = rb1 * q[1] - rb2 * q[2] + q[4] - q[5];
        let rate = rb1 * v[1] - rb2 * v[2] + v[4] - v[5];
        let d = approach + self.machine.tau_s * rate;
        let mesh = node.k * d - node.g;
        let friction = node.friction.map(|[k, g]| k * d - g);
        let twist = |side: usize, i: usize| {
            s.coupling_stiffness_n_m_per_rad[side] * (q[i] - q[i + 1])
                + s.coupling_damping_n_m_s_per_rad[side] * (v[i] - v[i + 1])
        };
        let (input, output) = (twist(0, 0), twist(1, 2));
        let [k1, k2] = [0, 1].map(|i| s.bearing_stiffness_n_per_m[i] + node.bearing[i]);
        let c = s.bearing_damping_n_s_per_m;
        [
            (self.torque[0] - input + node.torque[0]) / s.inertia_motor_kg_m2,
            (input - rb1 * mesh - friction[0]) / s.inertia_pinion_kg_m2,
            (rb2 * mesh - output + friction[1]) / s.inertia_gear_kg_m2,
            (output - self.torque[1] + node.torque[1]) / s.inertia_load_kg_m2,
            (node.force[0] - k1 * q[4] - c[0] * v[4] - mesh) / s.mass_kg[0],
            (node.force[1] - k2 * q[5] - c[1] * v[5] + mesh) / s.mass_kg[1],
        ]
    }

    /// One step from node `i` on; returns the accelerations at its start.
    fn step(&mut self, h: f64, nodes: &[Node], i: usize) -> Six {
        let mix = |a: &Six, b: &Six, s: f64| -> Six { std::array::from_fn(|i| a[i] + s * b[i]) };
        let (q, v) = (self.q, self.v);
        let a1 = self.accelerations(&nodes[i], &q, &v);
        let (q2, v2) = (mix(&q, &v, 0.5 * h), mix(&v, &a1, 0.5 * h));
        let a2 = self.accelerations(&nodes[i + 1], &q2, &v2);
        let (q3, v3) = (mix(&q, &v2, 0.5 * h), mix(&v, &a2, 0.5 * h));
        let a3 = self.accelerations(&nodes[i + 1], &q3, &v3);
        let (q4, v4) = (mix(&q, &v3, h), mix(&v, &a3, h));
        let a4 = self.accelerations(&nodes[i + 2], &q4, &v4);
        for j in 0..6 {
            self.q[j] += h / 6.0 * (v[j] + 2.0 * v2[j] + 2.0 * v3[j] + v4[j]);
            self.v[j] += h / 6.0 * (a1[j] + 2.0 * a2[j] + 2.0 * a3[j] + a4[j]);
        }
        a1
    }
}

/// Low-pass at `over` times the output rate: flat to 15 kHz, 90 dB down from 36 kHz (at 51.2 kHz); odd length, unit gain.
fn kaiser_low_pass(rate_hz: f64, over: usize) -> Vec<f64> {
    let fine_hz = rate_hz * over as f64;
    let (half, beta) = ((fine_hz * 1.465e-4) as i32, 9.0);
    let cut = (25_000.0_f64).min(0.49 * rate_hz) / fine_hz;
    let mut taps: Vec<f64> = (-half..=half)
        .map(|n| {
            let x = f64::from(n);
            let sinc = if n == 0 { 2.0 * cut } else { (TAU * cut * x).sin() / (PI * x) };
            sinc * bessel_i0(beta * (1.0 - (x / f64::from(half)).powi(2)).max(0.0).sqrt()) / bessel_i0(beta)
        })
        .collect();
    let sum: f64 = taps.iter().sum();
    taps.iter_mut().for_each(|tap| *tap /= sum);
    taps
}
