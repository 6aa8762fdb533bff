//! `meshband import`: measurement files into a record folder.

use clap::{Args as ClapArgs, ValueEnum};
use meshband_host::import::{ImportOptions, ImportSummary, Unit, import};
use meshband_host::record::{Record, Run};
use meshband_host::report::plot::{Axes, Label, Series};
use meshband_host::report::{Report, plot, write_json};
use meshband_host::spectral::{Window, amplitude_spectrum};
use meshband_host::{Error, Result, terminal};
use std::path::PathBuf;

/// Arguments of `meshband import`.
#[derive(ClapArgs)]
pub struct Args {
    /// MATLAB v5, csv, csv.gz, wav, npy or uff58 files; of equal length: channels of one run.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Folder of the new record.
    #[arg(short, long)]
    output: PathBuf,
    /// Sampling rate, Hz; needed where the files state none.
    #[arg(long)]
    rate: Option<f64>,
    /// Tooth counts of pinion and gear, as 23,46.
    #[arg(long, value_delimiter = ',')]
    teeth: Option<Vec<u32>>,
    /// Mesh frequency as far as known, Hz (within 3 %); searched for otherwise.
    #[arg(long)]
    mesh: Option<f64>,
    /// Unit of the source.
    #[arg(long, value_enum, default_value_t = SourceUnit::Acceleration)]
    unit: SourceUnit,
    /// Sensitivity, V per g: turns volts into m/s2.
    #[arg(long)]
    volt_per_g: Option<f64>,
    /// Names of the channels, separated by commas.
    #[arg(long, value_delimiter = ',')]
    channel_names: Option<Vec<String>>,
    /// Value of the largest code, in the record's unit; 10 % over the peak otherwise.
    #[arg(long)]
    full_scale: Option<f64>,
    /// Make every file a run of its own.
    #[arg(long)]
    runs: bool,
    /// Make no virtual tach.
    #[arg(long)]
    no_tach: bool,
    /// Remove each channel's mean.
    #[arg(long)]
    remove_mean: bool,
    /// Title of the record; the output folder's name otherwise.
    #[arg(long)]
    title: Option<String>,
    /// Write the summary as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Write a report with spectra and speed.
    #[arg(long)]
    report: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum SourceUnit {
    /// m/s2
    #[value(name = "m/s2")]
    Acceleration,
    /// multiples of standard gravity
    #[value(name = "g")]
    Gravity,
    /// volts
    #[value(name = "V")]
    Volt,
    /// the source states none
    #[value(name = "unknown")]
    Unknown,
}

/// Imports the files, prints what was found, writes the record.
pub fn run(args: Args) -> Result<()> {
    let teeth = match args.teeth.as_deref() {
        None => None,
        Some(&[pinion, gear]) => Some([pinion, gear]),
        Some(other) => {
            return Err(Error::invalid("--teeth", format!("needs two counts as 23,46, not {}", other.len())));
        }
    };
    if let Some(teeth) = teeth
        && teeth.iter().any(|z| !(5..=1000).contains(z))
    {
        return Err(Error::invalid("--teeth", format!("{},{} are not tooth counts (5 to 1000)", teeth[0], teeth[1])));
    }
    let unit = match args.unit {
        SourceUnit::Acceleration => Unit::MetrePerSecondSquared,
        SourceUnit::Gravity => Unit::Gravity,
        SourceUnit::Volt => Unit::Volt(args.volt_per_g),
        SourceUnit::Unknown => Unit::Unknown,
    };
    let name = args.output.file_name().map_or_else(|| "import".into(), |name| name.to_string_lossy().into_owned());
    let options = ImportOptions {
        title: args.title.unwrap_or(name),
        rate_hz: args.rate,
        teeth,
        mesh_guess_hz: args.mesh,
        unit,
        channel_names: args.channel_names,
        full_scale: args.full_scale,
        files_are_runs: args.runs,
        without_tach: args.no_tach,
        remove_mean: args.remove_mean,
    };
    let (record, summary) = import(&args.files, &options)?;
    record.write(&args.output)?;
    if let Some(path) = &args.json {
        write_json(path, &summary)?;
    }
    if let Some(path) = &args.report {
        report(&options.title, &record, &summary)?.write(path)?;
    }
    print(&summary);
    Ok(())
}

/// Name and value of every quality figure of a run's tach.
fn tach_rows(summary: &ImportSummary) -> Vec<Vec<String>> {
    let row = |(i, q): (usize, &meshband_host::import::virtual_tach::Quality)| {
        vec![
            format!("{i}"),
            format!("{:.3}", q.mesh_hz),
            format!("{:.4}", q.speed_hz),
            format!("{:.3}", q.speed_std_rpm),
            format!("{} x{}", summary.channels.get(q.channel).map_or("?", String::as_str), q.harmonic),
            format!("{:.1}", q.line_snr_db),
            format!("{:.2}", 1e6 * q.jitter_s),
            q.cross_check_s.map_or("-".into(), |s| format!("{:.2}", 1e6 * s)),
            q.mesh_over_pinion_line.map_or("-".into(), |r| format!("{r:.3}")),
        ]
    };
    summary.tach.iter().enumerate().map(row).collect()
}

const TACH_HEAD: [&str; 9] = [
    "run",
    "mesh, Hz",
    "pinion, Hz",
    "speed std, rpm",
    "line used",
    "line SNR, dB",
    "jitter, us",
    "cross-check, us",
    "mesh / 1x",
];

fn print(summary: &ImportSummary) {
    let rows: Vec<Vec<String>> = summary
        .channels
        .iter()
        .zip(&summary.quantisation_snr_db)
        .map(|(name, snr)| vec![name.clone(), format!("{snr:.1}")])
        .collect();
    println!(
        "{} run(s) of {} samples at {} Hz, full scale {} {}",
        summary.samples.len(),
        summary.samples.iter().map(usize::to_string).collect::<Vec<_>>().join(", "),
        summary.sample_rate_hz,
        summary.full_scale,
        summary.unit
    );
    print!("{}", terminal::table(&["channel", "over quantisation, dB"], &rows));
    if !summary.tach.is_empty() {
        println!("\nvirtual tach from the mesh line's phase (tooth index and angle 0 are unknown)");
        print!("{}", terminal::table(&TACH_HEAD, &tach_rows(summary)));
    }
    for remark in &summary.remarks {
        println!("note: {remark}");
    }
}

fn report(title: &str, record: &Record, summary: &ImportSummary) -> Result<Report> {
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
            .table("One row per run. Jitter is estimated from the noise around the line; the cross-check compares the two best lines.", &TACH_HEAD, &tach_rows(summary))
            .note("Which tooth is which, and shaft angle 0, cannot be known from the mesh line. Speed changes faster than about a third of the slower shaft's rate are smoothed away.")
            .picture(&speed(run)?, "Pinion speed per turn, run 0. The first and last turns are extrapolated.");
    }
    report = report.section("Spectra").text("Run 0, whole length, Blackman-Harris window, peak amplitude.");
    for (c, name) in summary.channels.iter().enumerate() {
        let spectrum = amplitude_spectrum(&run.signal_m_s2(c), run.sample_rate_hz(), Window::BlackmanHarris);
        let mesh_hz = summary.tach.first().map(|q| q.mesh_hz);
        let labels: Vec<Label> = mesh_hz
            .into_iter()
            .flat_map(|hz| (1..=8).map(move |h| Label { x: hz * f64::from(h), text: format!("{h}x mesh") }))
            .collect();
        let last = mesh_hz.map_or(0.5 * summary.sample_rate_hz, |hz| (8.6 * hz).min(0.5 * summary.sample_rate_hz));
        let points = spectrum.values.iter().enumerate().map(|(i, &v)| (spectrum.frequency(i), v)).skip(4);
        let series = Series::new(name, points.take_while(|p| p.0 <= last).collect());
        let caption = format!("dB re 1 {}", summary.unit);
        let picture = plot::spectrum(&[series], &labels, 1.0, 90.0, Axes { x: "frequency, Hz", y: &caption })?;
        report = report.picture(&picture, name);
    }
    Ok(summary.remarks.iter().fold(report, |report, remark| report.note(remark)))
}

fn speed(run: &Run) -> Result<String> {
    let points = run.edges_s.windows(2).map(|w| (0.5 * (w[0] + w[1]), 60.0 / (w[1] - w[0]))).collect();
    plot::lines(&[Series::new("pinion", points)], Axes { x: "time, s", y: "pinion speed, rpm" })
}
