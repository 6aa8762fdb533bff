//! The virtual node before and after: the node's own code on the record, on what the declared machine predicts, and
//! on the corrected one.
//!
//! Held-out runs only. The record and the corrected prediction are taken by a node that carries the refitted law, the
//! declared prediction by one with the declared machine's. Compared are its mesh bands (harmonic with all sidebands
//! that it reports, RMS, dB re 1 m/s2), the bandwidth its law gives at its own tach speed, and the bandwidth that it
//! measures on engagement edges; these on the pinion's channel only, which is the law's. Predictions carry no noise.
//!
//! A node takes a second to start, which short runs have not: whole turns of the same signal are played before it,
//! and only spectra that begin behind them are read. Runs of less than 18 turns give none. Cost: about a second per
//! run, channel and signal.

use super::apply::Applied;
use super::outcome::Outcome;
use crate::dynamics::assembly::{Damping, Model};
use crate::dynamics::rig::Rig;
use crate::law::file::LawFile;
use crate::machine::Machine;
use crate::predict::Predictor;
use crate::record::Record;
use crate::virtual_node::frames::Received;
use crate::virtual_node::image::TICKS_PER_SECOND;
use crate::virtual_node::setup::configuration;
use crate::virtual_node::signal::Signal;
use crate::virtual_node::simulation;
use crate::{Result, effects};
use meshband::message::{MeshBand, Message, SpectralLine, Spectrum};
use meshband::replay::START_TICK;
use rayon::prelude::*;
use serde::Serialize;

/// Time for a node to start, to find the speed, to settle and to have timed edges, s.
const START_S: f64 = 2.5;
/// Turns of the pinion in a spectrum, with some to spare.
const SPECTRUM_TURNS: f64 = 18.0;

/// Bands this far below a channel's strongest one are shown but not counted, dB: there the record is noise, which
/// predictions lack.
const DEEPEST_DB: f64 = 40.0;

/// What a node said of one signal.
#[derive(Debug, Clone, Serialize)]
pub struct Said {
    /// Pinion speed, Hz.
    pub speed_hz: f64,
    /// Bandwidth by its law, Hz.
    pub law_hz: f64,
    /// The speed lies outside the law's domain.
    pub clamped: bool,
    /// Bandwidth that it measured, Hz; none where its rate is too low or no edges stand out.
    pub measured_hz: Option<f64>,
    /// Harmonic and level of every mesh band, dB re 1 m/s2.
    pub bands_db: Vec<(u8, f64)>,
}

/// A held-out run and channel.
#[derive(Debug, Clone, Serialize)]
pub struct RunCheck {
    /// Signal file.
    pub run: String,
    /// Channel, from 0.
    pub channel: usize,
    /// Declared torque, N m.
    pub torque_n_m: f64,
    /// On the record.
    pub record: Said,
    /// On the declared machine's prediction.
    pub declared: Said,
    /// On the corrected machine's.
    pub corrected: Said,
}

/// Root mean square differences from the record, declared and corrected.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Differences {
    /// Band levels, dB.
    pub bands_db: [f64; 2],
    /// Bandwidth by the law against the one measured on the record, share of it.
    pub law: Option<[f64; 2]>,
    /// Measured bandwidth against the one measured on the record, share of it.
    pub measured: Option<[f64; 2]>,
}

/// Everything compared.
#[derive(Debug, Clone, Serialize)]
pub struct NodeCheck {
    /// Per run and channel.
    pub runs: Vec<RunCheck>,
    /// Over all of them.
    pub rms: Differences,
}

/// Runs the node on the held-out runs of `record`; `None` where there is no law to run it with.
///
/// # Errors
/// A machine that cannot be predicted, a law or signal that the node refuses.
pub fn node_check(record: &Record, outcome: &Outcome, applied: &Applied) -> Result<Option<NodeCheck>> {
    let Some(laws) = &applied.laws else { return Ok(None) };
    let declared = Predictor::new(record, Model::BendingTorsional, Damping::Declared)?;
    let mut corrected = Predictor::new(record, Model::BendingTorsional, Damping::Declared)?;
    corrected.rig = Rig::new(&Machine::read(&applied.machine)?, Model::BendingTorsional, Damping::Declared)?;
    corrected.torque_factor = applied.torque_factor;
    corrected.start_later(record, applied.pinion_turns.as_deref().unwrap_or_default())?;
    let added = effects::read(&applied.effects)?;
    let runs: Vec<Vec<RunCheck>> = outcome.split[2]
        .par_iter()
        .map(|&index| {
            let run = record.run(index)?;
            let (before, _) = declared.predict(run, &[])?;
            let (after, _) = corrected.predict(run, &added)?;
            (0..2)
                .into_par_iter()
                .map(|channel| {
                    let signal = Signal::of_record(record, index, (&channel.to_string(), None), 0.0, None)?;
                    let with = |samples: &[f64]| Signal { samples: samples.to_vec(), ..signal.clone() };
                    Ok(RunCheck {
                        run: run.declaration.signal.clone(),
                        channel,
                        torque_n_m: run.declaration.input_torque_n_m.unwrap_or(f64::NAN),
                        record: node(&signal, &laws[1])?,
                        declared: node(&with(&before[channel]), &laws[0])?,
                        corrected: node(&with(&after[channel]), &laws[1])?,
                    })
                })
                .collect()
        })
        .collect::<Result<_>>()?;
    let runs: Vec<RunCheck> = runs.into_iter().flatten().collect();
    let rms = differences(&runs);
    Ok(Some(NodeCheck { runs, rms }))
}

/// Runs the node's code on a signal, with as much of it played before as the node needs to start.
fn node(signal: &Signal, law: &LawFile) -> Result<Said> {
    let mut config = configuration(signal, None)?;
    config.law = law.for_node()?;
    let run = |lead: &Signal| -> Result<Received> {
        let image = lead.image(&config)?;
        Ok(Received::decode(&simulation::run(&image.bytes)?.link))
    };
    let begins = |s: &Spectrum| (s.tag.first_tick as f64 - f64::from(START_TICK)) / f64::from(TICKS_PER_SECOND);
    let per_s = (signal.edges_s.len() - 1) as f64 / (signal.edges_s[signal.edges_s.len() - 1] - signal.edges_s[0]);
    let per_turn = f64::from(signal.pulses_per_turn) / signal.pinion_per_tach;
    // Where the node's first spectrum begins does not depend on what follows: the signal itself shall begin just
    // there. Spectra begin at whole turns, timed with the jitter of an edge: half a turn on either side tells which.
    let (probe, _) = with_lead_in(signal, START_S + SPECTRUM_TURNS * per_turn / per_s);
    let probed = run(&probe)?;
    let first_s = probed.spectra().next().map_or(START_S, begins);
    // The longer run of the two has timed more teeth, of which a seam touches one.
    let mut measured: Vec<f64> = probed
        .messages()
        .filter_map(|m| if let Message::Indicators(i) = m { i.bandwidth } else { None })
        .map(|b| f64::from(b.bandwidth_hz))
        .collect();
    measured.sort_by(f64::total_cmp);
    let half_turn_s = 0.5 * per_turn / per_s;
    let (played, seam_s) = with_lead_in(signal, first_s - half_turn_s);
    let received = run(&played)?;
    let status = received.statuses().last();
    let spectra: Vec<_> = received.spectra().filter(|s| begins(s) >= seam_s - half_turn_s).collect();
    let harmonics: Vec<u8> = spectra.first().map_or(Vec::new(), |s| s.bands.iter().map(|b| b.harmonic).collect());
    let level = |harmonic: u8| {
        let all = spectra.iter().flat_map(|s| &s.bands).filter(|b| b.harmonic == harmonic).map(power);
        let (sum, count) = all.fold((0.0, 0.0), |(sum, count), p| (sum + p, count + 1.0));
        10.0 * (sum / count).max(f64::MIN_POSITIVE).log10()
    };
    Ok(Said {
        speed_hz: status.map_or(0.0, |s| f64::from(s.speed_hz)),
        law_hz: status.map_or(0.0, |s| f64::from(s.bandwidth_hz)),
        clamped: status.is_some_and(|s| s.law_clamped),
        measured_hz: measured.get(measured.len() / 2).copied(),
        bands_db: harmonics.into_iter().map(|h| (h, level(h))).collect(),
    })
}

/// The signal after whole turns of the tach's shaft from itself, of at least `lead_s` together, and the time at which
/// it begins.
///
/// It begins at its first edge. The seam is exact to half a sample for what turns with that shaft.
fn with_lead_in(signal: &Signal, lead_s: f64) -> (Signal, f64) {
    let index = |edge: usize| (signal.edges_s[edge] * signal.rate_hz).round() as usize;
    let pulses = signal.pulses_per_turn as usize;
    let turns = (signal.edges_s.len() - 1) / pulses;
    let (mut samples, mut edges_s) = (Vec::new(), Vec::new());
    let mut add = |from: usize, to: usize, edges: &[f64]| {
        let shift = (samples.len() as f64 - from as f64) / signal.rate_hz;
        edges_s.extend(edges.iter().map(|t| t + shift));
        samples.extend_from_slice(&signal.samples[from..to]);
        samples.len() as f64 / signal.rate_hz
    };
    let first = index(0);
    let mut seam_s = 0.0;
    while turns > 0 && seam_s < lead_s {
        let left = ((lead_s - seam_s) * signal.rate_hz) as usize;
        let needed = (1..turns).find(|turn| index(turn * pulses) - first >= left).unwrap_or(turns);
        seam_s = add(first, index(needed * pulses), &signal.edges_s[..needed * pulses]);
    }
    add(first, signal.samples.len(), &signal.edges_s);
    (Signal { samples, edges_s, ..signal.clone() }, seam_s)
}

/// Mean square of a band's lines, (m/s2)^2.
fn power(band: &MeshBand) -> f64 {
    let of = |line: &SpectralLine| 0.5 * f64::from(line.amplitude).powi(2);
    of(&band.line) + band.sidebands.iter().chain(&band.gear_sidebands).map(of).sum::<f64>()
}

impl RunCheck {
    /// Harmonic, level of the record, and how far the declared and corrected predictions are off, dB.
    pub fn bands(&self) -> impl Iterator<Item = (u8, f64, [f64; 2])> {
        let off = |said: &Said, harmonic: u8, level: f64| {
            said.bands_db.iter().find(|b| b.0 == harmonic).map_or(f64::NAN, |b| b.1 - level)
        };
        let row = move |&(harmonic, level): &(u8, f64)| {
            (harmonic, level, [&self.declared, &self.corrected].map(|said| off(said, harmonic, level)))
        };
        self.record.bands_db.iter().map(row)
    }

    /// Whether a band of this level counts.
    fn counts(&self, level_db: f64) -> bool {
        self.record.bands_db.iter().all(|band| level_db > band.1 - DEEPEST_DB)
    }

    /// Law against measured, and measured against measured, both as shares of what is measured on the record.
    fn bandwidths(&self) -> Option<([f64; 2], Option<[f64; 2]>)> {
        let own = self.record.measured_hz?;
        let law = [self.declared.law_hz, self.corrected.law_hz].map(|hz| hz / own - 1.0);
        let measured = self.declared.measured_hz.zip(self.corrected.measured_hz);
        Some((law, measured.map(|(a, b)| [a / own - 1.0, b / own - 1.0])))
    }
}

fn differences(runs: &[RunCheck]) -> Differences {
    let rms = |rows: Vec<[f64; 2]>| {
        let count = rows.len() as f64;
        (count > 0.0).then(|| [0, 1].map(|i| (rows.iter().map(|row| row[i] * row[i]).sum::<f64>() / count).sqrt()))
    };
    let widths: Vec<_> = runs.iter().filter(|run| run.channel == 0).filter_map(RunCheck::bandwidths).collect();
    let counted = |run: &'_ RunCheck| -> Vec<[f64; 2]> {
        let rows = run.bands().filter(|(_, level, off)| run.counts(*level) && off.iter().all(|d| d.is_finite()));
        rows.map(|row| row.2).collect()
    };
    let bands = runs.iter().flat_map(counted);
    Differences {
        bands_db: rms(bands.collect()).unwrap_or_default(),
        law: rms(widths.iter().map(|w| w.0).collect()),
        measured: rms(widths.iter().filter_map(|w| w.1).collect()),
    }
}

/// Heads of the tables of levels and of bandwidths.
pub const HEADS: [&[&str]; 2] = [
    &["node's mesh band, dB re 1 m/s2", "record", "declared off by", "corrected off by"],
    &[
        "node's bandwidth, Hz",
        "measured on record",
        "on declared",
        "on corrected",
        "by declared law",
        "by refitted law",
    ],
];

impl NodeCheck {
    /// Rows of both tables, as [`HEADS`].
    pub fn rows(&self) -> [Vec<Vec<String>>; 2] {
        let name = |run: &RunCheck| {
            format!("{}, channel {}, {:.2} Hz, {} N m", run.run, run.channel, run.record.speed_hz, run.torque_n_m)
        };
        let mut levels = Vec::new();
        for run in &self.runs {
            for (harmonic, level, off) in run.bands() {
                let [declared, corrected] = off.map(|d| format!("{d:+.3}"));
                levels.push(vec![
                    format!("{}, {harmonic} x mesh", name(run)),
                    format!("{level:.2}"),
                    declared,
                    corrected,
                ]);
            }
        }
        let [declared, corrected] = self.rms.bands_db.map(|d| format!("{d:.3}"));
        levels.push(vec!["RMS".into(), String::new(), declared, corrected]);
        let hz = |x: Option<f64>| x.map_or("-".into(), |hz| format!("{hz:.0}"));
        let law = |said: &Said| format!("{:.0}{}", said.law_hz, if said.clamped { " (clamped)" } else { "" });
        let mut widths: Vec<Vec<String>> = self
            .runs
            .iter()
            .filter(|run| run.channel == 0)
            .map(|run| {
                let [a, b, c] = [&run.record, &run.declared, &run.corrected].map(|said| hz(said.measured_hz));
                vec![name(run), a, b, c, law(&run.declared), law(&run.corrected)]
            })
            .collect();
        let share = |x: Option<f64>| x.map_or("-".into(), |x| format!("{:.1} %", 100.0 * x));
        let [measured, law] =
            [self.rms.measured, self.rms.law].map(|pair| [pair.map(|p| p[0]), pair.map(|p| p[1])].map(share));
        widths.push([vec!["RMS off the record's".into(), String::new()], measured.to_vec(), law.to_vec()].concat());
        [levels, widths]
    }
}
