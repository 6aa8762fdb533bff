//! `meshband-gateway`: vibration nodes to an MQTT broker and to Parquet files.

mod clock;
mod config;
mod error;
mod gateway;
mod health;
mod history;
mod intake;
mod journal;
mod sparkplug;
mod stop;
mod synthesise;
mod values;
mod virtual_nodes;

use clap::{Args, Parser, Subcommand};
use error::{Error, Result};
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(Parser)]
#[command(
    version,
    about = "Vibration nodes to an MQTT broker (Sparkplug B) and to Parquet files",
    args_conflicts_with_subcommands = true
)]
struct Cli {
    /// Configuration (TOML): nodes, broker, history
    config: Option<PathBuf>,
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Subcommand)]
enum Command {
    /// Virtual nodes on local TCP ports: the node's own code on made-up gears, in real time
    Nodes(NodesArgs),
    /// Made-up values of many nodes for days, straight into a history: sizes and times
    Synthesise(synthesise::SynthesiseArgs),
    /// A captured link (`meshband monitor --record`) into a folder of Parquet files with the history's columns
    Export(history::export::ExportArgs),
    /// Merges the small files of a history
    Compact {
        /// Root folder of the history
        folder: PathBuf,
    },
}

#[derive(Args)]
struct NodesArgs {
    /// How many
    #[arg(long, default_value_t = 3)]
    count: u16,
    /// Port of the first one; the others follow
    #[arg(long, default_value_t = 7700)]
    port: u16,
    /// Frames that are sent again after a break, as a line server with a buffer does
    #[arg(long, default_value_t = 0)]
    repeat: usize,
    /// Ends after so many seconds, having sent what it has; without it, never
    #[arg(long)]
    seconds: Option<u64>,
    /// Writes what every node sent, one line per frame: node, sequence, fingerprint, whether it went out
    #[arg(long)]
    ledger: Option<PathBuf>,
    /// Chip number of the first node; the others follow
    #[arg(long, default_value_t = 1)]
    unit: u32,
}

fn main() -> ExitCode {
    sparkplug::session::prepare_tls();
    match run(Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(reason) => {
            eprintln!("meshband-gateway: {reason}");
            ExitCode::from(2)
        }
    }
}

fn run(cli: Cli) -> Result {
    let stop = stop::Stop::on_signals().map_err(|reason| Error::new("signals", reason))?;
    match (cli.config, cli.command) {
        (Some(path), None) => gateway::run(&config::Config::read(&path)?, &stop),
        (_, Some(Command::Nodes(nodes))) => virtual_nodes::run(&nodes, &stop),
        (_, Some(Command::Synthesise(days))) => synthesise::run(&days, &stop),
        (_, Some(Command::Export(capture))) => history::export::run(&capture),
        (_, Some(Command::Compact { folder })) => {
            let (store, format) = (history::store::Store::open(&folder)?, history::files::Format::history()?);
            for partition in history::files::partitions(store.root())? {
                let (from, into) = history::compact::compact(&store, &partition, 2, &format)?;
                if from > 0 {
                    println!("{}: {from} files into {into}", partition.display());
                }
            }
            Ok(())
        }
        (None, None) => Err(Error::new("no configuration", "meshband-gateway CONFIG.toml, or --help")),
    }
}
