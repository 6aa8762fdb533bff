//! A trial: the firmware on a virtual board and on a signal, the same code on the host, and every line against the
//! f64 reference.

use super::board::{Clock, Played, VirtualBoard};
use super::frames::Received;
use super::reference::{Reference, Shaft};
use super::second::{self, SecondRow};
use super::signal::Signal;
use crate::link::words::words;
use crate::{Error, Result};
use meshband::config::Configuration;
use meshband::events::EventKind;
use meshband::message::{LineOrigin, MeshBand, Message, Peaks, SpectralLine, Spectrum, Status};
use meshband::tach::Validity;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;

/// A line counts for the worst errors where the reference has it this far above the floor around it, dB...
pub const CLEAR_DB: f64 = 12.0;
/// ... no further below the strongest harmonic than this, dB: windows have skirts there ...
pub const DEEPEST_DB: f64 = 50.0;
/// ... and within this many bins of the shaft's order: otherwise it is another machine part's line. The node reads
/// sidebands at their order and nowhere else.
pub const NEAR_BINS: f64 = 0.5;
/// Two lines closer than this many bins are one peak: half the main lobe of the window.
const APART_BINS: f64 = 2.0;

/// Speed, law and rates at an instant.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RateRow {
    /// From the signal's start, s.
    pub time_s: f64,
    /// The node's speed of the pinion, Hz.
    pub speed_hz: f64,
    /// The same from the tach edges in f64; `None` outside them.
    pub reference_speed_hz: Option<f64>,
    /// The law's bandwidth, Hz.
    pub bandwidth_hz: f64,
    /// Output rate the law asks for, Hz.
    pub requested_hz: f64,
    /// Output rate granted: converter rate after decimation, Hz.
    pub granted_hz: f64,
    /// Converter rate, Hz.
    pub adc_hz: f64,
    /// Half-band stages between them.
    pub stages: u8,
    /// Granted against requested, ppm.
    pub residual_ppm: f64,
    /// Block from which on this holds.
    pub block: u32,
    /// What is special: no speed, outside the law's domain, provisional law, rate limited.
    pub flags: Vec<&'static str>,
}

/// One line of a mesh band against the reference.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LineRow {
    /// Mesh harmonic.
    pub harmonic: u8,
    /// 0 for the harmonic itself, else the number of turns of the shaft aside.
    pub sideband: i32,
    /// Shaft of the sideband; the pinion for the harmonic itself.
    pub shaft: &'static str,
    /// As reported, Hz.
    pub frequency_hz: f64,
    /// As reported, unit of the signal.
    pub amplitude: f64,
    /// Reference over the same stretch of time, Hz.
    pub reference_hz: f64,
    /// Reference, unit of the signal.
    pub reference_amplitude: f64,
    /// Relative error of the frequency.
    pub frequency_error: f64,
    /// Error of the amplitude, dB.
    pub amplitude_error_db: f64,
    /// Reference above the lower quartile of the spectrum around it, dB.
    pub above_floor_db: f64,
    /// Reference line off the shaft's order, bins.
    pub off_order_bins: f64,
    /// Reference below the spectrum's strongest harmonic, dB.
    pub below_strongest_db: f64,
    /// Another line that the bins cannot tell from this one.
    pub not_separable_from: Option<String>,
    /// Above the end of the signal that is replayed: what the node finds there is no line of the machine.
    pub beyond_signal: bool,
}

impl LineRow {
    /// "2x", "2x -1" or "2x -1 gear": mesh harmonic, sideband of the pinion or of the gear.
    pub fn name(&self) -> String {
        match self.sideband {
            0 => format!("{}x", self.harmonic),
            n if self.shaft == "pinion" => format!("{}x {n:+}", self.harmonic),
            n => format!("{}x {n:+} {}", self.harmonic, self.shaft),
        }
    }

    /// Whether it is the shaft's line and stands clear of noise and of other lines' skirts, by the reference alone. A
    /// peak that the bins cannot tell from one of the pinion counts there, and not once more for the gear.
    pub fn is_clear(&self) -> bool {
        !self.beyond_signal
            && (self.not_separable_from.is_none() || self.shaft == "pinion")
            && self.above_floor_db >= CLEAR_DB
            && self.below_strongest_db <= DEEPEST_DB
            && self.off_order_bins.abs() <= NEAR_BINS
    }
}

/// One mesh-band spectrum against the reference.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SpectrumRow {
    /// First sample, s from the signal's start.
    pub start_s: f64,
    /// Length of the record behind it, s.
    pub length_s: f64,
    /// Bin width, Hz.
    pub resolution_hz: f64,
    /// Mean speed of the pinion over it in f64, Hz.
    pub speed_hz: f64,
    /// Turns of the pinion in it.
    pub turns: f64,
    /// Fastest over slowest turn within it, as reported.
    pub speed_ratio: f64,
    /// Its lines.
    pub lines: Vec<LineRow>,
}

/// A strong line of the wideband spectrum.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PeakRow {
    /// As reported, Hz.
    pub frequency_hz: f64,
    /// As reported, unit of the signal.
    pub amplitude: f64,
    /// Mesh harmonic that lies there, where one does.
    pub harmonic: Option<u32>,
    /// Whether that harmonic lies above half the rate and is folded here.
    pub folded: bool,
    /// Above the end of the signal that is replayed: nothing of the machine.
    pub beyond_signal: bool,
}

/// Worst errors over the lines that stand clear.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Worst {
    /// Lines looked at.
    pub lines: usize,
    /// Largest relative error of a frequency.
    pub frequency_error: f64,
    /// Largest error of an amplitude, dB.
    pub amplitude_error_db: f64,
}

/// Whether everything arrived and agreed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Integrity {
    /// The board's frames are those of the same code on the host on the same blocks, byte for byte.
    pub identical_to_host: bool,
    /// These blocks are the ones of a processor that is never late; otherwise the host followed the board's.
    pub on_schedule: bool,
    /// The codes sampled are those that the host took.
    pub identical_codes: bool,
    /// All runs sent the same bytes; `None` after a single run.
    pub identical_runs: Option<bool>,
    /// Blocks processed.
    pub blocks: u32,
    /// Blocks the node or the board missed.
    pub blocks_lost: u32,
    /// Tach edges lost.
    pub edges_lost: u32,
    /// Frames damaged or missing on the link.
    pub frames_lost: u32,
    /// Rate changes.
    pub rate_changes: u32,
    /// Events by kind.
    pub events: BTreeMap<String, u32>,
    /// Million instructions per second of the board's processor.
    pub mips: f64,
}

/// Result of a trial.
#[derive(Debug, Clone, Serialize)]
pub struct Trial {
    /// Rate of the signal at the board, Hz.
    pub signal_rate_hz: f64,
    /// Length replayed, s.
    pub duration_s: f64,
    /// Speeds and rates over time.
    pub rates: Vec<RateRow>,
    /// Mesh-band spectra.
    pub spectra: Vec<SpectrumRow>,
    /// Spectra reported whose stretch the reference cannot cover.
    pub uncompared: usize,
    /// Worst errors of the harmonics.
    pub worst_harmonics: Worst,
    /// Worst errors of the sidebands.
    pub worst_sidebands: Worst,
    /// Wideband peaks at the end, with their line spacing in Hz.
    pub peaks: Vec<PeakRow>,
    /// Line spacing of the wideband spectrum, Hz.
    pub peak_resolution_hz: f64,
    /// Values of a second sensor.
    pub second: Vec<SecondRow>,
    /// Losses and identities.
    pub integrity: Integrity,
    /// Wall-clock time of the run, s.
    pub wall_time_s: f64,
    /// Spectra of the further gears of a train, by number; not compared with the reference.
    #[serde(skip)]
    pub further_spectra: BTreeMap<u8, usize>,
    /// Converter rate of every block: start, s, and rate, Hz.
    #[serde(skip)]
    pub blocks: Vec<(f64, f64)>,
    /// Codes of the last block as accelerations: time, s, and value, unit of the signal.
    #[serde(skip)]
    pub samples: Vec<(f64, f64)>,
}

/// Refuses what an image of another version sends.
///
/// # Errors
/// [`Error::Tool`] where bytes came and no frame among them can be read.
pub fn check_version(link: &[u8]) -> Result<()> {
    let received = Received::decode(link);
    if received.packets.is_empty() && received.refused > 0 {
        let what = "its frames are of another version than this command: build it with `cargo xtask node-build`";
        return Err(Error::tool("firmware", what));
    }
    Ok(())
}

/// Runs the node on a signal, `runs` times on the board and once on the host, and compares.
///
/// # Errors
/// A signal or configuration that the node refuses; the image or what runs it absent, or a failed run.
pub fn run(signal: &Signal, config: &Configuration, board: &impl VirtualBoard, runs: usize) -> Result<Trial> {
    let shaft = Shaft::new(signal).ok_or_else(|| Error::invalid("tach", "has fewer than two edges in the window"))?;
    let played = board.play(signal, config, runs)?;
    let scale = signal.unit.scale();
    let received = Received::decode(&played.link);
    let comparison = Comparison { signal, shaft: &shaft, scale, clock: played.clock };
    let all: Vec<&Spectrum> = received.spectra().collect();
    let spectra: Vec<SpectrumRow> = all.par_iter().filter_map(|s| comparison.spectrum(s)).collect();
    let last_peaks = received.peaks().last();
    Ok(Trial {
        signal_rate_hz: played.signal_rate_hz,
        duration_s: played.duration_s,
        rates: received.statuses().map(|s| comparison.rates(s)).collect(),
        uncompared: all.len() - spectra.len(),
        worst_harmonics: worst(&spectra, |line| line.sideband == 0),
        worst_sidebands: worst(&spectra, |line| line.sideband != 0),
        spectra,
        peaks: last_peaks.map(|p| comparison.peaks(p)).unwrap_or_default(),
        peak_resolution_hz: last_peaks.map_or(0.0, |p| f64::from(p.tag.resolution_hz)),
        second: second::rows(signal, &received, played.clock),
        integrity: integrity(&played, &received),
        wall_time_s: played.wall_time_s,
        samples: played.samples.iter().map(|&(time_s, value)| (time_s, value / scale)).collect(),
        blocks: played.rates,
        further_spectra: further_spectra(&received),
    })
}

fn further_spectra(received: &Received) -> BTreeMap<u8, usize> {
    let mut counts = BTreeMap::new();
    for message in received.messages() {
        if let Message::GearSpectrum(of) = message {
            *counts.entry(of.gear).or_insert(0) += 1;
        }
    }
    counts
}

fn integrity(played: &Played, received: &Received) -> Integrity {
    let mut events: BTreeMap<String, u32> = BTreeMap::new();
    for message in received.messages() {
        if let Message::Event(event) = message {
            *events.entry(words(&event.kind)).or_insert(0) += event.count;
        }
    }
    // The node's own count comes with the closing statistics, or as events where a board sends none.
    let noticed = received.statistics().map_or(0, |statistics| statistics.blocks_lost);
    let told = received.messages().filter_map(|message| match message {
        Message::Event(event) if event.kind == EventKind::BlocksLost => Some(event.detail),
        _ => None,
    });
    Integrity {
        identical_to_host: played.identical_to_host,
        on_schedule: played.on_schedule,
        identical_codes: played.identical_codes,
        identical_runs: played.identical_runs,
        blocks: played.blocks,
        blocks_lost: noticed.max(played.blocks_lost).max(told.sum()),
        edges_lost: played.edges_lost,
        frames_lost: received.lost + received.refused,
        rate_changes: played.rate_changes,
        events,
        mips: played.mips,
    }
}

fn worst(spectra: &[SpectrumRow], wanted: impl Fn(&LineRow) -> bool) -> Worst {
    let lines = spectra.iter().flat_map(|s| &s.lines);
    lines.filter(|line| wanted(line) && line.is_clear()).fold(Worst::default(), |worst, line| Worst {
        lines: worst.lines + 1,
        frequency_error: worst.frequency_error.max(line.frequency_error.abs()),
        amplitude_error_db: worst.amplitude_error_db.max(line.amplitude_error_db.abs()),
    })
}

/// Lower quartile of the spectrum within 1.5 orders, the line itself left out.
fn floor(spectrum: &[(f64, f64)], order: f64, bin: f64) -> f64 {
    let aside = |o: f64| (o - order).abs();
    let around = spectrum.iter().filter(|(o, _)| aside(*o) <= 1.5 && aside(*o) > 4.0 * bin);
    let mut values: Vec<f64> = around.map(|p| p.1).collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 4).copied().unwrap_or(f64::MIN_POSITIVE).max(f64::MIN_POSITIVE)
}

struct Comparison<'a> {
    signal: &'a Signal,
    shaft: &'a Shaft,
    /// The node's m/s2 per unit of the signal shown.
    scale: f64,
    clock: Clock,
}

/// Names for each line another one that lies within `apart_hz`, where there is one.
fn name_inseparable(lines: &mut [LineRow], apart_hz: f64) {
    let places: Vec<(f64, String)> = lines.iter().map(|line| (line.frequency_hz, line.name())).collect();
    for (i, line) in lines.iter_mut().enumerate() {
        let near = |(j, (hz, _)): &(usize, &(f64, String))| *j != i && (hz - line.frequency_hz).abs() < apart_hz;
        line.not_separable_from = places.iter().enumerate().find(near).map(|(_, (_, name))| name.clone());
    }
}

impl Comparison<'_> {
    /// Highest frequency that the replayed signal can hold, Hz.
    fn signal_end_hz(&self) -> f64 {
        0.5 * self.signal.rate_hz
    }

    fn rates(&self, status: &Status) -> RateRow {
        let time_s = self.clock.seconds(status.tick);
        let edges = &self.signal.edges_s;
        let covered = edges.first().is_some_and(|&t| t <= time_s) && edges.last().is_some_and(|&t| t >= time_s);
        let flags = [
            (status.safe_rate, "no speed: highest rate"),
            (status.law_clamped && !status.safe_rate, "speed outside the law's domain"),
            (status.validity == Validity::Doubtful, "speed doubtful: rate held"),
            (status.limited, "rate limited"),
        ];
        RateRow {
            time_s,
            speed_hz: status.speed_hz.into(),
            reference_speed_hz: covered.then(|| self.shaft.speed_hz(time_s - 1e-4, time_s + 1e-4)),
            bandwidth_hz: status.bandwidth_hz.into(),
            requested_hz: status.requested_hz.into(),
            granted_hz: status.granted_hz.into(),
            adc_hz: status.adc_hz.into(),
            stages: status.stages,
            residual_ppm: status.residual_ppm.into(),
            block: status.block,
            flags: flags.iter().filter(|(is, _)| *is).map(|(_, name)| *name).collect(),
        }
    }

    fn spectrum(&self, spectrum: &Spectrum) -> Option<SpectrumRow> {
        let turns = f64::from(spectrum.turns);
        let start_s = self.clock.seconds(spectrum.tag.first_tick);
        let reference = Reference::over(self.signal, self.shaft, start_s, turns)?;
        let decibel = |a: f64, b: f64| 20.0 * (a / b).log10();
        let mut lines = Vec::new();
        for band in &spectrum.bands {
            let centre = f64::from(band.harmonic) * f64::from(self.signal.teeth[0]);
            let around = reference.spectrum(centre, 6.0);
            for (sideband, shaft, offset, line) in self.lines(band) {
                let order = centre + offset;
                let found = reference.line(order);
                let amplitude = f64::from(line.amplitude);
                lines.push(LineRow {
                    harmonic: band.harmonic,
                    sideband,
                    shaft,
                    frequency_hz: line.frequency_hz.into(),
                    amplitude: amplitude / self.scale,
                    reference_hz: found.frequency_hz,
                    reference_amplitude: found.amplitude / self.scale,
                    frequency_error: f64::from(line.frequency_hz) / found.frequency_hz - 1.0,
                    amplitude_error_db: decibel(amplitude, found.amplitude),
                    above_floor_db: decibel(found.amplitude, floor(&around, order, reference.bin)),
                    off_order_bins: (found.frequency_hz / reference.speed_hz - order) / reference.bin,
                    below_strongest_db: 0.0,
                    not_separable_from: None,
                    beyond_signal: found.frequency_hz > self.signal_end_hz(),
                });
            }
        }
        let harmonics = lines.iter().filter(|line| line.sideband == 0);
        let strongest = harmonics.map(|line| line.reference_amplitude).fold(0.0, f64::max);
        lines.iter_mut().for_each(|line| line.below_strongest_db = decibel(strongest, line.reference_amplitude));
        let apart_hz = APART_BINS * f64::from(spectrum.tag.resolution_hz);
        name_inseparable(&mut lines, apart_hz);
        Some(SpectrumRow {
            start_s,
            length_s: reference.end_s - start_s,
            resolution_hz: spectrum.tag.resolution_hz.into(),
            speed_hz: reference.speed_hz,
            turns,
            speed_ratio: f64::from(spectrum.fastest_hz / spectrum.slowest_hz),
            lines,
        })
    }

    /// The lines of a band: number of the sideband, its shaft, its offset in pinion orders, the line. Sidebands that
    /// the band does not reach are zero and left out.
    fn lines<'m>(&self, band: &'m MeshBand) -> Vec<(i32, &'static str, f64, &'m SpectralLine)> {
        let gear_order = f64::from(self.signal.teeth[0]) / f64::from(self.signal.teeth[1]);
        let mut lines = vec![(0, "pinion", 0.0, &band.line)];
        for (shaft, order, list) in [("pinion", 1.0, &band.sidebands), ("gear", gear_order, &band.gear_sidebands)] {
            let pairs = (list.len() / 2) as i32;
            let numbered = (-pairs..=pairs).filter(|&n| n != 0).zip(list);
            lines.extend(numbered.map(|(n, line)| (n, shaft, order * f64::from(n), line)));
        }
        lines.retain(|(.., line)| line.amplitude > 0.0);
        lines
    }

    fn peaks(&self, peaks: &Peaks) -> Vec<PeakRow> {
        let row = |(i, line): (usize, &SpectralLine)| {
            let (harmonic, folded) = match peaks.origins.get(i) {
                Some(LineOrigin::Mesh { harmonic }) => (Some(u32::from(*harmonic)), false),
                Some(LineOrigin::Folded { harmonic }) => (Some(u32::from(*harmonic)), true),
                _ => (None, false),
            };
            let amplitude = f64::from(line.amplitude) / self.scale;
            let frequency_hz = f64::from(line.frequency_hz);
            // The node names lines by their order alone; it does not know where a replayed signal ends.
            let harmonic = harmonic.filter(|_| frequency_hz <= self.signal_end_hz());
            PeakRow { frequency_hz, amplitude, harmonic, folded, beyond_signal: frequency_hz > self.signal_end_hz() }
        };
        peaks.lines.iter().enumerate().map(row).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(shaft: &'static str, sideband: i32, frequency_hz: f64) -> LineRow {
        LineRow {
            harmonic: 1,
            sideband,
            shaft,
            frequency_hz,
            amplitude: 1.0,
            reference_hz: frequency_hz,
            reference_amplitude: 1.0,
            frequency_error: 0.0,
            amplitude_error_db: 0.0,
            above_floor_db: 40.0,
            off_order_bins: 0.0,
            below_strongest_db: 10.0,
            not_separable_from: None,
            beyond_signal: false,
        }
    }

    #[test]
    fn regress_a_line_of_two_shafts_is_named_and_counted_once() {
        // 21 and 64 teeth at 24.3 Hz: the gear's third sideband lies 0.4 Hz from the pinion's first, bins are 1.52 Hz
        // wide.
        let gear = 24.3 * 21.0 / 64.0;
        let mut lines = vec![
            line("pinion", 0, 510.3),
            line("pinion", 1, 534.6),
            line("gear", 2, 510.3 + 2.0 * gear),
            line("gear", 3, 510.3 + 3.0 * gear),
        ];
        name_inseparable(&mut lines, APART_BINS * 1.52);
        assert_eq!(lines[1].not_separable_from.as_deref(), Some("1x +3 gear"));
        assert_eq!(lines[3].not_separable_from.as_deref(), Some("1x +1"));
        assert!(lines[0].not_separable_from.is_none() && lines[2].not_separable_from.is_none());
        let counted: Vec<bool> = lines.iter().map(LineRow::is_clear).collect();
        assert_eq!(counted, [true, true, true, false]);
    }
}
