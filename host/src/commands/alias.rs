//! `meshband alias`: folded mesh harmonics at a sampling rate, and which of them explain given lines.

use clap::Args as ClapArgs;
use meshband_host::output::show;
use meshband_host::report::Report;
use meshband_host::report::plot::{Axes, Series, stems};
use meshband_host::results::Results;
use meshband_host::{Error, Result, terminal};
use serde::Serialize;

/// Arguments of `meshband alias`.
#[derive(ClapArgs)]
pub struct Args {
    /// Mesh frequency, Hz.
    #[arg(long)]
    mesh: f64,
    /// Sampling rate, Hz.
    #[arg(long)]
    rate: f64,
    /// Highest harmonic listed.
    #[arg(long, default_value_t = 60)]
    harmonics: u32,
    /// Observed lines, Hz, separated by commas: names the folded harmonics that explain them.
    #[arg(long, value_delimiter = ',')]
    lines: Vec<f64>,
    /// How near a folded harmonic must be to explain a line, Hz; the rounding of one decimal by default.
    #[arg(long, default_value_t = 0.15)]
    tolerance: f64,
    #[command(flatten)]
    results: Results,
}

#[derive(Serialize)]
struct Folded {
    harmonic: u32,
    true_hz: f64,
    appears_hz: f64,
}

#[derive(Serialize)]
struct Explained {
    line_hz: f64,
    /// Harmonics below the Nyquist frequency: the line is what it seems.
    true_harmonics: Vec<u32>,
    /// Harmonics above it that fold here.
    folded_harmonics: Vec<u32>,
}

#[derive(Serialize)]
struct Outcome {
    mesh_hz: f64,
    rate_hz: f64,
    folded: Vec<Folded>,
    lines: Vec<Explained>,
}

/// Prints every harmonic above the Nyquist frequency with the line it folds to, or names given lines.
pub fn run(args: Args) -> Result<()> {
    for (name, value) in [("--mesh", args.mesh), ("--rate", args.rate), ("--tolerance", args.tolerance)] {
        if !(value.is_finite() && value > 0.0) {
            return Err(Error::invalid(name, format!("{value} is not a positive frequency in Hz")));
        }
    }
    if !(1..=100_000).contains(&args.harmonics) {
        return Err(Error::invalid("--harmonics", format!("{} is not within 1 to 100000", args.harmonics)));
    }
    if let Some(line) = args.lines.iter().find(|hz| !(hz.is_finite() && (0.0..=0.5 * args.rate).contains(*hz))) {
        return Err(Error::invalid("--lines", format!("{line} Hz cannot appear at a rate of {} Hz", args.rate)));
    }
    let mut files = args.results.announce(&mut args.results.outputs([]))?;
    let outcome = outcome(&args);
    files.write(&outcome, || report(&outcome))?;
    print(&outcome)
}

fn outcome(args: &Args) -> Outcome {
    let harmonic = |harmonic: u32| {
        let true_hz = args.mesh * f64::from(harmonic);
        Folded { harmonic, true_hz, appears_hz: (true_hz - args.rate * (true_hz / args.rate).round()).abs() }
    };
    let (folded, direct): (Vec<Folded>, Vec<Folded>) =
        (1..=args.harmonics).map(harmonic).partition(|f| f.true_hz > 0.5 * args.rate);
    let near = |all: &[Folded], hz: f64| {
        all.iter().filter(|f| (f.appears_hz - hz).abs() <= args.tolerance).map(|f| f.harmonic).collect()
    };
    let lines = args
        .lines
        .iter()
        .map(|&hz| Explained { line_hz: hz, true_harmonics: near(&direct, hz), folded_harmonics: near(&folded, hz) })
        .collect();
    Outcome { mesh_hz: args.mesh, rate_hz: args.rate, folded, lines }
}

fn folded_rows(outcome: &Outcome) -> Vec<Vec<String>> {
    let row = |f: &Folded| vec![f.harmonic.to_string(), format!("{:.3}", f.true_hz), format!("{:.3}", f.appears_hz)];
    outcome.folded.iter().map(row).collect()
}

fn line_rows(outcome: &Outcome) -> Vec<Vec<String>> {
    let list = |harmonics: &[u32]| match harmonics {
        [] => "none".to_string(),
        some => some.iter().map(|h| format!("{h}x")).collect::<Vec<_>>().join(", "),
    };
    let row = |e: &Explained| vec![format!("{:.3}", e.line_hz), list(&e.true_harmonics), list(&e.folded_harmonics)];
    outcome.lines.iter().map(row).collect()
}

const FOLDED_HEAD: [&str; 3] = ["harmonic", "true, Hz", "appears at, Hz"];
const LINE_HEAD: [&str; 3] = ["line, Hz", "mesh harmonic", "folded mesh harmonic"];

fn print(outcome: &Outcome) -> Result<()> {
    if outcome.lines.is_empty() {
        show(&terminal::table(&FOLDED_HEAD, &folded_rows(outcome)))
    } else {
        show(&terminal::table(&LINE_HEAD, &line_rows(outcome)))
    }
}

fn report(outcome: &Outcome) -> Result<Report> {
    let points = |observed: bool| -> Vec<(f64, f64)> {
        let mut points: Vec<(f64, f64)> = if observed {
            outcome.lines.iter().map(|e| (e.line_hz, 0.0)).collect()
        } else {
            outcome.folded.iter().map(|f| (f.appears_hz, f64::from(f.harmonic))).collect()
        };
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    };
    let mut series = vec![Series::new("folded harmonic", points(false))];
    if !outcome.lines.is_empty() {
        series.push(Series::new("line asked for", points(true)));
    }
    let picture = stems(&series, Axes { x: "appears at, Hz", y: "mesh harmonic" })?;
    let mut report = Report::new("Folded mesh harmonics", "Which lines of a spectrum are not where they seem")
        .figure("Mesh frequency", format!("{} Hz", outcome.mesh_hz))
        .figure("Sampling rate", format!("{} Hz", outcome.rate_hz))
        .figure("Harmonics that fold", outcome.folded.len());
    if !outcome.lines.is_empty() {
        report = report.section("Lines asked for").table(
            "Harmonics that explain each line.",
            &LINE_HEAD,
            &line_rows(outcome),
        );
    }
    Ok(report
        .section("All folded harmonics")
        .picture(&picture, "Each stem is a mesh harmonic above half the sampling rate, drawn where it appears.")
        .table("Harmonics above half the sampling rate.", &FOLDED_HEAD, &folded_rows(outcome)))
}
