//! The same equations by another way: dense matrices, stiffness as a sum over single pairs, classical Runge-Kutta.

use super::{machine, rms, waveform};
use meshband_mechanics::dynamics::Motion;
use meshband_train_dynamics::TrainMachine;
use meshband_train_dynamics::assembly::System;
use meshband_train_dynamics::effects::{Effect, Seat};
use meshband_train_dynamics::integrate::Course;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;

/// A train by Runge-Kutta.
struct Independent<'s> {
    system: &'s System,
    directions: Vec<DVector<f64>>,
    inverse_mass: DVector<f64>,
    force: DVector<f64>,
    speed_hz: f64,
    /// Loss of stiffness of a tooth of the first gear of a mesh: mesh, tooth, share.
    loss: Option<(usize, i64, f64)>,
    /// Runout of the first gear of a mesh: mesh and amplitude, m.
    runout: Option<(usize, f64)>,
}

impl Independent<'_> {
    /// Accelerations.
    fn rates(&self, t: f64, q: &DVector<f64>, v: &DVector<f64>) -> DVector<f64> {
        let mut force = &self.force - &self.system.stiffness * q - &self.system.damping * v;
        for (index, (mesh, direction)) in self.system.meshes.iter().zip(&self.directions).enumerate() {
            let curve = &self.system.stiffnesses[mesh.stiffness];
            let mut position = mesh.order * self.speed_hz * t + mesh.phase;
            let turns = (position - curve.pitch_point) / f64::from(mesh.teeth[0]);
            let turn_rate = mesh.order * self.speed_hz / f64::from(mesh.teeth[0]);
            let (mut e, mut rate) = (0.0, 0.0);
            if let Some((_, amplitude)) = self.runout.filter(|(of, _)| *of == index) {
                e = -amplitude * (TAU * turns).sin();
                rate = -amplitude * TAU * turn_rate * (TAU * turns).cos();
                position += e / curve.base_pitch_m;
            }
            let approach = direction.dot(q) - e + mesh.damping_s * (direction.dot(v) - rate);
            let first = position.floor() as i64 - 6;
            for number in first..first + 8 {
                let mut k = curve.pair.value(position - number as f64);
                if let Some((_, tooth, share)) = self.loss.filter(|(of, ..)| *of == index) {
                    let own = number.rem_euclid(i64::from(mesh.teeth[0])) == tooth;
                    k *= if own { 1.0 - share } else { 1.0 };
                }
                force -= k * approach * direction;
            }
        }
        force.component_mul(&self.inverse_mass)
    }

    /// Accelerations at every `every`-th of `steps` steps of classical Runge-Kutta.
    fn run(&self, start: DVector<f64>, dt: f64, steps: usize, every: usize) -> Vec<DVector<f64>> {
        let (mut q, mut v) = (start, DVector::zeros(self.system.len()));
        let mut all = Vec::new();
        for i in 0..steps {
            let t = i as f64 * dt;
            let a1 = self.rates(t, &q, &v);
            if i % every == 0 {
                all.push(a1.clone());
            }
            let (v2, q2) = (&v + 0.5 * dt * &a1, &q + 0.5 * dt * &v);
            let a2 = self.rates(t + 0.5 * dt, &q2, &v2);
            let (v3, q3) = (&v + 0.5 * dt * &a2, &q + 0.5 * dt * &v2);
            let a3 = self.rates(t + 0.5 * dt, &q3, &v3);
            let (v4, q4) = (&v + dt * &a3, &q + dt * &v3);
            let a4 = self.rates(t + dt, &q4, &v4);
            q += dt / 6.0 * (&v + 2.0 * &v2 + 2.0 * &v3 + &v4);
            v += dt / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
        }
        all
    }
}

/// Largest distance of all accelerations from Runge-Kutta's, over the root mean square of each.
fn distance(
    machine: &TrainMachine,
    load_torque_n_m: f64,
    effects: &[Effect],
    disturb: impl Fn(&mut Independent),
) -> f64 {
    let system = System::assemble(machine).expect("a system");
    let speed_hz = 25.0;
    let motion = Motion::Constant { speed_hz, turns_at_zero: 0.0 };
    let course = Course { system: &system, motion: &motion, load_torque_n_m, effects };
    let (rate_hz, count, every) = (50_000.0, 1000, 80);
    let ours = waveform(&course, 0.0, (rate_hz, count), &|step, i| step.acceleration(i), system.len());
    let mut independent = Independent {
        directions: system.meshes.iter().map(|mesh| system.direction(mesh)).collect(),
        inverse_mass: system.mass.map(|mass| 1.0 / mass),
        force: load_torque_n_m * &system.force_per_load,
        system: &system,
        speed_hz,
        loss: None,
        runout: None,
    };
    disturb(&mut independent);
    let start = system.static_deflection(load_torque_n_m).expect("a deflection");
    let own = independent.run(start, 1.0 / (rate_hz * every as f64), count * every, every);
    let far = |i: usize| {
        let level = rms(&ours[i]);
        let largest = own.iter().enumerate().map(|(n, a)| (a[i] - ours[i][n]).abs()).fold(0.0, f64::max);
        if level > 0.0 { largest / level } else { largest }
    };
    assert!(rms(&ours[3]) > 1e-3, "the train moves");
    (0..system.len()).map(far).fold(0.0, f64::max)
}

#[test]
fn ref_two_stages_move_as_by_runge_kutta_sound_and_with_faults() {
    let machine = machine("train-two-stage");
    let far = distance(&machine, 200.0, &[], |_| {});
    assert!(far < 1e-4, "sound: {far:e}");
    let cracked = Effect::ToothStiffness { at: Seat { gear: 2, planet: None }, tooth: 3, loss: 0.3 };
    let runout = Effect::Runout { at: Seat { gear: 0, planet: None }, amplitude_m: 12e-6, phase_turns: 0.0 };
    let far = distance(&machine, 200.0, &[cracked, runout], |independent| {
        independent.loss = Some((1, 3, 0.3));
        independent.runout = Some((0, 12e-6));
    });
    assert!(far < 1e-4, "with faults: {far:e}");
}

#[test]
fn ref_a_planetary_set_moves_as_by_runge_kutta() {
    let far = distance(&machine("train-planetary"), 100.0, &[], |_| {});
    assert!(far < 1e-4, "{far:e}");
}

#[test]
fn theory_the_matrices_of_every_example_are_symmetric_and_lose_no_rotation() {
    for name in ["train-two-stage", "train-planetary"] {
        let system = System::assemble(&machine(name)).expect("a system");
        let full = system.mean_stiffness();
        let asymmetry: DMatrix<f64> = &full - full.transpose();
        assert!(asymmetry.amax() <= 1e-12 * full.amax(), "{name}");
        assert!((&full * &system.rigid).amax() < 1e-9 * full.amax() * system.rigid.amax(), "{name}");
        assert!(system.rigid.dot(&system.force_per_load).abs() < 1e-12, "{name}");
    }
}
