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
    /// Finds what the declared machine of a record lacks; error before and after.
    Loop(commands::close::Args),
}

fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Alias(args) => commands::alias::run(args),
        Command::Loop(args) => commands::close::run(args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("meshband: {error}");
            ExitCode::from(2)
        }
    }
}
