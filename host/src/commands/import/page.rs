//! The report of an import: what came in, its speed, the first turns as they are, spectra over the pinion's order.

use super::{TACH_HEAD, tach, tach_rows};
use meshband_host::Result;
use meshband_host::import::ImportSummary;
use meshband_host::record::{Record, Run};
use meshband_host::report::plot::{Axes, Label, Series};
use meshband_host::report::{Report, plot};
use meshband_host::spectral::{Window, amplitude_spectrum};

/// Mesh harmonics that are marked.
const HARMONICS: u8 = 8;
/// Length of the waveform shown where no speed is known, s.
const WAVEFORM_S: f64 = 0.1;
/// Turns of the pinion shown otherwise.
const TURNS: f64 = 2.0;

/// The page.
///
/// # Errors
/// A picture that cannot be drawn.
pub(super) fn page(title: &str, record: &Record, summary: &ImportSummary) -> Result<Report> {
    let run = record.run(0)?;
    let mut report = Report::new(title, "Imported record")
        .figure("Runs", summary.samples.len())
        .figure("Channels", summary.channels.len())
        .figure("Sampling rate", format!("{} Hz", summary.sample_rate_hz))
        .figure("Length of run 0", format!("{:.2} s", run.duration_s()))
        .figure("Full scale", format!("{} {}", summary.full_scale, summary.unit));
    if let Some(q) = summary.tach.first() {
        report = report
            .figure("Mesh frequency", format!("{:.3} Hz", q.mesh_hz))
            .figure("Pinion speed", format!("{:.1} rpm", 60.0 * q.speed_hz))
            .figure("Tach jitter", format!("{:.2} us", 1e6 * q.jitter_s))
            .section("Virtual tachometer")
            .text("Pulses come from the phase of the mesh line that gives the least jitter in time.")
            .table(
                "One row per run. Jitter is estimated from the noise around the line; the cross-check compares \
                the two best lines.",
                &TACH_HEAD,
                &tach_rows(summary),
            )
            .note(
                "Which tooth is which, and shaft angle 0, cannot be known from the mesh line. Speed changes faster \
                than about a third of the slower shaft's rate are smoothed away.",
            )
            .picture(&speed(run)?, "Pinion speed per turn, run 0. The first and last turns are extrapolated.");
    }
    let mut report = tach::report(report, record, summary)?;
    let mesh_hz = mesh_hz(summary);
    let pinion_hz = mesh_hz.zip(record.declaration.teeth()).map(|(hz, teeth)| hz / f64::from(teeth[0]));
    report = report.section("Waveforms");
    for (c, name) in summary.channels.iter().enumerate() {
        report =
            report.picture(&waveform(run, c, pinion_hz, &summary.unit)?, &format!("{name}: the beginning of run 0."));
    }
    let axis =
        pinion_hz.map_or("Over frequency.".into(), |hz| format!("Order 1 is the pinion's mean speed, {hz:.4} Hz."));
    report =
        report.section("Spectra").text(&format!("Run 0, whole length, Blackman-Harris window, peak amplitude. {axis}"));
    for (c, name) in summary.channels.iter().enumerate() {
        report = report.picture(&spectrum(run, c, (mesh_hz, pinion_hz), summary)?, name);
    }
    Ok(summary.remarks.iter().fold(report, |report, remark| report.note(remark)))
}

/// Mesh frequency by the virtual tach or by the measured one, Hz.
fn mesh_hz(summary: &ImportSummary) -> Option<f64> {
    let measured = summary.measured_tach.first().and_then(|figures| figures.mesh.as_ref());
    summary.tach.first().map(|q| q.mesh_hz).or(measured.map(|mesh| mesh.implied_hz))
}

fn waveform(run: &Run, channel: usize, pinion_hz: Option<f64>, unit: &str) -> Result<String> {
    let rate_hz = run.sample_rate_hz();
    let length_s = pinion_hz.map_or(WAVEFORM_S, |hz| TURNS / hz);
    let samples = run.signal_m_s2(channel);
    let points = samples.iter().take((length_s * rate_hz).ceil() as usize).enumerate();
    let points = points.map(|(i, &x)| (1e3 * i as f64 / rate_hz, x)).collect();
    plot::lines(&[Series::new("waveform", points)], Axes { x: "time, ms", y: unit })
}

/// Over the pinion's order where it is known, over frequency otherwise.
fn spectrum(
    run: &Run,
    channel: usize,
    (mesh_hz, pinion_hz): (Option<f64>, Option<f64>),
    summary: &ImportSummary,
) -> Result<String> {
    let spectrum = amplitude_spectrum(&run.signal_m_s2(channel), run.sample_rate_hz(), Window::BlackmanHarris);
    let scale = pinion_hz.unwrap_or(1.0);
    let marks = mesh_hz.into_iter().flat_map(|hz| (1..=HARMONICS).map(move |h| (h, hz * f64::from(h))));
    let labels: Vec<Label> = marks.map(|(h, hz)| Label { x: hz / scale, text: format!("{h}x mesh") }).collect();
    let half = 0.5 * summary.sample_rate_hz;
    let last = mesh_hz.map_or(half, |hz| ((f64::from(HARMONICS) + 0.6) * hz).min(half));
    // The lowest bins hold the mean's skirt.
    let points = spectrum.values.iter().enumerate().map(|(i, &v)| (spectrum.frequency(i), v)).skip(4);
    let points = points.take_while(|p| p.0 <= last).map(|(hz, v)| (hz / scale, v)).collect();
    let x = if pinion_hz.is_some() { "order of the pinion" } else { "frequency, Hz" };
    let y = format!("dB re 1 {}", summary.unit);
    plot::spectrum(&[Series::new("spectrum", points)], &labels, 1.0, 90.0, Axes { x, y: &y })
}

fn speed(run: &Run) -> Result<String> {
    let points = run.edges_s.windows(2).map(|w| (0.5 * (w[0] + w[1]), 60.0 / (w[1] - w[0]))).collect();
    plot::lines(&[Series::new("pinion", points)], Axes { x: "time, s", y: "pinion speed, rpm" })
}
