//! `meshband-validate levels`: what alarms on the departure from expected levels detect, beside absolute alarms.

use clap::Args as ClapArgs;
use meshband_host::law::domain::Domain;
use meshband_host::levels::learn::learn;
use meshband_host::levels::observe::Observations;
use meshband_host::machine::Machine;
use meshband_host::output::show;
use meshband_host::results::Force;
use meshband_host::terminal::Progress;
use meshband_host::{Error, Result};
use meshband_validate::levels::bench::{Bench, FAULTS};
use meshband_validate::levels::hours::{self, Hour, Sample};
use meshband_validate::levels::judge::{Scales, judge};
use meshband_validate::levels::text::{Spent, page};
use rayon::prelude::*;
use std::path::PathBuf;

/// Arguments of `meshband-validate levels`.
#[derive(ClapArgs)]
pub struct Args {
    /// Machine file with a nominal torque.
    machine: PathBuf,
    /// Hours of machine time in all.
    #[arg(long, default_value_t = 60)]
    hours: usize,
    /// Pinion speeds, Hz.
    #[arg(long, value_name = "LOW..HIGH", default_value = "8..25")]
    speeds: Domain,
    /// Seed of speeds, loads and noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Writes the page here instead of printing it.
    #[arg(short, long)]
    output: Option<PathBuf>,
    #[command(flatten)]
    permission: Force,
}

/// Allowed false alarms per day, as multiples of the sound hours.
const PER_DAY: [f64; 3] = [1.0, 4.0, 24.0];

/// Runs the hours and writes the page.
pub fn run(args: Args) -> Result<()> {
    if !(10..=1000).contains(&args.hours) {
        return Err(Error::invalid("--hours", format!("{} is not within 10 to 1000", args.hours)));
    }
    let output = args.permission.outputs([args.machine.as_path()]).optional(args.output.as_deref())?;
    let machine = Machine::read(&args.machine)?;
    let range = (args.speeds.lowest_hz, args.speeds.highest_hz);
    let bench = Bench::new(&machine, range)?;
    let spent = Spent::of(args.hours);
    let progress = Progress::new("hours", spent.all() as u64);
    let mut config = hours::configuration(&bench)?;
    let run = |config: &_, fault, index: usize| {
        let seed = args.seed.wrapping_mul(1_000_003).wrapping_add(index as u64);
        let result = hours::run(&bench, config, Hour { fault, seconds: 3600.0, seed });
        progress.step();
        result
    };
    let taught: Vec<(Vec<Sample>, Observations)> =
        (0..spent.taught).into_par_iter().map(|n| run(&config, None, n)).collect::<Result<_>>()?;
    let (mut samples, mut observed) = (Vec::new(), Observations::default());
    for (hour, values) in taught {
        samples.extend(hour);
        observed.extend(values);
    }
    let learned = learn(&observed, 0.0)?;
    (config.levels, config.local_levels) = (learned.levels().collect(), learned.local_levels().collect());
    let mut plan: Vec<Option<usize>> = vec![None; spent.sound];
    (0..FAULTS.len()).for_each(|fault| plan.extend(vec![Some(fault); spent.each_fault]));
    let all: Vec<Vec<Sample>> = plan
        .par_iter()
        .enumerate()
        .map(|(n, &fault)| Ok(run(&config, fault, spent.taught + n)?.0))
        .collect::<Result<_>>()?;
    let (sound, faulty) = all.split_at(spent.sound);
    let faulty: Vec<Vec<Vec<Sample>>> = faulty.chunks(spent.each_fault).map(<[_]>::to_vec).collect();
    let mut allowed = PER_DAY.map(|n| (n * spent.sound as f64 / 24.0).round() as usize).to_vec();
    allowed.dedup();
    let rows = judge(&Scales::new(&samples, range), sound, &faulty, &allowed);
    let command = format!(
        "meshband-validate levels {} --hours {} --speeds {}..{} --seed {}",
        args.machine.display(),
        args.hours,
        range.0,
        range.1,
        args.seed
    );
    let text = page(&command, &machine.title, spent, range, &rows);
    match output {
        Some(mut file) => file.write(text),
        None => show(&text),
    }
}
