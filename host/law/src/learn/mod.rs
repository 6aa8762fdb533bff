//! A law from the machine itself: `meshband law learn` measures the bandwidth over the speeds of a record.
//!
//! A record of several speeds, or of a run-up, is cut into stretches of nearly constant speed ([`mod@stretches`]). In
//! each, engagement edges are timed by the node's own estimator where they can be ([`timed`]), which is what a
//! simulated law holds; behind a housing they mostly cannot, and the frequency below which 99 % of the power locked
//! to the shaft lies ([`occupied`]) is measured instead. One law is of one kind: the two differ by their definition.
//! Stretches of like speed make a knot with its standard error.
//!
//! Limits: what is measured is machine, housing and sensor together, at the torque of the record; a bandwidth at the
//! record's own band is a lower bound and makes no knot.

pub mod knots;
pub mod occupied;
pub mod report;
pub mod stretches;
pub mod timed;

use super::file::{LawFile, Measured};
use super::forms::Law;
use crate::analysis::angle::Angle;
use crate::machine::{EngagementKind, Machine};
use crate::record::{Record, Run, Tach};
use crate::{Error, Result};
use knots::Knot;
use occupied::LockedPower;
use rayon::prelude::*;
use serde::Serialize;
use stretches::{Stretch, stretches};

/// What is measured, or which of the two where that is left open.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Wanted {
    /// Edges where they can be timed at every speed, else the occupied bandwidth.
    Auto,
    /// Rise times of engagement edges.
    Edges,
    /// Occupied bandwidth.
    Occupied,
}

/// A stretch with both measurements.
#[derive(Debug, Clone)]
pub struct Seen {
    /// Pinion speed, Hz.
    pub speed_hz: f64,
    /// Power locked to the pinion, by order.
    pub locked: LockedPower,
    /// Bandwidth of its engagement edges, Hz.
    pub edge_hz: Option<f64>,
}

/// What was learned.
#[derive(Debug, Clone, Serialize)]
pub struct Learned {
    /// Version of this schema.
    pub schema: u32,
    /// Title of the record.
    pub title: String,
    /// Name of the channel.
    pub channel: String,
    /// What the bandwidth is.
    pub measured: Measured,
    /// Why it is that.
    pub reason: String,
    /// Stretches of nearly constant speed that were found.
    pub stretches: usize,
    /// Bandwidth by speed, ascending.
    pub knots: Vec<Knot>,
    /// Relative standard uncertainty of a bandwidth read from the law.
    pub relative_uncertainty: f64,
    /// What holds of the record, in sentences.
    pub notes: Vec<String>,
}

/// Measures the bandwidth of a channel over the speeds of a record.
///
/// # Errors
/// A record without tach or tooth counts, no such channel, no stretch of nearly constant speed, too few speeds for a
/// law.
pub fn learn(record: &Record, channel: usize, wanted: Wanted) -> Result<Learned> {
    let place = record.folder.display().to_string();
    let tach = record.require_tach()?;
    let teeth = record.declaration.teeth().ok_or_else(|| {
        Error::invalid(&place, "has no [pair] teeth = [pinion, gear]; the tooth pitch is unknown without them")
    })?;
    let names = &record.declaration.acquisition.channels;
    let name = names.get(channel).ok_or_else(|| {
        Error::invalid(&place, format!("has no channel {channel}; they are 0 to {}", names.len().max(1) - 1))
    })?;
    let mut notes = Vec::new();
    let seen: Vec<Seen> = record
        .runs
        .iter()
        .enumerate()
        .flat_map(|(i, run)| match of_run(run, channel, tach, teeth, &format!("{place} run {i}")) {
            Ok(seen) => seen,
            Err(error) => {
                notes.push(format!("left out: {error}"));
                Vec::new()
            }
        })
        .collect();
    if seen.is_empty() {
        let why = notes.first().map_or(String::new(), |note| format!(" ({note})"));
        let what = format!(
            "no stretch of {} turns of the pinion with a speed within {:.0} %{why}",
            stretches::FEWEST_TURNS,
            100.0 * stretches::SPEED_TOLERANCE_SHARE
        );
        return Err(Error::invalid(place, what));
    }
    let (measured, reason) = chosen(wanted, &seen).map_err(|what| Error::invalid(&place, what))?;
    let knots = knots::knots(&seen, measured, &mut notes);
    if knots.len() < 2 {
        let found =
            knots.first().map_or(String::new(), |k| format!(": {:.0} Hz at {:.2} turns/s", k.bandwidth_hz, k.speed_hz));
        let what = format!(
            "bandwidth could be measured at {} speed{found}; a law needs two, {:.0} % apart",
            knots.len(),
            100.0 * (knots::BIN_RATIO - 1.0)
        );
        return Err(Error::invalid(place, what + &notes.iter().map(|note| format!("; {note}")).collect::<String>()));
    }
    Ok(Learned {
        schema: 1,
        title: record.declaration.title().to_owned(),
        channel: crate::text::name(name),
        measured,
        reason,
        stretches: seen.len(),
        relative_uncertainty: knots::relative_uncertainty(&knots),
        knots,
        notes,
    })
}

/// The stretches of a run, each measured in both ways.
fn of_run(run: &Run, channel: usize, tach: &Tach, teeth: [u32; 2], place: &str) -> Result<Vec<Seen>> {
    let angle = Angle::of(run, tach, teeth, place)?;
    let (signal, rate_hz) = (run.signal_m_s2(channel), run.sample_rate_hz());
    let samples = angle.resampled(&signal, rate_hz);
    let seen = |stretch: &Stretch| Seen {
        speed_hz: stretch.speed_hz,
        locked: occupied::locked_power(&samples, angle.per_turn[0], stretch, rate_hz),
        edge_hz: timed::edge_bandwidth_hz(&signal, rate_hz, stretch, teeth[0]),
    };
    Ok(stretches(&angle).par_iter().map(seen).collect())
}

/// Which of the two is measured, and why; the refusal in words.
fn chosen(wanted: Wanted, seen: &[Seen]) -> std::result::Result<(Measured, String), String> {
    let timed = seen.iter().filter(|s| s.edge_hz.is_some()).count();
    let of = format!("engagement edges could be timed in {timed} of {} stretches", seen.len());
    match wanted {
        Wanted::Occupied => Ok((Measured::Occupied, "asked for".into())),
        Wanted::Edges if timed == 0 => Err(format!("{of}; --method occupied measures the occupied bandwidth")),
        Wanted::Edges => Ok((Measured::Edges, of)),
        Wanted::Auto if timed == seen.len() => Ok((Measured::Edges, of)),
        Wanted::Auto => Ok((Measured::Occupied, of)),
    }
}

impl Learned {
    /// The law for a node; `machine` names the machine it belongs to.
    pub fn file(&self, machine: Option<&Machine>) -> LawFile {
        // Six digits are what a node's f32 holds.
        let digits = |x: f64| format!("{x:.5e}").parse::<f64>().expect("a number");
        let knots: Vec<(f64, f64)> = self.knots.iter().map(|k| (digits(k.speed_hz), digits(k.bandwidth_hz))).collect();
        LawFile {
            machine: machine.map_or_else(|| self.title.clone(), |m| m.title.clone()),
            machine_hash: format!("{:#018x}", machine.map_or(0, Machine::hash)),
            ramp: machine.and_then(|m| m.engagement).map_or(EngagementKind::None, |e| e.kind),
            measured: Some(self.measured),
            domain_hz: [knots[0].0, knots[knots.len() - 1].0],
            relative_uncertainty: digits(self.relative_uncertainty.min(1.0)),
            law: Law::Tabulated { knots },
        }
    }

    /// How far the law can be relied on, in one sentence.
    pub fn reliance(&self) -> String {
        let what = match self.measured {
            Measured::Edges => "edges of this machine behind this sensor",
            Measured::Occupied => {
                "99 % of this machine's shaft-locked vibration behind this sensor (sampling rates follow from it; \
                 rise times do not)"
            }
        };
        format!(
            "The law describes {what}, between {:.2} and {:.2} turns/s, to {:.1} % (standard uncertainty).",
            self.knots[0].speed_hz,
            self.knots[self.knots.len() - 1].speed_hz,
            100.0 * self.relative_uncertainty
        )
    }
}
