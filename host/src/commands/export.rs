//! `meshband export`: a run of a record as a file of another format.

use clap::Args as ClapArgs;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use meshband_host::output::Outputs;
use meshband_host::record::export::{Format, content};
use meshband_host::record::{Record, edges_text};
use meshband_host::{Error, Result, say};
use std::path::PathBuf;

/// Arguments of `meshband export`.
#[derive(ClapArgs)]
pub struct Args {
    /// Record folder.
    record: PathBuf,
    /// Format of the file; wav states no unit, npy neither unit nor rate.
    #[arg(long, value_parser = formats())]
    to: Format,
    /// The file.
    #[arg(short, long)]
    output: PathBuf,
    /// Run, from 0; needed where the record has several.
    #[arg(long)]
    run: Option<usize>,
    /// Edge times of the run's tachometer as a file of their own (seconds from the first sample).
    #[arg(long, value_name = "FILE")]
    edges: Option<PathBuf>,
    /// Overwrite files that exist.
    #[arg(long)]
    force: bool,
}

fn formats() -> impl TypedValueParser<Value = Format> {
    let names = PossibleValuesParser::new(Format::ALL.map(|(name, _)| name));
    names.try_map(|name| Format::named(&name).ok_or("is no format"))
}

/// Writes the file.
pub fn run(args: Args) -> Result<()> {
    let mut outputs = Outputs::new(args.force);
    outputs.reads(&args.record);
    let mut file = outputs.file(&args.output)?;
    let mut edges = outputs.optional(args.edges.as_deref())?;
    let record = Record::read(&args.record)?;
    let index = match (args.run, record.runs.len()) {
        (Some(index), _) => index,
        (None, 1) => 0,
        (None, count) => {
            return Err(Error::invalid(
                "--run",
                format!("{} has {count} runs; say which, from 0", args.record.display()),
            ));
        }
    };
    let run = record.run(index)?;
    file.write(content(args.to, run, &record.declaration.acquisition)?)?;
    if let Some(edges) = &mut edges {
        if run.edges_s.is_empty() {
            return Err(Error::invalid("--edges", format!("run {index} has no tachometer")));
        }
        edges.write(edges_text(&run.edges_s))?;
    }
    let unit = record.declaration.acquisition.unit.as_deref().unwrap_or("m/s2");
    say!("{} samples of {} channel(s) at {} Hz in {unit}", run.samples(), run.channels(), run.sample_rate_hz())?;
    let beside = &run.declaration.beside;
    if !beside.is_empty() {
        say!(
            "note: what is kept beside the channels is not exported: {}",
            beside.iter().map(|b| b.name.as_str()).collect::<Vec<_>>().join(", ")
        )?;
    }
    Ok(())
}
