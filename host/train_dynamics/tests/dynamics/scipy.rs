//! Two spur stages against a vector by SciPy's DOP853: `tests/vectors/two_stage.py` has the equations and the command.

use super::{rms, waveform};
use meshband_mechanics::dynamics::Motion;
use meshband_mechanics::piecewise::PiecewisePolynomial;
use meshband_mechanics::stiffness::mesh;
use meshband_train_dynamics::TrainMachine;
use meshband_train_dynamics::assembly::System;
use meshband_train_dynamics::integrate::Course;
use meshband_train_dynamics::stiffness::MeshStiffness;

/// The script's machine.
const MACHINE: &str = r#"
stage = [{ kind = "pair", teeth = [23, 61] }, { kind = "pair", teeth = [19, 77] }]
[[mesh]]
module_mm = 2.0
face_width_mm = 20
centre_line_deg = 17.188733853924695
mesh_damping_s = 4e-7
mass_kg = [0.4, 2.6]
inertia_kg_m2 = [1.5e-4, 5.0e-3]
[[mesh]]
module_mm = 3.0
face_width_mm = 30
centre_line_deg = 80.21409131831524
mesh_damping_s = 3e-7
mass_kg = [0.5, 9.0]
inertia_kg_m2 = [2.0e-4, 5.5e-2]
[[shaft]]
bearing_stiffness_n_per_m = [1.2e8, 1.0e8]
bearing_damping_n_s_per_m = [500, 450]
[[shaft]]
torsional_stiffness_n_m_per_rad = 2e5
torsional_damping_n_m_s_per_rad = 0.5
bearing_stiffness_n_per_m = [1.5e8, 1.3e8]
bearing_damping_n_s_per_m = [0, 0]
[[shaft]]
bearing_stiffness_n_per_m = [2.0e8, 1.8e8]
bearing_damping_n_s_per_m = [3500, 3300]
[drive]
inertia_kg_m2 = 4e-3
coupling_stiffness_n_m_per_rad = 3e4
coupling_damping_n_m_s_per_rad = 0.3
[load]
inertia_kg_m2 = 3e-2
coupling_stiffness_n_m_per_rad = 9e4
coupling_damping_n_m_s_per_rad = 4.0
"#;

/// The script's pair: a parabola over the path of contact.
fn parabola(own: &MeshStiffness, ratio: f64, peak: f64) -> MeshStiffness {
    // peak (1 - 0.4 (2 s / ratio - 1)^2) in powers of s.
    let powers = vec![0.6 * peak, 1.6 * peak / ratio, -1.6 * peak / (ratio * ratio)];
    let pair = PiecewisePolynomial::new(vec![0.0, ratio], vec![powers]);
    MeshStiffness { total: mesh::total(&pair), pair, ..own.clone() }
}

#[test]
fn ref_two_stages_move_as_by_scipy() {
    let machine = TrainMachine::parse(MACHINE, "two stages").expect("a machine");
    let mut system = System::assemble(&machine).expect("a system");
    system.stiffnesses[0] = parabola(&system.stiffnesses[0], 1.62, 2.1e8);
    system.stiffnesses[1] = parabola(&system.stiffnesses[1], 1.58, 3.4e8);
    // The bearings of the middle shaft's two gears differ in damping.
    for (body, damping) in [(1, [1500.0, 1400.0]), (2, [600.0, 550.0])] {
        let at = system.bodies[body].at;
        (0..2).for_each(|axis| system.damping[(at + 1 + axis, at + 1 + axis)] = damping[axis]);
    }
    let motion = Motion::Constant { speed_hz: 25.0, turns_at_zero: 0.0 };
    let course = Course { system: &system, motion: &motion, load_torque_n_m: 150.0, effects: &[] };
    let ours = waveform(&course, 0.0, (20e3, 200), &|step, i| step.acceleration(i + 2), 12);
    let text = include_str!("../vectors/two_stage.csv");
    let rows: Vec<Vec<f64>> = text
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| line.split(',').map(|cell| cell.parse().expect("a number")).collect())
        .collect();
    assert_eq!(rows.len(), 200);
    for (i, signal) in ours.iter().enumerate() {
        let far = rows.iter().zip(signal).map(|(row, x)| (row[i] - x).abs()).fold(0.0, f64::max);
        assert!(far < 1e-6 * rms(signal), "coordinate {i}: {:e} of the root mean square", far / rms(signal));
    }
}
