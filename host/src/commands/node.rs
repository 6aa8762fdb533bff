//! `meshband node`: the real firmware on a virtual board, fed with a run of a record, or with a machine simulated for
//! the purpose.

use clap::{Args as ClapArgs, ValueEnum};
use meshband::config::Configuration;
use meshband::law::Law;
use meshband_emulator::board::CYCLES_PER_INSTRUCTION;
use meshband_host::dynamics::simulate::Acquisition;
use meshband_host::law::file::LawFile;
use meshband_host::machine::{Hunting, Machine};
use meshband_host::output::{interrupt, show};
use meshband_host::record::Record;
use meshband_host::results::Results;
use meshband_host::speed::Speed;
use meshband_host::virtual_node::emulated::run::Emulated;
use meshband_host::virtual_node::profile::Pace;
use meshband_host::virtual_node::qemu::{Qemu, built_firmware};
use meshband_host::virtual_node::setup::configuration;
use meshband_host::virtual_node::signal::{Operation, Signal, Unit};
use meshband_host::virtual_node::stations::Stations;
use meshband_host::virtual_node::summary::{self, Table};
use meshband_host::virtual_node::trial::{self, Trial};
use meshband_host::virtual_node::{peers, serve};
use meshband_host::virtual_node::{profile, report};
use meshband_host::{Error, Result, effects, remark, say, terminal};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};

/// Longest signal that is simulated, s.
const MOST_S: f64 = 60.0;
/// Turns of the pinion beyond whole hunting periods that a loop is cut from.
const SPARE_TURNS: f64 = 3.0;
/// Relative jump of the speed at a loop's seam from which on it is said.
const SPEED_JUMP: f64 = 0.02;

/// Arguments of `meshband node`.
#[derive(ClapArgs)]
pub struct Args {
    /// Record folder, or machine file to simulate.
    #[arg(required_unless_present = "looped")]
    input: Option<PathBuf>,
    /// Run of the record.
    #[arg(long, default_value_t = 0)]
    run: usize,
    /// Channel: its number from 0, its name, or a part of it (machine: 0 pinion bearing, 1 gear bearing).
    #[arg(long, default_value = "0")]
    channel: String,
    /// Channel of a second sensor, named alike: for an emulated STM32F405 and for --serve; an386 has one converter.
    #[arg(long, value_name = "CHANNEL")]
    second: Option<String>,
    /// Board: an386 in QEMU, or an emulated STM32F405 with the very image that is flashed.
    #[arg(long, value_enum, default_value = "an386")]
    board: BoardName,
    /// Start of the stretch to replay, s; the memory of an386 holds 8.3 s.
    #[arg(long, default_value_t = 0.0)]
    start: f64,
    /// Length of the stretch, s; the rest of the run, or 3 s of a machine, with --serve long enough for both shafts
    /// to come round.
    #[arg(long)]
    duration: Option<f64>,
    /// Unit of the amplitudes shown.
    #[arg(long, value_enum)]
    unit: Option<ShownUnit>,
    /// Machine: pinion speed, as 24.75Hz or 1485rpm (a bare number is Hz); its nominal speed otherwise.
    #[arg(long)]
    speed: Option<Speed>,
    /// Machine: run-up between two pinion speeds, as 3,25 or 180rpm,1500rpm; with --serve it comes down again.
    #[arg(long, value_delimiter = ',', conflicts_with = "speed")]
    run_up: Option<Vec<Speed>>,
    /// Machine: torque at the motor, N m; its nominal torque otherwise.
    #[arg(long)]
    torque: Option<f64>,
    /// Machine: effect, `name:key=value,...`; may be repeated.
    #[arg(long = "effect")]
    effects: Vec<String>,
    /// Machine: tach pulses per turn of the pinion.
    #[arg(long, default_value_t = 8)]
    pulses: u32,
    /// Machine: rate of the signal on the wire, Hz; its anti-alias filter is flat to 0.4 of it.
    #[arg(long, default_value_t = 204_800.0)]
    signal_rate: f64,
    /// Law of the machine (law.toml of `law fit` or `law learn`); otherwise the one that the node is built with.
    #[arg(long, value_name = "FILE")]
    law: Option<PathBuf>,
    /// Forces the converter's rate, Hz, without decimation, whatever the law says: aliases are then real.
    #[arg(long)]
    rate: Option<f64>,
    /// Serves a live node on the looped signal at tcp:PORT or tcp:HOST:PORT (0: any free port) until Ctrl-C, for
    /// `monitor` and `configure`.
    #[arg(long, value_name = "tcp:PORT", conflicts_with_all = ["json", "report", "runs", "profile", "rate"])]
    serve: Option<String>,
    /// With --serve: the record or machine, which is looped.
    #[arg(long = "loop", value_name = "RECORD|MACHINE", requires = "serve", conflicts_with = "input")]
    looped: Option<PathBuf>,
    /// With --serve: the node as a Modbus station, too: tcp:PORT, or rtu at a pseudo-terminal; may be repeated.
    #[arg(long, value_name = "tcp:PORT|rtu", requires = "serve")]
    modbus: Vec<String>,
    /// Runs on the board; more than one are compared byte for byte.
    #[arg(long, default_value_t = 1)]
    runs: usize,
    /// Instruction rate in QEMU: 1000 MIPS over 2 to this power.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u8).range(0..=8))]
    icount_shift: u8,
    /// Cycles per instruction of the emulated STM32F405, 1 to 4.
    #[arg(long, default_value_t = CYCLES_PER_INSTRUCTION)]
    cycles_per_instruction: f64,
    /// In QEMU, runs the record at other instruction rates, too, and says from which on the node keeps up.
    #[arg(long)]
    profile: bool,
    /// Firmware image; without it the one that `cargo xtask node-build` made.
    #[arg(long)]
    firmware: Option<PathBuf>,
    #[command(flatten)]
    results: Results,
}

impl Args {
    /// Record or machine, however it was named.
    fn input(&self) -> &Path {
        self.input.as_deref().or(self.looped.as_deref()).unwrap_or(Path::new(""))
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum BoardName {
    /// QEMU's mps2-an386
    An386,
    /// emulated STM32F405
    Stm32f405,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum ShownUnit {
    /// m/s2
    #[value(name = "m/s2")]
    Acceleration,
    /// multiples of standard gravity
    #[value(name = "g")]
    Gravity,
}

/// Replays the signal, prints what the node reported, and compares its lines with the f64 reference.
pub fn run(args: Args) -> Result<()> {
    let input = args.input();
    let inputs = std::iter::once(input).chain(args.law.as_deref());
    let mut files = args.results.announce(&mut args.results.outputs(inputs))?;
    let law = match &args.law {
        Some(path) => Some(LawFile::read(path)?),
        None => own_law(&args),
    };
    let mut signal = if is_record(input) { of_record(&args)? } else { of_machine(&args)? };
    if let Some(unit) = args.unit {
        if signal.unit != Unit::Acceleration {
            return Err(Error::invalid("--unit", format!("the record is in {}, not in m/s2", signal.unit)));
        }
        signal.unit = match unit {
            ShownUnit::Acceleration => Unit::Acceleration,
            ShownUnit::Gravity => Unit::Gravity,
        };
    }
    if args.second.is_some() && args.serve.is_none() && args.board == BoardName::An386 {
        return Err(Error::invalid("--second", "an386 has one converter: --board stm32f405, or --serve"));
    }
    let mut config = configuration(&signal, args.rate)?;
    if let Some(file) = &law {
        config.law = file.for_node()?;
    }
    signal.notes.extend(whose_law(&config.law, signal.machine_hash));
    if let Some(port) = &args.serve {
        return live(&args, &signal, &config, port);
    }
    let (trial, paces) = match args.board {
        BoardName::An386 => in_qemu(&args, &signal, &config)?,
        BoardName::Stm32f405 => (emulated(&args, &signal, &config)?, Vec::new()),
    };
    let value = serde_json::json!({
        "title": signal.title,
        "channel": signal.channel,
        "unit": signal.unit.to_string(),
        "notes": signal.notes,
        "trial": trial,
        "paces": paces,
    });
    files.write(&value, || report::build(&trial, &signal, &paces))?;
    print(&trial, &signal)?;
    if paces.is_empty() {
        return Ok(());
    }
    say!("")?;
    print_table(&summary::paces(&paces))
}

/// A node in real time until it is told to end.
fn live(args: &Args, signal: &Signal, config: &Configuration, port: &str) -> Result<()> {
    let address = peers::address("--serve", port)?;
    let stations = Stations::new(&args.modbus, &config.link)?;
    signal.notes.iter().for_each(|note| remark!("note: {note}"));
    interrupt::only_ask();
    serve::serve(signal, config, &address, stations, |ready| announce(signal, &ready), interrupt::requested)
}

/// Where the node is, and what of its loop is not as in a machine that turns on.
fn announce(signal: &Signal, ready: &serve::Ready<'_>) -> Result<()> {
    let (address, repeated) = (ready.address, ready.repeated);
    say!(
        "node of {} at tcp:{address}, {:.2} s looped; `meshband monitor tcp:{address}` shows it, Ctrl-C ends it",
        signal.title,
        repeated.seconds()
    )?;
    ready.stations.iter().try_for_each(|station| say!("{station}; its registers: `meshband modbus -o map.csv`"))?;
    if repeated.jump_deg() > 0.0 {
        let turns = Hunting::of(signal.teeth).turns;
        remark!(
            "note: the signal is shorter than {turns} turns of the pinion, after which both shafts come round: one \
             shaft jumps by {:.0} degrees once per loop",
            repeated.jump_deg()
        );
    }
    let [before, behind] = repeated.speeds_hz();
    if (before / behind - 1.0).abs() > SPEED_JUMP {
        remark!(
            "note: the speed jumps from {before:.2} to {behind:.2} Hz once per loop: the signal ends at another than \
             it begins with"
        );
    }
    Ok(())
}

/// A machine that is served gets its own law where one can be fitted: rates are then those of this machine.
fn own_law(args: &Args) -> Option<LawFile> {
    if args.serve.is_none() || is_record(args.input()) {
        return None;
    }
    progress("fitting the machine's law");
    let file = super::law::for_node(args.input());
    file.map_err(|error| remark!("note: no law of this machine can be fitted ({error}); the built-in one serves")).ok()
}

/// What must be said of a law that is not known to be the machine's own.
fn whose_law(law: &Law, machine: Option<u64>) -> Option<String> {
    let own = "--law FILE gives the node its own (`law fit`, `law learn`)";
    match machine {
        Some(hash) if hash == law.machine_hash => None,
        Some(_) if law.machine_hash != 0 => {
            Some(format!("the bandwidth law is another machine's: rates follow it, not this machine; {own}"))
        }
        _ => Some(format!("whether the bandwidth law is this machine's cannot be told; {own}")),
    }
}

fn in_qemu(args: &Args, signal: &Signal, config: &Configuration) -> Result<(Trial, Vec<Pace>)> {
    let firmware = args.firmware.clone().unwrap_or_else(|| built_firmware("an386"));
    let qemu = Qemu { icount_shift: args.icount_shift, ..Qemu::new(firmware) };
    progress(&format!("{:.2} s of {}, {}, in QEMU", signal.duration_s(), signal.title, signal.channel));
    let trial = trial::run(signal, config, &qemu, args.runs)?;
    let paces = if args.profile { profile::run(signal, config, &qemu)? } else { Vec::new() };
    Ok((trial, paces))
}

fn emulated(args: &Args, signal: &Signal, config: &Configuration) -> Result<Trial> {
    if args.profile {
        return Err(Error::invalid("--profile", "is for an386; --cycles-per-instruction sets the pace of stm32f405"));
    }
    let cycles_per_instruction = args.cycles_per_instruction;
    if !(1.0..=4.0).contains(&cycles_per_instruction) {
        let what = format!("{cycles_per_instruction} is not within 1 to 4");
        return Err(Error::invalid("--cycles-per-instruction", what));
    }
    let firmware = args.firmware.clone().unwrap_or_else(|| built_firmware("stm32f405"));
    let board = Emulated { cycles_per_instruction, ..Emulated::new(firmware) };
    progress(&format!("{:.2} s of {}, {}, emulated", signal.duration_s(), signal.title, signal.channel));
    trial::run(signal, config, &board, args.runs)
}

/// Folders are records; of files only a `record.toml` belongs to one.
fn is_record(input: &Path) -> bool {
    input.is_dir() || input.file_name().is_some_and(|name| name == "record.toml")
}

fn of_record(args: &Args) -> Result<Signal> {
    let given = [
        ("--speed", args.speed.is_some()),
        ("--run-up", args.run_up.is_some()),
        ("--torque", args.torque.is_some()),
        ("--effect", !args.effects.is_empty()),
    ];
    if let Some((option, _)) = given.iter().find(|(_, is)| *is) {
        return Err(Error::invalid(option, "is for machines; a record has its own"));
    }
    let channels = (args.channel.as_str(), args.second.as_deref());
    Signal::of_record(&Record::read(args.input())?, args.run, channels, args.start, args.duration)
}

fn of_machine(args: &Args) -> Result<Signal> {
    let machine = Machine::read(args.input())?;
    let nominal = |value: Option<f64>, option: &str, nominal: Option<f64>| {
        let value = value.or(nominal).ok_or_else(|| {
            Error::invalid(option, format!("is needed: {} has no [nominal] operating point", args.input().display()))
        })?;
        if value.is_finite() && value > 0.0 {
            Ok(value)
        } else {
            Err(Error::invalid(option, format!("{value} is not a positive number")))
        }
    };
    let (speed_hz, final_speed_hz) = match args.run_up.as_deref() {
        None => (nominal(args.speed.map(|speed| speed.0), "--speed", machine.nominal.map(|n| n.speed_hz))?, None),
        Some(&[Speed(from), Speed(to)]) if [from, to].iter().all(|hz| hz.is_finite() && *hz > 0.0) => (from, Some(to)),
        Some(_) => return Err(Error::invalid("--run-up", "needs two positive speeds, as 3Hz,25Hz or 180rpm,1500rpm")),
    };
    let torque_n_m = nominal(args.torque, "--torque", machine.nominal.map(|n| n.torque_n_m))?;
    let effects = args.effects.iter().map(|text| effects::parse(text)).collect::<Result<Vec<_>>>()?;
    let body = |wanted: &str, option: &str| match wanted {
        "0" | "pinion" => Ok(0),
        "1" | "gear" => Ok(1),
        other => Err(Error::invalid(option, format!("'{other}': a machine has 0 (pinion) and 1 (gear)"))),
    };
    let channel = body(&args.channel, "--channel")?;
    let second = args.second.as_deref().map(|wanted| body(wanted, "--second")).transpose()?;
    // Turns in which both shafts come round, and a few more to cut in.
    let round_s = (f64::from(Hunting::of(machine.pair.teeth).turns) + SPARE_TURNS) / speed_hz;
    let back_s = (args.serve.is_some() && final_speed_hz.is_some()).then_some(round_s.min(MOST_S / 2.0));
    let usual_s = match (final_speed_hz, &args.serve) {
        (Some(_), _) => 8.0,
        (None, Some(_)) => round_s.clamp(3.0, MOST_S),
        (None, None) => 3.0,
    };
    let duration_s = args.duration.unwrap_or(usual_s);
    if !(0.1..=MOST_S).contains(&duration_s) {
        return Err(Error::invalid("--duration", format!("{duration_s} s is not within 0.1 to {MOST_S} s")));
    }
    let duration_s = duration_s + back_s.unwrap_or(0.0);
    let acquisition = Acquisition {
        rate_hz: args.signal_rate,
        duration_s,
        pulses_per_turn: args.pulses,
        jitter_s: 0.0,
        noise_m_s2: 0.0,
        seed: 1,
    };
    let effects = &effects[..];
    let operation = Operation { speed_hz, final_speed_hz, back_s, torque_n_m, effects, acquisition, channel, second };
    progress(&format!("simulating {duration_s} s of {}", machine.title));
    Signal::of_machine(&machine, &operation)
}

/// One line for who is watching; logs and pipes stay clean.
fn progress(what: &str) {
    if std::io::stderr().is_terminal() {
        remark!("node: {what} ...");
    }
}

fn print_table(table: &Table) -> Result<()> {
    show(&terminal::table(&table.head, &table.rows))
}

fn print(trial: &Trial, signal: &Signal) -> Result<()> {
    say!("\nspeed of the pinion and rates")?;
    print_table(&summary::rates(trial, 16))?;
    if let Some(table) = summary::lines(trial, false) {
        say!("\nmesh harmonics, amplitudes in {}, against the f64 reference", signal.unit)?;
        print_table(&table)?;
    }
    let forced = trial.rates.first().is_some_and(|r| r.adc_hz == r.granted_hz && trial.peaks.iter().any(|p| p.folded));
    if forced || trial.spectra.is_empty() {
        say!("\nwideband peaks, lines {:.2} Hz apart", trial.peak_resolution_hz)?;
        print_table(&summary::peaks(trial))?;
    }
    say!("")?;
    let lines = summary::verdicts(trial, signal);
    let width = lines.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    lines.into_iter().try_for_each(|(name, value)| say!("{name:<width$}  {value}"))
}
