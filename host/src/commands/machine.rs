//! `meshband machine`: a machine file from a few figures, what a machine file says, and every key it may have.

use clap::{Args as ClapArgs, Subcommand, ValueEnum};
use meshband_host::dynamics::Rig;
use meshband_host::dynamics::assembly::{Damping, Model};
use meshband_host::dynamics::modes::{Mode, modes};
use meshband_host::law::domain::Domain;
use meshband_host::law::guesses::{Sensitivity, sensitivity};
use meshband_host::machine::estimate::{Bearings, Known, estimate};
use meshband_host::machine::{Hunting, Machine, keys};
use meshband_host::output::{interrupt, show};
use meshband_host::report::Report;
use meshband_host::results::{Force, Results};
use meshband_host::speed::Speed;
use meshband_host::stiffness::report::Report as Stiffness;
use meshband_host::terminal::{Progress, table};
use meshband_host::train_dynamics::TrainMachine;
use meshband_host::train_dynamics::stage_pair::pair_of_stage;
use meshband_host::{Error, Result, budget, remark, say, text, train};
use serde::Serialize;
use std::f64::consts::TAU;
use std::io::{IsTerminal, Write};
use std::path::PathBuf;

/// Arguments of `meshband machine`.
#[derive(ClapArgs)]
pub struct Args {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    /// Writes a machine file from a few figures: estimates the rest, marks every guess, says which guesses move the
    /// law.
    New(New),
    /// Explains a machine: contact, hunting period, natural frequencies with modes, stiffness beside ISO 6336, domain
    /// of its law.
    Check(Check),
    /// One spur stage of a train machine as a pair's machine file, the rest of the train rigid: for its law, for
    /// model-based inference.
    Stage(Stage),
    /// Every key of a machine file with unit and meaning.
    Keys {
        /// As a Markdown table.
        #[arg(long)]
        markdown: bool,
    },
}

#[derive(ClapArgs)]
struct New {
    /// Machine file to write.
    #[arg(short, long)]
    output: PathBuf,
    /// Tooth counts of pinion and gear, as 21,64 or 21/64.
    #[arg(long, value_parser = teeth)]
    teeth: Option<[u32; 2]>,
    /// Module, mm.
    #[arg(long, value_name = "MM")]
    module: Option<f64>,
    /// Face width, mm.
    #[arg(long, value_name = "MM")]
    width: Option<f64>,
    /// Speed of the pinion, as 24.75Hz or 1485rpm; a bare number is Hz.
    #[arg(long)]
    speed: Option<Speed>,
    /// Power, kW; the torque follows from it.
    #[arg(long, value_name = "KW", conflicts_with = "torque")]
    power: Option<f64>,
    /// Torque of the pinion, N m.
    #[arg(long, value_name = "NM")]
    torque: Option<f64>,
    /// Pressure angle, degrees.
    #[arg(long)]
    pressure_angle: Option<f64>,
    /// Bore diameters of pinion and gear, mm, as 20,40.
    #[arg(long, value_delimiter = ',', num_args = 1, value_name = "MM,MM")]
    bores: Vec<f64>,
    /// Kind of the bearings.
    #[arg(long, value_enum)]
    bearings: Option<BearingKind>,
    /// Tip relief, um.
    #[arg(long, value_name = "UM", conflicts_with = "ramp")]
    relief: Option<f64>,
    /// Pinion rotation over which a pair takes up its load, mrad, where it was measured.
    #[arg(long, value_name = "MRAD")]
    ramp: Option<f64>,
    /// Helix angle, degrees: refused, because only spur gears are in the model.
    #[arg(long, value_name = "DEGREES", hide = true)]
    helix: Option<f64>,
    /// Does not work out which guesses move the law.
    #[arg(long)]
    quick: bool,
    #[command(flatten)]
    permission: Force,
}

#[derive(ClapArgs)]
struct Stage {
    /// Train machine file.
    machine: PathBuf,
    /// Stage, counted from 1.
    stage: usize,
    /// Machine file to write.
    #[arg(short, long)]
    output: PathBuf,
    #[command(flatten)]
    permission: Force,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum BearingKind {
    Ball,
    Roller,
    Plain,
}

#[derive(ClapArgs)]
struct Check {
    /// Machine file, train file (tables `stage`), or a record folder.
    machine: PathBuf,
    /// Of a train: turns of its input that a record would hold, by which lines are told apart.
    #[arg(long, value_name = "N", default_value_t = 1000.0)]
    turns: f64,
    #[command(flatten)]
    results: Results,
}

/// Runs the action.
pub fn run(args: Args) -> Result<()> {
    match args.action {
        Action::New(args) => new(&args),
        Action::Check(args) => check(&args),
        Action::Stage(args) => stage(&args),
        Action::Keys { markdown } => show(&if markdown { keys::markdown() } else { keys::reference() }),
    }
}

fn stage(args: &Stage) -> Result<()> {
    let mut file = args.permission.outputs([args.machine.as_path()]).file(&args.output)?;
    let machine = TrainMachine::read(&args.machine)?;
    let pair = pair_of_stage(&machine, args.stage)?;
    let what = |error: toml::ser::Error| Error::invalid(args.machine.display(), text::one_line(&error.to_string()));
    let tables = toml::to_string(&pair).map_err(what)?;
    file.write(format!("# Stage {} of {}, the rest of the train rigid.\n{tables}", args.stage, pair.title))?;
    say!("written: {}, {} and {} teeth", args.output.display(), pair.pair.teeth[0], pair.pair.teeth[1])
}

fn new(args: &New) -> Result<()> {
    let mut file = args.permission.outputs([]).file(&args.output)?;
    let estimated = estimate(&known(args)?)?;
    file.write(estimated.to_toml())?;
    say!(
        "written: {} with {} guesses, each marked with its rule and factor",
        args.output.display(),
        estimated.guesses.len()
    )?;
    if args.quick {
        return Ok(());
    }
    let progress = Progress::new("guesses", estimated.guesses.len() as u64);
    let found = sensitivity(&estimated, &|| progress.step());
    drop(progress);
    match found {
        Ok(found) => show(&guesses_text(&found)),
        Err(error) => {
            remark!("warning: which guesses move the law cannot be told: {error}");
            Ok(())
        }
    }
}

/// Which guesses move the law, in a sentence and a table.
fn guesses_text(found: &Sensitivity) -> String {
    let percent = |factor: f64| format!("{:.0} %", 100.0 * (factor - 1.0));
    let rows: Vec<Vec<String>> = found
        .shares
        .iter()
        .map(|share| {
            let moves = share.moves.map_or("no edge to time".into(), percent);
            vec![share.guess.key.into(), share.guess.value.clone(), share.guess.reach.to_string(), moves]
        })
        .collect();
    let at: Vec<String> = found
        .speeds_hz
        .iter()
        .zip(found.bandwidth_hz)
        .map(|(speed, hz)| format!("{} at {speed:.3} Hz", hz.map_or("no edge".into(), |hz| format!("{hz:.0} Hz"))))
        .collect();
    format!(
        "\nbandwidth: {}\nby all guesses together within a factor {:.2} (95 %)\n\n{}",
        at.join(", "),
        found.within_factor,
        table(&["guess", "value", "in truth", "moves the law by"], &rows)
    )
}

/// What the wizard can describe, before its first question.
const SCOPE: &str = "one pair of spur gears; of a gearbox with several stages describe the pair nearest to the \
    sensor, the others stay outside; helical and planetary gears are outside the model";

fn known(args: &New) -> Result<Known> {
    if let Some(degrees) = args.helix.filter(|degrees| *degrees != 0.0) {
        let what = format!(
            "{degrees} degrees: helical gears are outside the model; `import`, `analyse`, `loop` on a record and \
             `commission` work without it"
        );
        return Err(Error::invalid("--helix", what));
    }
    let all_given = args.teeth.is_some() && args.module.is_some() && args.width.is_some() && args.speed.is_some();
    if !(all_given && (args.torque.is_some() || args.power.is_some())) && can_ask() {
        remark!("{SCOPE}");
    }
    let teeth = args.teeth.map_or_else(|| asked("teeth of pinion and gear, as 21,64", "--teeth", teeth), Ok)?;
    if teeth[0] > teeth[1] {
        let ratio = f64::from(teeth[0]) / f64::from(teeth[1]);
        remark!(
            "note: {} teeth drive {}: the pair speeds up by {ratio:.2}; the pinion is the one whose speed and torque \
             are given",
            teeth[0],
            teeth[1]
        );
    }
    let positive_or =
        |given: Option<f64>, question: &str, option: &str| given.map_or_else(|| asked(question, option, positive), Ok);
    let module_m = 1e-3 * positive_or(args.module, "module, mm", "--module")?;
    let face_width_m = 1e-3 * positive_or(args.width, "face width, mm", "--width")?;
    let speed =
        args.speed.map_or_else(|| asked("speed of the pinion, as 24.75Hz or 1485rpm", "--speed", turning), Ok)?;
    let speed_hz = speed.0;
    let torque_n_m = match (args.torque, args.power) {
        (Some(torque), _) => torque,
        (None, power) => 1e3 * positive_or(power, "power, kW", "--power or --torque")? / (TAU * speed_hz),
    };
    let bore_radius_m = match args.bores[..] {
        [] => None,
        [pinion, gear] => Some([0.5e-3 * pinion, 0.5e-3 * gear]),
        _ => return Err(Error::invalid("--bores", "needs two diameters, as 20,40")),
    };
    let title = args.output.file_stem().map_or_else(|| "machine".into(), |name| name.to_string_lossy().into_owned());
    Ok(Known {
        title,
        teeth,
        module_m,
        face_width_m,
        speed_hz,
        torque_n_m,
        pressure_angle_deg: args.pressure_angle,
        bore_radius_m,
        ramp_rad: args.ramp.map(|mrad| 1e-3 * mrad),
        relief_m: args.relief.map(|um| 1e-6 * um),
        bearings: args.bearings.map(|kind| match kind {
            BearingKind::Ball => Bearings::Ball,
            BearingKind::Roller => Bearings::Roller,
            BearingKind::Plain => Bearings::Plain,
        }),
    })
}

fn can_ask() -> bool {
    std::io::stdin().is_terminal() && std::io::stderr().is_terminal()
}

/// Asked for in the terminal until the answer can be read; without a terminal the option is named.
fn asked<T>(question: &str, option: &str, read: impl Fn(&str) -> std::result::Result<T, String>) -> Result<T> {
    if !can_ask() {
        return Err(Error::invalid(option, format!("is needed: {question}")));
    }
    loop {
        let mut text = String::new();
        let mut err = std::io::stderr();
        let _ = write!(err, "{question}? ").and_then(|()| err.flush());
        let count = std::io::stdin().read_line(&mut text).map_err(|error| Error::tool("terminal", error))?;
        if count == 0 || interrupt::requested() {
            return Err(Error::invalid(option, format!("no answer: {question}")));
        }
        match read(text.trim()) {
            Ok(value) => return Ok(value),
            Err(why) => remark!("{why}"),
        }
    }
}

/// Two tooth counts, with a comma, a slash or a blank between them.
pub fn teeth(text: &str) -> std::result::Result<[u32; 2], String> {
    /// Fewest and most teeth.
    const RANGE: std::ops::RangeInclusive<u32> = 5..=1000;
    let refuse = || format!("'{}' are not two tooth counts from 5 to 1000, as 21,64", meshband_host::text::name(text));
    let parts = text.split([',', '/', ' ']).filter(|part| !part.is_empty());
    let counts: Vec<u32> =
        parts.map(|part| part.parse().map_err(|_| refuse())).collect::<std::result::Result<_, _>>()?;
    match counts[..] {
        [pinion, gear] if RANGE.contains(&pinion) && RANGE.contains(&gear) => Ok([pinion, gear]),
        _ => Err(refuse()),
    }
}

fn positive(text: &str) -> std::result::Result<f64, String> {
    let value = text.replace(',', ".").parse::<f64>().ok().filter(|value| value.is_finite() && *value > 0.0);
    value.ok_or_else(|| format!("'{}' is no positive number", meshband_host::text::name(text)))
}

fn turning(text: &str) -> std::result::Result<Speed, String> {
    let speed: Speed = text.parse()?;
    if speed.0 > 0.0 && speed.0.is_finite() { Ok(speed) } else { Err("a speed is above zero".into()) }
}

/// What `machine check` says.
#[derive(Serialize)]
struct Explained {
    title: String,
    machine_hash: String,
    teeth: [u32; 2],
    contact_ratio: f64,
    centre_distance_m: f64,
    hunting_turns: u32,
    mean_stiffness_n_per_m: f64,
    iso_6336_n_per_m: f64,
    modes: Vec<Mode>,
    law_domain_hz: [f64; 2],
    law: String,
    warnings: Vec<String>,
}

fn check(args: &Check) -> Result<()> {
    let mut files = args.results.announce(&mut args.results.outputs([args.machine.as_path()]))?;
    let file = if args.machine.is_dir() { args.machine.join("record.toml") } else { args.machine.clone() };
    let declaration = budget::read_text(&file)?;
    if train::page::declares_train(&declaration) {
        let place = file.display().to_string();
        let train = match TrainMachine::is_declared(&declaration) {
            true => TrainMachine::parse(&declaration, &place)?.train,
            false => train::page::read(&place, &declaration)?,
        };
        if !(args.turns.is_finite() && args.turns >= 1.0) {
            return Err(Error::invalid("--turns", format!("{} is no number of turns", args.turns)));
        }
        let explained = train::page::explain(&train, args.turns)?;
        files.write(&explained, || Ok(train::page::report(&explained, &train)))?;
        return show(&train::page::text(&explained));
    }
    let machine = Machine::read(&args.machine)?;
    let explained = explain(&machine)?;
    files.write(&explained, || report(&explained, &machine))?;
    show(&text(&explained))
}

fn explain(machine: &Machine) -> Result<Explained> {
    let stiffness = Stiffness::new(machine, 21)?;
    let rig = Rig::new(machine, Model::BendingTorsional, Damping::Declared)?;
    let domain = Domain::of(machine);
    let law = match (machine.engagement, machine.nominal) {
        (None, _) => "no law: the pair switches on at once ([engagement] is absent), its bandwidth has no limit".into(),
        (Some(_), None) => "no law without an operating point: [nominal] is absent".into(),
        (Some(_), Some(_)) => {
            format!("a law can be fitted from {} to {} Hz (`meshband law fit`)", domain.lowest_hz, domain.highest_hz)
        }
    };
    Ok(Explained {
        title: machine.title.clone(),
        machine_hash: stiffness.machine_hash,
        teeth: machine.pair.teeth,
        contact_ratio: stiffness.contact_ratio,
        centre_distance_m: stiffness.centre_distance_m,
        hunting_turns: Hunting::of(machine.pair.teeth).turns,
        mean_stiffness_n_per_m: stiffness.used.mean,
        iso_6336_n_per_m: stiffness.iso_6336_b.mean_n_per_m,
        modes: modes(&rig.system, rig.mean_stiffness_n_per_m()),
        law_domain_hz: [domain.lowest_hz, domain.highest_hz],
        law,
        warnings: stiffness.warnings,
    })
}

const HEAD: [&str; 4] = ["mode, Hz", "met by the mesh at, Hz", "mesh's share, %", "what moves"];

fn mode_rows(e: &Explained) -> Vec<Vec<String>> {
    let row = |mode: &Mode| {
        let moves: Vec<String> =
            mode.moves.iter().map(|(name, share)| format!("{name} {:.0} %", 100.0 * share)).collect();
        let speed = mode.frequency_hz / f64::from(e.teeth[0]);
        vec![
            format!("{:.1}", mode.frequency_hz),
            format!("{speed:.2}"),
            format!("{:.0}", 100.0 * mode.mesh_share),
            moves.join(", "),
        ]
    };
    e.modes.iter().map(row).collect()
}

/// What the figures mean, sentence by sentence.
fn sentences(e: &Explained) -> Vec<String> {
    let (whole, share) = (e.contact_ratio.floor(), e.contact_ratio.fract());
    vec![
        format!(
            "contact ratio {:.4}: {} pairs carry during {:.0} % of each mesh period, {whole} during the rest",
            e.contact_ratio,
            whole + 1.0,
            100.0 * share
        ),
        format!(
            "the same teeth meet again after {} turns of the pinion; centre distance {:.3} mm",
            e.hunting_turns,
            1e3 * e.centre_distance_m
        ),
        format!(
            "mean mesh stiffness {:.4e} N/m, {:+.1} % against ISO 6336-1 method B",
            e.mean_stiffness_n_per_m,
            100.0 * (e.mean_stiffness_n_per_m / e.iso_6336_n_per_m - 1.0)
        ),
        e.law.clone(),
    ]
}

fn text(e: &Explained) -> String {
    let mut out = format!("machine {}, hash {}\n", e.title, e.machine_hash);
    sentences(e).iter().for_each(|sentence| out += &format!("{sentence}\n"));
    out += &format!(
        "\nnatural frequencies at the mean mesh stiffness; a pinion at the speed beside it meets them with its \
         mesh\n{}",
        table(&HEAD, &mode_rows(e))
    );
    e.warnings.iter().for_each(|warning| out += &format!("warning: {warning}\n"));
    out
}

fn report(e: &Explained, machine: &Machine) -> Result<Report> {
    let mut page = Report::new(&format!("Machine {}", machine.title), &format!("hash {}", e.machine_hash))
        .figure("Teeth", format!("{} / {}", e.teeth[0], e.teeth[1]))
        .figure("Contact ratio", format!("{:.4}", e.contact_ratio))
        .figure("Mean stiffness", format!("{:.1} N/um", 1e-6 * e.mean_stiffness_n_per_m));
    for sentence in sentences(e) {
        page = page.text(&sentence);
    }
    page = page.section("Natural frequencies").table("At the mean mesh stiffness.", &HEAD, &mode_rows(e));
    Ok(e.warnings.iter().fold(page, |page, warning| page.note(warning)))
}
