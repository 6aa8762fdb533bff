//! The report of a commissioning: what every step saw, and the baseline over speed.

use super::baseline::NAMES;
use super::outcome::Commissioning;
use super::run_up::Heard;
use super::step::StepRecord;
use crate::Result;
use crate::levels::learn::{Expected, HEAD, Learned};
use crate::report::Report;
use crate::report::facts::Facts;
use crate::report::plot::{self, Axes, Series};
use meshband::alarm::AlarmBand;

/// Points of a drawn curve between two points of the table.
const CURVE_POINTS: usize = 16;

/// Makes it.
///
/// # Errors
/// A picture that cannot be drawn.
pub fn of(done: &Commissioning) -> Result<Report> {
    let verdict = match (done.refusal(), done.stored) {
        (Some((step, _)), _) => format!("refused at {}", step.step.name()),
        (None, true) => "watching".into(),
        (None, false) => "ready, not stored".into(),
    };
    let mut report = Report::new("Commissioning", &format!("{} with the node at {}", done.machine, done.port))
        .verdict(letter(done))
        .facts(facts(done))
        .figure("Verdict", verdict)
        .figure("Node", done.node.board.to_string());
    if let Some(coverage) = &done.coverage {
        report = report.figure("Speed classes", format!("{} of {}", coverage.filled().count(), coverage.classes.len()));
    }
    if let Some(proposal) = &done.alarms {
        report =
            report.figure("False alarms asked for", format!("{} a year of turning", proposal.false_alarms_per_year));
    }
    if let Some((step, finding)) = done.refusal() {
        report = report.note(&format!("{}: {}, {}. {}", step.step.name(), finding.what, finding.seen, finding.advice));
    }
    report = to_do(report, done);
    if let (Some(learned), Some(proposal)) = (&done.levels, &done.alarms) {
        report = alarms(report, &proposal.alarms);
        report = report.table("Expected levels and standard uncertainties.", &HEAD, &learned.rows());
    }
    report = report.appendix("Every step");
    for step in &done.steps {
        report = section(report, step);
    }
    if let Some(coverage) = &done.coverage {
        let row = |class: &super::coverage::SpeedClass| {
            vec![format!("{:.2}", class.from_hz), format!("{:.2}", class.to_hz), class.values.to_string()]
        };
        let rows: Vec<Vec<String>> = coverage.classes.iter().map(row).collect();
        let caption = format!("Values by class of speed; {} fill one.", coverage.wanted);
        report = report.section("Speeds").table(&caption, &["from, Hz", "to, Hz", "values"], &rows);
    }
    if let (Some(learned), Some(heard), Some(proposal)) = (&done.levels, &done.heard, &done.alarms) {
        let limit = proposal.alarms.first().map_or(0.0, |alarm| f64::from(alarm.raise));
        report = levels(report, learned, heard, limit)?;
    }
    if !done.changes.is_empty() {
        let row = |change: &super::settings_text::Change| {
            vec![change.key.clone(), change.before.clone(), change.after.clone()]
        };
        let rows: Vec<Vec<String>> = done.changes.iter().map(row).collect();
        report =
            report.section("Configuration").table("What differs from the one found.", &["key", "before", "now"], &rows);
    }
    Ok(report)
}

/// What was done, whether the machine is watched, what to do next.
fn letter(done: &Commissioning) -> Vec<String> {
    let speeds = done.coverage.as_ref().and_then(|coverage| coverage.covered_hz());
    let range = speeds.map_or(String::new(), |[low, high]| {
        format!(", pinion at {low:.2} to {high:.2} Hz ({:.0} to {:.0} rpm)", 60.0 * low, 60.0 * high)
    });
    let values = done.heard.as_ref().map_or(0, |heard| heard.levels.by_quantity[0].len());
    let first =
        format!("{} with the node at {}: {values} values of the sound machine{range}.", done.machine, done.port);
    let alarms = done.alarms.as_ref().map_or(0, |proposal| proposal.alarms.len());
    let asked = done.alarms.as_ref().map_or(0.0, |proposal| proposal.false_alarms_per_year);
    let [second, third] = match (done.refusal(), done.stored) {
        (Some((step, finding)), _) => [
            format!("It is not watched: {} refused {} ({}).", step.step.name(), finding.what, finding.seen),
            format!("Next: {}; then `meshband commission` once more.", finding.advice),
        ],
        (None, true) => [
            format!("It is watched from now on, by {alarms} alarms made for {asked} false alarms per year of turning."),
            "Next: nothing; look at this page again when load, sensor or machine change, and commission anew then."
                .into(),
        ],
        (None, false) => [
            format!("It is not watched: {alarms} alarms were made but not stored."),
            "Next: store them: `meshband configure PORT --settings node.toml`, or commission with --yes.".into(),
        ],
    };
    vec![first, second, third]
}

/// Everything with an advice, in one table.
fn to_do(report: Report, done: &Commissioning) -> Report {
    let rows: Vec<Vec<String>> = done
        .steps
        .iter()
        .flat_map(|step| step.findings.iter().map(move |finding| (step, finding)))
        .filter(|(_, finding)| !finding.advice.is_empty())
        .map(|(step, finding)| {
            let cells = [step.step.name(), finding.outcome.name(), &finding.what, &finding.seen, &finding.advice];
            cells.map(str::to_owned).to_vec()
        })
        .collect();
    match rows.is_empty() {
        true => report.section("Reservations").text("None: every step passed."),
        false => {
            report.section("Reservations").table("", &["step", "outcome", "looked at", "seen", "what to do"], &rows)
        }
    }
}

fn facts(done: &Commissioning) -> Facts {
    let mut facts = vec![("node".to_owned(), crate::link::text::identity(&done.node))];
    if let Some(config) = &done.configuration {
        let gears = config.gears;
        facts.push(("teeth, pinion and gear".into(), format!("{} and {}", gears.pinion_teeth, gears.gear_teeth)));
        facts.push(("sensor".into(), format!("{} m/s2 per code", config.sensor.acceleration_per_code.0)));
    }
    facts
}

fn section(report: Report, step: &StepRecord) -> Report {
    let head = ["looked at", "outcome", "seen", "what to do"];
    let has_advice = step.findings.iter().any(|finding| !finding.advice.is_empty());
    let columns = if has_advice { head.len() } else { head.len() - 1 };
    let row = |finding: &super::step::Finding| {
        let cells = [&finding.what, finding.outcome.name(), &finding.seen, &finding.advice];
        cells[..columns].iter().map(|&cell| cell.to_owned()).collect()
    };
    let rows: Vec<Vec<String>> = step.findings.iter().map(row).collect();
    let name = step.step.name();
    let heading = format!("Step {}: {}", name, step.outcome.name());
    report.section(&heading).table("", &head[..columns], &rows)
}

/// Each quantity over speed: the values, the expectation, and where its alarm lies.
fn levels(mut report: Report, learned: &Learned, heard: &Heard, limit: f64) -> Result<Report> {
    report = report.section("Baseline over speed").text(
        "Dots are the node's values of the sound machine, the line what is expected of it from now on, the upper \
         line where the departure's alarm lies for this quantity alone.",
    );
    for ((quantity, name), values) in NAMES.into_iter().enumerate().zip(&heard.levels.by_quantity) {
        let of = |point: &Expected| point.levels[quantity];
        let known: Vec<&Expected> = learned.points.iter().filter(|point| of(point).uncertainty_db > 0.0).collect();
        if values.is_empty() || known.len() < 2 {
            report = report.note(&format!("{name}: nothing is expected of it."));
            continue;
        }
        let curve = |by: f64| -> Vec<(f64, f64)> {
            let at = |pair: &[&Expected], t: f64| {
                let (a, b) = (of(pair[0]), of(pair[1]));
                let between = |x: f32, y: f32| f64::from(x) + t * f64::from(y - x);
                let speed = f64::from(pair[0].speed.0) * f64::from(pair[1].speed.0 / pair[0].speed.0).powf(t);
                let height = between(a.level_db, b.level_db) + by * between(a.uncertainty_db, b.uncertainty_db);
                (speed, height)
            };
            let pieces = known
                .windows(2)
                .flat_map(|pair| (0..=CURVE_POINTS).map(move |n| at(pair, n as f64 / CURVE_POINTS as f64)));
            pieces.collect()
        };
        let dots = values.iter().map(|value| (value.speed_hz, value.level_db)).collect();
        let unit = match name {
            "velocity RMS" => "level, dB re 1 m/s",
            "FM0" => "level, dB re 1",
            _ => "level, dB re 1 m/s2",
        };
        let picture = plot::scatter(
            &Series::new("sound machine", dots),
            &[Series::new("expected", curve(0.0)), Series::new("alarm", curve(limit))],
            Axes { x: "pinion speed, Hz", y: unit },
        )?;
        report = report.picture(&picture, &format!("{name}, {} values.", values.len()));
    }
    Ok(report)
}

fn alarms(report: Report, alarms: &[AlarmBand]) -> Report {
    let row = |alarm: &AlarmBand| {
        vec![
            crate::link::words::watched(alarm.watched).to_owned(),
            format!("{:.2}", alarm.from.0),
            format!("{:.2}", alarm.to.0),
            format!("{:.4}", alarm.raise),
            format!("{:.4}", alarm.clear),
            alarm.persistence.to_string(),
        ]
    };
    let rows: Vec<Vec<String>> = alarms.iter().map(row).collect();
    let head = ["watched", "from, Hz", "to, Hz", "raises", "clears", "values in a row"];
    let note = "Outside these speeds only the signal itself is watched.";
    report.section("Alarms").table("", &head, &rows).note(note)
}
