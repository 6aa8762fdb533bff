//! `meshband predict`: what the declared machine gives for each run of a record.

use clap::Args as ClapArgs;
use indicatif::ProgressBar;
use meshband_host::dynamics::assembly::{Damping, Model};
use meshband_host::dynamics::predict::Predictor;
use meshband_host::record::{Record, npy};
use meshband_host::{Error, Result};
use rayon::prelude::*;
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
    /// Statistics of every run as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
}

/// Writes one prediction per run.
pub fn run(args: Args) -> Result<()> {
    let record = Record::read(&args.record)?;
    let predictor = Predictor::new(&record, args.model, Damping::Declared)?;
    std::fs::create_dir_all(&args.output).map_err(Error::file(&args.output))?;
    let bar = ProgressBar::new(record.runs.len() as u64);
    let results: Vec<serde_json::Value> = record
        .runs
        .par_iter()
        .map(|run| {
            let (channels, statistics) = predictor.predict(run, &[])?;
            let values: Vec<f32> = (0..run.samples()).flat_map(|i| channels.iter().map(move |c| c[i] as f32)).collect();
            npy::write_f32(&args.output.join(&run.declaration.signal), &values, channels.len())?;
            bar.inc(1);
            Ok(serde_json::json!({ "run": run.declaration.signal, "statistics": statistics }))
        })
        .collect::<Result<_>>()?;
    bar.finish_and_clear();
    if let Some(path) = &args.json {
        let text = serde_json::to_string_pretty(&results).expect("plain values");
        std::fs::write(path, text).map_err(Error::file(path))?;
    }
    Ok(())
}
