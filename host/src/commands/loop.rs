//! `meshband loop`: what a record's declared machine lacks, and the held-out error as declared, calibrated and
//! corrected.

use super::part::PartArgs;
use clap::{Args as ClapArgs, ValueEnum};
use meshband_host::check::{self, Findings};
use meshband_host::model_based::Outcome;
use meshband_host::model_based::apply::{Applied, Correction};
use meshband_host::model_based::bands::{bands, occupied};
use meshband_host::model_based::node_check::{HEADS, NodeCheck, node_check};
use meshband_host::model_based::replay::{Replay, replay};
use meshband_host::model_based::report::{self, report};
use meshband_host::model_based::{Options, close_loop};
use meshband_host::observation::input;
use meshband_host::output::show;
use meshband_host::record::{Record, facts};
use meshband_host::report::Report;
use meshband_host::report::letter::About;
use meshband_host::results::{Announced, Results};
use meshband_host::signal_based::preflight::{self, Preflight};
use meshband_host::{Error, Result, say, signal_based, terminal};
use serde::Serialize;
use std::path::PathBuf;

/// Arguments of `meshband loop`.
#[derive(ClapArgs)]
pub struct Args {
    /// Record folder.
    record: PathBuf,
    #[command(flatten)]
    part: PartArgs,
    #[command(flatten)]
    results: Results,
    /// Writes the corrected machine, its effects and its law beside this machine file, and compares a virtual node
    /// before and after.
    #[arg(long)]
    apply: Option<PathBuf>,
    /// Inference to run; the model-based one where the record allows it and none is given.
    #[arg(long, value_enum)]
    level: Option<Level>,
    /// Leaves out what would have been found of every effect that was not (model-based inference).
    #[arg(long)]
    no_limits: bool,
    /// Compares with so many records of the calibrated machine without any effect (parametric bootstrap): this
    /// record's own probability of a false alarm (model-based inference).
    #[arg(long, value_name = "N", default_value_t = 0)]
    null: usize,
    /// Seed of the split into fit, selection and held-out runs, and of the records of --null (model-based inference).
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// What the loop may rest on.
#[derive(Clone, Copy, ValueEnum)]
enum Level {
    /// Tooth counts and a speed reference: lines behind an unknown path.
    #[value(alias = "kinematic")]
    SignalBased,
    /// The declared machine's equations.
    #[value(alias = "dynamic")]
    ModelBased,
}

impl From<Level> for preflight::Level {
    fn from(level: Level) -> Self {
        match level {
            Level::SignalBased => Self::SignalBased,
            Level::ModelBased => Self::ModelBased,
        }
    }
}

/// The outcome with what came of `--apply`.
#[derive(Serialize)]
struct Written<'a> {
    #[serde(flatten)]
    outcome: &'a Outcome,
    #[serde(skip_serializing_if = "Option::is_none")]
    applied: Option<&'a Applied>,
    /// Why the correction or its check on a virtual node could not be made.
    #[serde(skip_serializing_if = "Option::is_none")]
    apply_failed: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    virtual_node: Option<&'a NodeCheck>,
}

/// Runs the loop, writes its files and prints the outcome.
pub fn run(args: Args) -> Result<()> {
    let read = [Some(&args.record), args.apply.as_ref()].into_iter().flatten().map(PathBuf::as_path);
    let mut outputs = args.results.outputs(read);
    let mut written = args.results.announce(&mut outputs)?;
    let files = args.part.read(&args.record)?;
    let preflight = Preflight::of(&files);
    let place = files.folder.join("record.toml").display().to_string();
    let level = preflight.level(args.level.map(Into::into), &place)?;
    // What the correction would write is checked first, whatever the level.
    let correction = match &args.apply {
        Some(path) if files.declaration.has_machine() => Some(Correction::announce(path, &files, &mut outputs)?),
        Some(_) => return Err(nothing_to_correct(&preflight)),
        None => None,
    };
    if level == preflight::Level::SignalBased {
        if preflight.lacks_only_speeds() {
            // A machine that is declared wrongly is refused, not passed over.
            input::view(&files)?;
        }
        if correction.is_some() {
            return Err(nothing_to_correct(&preflight));
        }
        return run_signal_based(&args, &files, &preflight, &mut written);
    }
    let record = input::view(&files)?;
    refuse_unusable(&record, &mut written)?;
    let options = Options {
        seed: args.seed,
        progress: true,
        limits: !args.no_limits,
        null_records: args.null,
        ..Options::default()
    };
    let mut outcome = close_loop(&record, &options)?;
    if let Some(name) = args.record.file_name() {
        outcome.record = name.to_string_lossy().into_owned();
    }
    let about = facts::about(&files);
    let replayed = (written.wants_report() || correction.is_some()).then(|| replay(&record, &outcome));
    if correction.is_some() {
        // The correction takes its time and may fail: what has been found is safe first.
        written.write_early(&Written::of(&outcome, &Correcting::default()), || {
            page(&outcome, replayed.as_ref(), &about, None)
        })?;
    }
    let made = correction.map(|correction| correct(correction, &files, &outcome)).unwrap_or_default();
    written.write(&Written::of(&outcome, &made), || page(&outcome, replayed.as_ref(), &about, made.check.as_ref()))?;
    show(&outcome.summary())?;
    if let (Some(applied), Some(replayed)) = (&made.applied, &replayed) {
        print_applied(applied)?;
        print_bands(replayed, &outcome)?;
    }
    if let Some(check) = &made.check {
        HEADS.iter().zip(check.rows()).try_for_each(|(head, rows)| show(&terminal::table(head, &rows)))?;
    }
    made.failed.map_or(Ok(()), Err)
}

/// Why `--apply` is refused for signal-based inference.
fn nothing_to_correct(preflight: &Preflight) -> Error {
    let missing = preflight.for_model_based.join("; ");
    Error::invalid("--apply", format!("corrects a machine, which signal-based inference has not; missing: {missing}"))
}

/// Signal-based inference: families of lines in what the mesh leaves.
fn run_signal_based(args: &Args, record: &Record, preflight: &Preflight, written: &mut Announced) -> Result<()> {
    let mut outcome = signal_based::run(record, preflight)?;
    if let Some(name) = args.record.file_name() {
        outcome.record = name.to_string_lossy().into_owned();
    }
    written.write(&outcome, || signal_based::report::report(&outcome, &facts::about(record)))?;
    show(&signal_based::view::text(&outcome))
}

/// What came of `--apply`.
#[derive(Default)]
struct Correcting {
    applied: Option<Applied>,
    check: Option<NodeCheck>,
    failed: Option<Error>,
}

/// Writes the correction and compares the virtual node before and after; what fails is kept with what did not.
fn correct(correction: Correction, record: &Record, outcome: &Outcome) -> Correcting {
    let applied = match correction.write(outcome) {
        Ok(applied) => applied,
        Err(error) => return Correcting { failed: Some(error), ..Correcting::default() },
    };
    match node_check(record, outcome, &applied) {
        Ok(check) => Correcting { applied: Some(applied), check, failed: None },
        Err(error) => Correcting { applied: Some(applied), check: None, failed: Some(error) },
    }
}

impl<'a> Written<'a> {
    fn of(outcome: &'a Outcome, made: &'a Correcting) -> Self {
        let apply_failed = made.failed.as_ref().map(Error::to_string);
        Self { outcome, applied: made.applied.as_ref(), apply_failed, virtual_node: made.check.as_ref() }
    }
}

fn page(outcome: &Outcome, replayed: Option<&Replay>, about: &About, check: Option<&NodeCheck>) -> Result<Report> {
    let page = report(outcome, replayed.expect("a report is only made of a replayed outcome"), about)?;
    let Some(check) = check else { return Ok(page) };
    let [levels, widths] = check.rows();
    Ok(page
        .section("Virtual node before and after")
        .text(
            "The node's own code on held-out runs: on the record, on what the declared machine predicts, and on \
            the corrected one.",
        )
        .table("Mesh-band levels that the node reports.", HEADS[0], &levels)
        .table("Bandwidth measured by the node, and by the law it carries.", HEADS[1], &widths))
}

/// What is written of a record that nothing can be inferred from.
#[derive(Serialize)]
struct Refused<'a> {
    headline: String,
    findings: &'a Findings,
}

/// Ends with the findings where the record's check refuses it: files first, then text, then the error.
fn refuse_unusable(record: &input::Record, written: &mut Announced) -> Result<()> {
    let findings = check::record(record);
    let Err(error) = findings.require_usable() else { return Ok(()) };
    let headline = error.to_string();
    written.write(&Refused { headline: headline.clone(), findings: &findings }, || {
        let page = Report::new(&format!("Closed loop: {}", record.title), &headline);
        Ok(report::findings(page, &findings))
    })?;
    show(&findings.text())?;
    Err(error)
}

/// Effects of one name shown before the rest is only counted.
const MAX_SHOWN_EFFECTS: usize = 4;

fn print_applied(applied: &Applied) -> Result<()> {
    say!("written: {}, {}", applied.machine.display(), applied.effects.display())?;
    say!("  torque times {:.5}", applied.torque_factor)?;
    applied.written.iter().take(MAX_SHOWN_EFFECTS).try_for_each(|effect| say!("  --effect {effect}"))?;
    if applied.written.len() > MAX_SHOWN_EFFECTS {
        say!("  and {} more", applied.written.len() - MAX_SHOWN_EFFECTS)?;
    }
    applied.remarks.iter().try_for_each(|remark| say!("  {remark}"))?;
    applied.not_written.iter().try_for_each(|other| say!("  without counterpart in the simulator: {other}"))?;
    say!("law {}", applied.law_remark)?;
    match (&applied.law, applied.bandwidth_hz) {
        (Some(path), Some([before, after])) => {
            say!("  {}: edge bandwidth {before:.0} Hz declared, {after:.0} Hz corrected", path.display())
        }
        _ => Ok(()),
    }
}

fn print_bands(replayed: &Replay, outcome: &Outcome) -> Result<()> {
    let rows: Vec<Vec<String>> = bands(replayed, outcome)
        .iter()
        .map(|b| {
            let [declared, corrected] = [b.declared_error_db, b.corrected_error_db].map(|e| format!("{e:.3}"));
            vec![format!("ch {}, {} x mesh", b.channel, b.harmonic), format!("{:.2}", b.record_db), declared, corrected]
        })
        .collect();
    show(&terminal::table(&["held-out band, dB", "record", "declared off by", "corrected"], &rows))?;
    let rows: Vec<Vec<String>> = occupied(replayed, outcome)
        .iter()
        .map(|o| {
            let [record, declared, corrected] =
                [o.record_hz, o.declared_error_hz, o.corrected_error_hz].map(|hz| format!("{hz:.1}"));
            vec![format!("ch {}", o.channel), record, declared, corrected]
        })
        .collect();
    let head = ["held-out bandwidth of 99 % of the power, Hz", "record", "declared off by", "corrected"];
    show(&terminal::table(&head, &rows))
}
