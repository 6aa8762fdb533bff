//! `meshband simulate`: a record folder of a simulated machine.

use clap::Args as ClapArgs;
use meshband_host::dynamics::assembly::{Damping, Model};
use meshband_host::dynamics::simulate::{Acquisition, simulate};
use meshband_host::dynamics::{Motion, Rig};
use meshband_host::machine::Machine;
use meshband_host::record::{self, Declaration, Record, Run, RunDeclaration, Tach};
use meshband_host::{Error, Result, effects};
use std::path::PathBuf;

/// Arguments of `meshband simulate`.
#[derive(ClapArgs)]
pub struct Args {
    /// Machine file or record folder.
    machine: PathBuf,
    /// Pinion speed, Hz.
    #[arg(long)]
    speed: f64,
    /// Pinion speed reached at the end of the run, Hz; default: constant speed.
    #[arg(long)]
    final_speed: Option<f64>,
    /// Torque at the motor, N m.
    #[arg(long)]
    torque: f64,
    /// Effect, `name:key=value,...`; may be repeated.
    #[arg(long = "effect")]
    effects: Vec<String>,
    /// Sampling rate, Hz.
    #[arg(long, default_value_t = 51_200.0)]
    rate: f64,
    /// Length, s.
    #[arg(long, default_value_t = 2.0)]
    duration: f64,
    /// Tach pulses per turn of the pinion.
    #[arg(long, default_value_t = 1)]
    pulses: u32,
    /// Standard deviation of tach edges, s.
    #[arg(long, default_value_t = 0.0)]
    jitter: f64,
    /// Standard deviation of white noise, m/s2.
    #[arg(long, default_value_t = 0.0)]
    noise: f64,
    /// Seed of the random streams.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Model: bending-torsional, bending-torsional-6 or casing.
    #[arg(long, default_value = "bending-torsional")]
    model: Model,
    /// Record folder to write.
    #[arg(short)]
    output: PathBuf,
    /// Statistics as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
}

/// Simulates one run and writes it.
pub fn run(args: Args) -> Result<()> {
    let machine = Machine::read(&args.machine)?;
    let rig = Rig::new(&machine, args.model, Damping::Declared)?;
    let effects = args.effects.iter().map(|text| effects::parse(text)).collect::<Result<Vec<_>>>()?;
    let motion = match args.final_speed {
        None => Motion::Constant { speed_hz: args.speed, turns_at_zero: 0.0 },
        Some(to_hz) if to_hz.is_finite() && to_hz > 0.0 => {
            Motion::RunUp { from_hz: args.speed, to_hz, duration_s: args.duration }
        }
        Some(to_hz) => return Err(Error::invalid("--final-speed", format!("{to_hz} Hz is not a positive speed"))),
    };
    let acquisition = Acquisition {
        rate_hz: args.rate,
        duration_s: args.duration,
        pulses_per_turn: args.pulses,
        jitter_s: args.jitter,
        noise_m_s2: args.noise,
        seed: args.seed,
    };
    let simulated = simulate(&rig, &motion, args.torque, &effects, &acquisition)?;
    let declared = record::Acquisition {
        sample_rate_hz: args.rate,
        channels: vec!["pinion bearing, line of action".into(), "gear bearing, line of action".into()],
        full_scale_m_s2: record::suggested_full_scale(&simulated.channels),
        code_bits: 16,
        unit: None,
        other: toml::Table::new(),
    };
    let tach = Tach {
        shaft: "pinion".into(),
        pulses_per_rev: args.pulses,
        jitter_s: Some(args.jitter),
        source: None,
        other: toml::Table::new(),
    };
    let mut declaration = Declaration::of_machine(&machine, declared.clone(), Some(tach))?;
    let mut table = RunDeclaration::numbered(0, true, Some(args.torque));
    table.first_pulse_index = simulated.first_pulse_index;
    declaration.runs.push(table.clone());
    let run = Run::from_signals(table, &declared, &simulated.channels, simulated.edges_s)?;
    Record { folder: machine.folder.clone(), declaration, runs: vec![run] }.write(&args.output)?;
    if let Some(path) = &args.json {
        let value = serde_json::json!({ "statistics": simulated.statistics, "effects": args.effects });
        std::fs::write(path, value.to_string()).map_err(Error::file(path))?;
    }
    Ok(())
}
