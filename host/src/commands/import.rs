//! `meshband import`: measurement files into a record folder.

mod page;
mod tach;

use clap::{Args as ClapArgs, ValueEnum};
use meshband_host::import::tach::{Shaft, TachOptions};
use meshband_host::import::{self, ImportOptions, ImportSummary, Reading, TachChoice, Unit};
use meshband_host::machine::Machine;
use meshband_host::machine::bearing::Bearing;
use meshband_host::output::{Content, show};
use meshband_host::part::Part;
use meshband_host::results::Results;
use meshband_host::train::Train;
use meshband_host::{Error, Result, say, terminal};
use std::path::{Path, PathBuf};

/// Arguments of `meshband import`.
#[derive(ClapArgs)]
pub struct Args {
    /// MATLAB, HDF5, TDMS, LabVIEW, csv and other text, wav, FLAC, npy or uff58 files; of equal length: channels of
    /// one run.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Folder of the new record.
    #[arg(short, long)]
    output: PathBuf,
    /// Sampling rate, Hz; needed where the files state none.
    #[arg(long)]
    rate: Option<f64>,
    /// Take --rate although a file states another one.
    #[arg(long, requires = "rate")]
    override_rate: bool,
    /// Text: whether numbers have decimal points or decimal commas, where the file leaves it open.
    #[arg(long, value_enum)]
    decimal: Option<Decimal>,
    /// No column is time: the first one is a channel, too.
    #[arg(long)]
    no_time: bool,
    /// Unit of a time column that states none, as s, ms, us, ns or min.
    #[arg(long, value_name = "UNIT", conflicts_with = "no_time")]
    time_unit: Option<String>,
    /// Columns to read, by name or number (from 1, time included), separated by commas; all otherwise. Time and
    /// tachometer stay.
    #[arg(long, value_delimiter = ',')]
    columns: Vec<String>,
    /// Columns to leave out, by name or number, separated by commas.
    #[arg(long, value_delimiter = ',')]
    skip: Vec<String>,
    /// Second from which the recording is taken, 0 for its first sample.
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    from: Option<f64>,
    /// Second up to which the recording is taken.
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    to: Option<f64>,
    /// Tooth counts of pinion and gear, as 23,46 or 23/46.
    #[arg(long, value_parser = super::machine::teeth)]
    teeth: Option<[u32; 2]>,
    /// Mesh frequency as far as known, Hz (within 3 %); searched for otherwise. FROM,TO: it changes within that range.
    #[arg(long, value_delimiter = ',', num_args = 1)]
    mesh: Vec<f64>,
    /// Unit of channels whose file states none (m/s2, g, mg, V, N m and so on, or unknown); one, or one for each,
    /// separated by commas.
    #[arg(long, value_delimiter = ',')]
    unit: Vec<String>,
    /// Take --unit although a file states another one.
    #[arg(long, requires = "unit")]
    override_unit: bool,
    /// Sensitivity, V per g: turns volts into m/s2; one for all channels, or one for each, separated by commas.
    #[arg(long, value_delimiter = ',')]
    volt_per_g: Vec<f64>,
    /// Names of the channels, separated by commas.
    #[arg(long, value_delimiter = ',')]
    channel_names: Option<Vec<String>>,
    /// Value of the largest code, in the record's unit; 10 % over the peak otherwise.
    #[arg(long)]
    full_scale: Option<f64>,
    /// What the largest number of an integer file stands for, in --unit: one, one per channel, or a csv file with one
    /// row per channel.
    #[arg(long, value_name = "VALUES|FILE")]
    source_full_scale: Option<String>,
    /// Keep samples as float32 values instead of 16-bit codes of one full scale.
    #[arg(long)]
    float: bool,
    /// Torque at the pinion's shaft, N m; one for all runs, or one for each, separated by commas.
    #[arg(long, value_delimiter = ',', allow_negative_numbers = true)]
    torque: Vec<f64>,
    /// Load of every run in any one unit (percent), separated by commas: the loop then looks for a law of the speed
    /// against it.
    #[arg(long, value_delimiter = ',', allow_negative_numbers = true)]
    load: Vec<f64>,
    /// The rig has one shaft and no gears.
    #[arg(long, conflicts_with_all = ["teeth", "machine"])]
    no_gears: bool,
    /// Bearing by designation, on the pinion's shaft or on SHAFT: `6205`, `gear=6203`; once for each. By dimensions
    /// or orders: `[[bearing]]` in record.toml.
    #[arg(long = "bearing", value_name = "[SHAFT=]DESIGNATION")]
    bearings: Vec<String>,
    /// No tachometer was recorded; the shaft turns at this constant speed, rpm.
    #[arg(long, value_name = "RPM", conflicts_with_all = ["no_tach", "tach"])]
    speed: Option<f64>,
    /// Train file (tables `stage`): the record then declares all stages, and its `tach` says shaft and pulses of the
    /// tachometer.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["teeth", "machine", "no_gears"])]
    train: Option<PathBuf>,
    /// Machine file: the record then declares the whole machine, its tooth counts included.
    #[arg(long, value_name = "FILE")]
    machine: Option<PathBuf>,
    /// Make every file a run of its own.
    #[arg(long)]
    runs: bool,
    #[command(flatten)]
    tach: tach::TachArgs,
    /// Make no virtual tach.
    #[arg(long)]
    no_tach: bool,
    /// Remove each channel's mean.
    #[arg(long)]
    remove_mean: bool,
    /// Title of the record; the output folder's name otherwise.
    #[arg(long)]
    title: Option<String>,
    #[command(flatten)]
    results: Results,
}

#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
enum Decimal {
    Point,
    Comma,
}

/// A bearing from `[SHAFT=]DESIGNATION`.
fn bearing(text: &str) -> Bearing {
    let (shaft, designation) = text.split_once('=').unwrap_or(("pinion", text));
    let (shaft, designation) = (shaft.trim().to_owned(), designation.trim().to_owned());
    Bearing { name: designation.clone(), shaft, designation: Some(designation), ..Bearing::default() }
}

/// Imports the files, writes the record, prints what was found.
pub fn run(args: Args) -> Result<()> {
    let machine = args.machine.as_deref().map(Machine::read).transpose()?;
    let train = args.train.as_deref().map(Train::read).transpose()?;
    let given = train.as_ref().and_then(|train| train.declaration.as_pair());
    let teeth = import::teeth(machine.as_ref(), given.or(args.teeth))?;
    let (mesh_guess_hz, mesh_range_hz) = mesh(&args.mesh)?;
    let measured = match &train {
        Some(train) => train_tach(train, args.tach.options()?, !args.no_tach && args.speed.is_none())?,
        None => args.tach.options()?,
    };
    let name = args.output.file_name().map_or_else(|| "import".into(), |name| name.to_string_lossy().into_owned());
    let options = ImportOptions {
        title: args.title.unwrap_or(name),
        reading: Reading {
            decimal_comma: args.decimal.map(|decimal| decimal == Decimal::Comma),
            no_time: args.no_time,
            time_unit_s: args.time_unit.as_deref().map(time_unit).transpose()?,
            columns: args.columns,
            skip: args.skip,
            part: Part::new(args.from, args.to)?,
            ..Reading::default()
        },
        rate_hz: args.rate,
        override_rate: args.override_rate,
        teeth,
        train,
        mesh_guess_hz,
        mesh_range_hz,
        units: units(&args.unit, &args.volt_per_g)?,
        override_unit: args.override_unit,
        channel_names: args.channel_names,
        full_scale: args.full_scale,
        source_full_scale: args.source_full_scale.as_deref().map_or(Ok(Vec::new()), full_scales)?,
        float: args.float,
        torques_n_m: args.torque,
        loads: args.load,
        no_gears: args.no_gears,
        bearings: args.bearings.iter().map(|text| bearing(text)).collect(),
        machine,
        files_are_runs: args.runs,
        tach: match measured {
            Some(tach) => TachChoice::Measured(tach),
            None if args.no_tach => TachChoice::None,
            None if args.speed.is_some() => TachChoice::Nominal(args.speed.unwrap_or(f64::NAN) / 60.0),
            None => TachChoice::Virtual,
        },
        remove_mean: args.remove_mean,
    };
    let mut read = args.files.clone();
    read.extend(args.tach.files());
    read.extend(args.machine.iter().chain(&args.train).cloned());
    read.extend(args.source_full_scale.iter().map(PathBuf::from).filter(|path| path.is_file()));
    let mut outputs = args.results.outputs(read.iter().map(PathBuf::as_path));
    let folder = outputs.folder(&args.output, Content::Record)?;
    let mut files = args.results.announce(&mut outputs)?;
    let (record, summary) = import::import(&args.files, &options)?;
    record.write_to(folder)?;
    files.write(&summary, || page::page(&options.title, &record, &summary))?;
    print(&summary)
}

/// The tachometer that a train declares, on the channel that `given` names or on the one that looks like it; `given`
/// itself where none is declared.
fn train_tach(train: &Train, given: Option<TachOptions>, wanted: bool) -> Result<Option<TachOptions>> {
    let Some(declared) = train.declaration.tachs.first().filter(|_| wanted) else { return Ok(given) };
    let ratio = train.shaft_order(declared.shaft).value();
    let (falling, threshold) = given.as_ref().map_or((None, None), |given| (given.falling, given.threshold));
    let own = || declared.source.iter().cloned().collect();
    let sources = given.map_or_else(own, |given| given.sources);
    let shaft = if declared.shaft == 0 { Shaft::Pinion } else { Shaft::Ratio(ratio) };
    Ok(Some(TachOptions { sources, pulses: declared.pulses_per_turn, shaft, falling, threshold }))
}

/// A guess of the mesh frequency, or a range.
fn mesh(given: &[f64]) -> Result<(Option<f64>, Option<[f64; 2]>)> {
    match *given {
        [] => Ok((None, None)),
        [guess] => Ok((Some(guess), None)),
        [from, to] => Ok((None, Some([from, to]))),
        _ => Err(Error::invalid("--mesh", "needs one frequency, or a range as 350,720")),
    }
}

/// Full scales from a list, or from a file of that name.
fn full_scales(text: &str) -> Result<Vec<f64>> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    numbers.map_or_else(|| import::read_full_scales(Path::new(text)), Ok)
}

/// Seconds of a unit of time.
fn time_unit(text: &str) -> Result<f64> {
    let unit = import::units::measure(text).filter(|unit| unit.quantity == import::units::Quantity::Time);
    let refuse = || Error::invalid("--time-unit", format!("'{text}' is no unit of time such as s, ms, us, ns or min"));
    unit.map(|unit| unit.factor).ok_or_else(refuse)
}

/// One unit for all channels, or one for each: as many as units or sensitivities are given; none where none is said.
fn units(units: &[String], volt_per_g: &[f64]) -> Result<Vec<Unit>> {
    let count = units.len().max(volt_per_g.len());
    for (name, given) in [("--unit", units.len()), ("--volt-per-g", volt_per_g.len())] {
        if given > 1 && given != count {
            return Err(Error::invalid(
                name,
                format!("{given} values, there are {count} of the other for the channels"),
            ));
        }
    }
    let sensitivity = |c: usize| volt_per_g.get(c % volt_per_g.len().max(1)).copied();
    if let Some(other) = sensitivity(0).filter(|volt_per_g| !(volt_per_g.is_finite() && *volt_per_g > 0.0)) {
        return Err(Error::invalid("--volt-per-g", format!("{other} is not a positive number")));
    }
    let unit = |c: usize| match units.get(c % units.len().max(1)) {
        None => Ok(Unit::Volt(sensitivity(c))),
        Some(text) => match Unit::parse(text).map_err(|what| Error::invalid("--unit", what))? {
            Unit::Volt(_) => Ok(Unit::Volt(sensitivity(c))),
            other => Ok(other),
        },
    };
    (0..count).map(unit).collect()
}

/// Name and value of every quality figure of a run's tach.
fn tach_rows(summary: &ImportSummary) -> Vec<Vec<String>> {
    let row = |(i, q): (usize, &meshband_host::import::virtual_tach::Quality)| {
        vec![
            format!("{i}"),
            format!("{:.3}", q.mesh_hz),
            format!("{:.4}", q.speed_hz),
            format!("{:.3}", q.speed_std_rpm),
            format!("{} x{}", summary.channels.get(q.channel).map_or("?", String::as_str), q.harmonic),
            format!("{:.1}", q.line_snr_db),
            format!("{:.2}", 1e6 * q.jitter_s),
            q.cross_check_s.map_or("-".into(), |s| format!("{:.2}", 1e6 * s)),
            q.mesh_over_pinion_line.map_or("-".into(), |r| format!("{r:.3}")),
        ]
    };
    summary.tach.iter().enumerate().map(row).collect()
}

const TACH_HEAD: [&str; 9] = [
    "run",
    "mesh, Hz",
    "pinion, Hz",
    "speed std, rpm",
    "line used",
    "line SNR, dB",
    "jitter, us",
    "cross-check, us",
    "mesh / 1x",
];

fn print(summary: &ImportSummary) -> Result<()> {
    let rows: Vec<Vec<String>> = summary
        .channels
        .iter()
        .zip(&summary.quantisation_snr_db)
        .map(|(name, snr)| vec![name.clone(), if snr.is_finite() { format!("{snr:.1}") } else { "constant".into() }])
        .collect();
    say!(
        "{} run(s) of {} samples at {} Hz, full scale {} {}",
        summary.samples.len(),
        summary.samples.iter().map(usize::to_string).collect::<Vec<_>>().join(", "),
        summary.sample_rate_hz,
        summary.full_scale,
        summary.unit
    )?;
    if !rows.is_empty() {
        show(&terminal::table(&["channel", "over quantisation, dB"], &rows))?;
    }
    if !summary.tach.is_empty() {
        say!("\nvirtual tach from the mesh line's phase (tooth index and angle 0 are unknown)")?;
        show(&terminal::table(&TACH_HEAD, &tach_rows(summary)))?;
    }
    tach::print(summary)?;
    summary.remarks.iter().try_for_each(|remark| say!("note: {remark}"))
}
