//! Puts imported channels into a record: units, full scale, a measured tach, a virtual one, or none.

use super::grouped::{Group, grouped, rate, short};
use super::quantities::{self, Unit};
use super::tach::{self, TachFigures, TachOptions};
use super::virtual_tach::{Options, Quality, followed, virtual_tach};
use super::{Columns, Reading, declared, quantisation, read_as};
use crate::budget::VALUES;
use crate::data_quality::{self, mesh, pulsed::Pulsed, steps};
use crate::machine::Machine;
use crate::machine::bearing::Bearing;
use crate::record::{
    Acquisition, Beside, BesideDeclaration, FLOAT_BITS, PART, Record, Run, RunDeclaration, Tach, suggested_full_scale,
};
use crate::train::Train;
use crate::{Error, Result};
use rayon::prelude::*;
use serde::Serialize;
use std::path::PathBuf;
use toml::{Table, Value};

/// Where a record's pulses come from.
#[derive(Debug, Clone, PartialEq)]
pub enum TachChoice {
    /// From the mesh line.
    Virtual,
    /// The record has none.
    None,
    /// None was recorded; the pinion's (or only) shaft turns at this constant speed, turns per second.
    Nominal(f64),
    /// From a tachometer that was recorded.
    Measured(TachOptions),
}

/// How to import.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportOptions {
    /// Title of the record.
    pub title: String,
    /// How the files are read where they leave it open.
    pub reading: Reading,
    /// Sampling rate, Hz, required where the files say nothing; where they do, it must agree with them.
    pub rate_hz: Option<f64>,
    /// The files' own rate is wrong: `rate_hz` holds against it.
    pub override_rate: bool,
    /// Tooth counts; required for the virtual tach, checked against a measured one.
    pub teeth: Option<[u32; 2]>,
    /// The train, where it is one.
    pub train: Option<Train>,
    /// Mesh frequency as far as known, Hz.
    pub mesh_guess_hz: Option<f64>,
    /// Range that the mesh frequency stays within where it changes much (a run-up), Hz; the speed is then followed.
    pub mesh_range_hz: Option<[f64; 2]>,
    /// Units of the source where it states none: one for all channels, or one for each; empty: none is said.
    pub units: Vec<Unit>,
    /// The files' own units are wrong: `units` hold against them.
    pub override_unit: bool,
    /// Channel names instead of those of the files.
    pub channel_names: Option<Vec<String>>,
    /// Full scale in the record's unit; 10 % over the peak where absent.
    pub full_scale: Option<f64>,
    /// What the largest number of a source of integers stands for, in the source's unit: one, or one for each
    /// channel; empty: the source's numbers are values.
    pub source_full_scale: Vec<f64>,
    /// Samples are kept as float32 values instead of codes of one full scale.
    pub float: bool,
    /// Torques at the pinion's shaft, N m: one, or one for each run; empty where unknown.
    pub torques_n_m: Vec<f64>,
    /// Loads in any one unit: one for each run; empty where unknown.
    pub loads: Vec<f64>,
    /// The rig has one shaft and no gears.
    pub no_gears: bool,
    /// The bearings, where they are known.
    pub bearings: Vec<Bearing>,
    /// The machine, where it is known.
    pub machine: Option<Machine>,
    /// Each file is a run of its own instead of channels of one run.
    pub files_are_runs: bool,
    /// Where the pulses come from.
    pub tach: TachChoice,
    /// Remove each channel's mean (volts with an offset would waste codes).
    pub remove_mean: bool,
}

impl Default for ImportOptions {
    /// One run of one file in m/s2, without a tachometer.
    fn default() -> Self {
        Self {
            title: "import".into(),
            reading: Reading::default(),
            rate_hz: None,
            override_rate: false,
            teeth: None,
            train: None,
            mesh_guess_hz: None,
            mesh_range_hz: None,
            units: vec![Unit::MetrePerSecondSquared],
            override_unit: false,
            channel_names: None,
            full_scale: None,
            source_full_scale: Vec::new(),
            float: false,
            torques_n_m: Vec::new(),
            loads: Vec::new(),
            no_gears: false,
            bearings: Vec::new(),
            machine: None,
            files_are_runs: false,
            tach: TachChoice::None,
            remove_mean: false,
        }
    }
}

/// What an import did, for printing.
#[derive(Debug, Clone, Serialize)]
pub struct ImportSummary {
    /// Source files.
    pub files: Vec<PathBuf>,
    /// Sampling rate, Hz.
    pub sample_rate_hz: f64,
    /// Samples of each run.
    pub samples: Vec<usize>,
    /// Channel names.
    pub channels: Vec<String>,
    /// Value of code 32767.
    pub full_scale: f64,
    /// Unit of the record.
    pub unit: String,
    /// Names of what is kept beside the channels.
    pub beside: Vec<String>,
    /// Typical level over quantisation noise per channel, the worst of the runs, dB; empty for float samples.
    pub quantisation_snr_db: Vec<f64>,
    /// Virtual tach of each run; empty without.
    pub tach: Vec<Quality>,
    /// Measured tach of each run; empty without.
    pub measured_tach: Vec<TachFigures>,
    /// Pulses per turn and shaft of the measured tach, for people.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub measured_tach_is: Option<String>,
    /// Remarks of the readers.
    pub remarks: Vec<String>,
}

/// Reads `files` and builds the record in memory.
///
/// # Errors
/// Unreadable files, files that do not fit together, a missing rate, clipping at the chosen full scale, no
/// trustworthy mesh line where a virtual tach is wanted, or a tachometer that cannot be read as one.
pub fn import(files: &[PathBuf], options: &ImportOptions) -> Result<(Record, ImportSummary)> {
    let reading = reading(options)?;
    let mut sources = read_all(files, &reading)?;
    declared::shares(files, &mut sources, options)?;
    let mut remarks: Vec<String> = Vec::new();
    let rate_hz = rate(files, &sources, options, &mut remarks)?;
    check_full_scale(options)?;
    for (file, source) in files.iter().zip(&sources) {
        remarks.extend(source.remarks.iter().map(|remark| format!("{}: {remark}", short(file))));
    }
    let mut runs = grouped(files, sources, options.files_are_runs)?;
    remarks.extend(runs.iter().filter_map(|run| Some(format!("{}: {}", run.label, run.cut?.described()))));
    // A table of the acquisition system has a row for the tachometer's channel, too.
    let of_every_column = options.source_full_scale.len() == runs[0].channels.len();
    if of_every_column {
        declared::scaled(&mut runs, options)?;
    }
    let found = super::train::with_channel(options, &runs)?;
    let options = &found;
    remarks.extend(super::train::other_tachs(options, &mut runs, rate_hz)?);
    let before: Vec<Vec<String>> = runs.iter().map(|run| run.names.clone()).collect();
    let measured = match &options.tach {
        TachChoice::Measured(tach) => {
            let tach = by_name(tach, &runs[0]);
            // A file of its own has columns of its own.
            let reading = Reading { columns: Vec::new(), skip: Vec::new(), ..reading.clone() };
            tach::measured(&tach, &mut runs, rate_hz, options.teeth, compared(options), &reading)?
        }
        TachChoice::Virtual | TachChoice::None | TachChoice::Nominal(_) => {
            remarks.extend(runs.iter().flat_map(overlooked));
            Vec::new()
        }
    };
    runs.iter_mut().zip(&before).for_each(|(run, before)| run.follow(before));
    if !of_every_column {
        declared::scaled(&mut runs, options)?;
    }
    let quantities::Sorted { unit, beside, remarks: sorted } = quantities::sort(&mut runs, rate_hz, options)?;
    remarks.extend(sorted);
    let names = channel_names(&runs[0], options.channel_names.as_deref())?;
    for run in &runs {
        let said = data_quality::first_lines(&data_quality::of_channels(&names, &run.channels, rate_hz));
        remarks.extend(said.into_iter().map(|text| format!("{}: {text}", run.label)));
    }
    let full_scale = options
        .full_scale
        .unwrap_or_else(|| runs.iter().map(|run| suggested_full_scale(&run.channels)).fold(0.0, f64::max));
    let quantisation_snr_db = if options.float {
        Vec::new()
    } else {
        quantisation_snr_db(&runs, &names, full_scale, options.full_scale.is_some(), &mut remarks)?
    };
    let acquisition = Acquisition {
        sample_rate_hz: rate_hz,
        channels: names.clone(),
        full_scale_m_s2: full_scale,
        code_bits: if options.float { FLOAT_BITS } else { 16 },
        unit: unit.clone(),
        other: Table::new(),
    };
    let Made { runs: made, tach, quality, figures } = made(&runs, measured, beside, &acquisition, options)?;
    if let TachChoice::Measured(tach) = &options.tach {
        remarks.extend(runs.iter().zip(&figures).flat_map(|(run, figures)| tach::remarks(&run.label, tach, figures)));
    }
    if options.tach != TachChoice::Virtual && figures.is_empty() {
        remarks.extend(runs.iter().zip(&made).filter_map(|(run, made)| nominal_mesh(run, made, rate_hz, options)));
    }
    let summary = ImportSummary {
        files: files.to_vec(),
        sample_rate_hz: rate_hz,
        samples: made.iter().map(Run::samples).collect(),
        channels: names,
        full_scale,
        unit: unit.unwrap_or_else(|| "m/s2".into()),
        beside: made[0].declaration.beside.iter().map(|beside| beside.name.clone()).collect(),
        quantisation_snr_db,
        tach: quality,
        measured_tach: figures,
        measured_tach_is: match &options.tach {
            TachChoice::Measured(tach) => Some(tach.described()),
            TachChoice::Virtual | TachChoice::None | TachChoice::Nominal(_) => None,
        },
        remarks,
    };
    let (mut declaration, folder) = declared::declaration(options, acquisition, tach)?;
    declaration.runs = made.iter().map(|run| run.declaration.clone()).collect();
    Ok((Record { folder, declaration, runs: made }, summary))
}

/// The mesh that a measured tachometer is compared with: the pair's, or the first of a train.
fn compared(options: &ImportOptions) -> Option<tach::Compared> {
    if let Some(teeth) = options.teeth {
        return Some(tach::Compared { teeth, turns: 1.0, passes: 0 });
    }
    let train = options.train.as_ref()?;
    let (teeth, shaft) = super::train::virtual_teeth(train)?;
    let carrier = train.meshes.first().and_then(|mesh| mesh.carrier.as_ref());
    let passes = carrier.map_or(0, |carrier| crate::train::lines::passes(carrier) as u32);
    Some(tach::Compared { teeth, turns: train.shaft_order(shaft).value().abs(), passes })
}

/// What the mesh line says of a speed that was only given.
fn nominal_mesh(run: &Group, made: &Run, rate_hz: f64, options: &ImportOptions) -> Option<String> {
    let pulsed = Pulsed {
        channels: &run.channels,
        rate_hz,
        edges_s: &made.edges_s,
        pulses: 1,
        ratio: 1.0,
        shaft: "the pinion".into(),
        teeth: options.teeth?,
        passes: 0,
        nominal: true,
        sampled_at_hz: None,
    };
    let checked = (made.edges_s.len() > 1).then(|| mesh::check(&run.label, &pulsed)).flatten()?;
    Some(format!("{}: {}", run.label, checked.sentence))
}

fn check_full_scale(options: &ImportOptions) -> Result<()> {
    match options.full_scale.filter(|x| !(x.is_finite() && *x > 0.0)) {
        Some(full_scale) => Err(Error::invalid("--full-scale", format!("{full_scale} is not a positive number"))),
        None => Ok(()),
    }
}

/// How the files are read: what the user says about them, the rate and the tachometer included.
fn reading(options: &ImportOptions) -> Result<Reading> {
    let tach = match &options.tach {
        TachChoice::Measured(tach) => tach.sources.clone(),
        TachChoice::Virtual | TachChoice::None | TachChoice::Nominal(_) => Vec::new(),
    };
    let chosen = !options.reading.columns.is_empty();
    if let Some(number) = tach.iter().find(|source| chosen && source.parse::<usize>().is_ok()) {
        return Err(Error::invalid("--tach", format!("{number}: with --columns the tachometer is called by its name")));
    }
    Ok(Reading { rate_hz: options.rate_hz, tach, ..options.reading.clone() })
}

/// The tachometer by the channel's name without its unit, where it was called with it.
fn by_name(tach: &tach::TachOptions, run: &Group) -> tach::TachOptions {
    let bare = |source: &String| match super::units::of_name(source) {
        Some((name, _)) if !run.names.contains(source) && run.names.contains(&name) => name,
        _ => source.clone(),
    };
    tach::TachOptions { sources: tach.sources.iter().map(bare).collect(), ..tach.clone() }
}

fn read_all(files: &[PathBuf], reading: &Reading) -> Result<Vec<Columns>> {
    let mut sources: Vec<Columns> = Vec::new();
    let mut values = 0;
    // As many at once as there are processors: the budget is looked at in between.
    for some in files.chunks(rayon::current_num_threads()) {
        let read: Vec<Result<Columns>> = some.par_iter().map(|file| read_as(file, reading)).collect();
        for (file, source) in some.iter().zip(read) {
            let source = source?;
            values += source.channels.iter().map(Vec::len).sum::<usize>();
            VALUES.check(
                file.display(),
                values as f64,
                "take a part with --from and --to, or fewer channels with --columns",
            )?;
            sources.push(source);
        }
    }
    Ok(sources)
}

/// A hint for every channel that would be an acceleration and looks like a tachometer's.
fn overlooked(run: &Group) -> Vec<String> {
    let found: Vec<bool> = run.channels.par_iter().map(|channel| tach::looks_like_a_tach(channel)).collect();
    let channels = run.names.iter().enumerate().zip(found).filter(|(_, found)| *found);
    channels
        .map(|((i, name), _)| {
            format!(
                "{}: channel {} '{name}' has two levels like a tachometer; --tach {} makes it one",
                run.label,
                i + 1,
                i + 1
            )
        })
        .collect()
}

/// The runs of the record and what their pulses are like.
struct Made {
    runs: Vec<Run>,
    tach: Option<Tach>,
    quality: Vec<Quality>,
    figures: Vec<TachFigures>,
}

fn made(
    runs: &[Group],
    measured: Vec<tach::MeasuredTach>,
    beside: Vec<Vec<(BesideDeclaration, Beside)>>,
    acquisition: &Acquisition,
    options: &ImportOptions,
) -> Result<Made> {
    let (mut made, mut quality, mut figures) = (Vec::new(), Vec::new(), Vec::new());
    let mut measured = measured.into_iter();
    for ((i, run), beside) in runs.iter().enumerate().zip(beside) {
        let mut declaration =
            RunDeclaration::numbered(i, options.tach != TachChoice::None, declared::torque(options, i, runs.len())?);
        declaration.other.insert("source".into(), run.label.clone().into());
        if let Some(cut) = &run.cut {
            declaration.other.insert(PART.into(), cut.described().into());
        }
        if let Some(load) = declared::load(options, i, runs.len())? {
            declaration.other.insert(crate::record::LOAD.into(), load.into());
        }
        let mut edges = Vec::new();
        if let Some(tach) = measured.next() {
            declaration.first_pulse_index = tach.figures.first_pulse_index;
            declaration.other.insert("measured_tach".into(), table(&tach.figures));
            edges = tach.edges_s;
            figures.push(tach.figures);
        } else if options.tach == TachChoice::Virtual {
            let tach = run_tach(&run.label, &run.channels, acquisition.sample_rate_hz, options)?;
            declaration.other.insert("virtual_tach".into(), table(&tach.quality));
            edges = tach.edges_s;
            quality.push(tach.quality);
        } else if let TachChoice::Nominal(speed_hz) = options.tach {
            edges = declared::nominal_edges(speed_hz, run.channels[0].len() as f64 / acquisition.sample_rate_hz)?;
        }
        let mut values = Vec::new();
        for (k, (own, signal)) in beside.into_iter().enumerate() {
            declaration.beside.push(BesideDeclaration { file: format!("run{i:02}.beside{k:02}.npy"), ..own });
            values.push(signal);
        }
        let mut run = Run::from_signals(declaration, acquisition, &run.channels, edges)?;
        run.beside = values;
        made.push(run);
    }
    let of_runs = quality.iter().map(|q| q.jitter_s).chain(figures.iter().map(|f| f.jitter_s));
    let jitter_s = of_runs.reduce(f64::max).unwrap_or(0.0);
    let tach = match &options.tach {
        TachChoice::None => None,
        TachChoice::Measured(measured) => Some(measured.declaration(options.teeth, jitter_s)),
        TachChoice::Virtual => Some(on_pinion("virtual", Some(jitter_s))),
        TachChoice::Nominal(_) => Some(on_pinion("nominal", None)),
    };
    let tach = tach.map(|tach| super::train::on_shaft(tach, options));
    Ok(Made { runs: made, tach, quality, figures })
}

/// One pulse per turn of the pinion that no pick-up made.
fn on_pinion(source: &str, jitter_s: Option<f64>) -> Tach {
    Tach {
        shaft: "pinion".into(),
        turns_per_pinion_turn: None,
        pulses_per_rev: 1,
        jitter_s,
        source: Some(source.into()),
        other: Table::new(),
    }
}

/// Typical level over quantisation noise of every channel, the worst of all runs, with remarks where it is poor.
fn quantisation_snr_db(
    runs: &[Group],
    names: &[String],
    full_scale: f64,
    given: bool,
    remarks: &mut Vec<String>,
) -> Result<Vec<f64>> {
    let step = full_scale / crate::record::CODE_MAX;
    let mut worst = vec![f64::INFINITY; names.len()];
    for run in runs {
        let of = |channel: &Vec<f64>| (quantisation::resolution(channel, step), steps::of_source(channel));
        let found: Vec<_> = run.channels.par_iter().map(of).collect();
        for (((found, own_step), name), worst) in found.into_iter().zip(names).zip(&mut worst) {
            remarks.extend(quantisation::judge(&run.label, name, &found, full_scale, given)?);
            *worst = worst.min(found.snr_db);
            // The file's own steps where they are coarser than the record's.
            if let Some(own_step) = own_step.filter(|own| *own > step) {
                let few = steps::judge(name, found.level, own_step);
                remarks.extend(few.map(|what| format!("{}: {what}", run.label)));
                *worst = worst.min(steps::over_quantisation(found.level, own_step));
            }
        }
    }
    Ok(worst)
}

fn channel_names(run: &Group, given: Option<&[String]>) -> Result<Vec<String>> {
    match given {
        Some(names) if names.len() == run.channels.len() => Ok(names.to_vec()),
        Some(names) => {
            let what = format!(
                "names {} channels, {} holds {} (without the tachometer)",
                names.len(),
                run.label,
                run.channels.len()
            );
            Err(Error::invalid("--channel-names", what))
        }
        None => Ok(run.names.clone()),
    }
}

fn run_tach(
    label: &str,
    channels: &[Vec<f64>],
    rate_hz: f64,
    options: &ImportOptions,
) -> Result<super::virtual_tach::VirtualTach> {
    let teeth = options
        .teeth
        .or_else(|| options.train.as_ref().and_then(super::train::virtual_teeth).map(|(teeth, _)| teeth))
        .ok_or_else(|| Error::invalid("--teeth", "the virtual tach needs tooth counts; or give --no-tach"))?;
    if let Some(hz) = options.mesh_guess_hz.filter(|hz| !(hz.is_finite() && *hz > 0.0)) {
        return Err(Error::invalid("--mesh", format!("{hz} is not a positive frequency in Hz")));
    }
    if teeth.iter().any(|z| !(5..=1000).contains(z)) {
        return Err(Error::invalid("--teeth", format!("{},{} are not tooth counts (5 to 1000)", teeth[0], teeth[1])));
    }
    if let Some(range_hz) = options.mesh_range_hz {
        return followed(label, channels, rate_hz, teeth, range_hz);
    }
    virtual_tach(label, channels, rate_hz, &Options { teeth, mesh_guess_hz: options.mesh_guess_hz })
}

fn table(figures: &impl Serialize) -> Value {
    Value::try_from(figures).unwrap_or_else(|_| Value::Table(Table::new()))
}
