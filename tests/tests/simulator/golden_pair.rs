//! The 19/48 pair of the golden vector: square-wave stiffness, damping and inertias as in `vectors/dynamics.json`.

// Each test file uses its own part.
#![allow(dead_code)]

use meshband_host::dynamics::assembly::Options as AssemblyOptions;
use meshband_host::dynamics::mesh::MeshDamping;
use meshband_host::dynamics::{Facts, Motion, System};
use meshband_host::machine::Machine;
use meshband_host::piecewise::PiecewisePolynomial;
use serde_json::Value;

pub fn vectors() -> Value {
    serde_json::from_str(include_str!("../../vectors/dynamics.json")).expect("valid JSON")
}

pub fn number(v: &Value) -> f64 {
    v.as_f64().expect("number")
}

pub fn golden_machine(v: &Value) -> Machine {
    let inertia = &v["inertia_kg_m2"];
    let text = format!(
        "title = 'golden'\n[pair]\nteeth = [19, 48]\nmodule_m = {}\nface_width_m = 0.016\n\
         bore_radius_m = [0.0096, 0.0265]\nyoungs_modulus_pa = 2.068e11\npoisson = 0.3\nmesh_damping_s = 0.0\n\
         [shafts]\ninertia_motor_kg_m2 = {}\ninertia_pinion_kg_m2 = {}\ninertia_gear_kg_m2 = {}\n\
         inertia_load_kg_m2 = {}\ncoupling_stiffness_n_m_per_rad = {}\ncoupling_damping_n_m_s_per_rad = {}\n\
         mass_kg = {}\nbearing_stiffness_n_per_m = [{bearing}, {bearing}]\nbearing_damping_n_s_per_m = [{damping}, \
         {damping}]\n",
        v["module_m"],
        inertia["motor"],
        inertia["pinion"],
        inertia["gear"],
        inertia["load"],
        v["coupling_stiffness_n_m_per_rad"],
        v["coupling_damping_n_m_s_per_rad"],
        v["mass_kg"],
        bearing = v["bearing_stiffness_n_per_m"],
        damping = v["bearing_damping_n_s_per_m"],
    );
    Machine::from_toml(&text, "golden", std::path::Path::new("")).expect("a sound machine")
}

pub struct Golden {
    pub system: System,
    pub stiffness: PiecewisePolynomial,
    pub damping: MeshDamping,
    pub motion: Motion,
    pub facts: Facts,
    pub k: [f64; 2],
    pub period: f64,
    pub double: f64,
    pub torque: f64,
}

pub fn golden() -> Golden {
    let v = vectors();
    let machine = golden_machine(&v);
    let axis_angle_rad = 20.0_f64.to_radians();
    let system = System::assemble(&machine, &AssemblyOptions { axis_angle_rad, ..Default::default() }).expect("sound");
    let square = &v["stiffness_square_wave_n_per_m"];
    let k = [number(&square["double"]), number(&square["single"])];
    let part = number(&v["contact_ratio"]) - 1.0;
    let stiffness = PiecewisePolynomial::new(vec![0.0, part, 1.0], vec![vec![k[0]], vec![k[1]]]);
    let [rb1, rb2] = system.base_radius_m;
    let mass_kg =
        1.0 / (rb1 * rb1 / machine.shafts.inertia_pinion_kg_m2 + rb2 * rb2 / machine.shafts.inertia_gear_kg_m2);
    let facts = Facts {
        teeth: [19, 48],
        base_radius_m: system.base_radius_m,
        base_pitch_m: std::f64::consts::TAU * rb1 / 19.0,
        pressure_angle_rad: axis_angle_rad,
        path_base_pitches: 1.0,
        pitch_point_base_pitches: 0.5,
        mass_kg: machine.shafts.mass_kg,
        input_torque_n_m: 11.9,
        bearing_stiffness_n_per_m: machine.shafts.bearing_stiffness_n_per_m,
    };
    Golden {
        system,
        stiffness,
        damping: MeshDamping::Ratio { ratio: 0.03, mass_kg },
        motion: Motion::Constant { speed_hz: 30.0, turns_at_zero: 0.0 },
        facts,
        k,
        period: number(&v["mesh_period_s"]),
        double: number(&v["double_contact_s"]),
        torque: number(&v["torque_n_m"]),
    }
}

/// Companion matrix of the golden system at stiffness `k`, with the constant force as last column.
pub fn companion(g: &Golden, k: f64) -> nalgebra::DMatrix<f64> {
    let n = g.system.len();
    let MeshDamping::Ratio { ratio, mass_kg } = g.damping else { panic!("the golden damping is a ratio") };
    let c = 2.0 * ratio * (k * mass_kg).sqrt();
    let shape = &g.system.mesh * g.system.mesh.transpose();
    let (stiffness, damping) = (&g.system.stiffness + k * &shape, &g.system.damping + c * &shape);
    let mut a = nalgebra::DMatrix::zeros(2 * n + 1, 2 * n + 1);
    for i in 0..n {
        a[(i, n + i)] = 1.0;
        a[(n + i, 2 * n)] = g.system.torque[i] * g.torque / g.system.mass[i];
        for j in 0..n {
            a[(n + i, j)] = -stiffness[(i, j)] / g.system.mass[i];
            a[(n + i, n + j)] = -damping[(i, j)] / g.system.mass[i];
        }
    }
    a
}
