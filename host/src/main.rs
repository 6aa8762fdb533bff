//! The `meshband` command: one subcommand per file in `commands/`.

use clap::{Parser, Subcommand};
use meshband_host::{Result, program, report};
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
    /// Order spectrum and map, sidebands, averages, envelope, and the orders that the mesh does not explain.
    Analyse(commands::analyse::Args),
    /// The waveform that a node holds for an alarm, as a record.
    Capture(commands::capture::Args),
    /// What is wrong with a record, before anything is inferred from it.
    Check(commands::check::Args),
    /// The library of effects: names, keys, signatures, pictures.
    Effects(commands::effects::Args),
    /// A run of a record as a file of another format (wav, csv, mat, uff58, npy, mf4, parquet).
    Export(commands::export::Args),
    /// A node as a device: supply, temperature, bias, clock, time of day.
    Health(commands::health::Args),
    /// Measurement files (mat, HDF5, TDMS, csv, wav, FLAC, npy, uff58) into a record folder, with their tach or a
    /// virtual one.
    Import(Box<commands::import::Args>),
    /// Bandwidth law of a machine: the paper's studies, fit, check, constants for the node.
    Law(commands::law::Args),
    /// Expected levels of a sound machine for a node; departure against absolute alarms.
    Levels(commands::levels::Args),
    /// A machine file from a few figures, what a machine file says, every key of it.
    Machine(commands::machine::Args),
    /// Tells a node its machine and law, and has it stored.
    Configure(commands::configure::Args),
    /// A node from wired to watching: identify, wiring, run-up, law, baseline, alarms, stored, report.
    Commission(commands::commission::Args),
    /// Another image for a node, over its link, with the way back.
    Update(commands::update::Args),
    /// A node's registers for whoever programs a PLC: the map as csv, one request per group, an example in bytes.
    Modbus(commands::modbus::Args),
    /// Live view of a node in the terminal, or of a captured link.
    Monitor(commands::monitor::Args),
    /// Mesh stiffness over the cycle: tooth components, pair, total, ISO 6336 beside it.
    Stiffness(commands::stiffness::Args),
    /// The real firmware in QEMU on a run of a record.
    Node(commands::node::Args),
    /// What the declared machine gives for each run of a record.
    Predict(commands::predict::Args),
    /// A record folder of a simulated machine.
    Simulate(commands::simulate::Args),
    /// Finds what the declared machine of a record lacks; error declared, calibrated and corrected (alias: loop).
    #[command(alias = "loop")]
    Diagnose(commands::close::Args),
}

fn main() -> ExitCode {
    report::facts::set_command(std::env::args_os().map(|word| word.to_string_lossy().into_owned()));
    program::execute(|cli: Cli| run(cli.command))
}

fn run(command: Command) -> Result<()> {
    match command {
        Command::Alias(args) => commands::alias::run(args),
        Command::Analyse(args) => commands::analyse::run(args),
        Command::Capture(args) => commands::capture::run(args),
        Command::Check(args) => commands::check::run(args),
        Command::Effects(args) => commands::effects::run(args),
        Command::Export(args) => commands::export::run(args),
        Command::Health(args) => commands::health::run(args),
        Command::Import(args) => commands::import::run(*args),
        Command::Law(args) => commands::law::run(args),
        Command::Levels(args) => commands::levels::run(args),
        Command::Machine(args) => commands::machine::run(args),
        Command::Configure(args) => commands::configure::run(args),
        Command::Commission(args) => commands::commission::run(args),
        Command::Update(args) => commands::update::run(args),
        Command::Modbus(args) => commands::modbus::run(args),
        Command::Monitor(args) => commands::monitor::run(args),
        Command::Stiffness(args) => commands::stiffness::run(args),
        Command::Node(args) => commands::node::run(args),
        Command::Predict(args) => commands::predict::run(args),
        Command::Simulate(args) => commands::simulate::run(args),
        Command::Diagnose(args) => commands::close::run(args),
    }
}
