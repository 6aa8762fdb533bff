//! `meshband capture`: a waveform that a node holds, as a record.

use clap::Args as ClapArgs;
use meshband_host::link::Client;
use meshband_host::link::capture::{await_held, fetch};
use meshband_host::output::Content;
use meshband_host::results::Force;
use meshband_host::{Result, say};
use std::path::PathBuf;
use std::time::Duration;

/// Arguments of `meshband capture`.
#[derive(ClapArgs)]
pub struct Args {
    /// Serial port, pseudo-terminal or tcp:HOST:PORT.
    port: String,
    /// Folder of the record to write, for `meshband analyse`.
    #[arg(short, long)]
    output: PathBuf,
    /// Asks for a waveform now where none is held.
    #[arg(long)]
    trigger: bool,
    /// Leaves it in the node, which then cannot take another one.
    #[arg(long)]
    keep: bool,
    /// How long a waveform under way is waited for, s.
    #[arg(long, default_value_t = 30)]
    wait: u64,
    #[command(flatten)]
    permission: Force,
}

/// Fetches, checks, writes, and only then lets the node use its memory again.
pub fn run(args: Args) -> Result<()> {
    let folder = args.permission.outputs([]).folder(&args.output, Content::Record)?;
    let mut client = Client::open(&args.port)?;
    let board = client.identify()?.board;
    let head = await_held(&mut client, args.trigger, Duration::from_secs(args.wait))?;
    let waveform = fetch(&mut client, &head)?;
    waveform.record(&board)?.write_to(folder)?;
    if !args.keep {
        client.release_capture(head.facts.number)?;
    }
    say!("{}", waveform.summary())?;
    let after = client.capture(false)?;
    if after.missed > 0 {
        say!("{} triggers found another waveform begun or held, since the node's start", after.missed)?;
    }
    say!("written to {}{}", args.output.display(), if args.keep { "; still held" } else { "; released" })
}
