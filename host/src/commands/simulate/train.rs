//! `meshband simulate` of a train: a machine file with `[[stage]]` and `[[mesh]]` goes here.
//!
//! Channels are the bearing of the first gear of every shaft along y, and the ring housing of every planetary set. The
//! tachometer is the file's own, or one on shaft 0.

use super::{Args, run_up};
use meshband_host::dynamics::Motion;
use meshband_host::dynamics::simulate::{run_seed, start_turns};
use meshband_host::output::Content;
use meshband_host::record::{self, Declaration, Record, RunDeclaration, Tach};
use meshband_host::report::Report;
use meshband_host::report::plot::{Axes, Series, spectrum};
use meshband_host::spectral::{Window, amplitude_spectrum};
use meshband_host::train_dynamics::effects::Effect;
use meshband_host::train_dynamics::sensor::{Axis, Sensor};
use meshband_host::train_dynamics::{Run, Simulated, TrainMachine, simulate};
use meshband_host::{Error, Result, remark};
use rayon::prelude::*;
use std::path::PathBuf;

/// Whether the machine file declares a train with its toothing.
///
/// # Errors
/// A file that cannot be read.
pub fn is_train(args: &Args) -> Result<bool> {
    Ok(args.machine.is_file() && TrainMachine::is_declared(&meshband_host::budget::read_text(&args.machine)?))
}

/// Simulates the runs and writes the record.
pub fn run(args: &Args) -> Result<()> {
    let unfit = [("--field", args.field.is_some()), ("--effects", args.effects_file.is_some())];
    if let Some((option, _)) = unfit.into_iter().find(|(_, is_given)| *is_given) {
        return Err(Error::invalid(option, "is for gear pairs; a train takes --effect"));
    }
    let mut outputs = args.results.outputs([args.machine.as_path()]);
    let folder = outputs.folder(&args.output, Content::Record)?;
    let mut files = args.results.announce(&mut outputs)?;
    let machine = TrainMachine::read(&args.machine)?;
    let sensors = sensors(&machine)?;
    let runs = runs(args, &machine, &sensors)?;
    let results: Vec<Simulated> = runs.par_iter().map(|run| simulate(&machine, run)).collect::<Result<_>>()?;
    for (index, warning) in results.iter().enumerate().filter_map(|(i, r)| Some((i, warning(r)?))) {
        remark!("warning: run {index}: {warning}");
    }
    record(&machine, &sensors, &runs, &results)?.write_to(folder)?;
    let json = json(args, &machine, &runs, &results);
    files.write(&json, || report(&machine, &sensors, &runs, &results))
}

/// Place of the sensor on a ring, turns from the housing's x axis: upright.
pub const RING_PLACE_TURNS: f64 = 0.25;

/// One sensor per shaft with gears of parallel stages, one per ring.
fn sensors(machine: &TrainMachine) -> Result<Vec<Sensor>> {
    let train = &machine.train;
    let mut all = Vec::new();
    for shaft in 0..train.shafts.len() {
        if train.gears_on(shaft).next().is_some() {
            all.push(Sensor::on_shaft(machine, shaft, Axis::Y)?);
        }
    }
    let sets = train.meshes.iter().filter(|mesh| mesh.carrier.is_some());
    all.extend(sets.map(|mesh| Sensor::Ring { stage: mesh.stage, place_turns: RING_PLACE_TURNS }));
    Ok(all)
}

/// Torque of the load per torque of the drive.
fn load_per_drive(machine: &TrainMachine) -> f64 {
    1.0 / machine.train.shaft_order(machine.load.shaft).value()
}

/// The runs asked for.
fn runs(args: &Args, machine: &TrainMachine, sensors: &[Sensor]) -> Result<Vec<Run>> {
    let nominal = |given: Vec<f64>, option: &str, value: Option<f64>| match (given.is_empty(), value) {
        (false, _) => Ok(given),
        (true, Some(value)) => Ok(vec![value]),
        (true, None) => Err(Error::invalid(option, "is needed: the machine declares no [nominal]")),
    };
    let declared = machine.nominal;
    let drive = declared.map(|n| n.load_torque_n_m / load_per_drive(machine));
    let torques = nominal(args.torque.clone(), "--torque", drive)?;
    let (mut motions, mut default_s) = (Vec::new(), 2.0);
    if args.run_up.is_empty() {
        let speeds = args.speed.iter().map(|speed| speed.0).collect();
        let speeds = nominal(speeds, "--speed", declared.map(|n| n.speed_hz))?;
        motions.extend(speeds.into_iter().map(|speed_hz| Motion::Constant { speed_hz, turns_at_zero: 0.0 }));
    } else {
        let (motion, seconds) = run_up(&args.run_up)?;
        motions.push(motion);
        default_s = seconds;
    }
    let effects: Vec<Effect> = args.effects.iter().map(|text| Effect::parse(text)).collect::<Result<_>>()?;
    let tach = machine.train.declaration.tachs.first();
    let mut runs = Vec::new();
    for motion in &motions {
        for &torque in &torques {
            let seed = run_seed(args.seed, runs.len());
            let mut motion = motion.clone();
            if let (Motion::Constant { turns_at_zero, .. }, true) = (&mut motion, args.random_start) {
                *turns_at_zero = start_turns(seed);
            }
            runs.push(Run {
                motion,
                load_torque_n_m: torque * load_per_drive(machine),
                effects: effects.clone(),
                sensors: sensors.to_vec(),
                rate_hz: args.rate,
                duration_s: args.duration.unwrap_or(default_s),
                tach_shaft: tach.map_or(0, |tach| tach.shaft),
                pulses_per_turn: tach.map_or(args.pulses, |tach| tach.pulses_per_turn),
                jitter_s: args.jitter,
                noise_m_s2: args.noise,
                seed,
            });
        }
    }
    Ok(runs)
}

/// That teeth would have to pull.
fn warning(simulated: &Simulated) -> Option<String> {
    let least = simulated.statistics.least_mesh_force_n;
    (least < 0.0).then(|| format!("a mesh force falls to {least:.3e} N: teeth cannot pull, the contact here is linear"))
}

fn record(machine: &TrainMachine, sensors: &[Sensor], runs: &[Run], results: &[Simulated]) -> Result<Record> {
    let train = &machine.train;
    let all: Vec<Vec<f64>> = results.iter().flat_map(|r| r.channels.iter().cloned()).collect();
    let first = runs.first().ok_or_else(|| Error::invalid("--speed", "no run is asked for"))?;
    let acquisition = record::Acquisition {
        sample_rate_hz: first.rate_hz,
        channels: sensors.iter().map(|sensor| sensor.words(machine)).collect(),
        full_scale_m_s2: record::suggested_full_scale(&all),
        code_bits: 16,
        unit: None,
        other: toml::Table::new(),
    };
    let tach = Tach {
        shaft: "pinion".into(),
        turns_per_pinion_turn: None,
        pulses_per_rev: first.pulses_per_turn,
        jitter_s: Some(first.jitter_s),
        source: None,
        other: toml::Table::new(),
    };
    let pair = train.declaration.as_pair();
    let tach = match (pair, first.tach_shaft) {
        (Some(_), 0) => tach,
        (Some(_), _) => Tach { shaft: "gear".into(), ..tach },
        (None, shaft) => tach.on_train_shaft(shaft, train.shaft_order(shaft).value()),
    };
    let title = &train.declaration.title;
    let mut declaration = Declaration::of_import(title, pair, acquisition.clone(), Some(tach));
    declaration.rest.extend(train.declaration.tables()?);
    let mut made = Vec::new();
    for (index, (run, simulated)) in runs.iter().zip(results).enumerate() {
        if simulated.edges_s.len() < 2 {
            let what = format!("{} tach edges in run {index}: a speed needs two", simulated.edges_s.len());
            return Err(Error::invalid("--duration", what));
        }
        let mut table = RunDeclaration::numbered(index, true, Some(run.load_torque_n_m / load_per_drive(machine)));
        table.first_pulse_index = simulated.first_pulse_index;
        declaration.runs.push(table.clone());
        made.push(record::Run::from_signals(table, &acquisition, &simulated.channels, simulated.edges_s.clone())?);
    }
    Ok(Record { folder: PathBuf::from("."), declaration, runs: made })
}

fn json(args: &Args, machine: &TrainMachine, runs: &[Run], results: &[Simulated]) -> serde_json::Value {
    let runs: Vec<_> = runs
        .iter()
        .zip(results)
        .map(|(run, r)| {
            serde_json::json!({
                "input_speed_hz": run.motion.speed_hz(0.0),
                "input_torque_n_m": run.load_torque_n_m / load_per_drive(machine),
                "load_torque_n_m": run.load_torque_n_m,
                "settling_s": r.settling_s,
                "steps": r.statistics.steps,
                "least_mesh_force_n": r.statistics.least_mesh_force_n,
                "warning": warning(r),
            })
        })
        .collect();
    serde_json::json!({ "effects": args.effects, "seed": args.seed, "runs": runs })
}

fn report(machine: &TrainMachine, sensors: &[Sensor], runs: &[Run], results: &[Simulated]) -> Result<Report> {
    let mut report = Report::new("Simulation of a train", &machine.train.declaration.title)
        .figure("Runs", results.len())
        .figure("Shafts", machine.train.shafts.len())
        .figure("Effects", runs.first().map_or(0, |run| run.effects.len()));
    for (index, (run, r)) in runs.iter().zip(results).enumerate() {
        let rows: Vec<Vec<String>> = sensors
            .iter()
            .zip(&r.channels)
            .map(|(sensor, x)| {
                let rms = (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt();
                vec![sensor.words(machine), format!("{rms:.4}")]
            })
            .collect();
        let bins = |channel: &Vec<f64>, sensor: &Sensor| {
            let s = amplitude_spectrum(channel, run.rate_hz, Window::Hann);
            let values = (1..s.values.len()).map(|i| (s.frequency(i), s.values[i])).collect();
            Series::new(&sensor.words(machine), values)
        };
        let series: Vec<Series> = r.channels.iter().zip(sensors).take(2).map(|(c, s)| bins(c, s)).collect();
        let axes = Axes { x: "frequency, Hz", y: "acceleration, dB re 1 m/s2" };
        let title = format!("Run {index}: {} Hz, load {} N m", run.motion.speed_hz(0.0), run.load_torque_n_m);
        report = report
            .section(&title)
            .table("Root mean square of each channel, m/s2.", &["channel", "level"], &rows)
            .picture(&spectrum(&series, &[], 1.0, 100.0, axes)?, "Amplitude spectrum of the first channels.");
        if let Some(text) = warning(r) {
            report = report.note(&text);
        }
    }
    Ok(report)
}
