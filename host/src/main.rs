//! The `meshband` command: one subcommand per file in `commands/`.

use clap::{Parser, Subcommand};
use std::process::ExitCode;

mod commands;

/// Gear-vibration workbench: simulate, predict, import, run the virtual node, close the loop.
#[derive(Parser)]
#[command(name = "meshband", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Which spectral lines are folded mesh harmonics at a given sampling rate.
    Alias(commands::alias::Args),
    /// The real firmware in QEMU on a run of a record.
    Node(commands::node::Args),
}

fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Alias(args) => commands::alias::run(args),
        Command::Node(args) => commands::node::run(args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("meshband: {error}");
            ExitCode::from(2)
        }
    }
}
