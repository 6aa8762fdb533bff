//! `meshband loop`: what a record's declared machine lacks, and the held-out error before and after adding it.

use clap::Args as ClapArgs;
use meshband_host::closed_loop::apply::apply;
use meshband_host::closed_loop::bands::{bands, occupied};
use meshband_host::closed_loop::replay::replay;
use meshband_host::closed_loop::report::report;
use meshband_host::closed_loop::{Options, close_loop, input};
use meshband_host::report::write_json;
use meshband_host::{Result, terminal};
use std::path::PathBuf;

/// Arguments of `meshband loop`.
#[derive(ClapArgs)]
pub struct Args {
    /// Record folder.
    record: PathBuf,
    /// Writes the outcome as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Writes a report with residual spectra before and after.
    #[arg(long)]
    report: Option<PathBuf>,
    /// Writes the corrected machine, its effects and, where the pair changed, its law beside this machine file.
    #[arg(long)]
    apply: Option<PathBuf>,
    /// Seed of the split into fit, selection and held-out runs.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Runs the loop and prints the outcome.
pub fn run(args: Args) -> Result<()> {
    let record = input::read(&args.record)?;
    let options = Options { seed: args.seed, progress: true, ..Options::default() };
    let mut outcome = close_loop(&record, &options)?;
    if let Some(name) = args.record.file_name() {
        outcome.record = name.to_string_lossy().into_owned();
    }
    print!("{}", outcome.summary());
    if let Some(path) = &args.json {
        write_json(path, &outcome)?;
    }
    if args.report.is_none() && args.apply.is_none() {
        return Ok(());
    }
    let replayed = replay(&record, &outcome);
    if let Some(path) = &args.report {
        report(&outcome, &replayed)?.write(path)?;
    }
    if let Some(machine) = &args.apply {
        let applied = apply(machine, &outcome)?;
        println!("written: {}, {}", applied.machine.display(), applied.effects.display());
        for effect in &applied.written {
            println!("  --effect {effect}");
        }
        for other in &applied.not_written {
            println!("  without counterpart in the simulator: {other}");
        }
        println!("law {}", applied.law_remark);
        if let (Some(path), Some([before, after])) = (&applied.law, applied.bandwidth_hz) {
            println!("  {}: edge bandwidth {before:.0} Hz declared, {after:.0} Hz corrected", path.display());
        }
        let rows: Vec<Vec<String>> = bands(&replayed, &outcome)
            .iter()
            .map(|b| {
                let errors = [b.declared_error_db, b.corrected_error_db].map(|e| format!("{e:.3}"));
                let [declared, corrected] = errors;
                vec![
                    format!("ch {}, {} x mesh", b.channel, b.harmonic),
                    format!("{:.2}", b.record_db),
                    declared,
                    corrected,
                ]
            })
            .collect();
        print!("{}", terminal::table(&["held-out band, dB", "record", "declared off by", "corrected"], &rows));
        let rows: Vec<Vec<String>> = occupied(&replayed, &outcome)
            .iter()
            .map(|o| {
                let [record, declared, corrected] =
                    [o.record_hz, o.declared_error_hz, o.corrected_error_hz].map(|hz| format!("{hz:.1}"));
                vec![format!("ch {}", o.channel), record, declared, corrected]
            })
            .collect();
        let head = ["held-out bandwidth of 99 % of the power, Hz", "record", "declared off by", "corrected"];
        print!("{}", terminal::table(&head, &rows));
    }
    Ok(())
}
