//! `meshband predict` of a record of a train: what its train machine gives at the channels, by their names.
//!
//! A channel is predicted where it is named as `meshband simulate` names its sensors: "bearing of pinion of stage 2,
//! y", "ring housing of stage 1". The angle comes from the tach by the train's exact ratio. Limit:
//! a record tells its first angle within one turn of the tach's shaft; where it began whole turns later, meshes of
//! other shafts stand elsewhere, and levels can be compared, not waveforms.

use super::{Args, Outcome, compare};
use meshband_host::dynamics::Motion;
use meshband_host::output::{OutputFolder, show};
use meshband_host::record::{Record, Run as Recorded, npy};
use meshband_host::results::Announced;
use meshband_host::train_dynamics::effects::Effect;
use meshband_host::train_dynamics::sensor::{Axis, Sensor};
use meshband_host::train_dynamics::{Run, TrainMachine, simulate};
use meshband_host::{Error, Result, budget, say, terminal};
use rayon::prelude::*;

/// The train machine to predict with; none where the record is a pair's.
///
/// # Errors
/// A record of a train without one, files that cannot be read, a machine of another train.
pub fn machine(args: &Args, record: &Record) -> Result<Option<TrainMachine>> {
    let given = args.machine.as_deref().filter(|path| path.is_file());
    let is_train = given.map(budget::read_text).transpose()?.is_some_and(|text| TrainMachine::is_declared(&text));
    match (record.declaration.has_train(), given, is_train) {
        (false, _, false) => Ok(None),
        (true, Some(path), true) => {
            let machine = TrainMachine::read(path)?;
            let declared = record.declaration.train()?;
            if declared.is_some_and(|train| train.declaration.stages != machine.train.declaration.stages) {
                return Err(Error::invalid(path.display(), "has other [[stage]] tables than the record"));
            }
            if args.effects_file.is_some() {
                return Err(Error::invalid("--effects", "is for gear pairs; simulate a train with --effect"));
            }
            Ok(Some(machine))
        }
        (true, ..) => {
            let what = "is a record of a train: give its train machine with --machine (tables [[stage]] and [[mesh]])";
            Err(Error::invalid(record.folder.display(), what))
        }
        (false, _, true) => Err(Error::invalid("--machine", "is of a train; the record declares none ([[stage]])")),
    }
}

/// Writes one prediction per run.
pub fn run(
    args: &Args,
    record: &Record,
    machine: &TrainMachine,
    (names, folder, mut files): (&[String], OutputFolder, Announced),
) -> Result<()> {
    let channels = &record.declaration.acquisition.channels;
    let sensors: Vec<Sensor> = channels.iter().map(|name| sensor(machine, name)).collect::<Result<_>>()?;
    let drawn = files.wants_report();
    let outcomes: Vec<Outcome> = record
        .runs
        .par_iter()
        .zip(names)
        .map(|(run, name)| {
            let predicted = predicted(record, machine, run, &sensors)?;
            let values: Vec<f32> =
                (0..run.samples()).flat_map(|i| predicted.iter().map(move |channel| channel[i] as f32)).collect();
            folder.write(name, npy::bytes_f32(&values, predicted.len()))?;
            Ok(compare(run, &predicted, None, drawn))
        })
        .collect::<Result<_>>()?;
    folder.commit()?;
    let mut rows = Vec::new();
    for outcome in &outcomes {
        for ((name, rest), level) in channels.iter().zip(&outcome.remaining).zip(&outcome.level_db) {
            rows.push(vec![outcome.run.clone(), name.clone(), format!("{:.3}", 100.0 * rest), format!("{level:+.3}")]);
        }
    }
    let head = ["run", "channel", "remaining, %", "level, dB"];
    files.write(&outcomes, || super::report(args, &outcomes, channels, (&head, &rows)))?;
    say!("remaining below 15 kHz, of the measured AC RMS; predicted level less measured")?;
    show(&terminal::table(&head, &rows))
}

/// The sensor that a channel's name stands for.
fn sensor(machine: &TrainMachine, name: &str) -> Result<Sensor> {
    let train = &machine.train;
    let bearings =
        (0..train.gears.len()).flat_map(|gear| [Axis::X, Axis::Y].map(|axis| Sensor::Bearing { gear, axis }));
    let sets = train.meshes.iter().filter(|mesh| mesh.carrier.is_some());
    let rings =
        sets.map(|mesh| Sensor::Ring { stage: mesh.stage, place_turns: super::super::simulate::RING_PLACE_TURNS });
    let all: Vec<Sensor> = bearings.chain(rings).collect();
    all.iter().find(|sensor| sensor.words(machine) == name).copied().ok_or_else(|| {
        let known: Vec<String> = all.iter().map(|sensor| sensor.words(machine)).collect();
        let what = format!("channel `{name}` is no sensor of the train machine; name it one of: {}", known.join("; "));
        Error::invalid("[acquisition] channels", what)
    })
}

fn predicted(record: &Record, machine: &TrainMachine, run: &Recorded, sensors: &[Sensor]) -> Result<Vec<Vec<f64>>> {
    let tach = record.require_tach()?;
    let shaft = tach.train_shaft().unwrap_or(0);
    let first = u64::from(run.declaration.first_pulse_index);
    let jitter_s = tach.jitter_s.unwrap_or(0.0);
    let motion = Motion::from_tach(&run.edges_s, tach.pulses_per_rev, first, jitter_s)?;
    let torque = run.declaration.input_torque_n_m.ok_or_else(|| {
        Error::invalid(
            format!("[[run]] {}", run.declaration.signal),
            "input_torque_n_m: missing; a prediction needs it",
        )
    })?;
    let load_per_drive = 1.0 / machine.train.shaft_order(machine.load.shaft).value();
    let asked = Run {
        motion: motion.geared(1.0 / machine.train.shaft_order(shaft).value()),
        load_torque_n_m: torque * load_per_drive,
        effects: Vec::<Effect>::new(),
        sensors: sensors.to_vec(),
        rate_hz: run.sample_rate_hz(),
        duration_s: run.samples() as f64 / run.sample_rate_hz(),
        tach_shaft: shaft,
        pulses_per_turn: tach.pulses_per_rev,
        jitter_s: 0.0,
        noise_m_s2: 0.0,
        seed: 0,
    };
    Ok(simulate(machine, &asked)?.channels)
}
