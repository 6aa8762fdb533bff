//! The damage campaign on its own: `cargo xtask damage` builds what it needs and calls this.

use meshband_tests::damage::{CAMPAIGN_ATTACKS, Campaign, report, run};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Mutex;
use std::time::Instant;

const HELP: &str = "damage --program MESHBAND [--cases N] [--seed S] [--only FAMILY[:NUMBER]] [--keep FOLDER] \
    [--json FILE] [--markdown FILE]";

fn main() -> ExitCode {
    match attack() {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(message) => {
            eprintln!("damage: {message}");
            ExitCode::from(2)
        }
    }
}

struct Options {
    campaign: Campaign,
    json: Option<PathBuf>,
    markdown: Option<PathBuf>,
}

fn options() -> Result<Options, String> {
    let workers = std::thread::available_parallelism().map_or(2, usize::from);
    let program = PathBuf::new();
    let campaign = Campaign { program, seed: 1, cases: CAMPAIGN_ATTACKS, only: None, keep: None, workers };
    let mut options = Options { campaign, json: None, markdown: None };
    let mut words = std::env::args().skip(1);
    while let Some(option) = words.next() {
        let value = words.next().ok_or_else(|| format!("{option} needs a value\n{HELP}"))?;
        let number = || value.parse::<u64>().map_err(|_| format!("{option}: `{value}` is no whole number"));
        match option.as_str() {
            // Attacks run in folders of their own.
            "--program" => options.campaign.program = std::path::absolute(&value).map_err(|error| error.to_string())?,
            "--cases" => options.campaign.cases = number()? as usize,
            "--seed" => options.campaign.seed = number()?,
            "--keep" => options.campaign.keep = Some(value.into()),
            "--json" => options.json = Some(value.into()),
            "--markdown" => options.markdown = Some(value.into()),
            "--only" => {
                let (family, index) = value.split_once(':').map_or((&*value, None), |(f, i)| (f, Some(i)));
                let index =
                    index.map(str::parse).transpose().map_err(|_| format!("--only: `{value}` has no number"))?;
                options.campaign.only = Some((family.to_owned(), index));
            }
            _ => return Err(format!("unknown option {option}\n{HELP}")),
        }
    }
    if options.campaign.program.as_os_str().is_empty() { Err(HELP.to_owned()) } else { Ok(options) }
}

/// Whether no attack failed.
fn attack() -> Result<bool, String> {
    let Options { campaign, json, markdown } = options()?;
    let start = Instant::now();
    let said = Mutex::new(0);
    let outcome = run(&campaign, |done, all| {
        let mut last = said.lock().expect("no printing panics");
        let tenth = 20 * done / all.max(1);
        if tenth > *last {
            *last = tenth;
            eprintln!("damage: {done} of {all} attacks, {:.0} s", start.elapsed().as_secs_f64());
        }
    })?;
    let write = |path: Option<PathBuf>, text: String| match path {
        Some(path) => std::fs::write(&path, text).map_err(|error| format!("{}: {error}", path.display())),
        None => Ok(()),
    };
    write(json, format!("{:#}\n", report::json(&campaign, &outcome)))?;
    write(markdown, report::markdown(&campaign, &outcome))?;
    let failed = report::failed(&outcome);
    for made in &failed {
        println!("{}: {}", report::again(campaign.seed, made), report::printable(&made.what));
        made.lines.iter().for_each(|line| println!("    {}", report::printable(line)));
        made.findings.iter().for_each(|(kind, what)| println!("    {}: {}", kind.name(), report::printable(what)));
    }
    println!(
        "{} attacks in {:.0} s, {} with failures, {} not possible here",
        outcome.made.len(),
        start.elapsed().as_secs_f64(),
        failed.len(),
        outcome.impossible
    );
    Ok(failed.is_empty())
}
