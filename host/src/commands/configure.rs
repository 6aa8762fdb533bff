//! `meshband configure`: tells a node its machine and law, and has it stored.

use clap::Args as ClapArgs;
use meshband_host::link::Client;
use meshband_host::link::setup::{self, Installation};
use meshband_host::{Error, Result};
use std::path::PathBuf;

/// Arguments of `meshband configure`.
#[derive(ClapArgs)]
pub struct Args {
    /// Serial port, pseudo-terminal or tcp:HOST:PORT.
    port: String,
    /// Machine file; gives the tooth counts and guards against a law of another machine.
    #[arg(long)]
    machine: Option<PathBuf>,
    /// Law file, as `meshband law fit` writes it.
    #[arg(long)]
    law: Option<PathBuf>,
    /// Teeth of pinion and gear, instead of a machine file.
    #[arg(long, num_args = 2, value_names = ["PINION", "GEAR"])]
    teeth: Option<Vec<u16>>,
    /// Tach pulse positions per turn, missing ones included.
    #[arg(long)]
    pulses: Option<u16>,
    /// Adjacent missing teeth of the tach wheel.
    #[arg(long)]
    missing: Option<u16>,
    /// Turns of the pinion per turn of the tach shaft.
    #[arg(long)]
    ratio: Option<f32>,
    /// Acceleration per 16-bit ADC code, m/s2.
    #[arg(long, allow_negative_numbers = true)]
    sensitivity: Option<f32>,
    /// Stop edge of the analogue filter, Hz.
    #[arg(long)]
    analogue_stop: Option<f32>,
    /// Highest ADC rate, Hz.
    #[arg(long)]
    highest_adc: Option<f32>,
    /// Mesh harmonics to report.
    #[arg(long)]
    harmonics: Option<u8>,
    /// Sideband pairs to report per harmonic.
    #[arg(long)]
    sidebands: Option<u8>,
    /// Only until the next power-up: does not store it.
    #[arg(long)]
    volatile: bool,
    /// Starts measuring afterwards.
    #[arg(long)]
    start: bool,
    /// Configuration in force as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
}

/// Reads the node's configuration, changes what the arguments say, sends, stores and reads back.
pub fn run(args: Args) -> Result<()> {
    let mut client = Client::open(&args.port)?;
    let identity = client.identify()?;
    let [major, minor, patch] = identity.version;
    println!("node {major}.{minor}.{patch}, {} Hz time base, {}", identity.ticks_per_second, self_test(&identity));
    let mut config = client.configuration()?;
    let installation = Installation {
        teeth: args.teeth.as_deref().and_then(|teeth| teeth.try_into().ok()),
        pulses_per_turn: args.pulses,
        missing: args.missing,
        pinion_per_tach: args.ratio,
        acceleration_per_code: args.sensitivity,
        analogue_stop_hz: args.analogue_stop,
        highest_adc_hz: args.highest_adc,
        harmonics: args.harmonics,
        sidebands: args.sidebands,
    };
    setup::apply(&mut config, args.machine.as_deref(), args.law.as_deref(), &installation)?;
    config
        .validate(identity.ticks_per_second)
        .map_err(|error| Error::invalid("configuration", format!("{error} on this node")))?;
    client.set_configuration(&config)?;
    let held = client.configuration()?;
    if held != config {
        return Err(Error::tool("node", "holds another configuration than it was sent"));
    }
    if !args.volatile {
        client.commit()?;
    }
    if args.start {
        client.start()?;
    }
    println!(
        "{} x {} teeth, {} pulses per turn, law {:.0} Hz at {} Hz to {:.0} Hz at {} Hz{}; {}",
        held.gears.pinion_teeth,
        held.gears.gear_teeth,
        held.tach.pulses_per_turn,
        held.law.bandwidth(held.law.lowest).bandwidth.0,
        held.law.lowest.0,
        held.law.bandwidth(held.law.highest).bandwidth.0,
        held.law.highest.0,
        if held.law.provisional { " (provisional)" } else { "" },
        if args.volatile { "not stored" } else { "stored" },
    );
    if let Some(path) = args.json {
        let text = serde_json::to_string_pretty(&held).map_err(|e| Error::invalid(path.display(), e))?;
        std::fs::write(&path, text + "\n").map_err(Error::file(&path))?;
    }
    Ok(())
}

fn self_test(identity: &meshband::message::Identity) -> String {
    let test = identity.self_test;
    match (test.run, test.failed) {
        (0, _) => "self-test not run".to_owned(),
        (run, 0) => format!("self-test passed ({} of 5 items so far)", run.count_ones()),
        (_, failed) => format!("self-test FAILED, items {failed:#07b}"),
    }
}
