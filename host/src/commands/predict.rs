//! `meshband predict`: what the declared machine gives for each run of a record.

mod train;

use clap::Args as ClapArgs;
use meshband_host::dynamics::assembly::{Damping, Model};
use meshband_host::dynamics::rig::{PARTS, Rig};
use meshband_host::dynamics::taylor::Statistics;
use meshband_host::machine::Machine;
use meshband_host::output::{Content, show};
use meshband_host::predict::Predictor;
use meshband_host::record::{Record, Run, npy};
use meshband_host::report::Report;
use meshband_host::report::plot::{Axes, Series, spectrum};
use meshband_host::results::Results;
use meshband_host::spectral::{Window, amplitude_spectrum};
use meshband_host::{Error, Result, effects, say, terminal};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Arguments of `meshband predict`.
#[derive(ClapArgs)]
pub struct Args {
    /// Record folder.
    record: PathBuf,
    /// Folder for the predictions, named as the signals of the record (`runNN.npy`; float32, m/s2, same shape); no
    /// record itself.
    #[arg(short)]
    output: PathBuf,
    /// Model: bending-torsional, bending-torsional-6 or casing.
    #[arg(long, default_value = "bending-torsional")]
    model: Model,
    /// Machine to predict with in place of the record's own, such as the one `meshband loop --apply` writes; of a
    /// record of a train the train machine, which it needs.
    #[arg(long)]
    machine: Option<PathBuf>,
    /// File of `[[effect]]` tables added to the machine, as `meshband loop --apply` writes it.
    #[arg(long = "effects", value_name = "FILE")]
    effects_file: Option<PathBuf>,
    #[command(flatten)]
    results: Results,
}

/// Frequencies compared: the acquisition is flat up to here.
const BAND_HZ: f64 = 15_000.0;

/// A run beside its prediction.
#[derive(Serialize)]
struct Outcome {
    run: String,
    input_torque_n_m: Option<f64>,
    /// RMS of what remains below 15 kHz over the measured AC RMS there, per channel.
    remaining: Vec<f64>,
    /// Predicted over measured AC RMS below 15 kHz, dB, per channel: what can be compared of effects whose phase is
    /// free in every run.
    level_db: Vec<f64>,
    /// Of the pair's solver.
    #[serde(skip_serializing_if = "Option::is_none")]
    statistics: Option<Statistics>,
    #[serde(skip)]
    spectra: Vec<[Series; 3]>,
}

/// Writes one prediction per run.
pub fn run(args: Args) -> Result<()> {
    let read = [Some(&args.record), args.machine.as_ref(), args.effects_file.as_ref()];
    let mut outputs = args.results.outputs(read.into_iter().flatten().map(PathBuf::as_path));
    let folder = outputs.folder(&args.output, Content::Predictions)?;
    let mut files = args.results.announce(&mut outputs)?;
    let record = Record::read(&args.record)?;
    if record.runs.is_empty() {
        return Err(Error::invalid(args.record.display(), "has no [[run]] to predict"));
    }
    let names = names(&record)?;
    if let Some(machine) = train::machine(&args, &record)? {
        return train::run(&args, &record, &machine, (&names, folder, files));
    }
    let mut predictor = Predictor::new(&record, args.model, Damping::Declared)?;
    if let Some(path) = &args.machine {
        predictor.rig = Rig::new(&Machine::read(path)?, args.model, Damping::Declared)?;
    }
    let effects = args.effects_file.as_deref().map_or_else(|| Ok(Vec::new()), effects::read)?;
    predictor.torque_factor = args.effects_file.as_deref().map_or(Ok(1.0), effects::read_torque_factor)?;
    let turns = args.effects_file.as_deref().map_or_else(|| Ok(Vec::new()), effects::read_pinion_turns)?;
    predictor.start_later(&record, &turns)?;
    predictor.rig.progress = Some(Arc::new(terminal::Progress::new("predict", PARTS * record.runs.len() as u64)));
    let drawn = files.wants_report();
    let outcomes: Vec<Outcome> = record
        .runs
        .par_iter()
        .zip(&names)
        .map(|(run, name)| {
            let (channels, statistics) = predictor.predict(run, &effects)?;
            let values: Vec<f32> = (0..run.samples()).flat_map(|i| channels.iter().map(move |c| c[i] as f32)).collect();
            folder.write(name, npy::bytes_f32(&values, channels.len()))?;
            Ok(compare(run, &channels, Some(statistics), drawn))
        })
        .collect::<Result<_>>()?;
    predictor.rig.progress = None;
    folder.commit()?;
    let rows: Vec<Vec<String>> = outcomes
        .iter()
        .map(|o| {
            let torque = o.input_torque_n_m.map_or(String::new(), |t| t.to_string());
            // A silent channel has no level to compare with.
            let or_dash = |x: f64, text: String| if x.is_finite() { text } else { "-".into() };
            let remaining = o.remaining.iter().map(|&r| or_dash(r, format!("{:.3}", 100.0 * r)));
            let levels = o.level_db.iter().map(|&l| or_dash(l, format!("{l:+.3}")));
            [o.run.clone(), torque].into_iter().chain(remaining).chain(levels).collect()
        })
        .collect();
    let head = ["run", "torque, N m", "pinion channel, %", "gear channel, %", "pinion level, dB", "gear level, dB"];
    let channels = ["pinion channel", "gear channel"].map(String::from);
    files.write(&outcomes, || report(&args, &outcomes, &channels, (&head, &rows)))?;
    say!("remaining below 15 kHz, of the measured AC RMS; predicted level less measured")?;
    show(&terminal::table(&head, &rows))
}

/// One file per run: its signal's name, without folders.
fn names(record: &Record) -> Result<Vec<String>> {
    let name =
        |run: &Run| Path::new(&run.declaration.signal).file_name().map(|name| name.to_string_lossy().into_owned());
    let names: Vec<String> = record.runs.iter().filter_map(name).collect();
    let mut seen = BTreeSet::new();
    match names.iter().find(|name| !seen.insert(name.as_str())) {
        Some(name) => Err(Error::invalid(record.folder.display(), format!("two runs have a signal named {name}"))),
        None => Ok(names),
    }
}

fn report(
    args: &Args,
    outcomes: &[Outcome],
    channels: &[String],
    (head, rows): (&[&str], &[Vec<String>]),
) -> Result<Report> {
    let worst = outcomes.iter().flat_map(|o| &o.remaining).copied().fold(0.0, f64::max);
    let mut report = Report::new("Prediction", &args.record.display().to_string())
        .figure("Runs", outcomes.len())
        .figure("Largest remainder", format!("{:.3} %", 100.0 * worst))
        .text("What the declared machine explains of each run, from declaration, torque and tach alone.")
        .table("Remaining below 15 kHz, of the measured AC RMS; predicted level less measured.", head, rows);
    for outcome in outcomes {
        for (channel, spectra) in outcome.spectra.iter().enumerate() {
            let axes = Axes { x: "frequency, Hz", y: "acceleration, dB re 1 m/s2" };
            let title = format!("{}, {}", outcome.run, channels.get(channel).map_or("channel", String::as_str));
            let svg = spectrum(spectra, &[], 1.0, 110.0, axes)?;
            report = report.section(&title).picture(&svg, "Amplitude spectra: measured, predicted, and what remains.");
        }
    }
    Ok(report)
}

fn compare(run: &Run, predicted: &[Vec<f64>], statistics: Option<Statistics>, drawn: bool) -> Outcome {
    let (mut remaining, mut level_db) = (vec![0.0; predicted.len()], vec![0.0; predicted.len()]);
    let mut spectra = Vec::new();
    for (channel, predicted) in predicted.iter().enumerate().take(run.channels()) {
        let measured = run.signal_m_s2(channel);
        let rest: Vec<f64> = measured.iter().zip(predicted).map(|(a, b)| a - b).collect();
        let of = |signal: &[f64]| amplitude_spectrum(signal, run.sample_rate_hz(), Window::Hann);
        let [m, p, r] = [of(&measured), of(predicted), of(&rest)];
        let last = ((BAND_HZ / m.bin) as usize).min(m.values.len() - 1);
        // The window spreads the mean over the first bins.
        let rms = |values: &[f64]| values[3.min(last)..=last].iter().map(|a| a * a).sum::<f64>().sqrt();
        remaining[channel] = rms(&r.values) / rms(&m.values);
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
