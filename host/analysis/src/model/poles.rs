//! Poles of the declared machine at its mean mesh stiffness: how fast it swings, and how long it remembers.
//!
//! Eigenvalues of the first-order form of the six equations of [`harmonic_balance`](super::harmonic_balance), 12 x
//! 12, with the rigid rotation's double zero left out. Cost: microseconds. Limits: the stiffness varies about its
//! mean, and with it frequencies by some percent.

use super::harmonic_balance::{DOF, GEAR, GEAR_Y, LOAD, MOTOR, Machine, PINION, PINION_Y};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;

/// What of the poles a stepped integration must respect.
#[derive(Debug, Clone, Copy)]
pub struct Poles {
    /// Frequency of the fastest mode, Hz.
    pub fastest_hz: f64,
    /// Slowest rate of decay, 1/s.
    pub slowest_decay_per_s: f64,
}

/// Eigenvalues below this, 1/s, are the rigid rotation's zeros as rounding leaves them.
const RIGID_PER_S: f64 = 0.1;

impl Poles {
    /// Of `machine`.
    pub fn of(machine: &Machine) -> Self {
        let s = &machine.shafts;
        let [rb1, rb2] = machine.base_radius_m;
        let mass = [
            s.inertia_motor_kg_m2,
            s.inertia_pinion_kg_m2,
            s.inertia_gear_kg_m2,
            s.inertia_load_kg_m2,
            s.mass_kg[0],
            s.mass_kg[1],
        ];
        let at = |places: &[(usize, f64)]| {
            let mut vector = DVector::zeros(DOF);
            places.iter().for_each(|&(i, x)| vector[i] = x);
            vector
        };
        let mesh = machine.stiffness(0).re;
        // Directions of the springs with their stiffness and damping.
        let springs = [
            (at(&[(PINION, rb1), (GEAR, -rb2), (PINION_Y, 1.0), (GEAR_Y, -1.0)]), mesh, mesh * machine.tau_s),
            (
                at(&[(MOTOR, 1.0), (PINION, -1.0)]),
                s.coupling_stiffness_n_m_per_rad[0],
                s.coupling_damping_n_m_s_per_rad[0],
            ),
            (
                at(&[(GEAR, 1.0), (LOAD, -1.0)]),
                s.coupling_stiffness_n_m_per_rad[1],
                s.coupling_damping_n_m_s_per_rad[1],
            ),
            (at(&[(PINION_Y, 1.0)]), s.bearing_stiffness_n_per_m[0], s.bearing_damping_n_s_per_m[0]),
            (at(&[(GEAR_Y, 1.0)]), s.bearing_stiffness_n_per_m[1], s.bearing_damping_n_s_per_m[1]),
        ];
        let mut first_order = DMatrix::zeros(2 * DOF, 2 * DOF);
        for i in 0..DOF {
            first_order[(i, DOF + i)] = 1.0;
            for j in 0..DOF {
                for (direction, stiffness, damping) in &springs {
                    let share = direction[i] * direction[j] / mass[i];
                    first_order[(DOF + i, j)] -= stiffness * share;
                    first_order[(DOF + i, DOF + j)] -= damping * share;
                }
            }
        }
        let poles = first_order.complex_eigenvalues();
        let moving = || poles.iter().filter(|pole| pole.norm() > RIGID_PER_S);
        Self {
            fastest_hz: moving().map(|pole| pole.im.abs() / TAU).fold(0.0, f64::max),
            slowest_decay_per_s: moving().map(|pole| -pole.re).fold(f64::INFINITY, f64::min),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::{Pair, Shafts};
    use crate::stiffness::pair_curve::PairCurve;

    /// With bearings and couplings so soft that they do not count the mesh is the only spring, between known masses.
    #[test]
    fn theory_one_spring_between_known_masses() {
        let pair = Pair::spur([20, 40], 0.003, 0.02, [0.01, 0.02]);
        let shafts = Shafts {
            inertia_motor_kg_m2: 0.001,
            inertia_pinion_kg_m2: 0.002,
            inertia_gear_kg_m2: 0.01,
            inertia_load_kg_m2: 0.02,
            coupling_stiffness_n_m_per_rad: [1.0, 1.0],
            coupling_damping_n_m_s_per_rad: [0.01, 0.01],
            mass_kg: [1.5, 4.0],
            bearing_stiffness_n_per_m: [1e3, 1e3],
            bearing_damping_n_s_per_m: [10.0, 10.0],
        };
        let curve = PairCurve { u: vec![0.0, 1.5], k: vec![2e8, 2e8] };
        let mut machine = Machine::new(&pair, &shafts, &curve);
        machine.tau_s = 2e-6;
        let [rb1, rb2] = machine.base_radius_m;
        let per_mass = rb1 * rb1 / 0.002 + rb2 * rb2 / 0.01 + 1.0 / 1.5 + 1.0 / 4.0;
        let omega = (3e8 * per_mass).sqrt();
        let poles = Poles::of(&machine);
        assert!((poles.fastest_hz * TAU / omega - 1.0).abs() < 1e-3, "{poles:?} {omega}");
        // The slowest is a body on its soft bearing or a coupling: damping over twice the mass.
        assert!(poles.slowest_decay_per_s > 0.1 && poles.slowest_decay_per_s < 5.0, "{poles:?}");
    }
}
