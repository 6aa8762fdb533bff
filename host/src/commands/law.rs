//! `meshband law`: the paper's studies on a machine, its bandwidth law, and the check at speeds not fitted.

use clap::{Args as ClapArgs, Subcommand};
use meshband_host::law::derive::{Check, Laws, OPERATING_POINTS, check, derive};
use meshband_host::law::domain::Domain;
use meshband_host::law::file::LawFile;
use meshband_host::law::learn::{self, Learned, Wanted};
use meshband_host::law::operating::Bench;
use meshband_host::law::outcome::{self, Outcome};
use meshband_host::law::report::{
    LAW_HEAD, check_head, check_rows, check_section, law_rows, law_section, study_report,
};
use meshband_host::law::{export, validation};
use meshband_host::machine::Machine;
use meshband_host::output::show;
use meshband_host::record::Record;
use meshband_host::report::Report;
use meshband_host::results::{Announced, Force, Results};
use meshband_host::terminal::{Progress, table};
use meshband_host::train_dynamics::TrainMachine;
use meshband_host::train_dynamics::stage_pair::pair_of_stage;
use meshband_host::{Error, Result, budget, say};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Arguments of `meshband law`.
#[derive(ClapArgs)]
pub struct Args {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    /// Bandwidth against module, teeth, speed, torque, ramp, crack and sampling rate.
    Study(Study),
    /// Fits every form of the law; writes the tabulated one for a node.
    Fit(Fit),
    /// Compares every form with simulations at speeds that were not fitted.
    Check(CheckOnly),
    /// Measures the law on a record of the machine itself: several speeds, or a run-up.
    Learn(Learn),
    /// The law as the Rust constants that the node is built with.
    Export(Export),
}

#[derive(ClapArgs)]
struct Common {
    /// Machine file, a record folder, or a train machine with --stage.
    machine: PathBuf,
    /// Spur stage of a train machine, counted from 1, the rest of the train rigid; speeds are its pinion's.
    #[arg(long, value_name = "N")]
    stage: Option<usize>,
    #[command(flatten)]
    results: Results,
}

#[derive(ClapArgs)]
struct Study {
    #[command(flatten)]
    common: Common,
    /// Judges the paper's statements, which are about its own rig (machines/paper-rig.toml).
    #[arg(long)]
    paper: bool,
    /// Writes that judgement as Markdown here.
    #[arg(long)]
    validation: Option<PathBuf>,
}

#[derive(ClapArgs)]
struct Fit {
    #[command(flatten)]
    common: Common,
    /// Writes the tabulated law here (law.toml), for a node.
    #[arg(short, long)]
    output: Option<PathBuf>,
    #[command(flatten)]
    speeds: Speeds,
}

/// Which speeds a law is for.
#[derive(ClapArgs)]
struct Speeds {
    /// Pinion speeds that the law is for, Hz; otherwise 1..25, reaching a quarter beyond the machine's nominal speed.
    #[arg(long, value_name = "LOW..HIGH")]
    speeds: Option<Domain>,
}

#[derive(ClapArgs)]
struct CheckOnly {
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    speeds: Speeds,
}

#[derive(ClapArgs)]
struct Learn {
    /// Record folder; needs tooth counts and a tach, real or virtual.
    record: PathBuf,
    /// Channel, from 0.
    #[arg(long, value_name = "N", default_value_t = 0)]
    channel: usize,
    /// What is measured.
    #[arg(long, value_enum, default_value = "auto")]
    method: Wanted,
    /// Machine file: the law is then named after it, and its simulated law stands beside.
    #[arg(long, value_name = "FILE")]
    machine: Option<PathBuf>,
    /// Writes the law here (law.toml), for a node.
    #[arg(short, long)]
    output: Option<PathBuf>,
    #[command(flatten)]
    results: Results,
}

#[derive(ClapArgs)]
struct Export {
    /// Machine file.
    machine: PathBuf,
    /// Writes the source text here instead of printing it.
    #[arg(short, long)]
    output: Option<PathBuf>,
    #[command(flatten)]
    permission: Force,
}

/// Runs the action.
pub fn run(args: Args) -> Result<()> {
    match args.action {
        Action::Study(args) => study(&args),
        Action::Fit(args) => fit(&args),
        Action::Check(args) => check_only(&args),
        Action::Learn(args) => learn(&args),
        Action::Export(args) => export_only(&args),
    }
}

fn study(args: &Study) -> Result<()> {
    let results = &args.common.results;
    let mut outputs = results.outputs([args.common.machine.as_path()]);
    let mut files = results.announce(&mut outputs)?;
    let judgement = outputs.optional(args.validation.as_deref())?;
    let machine = pair_machine(&args.common.machine, args.common.stage)?;
    let judged = args.paper || args.validation.is_some();
    if judged && machine.pair.teeth != PAPER_TEETH {
        let [pinion, gear] = machine.pair.teeth;
        let option = if args.paper { "--paper" } else { "--validation" };
        let what = format!("judges statements about a 55/75 rig; {} has {pinion}/{gear} teeth", machine.title);
        return Err(Error::invalid(option, what));
    }
    let progress = Progress::new("law study", outcome::STEPS);
    let outcome = outcome::run(&machine, &|| progress.step())?;
    drop(progress);
    let claims = judged.then(|| validation::claims(&outcome));
    files.write(&WithClaims { outcome: &outcome, claims: claims.as_deref() }, || study_report(&outcome))?;
    if let Some(mut file) = judgement {
        file.write(validation::markdown(&outcome))?;
    }
    print_study(&outcome)?;
    claims.iter().flatten().try_for_each(print_claim)
}

/// Tooth counts of the paper's rig.
const PAPER_TEETH: [u32; 2] = [55, 75];

#[derive(Serialize)]
struct WithClaims<'a> {
    #[serde(flatten)]
    outcome: &'a Outcome,
    #[serde(skip_serializing_if = "Option::is_none")]
    claims: Option<&'a [validation::Claim]>,
}

fn print_study(o: &Outcome) -> Result<()> {
    let c = &o.calibration;
    say!(
        "calibration: {:.4} mrad gives {:.2} kHz at {} Hz; this machine's ramp is {:.4} mrad\n",
        1e3 * c.width_rad,
        c.target_hz * 1e-3,
        c.shaft_hz,
        1e3 * o.laws.ramp_width_rad
    )?;
    let khz = meshband_host::law::report::khz;
    let sweeps = [o.module.as_ref(), o.teeth.as_ref(), Some(&o.speed), Some(&o.torque)];
    for sweep in sweeps.into_iter().flatten() {
        let head = [sweep.name, "positive pulse, kHz", "alone, kHz", "negative pulse, kHz", "99 % occupied, kHz"];
        let rows: Vec<Vec<String>> = sweep
            .rows
            .iter()
            .map(|r| vec![r.label.clone(), khz(r.exit_hz), khz(r.alone_hz), khz(r.entry_hz), khz(Some(r.occupied_hz))])
            .collect();
        say!("{}", table(&head, &rows))?;
    }
    print_check(&o.check)
}

fn print_claim(claim: &validation::Claim) -> Result<()> {
    let verdict = match &claim.verdict {
        validation::Verdict::Holds => "holds".to_string(),
        validation::Verdict::HoldsOnlyIf(condition) => format!("holds only if {condition}"),
        validation::Verdict::DoesNotHold => "does not hold".to_string(),
    };
    say!("{} - {}", claim.sentence, verdict)
}

fn print_check(check: &Check) -> Result<()> {
    let head = check_head(check);
    let head: Vec<&str> = head.iter().map(String::as_str).collect();
    say!("{}", table(&head, &check_rows(check)))?;
    say!(
        "ring of earlier engagements: {:.2} % rms, {:.2} % at most; hides the edge at {} of {} speeds",
        100.0 * check.ring_rms,
        100.0 * check.ring_worst,
        check.hidden,
        check.rows.len()
    )?;
    say!("{}\n", check.reliance())
}

#[derive(Serialize)]
struct Fitted<'a> {
    laws: &'a Laws,
    check: &'a Check,
}

/// The pair of a machine file, or of a stage of a train machine.
fn pair_machine(path: &Path, stage: Option<usize>) -> Result<Machine> {
    let is_train = path.is_file() && TrainMachine::is_declared(&budget::read_text(path)?);
    match (is_train, stage) {
        (true, Some(stage)) => pair_of_stage(&TrainMachine::read(path)?, stage),
        (true, None) => Err(Error::invalid(path.display(), "is a train machine: say which spur stage with --stage N")),
        (false, Some(_)) => Err(Error::invalid("--stage", "is for train machines (tables [[stage]] and [[mesh]])")),
        (false, None) => Machine::read(path),
    }
}

/// Fits and checks a machine.
fn fitted(machine: &Machine, domain: Option<Domain>) -> Result<(Laws, Check)> {
    let domain = domain.unwrap_or_else(|| Domain::of(machine));
    let bench = Bench::new(machine)?;
    let progress = Progress::new("law fit", OPERATING_POINTS);
    let laws = derive(machine, &bench, domain, &|| progress.step())?;
    let check = check(&laws, &bench, &|| progress.step())?;
    Ok((laws, check))
}

/// The law that a node of this machine gets.
pub(super) fn for_node(path: &Path) -> Result<LawFile> {
    let machine = Machine::read(path)?;
    let bench = Bench::new(&machine)?;
    let laws = derive(&machine, &bench, Domain::of(&machine), &|| ())?;
    let file = laws.file(check(&laws, &bench, &|| ())?.relative_uncertainty());
    file.for_node()?;
    Ok(file)
}

fn write_common(files: &mut Announced, laws: &Laws, check: &Check, title: &str) -> Result<()> {
    files.write(&Fitted { laws, check }, || {
        let subtitle = format!("{}, ramp {}, hash {}", laws.machine, laws.ramp.name(), laws.machine_hash);
        check_section(law_section(Report::new(title, &subtitle), laws)?, check)
    })
}

fn fit(args: &Fit) -> Result<()> {
    let results = &args.common.results;
    let mut outputs = results.outputs([args.common.machine.as_path()]);
    let mut files = results.announce(&mut outputs)?;
    let node_law = outputs.optional(args.output.as_deref())?;
    let machine = pair_machine(&args.common.machine, args.common.stage)?;
    let (laws, check) = fitted(&machine, args.speeds.speeds)?;
    write_common(&mut files, &laws, &check, "Bandwidth law: fit")?;
    if let Some(mut target) = node_law {
        let file = laws.file(check.relative_uncertainty());
        file.for_node()?;
        target.write(file.to_toml())?;
    }
    say!(
        "machine {}, hash {}, ramp {} of {:.4} mrad, {} to {} Hz",
        laws.machine,
        laws.machine_hash,
        laws.ramp.name(),
        1e3 * laws.ramp_width_rad,
        laws.domain.lowest_hz,
        laws.domain.highest_hz
    )?;
    say!("{}", table(&LAW_HEAD, &law_rows(&laws)))?;
    print_check(&check)
}

fn check_only(args: &CheckOnly) -> Result<()> {
    let Common { machine, stage, results } = &args.common;
    let mut files = results.announce(&mut results.outputs([machine.as_path()]))?;
    let (laws, check) = fitted(&pair_machine(machine, *stage)?, args.speeds.speeds)?;
    write_common(&mut files, &laws, &check, "Bandwidth law: check")?;
    print_check(&check)
}

fn learn(args: &Learn) -> Result<()> {
    let inputs = std::iter::once(args.record.as_path()).chain(args.machine.as_deref());
    let mut outputs = args.results.outputs(inputs);
    let mut files = args.results.announce(&mut outputs)?;
    let node_law = outputs.optional(args.output.as_deref())?;
    let machine = args.machine.as_deref().map(Machine::read).transpose()?;
    let record = Record::read(&args.record)?;
    let learned = learn::learn(&record, args.channel, args.method)?;
    let file = learned.file(machine.as_ref());
    file.for_node()?;
    let simulated = machine.as_ref().map(|machine| fitted(machine, learned_domain(&learned))).transpose()?;
    let simulated = simulated.map(|(laws, check)| laws.file(check.relative_uncertainty()).law);
    files.write(&learned, || learn::report::report(&learned, simulated.as_ref()))?;
    if let Some(mut target) = node_law {
        target.write(file.to_toml())?;
    }
    show(&learn::report::text(&learned, simulated.as_ref()))
}

/// The range in which the simulated law is compared: the learned one's where a law can be asked for over it.
fn learned_domain(learned: &Learned) -> Option<Domain> {
    let [lowest, highest] = [learned.knots.first()?.speed_hz, learned.knots.last()?.speed_hz];
    format!("{lowest}..{highest}").parse().ok()
}

fn export_only(args: &Export) -> Result<()> {
    let target = args.permission.outputs([args.machine.as_path()]).optional(args.output.as_deref())?;
    let (laws, check) = fitted(&Machine::read(&args.machine)?, Some(Domain::PAPER))?;
    let source = export::rust_source(&laws.file(check.relative_uncertainty()), &args.machine.display().to_string())?;
    match target {
        Some(mut file) => file.write(source),
        None => show(&source),
    }
}
