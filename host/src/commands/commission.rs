//! `meshband commission`: a node from wired to watching, in one course.

use super::installation::InstallationArgs;
use clap::Args as ClapArgs;
use meshband_host::commissioning::coverage::Coverage;
use meshband_host::commissioning::ear::Operator;
use meshband_host::commissioning::outcome::Commissioning;
use meshband_host::commissioning::{Plan, commission, report, run_up, settings_text};
use meshband_host::law::domain::Domain;
use meshband_host::link::Client;
use meshband_host::link::setup::Sources;
use meshband_host::machine::Machine;
use meshband_host::output::{COMMISSIONING, Content, OutputFolder, interrupt};
use meshband_host::results::Force;
use meshband_host::{Error, Result, remark, say};
use std::io::{BufRead, IsTerminal};
use std::path::PathBuf;

/// Values over all classes below which no spread is known: ten degrees of freedom, and two points of a table.
const FEWEST_VALUES: usize = 12;

/// Arguments of `meshband commission`.
#[derive(ClapArgs)]
pub struct Args {
    /// Serial port, pseudo-terminal or tcp:HOST:PORT.
    port: String,
    /// Machine file: tooth counts, nominal speed, and whose the law is.
    #[arg(long)]
    machine: PathBuf,
    /// Folder for commissioning.json, report.html, node.toml and, where a law was learned, law.toml.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Law file of this machine (`law fit`, `law learn`); otherwise the node's own stays if it is this machine's, or
    /// one is learned.
    #[arg(long)]
    law: Option<PathBuf>,
    /// Settings file in TOML, as for `configure`. Options below go before it.
    #[arg(long)]
    settings: Option<PathBuf>,
    #[command(flatten)]
    installation: InstallationArgs,
    /// Pinion speeds that the machine goes through, as 12Hz..25Hz or 750rpm..1500rpm, or its one speed, as 1485rpm;
    /// otherwise half to 1.05 times its nominal speed.
    #[arg(long, value_name = "LOW..HIGH|SPEED", value_parser = run_up::speeds)]
    speeds: Option<Domain>,
    /// Values, of a second each at least, that fill a class of speeds; a machine of one speed is listened to five
    /// times as long.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u16).range(4..=1000))]
    values: u16,
    /// Time for one way through the speeds, minutes.
    #[arg(long, value_name = "MINUTES", default_value_t = 60.0)]
    time: f64,
    /// Standard uncertainty for what these minutes do not show (load, temperature), dB.
    #[arg(long, value_name = "DB", default_value_t = 1.0)]
    allowance: f64,
    /// False alarms per year of turning that the limits are for.
    #[arg(long, value_name = "PER_YEAR", default_value_t = 1.0)]
    false_alarms: f64,
    /// Stores the configuration without asking.
    #[arg(long)]
    yes: bool,
    /// Asks nothing, waits only: for a machine that goes through its speeds by itself.
    #[arg(long)]
    unattended: bool,
    #[command(flatten)]
    permission: Force,
}

/// Whoever sits at the terminal.
struct Terminal {
    asks: bool,
}

impl Operator for Terminal {
    fn tell(&mut self, line: &str) -> Result<()> {
        say!("{line}")
    }

    fn ask(&mut self, question: &str) -> Result<bool> {
        if !self.asks {
            return Ok(false);
        }
        say!("{question} [y/N]")?;
        let mut answer = String::new();
        std::io::stdin().lock().read_line(&mut answer).map_err(|e| Error::tool("standard input", e))?;
        Ok(matches!(answer.trim(), "y" | "Y" | "yes"))
    }

    fn wants_to_end(&self) -> bool {
        interrupt::requested()
    }
}

/// Goes through the steps and writes what they gave; a refused step ends with its sentence and exit code 2.
pub fn run(args: Args) -> Result<()> {
    let plan = plan(&args)?;
    let read = [Some(&args.machine), args.law.as_ref(), args.settings.as_ref()];
    let mut outputs = args.permission.outputs(read.into_iter().flatten().map(PathBuf::as_path));
    let folder = outputs.folder(&args.output, Content::Commissioning)?;
    let mut client = Client::open(&args.port)?;
    let mut operator = Terminal { asks: !args.unattended && std::io::stdin().is_terminal() };
    interrupt::only_ask();
    let done = match commission(&mut client, &plan, &mut operator) {
        Err(error) if interrupt::requested() => {
            remark!("{error}; nothing was written");
            return Ok(());
        }
        other => other?,
    };
    write(&done, folder)?;
    if let Some((step, finding)) = done.refusal() {
        let advice = if finding.advice.is_empty() { String::new() } else { format!(": {}", finding.advice) };
        let what = format!("{}: {}{advice}", finding.what, finding.seen);
        return Err(Error::invalid(format!("commission, {}", step.step.name()), what));
    }
    let verdict = if done.stored { "stored: the node watches" } else { "not stored" };
    say!("{verdict}; {}", args.output.join("report.html").display())
}

fn plan(args: &Args) -> Result<Plan> {
    let within = |option: &str, value: f64, [low, high]: [f64; 2]| {
        let refuse = || Error::invalid(option, format!("{value} is not within {low} to {high}"));
        (low..=high).contains(&value).then_some(()).ok_or_else(refuse)
    };
    within("--time", args.time, [0.1, 1440.0])?;
    within("--allowance", args.allowance, [0.0, 40.0])?;
    within("--false-alarms", args.false_alarms, [1e-6, 1e4])?;
    let machine = Machine::read(&args.machine)?;
    let sources = Sources::read(Some(&args.machine), args.law.as_deref(), args.settings.as_deref())?;
    let range = run_up::range(args.speeds, &machine)?;
    let classes = Coverage::new(range, usize::from(args.values));
    let planned = classes.wanted * classes.classes.len();
    if planned < FEWEST_VALUES {
        let what = format!(
            "{} for {} classes are {planned} values: nothing can be expected from fewer than {FEWEST_VALUES}",
            args.values,
            classes.classes.len()
        );
        return Err(Error::invalid("--values", what));
    }
    Ok(Plan {
        port: args.port.clone(),
        range,
        machine,
        sources,
        installation: args.installation.facts(None),
        law_given: args.law.is_some(),
        values: usize::from(args.values),
        seconds: 60.0 * args.time,
        allowance_db: args.allowance,
        false_alarms_per_year: args.false_alarms,
        yes: args.yes,
    })
}

fn write(done: &Commissioning, folder: OutputFolder) -> Result<()> {
    let [json, page, settings, law] = COMMISSIONING;
    let text = serde_json::to_string_pretty(done).map_err(|e| Error::invalid(json, e))?;
    folder.write(json, text + "\n")?;
    folder.write(page, report::of(done)?.html())?;
    if let Some(config) = &done.configuration {
        let head = "# Made by `meshband commission`; for `meshband configure PORT --settings`.\n";
        folder.write(settings, settings_text::to_toml(config, head)?)?;
    }
    if let Some(file) = &done.law {
        folder.write(law, file.to_toml())?;
    }
    folder.commit()
}
