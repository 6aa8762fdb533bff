//! `meshband configure`: tells a node its machine and law, and has it stored.

use super::installation::InstallationArgs;
use clap::Args as ClapArgs;
use meshband::alarm::Watched;
use meshband::board::Timing;
use meshband::config::{Configuration, LinkConfig, Personality};
use meshband::units::TicksPerSecond;
use meshband_host::link::machine_class::MachineClass;
use meshband_host::link::setup::{Installation, Sources};
use meshband_host::link::{Client, report, text};
use meshband_host::results::Results;
use meshband_host::{Error, Result, remark, say};
use std::path::PathBuf;
use std::time::Duration;

/// How long the node's next start is waited for.
const START_PATIENCE: Duration = Duration::from_secs(60);

/// Arguments of `meshband configure`.
#[derive(ClapArgs)]
pub struct Args {
    /// Serial port, pseudo-terminal or tcp:HOST:PORT.
    port: String,
    /// Machine file; gives the tooth counts and guards against a law of another machine.
    #[arg(long)]
    machine: Option<PathBuf>,
    /// Gear train instead of a machine file, as `import --train` takes it: the node follows up to six of its gears in
    /// turns; its first `[tach]` goes with it.
    #[arg(long, conflicts_with_all = ["machine", "teeth"])]
    train: Option<PathBuf>,
    /// Law file, as `meshband law fit` writes it.
    #[arg(long)]
    law: Option<PathBuf>,
    /// Settings file in TOML: tach, sensor, limits, policy, mesh, alarms, front_end, holding, pass, levels, link,
    /// capture (book/src/reference/node.md). Options below go before it.
    #[arg(long)]
    settings: Option<PathBuf>,
    /// Teeth of pinion and gear, instead of a machine file.
    #[arg(long, num_args = 2, value_names = ["PINION", "GEAR"])]
    teeth: Option<Vec<u16>>,
    #[command(flatten)]
    installation: InstallationArgs,
    /// Class of the machine: alert and danger on the velocity's RMS at the zone boundaries of ISO 20816-3, instead of
    /// the node's upper limits on it: small (below 15 kW), medium-rigid, medium-flexible (to 300 kW), large-rigid,
    /// large-flexible.
    #[arg(long, value_name = "CLASS", value_parser = MachineClass::from_name)]
    machine_class: Option<MachineClass>,
    /// Only until the next power-up: does not store it.
    #[arg(long)]
    volatile: bool,
    /// Starts measuring afterwards.
    #[arg(long)]
    start: bool,
    /// Calls the node until it starts (60 s at most): the way back to one that speaks Modbus. Switch it off and on
    /// meanwhile.
    #[arg(long)]
    at_start: bool,
    /// Only acknowledges the alarms that stand: latched ones end. The configuration stays.
    #[arg(long, conflicts_with_all = ["machine", "train", "law", "settings", "teeth", "pulses", "missing", "ratio",
        "sensitivity", "volt_per_g",
        "machine_class", "analogue_stop", "highest_adc", "harmonics", "sidebands", "volatile", "start", "json",
        "report"])]
    acknowledge: bool,
    #[command(flatten)]
    results: Results,
}

/// Reads the node's configuration, changes what the arguments say, sends, stores and reads back.
pub fn run(args: Args) -> Result<()> {
    if args.acknowledge {
        open(&args)?.acknowledge_alarms()?;
        return say!("alarms acknowledged");
    }
    // Files first: their errors need no node.
    let read = [&args.machine, &args.train, &args.law, &args.settings].into_iter().flatten().map(PathBuf::as_path);
    let mut files = args.results.announce(&mut args.results.outputs(read))?;
    let mut sources = Sources::read(args.machine.as_deref(), args.law.as_deref(), args.settings.as_deref())?;
    if let Some(train) = &args.train {
        sources = sources.with_train(train)?;
    }
    let mut client = open(&args)?;
    let identity = client.identify()?;
    let mut config = client.configuration()?;
    // The node's own: another configuration begins without alarms.
    config.latched = 0;
    let facts = args.installation.facts(args.teeth.as_deref().and_then(|teeth| teeth.try_into().ok()));
    let installation = Installation { machine_class: args.machine_class, ..facts };
    sources.apply(&mut config, &installation)?;
    config
        .validate(Timing::of(&identity.board, TicksPerSecond(identity.ticks_per_second)))
        .map_err(|error| Error::invalid("configuration", format!("{error} on this node")))?;
    doubts(&config).iter().for_each(|doubt| remark!("warning: {doubt}"));
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
    files.write(&held, || Ok(report::of_configuration(&held, &identity, !args.volatile, &args.port)))?;
    say!(
        "{}, {} Hz time base, {}",
        text::identity(&identity),
        identity.ticks_per_second,
        report::self_test(identity.self_test)
    )?;
    say!(
        "{} x {} teeth, {} pulses per turn, law {:.0} Hz at {} Hz to {:.0} Hz at {} Hz{}, {} alarms; {}",
        held.gears.pinion_teeth,
        held.gears.gear_teeth,
        held.tach.pulses_per_turn,
        held.law.bandwidth(held.law.lowest).bandwidth.0,
        held.law.lowest.0,
        held.law.bandwidth(held.law.highest).bandwidth.0,
        held.law.highest.0,
        if held.law.provisional { " (provisional)" } else { "" },
        held.alarms.len(),
        if args.volatile { "not stored" } else { "stored" },
    )?;
    if let Some(followed) = sources.followed() {
        say!("follows in turns: {}", followed.names.join(", "))?;
        followed.left_out.iter().for_each(|name| remark!("not followed: {name}"));
    }
    match held.link.personality {
        Personality::Meshband => Ok(()),
        Personality::Modbus => say!("{}", from_next_start(&held.link, args.volatile, &args.port)),
    }
}

/// What a configuration says that is allowed and hardly meant.
fn doubts(config: &Configuration) -> Vec<String> {
    let mut doubts = Vec::new();
    let expects_nothing = config.levels.is_empty() && config.local_levels.is_empty();
    if expects_nothing && config.alarms.iter().any(|alarm| alarm.watched == Watched::Departure) {
        doubts.push(
            "an alarm on Departure can never be raised without expected levels: `meshband levels learn` or \
            `meshband commission` makes them"
                .into(),
        );
    }
    let [pinion, gear] = [config.gears.pinion_teeth, config.gears.gear_teeth];
    if pinion > gear {
        let ratio = f64::from(pinion) / f64::from(gear);
        doubts.push(format!(
            "{pinion} teeth drive {gear}: the pair speeds up by {ratio:.2}; the first count is the \
            pinion's, whose turns the tach gives"
        ));
    }
    doubts
}

fn open(args: &Args) -> Result<Client> {
    let mut client = Client::open(&args.port)?;
    if args.at_start {
        say!("calling the node: switch it off and on")?;
        client.call(START_PATIENCE)?;
    }
    Ok(client)
}

/// What a node that was told to speak Modbus does, and how it is reached again.
fn from_next_start(link: &LinkConfig, volatile: bool, port: &str) -> String {
    if volatile {
        return "Modbus is not stored: the line stays as it is".into();
    }
    let LinkConfig { address, parity, .. } = link;
    format!(
        "from its next start on it speaks Modbus: address {address}, {} bit/s, parity {parity:?}; back: `meshband \
         configure {port} --at-start`",
        link.rate()
    )
}
