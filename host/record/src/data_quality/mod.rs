//! What the samples and pulses of a recording say of themselves, whatever else is known of the machine.
//!
//! In: channels with their rate, and pulses and teeth where there are any. Out: remarks, each one sentence with
//! place, figure and what it means. `samples` (limits, standstill, repeats), `clocks` (channels against each other),
//! `hum` (mains), `steps` (of the file's own numbers), `repairs` (of pulses, at import), `mesh` (the mesh line against
//! the pulses; `comb` finds it, `phase` follows it over all turns, `folding` tries what an encoder above half the
//! sampling rate would mean). `meshband import` says them of what it reads, `check` and `analyse` of a record. Nothing
//! is refused here, nothing mended.

pub mod clocks;
pub(crate) mod comb;
mod folding;
pub mod hum;
pub mod mesh;
mod phase;
pub mod pulsed;
pub mod repairs;
pub mod samples;
pub mod steps;
mod thresholds;

use crate::record::{Record, Run};
use rayon::prelude::*;
use serde::Serialize;

/// Remarks that import and analysis print.
const MAX_PRINTED_REMARKS: usize = 6;

/// What a remark is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Samples pile up at a limit.
    Clipped,
    /// A channel stands still.
    Constant,
    /// A block of samples comes again, exactly.
    Repeated,
    /// A channel's clock against another's.
    Clock,
    /// Lines of the mains.
    Hum,
    /// Few of the numbers that the file had were used.
    FewSteps,
    /// Pulses that the import put in, took out or left out of step.
    Pulses,
    /// The mesh line against pulses and teeth: not everywhere, or with a remark.
    Mesh,
    /// Pulses, shaft or teeth look wrong: every order is in doubt.
    MeshDoubtful,
    /// The mesh line stands where pulses and teeth put it.
    MeshConfirmed,
}

/// One sentence about a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Remark {
    /// What it is about.
    pub kind: Kind,
    /// Channel concerned, from 0, where it is one.
    pub channel: Option<usize>,
    /// In words.
    pub text: String,
}

impl Remark {
    fn new(kind: Kind, channel: Option<usize>, text: String) -> Self {
        Self { kind, channel, text }
    }
}

/// What the channels of a run say of themselves and of each other; `names` has a name for each.
pub fn of_channels(names: &[String], channels: &[Vec<f64>], rate_hz: f64) -> Vec<Remark> {
    let own = |(c, signal): (usize, &Vec<f64>)| {
        let mut remarks = samples::remarks(c, &names[c], signal, rate_hz);
        let stands = remarks.iter().any(|remark| remark.kind == Kind::Constant);
        if !stands {
            remarks.extend(hum::remark(c, &names[c], signal, rate_hz));
        }
        remarks
    };
    let mut remarks: Vec<Remark> = channels.par_iter().enumerate().flat_map_iter(own).collect();
    remarks.extend(clocks::remarks(names, channels, rate_hz));
    remarks
}

/// What a run of a record says of itself: its channels, and the mesh line against its pulses where both are known.
pub fn of_run(record: &Record, run: &Run) -> Vec<Remark> {
    let names = &record.declaration.acquisition.channels;
    let channels: Vec<Vec<f64>> = (0..run.channels()).map(|c| run.signal_m_s2(c)).collect();
    let mut remarks = of_channels(names, &channels, run.sample_rate_hz());
    let few = |(c, signal): (usize, &Vec<f64>)| {
        let step = steps::of_source(signal)?;
        let text = steps::judge(&names[c], steps::level(signal), step)?;
        Some(Remark::new(Kind::FewSteps, Some(c), text))
    };
    remarks.extend(channels.iter().enumerate().filter_map(few));
    remarks.extend(repairs::of(run).map(|text| Remark::new(Kind::Pulses, None, text)));
    if let Some(check) = mesh_of(record, run, &channels) {
        let kind = match (check.is_plain(), check.doubtful) {
            (true, _) => Kind::MeshConfirmed,
            (false, true) => Kind::MeshDoubtful,
            (false, false) => Kind::Mesh,
        };
        remarks.push(Remark::new(kind, None, check.sentence));
    }
    remarks
}

/// The sentences of at most six remarks that say something is wrong, and how many more there are.
pub fn first_lines(remarks: &[Remark]) -> Vec<String> {
    let wrong: Vec<&Remark> = remarks.iter().filter(|remark| remark.kind != Kind::MeshConfirmed).collect();
    let mut lines: Vec<String> = wrong.iter().take(MAX_PRINTED_REMARKS).map(|remark| remark.text.clone()).collect();
    if wrong.len() > MAX_PRINTED_REMARKS {
        lines.push(format!(
            "{} more remarks on the recording: `meshband check` says them all",
            wrong.len() - MAX_PRINTED_REMARKS
        ));
    }
    lines
}

/// The mesh line against the pulses of a run of a record that has teeth and pulses of its own.
pub fn mesh_of(record: &Record, run: &Run, channels: &[Vec<f64>]) -> Option<mesh::MeshCheck> {
    let (tach, teeth) = (record.declaration.tach.as_ref()?, record.declaration.teeth()?);
    if tach.is_virtual() || run.edges_s.len() < 2 {
        return None;
    }
    let pulsed = pulsed::Pulsed {
        channels,
        rate_hz: run.sample_rate_hz(),
        edges_s: &run.edges_s,
        pulses: tach.pulses_per_rev,
        ratio: tach.turns_per_pinion_turn(Some(teeth))?,
        shaft: match tach.shaft.as_str() {
            "other" => "its shaft".into(),
            named => format!("the {named}"),
        },
        teeth,
        passes: 0,
        nominal: tach.source.as_deref() == Some("nominal"),
        sampled_at_hz: None,
    };
    mesh::check(&format!("{} {}", record.folder.display(), run.declaration.signal), &pulsed)
}
