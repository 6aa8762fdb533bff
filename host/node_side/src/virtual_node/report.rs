//! A trial in pictures: rate plan, mesh bands with the node's lines on the reference spectrum, errors, waveform.

use super::analogue::Interpolator;
use super::profile::Pace;
use super::reference::{Reference, Shaft};
use super::signal::Signal;
use super::summary::{self, Table};
use super::trial::{SpectrumRow, Trial};
use crate::Result;
use crate::report::Report;
use crate::report::facts::Facts;
use crate::report::plot::{self, Axes, Label, Series};

/// Builds the report.
///
/// # Errors
/// A picture that cannot be drawn.
pub fn build(trial: &Trial, signal: &Signal, paces: &[Pace]) -> Result<Report> {
    let title = format!("Node on {}", signal.title);
    let subtitle = format!("{}: the firmware on a virtual board against an f64 reference", signal.channel);
    let worst = trial.worst_harmonics;
    let yes = |is: bool| if is { "yes" } else { "no" };
    let mut report = Report::new(&title, &subtitle)
        .verdict(letter(trial, signal))
        .facts(facts(trial, signal))
        .figure("Signal replayed", format!("{:.2} s", trial.duration_s))
        .figure("Spectra compared", trial.spectra.len())
        .figure("Frequency of harmonics", percent(worst.lines, worst.frequency_error))
        .figure("Amplitude of harmonics", decibels(worst.lines, worst.amplitude_error_db))
        .figure("Same bytes as on the host", yes(trial.integrity.identical_to_host))
        .figure("Blocks lost", trial.integrity.blocks_lost);
    report = with_table(
        report.section("Mesh lines"),
        summary::lines(trial, false),
        &format!(
            "Mesh harmonics of the last spectrum, amplitude in {}; the two columns of worst errors are over all \
             spectra.",
            signal.unit
        ),
    );
    if let Some(first) = trial.spectra.last().and_then(|spectrum| Some((spectrum, *harmonics(spectrum).first()?))) {
        let (spectrum, harmonic) = first;
        report = report.picture(&mesh_band(signal, spectrum, harmonic)?, &band_caption(spectrum, harmonic));
    }
    report = report.appendix("Every band, rate and check");
    if let Some(spectrum) = trial.spectra.last() {
        for harmonic in harmonics(spectrum).into_iter().skip(1) {
            report = report.picture(&mesh_band(signal, spectrum, harmonic)?, &band_caption(spectrum, harmonic));
        }
        report = report.picture(&errors(trial)?, "Error of every line that stands clear of the noise, all spectra.");
        let caption = "Sidebands in turns of the pinion, then of the gear. What is not a clear line of that shaft is \
            marked and left out of the worst errors.";
        report = with_table(report.section("Sidebands"), summary::lines(trial, true), caption);
    } else {
        report = report.note("No mesh-band spectrum: the run was too short, or the speed was never locked.");
    }
    report = report
        .section("Speed and rates")
        .text(
            "The tachometer gives the speed, the law the bandwidth, the policy the rate; the timer grants the \
            nearest whole number of ticks, at block borders only.",
        )
        .picture(&speeds(trial)?, "Speed as the node reports it and as the tach edges give it in f64.")
        .picture(
            &rate_plan(trial)?,
            "The converter's rate stays where the fixed analogue filter allows it; \
            decimation by powers of two makes the rate asked for.",
        );
    report = with_table(report, Some(summary::rates(trial, 60)), "Reports of the node.");
    let peaks = summary::peaks(trial);
    if !peaks.rows.is_empty() {
        let caption = format!("Strongest lines of the wideband spectrum, spacing {:.2} Hz.", trial.peak_resolution_hz);
        report = with_table(report.section("Wideband peaks"), Some(peaks), &caption);
    }
    report = report
        .section("Waveform")
        .picture(&waveform(trial, signal)?, "The signal on the wire and the converter's codes, near the end.")
        .section("Integrity");
    let rows: Vec<Vec<String>> =
        summary::verdicts(trial, signal).into_iter().map(|(name, value)| vec![name, value]).collect();
    report = report.table("What was compared, and what was lost.", &["check", "result"], &rows);
    if !paces.is_empty() {
        let table = summary::paces(paces);
        let caption = "The same record at other instruction rates. The QEMU board spends some 100 instructions per \
            sample on converter and DMA.";
        report = with_table(report.section("Instruction rate"), Some(table), caption);
    }
    Ok(report)
}

fn band_caption(spectrum: &SpectrumRow, harmonic: u8) -> String {
    format!(
        "Mesh harmonic {harmonic}: reference spectrum of the same {:.2} s and the lines the node sent; bins of {:.2} \
         Hz.",
        spectrum.length_s, spectrum.resolution_hz
    )
}

/// What was tried, how the node did, what to do.
fn letter(trial: &Trial, signal: &Signal) -> Vec<String> {
    let integrity = &trial.integrity;
    let whole = integrity.identical_to_host && integrity.blocks_lost == 0;
    let first = format!(
        "The firmware on a virtual board was fed {:.2} s of {}, {}.",
        trial.duration_s, signal.title, signal.channel
    );
    let worst = trial.worst_harmonics;
    let second = if trial.spectra.is_empty() {
        "It sent no mesh bands: the signal is too short, or its speed was never locked.".to_owned()
    } else {
        format!(
            "Its mesh lines are {} in frequency and {} in amplitude of the double-precision reference; {}.",
            percent(worst.lines, worst.frequency_error),
            decibels(worst.lines, worst.amplitude_error_db),
            if whole {
                "nothing was lost and every byte is the host's"
            } else {
                "but it lost blocks, or differs from the host"
            }
        )
    };
    let third = match (trial.spectra.is_empty(), whole) {
        (true, _) => "Next: a longer stretch (--duration), or another (--start).",
        (false, true) => "Next: nothing; a board with this firmware will report this machine so.",
        (false, false) => "Next: see the table of checks; a slower processor shows so, too (--icount-shift).",
    };
    vec![first, second, third.into()]
}

fn facts(trial: &Trial, signal: &Signal) -> Facts {
    let [pinion, gear] = signal.teeth;
    let speed = trial.spectra.last().map_or("not locked".into(), |s| format!("{:.3} Hz at the end", s.speed_hz));
    [
        ("signal", signal.place.clone()),
        ("teeth, pinion and gear", format!("{pinion} and {gear}")),
        ("speed of the pinion", speed),
        ("sampling of the signal", format!("{} Hz, {:.2} s", signal.rate_hz, signal.duration_s())),
        ("sensor", format!("{}, in {}", signal.channel, signal.unit)),
    ]
    .map(|(name, value)| (name.to_owned(), value))
    .to_vec()
}

fn percent(lines: usize, error: f64) -> String {
    if lines == 0 { "-".into() } else { format!("within {:.4} %", 100.0 * error) }
}

fn decibels(lines: usize, error: f64) -> String {
    if lines == 0 { "-".into() } else { format!("within {error:.3} dB") }
}

fn with_table(report: Report, table: Option<Table>, caption: &str) -> Report {
    match table {
        Some(table) => report.table(caption, &table.head, &table.rows),
        None => report,
    }
}

fn harmonics(spectrum: &SpectrumRow) -> Vec<u8> {
    spectrum.lines.iter().filter(|line| line.sideband == 0).map(|line| line.harmonic).collect()
}

/// The reference spectrum around a harmonic, the node's lines as spikes.
fn mesh_band(signal: &Signal, row: &SpectrumRow, harmonic: u8) -> Result<String> {
    let lines: Vec<_> = row.lines.iter().filter(|line| line.harmonic == harmonic).collect();
    let reach =
        lines.iter().filter(|l| l.shaft == "pinion").map(|line| line.sideband.abs()).max().unwrap_or(0) as f64 + 0.7;
    let centre = lines.iter().find(|line| line.sideband == 0).map_or(0.0, |line| line.reference_hz);
    let (from, to) = (centre - reach * row.speed_hz, centre + reach * row.speed_hz);
    let scale = signal.unit.scale();
    let order = f64::from(harmonic) * f64::from(signal.teeth[0]);
    let turning = Shaft::new(signal);
    let reference = turning.and_then(|turning| Reference::over(signal, &turning, row.start_s, row.turns));
    let background = reference.map(|r| r.spectrum(order, reach)).unwrap_or_default();
    let background = background.into_iter().map(|(o, value)| (o * row.speed_hz, value / scale)).collect();
    // Wider than a column of the picture, so that a spike stays one.
    let half = 0.002 * (to - from);
    let mut sorted = lines.clone();
    sorted.sort_by(|a, b| a.frequency_hz.total_cmp(&b.frequency_hz));
    let spike = |line: &&super::trial::LineRow| {
        let (x, y) = (line.frequency_hz, line.amplitude);
        [(x - half, 0.0), (x, y), (x + half, 0.0)]
    };
    let spikes = sorted.iter().flat_map(spike).collect();
    // The gear's sidebands are many: spikes without labels. What does not stand clear has no name.
    let labelled = lines.iter().filter(|line| line.shaft == "pinion" && line.is_clear());
    let labels: Vec<Label> = labelled.map(|line| Label { x: line.frequency_hz, text: line.name() }).collect();
    let series = [Series::new("reference", background), Series::new("node", spikes)];
    plot::spectrum(&series, &labels, 1.0, 80.0, Axes { x: "frequency, Hz", y: &format!("dB re 1 {}", signal.unit) })
}

fn errors(trial: &Trial) -> Result<String> {
    let points = |sidebands: bool| {
        let lines =
            trial.spectra.iter().flat_map(|s| &s.lines).filter(|l| l.is_clear() && (l.sideband != 0) == sidebands);
        let mut points: Vec<(f64, f64)> = lines.map(|l| (l.reference_hz, l.amplitude_error_db)).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    };
    let series = [Series::new("sidebands", points(true)), Series::new("harmonics", points(false))];
    plot::stems(&series, Axes { x: "frequency, Hz", y: "amplitude error, dB" })
}

fn speeds(trial: &Trial) -> Result<String> {
    let node = trial.rates.iter().filter(|r| r.speed_hz > 0.0).map(|r| (r.time_s, r.speed_hz)).collect();
    let tach = trial.rates.iter().filter_map(|r| Some((r.time_s, r.reference_speed_hz?))).collect();
    let series = [Series::new("tach edges, f64", tach), Series::new("node", node)];
    plot::lines(&series, Axes { x: "time, s", y: "speed, Hz" })
}

fn rate_plan(trial: &Trial) -> Result<String> {
    let steps = |points: Vec<(f64, f64)>| {
        let mut out: Vec<(f64, f64)> = Vec::new();
        for (x, y) in points {
            if let Some(&(_, before)) = out.last() {
                out.push((x, before));
            }
            out.push((x, y / 1000.0));
        }
        if let Some(&(_, y)) = out.last() {
            out.push((trial.duration_s, y));
        }
        out
    };
    let reported =
        |value: fn(&super::trial::RateRow) -> f64| trial.rates.iter().map(|r| (r.time_s, value(r))).collect();
    let series = [
        Series::new("converter", steps(trial.blocks.clone())),
        Series::new("granted after decimation", steps(reported(|r| r.granted_hz))),
        Series::new("requested", steps(reported(|r| r.requested_hz))),
        Series::new("law's bandwidth", steps(reported(|r| r.bandwidth_hz))),
    ];
    plot::lines(&series, Axes { x: "time, s", y: "kHz" })
}

/// About three mesh periods, at least 40 samples.
fn waveform(trial: &Trial, signal: &Signal) -> Result<String> {
    let mesh_hz = trial.spectra.last().and_then(|s| s.lines.first().map(|line| line.frequency_hz)).unwrap_or(1000.0);
    let Some(&(first, _)) = trial.samples.first() else { return plot::lines(&[], Axes { x: "time, ms", y: "" }) };
    let period = trial.samples.get(1).map_or(1e-5, |p| p.0 - first);
    let length = (3.0 / mesh_hz).max(40.0 * period).min(period * trial.samples.len() as f64);
    let interpolator = Interpolator::new();
    let scale = signal.unit.scale();
    let wire = (0..=1500).map(|i| first + length * f64::from(i) / 1500.0);
    let wire = wire.map(|t| (1e3 * (t - first), interpolator.value(&signal.samples, t * signal.rate_hz) / scale));
    let codes = trial.samples.iter().take_while(|p| p.0 <= first + length);
    let codes = codes.flat_map(|&(t, x)| {
        // As the converter holds it.
        let t = 1e3 * (t - first);
        [(t, x), (t + 1e3 * period, x)]
    });
    let series = [Series::new("signal", wire.collect()), Series::new("codes", codes.collect())];
    plot::lines(&series, Axes { x: &format!("time after {first:.4} s, ms"), y: &signal.unit.to_string() })
}
