//! `meshband update`: another image for a node, over its link.

use clap::Args as ClapArgs;
use meshband_host::link::update::{self, Progress, UpdateFile};
use meshband_host::link::{Client, text};
use meshband_host::{Result, say};
use std::path::PathBuf;
use std::time::Duration;

/// How long the node's next start is waited for.
const START_PATIENCE: Duration = Duration::from_secs(60);
/// Steps in which the transfer is told.
const PARTS: u32 = 10;

/// Arguments of `meshband update`.
#[derive(ClapArgs)]
pub struct Args {
    /// Update file, as `cargo xtask node-build` writes it (stm32f405.update): the image for both slots.
    file: PathBuf,
    /// Serial port, pseudo-terminal or tcp:HOST:PORT.
    #[arg(long)]
    port: String,
    /// Calls the node until it starts (60 s at most): for one that speaks Modbus. Switch it off and on meanwhile.
    #[arg(long)]
    at_start: bool,
}

/// Sends, activates, waits for the new image and confirms it.
pub fn run(args: Args) -> Result<()> {
    // The file first: its errors need no node.
    let file = UpdateFile::read(&args.file)?;
    let mut client = Client::open(&args.port)?;
    if args.at_start {
        say!("calling the node: switch it off and on")?;
        client.call(START_PATIENCE)?;
    }
    let before = client.identify()?;
    say!("{}", text::identity(&before))?;
    let mut told = None;
    let node = update::run(&mut client, &file, |progress| {
        let line = match progress {
            Progress::Erasing => {
                "erasing the free slot: the node is deaf and does not measure for 2 s to 4 s".to_owned()
            }
            Progress::Sent(bytes, all) => format!("{} % of {all} bytes", bytes / (all / PARTS).max(1) * 100 / PARTS),
            Progress::Restarting => "complete and sound; the node restarts".to_owned(),
            Progress::Waiting(missing) => format!("the new image runs; still to come: {}", update::lacking(missing)),
        };
        if told.as_ref() != Some(&line) {
            say!("{line}")?;
            told = Some(line);
        }
        Ok(())
    })?;
    say!(
        "updated from {} to {}, slot {:?}, confirmed",
        update::running(&before),
        update::running(&node),
        node.image.slot
    )
}
