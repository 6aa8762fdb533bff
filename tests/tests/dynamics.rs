//! Dynamics against independent numbers: golden vector, natural frequencies, records of another simulator.

use meshband_host::dynamics::assembly::{Damping, Model, Options as AssemblyOptions};
use meshband_host::dynamics::mesh::MeshDamping;
use meshband_host::dynamics::predict::Predictor;
use meshband_host::dynamics::taylor::Options;
use meshband_host::dynamics::{Facts, Mesh, Motion, Solver, State, System};
use meshband_host::machine::Machine;
use meshband_host::piecewise::PiecewisePolynomial;
use meshband_host::record::Record;
use serde_json::Value;

fn vectors() -> Value {
    serde_json::from_str(include_str!("../vectors/dynamics.json")).expect("valid JSON")
}

fn number(v: &Value) -> f64 {
    v.as_f64().expect("number")
}

fn golden_machine(v: &Value) -> Machine {
    let inertia = &v["inertia_kg_m2"];
    let text = format!(
        "title = 'golden'\n[pair]\nteeth = [19, 48]\nmodule_m = {}\nface_width_m = 0.016\n\
         bore_radius_m = [0.0096, 0.0265]\nyoungs_modulus_pa = 2.068e11\npoisson = 0.3\nmesh_damping_s = 0.0\n\
         [shafts]\ninertia_motor_kg_m2 = {}\ninertia_pinion_kg_m2 = {}\ninertia_gear_kg_m2 = {}\n\
         inertia_load_kg_m2 = {}\ncoupling_stiffness_n_m_per_rad = {}\ncoupling_damping_n_m_s_per_rad = {}\n\
         mass_kg = {}\nbearing_stiffness_n_per_m = [{bearing}, {bearing}]\nbearing_damping_n_s_per_m = [{damping}, {damping}]\n",
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

struct Golden {
    system: System,
    stiffness: PiecewisePolynomial,
    damping: MeshDamping,
    motion: Motion,
    facts: Facts,
    k: [f64; 2],
    period: f64,
    double: f64,
    torque: f64,
}

fn golden() -> Golden {
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

#[test]
fn ref_natural_frequencies_of_eight_coordinates() {
    let g = golden();
    let found = g.system.natural_frequencies_hz(g.k[0]);
    let expected = vectors();
    for (found, expected) in found.iter().zip(expected["modes_at_double_hz"].as_array().expect("list")) {
        let expected = number(expected);
        let allowed = if expected == 0.0 { 1e-2 } else { 1e-6 * expected };
        assert!((found - expected).abs() <= allowed, "{found} Hz instead of {expected} Hz");
    }
}

#[test]
fn ref_golden_acceleration_at_segment_ends() {
    let g = golden();
    let force = &g.system.torque * g.torque;
    let mean = (g.k[0] * g.double + g.k[1] * (g.period - g.double)) / g.period;
    let start = g.system.static_deflection(&force, mean).expect("solvable");
    let mut state = State::<8> { q: std::array::from_fn(|i| start[i]), v: [0.0; 8] };
    let solver = Solver::<8>::new(&g.system, &force);
    let mut mesh = Mesh::new(&g.system, &g.stiffness, g.damping, &g.motion, &[], g.facts);
    let y1 = g.system.sensor(0).expect("y1");
    let mut ends = Vec::new();
    let options = Options { tolerance: 1e-13, ..Default::default() };
    let statistics = solver
        .integrate(&mut mesh, &mut state, (0.0, 28.0 * g.period), &options, |step| {
            ends.push((step.start_s + step.end * step.length_s, step.acceleration(y1).value(step.end)));
        })
        .expect("integrates");
    println!("{statistics:?}");
    let expected = vectors();
    for (segment, value) in expected["y1_acceleration_at_segment_end_m_s2"].as_object().expect("table") {
        let n: u32 = segment.parse().expect("number");
        let t = f64::from((n - 1) / 2) * g.period + if n % 2 == 1 { g.double } else { g.period };
        let (_, found) = ends.iter().find(|(end, _)| (end - t).abs() < 1e-9).expect("a step ends there");
        let error = (found / number(value) - 1.0).abs();
        println!("segment {n}: {found} error {error:.1e}");
        assert!(error < 1e-9, "segment {n}: {found} instead of {value}");
    }
}

/// What remains of `measured - predicted` below 15 kHz, relative to the measured AC RMS below 15 kHz.
fn remaining(measured: &[f64], predicted: &[f64], rate_hz: f64) -> f64 {
    let n = measured.len();
    let fft = rustfft::FftPlanner::<f64>::new().plan_fft_forward(n);
    let power = |signal: Vec<f64>| {
        let mut line: Vec<_> = signal.into_iter().map(|x| rustfft::num_complex::Complex::new(x, 0.0)).collect();
        fft.process(&mut line);
        let last = (15_000.0 * n as f64 / rate_hz) as usize;
        line[1..=last].iter().map(|c| c.norm_sqr()).sum::<f64>()
    };
    let difference = measured.iter().zip(predicted).map(|(a, b)| a - b).collect();
    (power(difference) / power(measured.to_vec())).sqrt()
}

#[test]
fn ref_records_of_an_independent_simulator_are_predicted_to_a_thousandth() {
    for name in ["check-19-48", "check-55-75"] {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("vectors").join(name);
        let record = Record::read(&folder).expect("a sound record");
        let predictor = Predictor::new(&record, Model::BendingTorsional, Damping::Declared).expect("a machine");
        for (index, run) in record.runs.iter().enumerate() {
            let (channels, statistics) = predictor.predict(run, &[]).expect("predicts");
            for (channel, predicted) in channels.iter().enumerate() {
                let left = remaining(&run.signal_m_s2(channel), predicted, run.sample_rate_hz());
                println!("{name} run {index} channel {channel}: {:.4} % left, {statistics:?}", 100.0 * left);
                assert!(left < 1e-3, "{name} run {index} channel {channel}: {left:.2e} of the AC RMS left");
            }
        }
    }
}
