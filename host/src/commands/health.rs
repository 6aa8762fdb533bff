//! `meshband health`: the node as a device, and the time of day told to it.

use clap::Args as ClapArgs;
use meshband_host::link::{Client, health, report, text};
use meshband_host::output::show;
use meshband_host::results::Results;
use meshband_host::terminal::table;
use meshband_host::{Error, Result, say};

/// Arguments of `meshband health`.
#[derive(ClapArgs)]
pub struct Args {
    /// Serial port, pseudo-terminal or tcp:HOST:PORT.
    port: String,
    /// Tells the node this host's time of day first.
    #[arg(long)]
    set_clock: bool,
    #[command(flatten)]
    results: Results,
}

/// Asks, and shows.
pub fn run(args: Args) -> Result<()> {
    let mut outputs = args.results.outputs([]);
    let mut files = args.results.announce(&mut outputs)?;
    let mut client = Client::open(&args.port)?;
    let node = client.identify()?;
    if !health::is_known_to(&node) {
        let what =
            format!("speaks schema {} of the link; it tells this from {} on", node.wire_schema, health::FIRST_SCHEMA);
        return Err(Error::tool("node", what));
    }
    let said = if args.set_clock { health::tell_time(&mut client)? } else { client.health()? };
    files.write(&serde_json::json!({ "identity": node, "health": said }), || {
        Ok(report::of_health(&said, &node, &args.port))
    })?;
    say!("{}", text::identity(&node))?;
    show(&table(&["quantity", "value"], &health::rows(&said)))
}
