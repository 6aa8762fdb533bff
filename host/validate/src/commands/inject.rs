//! `meshband inject`: known effects in measured backgrounds, found or not, against the limits that `loop` prints.

use clap::Args as ClapArgs;
use meshband_host::output::show;
use meshband_host::record::Record;
use meshband_host::results::Force;
use meshband_host::{Error, Result, say, terminal};
use meshband_validate::injection::{self, Effect, Options, Outcome};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Arguments of `meshband inject`.
#[derive(ClapArgs)]
pub struct Args {
    /// Record folders with tooth counts and a speed reference.
    #[arg(required = true)]
    records: Vec<PathBuf>,
    /// Positions of every effect and strength, spread over the records.
    #[arg(long, default_value_t = 20)]
    positions: usize,
    /// Surrogates of the backgrounds without any effect, spread over the records.
    #[arg(long, default_value_t = 200)]
    surrogates: usize,
    /// Only families whose name in the limits has one of these parts, separated by commas.
    #[arg(long, value_delimiter = ',')]
    only: Vec<String>,
    /// Minutes after which it ends with what it has.
    #[arg(long, default_value_t = 60.0)]
    minutes: f64,
    /// Seed of positions and phases.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Writes the result as JSON; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    #[command(flatten)]
    permission: Force,
}

/// Runs the injections and prints their table.
pub fn run(args: Args) -> Result<()> {
    if !(args.minutes.is_finite() && args.minutes > 0.0 && args.minutes < 1e5) {
        return Err(Error::invalid("--minutes", format!("{} is no time to work for", args.minutes)));
    }
    let inputs: Vec<&Path> = args.records.iter().map(PathBuf::as_path).collect();
    let json = args.permission.outputs(inputs).optional(args.json.as_deref())?;
    let records: Vec<Record> = args.records.iter().map(|path| Record::read(path)).collect::<Result<_>>()?;
    let options = Options {
        positions: args.positions,
        surrogates: args.surrogates,
        only: args.only,
        seed: args.seed,
        longest: Duration::from_secs_f64(60.0 * args.minutes),
    };
    let outcome = injection::run(&records, &options)?;
    if let Some(mut file) = json {
        file.write_json(&outcome)?;
    }
    print(&outcome)
}

fn print(outcome: &Outcome) -> Result<()> {
    let mut head: Vec<String> = vec!["effect, found (named) of tried".into(), "limits printed".into()];
    head.extend(injection::STRENGTHS.map(|of_limit| format!("at {of_limit} x")));
    head.extend(["half found at".into(), "something else".into()]);
    let rows: Vec<Vec<String>> = outcome.effects.iter().map(row).collect();
    let head: Vec<&str> = head.iter().map(String::as_str).collect();
    for own in &outcome.backgrounds {
        let [runs, channels] = own.runs_and_channels;
        let families = if own.families.is_empty() { "nothing".into() } else { own.families.join("; ") };
        say!("{}, teeth {:?}, runs {runs}, channels {channels}; in it: {families}", own.record, own.teeth)?;
        own.left_out.iter().try_for_each(|family| say!("  not injected, in it or on its lines: {family}"))?;
    }
    show(&terminal::table(&head, &rows))?;
    let [tried, added] = outcome.surrogates;
    say!("surrogates without an effect: {added} of {tried} with a family adopted; seed {}", outcome.seed)?;
    for own in outcome.backgrounds.iter().filter(|own| !own.added.is_empty()) {
        say!("  {}: {}", own.record, own.added.join("; "))?;
    }
    if outcome.cut_short { say!("ended by --minutes") } else { Ok(()) }
}

fn row(effect: &Effect) -> Vec<String> {
    let halves = || effect.parts.iter().filter_map(|part| part.limits[0]);
    let (least, most) = (halves().fold(f64::INFINITY, f64::min), halves().fold(0.0, f64::max));
    let mut row = vec![effect.family.clone(), format!("{:.3} to {:.3} % {}", 100.0 * least, 100.0 * most, effect.unit)];
    row.extend(effect.counts.iter().map(|count| format!("{} ({}) of {}", count.found, count.named, count.tried)));
    row.push(effect.half_over_limit.map_or("-".into(), |half| format!("{half:.2} x")));
    row.push(effect.counts.iter().map(|count| count.wrong).sum::<usize>().to_string());
    row
}
