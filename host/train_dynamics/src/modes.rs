//! Modes of the train with every mesh at its mean stiffness, and how long a transient lasts.

use crate::assembly::System;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;

/// Share of the largest squared frequency below which a mode is the rotation of the whole.
const RIGID_SHARE: f64 = 1e-10;

/// One mode.
#[derive(Debug, Clone, PartialEq)]
pub struct Mode {
    /// Undamped natural frequency, Hz; 0 of the rotation of the whole.
    pub frequency_hz: f64,
    /// Damping ratio by the damping's share of the mode alone.
    pub damping_ratio: f64,
    /// Mass-normalised shape.
    pub shape: DVector<f64>,
}

/// All modes by ascending frequency.
pub fn modes(system: &System) -> Vec<Mode> {
    let root = system.mass.map(|mass| 1.0 / mass.sqrt());
    let full = system.mean_stiffness();
    let n = system.len();
    let scaled = DMatrix::from_fn(n, n, |i, j| full[(i, j)] * root[i] * root[j]);
    let eigen = scaled.symmetric_eigen();
    let damping = system.mean_damping();
    let largest = eigen.eigenvalues.amax();
    let mut modes: Vec<Mode> = (0..n)
        .map(|i| {
            let square = eigen.eigenvalues[i];
            let shape = eigen.eigenvectors.column(i).component_mul(&root);
            let omega = if square > RIGID_SHARE * largest { square.sqrt() } else { 0.0 };
            let share = shape.dot(&(&damping * &shape));
            Mode {
                frequency_hz: omega / TAU,
                damping_ratio: if omega > 0.0 { share / (2.0 * omega) } else { 0.0 },
                shape,
            }
        })
        .collect();
    modes.sort_by(|a, b| a.frequency_hz.total_cmp(&b.frequency_hz));
    modes
}

/// Time, s, in which every elastic mode's transient falls to this share; infinite without damping.
pub fn settling_s(system: &System, share: f64) -> f64 {
    let rates = modes(system).into_iter().filter(|mode| mode.frequency_hz > 0.0);
    let slowest = rates.map(|mode| mode.damping_ratio * mode.frequency_hz * TAU).fold(f64::INFINITY, f64::min);
    -share.ln() / slowest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::TrainMachine;

    fn system(text: &str) -> System {
        System::assemble(&TrainMachine::parse(text, "m.toml").expect("a machine")).expect("a system")
    }

    #[test]
    fn theory_a_torsional_chain_has_the_closed_forms_frequencies() {
        // Bearings so stiff and bodies so light across that nothing but twist is left below 20 kHz: drive and pinion as
        // one, gear and load as one, joined by the mesh: w2 = k (rb1^2/I1 + rb2^2/I2).
        let text = "[[stage]]\nkind = \"pair\"\nteeth = [20, 40]\n[[mesh]]\nmodule_mm = 3\nface_width_mm = 20\nmass_kg \
            = [1e-2, 1e-2]\ninertia_kg_m2 = [2e-3, 9e-3]\n[[shaft]]\nbearing_stiffness_n_per_m = [1e12, \
            1e12]\n[[shaft]]\nbearing_stiffness_n_per_m = [1e12, 1e12]\n[drive]\ninertia_kg_m2 = \
            4e-3\ncoupling_stiffness_n_m_per_rad = 1e12\n[load]\ninertia_kg_m2 = 5e-3\ncoupling_stiffness_n_m_per_rad \
            = 1e12\n";
        let system = system(text);
        let base = [20.0, 40.0].map(|z: f64| 0.5 * 3e-3 * z * 20f64.to_radians().cos());
        let mean = system.stiffnesses[0].mean_n_per_m();
        let square = mean * (base[0] * base[0] / 6e-3 + base[1] * base[1] / 14e-3);
        let modes = modes(&system);
        assert_eq!(modes[0].frequency_hz, 0.0);
        assert!((modes[1].frequency_hz * TAU / square.sqrt() - 1.0).abs() < 1e-3, "{}", modes[1].frequency_hz);
        assert!(modes[2].frequency_hz > 20e3);
    }

    #[test]
    fn theory_three_inertias_of_a_shaft_have_the_textbooks_two_frequencies() {
        // A very stiff mesh (a wide face) makes one inertia of its gears: drive, gears and load with springs k1 and k2.
        let text = "[[stage]]\nkind = \"pair\"\nteeth = [30, 30]\n[[mesh]]\nmodule_mm = 10\nface_width_mm = \
            5000\nmass_kg = [1e-2, 1e-2]\ninertia_kg_m2 = [1e-3, 2e-3]\n[[shaft]]\nbearing_stiffness_n_per_m = [1e12, \
            1e12]\n[[shaft]]\nbearing_stiffness_n_per_m = [1e12, 1e12]\n[drive]\ninertia_kg_m2 = \
            4e-3\ncoupling_stiffness_n_m_per_rad = 2e4\n[load]\ninertia_kg_m2 = 5e-3\ncoupling_stiffness_n_m_per_rad = \
            3e4\n";
        let modes = modes(&system(text));
        let [j1, j2, j3, k1, k2]: [f64; 5] = [4e-3, 3e-3, 5e-3, 2e4, 3e4];
        // w^4 - w^2 (k1/j1 + (k1 + k2)/j2 + k2/j3) + k1 k2 (j1 + j2 + j3)/(j1 j2 j3) = 0.
        let half = 0.5 * (k1 / j1 + (k1 + k2) / j2 + k2 / j3);
        let rest = k1 * k2 * (j1 + j2 + j3) / (j1 * j2 * j3);
        for (mode, sign) in [(1, -1.0), (2, 1.0_f64)] {
            let closed = (half + sign * (half * half - rest).sqrt()).sqrt() / TAU;
            assert!((modes[mode].frequency_hz / closed - 1.0).abs() < 1e-3, "{} {closed}", modes[mode].frequency_hz);
        }
    }

    #[test]
    fn theory_a_static_load_goes_through_two_stages_in_balance() {
        let text = "[[stage]]\nkind = \"pair\"\nteeth = [23, 61]\nhelix_angle_deg = 15\n[[stage]]\nkind = \
            \"pair\"\nteeth = [19, 77]\n[[mesh]]\nmodule_mm = 2.0\nface_width_mm = 20\n[[mesh]]\nmodule_mm = \
            3.0\nface_width_mm = 30\ncentre_line_deg = 70\n";
        let machine = TrainMachine::parse(text, "m.toml").expect("a machine");
        let system = System::assemble(&machine).expect("a system");
        let load = 150.0;
        let deflection = system.static_deflection(load).expect("a deflection");
        for (mesh, torque, teeth) in [(0, load * 23.0 * 19.0 / (61.0 * 77.0), 23), (1, load * 19.0 / 77.0, 19)] {
            let line = &system.meshes[mesh];
            let force = system.stiffnesses[mesh].mean_n_per_m() * system.direction(line).dot(&deflection);
            let toothing = &machine.toothings[mesh];
            let base = toothing.radius_m(teeth) * toothing.transverse_pressure_angle().cos();
            assert!((force * base / torque - 1.0).abs() < 1e-9, "mesh {mesh}: {force}");
        }
        // The bearings carry what the meshes push, x and y.
        let ground: f64 =
            (0..4).map(|b| system.bodies[b].at + 1).map(|i| system.stiffness[(i, i)] * deflection[i]).sum();
        assert!(ground.abs() < 1e-6 * load / 0.02, "{ground}");
        assert!((system.mean_stiffness() * &system.rigid).amax() < 1e-6 * system.mean_stiffness().amax());
    }
}
