//! Six bodies' coordinates in classical Runge-Kutta steps, the runs of a record side by side.
//!
//! One run is bound by the latency of its chain of dependent operations; four in the vector units' lanes take little
//! longer than one.

use super::harmonic_balance::Machine;
use super::stepped_mesh::{Node, Point, SteppedMesh};
use crate::lanes::{LANES, Lane, Several};

/// Coordinates: rotations of motor, pinion, gear, load; translations of pinion and gear.
type Six<V> = [V; 6];
/// Steps whose nodes are gathered before they are taken.
const AHEAD: usize = 16;

/// What acts at a node, of all runs.
#[derive(Clone, Copy)]
struct Acting<V> {
    k: V,
    g: V,
    friction: [[V; 2]; 2],
    bearing: [V; 2],
    torque: [V; 2],
    force: [V; 2],
}

impl Acting<Several> {
    fn put(&mut self, lane: usize, node: &Node) {
        self.k.0[lane] = node.k;
        self.g.0[lane] = node.g;
        for i in 0..2 {
            self.friction[i][0].0[lane] = node.friction[i][0];
            self.friction[i][1].0[lane] = node.friction[i][1];
            self.bearing[i].0[lane] = node.bearing[i];
            self.torque[i].0[lane] = node.torque[i];
            self.force[i].0[lane] = node.force[i];
        }
    }
}

/// Constants of the equations: stiffness and damping of the couplings and bearings, radii, inertias inverted.
#[derive(Debug, Clone, Copy)]
struct Equations<V> {
    base_radius_m: [V; 2],
    tau_s: V,
    coupling: [[V; 2]; 2],
    bearing: [[V; 2]; 2],
    per_inertia: [V; 4],
    per_mass: [V; 2],
    torque: [V; 2],
    h: V,
    half: V,
    sixth: V,
    two: V,
}

/// Up to [`LANES`] runs of one machine, stepped together; lanes left over repeat the first run.
pub(super) struct Bodies<'a> {
    meshes: Vec<SteppedMesh<'a>>,
    equations: Equations<Several>,
    q: Six<Several>,
    v: Six<Several>,
    ahead: Vec<[Acting<Several>; 3]>,
    units: pulp::Arch,
}

impl<'a> Bodies<'a> {
    /// At rest against the mean stiffness, each at its own point; steps of `h` (s).
    pub fn new(machine: &Machine, meshes: Vec<SteppedMesh<'a>>, at: &[Point], h: f64) -> Self {
        let s = &machine.shafts;
        let ratio = f64::from(machine.teeth[0]) / f64::from(machine.teeth[1]);
        let points: [Point; LANES] = std::array::from_fn(|l| at[if l < at.len() { l } else { 0 }]);
        let torque = points.map(|at| [at.torque_n_m, at.torque_n_m / ratio]);
        let rest = points.map(|at| at_rest(machine, at));
        let equations = Equations {
            base_radius_m: machine.base_radius_m.map(Lane::of),
            tau_s: Lane::of(machine.tau_s),
            coupling: [0, 1]
                .map(|i| [s.coupling_stiffness_n_m_per_rad[i], s.coupling_damping_n_m_s_per_rad[i]].map(Lane::of)),
            bearing: [0, 1].map(|i| [s.bearing_stiffness_n_per_m[i], s.bearing_damping_n_s_per_m[i]].map(Lane::of)),
            per_inertia: [s.inertia_motor_kg_m2, s.inertia_pinion_kg_m2, s.inertia_gear_kg_m2, s.inertia_load_kg_m2]
                .map(|inertia| Lane::of(1.0 / inertia)),
            per_mass: s.mass_kg.map(|mass| Lane::of(1.0 / mass)),
            torque: [0, 1].map(|i| Several(torque.map(|torque| torque[i]))),
            h: Lane::of(h),
            half: Lane::of(0.5 * h),
            sixth: Lane::of(h / 6.0),
            two: Lane::of(2.0),
        };
        let zero = Several::of(0.0);
        let nothing = Acting {
            k: zero,
            g: zero,
            friction: [[zero; 2]; 2],
            bearing: [zero; 2],
            torque: [zero; 2],
            force: [zero; 2],
        };
        Self {
            meshes,
            equations,
            q: std::array::from_fn(|i| Several(rest.map(|q| q[i]))),
            v: [zero; 6],
            ahead: vec![[nothing; 3]; AHEAD],
            units: pulp::Arch::new(),
        }
    }

    /// Takes some steps and appends the translations' accelerations at their starts.
    pub fn advance(&mut self, accelerations: &mut [Vec<Several>; 2]) {
        for (lane, mesh) in self.meshes.iter_mut().enumerate() {
            for ahead in &mut self.ahead {
                let nodes = mesh.next_step();
                ahead.iter_mut().zip(nodes).for_each(|(acting, node)| acting.put(lane, node));
            }
        }
        for lane in self.meshes.len()..LANES {
            for acting in self.ahead.iter_mut().flatten() {
                acting.put(lane, &acting.of_first());
            }
        }
        let taken = Steps { equations: &self.equations, q: &mut self.q, v: &mut self.v, ahead: &self.ahead };
        for step in self.units.dispatch(taken) {
            for (list, value) in accelerations.iter_mut().zip(step) {
                list.push(value);
            }
        }
    }
}

impl Acting<Several> {
    fn of_first(&self) -> Node {
        let first = |value: &Several| value.0[0];
        Node {
            k: first(&self.k),
            g: first(&self.g),
            friction: self.friction.map(|both| both.map(|value| first(&value))),
            bearing: self.bearing.map(|value| first(&value)),
            torque: self.torque.map(|value| first(&value)),
            force: self.force.map(|value| first(&value)),
        }
    }
}

/// Deflections under the torque alone.
fn at_rest(machine: &Machine, at: Point) -> [f64; 6] {
    let ratio = f64::from(machine.teeth[0]) / f64::from(machine.teeth[1]);
    let s = &machine.shafts;
    let force = at.torque_n_m / machine.base_radius_m[0];
    let (y1, y2) = (-force / s.bearing_stiffness_n_per_m[0], force / s.bearing_stiffness_n_per_m[1]);
    let twist = (force / machine.stiffness(0).re - y1 + y2) / machine.base_radius_m[0];
    let torque = [at.torque_n_m, at.torque_n_m / ratio];
    let [input, output] = [0, 1].map(|i| torque[i] / s.coupling_stiffness_n_m_per_rad[i]);
    [twist + input, twist, 0.0, -output, y1, y2]
}

/// Some steps as what the vector units' dispatch takes: everything it calls must be compiled into it.
struct Steps<'b> {
    equations: &'b Equations<Several>,
    q: &'b mut Six<Several>,
    v: &'b mut Six<Several>,
    ahead: &'b [[Acting<Several>; 3]],
}

impl pulp::WithSimd for Steps<'_> {
    type Output = [[Several; 2]; AHEAD];

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> Self::Output {
        let (mut q, mut v) = (*self.q, *self.v);
        let equations = *self.equations;
        let mut taken = [[Several::of(0.0); 2]; AHEAD];
        for (taken, nodes) in taken.iter_mut().zip(self.ahead) {
            *taken = equations.step(nodes, &mut q, &mut v);
        }
        (*self.q, *self.v) = (q, v);
        taken
    }
}

impl<V: Lane> Equations<V> {
    #[inline(always)]
    fn accelerations(&self, node: &Acting<V>, q: &Six<V>, v: &Six<V>) -> Six<V> {
        let [rb1, rb2] = self.base_radius_m;
        let approach = rb1 * q[1] - rb2 * q[2] + q[4] - q[5];
        let rate = rb1 * v[1] - rb2 * v[2] + v[4] - v[5];
        let d = approach + self.tau_s * rate;
        let mesh = node.k * d - node.g;
        let friction = [0, 1].map(|i| node.friction[i][0] * d - node.friction[i][1]);
        let twist = |side: usize, i: usize| {
            self.coupling[side][0] * (q[i] - q[i + 1]) + self.coupling[side][1] * (v[i] - v[i + 1])
        };
        let (input, output) = (twist(0, 0), twist(1, 2));
        let held = |i: usize| (self.bearing[i][0] + node.bearing[i]) * q[4 + i] + self.bearing[i][1] * v[4 + i];
        [
            (self.torque[0] - input + node.torque[0]) * self.per_inertia[0],
            (input - rb1 * mesh - friction[0]) * self.per_inertia[1],
            (rb2 * mesh - output + friction[1]) * self.per_inertia[2],
            (output - self.torque[1] + node.torque[1]) * self.per_inertia[3],
            (node.force[0] - held(0) - mesh) * self.per_mass[0],
            (node.force[1] - held(1) + mesh) * self.per_mass[1],
        ]
    }

    /// One step over its three nodes; the translations' accelerations at its start.
    #[inline(always)]
    fn step(&self, nodes: &[Acting<V>; 3], q: &mut Six<V>, v: &mut Six<V>) -> [V; 2] {
        let mix = |a: &Six<V>, b: &Six<V>, s: V| -> Six<V> { std::array::from_fn(|i| a[i] + s * b[i]) };
        let a1 = self.accelerations(&nodes[0], q, v);
        let (q2, v2) = (mix(q, v, self.half), mix(v, &a1, self.half));
        let a2 = self.accelerations(&nodes[1], &q2, &v2);
        let (q3, v3) = (mix(q, &v2, self.half), mix(v, &a2, self.half));
        let a3 = self.accelerations(&nodes[1], &q3, &v3);
        let (q4, v4) = (mix(q, &v3, self.h), mix(v, &a3, self.h));
        let a4 = self.accelerations(&nodes[2], &q4, &v4);
        for j in 0..6 {
            q[j] = q[j] + self.sixth * (v[j] + self.two * (v2[j] + v3[j]) + v4[j]);
            v[j] = v[j] + self.sixth * (a1[j] + self.two * (a2[j] + a3[j]) + a4[j]);
        }
        [a1[4], a1[5]]
    }
}
