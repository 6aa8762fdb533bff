//! The loop's report for people: errors in three stages, residual spectra as declared and corrected, evidence, what
//! was refused, what stays.

use super::bands::bands;
use super::letter;
use super::outcome::{Outcome, StagedError, Stages};
use super::replay::Replay;
use crate::Result;
use crate::check::Findings;
use meshband_common::report::Report;
use meshband_common::report::letter::About;
use meshband_common::report::owners::Owners;
use meshband_common::report::plot::{Axes, Series, spectrum};

fn number(x: f64) -> String {
    if x == 0.0 {
        "0".into()
    } else if (1e-3..1e4).contains(&x.abs()) {
        format!("{x:.4}")
    } else {
        format!("{x:.2e}")
    }
}

fn optional(x: Option<f64>) -> String {
    x.map_or("-".into(), number)
}

fn interval(value: Option<f64>, range: Option<[f64; 2]>) -> String {
    match (value, range) {
        (Some(v), Some([a, b])) => format!("{v:.2} ({a:.2} to {b:.2})"),
        _ => "-".into(),
    }
}

/// The whole report of a record that `about` describes: the letter first, the figures of the method last.
///
/// # Errors
/// A picture that cannot be drawn.
pub fn report(outcome: &Outcome, replay: &Replay, about: &About) -> Result<Report> {
    let mut report = Report::new(&format!("Gear pair: {}", outcome.record), "What the declared machine lacks")
        .verdict(letter::sentences(outcome, about))
        .facts(about.facts.clone());
    let (head, rows) = letter::findings(outcome, replay, about);
    report = report.section("Findings");
    report = match rows.is_empty() {
        true => report.text("None beyond the declared machine."),
        false => report.table("Lines are those that the declared machine leaves on a held-out run.", &head, &rows),
    };
    report = stages(report, outcome);
    report = findings(report, &outcome.findings);
    report = residuals(report, outcome, replay, 0..1)?;
    report = report.appendix("All figures");
    report = errors(report, outcome);
    report = residuals(report, outcome, replay, 1..PICTURES)?;
    report = evidence(report, outcome);
    report = limits(report, outcome);
    report = levels(report, outcome, replay);
    report = refused(report, outcome);
    Ok(report)
}

/// The three stages, one sentence each.
fn stages(report: Report, outcome: &Outcome) -> Report {
    let held = outcome.error.held_out_runs.shaft_synchronous;
    let percent = |error: f64| format!("{:.1} %", 100.0 * error);
    report
        .section("How well the machine is described")
        .text(&format!(
            "As declared, the machine leaves {} of what is locked to the shafts unexplained.",
            percent(held.declared)
        ))
        .text(&format!("With its own parameters adjusted within their tolerances {} stay.", percent(held.calibrated)))
        .text(&format!(
            "With the findings {} stay; noise alone leaves {}.",
            percent(held.corrected),
            percent(held.noise_floor)
        ))
}

/// What is wrong with the record itself.
pub fn findings(report: Report, findings: &Findings) -> Report {
    let report = report.section("The record itself");
    let report = match findings.list.as_slice() {
        [] => report.text("No finding: channels, runs, tach and declaration fit each other."),
        list => list.iter().fold(report, |report, finding| report.note(&finding.text)),
    };
    report.text(&format!("Not checked: {}.", findings.not_checked.join("; ")))
}

fn errors(report: Report, outcome: &Outcome) -> Report {
    let rows = |name: &str, e: &StagedError| -> Vec<Vec<String>> {
        let row = |(part, s): (&str, Stages)| {
            let over = s.corrected / s.noise_floor.max(1e-300);
            let figures = [s.declared, s.calibrated, s.corrected, s.noise_floor, over].map(number);
            [vec![format!("{name}, {part}")], figures.to_vec()].concat()
        };
        e.parts().into_iter().map(row).collect()
    };
    let mut all = rows("fit runs", &outcome.error.fit_runs);
    all.extend(rows("held-out runs", &outcome.error.held_out_runs));
    let list = |runs: &[usize]| runs.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
    report
        .section("Error in three stages")
        .text(
            "Declared: the machine as its owner states it. Calibrated: its parameters fitted within their \
            tolerances, no effect. Corrected: with the effects, whose worth is corrected against calibrated. \
            Normalised RMS error of the prediction, phases from the tachometer alone; held-out runs take no part in \
            any fit but that of their own start (turns of the pinion, or phase of an order of neither shaft); a term \
            that does not lower their error is dropped.",
        )
        .table(
            "NRMSE, below 15 kHz",
            &[
                "",
                "declared",
                "calibrated",
                "corrected",
                "noise floor",
                "corrected / \
            floor",
            ],
            &all,
        )
        .text(&format!(
            "Runs to fit: {}; to select: {}; held out: {}.",
            list(&outcome.split[0]),
            list(&outcome.split[1]),
            list(&outcome.split[2])
        ))
}

/// Bins at the end of the band that are not drawn.
const SKIRT_BINS: usize = 4;

/// Two channels, each over orders and over frequency.
const PICTURES: usize = 4;

/// Some of them.
fn residuals(
    mut report: Report,
    outcome: &Outcome,
    replay: &Replay,
    pictures: std::ops::Range<usize>,
) -> Result<Report> {
    let Some(&run) = outcome.held_out_places().last() else { return Ok(report) };
    let base = &replay.declared;
    let (hz, bin) = (base.runs[run].angle.shaft_hz, 1.0 / base.analyser.duration_s());
    let z = f64::from(base.machine.teeth[0]);
    // Amplitudes of lines, from 8 Hz on, as the loop compares them.
    let series = |name: &str, bins: &[rustfft::num_complex::Complex64], scale: f64, top: f64| {
        // The window's skirt ends with the band: its last bins are no spectrum.
        let whole = bins.iter().enumerate().take(bins.len().saturating_sub(SKIRT_BINS)).skip((8.0 / bin) as usize);
        let points = whole.map(|(b, x)| (b as f64 * bin * scale, x.norm()));
        Series::new(name, points.take_while(|p| p.0 < top).collect())
    };
    report = report.section("Residual spectrum").text(&format!(
        "Held-out run {} at {hz:.3} Hz, {:.1} N m. Peak amplitudes, dB re 1 m/s2.",
        outcome.runs_used[run], base.runs[run].torque_n_m
    ));
    let axes = [(1.0 / hz, 3.6 * z, "order of the pinion"), (1.0, 15_000.0, "frequency, Hz")];
    let all_places = (0..2).flat_map(|channel| axes.map(|(scale, top, x)| (channel, scale, top, x)));
    for (channel, scale, top, x) in all_places.skip(pictures.start).take(pictures.len()) {
        let all = [
            series("record", &base.runs[run].measured[channel], scale, top),
            series("residual, declared", &replay.declared_residual[run][channel], scale, top),
            series("residual, corrected", &replay.corrected_residual[run][channel], scale, top),
        ];
        let in_orders = scale != 1.0;
        let mut owners = Owners::new(top / 60.0);
        if in_orders {
            for harmonic in 1..=3 {
                owners.claim(f64::from(harmonic) * z, format!("{harmonic} x mesh"));
            }
        }
        for e in outcome.effects.iter().filter(|_| in_orders) {
            let own = e.order_of_pinion.or(e.frequency_hz.map(|f| f / hz));
            let at = own.filter(|&order| stands(&all[0], order)).or_else(|| most_explained(&all[1], &all[2]));
            if let Some(x) = at {
                owners.claim(x, e.name.chars().take(28).collect::<String>());
            }
        }
        let labels = owners.labels();
        let svg = spectrum(&all, &labels, 1.0, 110.0, Axes { x, y: "dB re 1 m/s2" })?;
        report = report.picture(&svg, &format!("Channel {channel} over {x}."));
    }
    Ok(report)
}

/// Whether a line stands at an order: four times the median around it.
fn stands(record: &Series, order: f64) -> bool {
    let nearest = record.points.partition_point(|p| p.0 < order);
    let amplitudes = |reach: usize| {
        let (from, to) = (nearest.saturating_sub(reach), (nearest + reach).min(record.points.len()));
        record.points[from.min(to)..to].iter().map(|p| p.1).collect::<Vec<f64>>()
    };
    let mut around = amplitudes(60);
    around.sort_by(f64::total_cmp);
    let Some(&median) = around.get(around.len() / 2) else { return false };
    amplitudes(3).into_iter().any(|amplitude| amplitude > 4.0 * median)
}

/// Where the effects together explain most: their own order may show nothing, but their sidebands do.
fn most_explained(declared: &Series, corrected: &Series) -> Option<f64> {
    let gain = |(before, after): (&(f64, f64), &(f64, f64))| (before.0, before.1 - after.1);
    declared.points.iter().zip(&corrected.points).map(gain).max_by(|a, b| a.1.total_cmp(&b.1)).map(|(order, _)| order)
}

fn evidence(mut report: Report, outcome: &Outcome) -> Report {
    report = report.section("Effects and their evidence");
    if outcome.effects.is_empty() {
        return report.text(
            "No term earned its place: the declared machine, within its tolerances, explains what \
            stands above the noise.",
        );
    }
    for e in &outcome.effects {
        let v = &e.evidence;
        let mut rows = vec![
            vec!["family, shaft".to_string(), format!("{}, {}", e.family, e.shaft)],
            vec!["order of the pinion".into(), optional(e.order_of_pinion)],
            vec!["frequency, Hz".into(), optional(e.frequency_hz)],
            vec!["exponent of speed (95 %)".into(), interval(v.speed_exponent, v.speed_exponent_ci95)],
            vec!["exponent of torque (95 %)".into(), interval(v.torque_exponent, v.torque_exponent_ci95)],
            vec!["fall of the held-out error when added last".into(), number(v.held_out_gain)],
            vec![
                "p after correction for the search".into(),
                v.chance.map_or_else(|| "-".into(), |p| format!("{p} (log10 {:.1})", p.log10())),
            ],
            vec!["penalised log likelihood over the next name, nats".into(), optional(v.score_over_next)],
            vec!["left at its own lines beyond noise".into(), number(v.left_at_its_lines)],
        ];
        for (name, drop) in &v.next {
            rows.push(vec![format!("next: {name}"), format!("penalised log likelihood lower by {drop:.1}")]);
        }
        for (name, p) in e.parameters.iter().take(12) {
            let unit = if p.unit == "1" { "" } else { &p.unit };
            rows.push(vec![
                name.clone(),
                format!("{} ({} to {}) {unit}", number(p.value), number(p.ci95[0]), number(p.ci95[1])),
            ]);
        }
        if let Some(turns) = &e.pinion_turns_of_runs {
            let list: Vec<String> = turns.iter().map(u32::to_string).collect();
            rows.push(vec!["turns of the pinion by which each run starts later than counted".into(), list.join(", ")]);
        }
        if let Some(phases) = &e.phase_of_runs_rad {
            let list: Vec<String> = phases.iter().map(|p| number(*p)).collect();
            rows.push(vec!["phase of each run against the first, rad".into(), list.join(", ")]);
        }
        report = report.table(&e.verdict_and_name(), &["", ""], &rows);
        if let Some(reason) = &e.withheld_because {
            report = report.note(&format!("Name withheld: {reason}."));
        }
        if let Some(text) = &e.deciding_experiment {
            report = report.note(&format!("What would decide: {text}."));
        }
    }
    report
}

fn limits(report: Report, outcome: &Outcome) -> Report {
    if outcome.limits.is_empty() {
        return report;
    }
    let shown = |s: Option<f64>| s.map_or_else(|| "none tried".into(), |s| format!("{s:.2e}"));
    let rows: Vec<Vec<String>> = outcome
        .limits
        .iter()
        .map(|l| {
            let figures = [shown(l.found_in_half), shown(l.found_in_90_percent)];
            let [half, most] = figures;
            vec![l.family.clone(), l.at.clone(), half, most, l.unit.clone(), l.strength.clone()]
        })
        .collect();
    report.section("What would have been found").table(
        "Effects not found: smallest strength that this record would have shown, in half and in nine of ten of the \
         places tried (phase, tooth, order, starts of runs)",
        &["effect", "on", "in half from", "in 90 % from", "unit", "simulator's key"],
        &rows,
    )
}

fn levels(report: Report, outcome: &Outcome, replay: &Replay) -> Report {
    let rows: Vec<Vec<String>> = bands(replay, outcome)
        .iter()
        .map(|b| {
            vec![
                format!("channel {}, {} x mesh", b.channel, b.harmonic),
                format!("{:.2}", b.record_db),
                format!("{:.3}", b.declared_error_db),
                format!("{:.3}", b.corrected_error_db),
            ]
        })
        .collect();
    report
        .section("Band levels a node would report")
        .text(
            "RMS of each mesh harmonic with its sidebands on the held-out runs; errors of the model, RMS over the \
            runs.",
        )
        .table("dB re 1 m/s2", &["band", "record", "declared off by", "corrected off by"], &rows)
}

fn refused(report: Report, outcome: &Outcome) -> Report {
    let mut refused = outcome.refused.clone();
    refused.sort_by(|a, b| b.score.total_cmp(&a.score));
    let rows: Vec<Vec<String>> = refused
        .into_iter()
        .take(25)
        .map(|refused| vec![refused.name, format!("{:.1}", refused.score), refused.reason])
        .collect();
    let changes: Vec<Vec<String>> = outcome
        .declared_parameter_changes
        .iter()
        .map(|(name, change)| vec![name.clone(), format!("{:.3}", 100.0 * change)])
        .collect();
    let left: Vec<Vec<String>> = outcome
        .unexplained
        .iter()
        .map(|u| vec![u.description.clone(), format!("{:.4}", 100.0 * u.variance_share)])
        .collect();
    report
        .section("Considered and refused")
        .text(&format!(
            "Scores given in the search, for which probabilities are corrected: {}. {}",
            outcome.candidates_tried,
            outcome.null_records.map(|null| null.in_words()).unwrap_or_default()
        ))
        .table(
            "Best score of every explanation not taken (gain in likelihood less unknowns and search)",
            &["explanation", "score", "why not"],
            &rows,
        )
        .section("Declared parameters")
        .table("Adopted changes within tolerance", &["parameter", "change, %"], &changes)
        .section("What stays unexplained")
        .table("Share of the variance below 15 kHz, held-out runs", &["", "%"], &left)
}
