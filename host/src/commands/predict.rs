//! `meshband predict`: what the declared machine gives for each run of a record.

use clap::Args as ClapArgs;
use meshband_host::dynamics::assembly::{Damping, Model};
use meshband_host::dynamics::predict::Predictor;
use meshband_host::dynamics::rig::Rig;
use meshband_host::dynamics::taylor::Statistics;
use meshband_host::machine::Machine;
use meshband_host::record::{Record, Run, npy};
use meshband_host::report::plot::{Axes, Series, spectrum};
use meshband_host::report::{Report, write_json};
use meshband_host::spectral::{Window, amplitude_spectrum};
use meshband_host::{Error, Result, effects, terminal};
use rayon::prelude::*;
use serde::Serialize;
use std::path::PathBuf;

/// Arguments of `meshband predict`.
#[derive(ClapArgs)]
pub struct Args {
    /// Record folder.
    record: PathBuf,
    /// Folder for the predictions, `runNN.npy` (float32, m/s2, same shape as the record's).
    #[arg(short)]
    output: PathBuf,
    /// Model: bending-torsional, bending-torsional-6 or casing.
    #[arg(long, default_value = "bending-torsional")]
    model: Model,
    /// Machine to predict with in place of the record's own, such as the one `meshband loop --apply` writes.
    #[arg(long)]
    machine: Option<PathBuf>,
    /// File of `[[effect]]` tables added to the machine, as `meshband loop --apply` writes it.
    #[arg(long = "effects", value_name = "FILE")]
    effects_file: Option<PathBuf>,
    /// What each prediction leaves of its run, and its cost, as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Write a report with measured, predicted and remaining spectra.
    #[arg(long)]
    report: Option<PathBuf>,
}

/// Frequencies compared: the acquisition is flat up to here.
const BAND_HZ: f64 = 15_000.0;

/// A run beside its prediction.
#[derive(Serialize)]
struct Outcome {
    run: String,
    input_torque_n_m: Option<f64>,
    /// RMS of what remains below 15 kHz over the measured AC RMS there, per channel.
    remaining: [f64; 2],
    /// Predicted over measured AC RMS below 15 kHz, dB, per channel: what can be compared of effects whose phase is free in every run.
    level_db: [f64; 2],
    statistics: Statistics,
    #[serde(skip)]
    spectra: Vec<[Series; 3]>,
}

/// Writes one prediction per run.
pub fn run(args: Args) -> Result<()> {
    let record = Record::read(&args.record)?;
    let mut predictor = Predictor::new(&record, args.model, Damping::Declared)?;
    if let Some(path) = &args.machine {
        predictor.rig = Rig::new(&Machine::read(path)?, args.model, Damping::Declared)?;
    }
    let effects = args.effects_file.as_deref().map_or_else(|| Ok(Vec::new()), effects::read)?;
    predictor.torque_factor = args.effects_file.as_deref().map_or(Ok(1.0), effects::read_torque_factor)?;
    let turns = args.effects_file.as_deref().map_or_else(|| Ok(Vec::new()), effects::read_pinion_turns)?;
    predictor.start_later(&record, &turns)?;
    std::fs::create_dir_all(&args.output).map_err(Error::file(&args.output))?;
    let progress = terminal::Progress::new("predict", record.runs.len() as u64);
    let drawn = args.report.is_some();
    let outcomes: Vec<Outcome> = record
        .runs
        .par_iter()
        .map(|run| {
            let (channels, statistics) = predictor.predict(run, &effects)?;
            let values: Vec<f32> = (0..run.samples()).flat_map(|i| channels.iter().map(move |c| c[i] as f32)).collect();
            npy::write_f32(&args.output.join(&run.declaration.signal), &values, channels.len())?;
            progress.step();
            Ok(compare(run, &channels, statistics, drawn))
        })
        .collect::<Result<_>>()?;
    drop(progress);
    let rows: Vec<Vec<String>> = outcomes
        .iter()
        .map(|o| {
            let torque = o.input_torque_n_m.map_or(String::new(), |t| t.to_string());
            let [first, second] = o.remaining.map(|r| format!("{:.3}", 100.0 * r));
            let [level, other] = o.level_db.map(|l| format!("{l:+.3}"));
            vec![o.run.clone(), torque, first, second, level, other]
        })
        .collect();
    let head = ["run", "torque, N m", "pinion channel, %", "gear channel, %", "pinion level, dB", "gear level, dB"];
    println!("remaining below 15 kHz, of the measured AC RMS; predicted level less measured");
    print!("{}", terminal::table(&head, &rows));
    if let Some(path) = &args.json {
        write_json(path, &outcomes)?;
    }
    if let Some(path) = &args.report {
        let worst = outcomes.iter().flat_map(|o| o.remaining).fold(0.0, f64::max);
        let mut report = Report::new("Prediction", &args.record.display().to_string())
            .figure("Runs", outcomes.len())
            .figure("Largest remainder", format!("{:.3} %", 100.0 * worst))
            .text("What the declared machine explains of each run, from declaration, torque and tach alone.")
            .table("Remaining below 15 kHz, of the measured AC RMS; predicted level less measured.", &head, &rows);
        for outcome in &outcomes {
            for (channel, spectra) in outcome.spectra.iter().enumerate() {
                let axes = Axes { x: "frequency, Hz", y: "acceleration, dB re 1 m/s2" };
                let title = format!("{}, {} channel", outcome.run, ["pinion", "gear"][channel.min(1)]);
                let svg = spectrum(spectra, &[], 1.0, 110.0, axes)?;
                report =
                    report.section(&title).picture(&svg, "Amplitude spectra: measured, predicted, and what remains.");
            }
        }
        report.write(path)?;
    }
    Ok(())
}

fn compare(run: &Run, predicted: &[Vec<f64>; 2], statistics: Statistics, drawn: bool) -> Outcome {
    let (mut remaining, mut level_db) = ([0.0; 2], [0.0; 2]);
    let mut spectra = Vec::new();
    for (channel, predicted) in predicted.iter().enumerate().take(run.channels()) {
        let measured = run.signal_m_s2(channel);
        let rest: Vec<f64> = measured.iter().zip(predicted).map(|(a, b)| a - b).collect();
        let of = |signal: &[f64]| amplitude_spectrum(signal, run.sample_rate_hz(), Window::Hann);
        let [m, p, r] = [of(&measured), of(predicted), of(&rest)];
        let last = ((BAND_HZ / m.bin) as usize).min(m.values.len() - 1);
        // The window spreads the mean over the first bins.
        let rms = |values: &[f64]| values[3.min(last)..=last].iter().map(|a| a * a).sum::<f64>().sqrt();
        remaining[channel] = rms(&r.values) / rms(&m.values).max(f64::MIN_POSITIVE);
        level_db[channel] = 20.0 * (rms(&p.values) / rms(&m.values)).log10();
        if drawn {
            spectra.push(
                [("measured", m), ("predicted", p), ("remaining", r)]
                    .map(|(name, s)| Series::new(name, (1..=last).map(|i| (s.frequency(i), s.values[i])).collect())),
            );
        }
    }
    let run_name = run.declaration.signal.clone();
    Outcome {
        run: run_name,
        input_torque_n_m: run.declaration.input_torque_n_m,
        remaining,
        level_db,
        statistics,
        spectra,
    }
}
