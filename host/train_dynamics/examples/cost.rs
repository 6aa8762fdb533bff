//! Cost of a train per coordinate and simulated second, beside today's pair: `cargo run --release -p
//! meshband-train-dynamics --example cost`. Least of several repetitions, one core.

use meshband_mechanics::dynamics::assembly::{Damping, Model};
use meshband_mechanics::dynamics::{Motion, Rig};
use meshband_mechanics::machine::Machine;
use meshband_train_dynamics::TrainMachine;
use meshband_train_dynamics::assembly::System;
use meshband_train_dynamics::integrate::{Course, options};
use std::path::Path;
use std::time::Instant;

/// Repetitions of each measurement.
const REPETITIONS: usize = 7;
/// Simulated time, s, beside the pair's run-in.
const SECONDS: f64 = 1.6;

fn least_s(mut run: impl FnMut()) -> f64 {
    let times = (0..REPETITIONS).map(|_| {
        let start = Instant::now();
        run();
        start.elapsed().as_secs_f64()
    });
    times.fold(f64::INFINITY, f64::min)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let machines = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../machines");
    let pair = Machine::read(&machines.join("19-48.toml"))?;
    let rig = Rig::new(&pair, Model::BendingTorsional, Damping::Declared)?;
    let nominal = pair.nominal.ok_or("no operating point")?;
    let motion = Motion::Constant { speed_hz: nominal.speed_hz, turns_at_zero: 0.0 };
    let mut steps = 0;
    let taken = least_s(|| {
        steps = rig.run(&motion, nominal.torque_n_m, &[], SECONDS, |_| {}).map_or(0, |statistics| statistics.steps);
    });
    let per_pair = taken / (SECONDS + rig.run_in_s) / 8.0;
    println!("pair 19-48: 8 coordinates, {steps} steps, {:.3} ms per coordinate and second", 1e3 * per_pair);
    for name in ["train-two-stage", "train-planetary"] {
        let machine = TrainMachine::read(&machines.join(format!("{name}.toml")))?;
        let system = System::assemble(&machine)?;
        let nominal = machine.nominal.ok_or("no operating point")?;
        let motion = Motion::Constant { speed_hz: nominal.speed_hz, turns_at_zero: 0.0 };
        let load_torque_n_m = nominal.load_torque_n_m;
        let course = Course { system: &system, motion: &motion, load_torque_n_m, effects: &[] };
        let (mut steps, mut orders) = (0, 0);
        let start = course.start()?;
        let taken = least_s(|| {
            let statistics = course.integrate(&mut start.clone(), (0.0, SECONDS), &options(), |_| {});
            (steps, orders) = statistics.map_or((0, 0), |statistics| (statistics.steps, statistics.orders));
        });
        let own = taken / SECONDS / system.len() as f64;
        println!(
            "{name}: {} coordinates, {} meshes, {steps} steps of {:.1} orders, {:.3} ms per coordinate and second, \
             {:.2} of the pair's",
            system.len(),
            system.meshes.len(),
            orders as f64 / steps as f64,
            1e3 * own,
            own / per_pair
        );
    }
    Ok(())
}
