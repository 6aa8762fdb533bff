//! `meshband loop`: what a record's declared machine lacks, and the held-out error before and after adding it.

use clap::Args as ClapArgs;
use meshband_host::closed_loop::Outcome;
use meshband_host::closed_loop::apply::{Applied, apply};
use meshband_host::closed_loop::bands::{bands, occupied};
use meshband_host::closed_loop::node_check::{HEADS, NodeCheck, node_check};
use meshband_host::closed_loop::replay::{Replay, replay};
use meshband_host::closed_loop::report::report;
use meshband_host::closed_loop::{Options, close_loop, input};
use meshband_host::record::Record;
use meshband_host::report::write_json;
use meshband_host::{Result, terminal};
use serde::Serialize;
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
    /// Writes the corrected machine, its effects and its law beside this machine file, and compares a virtual node before and after.
    #[arg(long)]
    apply: Option<PathBuf>,
    /// Seed of the split into fit, selection and held-out runs.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// The outcome with what came of `--apply`.
#[derive(Serialize)]
struct Written<'a> {
    #[serde(flatten)]
    outcome: &'a Outcome,
    #[serde(skip_serializing_if = "Option::is_none")]
    applied: Option<&'a Applied>,
    #[serde(skip_serializing_if = "Option::is_none")]
    virtual_node: Option<&'a NodeCheck>,
}

/// Runs the loop and prints the outcome.
pub fn run(args: Args) -> Result<()> {
    let files = Record::read(&args.record)?;
    let record = input::view(&files)?;
    let options = Options { seed: args.seed, progress: true, ..Options::default() };
    let mut outcome = close_loop(&record, &options)?;
    if let Some(name) = args.record.file_name() {
        outcome.record = name.to_string_lossy().into_owned();
    }
    print!("{}", outcome.summary());
    let replayed = (args.report.is_some() || args.apply.is_some()).then(|| replay(&record, &outcome));
    let applied = args.apply.as_ref().map(|machine| apply(machine, &outcome)).transpose()?;
    if let (Some(applied), Some(replayed)) = (&applied, &replayed) {
        print_applied(applied);
        print_bands(replayed, &outcome);
    }
    let check = applied.as_ref().map(|applied| node_check(&files, &outcome, applied)).transpose()?.flatten();
    if let Some(check) = &check {
        for (head, rows) in HEADS.iter().zip(check.rows()) {
            print!("{}", terminal::table(head, &rows));
        }
    }
    if let Some(path) = &args.json {
        write_json(path, &Written { outcome: &outcome, applied: applied.as_ref(), virtual_node: check.as_ref() })?;
    }
    if let (Some(path), Some(replayed)) = (&args.report, &replayed) {
        let mut page = report(&outcome, replayed)?;
        if let Some(check) = &check {
            let [levels, widths] = check.rows();
            page = page
                .section("Virtual node before and after")
                .text("The node's own code on held-out runs: on the record, on what the declared machine predicts, and on the corrected one.")
                .table("Mesh-band levels that the node reports.", HEADS[0], &levels)
                .table("Bandwidth measured by the node, and by the law it carries.", HEADS[1], &widths);
        }
        page.write(path)?;
    }
    Ok(())
}

/// Effects of one name shown before the rest is only counted.
const SHOWN: usize = 4;

fn print_applied(applied: &Applied) {
    println!("written: {}, {}", applied.machine.display(), applied.effects.display());
    println!("  torque times {:.5}", applied.torque_factor);
    applied.written.iter().take(SHOWN).for_each(|effect| println!("  --effect {effect}"));
    if applied.written.len() > SHOWN {
        println!("  and {} more", applied.written.len() - SHOWN);
    }
    applied.remarks.iter().for_each(|remark| println!("  {remark}"));
    applied.not_written.iter().for_each(|other| println!("  without counterpart in the simulator: {other}"));
    println!("law {}", applied.law_remark);
    if let (Some(path), Some([before, after])) = (&applied.law, applied.bandwidth_hz) {
        println!("  {}: edge bandwidth {before:.0} Hz declared, {after:.0} Hz corrected", path.display());
    }
}

fn print_bands(replayed: &Replay, outcome: &Outcome) {
    let rows: Vec<Vec<String>> = bands(replayed, outcome)
        .iter()
        .map(|b| {
            let [declared, corrected] = [b.declared_error_db, b.corrected_error_db].map(|e| format!("{e:.3}"));
            vec![format!("ch {}, {} x mesh", b.channel, b.harmonic), format!("{:.2}", b.record_db), declared, corrected]
        })
        .collect();
    print!("{}", terminal::table(&["held-out band, dB", "record", "declared off by", "corrected"], &rows));
    let rows: Vec<Vec<String>> = occupied(replayed, outcome)
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
