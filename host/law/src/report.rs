//! Pictures and tables of the law's commands: the paper's Tables 2 to 6 and Figure 7, redone.

use super::derive::{Check, Laws};
use super::forms::Law;
use super::outcome::Outcome;
use super::sampling::{RateCase, SamplingStudy};
use super::study::{CrackStudy, Row, Sweep};
use crate::Result;
use meshband_common::report::Report;
use meshband_common::report::plot::{Axes, Label, Series, fit_with_residual, lines, spectrum, stems};

const SPEED: &str = "pinion speed, Hz";
const BANDWIDTH: &str = "bandwidth, kHz";

/// kHz with three digits after the point, a dash where there is none.
pub fn khz(hz: Option<f64>) -> String {
    hz.map_or("-".into(), |hz| format!("{:.3}", hz * 1e-3))
}

fn unsigned(share: f64) -> String {
    format!("{:.3} %", 100.0 * share)
}

fn percent(share: f64) -> String {
    format!("{:+.3} %", 100.0 * share)
}

/// The coefficients of every form with their intervals.
pub fn law_rows(laws: &Laws) -> Vec<Vec<String>> {
    let names = |law: &Law| -> Vec<&'static str> {
        match law {
            Law::Quadratic { .. } => vec!["a, Hz/Hz2", "b, Hz/Hz", "c, Hz"],
            Law::RootSumSquare { .. } => vec!["a, turns", "t_mode, s"],
            Law::RampThroughMode { .. } => vec!["ramp, rad", "mode, Hz"],
            Law::Tabulated { .. } => vec![],
        }
    };
    let mut rows = Vec::new();
    for fit in &laws.fits {
        if let Law::Tabulated { knots } = &fit.law {
            let range = format!("{:.1} to {:.1} Hz", knots[0].0, knots[knots.len() - 1].0);
            rows.push(vec![fit.law.name().into(), format!("{} knots", knots.len()), range, String::new()]);
        }
        for ((name, value), half) in names(&fit.law).iter().zip(fit.law.coefficients()).zip(&fit.half_width_95) {
            rows.push(vec![fit.law.name().into(), (*name).into(), format!("{value:.6e}"), format!("{half:.1e}")]);
        }
    }
    rows
}

/// Head of [`law_rows`].
pub const LAW_HEAD: [&str; 4] = ["form", "coefficient", "value", "half width of the 95 % interval"];

/// Errors of every form at held-out speeds.
pub fn check_rows(check: &Check) -> Vec<Vec<String>> {
    let row = |f: &super::derive::FormCheck| {
        let mut row = vec![f.form.to_string()];
        row.extend(f.at_named.iter().map(|&e| percent(e)));
        row.extend([f.worst, f.worst_periodic].map(unsigned));
        row.push(percent(f.beyond));
        row
    };
    check.forms.iter().map(row).collect()
}

/// Head of [`check_rows`].
pub fn check_head(check: &Check) -> Vec<String> {
    let at = |hz: &f64| format!("{} Hz", (100.0 * hz).round() / 100.0);
    let mut head = vec!["form".to_string()];
    head.extend(check.named_hz.iter().map(at));
    head.extend(["worst, edge alone", "worst, with the ring"].map(String::from));
    head.push(format!("at {}", at(&check.beyond_hz)));
    head
}

fn sweep_rows(sweep: &Sweep) -> Vec<Vec<String>> {
    let row = |r: &Row| {
        let rise = r.exit_rise_s.map_or("-".into(), |t| format!("{:.3}", t * 1e6));
        vec![r.label.clone(), rise, khz(r.exit_hz), khz(r.alone_hz), khz(r.entry_hz), khz(Some(r.occupied_hz))]
    };
    sweep.rows.iter().map(row).collect()
}

const SWEEP_HEAD: [&str; 6] =
    ["", "rise time, us", "positive pulse, kHz", "the same alone, kHz", "negative pulse, kHz", "99 % occupied, kHz"];

/// Bandwidth over speed with the forms, then the table with its residuals.
pub fn law_section(report: Report, laws: &Laws) -> Result<Report> {
    let points: Vec<(f64, f64)> = laws.points.iter().map(|p| (p.shaft_hz, 1e-3 * p.bandwidth_hz)).collect();
    let speeds = points.iter().map(|p| p.0);
    let (lowest, highest) = (speeds.clone().fold(f64::INFINITY, f64::min), speeds.fold(0.0, f64::max));
    let curve = |law: &Law| -> Vec<(f64, f64)> {
        let places = (0..=480).map(|i| lowest + (highest - lowest) * f64::from(i) / 480.0);
        places.map(|f| (f, 1e-3 * law.bandwidth_hz(f))).collect()
    };
    let mut report = report.section("The law: bandwidth over pinion speed");
    for (fit, what) in [(&laws.fits[3], "tabulated law"), (&laws.fits[0], "quadratic law")] {
        let residuals: Vec<(f64, f64)> = laws
            .points
            .iter()
            .map(|p| (p.shaft_hz, 100.0 * (fit.law.bandwidth_hz(p.shaft_hz) / p.bandwidth_hz - 1.0)))
            .collect();
        let picture = fit_with_residual(
            &Series::new("simulated engagement edge", points.clone()),
            &Series::new(what, curve(&fit.law)),
            &residuals,
            Axes { x: SPEED, y: BANDWIDTH },
            "error, %",
        )?;
        let caption = format!(
            "{what}: points from the simulation, curve from the law, error below. Largest error at the fitted speeds \
             {:.2} %.",
            100.0 * fit.worst_relative
        );
        report = report.picture(&picture, &caption);
    }
    Ok(report.table("Coefficients.", &LAW_HEAD, &law_rows(laws)).note(
        "The law belongs to this machine with this engagement ramp. Limited by the ramp, B is proportional to speed (a \
         fixed angle is turned in less time); limited by the mesh mode, below the knee, it is not.",
    ))
}

/// Errors at held-out speeds.
pub fn check_section(report: Report, check: &Check) -> Result<Report> {
    let error = |i: usize| -> Vec<(f64, f64)> {
        let mut points: Vec<(f64, f64)> =
            check.rows.iter().map(|r| (r.shaft_hz, 100.0 * (r.by_form_hz[i] / r.bandwidth_hz - 1.0))).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    };
    let series: Vec<Series> = [0, 2, 3].into_iter().map(|i| Series::new(check.forms[i].form, error(i))).collect();
    let picture = lines(&series, Axes { x: SPEED, y: "error, %" })?;
    let ring = format!(
        "Scatter of the full simulation about the single edge (the ring of earlier engagements): {:.2} % rms, {:.2} \
         % at \
         most; hidden by the ring at {} of {} speeds.",
        100.0 * check.ring_rms,
        100.0 * check.ring_worst,
        check.hidden,
        check.rows.len()
    );
    let head = check_head(check);
    let head: Vec<&str> = head.iter().map(String::as_str).collect();
    Ok(report
        .section("At speeds that were not fitted")
        .text(&check.reliance())
        .picture(&picture, "Error of each form at three named and fifty random speeds.")
        .table(
            "Errors; the last column is an extrapolation to twice the highest fitted speed.",
            &head,
            &check_rows(check),
        )
        .text(&ring))
}

/// The report of `law study`.
///
/// # Errors
/// A picture that cannot be drawn.
pub fn study_report(o: &Outcome) -> Result<Report> {
    let table = &o.check.forms[3];
    let mut report = Report::new(
        "Bandwidth law",
        &format!(
            "{}: engagement edges at {} Hz and {:.1} N m, and what their bandwidth depends on",
            o.machine, o.shaft_hz, o.torque_n_m
        ),
    )
    .figure("Bandwidth at 14.5 Hz", format!("{:.2} kHz", o.laws.fits[3].law.bandwidth_hz(14.5) * 1e-3))
    .figure("Ramp of this machine", format!("{:.3} mrad", 1e3 * o.laws.ramp_width_rad))
    .figure("Law, held-out error", format!("{:.2} %", 100.0 * table.worst))
    .figure("Quadratic, held-out error", format!("{:.1} %", 100.0 * o.check.forms[0].worst))
    .figure("Waveform rate", waveform_rate(o.estimator.waveform_multiple));
    if let Some(crack) = o.crack.as_ref().and_then(|c| c.last()) {
        let worst = crack.pulses.iter().map(|p| p.deviation.abs()).fold(0.0, f64::max);
        report = report.figure("Crack changes B by", format!("{:.2} % at most", 100.0 * worst));
    }
    report = edge_section(report, o)?;
    report = calibration_section(report, o)?;
    for (sweep, heading) in [(&o.module, "Module (Table 2)"), (&o.teeth, "Tooth numbers (Table 3)")] {
        if let Some(sweep) = sweep {
            let spread =
                format!("Largest minus smallest over mean: {:.2} % (the paper: about 1 %).", 100.0 * sweep.spread());
            report = report.section(heading).table(&spread, &SWEEP_HEAD, &sweep_rows(sweep));
        }
    }
    report = law_section(report, &o.laws)?.text("In the paper: Table 4, equation 10 (the quadratic law), Figure 7.");
    report = report.table(
        "Every whole speed (Table 4); the last row is beyond the law's domain.",
        &SWEEP_HEAD,
        &sweep_rows(&o.speed),
    );
    report = slope_section(report, o)?;
    report = check_section(report, &o.check)?.text("In the paper: Table 6.");
    report = report.section("Torque").table(
        &format!(
            "Largest minus smallest over mean: {:.3} %. With a ramp fixed in angle the model is linear in the load.",
            100.0 * o.torque.spread()
        ),
        &SWEEP_HEAD,
        &sweep_rows(&o.torque),
    );
    report = ramp_section(report, o)?;
    if let Some(crack) = &o.crack {
        report = crack_section(report, o, crack)?;
    }
    if let Some(sampling) = &o.sampling {
        for study in sampling {
            report = sampling_section(report, study)?;
        }
        report = implied_section(report, o);
    }
    estimator_section(report, o)
}

fn edge_section(report: Report, o: &Outcome) -> Result<Report> {
    let picture = lines(
        &[
            Series::new("acceleration of the pinion", o.pictures.edge.clone()),
            Series::new("begin, 10 %, 90 %, end", o.pictures.edge_marks.clone()),
        ],
        Axes { x: "time about the edge, us", y: "acceleration, m/s2" },
    )?;
    Ok(report
        .section("What is timed")
        .text(
            "An edge is the stretch around a local maximum of |slope| over which the slope keeps its sign and stays \
             above a \
             third of that maximum; its rise time is the 10-90 % time between the values at its ends, and B = 0.35 / \
             t_r. The \
             law times the edge with which a pair gives its load off. Between extrema one would time the ring instead.",
        )
        .picture(&picture, "One positive pulse: the acceleration climbs while the leaving pair's stiffness falls."))
}

fn calibration_section(report: Report, o: &Outcome) -> Result<Report> {
    let c = &o.calibration;
    let mrad = |w: f64| format!("{:.4}", 1e3 * w);
    let speeds: Vec<Vec<String>> = c.by_speed.iter().map(|&(f, w)| vec![format!("{f}"), mrad(w)]).collect();
    let widths: Vec<Vec<String>> = c.by_width.iter().map(|&(w, b)| vec![mrad(w), khz(Some(b))]).collect();
    Ok(report
        .section("The ramp is a calibration")
        .text(&format!(
            "One bandwidth of the paper survives, {:.2} kHz; its speed is inferred, {} Hz. A linear ramp of {} mrad \
             of pinion \
             rotation gives it on this machine. That is a calibration, not a result: a stiffness table with 1 mrad \
             steps has \
             just such a ramp. Everything else on this page follows from it without further adjustment.",
            c.target_hz * 1e-3,
            c.shaft_hz,
            mrad(c.width_rad)
        ))
        .table("If the bandwidth belongs to another speed, the ramp is another.", &["speed, Hz", "ramp, mrad"], &speeds)
        .table(
            "If the ramp is another, so is the bandwidth at that speed: inversely proportional.",
            &[
                "ramp, \
            mrad",
                "bandwidth, kHz",
            ],
            &widths,
        ))
}

fn slope_section(report: Report, o: &Outcome) -> Result<Report> {
    let points: Vec<(f64, f64)> =
        o.speed.rows.iter().filter_map(|r| Some((r.value, r.exit_hz?))).filter(|p| p.0 <= 25.0).collect();
    let slopes: Vec<(f64, f64)> =
        points.windows(2).map(|w| (0.5 * (w[0].0 + w[1].0), 1e-3 * (w[1].1 - w[0].1) / (w[1].0 - w[0].0))).collect();
    let picture = stems(&[Series::new("slope", slopes)], Axes { x: SPEED, y: "slope, kHz per Hz" })?;
    Ok(report.picture(
        &picture,
        "Difference of bandwidths over difference of speeds (Table 5): negative below the knee, then nearly constant.",
    ))
}

fn ramp_section(report: Report, o: &Outcome) -> Result<Report> {
    let series: Vec<Series> = o
        .ramps
        .iter()
        .map(|r| {
            let points = r.sweep.rows.iter().filter(|row| row.value <= 25.0);
            Series::new(
                &r.name,
                points.filter_map(|row| Some((row.value, 1e-3 * row.alone_hz?))).filter(|p| p.1 < 110.0).collect(),
            )
        })
        .collect();
    let at = |r: &super::study::RampStudy, f: f64| {
        khz(r.sweep.rows.iter().find(|row| row.value == f).and_then(|row| row.alone_hz))
    };
    let rows: Vec<Vec<String>> = o
        .ramps
        .iter()
        .map(|r| {
            vec![
                r.name.clone(),
                format!("{:.3}", r.width_mrad),
                at(r, 5.0),
                at(r, 15.0),
                at(r, 25.0),
                unsigned(r.table_worst),
                unsigned(r.quadratic_worst),
                format!("{:.1} %", 100.0 * r.ring_rms),
                format!("{} of 53", r.hidden),
            ]
        })
        .collect();
    let head = [
        "ramp",
        "width, mrad",
        "B at 5 Hz, kHz",
        "15 Hz",
        "25 Hz",
        "table, held out",
        "quadratic, held out",
        "ring, rms",
        "hidden by ring",
    ];
    Ok(report
        .section("The engagement ramp decides")
        .picture(
            &lines(&series, Axes { x: SPEED, y: BANDWIDTH })?,
            "Bandwidth of the single engagement edge for \
            different ramps on the same machine.",
        )
        .table("The same gear, the same speeds, other ramps.", &head, &rows)
        .note(
            "A real gear engages over several mrad (tip relief, deflected teeth touching early). Its edges are then \
             the mesh \
             mode's own, 7 to 20 kHz at these speeds, almost independent of speed at first; and in the full \
             simulation the ring \
             of earlier engagements moves single edges by tens of per cent, so no law in speed alone can predict \
             them to 2 %. \
             A law proportional to speed is a property of the short ramp.",
        ))
}

fn crack_section(report: Report, o: &Outcome, studies: &[CrackStudy]) -> Result<Report> {
    let picture = lines(
        &[Series::new("cracked", o.pictures.cracked.clone()), Series::new("healthy", o.pictures.healthy.clone())],
        Axes { x: "time since the cracked pair entered, ms", y: "acceleration, m/s2" },
    )?;
    let mut rows = Vec::new();
    for study in studies {
        for pulse in &study.pulses {
            rows.push(vec![
                format!("{:.2}", 1e3 * study.depth_m),
                format!("{:.1} %", 100.0 * study.stiffness_loss),
                pulse.label.clone(),
                khz(Some(pulse.bandwidth_hz)),
                percent(pulse.deviation),
            ]);
        }
    }
    Ok(report
        .section("Root crack: three peaks and three troughs")
        .picture(
            &picture,
            "The deepest crack against the healthy gear, over the mesh periods in which the cracked tooth works.",
        )
        .table(
            "Bandwidth of each pulse against the healthy pulse of its kind.",
            &["depth, mm", "stiffness lost", "pulse", "bandwidth, kHz", "difference"],
            &rows,
        ))
}

fn sampling_section(report: Report, study: &SamplingStudy) -> Result<Report> {
    let what = if study.cracked { "cracked" } else { "healthy" };
    let mut report =
        report.section(&format!("Sampled at 10, 100 and 1000 kHz: {what}, mesh frequency {:.3} Hz", study.mesh_hz));
    for case in &study.rates {
        let rate = format!("{:.0} kHz", case.rate_hz * 1e-3);
        let waveform =
            lines(&[Series::new(&rate, case.waveform.clone())], Axes { x: "time, ms", y: "acceleration, m/s2" })?;
        report = report.picture(&waveform, &format!("{rate}, six mesh periods. {}", waveform_words(case)));
        let labels = labels(case, study);
        let picture = spectrum(
            &[Series::new(&rate, case.spectrum.clone())],
            &labels,
            1.0,
            100.0,
            Axes { x: "frequency, Hz", y: "amplitude, dB re 1 m/s2" },
        )?;
        report = report.picture(&picture, &spectrum_words(case, study.cracked));
    }
    let rows: Vec<Vec<String>> = study
        .unknown
        .iter()
        .map(|u| {
            vec![
                format!("{:.1}", u.quoted_hz),
                format!("{:.3}", u.found_hz),
                format!("{:+.3}", u.found_hz - u.quoted_hz),
                u.harmonic.map_or("none".into(), |h| format!("{h}x, folded")),
                format!("{:.1}", u.over_mesh_line),
            ]
        })
        .collect();
    Ok(report.table(
        "The lines that the paper calls unknown, found in this simulation at 10 kHz.",
        &["quoted, Hz", "found, Hz", "difference, Hz", "mesh harmonic", "times the mesh line"],
        &rows,
    ))
}

/// The rate in multiples of the bandwidth, or that none of those tried is enough.
fn waveform_rate(multiple: f64) -> String {
    if multiple.is_finite() { format!("{multiple:.0} B") } else { "beyond all rates tried".into() }
}

fn waveform_words(case: &RateCase) -> String {
    format!(
        "Rate over twice the bandwidth: {:.2}. The largest value differs from period to period by {:.1} % rms.",
        case.critical_share,
        100.0 * case.peak_scatter
    )
}

fn spectrum_words(case: &RateCase, cracked: bool) -> String {
    let folded = case.strongest_folded_db.map_or("No folded line among the ten strongest.".into(), |db| {
        format!("Strongest folded line {db:+.0} dB against the mesh line.")
    });
    let sidebands =
        if cracked { format!(" Sidebands findable: {} of 12.", case.sidebands_findable) } else { String::new() };
    format!("Spectrum at {:.0} kHz; nx is a mesh harmonic, (nx) a folded one. {folded}{sidebands}", case.rate_hz * 1e-3)
}

/// Mesh harmonics by number, folded ones in brackets, the paper's unknown lines with their frequency where they fold.
fn labels(case: &RateCase, study: &SamplingStudy) -> Vec<Label> {
    let unknown = |hz: f64| study.unknown.iter().find(|u| (u.found_hz - hz).abs() < 1.0);
    let named = case.lines.iter().filter_map(|l| {
        let text = match (l.harmonic?, l.folded) {
            (h, true) if unknown(l.hz).is_some() => format!("({h}x) {:.1}", l.hz),
            (h, true) => format!("({h}x)"),
            (h, false) => format!("{h}x"),
        };
        Some(Label { x: l.hz, text })
    });
    named.collect()
}

fn implied_section(report: Report, o: &Outcome) -> Report {
    let rows: Vec<Vec<String>> = super::paper::UNKNOWN_LINES
        .iter()
        .zip(&o.implied)
        .map(|(l, i)| {
            vec![
                l.case.into(),
                format!("{} / {}", l.lines_hz[0], l.lines_hz[1]),
                format!("{}x / {}x", l.harmonics[0], l.harmonics[1]),
                format!("{:.3} / {:.3}", i.by_line_hz[0], i.by_line_hz[1]),
                format!("{:.4} %", 100.0 * i.disagreement.abs()),
                percent(i.from_quoted),
            ]
        })
        .collect();
    report.section("What the unknown lines say about the mesh frequency").table(
        "Each line alone implies a mesh frequency; the pair's disagreement, and the difference from the quoted mesh \
         line.",
        &["spectrum", "lines, Hz", "harmonics", "implied mesh, Hz", "disagreement", "from quoted"],
        &rows,
    )
}

fn estimator_section(report: Report, o: &Outcome) -> Result<Report> {
    let e = &o.estimator;
    let sampled: Vec<(f64, f64)> =
        e.sampled.iter().filter_map(|r| Some((r.samples_per_edge, 100.0 * r.error?))).collect();
    let cut: Vec<(f64, f64)> =
        e.cut_off.iter().filter_map(|r| Some((r.multiple, 100.0 * r.error?))).filter(|p| p.1 < 12.0).collect();
    Ok(report
        .section("The node's estimator, and the rate for waveforms")
        .picture(
            &lines(
                &[Series::new("median of 64 teeth", sampled)],
                Axes {
                    x: "samples per edge",
                    y: "error of the \
                rise time, %",
                },
            )?,
            &format!(
                "The sampled estimator against the polynomial. Below five samples per edge it refuses; within 2 \
                % from {:.1} samples on.",
                e.samples_needed
            ),
        )
        .picture(
            &lines(
                &[Series::new("cut off at k B / 2", cut)],
                Axes {
                    x: "k, rate over bandwidth",
                    y: "error of the \
                rise time, %",
                },
            )?,
            &format!(
                "Everything above half the rate k B removed by an ideal filter: the rise time stays within 2 % from \
                 k = {:.1} on. The \
                 waveform rate is the larger demand, {:.1} B.",
                e.cut_off_multiple, e.waveform_multiple
            ),
        ))
}
