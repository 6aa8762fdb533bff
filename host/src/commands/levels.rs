//! `meshband levels`: expected levels from a sound machine.

use clap::{Args as ClapArgs, Subcommand};
use meshband_host::Result;
use meshband_host::levels::learn::{HEAD, learn};
use meshband_host::levels::observe::Observations;
use meshband_host::levels::sources::observe;
use meshband_host::output::show;
use meshband_host::report::Report;
use meshband_host::results::Results;
use meshband_host::terminal::table;
use std::path::PathBuf;

/// Arguments of `meshband levels`.
#[derive(ClapArgs)]
pub struct Args {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    /// A node's table of expected levels, from records or captured values of the sound machine.
    Learn(Learn),
}

#[derive(ClapArgs)]
struct Learn {
    /// Record folders (the virtual node plays all runs), or links captured by `meshband monitor --record`.
    #[arg(required = true)]
    sources: Vec<PathBuf>,
    /// Channel of records, by number or name.
    #[arg(long, default_value = "0")]
    channel: String,
    /// Standard uncertainty for what these hours did not show (load, temperature), dB.
    #[arg(long, value_name = "DB", default_value_t = 1.0)]
    allowance: f64,
    /// Writes the table here, for `meshband configure PORT --settings`.
    #[arg(short, long)]
    output: Option<PathBuf>,
    #[command(flatten)]
    results: Results,
}

/// Learns.
pub fn run(args: Args) -> Result<()> {
    match args.action {
        Action::Learn(args) => learn_levels(&args),
    }
}

fn learn_levels(args: &Learn) -> Result<()> {
    let mut outputs = args.results.outputs(args.sources.iter().map(PathBuf::as_path));
    let mut files = args.results.announce(&mut outputs)?;
    let output = outputs.optional(args.output.as_deref())?;
    let mut observed = Observations::default();
    for source in &args.sources {
        observed.extend(observe(source, &args.channel)?);
    }
    let learned = learn(&observed, args.allowance)?;
    files.write(&learned, || {
        let subtitle = format!("{} values of the acceleration's RMS", learned.values[0]);
        Ok(Report::new("Expected levels", &subtitle).table(
            "Expected levels and standard uncertainties",
            &HEAD,
            &learned.rows(),
        ))
    })?;
    if let Some(mut file) = output {
        file.write(learned.to_toml())?;
    }
    show(&table(&HEAD, &learned.rows()))
}
