//! Every model, damping and motion against solutions that share nothing with the Taylor solver.

use super::golden_pair;

use golden_pair::{Golden, companion, golden, golden_machine, number, vectors};
use meshband_host::dynamics::assembly::{Damping, Model, Options as AssemblyOptions};
use meshband_host::dynamics::energy::Meter;
use meshband_host::dynamics::steady::{Balance, steady_state};
use meshband_host::dynamics::taylor::Options;
use meshband_host::dynamics::{Coordinate, Effect, Mesh, Motion, Rig, Solver, State, System};
use meshband_host::effects;
use meshband_host::machine::{Load, Machine, Motor};
use nalgebra::DVector;

/// The golden pair with another assembly.
fn with(options: AssemblyOptions) -> Golden {
    let mut g = golden();
    g.system = System::assemble(&golden_machine(&vectors()), &options).expect("sound");
    g
}

/// Largest error of the state after `zones` zones against the matrix exponential, relative to the largest value.
fn error_against_exponential<const N: usize>(g: &Golden, zones: usize, options: &Options) -> f64 {
    let force = &g.system.torque * g.torque;
    let start = g.system.static_deflection(&force, g.k[1]).expect("solvable");
    let mut exact = DVector::zeros(2 * N + 1);
    (0..N).for_each(|i| exact[i] = start[i]);
    exact[2 * N] = 1.0;
    let lengths = [g.double, g.period - g.double];
    let maps: Vec<_> = (0..2).map(|z| (companion(g, g.k[z]) * lengths[z]).exp()).collect();
    (0..zones).for_each(|i| exact = &maps[i % 2] * &exact);
    let end: f64 = (0..zones).map(|i| lengths[i % 2]).sum();
    let solver = Solver::<N>::new(&g.system, &force);
    let mut mesh = Mesh::new(&g.system, &g.stiffness, g.damping, &g.motion, &[], g.facts);
    let mut state = State::<N> { q: std::array::from_fn(|i| start[i]), v: [0.0; N] };
    let statistics = solver.integrate(&mut mesh, &mut state, (0.0, end), options, |_| {}).expect("integrates");
    let worst = |exact: &[f64], found: &[f64]| {
        let size = exact.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        exact.iter().zip(found).map(|(a, b)| (a - b).abs() / size).fold(0.0, f64::max)
    };
    let error = worst(&exact.as_slice()[..N], &state.q).max(worst(&exact.as_slice()[N..2 * N], &state.v));
    println!("{N} coordinates: error {error:.1e}, {statistics:?}");
    error
}

fn model(model: Model, damping: Damping) -> Golden {
    with(AssemblyOptions { model, damping, mean_mesh_stiffness_n_per_m: 3.0e8, axis_angle_rad: 0.35 })
}

#[test]
fn ref_every_model_agrees_with_the_matrix_exponential() {
    let options = Options { tolerance: 1e-12, ..Default::default() };
    assert!(error_against_exponential::<2>(&model(Model::Torsional, Damping::Declared), 8, &options) < 1e-9);
    let six = model(Model::BendingTorsionalWithoutShafts, Damping::Declared);
    assert!(error_against_exponential::<6>(&six, 8, &options) < 1e-9);
    assert!(error_against_exponential::<8>(&model(Model::BendingTorsional, Damping::Declared), 8, &options) < 1e-9);
    assert!(error_against_exponential::<10>(&model(Model::Casing, Damping::Declared), 8, &options) < 1e-9);
}

#[test]
fn ref_modal_damping_couples_everything_and_still_agrees() {
    let options = Options { tolerance: 1e-12, ..Default::default() };
    assert!(error_against_exponential::<8>(&model(Model::BendingTorsional, Damping::Modal(0.04)), 8, &options) < 1e-9);
    assert!(error_against_exponential::<10>(&model(Model::Casing, Damping::Modal(0.02)), 8, &options) < 1e-9);
}

#[test]
fn ref_printed_damping_is_solved_by_tiny_steps() {
    let printed = model(Model::BendingTorsional, Damping::Printed);
    let error = error_against_exponential::<8>(&printed, 1, &Options { tolerance: 1e-9, ..Default::default() });
    assert!(error < 1e-6, "{error:.1e}");
}

#[test]
fn theory_modal_damping_gives_every_mode_its_ratio() {
    let ratio = 0.03;
    let g = model(Model::BendingTorsional, Damping::Modal(ratio));
    let k = 3.0e8;
    let n = g.system.len();
    let full = &g.system.stiffness + k * &g.system.mesh * g.system.mesh.transpose();
    let a = nalgebra::DMatrix::from_fn(2 * n, 2 * n, |i, j| match (i < n, j < n) {
        (true, true) => 0.0,
        (true, false) => f64::from(u8::from(i == j - n)),
        (false, true) => -full[(i - n, j)] / g.system.mass[i - n],
        (false, false) => -g.system.damping[(i - n, j - n)] / g.system.mass[i - n],
    });
    let elastic: Vec<_> = a.complex_eigenvalues().iter().copied().filter(|e| e.norm() > 100.0).collect();
    assert_eq!(elastic.len(), 14);
    for e in elastic {
        assert!((-e.re / e.norm() / ratio - 1.0).abs() < 1e-6, "{e}");
    }
}

#[test]
fn theory_a_heavy_stiff_casing_is_ground() {
    let mut machine = golden_machine(&vectors());
    machine.casing = Some(meshband_host::machine::Casing {
        mass_kg: 1e6,
        stiffness_n_per_m: [1e14; 2],
        damping_n_s_per_m: [0.0; 2],
    });
    let options = AssemblyOptions { model: Model::Casing, ..Default::default() };
    let ten = System::assemble(&machine, &options).expect("sound").natural_frequencies_hz(3e8);
    let eight = System::assemble(&machine, &AssemblyOptions::default()).expect("sound").natural_frequencies_hz(3e8);
    for a in eight.iter().skip(1) {
        assert!(ten.iter().any(|b| (a / b - 1.0).abs() < 1e-5), "{a} Hz is not among {ten:?}");
    }
}

#[test]
fn theory_a_soft_casing_adds_its_own_mode() {
    let machine = golden_machine(&vectors());
    let options = AssemblyOptions { model: Model::Casing, ..Default::default() };
    let modes = System::assemble(&machine, &options).expect("sound").natural_frequencies_hz(3e8);
    // Casing and both shafts swing together in x, where the mesh does not act: the default casing of 525 Hz, loaded.
    assert_eq!(modes.len(), 10);
    assert!(modes.iter().any(|&hz| (400.0..525.0).contains(&hz)), "{modes:?}");
}

/// Reference numbers of SciPy's DOP853 at 1e-13 (`tests/compare/scipy_nonlinear.py`).
fn nonlinear(case: &str) -> serde_json::Value {
    let all: serde_json::Value =
        serde_json::from_str(include_str!("../../vectors/dynamics-nonlinear.json")).expect("valid JSON");
    all[case].clone()
}

fn assert_state(found: &State<8>, expected: &serde_json::Value, tolerance: f64) {
    for (name, found) in [("deflection", &found.q), ("velocity", &found.v)] {
        let expected: Vec<f64> = expected[name].as_array().expect("list").iter().map(number).collect();
        // Rotations and translations have different units: each against the largest of its kind.
        for part in [0..4, 4..8] {
            let size = expected[part.clone()].iter().fold(0.0_f64, |m, x| m.max(x.abs()));
            for i in part {
                let error = (found[i] - expected[i]).abs() / size;
                assert!(error < tolerance, "{name} {i}: {} instead of {} ({error:.1e})", found[i], expected[i]);
            }
        }
    }
}

fn start(g: &Golden, motor_velocity: f64) -> State<8> {
    let part = number(&vectors()["contact_ratio"]) - 1.0;
    let force = &g.system.torque * g.torque;
    let q = g.system.static_deflection(&force, g.k[0] * part + g.k[1] * (1.0 - part)).expect("solvable");
    let mut v = [0.0; 8];
    v[0] = motor_velocity;
    State { q: std::array::from_fn(|i| q[i]), v }
}

#[test]
fn ref_contact_loss_with_eight_coordinates_agrees_with_dop853() {
    let expected = nonlinear("contact_loss");
    let g = golden();
    let force = &g.system.torque * g.torque;
    let clearance = number(&expected["clearance_m"]);
    let effects = vec![effects::parse(&format!("backlash:clearance={clearance}")).expect("known")];
    let mut mesh = Mesh::new(&g.system, &g.stiffness, g.damping, &g.motion, &effects, g.facts);
    let mut state = start(&g, number(&expected["motor_velocity_rad_s"]));
    let end = number(&expected["mesh_periods"]) * g.period;
    let options = Options { tolerance: 1e-12, ..Default::default() };
    let solver = Solver::<8>::new(&g.system, &force);
    let statistics = solver.integrate(&mut mesh, &mut state, (0.0, end), &options, |_| {}).expect("integrates");
    assert!(statistics.contact_events > 4);
    assert_eq!(statistics.contact_events, expected["switches"].as_u64().expect("count"));
    assert_state(&state, &expected, 1e-6);
}

#[test]
fn ref_run_up_agrees_with_dop853() {
    let expected = nonlinear("run_up");
    let [from_hz, to_hz, duration_s] = ["from_hz", "to_hz", "duration_s"].map(|k| number(&expected[k]));
    let mut g = golden();
    g.motion = Motion::RunUp { from_hz, to_hz, duration_s };
    let force = &g.system.torque * g.torque;
    let mut mesh = Mesh::new(&g.system, &g.stiffness, g.damping, &g.motion, &[], g.facts);
    let mut state = start(&g, 0.0);
    let options = Options { tolerance: 1e-12, ..Default::default() };
    let solver = Solver::<8>::new(&g.system, &force);
    let end = number(&expected["end_s"]);
    solver.integrate(&mut mesh, &mut state, (0.0, end), &options, |_| {}).expect("integrates");
    assert_state(&state, &expected, 1e-8);
}

#[test]
fn theory_a_tach_of_a_run_up_gives_its_motion_back() {
    let run_up = Motion::RunUp { from_hz: 5.0, to_hz: 15.0, duration_s: 4.0 };
    let pulses = 8;
    // Edge k at the angle k / pulses, from the quadratic 5 t + 1.25 t^2.
    let time = |turns: f64| (-5.0 + (25.0 + 5.0 * turns).sqrt()) / 2.5;
    let edges: Vec<f64> = (0..300).map(|k| time(f64::from(k) / f64::from(pulses))).collect();
    let tach = Motion::from_tach(&edges, pulses, 0, 0.0).expect("a motion");
    for t in [0.3, 1.0, 2.7, 3.7] {
        let [a, b] = [&run_up, &tach].map(|m| m.turns(t, 1e-6).coefficient(0));
        assert!((a - b).abs() < 2e-4, "{a} and {b} turns at {t} s");
        let [a, b] = [&run_up, &tach].map(|m| m.speed_hz(t));
        assert!((a / b - 1.0).abs() < 0.02, "{a} and {b} Hz at {t} s");
    }
    assert!(matches!(Motion::from_tach(&edges[..2], pulses, 0, 0.0), Ok(Motion::Constant { .. })));
}

/// Integrates one period from the periodic state and gives the largest relative change.
fn repeats(g: &Golden, effects: &[Box<dyn Effect>], period: f64) -> f64 {
    let force = &g.system.torque * g.torque;
    let options = Options { tolerance: 1e-11, ..Default::default() };
    let mut mesh = Mesh::new(&g.system, &g.stiffness, g.damping, &g.motion, effects, g.facts);
    let steady =
        steady_state::<8>(&g.system, &mut mesh, &force, (0.0, period), Balance::Load, &options).expect("stable");
    let corrected = &force + &steady.correction;
    let mut state = steady.state;
    let solver = Solver::<8>::new(&g.system, &corrected);
    solver.integrate(&mut mesh, &mut state, (0.0, period), &options, |_| {}).expect("integrates");
    let size = steady.state.q.iter().fold(0.0_f64, |m, q| m.max(q.abs()));
    steady.state.q.iter().zip(&state.q).map(|(a, b)| (a - b).abs() / size).fold(0.0, f64::max)
}

#[test]
fn theory_the_motion_repeats_after_a_shaft_turn_and_after_the_hunting_period() {
    let g = golden();
    let pinion = vec![effects::parse("pinion-eccentricity").expect("known")];
    let turn = 1.0 / 30.0;
    let change = repeats(&g, &pinion, turn);
    println!("one pinion turn: {change:.1e}");
    assert!(change < 1e-7, "{change:.1e}");
    // 19 and 48 have no common divisor: 48 pinion turns.
    let both = vec![
        effects::parse("pinion-pitch-error:random=3e-6").expect("known"),
        effects::parse("gear-pitch-error:random=3e-6").expect("known"),
    ];
    let change = repeats(&g, &both, 48.0 * turn);
    println!("hunting period: {change:.1e}");
    assert!(change < 1e-6, "{change:.1e}");
}

fn smooth_machine() -> Machine {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/19-48.toml");
    Machine::read(&folder).expect("a machine")
}

#[test]
fn theory_energy_closes_in_every_mesh_period_of_a_smooth_model() {
    for model in [Model::BendingTorsional, Model::BendingTorsionalWithoutShafts, Model::Casing] {
        let rig = Rig::new(&smooth_machine(), model, Damping::Declared).expect("sound");
        let motion = Motion::Constant { speed_hz: 30.0, turns_at_zero: 0.0 };
        for list in [&[][..], &["pinion-eccentricity"], &["friction"], &["bearing-stiffness-modulation", "wear"]] {
            let effects: Vec<_> = list.iter().map(|text| effects::parse(text).expect("known")).collect();
            let sampled = rig.sampled(&motion, 11.9, &effects, 20e3, 2000).expect("runs");
            println!("{model:?} {list:?}: {:.1e}", sampled.energy.worst_residual);
            assert_eq!(sampled.energy.mesh_periods, 20);
            assert!(sampled.energy.worst_residual < 1e-6, "{model:?} {list:?}: {:?}", sampled.energy);
            // A smooth curve changes without jumps.
            assert!(sampled.energy.sum.jumps_j.abs() < 1e-6 * sampled.energy.sum.exchanged_j);
        }
    }
}

#[test]
fn theory_a_step_curve_does_its_parametric_work_in_jumps() {
    let g = golden();
    let force = &g.system.torque * g.torque;
    let options = Options { tolerance: 1e-12, ..Default::default() };
    let mut mesh = Mesh::new(&g.system, &g.stiffness, g.damping, &g.motion, &[], g.facts);
    let steady =
        steady_state::<8>(&g.system, &mut mesh, &force, (0.0, g.period), Balance::Load, &options).expect("stable");
    let mut state = steady.state;
    let solver = Solver::<8>::new(&g.system, &force);
    let mut meter = Meter::new(&g.system, &force);
    // Two periods: the jump at the start of a period is seen by the meter only after the first.
    solver
        .integrate(&mut mesh, &mut state, (0.0, 2.0 * g.period), &options, |step| {
            if step.start_s < g.period - 1e-9 && step.end_s() >= g.period - 1e-9 {
                meter.add(step);
                meter.take();
            } else {
                meter.add(step);
            }
        })
        .expect("integrates");
    let balance = meter.balance();
    println!("{balance:?}");
    assert!(balance.residual() < 1e-6);
    assert!((balance.parametric_j - balance.jumps_j).abs() < 1e-12 * balance.exchanged_j);
    // In the periodic state nothing is stored: the jumps feed exactly what is dissipated.
    let lost = balance.dissipated_mesh_j + balance.dissipated_shafts_j;
    assert!((balance.parametric_j / lost - 1.0).abs() < 1e-6, "{} of {lost} J", balance.parametric_j);
}

#[test]
fn fault_impossible_operation_is_refused_with_the_reason() {
    let rig = Rig::new(&smooth_machine(), Model::BendingTorsional, Damping::Declared).expect("sound");
    let steady = Motion::Constant { speed_hz: 30.0, turns_at_zero: 0.0 };
    let refused = |motion: &Motion, torque: f64, rate: f64, count: usize| {
        rig.accelerations(motion, torque, &[], rate, count).expect_err("refused").to_string()
    };
    assert!(refused(&steady, 0.0, 20e3, 100).contains("does not load"));
    assert!(refused(&steady, -5.0, 20e3, 100).contains("backlash"));
    assert!(refused(&steady, f64::NAN, 20e3, 100).contains("not a finite number"));
    assert!(refused(&steady, 5.0, 0.0, 100).contains("no record"));
    assert!(refused(&steady, 5.0, 20e3, 0).contains("no record"));
    let still = Motion::Constant { speed_hz: 0.0, turns_at_zero: 0.0 };
    assert!(refused(&still, 5.0, 20e3, 100).contains("not a positive speed"));
    // With the coast flank in the model a braking torque is a motion like any other.
    let backlash = vec![effects::parse("backlash:clearance=20e-6").expect("known")];
    let (channels, _) = rig.accelerations(&steady, -5.0, &backlash, 20e3, 2000).expect("coasts");
    assert!(channels.iter().flatten().all(|x| x.is_finite()));
}

#[test]
fn fault_a_pull_between_the_teeth_is_reported() {
    let rig = Rig::new(&smooth_machine(), Model::BendingTorsional, Damping::Declared).expect("sound");
    let motion = Motion::Constant { speed_hz: 30.0, turns_at_zero: 0.0 };
    let rough = vec![effects::parse("pitch-error:random=20e-6").expect("known")];
    let sampled = rig.sampled(&motion, 1.0, &rough, 20e3, 2000).expect("runs");
    assert!(sampled.energy.least_mesh_force_n < 0.0, "{:?}", sampled.energy);
    let calm = rig.sampled(&motion, 11.9, &[], 20e3, 2000).expect("runs");
    assert!(calm.energy.least_mesh_force_n > 0.0, "{:?}", calm.energy);
}

#[test]
fn theory_characteristics_of_motor_and_load_damp_the_train() {
    let mut machine = smooth_machine();
    let motion = Motion::Constant { speed_hz: 12.0, turns_at_zero: 0.0 };
    // Motor and load swing against each other after the start; the slopes of their characteristics brake them.
    let speed_rms = |machine: &Machine| {
        let rig = Rig::new(machine, Model::BendingTorsional, Damping::Declared).expect("sound");
        let motor = rig.system.index(Coordinate::Motor).expect("a motor");
        let (mut sum, mut count) = (0.0, 0);
        let ripple = vec![effects::parse("torque-ripple:depth=0.5,frequency=2").expect("known")];
        rig.run(&motion, 10.0, &ripple, 1.0, |step| {
            if step.start_s > 0.0 {
                let v = step.velocity(motor).value(0.5 * step.end);
                sum += v * v;
                count += 1;
            }
        })
        .expect("runs");
        (sum / f64::from(count)).sqrt()
    };
    let free = speed_rms(&machine);
    machine.motor =
        Some(Motor { line_frequency_hz: 50.0, pole_pairs: 2, breakdown_torque_n_m: 30.0, breakdown_slip: 0.2 });
    machine.load = Some(Load { speed_exponent: 2.0 });
    let braked = speed_rms(&machine);
    assert!(braked < 0.9 * free, "{braked} and {free} rad/s");
}
