//! `meshband node`: the real firmware in QEMU on a run of a record.

use clap::Args as ClapArgs;
use meshband::config::{Configuration, GearPair, TachWheel};
use meshband_host::qemu::{Qemu, built_firmware};
use meshband_host::record::Record;
use meshband_host::virtual_node::frames::Received;
use meshband_host::virtual_node::image::{Image, Source};
use meshband_host::virtual_node::simulation;
use meshband_host::{Error, Result};
use std::path::PathBuf;

/// Arguments of `meshband node`.
#[derive(ClapArgs)]
pub struct Args {
    /// Record folder.
    record: PathBuf,
    /// Run of the record.
    #[arg(long, default_value_t = 0)]
    run: usize,
    /// Channel of the run.
    #[arg(long, default_value_t = 0)]
    channel: usize,
    /// Firmware image; without it the one that `cargo xtask node-build` made.
    #[arg(long)]
    firmware: Option<PathBuf>,
    /// Writes the result as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
}

/// Replays the run, prints what the node reported, and compares its frames with the same code run here.
pub fn run(args: Args) -> Result<()> {
    let record = Record::read(&args.record)?;
    let tach = record.require_tach()?;
    let run = record.run(args.run)?;
    let place = args.record.display();
    if args.channel >= run.channels() {
        return Err(Error::invalid(
            "--channel",
            format!("the record has {} channels, numbered from 0", run.channels()),
        ));
    }
    let teeth = record.declaration.teeth().ok_or_else(|| Error::invalid(&place, "declares no tooth counts"))?;
    let small = |value: u32, what: &str| {
        u16::try_from(value).map_err(|_| Error::invalid(&place, format!("{what} {value} is beyond the node's range")))
    };
    let defaults = Configuration::default();
    let pinion_per_tach = if tach.shaft == "gear" { teeth[1] as f32 / teeth[0] as f32 } else { 1.0 };
    let config = Configuration {
        gears: GearPair { pinion_teeth: small(teeth[0], "teeth")?, gear_teeth: small(teeth[1], "teeth")? },
        tach: TachWheel {
            pulses_per_turn: small(tach.pulses_per_rev, "pulses_per_rev")?,
            pinion_per_tach,
            ..defaults.tach
        },
        ..defaults
    };
    let samples = run.signal_m_s2(args.channel);
    let source = Source { samples: &samples, rate_hz: run.sample_rate_hz(), edges_s: &run.edges_s };
    let image = Image::new(source, &config, |header| header)?;
    eprintln!("node: {:.2} s of signal at {:.0} Hz, in QEMU ...", image.duration_s, image.signal_rate_hz);
    let finished = Qemu::new(args.firmware.unwrap_or_else(|| built_firmware("an386"))).run(&image.bytes)?;
    let same = simulation::run(&image.bytes)?.link == finished.link;
    let received = Received::decode(&finished.link);
    println!("{:>9} {:>11} {:>12} {:>11} {:>10}", "speed Hz", "law Hz", "requested Hz", "granted Hz", "ADC Hz");
    for s in received.statuses() {
        println!(
            "{:9.4} {:11.1} {:12.1} {:11.1} {:10.1}",
            s.speed_hz, s.bandwidth_hz, s.requested_hz, s.granted_hz, s.adc_hz
        );
    }
    let spectrum = received.spectra().last();
    for band in spectrum.iter().flat_map(|s| &s.bands) {
        println!("mesh {:2}: {:10.3} Hz {:10.5}", band.harmonic, band.line.frequency_hz, band.line.amplitude);
    }
    println!("frames: {} lost, {} refused; same bytes as on the host: {same}", received.lost, received.refused);
    if let Some(path) = args.json {
        let value = serde_json::json!({
            "statuses": received.statuses().collect::<Vec<_>>(),
            "spectrum": spectrum,
            "statistics": received.statistics(),
            "identical_to_host": same,
            "wall_time_s": finished.wall_time.as_secs_f64(),
        });
        std::fs::write(&path, format!("{value:#}\n")).map_err(Error::file(&path))?;
    }
    Ok(())
}
