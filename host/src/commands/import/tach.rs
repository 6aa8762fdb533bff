//! A measured tachometer in `meshband import`: its options, its figures as text, table and pictures.

use clap::{Args as ClapArgs, ValueEnum};
use meshband_host::import::ImportSummary;
use meshband_host::import::tach::{Shaft, TachFigures, TachOptions};
use meshband_host::output::show;
use meshband_host::record::{Record, Run};
use meshband_host::report::plot::{Axes, Series};
use meshband_host::report::{Report, plot};
use meshband_host::{Error, Result, say, terminal};
use std::path::{Path, PathBuf};

/// Options of a tachometer that was recorded.
#[derive(ClapArgs)]
pub struct TachArgs {
    /// The recorded tachometer: number (from 1) or name of a channel, or a file (edges csv, or a recording of it
    /// alone); with
    /// --runs files separated by commas, one per run.
    #[arg(long, value_name = "COLUMN|NAME|FILE", value_delimiter = ',', conflicts_with = "no_tach")]
    tach: Option<Vec<String>>,
    /// Pulses per turn of the tachometer's shaft.
    #[arg(long, default_value_t = 1, requires = "tach")]
    pulses: u32,
    /// The tachometer's shaft: pinion, gear, or its turns per turn of the pinion (0.5, or 23/61).
    #[arg(long, value_name = "pinion|gear|RATIO", default_value = "pinion", requires = "tach")]
    tach_shaft: String,
    /// Edges that are timed; rising where nothing is said.
    #[arg(long, value_enum, requires = "tach")]
    edge: Option<Edge>,
    /// Level at which edges are timed, in the tachometer's unit; half way between its two levels otherwise.
    #[arg(long, value_name = "LEVEL", requires = "tach", allow_negative_numbers = true)]
    threshold: Option<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
enum Edge {
    Rising,
    Falling,
}

impl TachArgs {
    /// The options, where there is a measured tach.
    pub fn options(&self) -> Result<Option<TachOptions>> {
        let Some(sources) = &self.tach else { return Ok(None) };
        if let Some(level) = self.threshold.filter(|level| !level.is_finite()) {
            return Err(Error::invalid("--threshold", format!("{level} is no level")));
        }
        Ok(Some(TachOptions {
            sources: sources.clone(),
            pulses: self.pulses,
            shaft: shaft(&self.tach_shaft)?,
            falling: self.edge.map(|edge| edge == Edge::Falling),
            threshold: self.threshold,
        }))
    }

    /// Files among the sources, which are inputs.
    pub fn files(&self) -> Vec<PathBuf> {
        let sources = self.tach.iter().flatten();
        sources.map(PathBuf::from).filter(|path| Path::is_file(path)).collect()
    }
}

fn shaft(text: &str) -> Result<Shaft> {
    let ratio = match text {
        "pinion" => return Ok(Shaft::Pinion),
        "gear" => return Ok(Shaft::Gear),
        _ => match text.split_once('/') {
            Some((above, below)) => {
                above.trim().parse::<f64>().ok().zip(below.trim().parse().ok()).map(|(a, b): (_, f64)| a / b)
            }
            None => text.parse().ok(),
        },
    };
    let valid = ratio.filter(|ratio| ratio.is_finite() && *ratio > 0.0).map(Shaft::Ratio);
    valid.ok_or_else(|| {
        Error::invalid("--tach-shaft", format!("'{text}' is neither pinion nor gear nor a ratio such as 0.5 or 23/61"))
    })
}

const HEAD: [&str; 10] = [
    "run",
    "pulses",
    "shaft, turns/s",
    "slowest",
    "fastest",
    "pinion, turns/s",
    "jitter, us",
    "lost, doubled, odd",
    "wheel, % of pitch",
    "mesh / implied",
];

fn rows(summary: &ImportSummary) -> Vec<Vec<String>> {
    let count = |places: &[meshband_host::import::tach::Place]| places.iter().map(|place| place.pulses).sum::<usize>();
    let wheel = |figures: &TachFigures| match &figures.wheel {
        None => "-".into(),
        Some(wheel) if wheel.removed => {
            format!("{:.3} -> {:.3}", wheel.irregularity_percent, wheel.remaining_percent)
        }
        Some(wheel) => format!("{:.3}, left", wheel.irregularity_percent),
    };
    let row = |(i, f): (usize, &TachFigures)| {
        vec![
            i.to_string(),
            f.pulses.to_string(),
            format!("{:.4}", f.shaft_speed_hz.mean),
            format!("{:.4}", f.shaft_speed_hz.least),
            format!("{:.4}", f.shaft_speed_hz.most),
            f.pinion_speed_hz.map_or("-".into(), |speed| format!("{:.4}", speed.mean)),
            format!("{:.2}", 1e6 * f.jitter_s),
            format!("{}, {}, {}", count(&f.lost), count(&f.doubled), count(&f.irregular)),
            wheel(f),
            f.mesh.as_ref().and_then(|mesh| mesh.found_over_implied).map_or("-".into(), |share| format!("{share:.6}")),
        ]
    };
    summary.measured_tach.iter().enumerate().map(row).collect()
}

/// Where the pulses come from, and what they are taken for.
fn heading(summary: &ImportSummary, figures: &TachFigures) -> String {
    let levels = figures.levels.map_or(String::new(), |levels| {
        format!(", through {:.4} between {:.4} and {:.4}", levels.threshold, levels.low, levels.high)
    });
    format!("{}: {}{levels}", figures.source, summary.measured_tach_is.as_deref().unwrap_or_default())
}

/// Prints the figures of a measured tach, where there is one.
pub fn print(summary: &ImportSummary) -> Result<()> {
    let Some(first) = summary.measured_tach.first() else { return Ok(()) };
    say!("\nmeasured tach, {}", heading(summary, first))?;
    show(&terminal::table(&HEAD, &rows(summary)))
}

/// Adds the measured tach to a report, where there is one.
pub fn report(mut report: Report, record: &Record, summary: &ImportSummary) -> Result<Report> {
    let Some(first) = summary.measured_tach.first() else { return Ok(report) };
    if let Some(speed) = first.pinion_speed_hz {
        report = report.figure("Pinion speed", format!("{:.1} rpm", 60.0 * speed.mean));
    }
    report = report
        .figure("Tach jitter", format!("{:.2} us", 1e6 * first.jitter_s))
        .section("Tachometer")
        .text(&heading(summary, first))
        .table("One row per run; speeds over whole turns of the tachometer's shaft.", &HEAD, &rows(summary))
        .note(
            "Where angle 0 lies against the teeth is not known. What is locked to the tachometer's shaft (a swing \
            once per turn) cannot be told from an uneven wheel and goes with it. With one pulse per turn, speed that \
            changes from turn to turn counts as jitter.",
        );
    let pulses = record.declaration.tach.as_ref().map_or(1, |tach| tach.pulses_per_rev as usize);
    for (i, (run, figures)) in record.runs.iter().zip(&summary.measured_tach).enumerate() {
        report = report.picture(&speed(run, pulses)?, &format!("Speed of the tachometer's shaft per turn, run {i}."));
        if let Some(wheel) = &figures.wheel {
            let points =
                wheel.places.iter().enumerate().map(|(m, d)| (360.0 * m as f64 / pulses as f64, 100.0 * d)).collect();
            let axes = Axes { x: "angle of the mark, degrees", y: "behind its even place, % of the pitch" };
            let state = if wheel.removed { "taken out of the edge times" } else { "within their own error, left" };
            let caption = format!(
                "Places of the wheel's marks over the turn, learned from {} turns of run {i}; {state}.",
                wheel.turns
            );
            report = report.picture(&plot::stems(&[Series::new("marks", points)], axes)?, &caption);
        }
    }
    Ok(report)
}

/// Speed over time, one point per turn.
fn speed(run: &Run, pulses: usize) -> Result<String> {
    let turns: Vec<f64> = run.edges_s.iter().step_by(pulses).copied().collect();
    let points = turns.windows(2).map(|w| (0.5 * (w[0] + w[1]), 60.0 / (w[1] - w[0]))).collect();
    plot::lines(&[Series::new("tach shaft", points)], Axes { x: "time, s", y: "speed, rpm" })
}
