//! From a named effect of the loop to the simulator's own: keys, orders, phases, teeth.
//!
//! Both count angles from the same zero: pulse 0 of the record (`first_pulse_index` counts from it), where pair 0
//! enters the path. The loop writes every order-locked effect as `cos(order angle + phase)`, the angle being the
//! pinion's; the simulator's effects have conventions of their own, which each effect undoes in its own file
//! ([`Hypothesis::carry`]). What a record cannot tell is said with
//! [`Written::remark`]: a phase that is free in every run, and the hunting period's zero (a tachometer on the pinion
//! gives the gear's angle only up to whole turns of the pinion, which are carried over as found, run by run).

use super::candidate::Tuning;
use super::outcome::{Effect, Term};
use super::start::Start;
use crate::Result;
use crate::effects::hypothesis::{Carried, Fitted, HUNTING, Hypothesis, Seat};
use crate::effects::{hypotheses, of_table};
use crate::machine::{Geometry, Machine};

/// Simulator's effects that stand for one of the loop's.
#[derive(Debug, Clone)]
pub struct Written {
    /// Names and keys, to be added together.
    pub tables: Vec<(&'static str, toml::Table)>,
    /// What does not carry over.
    pub remark: Option<String>,
    /// Turns of the pinion by which every run starts later than its pulse 0 says.
    pub pinion_turns: Option<Vec<u32>>,
}

/// Remark of effects whose phase is another in every run.
pub const PHASE_FREE: &str = "phase free in every run: compare levels, not waveforms";
/// The reported value whose name begins so.
fn value<'a>(effect: &'a Effect, prefix: &str) -> Option<(&'a str, f64)> {
    let found = effect.parameters.iter().find(|(name, _)| name.starts_with(prefix) && !name.ends_with("_phase"));
    found.map(|(name, value)| (name.as_str(), value.value))
}

/// The channel a term of the measuring path acts on: 0, 1, or 2 for both.
fn channel(share: [f64; 2]) -> f64 {
    match share {
        [_, b] if b < 1e-3 => 0.0,
        [a, _] if a < 1e-3 => 1.0,
        _ => 2.0,
    }
}

/// Cosine and sine parts of every parameter of a term; of a fault of the record as a whole, the values of both
/// channels.
fn parts(hypothesis: &Hypothesis, effect: &Effect, term: Option<&Term>) -> Vec<[f64; 2]> {
    if matches!(hypothesis.seats, [Seat::Record]) {
        let of = |who: &str| value(effect, &format!("{}_{who}", hypothesis.quantity)).map_or(0.0, |v| v.1);
        return ["pinion", "gear"].map(|who| [of(who), 0.0]).to_vec();
    }
    let Some(term) = term else { return Vec::new() };
    let x = |i: usize| term.unknowns.get(i).copied().unwrap_or(0.0);
    term.parameters.iter().map(|p| [x(p.first), if p.complex { x(p.first + 1) } else { 0.0 }]).collect()
}

/// Shape in the terms of the seat: what a search found, or the delay (s) that the name of its share states.
fn shape(label: &str, term: Option<&Term>) -> [f64; 2] {
    match term.and_then(|t| t.tuning) {
        Some(own) if !matches!(own, Tuning::Order { .. }) => own.shape(),
        _ => {
            let delay = label.rsplit_once("_of_").and_then(|(_, text)| text.strip_suffix("_us")?.parse::<f64>().ok());
            [1e-6 * delay.unwrap_or(0.0), 0.0]
        }
    }
}

/// A reported effect as one hypothesis has it; `None` where its strength is not among the values.
fn fitted(hypothesis: &Hypothesis, effect: &Effect, term: Option<&Term>, machine: &Machine) -> Option<Carried> {
    let (label, size) = value(effect, hypothesis.quantity)?;
    let parts = parts(hypothesis, effect, term);
    let geometry = Geometry::new(&machine.pair).ok()?;
    let phase = effect.parameters.get(&format!("{label}_phase")).map_or(0.0, |v| v.value);
    let channel_share = term.map_or([1.0; 2], |t| t.channel_share);
    (hypothesis.carry)(&Fitted {
        teeth: machine.pair.teeth,
        pressure_angle_rad: geometry.working_pressure_angle,
        base_pitch_m: geometry.base_pitch_m,
        body: usize::from(effect.shaft == "gear"),
        order: effect.order_of_pinion,
        frequency_hz: effect.frequency_hz,
        size,
        phase_rad: phase,
        tooth: label.rsplit_once("tooth ").and_then(|(_, tooth)| tooth.parse().ok()),
        torque_exponent: term.map_or(0.0, |t| t.torque_exponent),
        parts: &parts,
        channel: channel(channel_share),
        channel_share,
        shape: shape(label, term),
    })
}

/// The simulator's effects for a named one of the loop with the term behind it; `None` without a counterpart.
///
/// # Errors
/// A machine without geometry, values beyond the simulator's range.
pub fn carry(effect: &Effect, term: Option<&Term>, machine: &Machine) -> Result<Option<Written>> {
    Geometry::new(&machine.pair)?;
    let own = hypotheses().filter(|h| h.name == effect.name && !h.in_the_angle);
    let Some(carried) = own.into_iter().find_map(|h| fitted(h, effect, term, machine)) else { return Ok(None) };
    for table in &carried.tables {
        of_table(table)?;
    }
    let tables = carried.tables.iter().map(|(name, keys)| {
        let keys = keys.iter().map(|(key, value)| ((*key).to_string(), toml::Value::Float(*value)));
        (*name, keys.collect::<toml::Table>())
    });
    let free = term.is_some_and(|t| t.phase_free || matches!(t.start, Start::Phases(_)));
    let on_the_gear = carried.tables.iter().any(|(_, keys)| keys.contains(&("gear", 1.0)));
    let remark = match carried.remark {
        _ if free => Some(PHASE_FREE.into()),
        None if on_the_gear => Some(HUNTING.into()),
        remark => remark,
    };
    let pinion_turns = term.and_then(|t| t.start.turns()).map(<[u32]>::to_vec);
    Ok(Some(Written { tables: tables.collect(), remark, pinion_turns }))
}
