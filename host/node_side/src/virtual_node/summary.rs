//! A trial in tables: the same rows for the terminal and for the report.

use super::profile::Pace;
use super::signal::Signal;
use super::trial::{LineRow, Trial, Worst};

/// A table: head and rows.
pub struct Table {
    /// Column heads.
    pub head: Vec<&'static str>,
    /// Cells.
    pub rows: Vec<Vec<String>>,
}

/// Speeds and rates; at most `limit` rows, evenly picked, first and last included.
pub fn rates(trial: &Trial, limit: usize) -> Table {
    let count = trial.rates.len();
    let row = |i: usize| {
        let r = &trial.rates[i];
        vec![
            format!("{:.3}", r.time_s),
            format!("{:.4}", r.speed_hz),
            r.reference_speed_hz.map_or("-".into(), |hz| format!("{hz:.4}")),
            format!("{:.0}", r.bandwidth_hz),
            format!("{:.0}", r.requested_hz),
            format!("{:.1}", r.granted_hz),
            format!("{:+.0}", r.residual_ppm),
            format!("{:.0}", r.adc_hz),
            format!("{}", 1u32 << r.stages),
            r.flags.join("; "),
        ]
    };
    let picked: Vec<usize> = match limit {
        0 => Vec::new(),
        _ if count <= limit => (0..count).collect(),
        1 => vec![count - 1],
        _ => (0..limit).map(|k| k * (count - 1) / (limit - 1)).collect(),
    };
    let head = vec![
        "time, s",
        "speed, Hz",
        "from tach, Hz",
        "law, Hz",
        "requested at least, Hz",
        "granted, Hz",
        "above, ppm",
        "ADC, Hz",
        "divided by",
        "remark",
    ];
    Table { head, rows: picked.into_iter().map(row).collect() }
}

/// The last spectrum's harmonics (`sidebands` false) or sidebands, with the worst errors over all spectra.
pub fn lines(trial: &Trial, sidebands: bool) -> Option<Table> {
    let last = trial.spectra.last()?;
    let wanted = |line: &&LineRow| (line.sideband != 0) == sidebands;
    let rows = last.lines.iter().filter(wanted).map(|line| line_row(trial, line)).collect();
    let head = vec![
        "mesh line",
        "node, Hz",
        "reference, Hz",
        "error, %",
        "node",
        "reference",
        "error, dB",
        "worst, %",
        "worst, dB",
        "over floor, dB",
        "remark",
    ];
    Some(Table { head, rows })
}

fn line_row(trial: &Trial, line: &LineRow) -> Vec<String> {
    let same =
        |other: &&LineRow| (other.harmonic, other.shaft, other.sideband) == (line.harmonic, line.shaft, line.sideband);
    let all = || trial.spectra.iter().flat_map(|s| s.lines.iter().filter(same));
    let largest = |value: fn(&LineRow) -> f64| all().map(|l| value(l).abs()).fold(0.0, f64::max);
    vec![
        line.name(),
        format!("{:.3}", line.frequency_hz),
        format!("{:.3}", line.reference_hz),
        format!("{:+.4}", 100.0 * line.frequency_error),
        significant(line.amplitude),
        significant(line.reference_amplitude),
        format!("{:+.3}", line.amplitude_error_db),
        format!("{:.4}", 100.0 * largest(|l| l.frequency_error)),
        format!("{:.3}", largest(|l| l.amplitude_error_db)),
        format!("{:.0}", line.above_floor_db),
        remark(line),
    ]
}

/// Why a line is not to be taken at its name.
fn remark(line: &LineRow) -> String {
    match &line.not_separable_from {
        _ if line.beyond_signal => "above the signal's end".into(),
        _ if line.above_floor_db < super::trial::CLEAR_DB => "noise".into(),
        _ if line.below_strongest_db > super::trial::DEEPEST_DB => "skirt".into(),
        Some(other) => format!("not separable from {other}"),
        None if line.off_order_bins.abs() > super::trial::NEAR_BINS => "not the shaft's".into(),
        None => String::new(),
    }
}

/// Wideband peaks, strongest first.
pub fn peaks(trial: &Trial) -> Table {
    let strongest = trial.peaks.first().map_or(1.0, |peak| peak.amplitude);
    let row = |peak: &super::trial::PeakRow| {
        let origin = match (peak.harmonic, peak.folded) {
            (Some(h), true) => format!("mesh {h}x folded here"),
            (Some(h), false) => format!("mesh {h}x"),
            _ if peak.beyond_signal => "nothing: above the signal's end".into(),
            _ => String::new(),
        };
        let level = 20.0 * (peak.amplitude / strongest).log10();
        vec![format!("{:.2}", peak.frequency_hz), significant(peak.amplitude), format!("{level:.1}"), origin]
    };
    Table {
        head: vec!["peak, Hz", "amplitude", "below strongest, dB", "explained by"],
        rows: trial.peaks.iter().map(row).collect(),
    }
}

/// The closing lines: what was compared, what was lost.
pub fn verdicts(trial: &Trial, signal: &Signal) -> Vec<(String, String)> {
    let yes = |is: bool| if is { "yes" } else { "NO" }.to_string();
    let worst = |w: Worst| match w.lines {
        0 => "none stands clear of the noise".to_string(),
        n => {
            format!(
                "worst of {n}: {:.4} % in frequency, {:.3} dB in amplitude",
                100.0 * w.frequency_error,
                w.amplitude_error_db
            )
        }
    };
    let i = &trial.integrity;
    let second = signal.second.as_ref().map(|second| {
        let largest = trial.second.iter().fold(0.0, |largest: f64, row| largest.max(row.rms_error().abs()));
        let text = match trial.second.last() {
            None => "no record of values within the signal".into(),
            Some(last) => format!(
                "RMS {} {} (signal {}, worst of {}: {:.3} %), peak {}, kurtosis {:.3}, velocity {:.3} mm/s",
                significant(last.rms),
                signal.unit,
                significant(last.reference_rms),
                trial.second.len(),
                100.0 * largest,
                significant(last.peak),
                last.kurtosis,
                1e3 * last.velocity_rms
            ),
        };
        (format!("second sensor, {}", second.channel), text)
    });
    let mut lines = vec![
        ("spectra".into(), format!("{} compared, {} not covered by the signal", trial.spectra.len(), trial.uncompared)),
        ("harmonics".into(), worst(trial.worst_harmonics)),
        ("sidebands of both shafts".into(), worst(trial.worst_sidebands)),
        ("same bytes on the board and on the host".into(), yes(i.identical_to_host)),
        ("same codes sampled".into(), yes(i.identical_codes)),
    ];
    lines.extend(second);
    if let Some(same) = i.identical_runs {
        lines.push(("same bytes in every run".into(), yes(same)));
    }
    let blocks =
        format!("{} processed, {} lost, {} rate changes (at borders)", i.blocks, i.blocks_lost, i.rate_changes);
    lines.push((format!("blocks at {} MIPS", i.mips), blocks));
    if !i.on_schedule {
        let what = "the processor was late: rates changed later than planned, or blocks were lost; the host took the \
            same blocks";
        lines.push(("schedule".into(), what.into()));
    }
    lines.push(("lost".into(), format!("{} tach edges, {} frames", i.edges_lost, i.frames_lost)));
    let events: Vec<String> = i.events.iter().map(|(kind, count)| format!("{kind} {count}")).collect();
    lines.push(("events".into(), if events.is_empty() { "none".into() } else { events.join(", ") }));
    if signal.duration_s() > trial.duration_s + 0.01 {
        let what =
            format!("{:.2} s of {:.2} s: the board's memory holds no more", trial.duration_s, signal.duration_s());
        lines.push(("replayed".into(), what));
    }
    lines.extend(signal.notes.iter().map(|note| ("note".into(), note.clone())));
    lines
}

/// Instruction rates tried.
pub fn paces(paces: &[Pace]) -> Table {
    let row = |pace: &Pace| {
        let verdict = match (pace.lost, pace.identical_to_host) {
            (0, true) => "keeps up",
            (0, false) => "late, none lost",
            _ => "too slow",
        };
        vec![format!("{}", pace.mips), pace.blocks.to_string(), pace.lost.to_string(), verdict.into()]
    };
    Table { head: vec!["MIPS", "blocks", "lost", "verdict"], rows: paces.iter().map(row).collect() }
}

/// Four significant digits.
fn significant(value: f64) -> String {
    match value.abs() {
        size if !(1e-4..1e5).contains(&size) => format!("{value:.3e}"),
        size => format!("{value:.*}", (3 - size.log10().floor() as i32).max(0) as usize),
    }
}
