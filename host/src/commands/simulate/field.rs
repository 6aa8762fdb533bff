//! `meshband simulate --field`: a record, or an acquisition system's files, as an owner of a machine would have them.

use super::{Args, Files, Point, Prepared, points, pull};
use meshband_host::budget::ALL_STEPS;
use meshband_host::dynamics::Motion;
use meshband_host::dynamics::rig::PARTS;
use meshband_host::field::{Field, FieldRun, Format, Site, content};
use meshband_host::output::{Content, OutputFolder};
use meshband_host::record::{self, Declaration, Record, Run, RunDeclaration, Tach};
use meshband_host::report::Report;
use meshband_host::report::plot::{Axes, Series, lines, spectrum};
use meshband_host::spectral::{Window, amplitude_spectrum};
use meshband_host::{Error, Result, remark, terminal};
use rayon::prelude::*;
use serde_json::json;
use std::path::PathBuf;
use std::sync::Arc;

/// Simulates the runs and writes record or files, and the truth where it is wanted.
pub fn run(args: &Args) -> Result<()> {
    let Some(path) = &args.field else { return Ok(()) };
    let read = [Some(&args.machine), args.effects_file.as_ref(), Some(path)];
    let mut outputs = args.results.outputs(read.into_iter().flatten().map(PathBuf::as_path));
    let kind = if args.files.is_some() { Content::Recordings } else { Content::Record };
    let folder = outputs.folder(&args.output, kind)?;
    let mut truth = outputs.optional(args.truth.as_deref())?;
    let mut files = args.results.announce(&mut outputs)?;
    let field = Field::read(path)?;
    let Prepared { machine, mut rig, mut effects, torque_factor } = Prepared::of(args)?;
    let (points, default_s) = points(args, &machine)?;
    let duration_s = args.duration.unwrap_or(default_s);
    if !(10e3..=1e6).contains(&args.rate) {
        return Err(Error::invalid("--rate", format!("{} Hz is not within 10 kHz to 1 MHz", args.rate)));
    }
    if !(duration_s.is_finite() && duration_s * args.rate >= 1024.0) {
        return Err(Error::invalid("--duration", format!("{duration_s} s at {} Hz is no record", args.rate)));
    }
    rig.progress = Some(Arc::new(terminal::Progress::new("simulate", PARTS * points.len() as u64)));
    let site = Site::new(&field, &machine, &rig, (args.rate, duration_s), args.seed);
    site.check(points.len())?;
    effects.extend(site.effects());
    let motions: Vec<Motion> = points.iter().map(|point| site.motion(&point.motion, point.seed)).collect();
    check_work(&site, &motions)?;
    let runs: Vec<FieldRun> = (points.par_iter().zip(&motions))
        .map(|(point, motion)| site.run(motion, torque_factor * point.torque_n_m, &effects, point.seed))
        .collect::<Result<_>>()?;
    for (index, run) in runs.iter().enumerate() {
        if let Some(warning) = pull(run.least_mesh_force, run.statistics.contact_events) {
            remark!("warning: run {index}: {warning}");
        }
    }
    match args.files {
        Some(format) => write_files(folder, format, &site, &runs)?,
        None => record(&site, &points, &runs)?.write_to(folder)?,
    }
    if let Some(file) = &mut truth {
        file.write_json(&truth_of(args, &site, &points, &runs))?;
    }
    files.write(&summary(args, &points, &runs), || report(args, &site, &points, &runs))
}

fn check_work(site: &Site, motions: &[Motion]) -> Result<()> {
    let mut steps = 0.0;
    for motion in motions {
        let work = site.rig.work(motion, site.paths.lead_s() + site.duration_s);
        work.check_against(site.rate_hz)?;
        work.check()?;
        steps += work.steps;
    }
    ALL_STEPS.check("simulation", steps, "shorten the runs or make fewer")
}

fn write_files(folder: OutputFolder, format: Files, site: &Site, runs: &[FieldRun]) -> Result<()> {
    let format = match format {
        Files::Wav => Format::Wav,
        Files::Csv => Format::Csv,
        Files::Npy => Format::Npy,
    };
    for (index, run) in runs.iter().enumerate() {
        let bytes = content(format, run, &site.field.channel, site.rate_hz)?;
        folder.write(format!("run{index:02}.{}", format.ending()), bytes)?;
    }
    folder.commit()
}

/// The record that a faultless import would make: edges where the marks pass, the wheel as uneven as it is.
fn record(site: &Site, points: &[Point], runs: &[FieldRun]) -> Result<Record> {
    let all: Vec<Vec<f64>> = runs.iter().flat_map(|r| r.channels.iter().cloned()).collect();
    let declared = record::Acquisition {
        sample_rate_hz: site.rate_hz,
        channels: site.field.channel.iter().map(|c| c.name.clone()).collect(),
        full_scale_m_s2: record::suggested_full_scale(&all),
        code_bits: 16,
        unit: None,
        other: toml::Table::new(),
    };
    let tach = site.field.tach.as_ref().map(|wheel| Tach {
        shaft: wheel.shaft_name().into(),
        turns_per_pinion_turn: None,
        pulses_per_rev: wheel.pulses,
        jitter_s: Some(0.0),
        source: Some("measured".into()),
        other: toml::Table::new(),
    });
    let mut declaration = Declaration::of_machine(site.machine, declared.clone(), tach)?;
    let mut made = Vec::new();
    for (index, (point, run)) in points.iter().zip(runs).enumerate() {
        let mut table = RunDeclaration::numbered(index, site.field.tach.is_some(), Some(point.torque_n_m));
        table.first_pulse_index = run.first_mark as u32;
        declaration.runs.push(table.clone());
        made.push(Run::from_signals(table, &declared, &run.channels, run.edges_s.clone())?);
    }
    Ok(Record { folder: site.machine.folder.clone(), declaration, runs: made })
}

/// What nobody could measure.
fn truth_of(args: &Args, site: &Site, points: &[Point], runs: &[FieldRun]) -> serde_json::Value {
    let of_run = |(point, run): (&Point, &FieldRun)| {
        json!({
            "pinion_speed_hz": point.speed_text,
            "input_torque_n_m": point.torque_n_m,
            "seed": point.seed,
            "first_turns": run.first_turns,
            "first_turn": run.first_turn,
            "turn_times_s": run.turn_times_s,
            "tach_edges_s": run.edges_s,
            "first_mark": run.first_mark,
        })
    };
    json!({
        "machine": site.machine.title,
        "seed": args.seed,
        "sample_rate_hz": site.rate_hz,
        "effects": args.effects,
        "paths": site.paths,
        "wheel_places_of_pitch": site.places,
        "runs": points.iter().zip(runs).map(of_run).collect::<Vec<_>>(),
    })
}

/// Root mean square of a signal.
fn rms(signal: &[f64]) -> f64 {
    (signal.iter().map(|x| x * x).sum::<f64>() / signal.len() as f64).sqrt()
}

/// Lowest and highest speed of whole turns, turns per second.
fn speeds(run: &FieldRun) -> [f64; 2] {
    let turns = run.turn_times_s.windows(2).map(|w| 1.0 / (w[1] - w[0]));
    turns.fold([f64::INFINITY, 0.0], |[low, high], speed| [low.min(speed), high.max(speed)])
}

fn summary(args: &Args, points: &[Point], runs: &[FieldRun]) -> serde_json::Value {
    let of_run = |(point, run): (&Point, &FieldRun)| {
        json!({
            "pinion_speed_hz": point.speed_text,
            "slowest_and_fastest_turn_hz": speeds(run),
            "input_torque_n_m": point.torque_n_m,
            "rms_m_s2": run.channels.iter().map(|c| rms(c)).collect::<Vec<_>>(),
            "tach_edges": run.edges_s.len(),
            "statistics": run.statistics,
            "warning": pull(run.least_mesh_force, run.statistics.contact_events),
        })
    };
    let runs: Vec<_> = points.iter().zip(runs).map(of_run).collect();
    json!({ "effects": args.effects, "seed": args.seed, "runs": runs })
}

fn report(args: &Args, site: &Site, points: &[Point], runs: &[FieldRun]) -> Result<Report> {
    let effects = if args.effects.is_empty() { "none".into() } else { args.effects.join(", ") };
    let rows: Vec<Vec<String>> = points
        .iter()
        .zip(runs)
        .map(|(point, run)| {
            let [slowest, fastest] = speeds(run);
            let levels: Vec<String> = run.channels.iter().map(|c| format!("{:.3}", rms(c))).collect();
            let torque = point.torque_n_m.to_string();
            vec![
                format!("{slowest:.3}"),
                format!("{fastest:.3}"),
                torque,
                levels.join(", "),
                run.edges_s.len().to_string(),
            ]
        })
        .collect();
    let head = ["slowest turn, Hz", "fastest turn, Hz", "torque, N m", "RMS of the channels, m/s2", "tach edges"];
    let mut report = Report::new("Simulated field record", &site.machine.title)
        .figure("Runs", runs.len())
        .figure("Sampling rate", format!("{} Hz", args.rate))
        .figure("Effects", effects)
        .table("Runs.", &head, &rows);
    for (index, run) in runs.iter().enumerate() {
        let turns = run.turn_times_s.windows(2).map(|w| (0.5 * (w[0] + w[1]), 1.0 / (w[1] - w[0]))).collect();
        let speed = lines(&[Series::new("pinion", turns)], Axes { x: "time, s", y: "speed, turns/s" })?;
        report = report.section(&format!("Run {index}")).picture(&speed, "Speed of every turn of the pinion.");
        let series: Vec<Series> = (run.channels.iter().zip(&site.field.channel).take(4))
            .map(|(signal, channel)| {
                let s = amplitude_spectrum(signal, args.rate, Window::Hann);
                Series::new(&channel.name, (1..s.values.len()).map(|i| (s.frequency(i), s.values[i])).collect())
            })
            .collect();
        let axes = Axes { x: "frequency, Hz", y: "acceleration, dB re 1 m/s2" };
        report = report.picture(&spectrum(&series, &[], 1.0, 100.0, axes)?, "Amplitude spectrum of the whole run.");
    }
    Ok(report)
}
