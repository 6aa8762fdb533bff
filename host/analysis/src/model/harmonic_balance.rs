//! Harmonic balance of the declared machine: exact steady responses on a comb of orders.
//!
//! `M q'' + C q' + K q + h F = f`, `F = k(theta) (1 + tau d/dt) h.q + g`, with q = motor, pinion, gear and load
//! rotation, pinion and gear translation along the line of action. Only the scalar approach `delta = h.q` meets the
//! periodic stiffness, so with `a(w) = h.D(w)^-1 h` the comb of orders `o + n z1` reduces to
//! `delta_n + a_n F_n = h.D_n^-1 f_n`, one dense complex system per comb, speed and machine; its LU factor serves any
//! excitation on that comb. At w = 0 the free rotation makes `a` infinite and the row becomes the torque balance
//! `F_0 = T / rb1`. Cost: (2 N + 1)^3 / 3 complex operations. Limits: linear contact (no loss), constant speed,
//! harmonics up to 16.5 kHz. SI units.

mod beyond;

use super::forward::{ForwardModel, Line, Operating};
use super::pieces::finer;
use crate::dynamics::excitation::Facts;
use crate::machine::{Pair, Shafts};
use crate::stiffness::pair_curve::PairCurve;
use nalgebra::{DMatrix, DVector, Dyn, LU};
use rustfft::num_complex::Complex64 as C;
use std::f64::consts::TAU;

/// Degrees of freedom, in the order of every force vector.
pub const DOF: usize = 6;
/// Index of the motor's rotation.
pub const MOTOR: usize = 0;
/// Index of the pinion's rotation.
pub const PINION: usize = 1;
/// Index of the gear's rotation.
pub const GEAR: usize = 2;
/// Index of the load's rotation.
pub const LOAD: usize = 3;
/// Index of the pinion's translation.
pub const PINION_Y: usize = 4;
/// Index of the gear's translation.
pub const GEAR_Y: usize = 5;

/// Highest frequency kept in the balance of a small effect, Hz.
pub const TOP_HZ: f64 = 16_500.0;
/// Highest frequency of the declared machine's own balance, Hz: harmonics above the band still act on those below.
pub const OWN_TOP_HZ: f64 = 26_000.0;

/// The declared linear machine, ready for harmonic balance.
#[derive(Debug, Clone)]
pub struct Machine {
    /// Numbers of teeth of pinion and gear.
    pub teeth: [u32; 2],
    /// Base radii, m.
    pub base_radius_m: [f64; 2],
    /// Operating pressure angle, rad.
    pub pressure_angle_rad: f64,
    /// Pair stiffness along the path of contact.
    pub curve: PairCurve,
    /// Mesh damping time, s.
    pub tau_s: f64,
    /// Shafts, bearings, inertias.
    pub shafts: Shafts,
    coefficients: Vec<C>,
}

/// Frequency response of the machine without the mesh, reduced to what the balance needs.
#[derive(Debug, Clone, Copy)]
struct Dynamics {
    /// `D^-1` of the motor-pinion and gear-load torsional pairs, 2 x 2 each: [motor, pinion], [gear, load].
    input: [[C; 2]; 2],
    output: [[C; 2]; 2],
    translation: [C; 2],
}

/// Factorised balance of one comb `base + n z1` at one speed.
pub struct Comb {
    /// Orders of the comb, from the lowest.
    pub orders: Vec<f64>,
    /// Index of `n = 0`.
    pub centre: usize,
    shaft_hz: f64,
    rigid_row: Option<usize>,
    compliance: Vec<C>,
    dynamics: Vec<Dynamics>,
    lu: LU<C, Dyn, Dyn>,
}

/// Solution of a comb.
#[derive(Debug, Clone)]
pub struct Solution {
    /// Acceleration lines of both channels.
    pub lines: Vec<Line>,
    /// `(1 + tau d/dt) delta` at each order, m.
    pub approach: Vec<C>,
    /// Mesh force at each order, N.
    pub force: Vec<C>,
    /// Translations at each order, m.
    pub translation: Vec<[C; 2]>,
    /// Rotations of motor, pinion, gear and load at each order, rad (zero at order 0).
    pub rotation: Vec<[C; 4]>,
}

/// A run of the declared machine: the factorised comb of its mesh and the steady state on it.
pub struct Balanced {
    /// The mesh's comb.
    pub comb: Comb,
    /// The steady state.
    pub solution: Solution,
}

impl ForwardModel for Machine {
    type Run = Balanced;

    fn run(&self, at: Operating) -> Balanced {
        let comb = self.own_comb(at.shaft_hz);
        let solution = self.base(&comb, at.torque_n_m);
        Balanced { comb, solution }
    }

    fn prediction<'a>(&self, run: &'a Balanced) -> &'a [Line] {
        &run.solution.lines
    }

    fn jacobian(&self, run: &Balanced) -> Vec<Vec<Line>> {
        self.sensitivities(&run.comb, &run.solution)
    }
}

impl Solution {
    /// The middle `2 half + 1` orders.
    pub fn within(&self, half: usize) -> Self {
        let cut = (self.lines.len() / 2).saturating_sub(half);
        let range = cut..self.lines.len() - cut;
        Self {
            lines: self.lines[range.clone()].to_vec(),
            approach: self.approach[range.clone()].to_vec(),
            force: self.force[range.clone()].to_vec(),
            translation: self.translation[range.clone()].to_vec(),
            rotation: self.rotation[range].to_vec(),
        }
    }
}

/// Harmonics of the mesh that are known.
const HARMONICS: u32 = 1024;

/// Coefficients of the mesh stiffness of pairs with this one's, from the mean on.
fn tabulated(curve: &PairCurve) -> Vec<C> {
    let curve = finer(curve);
    (0..=HARMONICS).map(|n| curve.transform(f64::from(n))).collect()
}

impl Machine {
    /// The machine of a declaration with its pair stiffness.
    pub fn new(pair: &Pair, shafts: &Shafts, curve: &PairCurve) -> Self {
        let angle = pair.pressure_angle_deg.to_radians();
        let base_radius_m = pair.teeth.map(|z| 0.5 * pair.module_m * f64::from(z) * angle.cos());
        Self {
            teeth: pair.teeth,
            base_radius_m,
            pressure_angle_rad: angle,
            curve: curve.clone(),
            tau_s: pair.mesh_damping_s,
            shafts: shafts.clone(),
            coefficients: tabulated(curve),
        }
    }

    /// Multiplies the stiffness of every pair.
    pub fn stiffen(&mut self, factor: f64) {
        self.curve.k.iter_mut().for_each(|k| *k *= factor);
        self.coefficients.iter_mut().for_each(|coefficient| *coefficient *= factor);
    }

    /// What effects may ask, at a torque.
    pub fn facts(&self, input_torque_n_m: f64) -> Facts {
        let [rb1, rb2] = self.base_radius_m;
        let (cos, tangent) = (self.pressure_angle_rad.cos(), self.pressure_angle_rad.tan());
        let z2 = f64::from(self.teeth[1]);
        let outer = rb2 / (z2 * cos) * (z2 + 2.0);
        // Along the line of action from the pinion's tangent point: the path begins where the gear's tip meets it.
        let start = (rb1 + rb2) * tangent - (outer * outer - rb2 * rb2).max(0.0).sqrt();
        let base_pitch_m = TAU * rb1 / f64::from(self.teeth[0]);
        Facts {
            teeth: self.teeth,
            base_radius_m: self.base_radius_m,
            base_pitch_m,
            pressure_angle_rad: self.pressure_angle_rad,
            path_base_pitches: self.curve.contact_ratio(),
            pitch_point_base_pitches: (rb1 * tangent - start) / base_pitch_m,
            mass_kg: self.shafts.mass_kg,
            input_torque_n_m,
            bearing_stiffness_n_per_m: self.shafts.bearing_stiffness_n_per_m,
        }
    }

    /// Fourier coefficient `n` of the total mesh stiffness, N/m.
    pub fn stiffness(&self, n: i64) -> C {
        let value = self.coefficients.get(n.unsigned_abs() as usize).copied().unwrap_or(C::ZERO);
        if n < 0 { value.conj() } else { value }
    }

    /// Harmonics on each side of a comb at a pinion speed.
    pub fn harmonics(&self, shaft_hz: f64) -> i64 {
        self.harmonics_to(TOP_HZ, shaft_hz)
    }

    fn harmonics_to(&self, top_hz: f64, shaft_hz: f64) -> i64 {
        ((top_hz / (shaft_hz * f64::from(self.teeth[0]))).ceil() as i64 + 2).clamp(24, 240)
    }

    fn dynamics(&self, omega: f64) -> Dynamics {
        let s = &self.shafts;
        let i = C::new(0.0, omega);
        let torsion = |first: f64, second: f64, side: usize| {
            let shaft = i * s.coupling_damping_n_m_s_per_rad[side] + s.coupling_stiffness_n_m_per_rad[side];
            let (a, d) = (shaft - omega * omega * first, shaft - omega * omega * second);
            let inverse = C::ONE / (a * d - shaft * shaft);
            [[d * inverse, shaft * inverse], [shaft * inverse, a * inverse]]
        };
        let body = |b: usize| {
            C::ONE
                / (i * s.bearing_damping_n_s_per_m[b] + s.bearing_stiffness_n_per_m[b] - omega * omega * s.mass_kg[b])
        };
        Dynamics {
            input: torsion(s.inertia_motor_kg_m2, s.inertia_pinion_kg_m2, 0),
            output: torsion(s.inertia_gear_kg_m2, s.inertia_load_kg_m2, 1),
            translation: [body(0), body(1)],
        }
    }

    /// Factorises the mesh's own comb with the harmonics that the declared machine's prediction needs.
    pub fn own_comb(&self, shaft_hz: f64) -> Comb {
        self.comb_to(0.0, shaft_hz, self.harmonics_to(OWN_TOP_HZ, shaft_hz))
    }

    /// Factorises the comb `base + n z1` at a speed; `base` 0 is the mesh's own comb.
    pub fn comb(&self, base: f64, shaft_hz: f64) -> Comb {
        self.comb_to(base, shaft_hz, self.harmonics(shaft_hz))
    }

    fn comb_to(&self, base: f64, shaft_hz: f64, half: i64) -> Comb {
        let z = f64::from(self.teeth[0]);
        let orders: Vec<f64> = (-half..=half).map(|n| base + n as f64 * z).collect();
        let size = orders.len();
        let rigid_row = orders.iter().position(|o| o.abs() < 1e-9);
        let mut dynamics = Vec::with_capacity(size);
        let mut compliance = Vec::with_capacity(size);
        for (row, order) in orders.iter().enumerate() {
            // The rigid row never uses its response; any regular frequency keeps the arithmetic finite.
            let omega = if Some(row) == rigid_row { 1.0 } else { TAU * shaft_hz * order };
            let d = self.dynamics(omega);
            compliance.push(self.compliance(&d));
            dynamics.push(d);
        }
        let matrix = DMatrix::from_fn(size, size, |row, column| {
            let mesh =
                self.stiffness(row as i64 - column as i64) * C::new(1.0, TAU * shaft_hz * orders[column] * self.tau_s);
            if Some(row) == rigid_row {
                mesh / self.coefficients[0].re
            } else {
                let own = if row == column { C::ONE } else { C::ZERO };
                own + compliance[row] * mesh
            }
        });
        Comb { orders, centre: half as usize, shaft_hz, rigid_row, compliance, dynamics, lu: matrix.lu() }
    }

    /// Response to generalised forces per order (empty for none) and to an extra contact force `g` per order (empty
    /// for none).
    pub fn respond(&self, comb: &Comb, forces: &[[C; DOF]], contact: &[C]) -> Solution {
        let [rb1, rb2] = self.base_radius_m;
        let size = comb.orders.len();
        let g = |n: usize| contact.get(n).copied().unwrap_or(C::ZERO);
        let free = |n: usize| -> [C; 4] {
            let Some(f) = forces.get(n) else { return [C::ZERO; 4] };
            let d = &comb.dynamics[n];
            [
                d.input[1][0] * f[MOTOR] + d.input[1][1] * f[PINION],
                d.output[0][0] * f[GEAR] + d.output[0][1] * f[LOAD],
                d.translation[0] * f[PINION_Y],
                d.translation[1] * f[GEAR_Y],
            ]
        };
        let right = DVector::from_fn(size, |n, _| {
            if Some(n) == comb.rigid_row {
                // Static balance: the mean mesh force carries the mean torque on the input side.
                let torque = forces.get(n).map_or(C::ZERO, |f| f[MOTOR] + f[PINION]);
                (torque / rb1 - g(n)) / self.coefficients[0].re
            } else {
                let q = free(n);
                q[0] * rb1 - q[1] * rb2 + q[2] - q[3] - comb.compliance[n] * g(n)
            }
        });
        let delta = comb.lu.solve(&right).unwrap_or_else(|| DVector::zeros(size));
        let approach: Vec<C> =
            (0..size).map(|n| delta[n] * C::new(1.0, TAU * comb.shaft_hz * comb.orders[n] * self.tau_s)).collect();
        let mut lines = Vec::with_capacity(size);
        let mut translation = Vec::with_capacity(size);
        let mut force = Vec::with_capacity(size);
        let mut rotation = Vec::with_capacity(size);
        for n in 0..size {
            let omega = TAU * comb.shaft_hz * comb.orders[n];
            let rigid = Some(n) == comb.rigid_row;
            let f = if rigid {
                forces.get(n).map_or(C::ZERO, |f| f[MOTOR] + f[PINION]) / rb1
            } else {
                let q = free(n);
                (q[0] * rb1 - q[1] * rb2 + q[2] - q[3] - delta[n]) / comb.compliance[n]
            };
            let y = if rigid {
                let k = self.shafts.bearing_stiffness_n_per_m;
                let own = forces.get(n).map_or([C::ZERO; 2], |f| [f[PINION_Y], f[GEAR_Y]]);
                [(own[0] - f) / k[0], (own[1] + f) / k[1]]
            } else {
                let q = free(n);
                [q[2] - comb.dynamics[n].translation[0] * f, q[3] + comb.dynamics[n].translation[1] * f]
            };
            let turn = if rigid {
                [C::ZERO; 4]
            } else {
                let own = forces.get(n).copied().unwrap_or([C::ZERO; DOF]);
                let (d, pinion, gear) = (&comb.dynamics[n], own[PINION] - f * rb1, own[GEAR] + f * rb2);
                [
                    d.input[0][0] * own[MOTOR] + d.input[0][1] * pinion,
                    d.input[1][0] * own[MOTOR] + d.input[1][1] * pinion,
                    d.output[0][0] * gear + d.output[0][1] * own[LOAD],
                    d.output[1][0] * gear + d.output[1][1] * own[LOAD],
                ]
            };
            rotation.push(turn);
            force.push(f);
            translation.push(y);
            lines.push(Line { order: comb.orders[n], amplitude: y.map(|y| y * (-omega * omega)) });
        }
        Solution { lines, approach, force, translation, rotation }
    }

    /// Approach of the bodies by a unit mesh force.
    fn compliance(&self, d: &Dynamics) -> C {
        let [rb1, rb2] = self.base_radius_m;
        d.input[1][1] * (rb1 * rb1) + d.output[0][0] * (rb2 * rb2) + d.translation[0] + d.translation[1]
    }

    /// The declared machine's own steady vibration at a speed and torque (comb with base 0).
    pub fn base(&self, comb: &Comb, torque_n_m: f64) -> Solution {
        let mut forces = vec![[C::ZERO; DOF]; comb.orders.len()];
        forces[comb.centre][MOTOR] = C::new(torque_n_m, 0.0);
        let load = torque_n_m * f64::from(self.teeth[1]) / f64::from(self.teeth[0]);
        forces[comb.centre][LOAD] = C::new(-load, 0.0);
        self.respond(comb, &forces, &[])
    }

    /// Responses to a unit relative change of every declared parameter, in the order of
    /// the machine fit's own tolerances: exact first-order perturbation on the same factorisation.
    pub fn sensitivities(&self, comb: &Comb, base: &Solution) -> Vec<Vec<Line>> {
        let s = &self.shafts;
        let size = comb.orders.len();
        let i_omega: Vec<C> = comb.orders.iter().map(|o| C::new(0.0, TAU * comb.shaft_hz * o)).collect();
        let forced = |f: &dyn Fn(usize) -> [C; DOF]| {
            let forces: Vec<[C; DOF]> = (0..size).map(f).collect();
            self.respond(comb, &forces, &[]).lines
        };
        let pair = |first: usize, value: C| {
            let mut f = [C::ZERO; DOF];
            f[first] = value;
            f[first + 1] = -value;
            f
        };
        let single = |dof: usize, value: C| {
            let mut f = [C::ZERO; DOF];
            f[dof] = value;
            f
        };
        let damped: Vec<C> = (0..size)
            .map(|n| {
                let rate = i_omega[n] * self.tau_s;
                base.approach[n] * rate / (rate + 1.0)
            })
            .collect();
        let damping: Vec<C> = (0..size as i64)
            .map(|n| (0..size as i64).map(|l| self.stiffness(n - l) * damped[l as usize]).sum())
            .collect();
        let y = &base.translation;
        let turn = &base.rotation;
        let mut all = vec![self.respond(comb, &[], &base.force).lines, self.respond(comb, &[], &damping).lines];
        for side in 0..2 {
            all.push(forced(&|n| single(PINION_Y + side, y[n][side] * -s.bearing_stiffness_n_per_m[side])));
        }
        for side in 0..2 {
            all.push(forced(&|n| {
                single(PINION_Y + side, y[n][side] * i_omega[n] * -s.bearing_damping_n_s_per_m[side])
            }));
        }
        let twist = |n: usize, side: usize| turn[n][2 * side] - turn[n][2 * side + 1];
        for side in 0..2 {
            all.push(forced(&|n| pair(2 * side, twist(n, side) * -s.coupling_stiffness_n_m_per_rad[side])));
        }
        for (dof, inertia) in [(PINION, s.inertia_pinion_kg_m2), (GEAR, s.inertia_gear_kg_m2)] {
            all.push(forced(&|n| single(dof, turn[n][dof] * i_omega[n] * i_omega[n] * -inertia)));
        }
        for side in 0..2 {
            all.push(forced(&|n| single(PINION_Y + side, y[n][side] * i_omega[n] * i_omega[n] * -s.mass_kg[side])));
        }
        for side in 0..2 {
            all.push(forced(&|n| {
                pair(2 * side, twist(n, side) * i_omega[n] * -s.coupling_damping_n_m_s_per_rad[side])
            }));
        }
        all.push(base.lines.clone());
        all
    }
}
