//! A train of one spur stage is the pair that the pair's own simulator has.

use super::{line, machine_path, rms, waveform};
use meshband_mechanics::dynamics::assembly::{Damping, Model};
use meshband_mechanics::dynamics::inertia::InertiaTorque;
use meshband_mechanics::dynamics::{Effect as PairEffect, Motion, Rig, Step};
use meshband_mechanics::machine::Machine;
use meshband_train_dynamics::TrainMachine;
use meshband_train_dynamics::assembly::System;
use meshband_train_dynamics::effects::{Effect, Seat};
use meshband_train_dynamics::integrate::Course;

/// Input speed, Hz, and torque, N m, of the machine's operating point.
const SPEED_HZ: f64 = 30.0;
const TORQUE_N_M: f64 = 11.9;
/// Run-in of the pair's simulator, s.
const RUN_IN_S: f64 = 0.4;
/// A whole number of samples per mesh period.
const RATE_HZ: f64 = 19.0 * SPEED_HZ * 256.0;

/// The 19/48 pair of `machines/19-48.toml` as a train: its line of action lies along y at a centre line of 20 degrees.
fn train() -> TrainMachine {
    let ramp = 0.04 * 19.0 / std::f64::consts::TAU;
    let text = format!(
        "[[stage]]\nkind = \"pair\"\nteeth = [19, 48]\n[[mesh]]\nmodule_mm = 3.175\nface_width_mm = \
         16\ncentre_line_deg = 20\nbore_radius_mm = [9.6, 26.5]\nyoungs_modulus_gpa = \
         206.8\nengagement_base_pitches = {ramp}\nmesh_damping_ratio = 0.03\nmass_kg = [0.96, 2.88]\ninertia_kg_m2 = \
         [4.3659e-4, 8.3602e-3]\n[[shaft]]\nbearing_stiffness_n_per_m = [6.56e7, \
         6.56e7]\nbearing_damping_n_s_per_m = [600, 600]\n[[shaft]]\nbearing_stiffness_n_per_m = [6.56e7, \
         6.56e7]\nbearing_damping_n_s_per_m = [1000, 1000]\n[drive]\ninertia_kg_m2 = \
         0.0021\ncoupling_stiffness_n_m_per_rad = 4.4e4\ncoupling_damping_n_m_s_per_rad = 0.4\n[load]\ninertia_kg_m2 \
         = 0.0105\ncoupling_stiffness_n_m_per_rad = 4.4e4\ncoupling_damping_n_m_s_per_rad = 1.43\n"
    );
    TrainMachine::parse(&text, "pair").expect("a machine")
}

/// Acceleration of both bodies along the line of action by the pair's own simulator.
fn of_pair(motion: &Motion, effects: &[Box<dyn PairEffect>], count: usize) -> [Vec<f64>; 2] {
    let machine = Machine::read(&machine_path("19-48")).expect("a machine");
    let mut rig = Rig::new(&machine, Model::BendingTorsional, Damping::Declared).expect("a rig");
    rig.options.tolerance = 1e-11;
    let sensors = rig.sensors().expect("sensors");
    let mut signals = [Vec::new(), Vec::new()];
    let duration = (count as f64 + 0.5) / RATE_HZ;
    let sink = |step: &Step| {
        let first = signals[0].len();
        let until = ((step.end_s() * RATE_HZ).ceil().max(0.0) as usize).min(count);
        for (signal, sensor) in signals.iter_mut().zip(sensors) {
            let series = step.acceleration(sensor);
            let at = |i: usize| (i as f64 / RATE_HZ - step.start_s) / step.length_s;
            signal.extend((first..until).map(|i| series.value(at(i))));
        }
    };
    rig.run(motion, TORQUE_N_M, effects, duration, sink).expect("a run");
    signals
}

fn of_train(motion: &Motion, effects: &[Effect], count: usize) -> Vec<Vec<f64>> {
    let system = System::assemble(&train()).expect("a system");
    let load_torque_n_m = TORQUE_N_M * 48.0 / 19.0;
    let course = Course { system: &system, motion, load_torque_n_m, effects };
    let y = [system.bodies[0].at + 2, system.bodies[1].at + 2];
    waveform(&course, -RUN_IN_S, (RATE_HZ, count), &|step, i| step.acceleration(y[i]), 2)
}

/// Largest difference over the root mean square.
fn distance(ours: &[f64], own: &[f64]) -> f64 {
    assert_eq!(ours.len(), own.len());
    ours.iter().zip(own).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / rms(own)
}

#[test]
fn ref_a_train_of_one_stage_has_the_pairs_waveform_and_spectrum() {
    let motion = Motion::Constant { speed_hz: SPEED_HZ, turns_at_zero: 0.0 };
    let count = 256 * 19;
    let (ours, own) = (of_train(&motion, &[], count), of_pair(&motion, &[], count));
    for channel in 0..2 {
        let far = distance(&ours[channel], &own[channel]);
        assert!(far < 1e-4, "channel {channel}: {far:e} of the root mean square");
        let lines = |signal: &[f64]| -> Vec<f64> {
            (1..=40).map(|k| line(signal, RATE_HZ, f64::from(k) * 19.0 * SPEED_HZ)).collect()
        };
        for (k, (a, b)) in lines(&ours[channel]).into_iter().zip(lines(&own[channel])).enumerate() {
            assert!((a / b - 1.0).abs() < 1e-3, "channel {channel}, harmonic {}: {a} {b}", k + 1);
        }
    }
}

#[test]
fn ref_a_run_up_of_one_stage_has_the_pairs_waveform() {
    let motion = Motion::RunUp { from_hz: 20.0, to_hz: 40.0, duration_s: 0.1 };
    let count = (0.1 * RATE_HZ) as usize;
    // The pair leaves out the pinion's own share of the torque, which twists the input's coupling.
    let inertia = InertiaTorque::of(&Machine::read(&machine_path("19-48")).expect("a machine"));
    let (ours, own) = (of_train(&motion, &[], count), of_pair(&motion, &[Box::new(inertia)], count));
    // The start of the change excites that coupling; later nothing is left of it.
    let later = |signal: &[f64]| signal[count / 2..].to_vec();
    let far = distance(&later(&ours[1]), &later(&own[1]));
    assert!(far < 0.02, "{far:e} of the root mean square");
    let without = distance(&later(&of_pair(&motion, &[], count)[1]), &later(&own[1]));
    assert!(without > 10.0 * far, "the mesh carries what speeds the load up: {without:e}");
}

#[test]
fn ref_runout_of_the_gear_is_the_pairs_eccentricity() {
    let motion = Motion::Constant { speed_hz: SPEED_HZ, turns_at_zero: 0.0 };
    let count = 256 * 48;
    let seat = Seat { gear: 1, planet: None };
    let effect = Effect::Runout { at: seat, amplitude_m: 8e-6, phase_turns: 0.2 };
    let eccentricity = meshband_mechanics::effects::parse("eccentricity:amplitude=8e-6,phase=0.3,gear=1");
    let eccentricity = eccentricity.expect("an effect");
    let own = of_pair(&motion, &[eccentricity], count);
    let ours = of_train(&motion, &[effect], count);
    // Phases are counted from elsewhere, so lines are compared: the sidebands of the first harmonics.
    for order in [47.0, 48.0, 49.0, 96.0, 97.0] {
        let hz = order * SPEED_HZ * 19.0 / 48.0;
        let (a, b) = (line(&ours[1], RATE_HZ, hz), line(&own[1], RATE_HZ, hz));
        assert!((a / b - 1.0).abs() < 1e-3, "order {order}: {a} {b}");
    }
}
