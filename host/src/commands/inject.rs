//! `meshband inject`: known effects in a measured background, found or not, against the limits that `loop` prints.

use super::results::Force;
use clap::Args as ClapArgs;
use meshband_host::injection::{self, Options, Outcome};
use meshband_host::output::show;
use meshband_host::record::Record;
use meshband_host::{Error, Result, say, terminal};
use std::path::PathBuf;
use std::time::Duration;

/// Arguments of `meshband inject`.
#[derive(ClapArgs)]
pub struct Args {
    /// Record folder with tooth counts and a speed reference.
    record: PathBuf,
    /// Positions of every effect and strength.
    #[arg(long, default_value_t = 20)]
    positions: usize,
    /// Surrogates of the background without any effect.
    #[arg(long, default_value_t = 200)]
    surrogates: usize,
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
    let json = args.permission.outputs([args.record.as_path()]).optional(args.json.as_deref())?;
    let record = Record::read(&args.record)?;
    let options = Options {
        positions: args.positions,
        surrogates: args.surrogates,
        seed: args.seed,
        longest: Duration::from_secs_f64(60.0 * args.minutes),
    };
    let outcome = injection::run(&record, &options)?;
    if let Some(mut file) = json {
        file.write_json(&outcome)?;
    }
    print(&outcome)
}

fn print(outcome: &Outcome) -> Result<()> {
    let mut head: Vec<String> = vec!["effect".into(), "limit printed".into()];
    head.extend(injection::STRENGTHS.map(|of_limit| format!("at {of_limit} x")));
    head.extend(["half found at".into(), "taken for another".into()]);
    let row = |effect: &injection::Effect| {
        let mut row = vec![effect.family.clone(), format!("{:.4} % {}", 100.0 * effect.limit, effect.unit)];
        row.extend(effect.counts.iter().map(|count| format!("{} of {}", count.found, count.tried)));
        row.push(effect.half_over_limit.map_or("-".into(), |half| format!("{half:.2} x")));
        row.push(effect.counts.iter().map(|count| count.wrong).sum::<usize>().to_string());
        row
    };
    let rows: Vec<Vec<String>> = outcome.effects.iter().map(row).collect();
    let head: Vec<&str> = head.iter().map(String::as_str).collect();
    say!("{} families in the background; seed {}", outcome.background, outcome.seed)?;
    show(&terminal::table(&head, &rows))?;
    outcome.left_out.iter().try_for_each(|family| say!("not injected, in the background or on its lines: {family}"))?;
    let [tried, added] = outcome.surrogates;
    say!("surrogates without an effect: {added} of {tried} with a family adopted")?;
    if outcome.cut_short { say!("ended by --minutes") } else { Ok(()) }
}
