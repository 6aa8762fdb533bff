//! `meshband simulate`: a record folder of a simulated machine, one run per pair of speed and torque.

mod field;
mod train;

pub use train::RING_PLACE_TURNS;

use clap::{Args as ClapArgs, ValueEnum};
use meshband_host::budget::ALL_STEPS;
use meshband_host::dynamics::assembly::{Damping, Model};
use meshband_host::dynamics::rig::{PARTS, Rig};
use meshband_host::dynamics::simulate::{Acquisition, Simulated, run_seed, simulate, start_turn, start_turns};
use meshband_host::dynamics::work::{check_edges, check_samples};
use meshband_host::dynamics::{Effect, Motion};
use meshband_host::machine::Hunting;
use meshband_host::machine::Machine;
use meshband_host::output::Content;
use meshband_host::record::{self, Declaration, Record, Run, RunDeclaration, Tach};
use meshband_host::report::Report;
use meshband_host::report::plot::{Axes, Series, lines, spectrum};
use meshband_host::results::Results;
use meshband_host::spectral::{Window, amplitude_spectrum};
use meshband_host::speed::Speed;
use meshband_host::{Error, Result, effects, remark, terminal};
use rayon::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// Arguments of `meshband simulate`.
#[derive(ClapArgs)]
pub struct Args {
    /// Machine file or record folder.
    machine: PathBuf,
    /// Pinion speeds, as 24.75Hz or 1485rpm (a bare number is Hz), separated by commas; default: the machine's
    /// nominal speed.
    #[arg(long, value_delimiter = ',')]
    speed: Vec<Speed>,
    /// One run whose speed changes linearly instead: FROM,TO (Hz),SECONDS; it lasts at least that long.
    #[arg(long, value_delimiter = ',', num_args = 1, conflicts_with = "speed")]
    run_up: Vec<f64>,
    /// Torques at the motor, N m, separated by commas; default: the machine's nominal torque.
    #[arg(long, value_delimiter = ',')]
    torque: Vec<f64>,
    /// Effect, `name:key=value,...`; may be repeated (`meshband effects` lists them).
    #[arg(long = "effect")]
    effects: Vec<String>,
    /// File of `[[effect]]` tables, as `meshband loop --apply` writes it.
    #[arg(long = "effects", value_name = "FILE")]
    effects_file: Option<PathBuf>,
    /// Sampling rate, Hz.
    #[arg(long, default_value_t = 51_200.0)]
    rate: f64,
    /// Length of each run, s; default: 2, or the run-up's duration.
    #[arg(long)]
    duration: Option<f64>,
    /// Tach pulses per turn of the pinion.
    #[arg(long, default_value_t = 1, conflicts_with = "field")]
    pulses: u32,
    /// Standard deviation of tach edges, s.
    #[arg(long, default_value_t = 0.0, conflicts_with = "field")]
    jitter: f64,
    /// Standard deviation of white noise, m/s2.
    #[arg(long, default_value_t = 0.0, conflicts_with = "field")]
    noise: f64,
    /// Seed of the random streams.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Start every run at a random angle of the hunting period (from the seed) instead of angle 0; the first in the
    /// first turn.
    #[arg(long)]
    random_start: bool,
    /// Model: bending-torsional, bending-torsional-6 or casing.
    #[arg(long, default_value = "bending-torsional")]
    model: Model,
    /// A record as owners have them: wander, housing, tachometer, noise from this TOML file (book: howto/simulate).
    #[arg(long, value_name = "FILE", conflicts_with = "random_start")]
    field: Option<PathBuf>,
    /// With --field: writes a folder of an acquisition system's files instead of a record.
    #[arg(long = "as", value_enum, value_name = "FORMAT", requires = "field")]
    files: Option<Files>,
    /// With --field: writes what nobody could measure (angle, paths, effects) as JSON.
    #[arg(long, value_name = "FILE", requires = "field")]
    truth: Option<PathBuf>,
    /// Record folder (with --as: folder of files) to write.
    #[arg(short, long)]
    output: PathBuf,
    #[command(flatten)]
    results: Results,
}

/// Formats of an acquisition system.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Files {
    /// 32-bit float WAV
    Wav,
    /// comma-separated text with a time column
    Csv,
    /// NumPy float32, samples x channels
    Npy,
}

/// One run's conditions.
struct Point {
    motion: Motion,
    speed_text: String,
    torque_n_m: f64,
    seed: u64,
}

/// Simulates the runs and writes the record.
pub fn run(args: Args) -> Result<()> {
    if train::is_train(&args)? {
        return train::run(&args);
    }
    if args.field.is_some() {
        return field::run(&args);
    }
    let read = [Some(&args.machine), args.effects_file.as_ref()].into_iter().flatten().map(PathBuf::as_path);
    let mut outputs = args.results.outputs(read);
    let folder = outputs.folder(&args.output, Content::Record)?;
    let mut files = args.results.announce(&mut outputs)?;
    let Prepared { machine, mut rig, effects, torque_factor } = Prepared::of(&args)?;
    let (points, default_s) = points(&args, &machine)?;
    let duration_s = args.duration.unwrap_or(default_s);
    check_samples(args.rate, duration_s, points.len())?;
    check_work(&rig, &points, &args, duration_s)?;
    rig.progress = Some(Arc::new(terminal::Progress::new("simulate", PARTS * points.len() as u64)));
    let results: Vec<Simulated> = points
        .par_iter()
        .map(|point| {
            let acquisition = Acquisition {
                rate_hz: args.rate,
                duration_s,
                pulses_per_turn: args.pulses,
                jitter_s: args.jitter,
                noise_m_s2: args.noise,
                seed: point.seed,
            };
            simulate(&rig, &point.motion, torque_factor * point.torque_n_m, &effects, &acquisition)
        })
        .collect::<Result<_>>()?;
    rig.progress = None;
    for (index, warning) in results.iter().enumerate().filter_map(|(i, r)| Some((i, warning(r)?))) {
        remark!("warning: run {index}: {warning}");
    }
    record(&args, &machine, &points, &results)?.write_to(folder)?;
    files.write(&json(&args, &points, &results), || report(&args, &machine, &points, &results))
}

/// Machine and effects that the options name.
struct Prepared {
    machine: Machine,
    rig: Rig,
    effects: Vec<Box<dyn Effect>>,
    torque_factor: f64,
}

impl Prepared {
    fn of(args: &Args) -> Result<Self> {
        let machine = Machine::read(&args.machine)?;
        let rig = Rig::new(&machine, args.model, Damping::Declared)?;
        let mut effects = args.effects.iter().map(|text| effects::parse(text)).collect::<Result<Vec<_>>>()?;
        if let Some(path) = &args.effects_file {
            effects.extend(effects::read(path)?);
        }
        let torque_factor = args.effects_file.as_deref().map_or(Ok(1.0), effects::read_torque_factor)?;
        Ok(Self { machine, rig, effects, torque_factor })
    }
}

/// The runs asked for, and their default length, s.
fn points(args: &Args, machine: &Machine) -> Result<(Vec<Point>, f64)> {
    let nominal = |given: &[f64], option: &str, value: Option<f64>| match (given, value) {
        ([], None) => Err(Error::invalid(option, "is needed: the machine declares no [nominal]")),
        ([], Some(value)) => Ok(vec![value]),
        (given, _) => Ok(given.to_vec()),
    };
    let torques = nominal(&args.torque, "--torque", machine.nominal.map(|n| n.torque_n_m))?;
    let mut motions = Vec::new();
    let mut default_s = 2.0;
    match args.run_up[..] {
        [] => {
            for speed_hz in nominal(
                &args.speed.iter().map(|speed| speed.0).collect::<Vec<_>>(),
                "--speed",
                machine.nominal.map(|n| n.speed_hz),
            )? {
                motions.push((Motion::Constant { speed_hz, turns_at_zero: 0.0 }, format!("{speed_hz}")));
            }
        }
        _ => {
            let (motion, duration_s) = run_up(&args.run_up)?;
            default_s = duration_s;
            let text = format!("{} to {}", args.run_up[0], args.run_up[1]);
            motions.push((motion, text));
        }
    }
    let hunting = Hunting::of(machine.pair.teeth).turns;
    let mut points = Vec::new();
    for (motion, speed_text) in &motions {
        for &torque_n_m in &torques {
            let seed = run_seed(args.seed, points.len());
            let mut motion = motion.clone();
            if let (Motion::Constant { turns_at_zero, .. }, true) = (&mut motion, args.random_start) {
                // Anywhere in the hunting period: a tachometer on the pinion does not tell which turn it is. The
                // first run's first edge is within the first turn, so that teeth of the gear keep their numbers.
                let turn = if points.is_empty() { 0 } else { start_turn(seed, hunting) };
                *turns_at_zero = f64::from(turn) + start_turns(seed) - 1.0 / f64::from(args.pulses.max(1));
            }
            points.push(Point { motion, speed_text: speed_text.clone(), torque_n_m, seed });
        }
    }
    Ok((points, default_s))
}

/// A run-up from its option, with its duration, s.
fn run_up(option: &[f64]) -> Result<(Motion, f64)> {
    let &[from_hz, to_hz, duration_s] = option else {
        return Err(Error::invalid("--run-up", "needs FROM,TO,SECONDS"));
    };
    if [from_hz, to_hz, duration_s].iter().any(|x| !(x.is_finite() && *x > 0.0)) {
        return Err(Error::invalid("--run-up", "speeds and duration must be positive numbers"));
    }
    Ok((Motion::RunUp { from_hz, to_hz, duration_s }, duration_s))
}

/// Refuses what is no machine for this rate, and what would take for ever.
fn check_work(rig: &Rig, points: &[Point], args: &Args, duration_s: f64) -> Result<()> {
    let mut steps = 0.0;
    for point in points {
        let work = rig.work(&point.motion, duration_s);
        work.check_against(args.rate)?;
        work.check()?;
        check_edges(work.shaft_hz, args.pulses, duration_s)?;
        steps += work.steps;
    }
    ALL_STEPS.check("simulation", steps, "shorten the runs or make fewer")
}

/// What a reader of the result must know.
fn warning(simulated: &Simulated) -> Option<String> {
    let energy = &simulated.energy;
    pull([energy.least_mesh_force_n, energy.least_at_s], simulated.statistics.contact_events)
}

/// That teeth would have to pull, from the least mesh force, N, and its time, s.
fn pull([least_n, at_s]: [f64; 2], contact_events: u64) -> Option<String> {
    (least_n < 0.0 && contact_events == 0).then(|| {
        format!(
            "the mesh force falls to {least_n:.3e} N at {at_s:.4} s: teeth cannot pull; add `--effect backlash` for \
             contact loss"
        )
    })
}

fn record(args: &Args, machine: &Machine, points: &[Point], results: &[Simulated]) -> Result<Record> {
    let all: Vec<Vec<f64>> = results.iter().flat_map(|r| r.channels.iter().cloned()).collect();
    let declared = record::Acquisition {
        sample_rate_hz: args.rate,
        channels: vec!["pinion bearing, line of action".into(), "gear bearing, line of action".into()],
        full_scale_m_s2: record::suggested_full_scale(&all),
        code_bits: 16,
        unit: None,
        other: toml::Table::new(),
    };
    let tach = Tach {
        shaft: "pinion".into(),
        turns_per_pinion_turn: None,
        pulses_per_rev: args.pulses,
        jitter_s: Some(args.jitter),
        source: None,
        other: toml::Table::new(),
    };
    let mut declaration = Declaration::of_machine(machine, declared.clone(), Some(tach))?;
    let mut runs = Vec::new();
    for (index, (point, simulated)) in points.iter().zip(results).enumerate() {
        if simulated.edges_s.len() < 2 {
            let what =
                format!("{} tach edges in run {index}: a speed needs two, lengthen the run", simulated.edges_s.len());
            return Err(Error::invalid("--duration", what));
        }
        let mut table = RunDeclaration::numbered(index, true, Some(point.torque_n_m));
        table.first_pulse_index = simulated.first_pulse_index;
        declaration.runs.push(table.clone());
        runs.push(Run::from_signals(table, &declared, &simulated.channels, simulated.edges_s.clone())?);
    }
    Ok(Record { folder: machine.folder.clone(), declaration, runs })
}

fn json(args: &Args, points: &[Point], results: &[Simulated]) -> serde_json::Value {
    let runs: Vec<_> = points
        .iter()
        .zip(results)
        .map(|(point, r)| {
            serde_json::json!({
                "pinion_speed_hz": point.speed_text,
                "input_torque_n_m": point.torque_n_m,
                "statistics": r.statistics,
                "energy": r.energy,
                "warning": warning(r),
            })
        })
        .collect();
    serde_json::json!({ "effects": args.effects, "seed": args.seed, "runs": runs })
}

/// Samples drawn of a waveform.
const MAX_DRAWN_SAMPLES: usize = 4000;

fn report(args: &Args, machine: &Machine, points: &[Point], results: &[Simulated]) -> Result<Report> {
    let effects = if args.effects.is_empty() { "none".into() } else { args.effects.join(", ") };
    let rows: Vec<Vec<String>> = points
        .iter()
        .zip(results)
        .map(|(point, r)| {
            let rms = |x: &[f64]| (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt();
            vec![
                point.speed_text.clone(),
                point.torque_n_m.to_string(),
                format!("{:.4}", rms(&r.channels[0])),
                format!("{:.4}", rms(&r.channels[1])),
                r.statistics.steps.to_string(),
                r.statistics.contact_events.to_string(),
                format!("{:.1e}", r.energy.worst_residual),
                format!("{:.1}", r.energy.least_mesh_force_n),
            ]
        })
        .collect();
    let head = [
        "speed, Hz",
        "torque, N m",
        "RMS pinion, m/s2",
        "RMS gear, m/s2",
        "steps",
        "contact events",
        "energy residual",
        "least mesh force, N",
    ];
    let mut report = Report::new("Simulation", &machine.title)
        .figure("Runs", results.len())
        .figure("Sampling rate", format!("{} Hz", args.rate))
        .figure("Effects", effects)
        .table("Runs: level, cost, energy balance per mesh period, least mesh force.", &head, &rows);
    for text in results.iter().filter_map(warning).take(1) {
        report = report.note(&text);
    }
    for (index, (point, r)) in points.iter().zip(results).enumerate() {
        let named = ["pinion", "gear"];
        let wave = |c: usize| {
            let part = r.channels[c].iter().take(MAX_DRAWN_SAMPLES).enumerate();
            Series::new(named[c], part.map(|(i, x)| (i as f64 / args.rate, *x)).collect())
        };
        let bins = |c: usize| {
            let s = amplitude_spectrum(&r.channels[c], args.rate, Window::Hann);
            Series::new(named[c], (1..s.values.len()).map(|i| (s.frequency(i), s.values[i])).collect())
        };
        let title = format!("Run {index}: {} Hz, {} N m", point.speed_text, point.torque_n_m);
        let waves = lines(&[wave(0), wave(1)], Axes { x: "time, s", y: "acceleration, m/s2" })?;
        let axes = Axes { x: "frequency, Hz", y: "acceleration, dB re 1 m/s2" };
        report = report
            .section(&title)
            .picture(&waves, "Start of the run.")
            .picture(&spectrum(&[bins(0), bins(1)], &[], 1.0, 100.0, axes)?, "Amplitude spectrum of the whole run.");
    }
    Ok(report)
}
