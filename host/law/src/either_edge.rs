//! The law of a machine by whichever of a pair's two edges can be timed: give-off where possible, else take-up.
//!
//! The law's own edge is the one with which a pair gives its load off (see [`super::derive`]). Where the ramp is long
//! against the fastest mode's period (the check machines' tables: 0.34 ms at 12 Hz against 0.2 ms) that edge sinks
//! into the machine's own motion over a good part of the speeds, while the take-up edge stands high and smooth over
//! nearly all. The node times the steeper edge of a tooth pitch, whichever it is, so the take-up edge is then what
//! its bandwidth must carry. Its domain is the longest stretch of speeds without a jump: at the lowest speeds ripples
//! of the fastest mode are steeper than the ramp. Cost: about two seconds.

use super::derive::{self, FIT_SPEEDS, KNOT_TOLERANCE, bandwidth_hz, study_torque};
use super::domain::Domain;
use super::file::LawFile;
use super::fit::fit_table;
use super::forms::Law;
use super::operating::{Bench, Event};
use super::point::Point;
use crate::machine::{EngagementKind, Machine};
use crate::{Error, Result};
use rayon::prelude::*;

/// Change of bandwidth from one speed of the study to the next (0.6 % faster) that is a jump from one edge to another.
const JUMP: f64 = 0.05;
/// Least ratio of highest and lowest speed that makes a law.
const LEAST_SPAN: f64 = 2.0;

/// Laws of machines that are to be compared, by the same edge.
#[derive(Debug, Clone)]
pub struct SameEdge {
    /// The laws, in the order of the machines.
    pub laws: Vec<LawFile>,
    /// Which edge they time.
    pub event: Event,
    /// Why not the other one.
    pub reason: Option<String>,
}

/// Laws of machines by the same edge.
///
/// # Errors
/// A machine without operating point, and where neither edge can be timed over a stretch of speeds on every machine.
pub fn by_same_edge(machines: &[(&Machine, &Bench)], step: &(impl Fn() + Sync)) -> Result<SameEdge> {
    let own = |&(machine, bench): &(&Machine, &Bench)| -> Result<LawFile> {
        let laws = derive::derive(machine, bench, Domain::of(machine), step)?;
        Ok(laws.file(derive::check(&laws, bench, step)?.relative_uncertainty()))
    };
    let why = match machines.iter().map(own).collect::<Result<Vec<_>>>() {
        Ok(laws) => return Ok(SameEdge { laws, event: Event::Exit, reason: None }),
        Err(why) => why,
    };
    let laws = machines.iter().map(|(machine, bench)| take_up(machine, bench)).collect::<Result<Vec<_>>>()?;
    Ok(SameEdge { laws, event: Event::Entry, reason: Some(why.to_string()) })
}

/// The law of the take-up edge.
fn take_up(machine: &Machine, bench: &Bench) -> Result<LawFile> {
    let torque = study_torque(machine)?;
    let alone = |f: f64| Ok(bench.isolated(Event::Entry, f, torque)?.as_ref().map(bandwidth_hz));
    let domain = Domain::of(machine);
    let speeds = domain.log_speeds(FIT_SPEEDS);
    let edges: Vec<Option<f64>> = speeds.par_iter().map(|&f| alone(f)).collect::<Result<_>>()?;
    let all: Vec<Point> = speeds
        .iter()
        .zip(&edges)
        .map(|(&shaft_hz, b)| Point { shaft_hz, bandwidth_hz: b.unwrap_or(f64::INFINITY) })
        .collect();
    let points = longest(&all).ok_or_else(|| {
        Error::impossible("bandwidth law", "neither engagement edge can be timed over a stretch of speeds")
    })?;
    let domain_hz = [points[0].shaft_hz, points[points.len() - 1].shaft_hz];
    let law = fit_table(points, meshband::law::MAX_KNOTS, KNOT_TOLERANCE)?.law;
    let inside = |f: &f64| (domain_hz[0]..=domain_hz[1]).contains(f);
    let errors: Vec<[f64; 2]> = domain
        .held_out_speeds()
        .into_par_iter()
        .filter(inside)
        .map(|f| {
            let edge = alone(f)?.unwrap_or(f64::INFINITY);
            let on_ring = bench.healthy(f, torque)?.edge(0, Event::Entry).as_ref().map_or(edge, bandwidth_hz);
            Ok([law.bandwidth_hz(f) / edge - 1.0, on_ring / edge - 1.0])
        })
        .collect::<Result<_>>()?;
    let worst = errors.iter().fold(0.0_f64, |w, e| w.max(e[0].abs()));
    let ring = (errors.iter().map(|e| e[1] * e[1]).sum::<f64>() / errors.len().max(1) as f64).sqrt();
    // Six digits are what a node's f32 holds.
    let digits = |x: f64| format!("{x:.5e}").parse::<f64>().expect("a number");
    let Law::Tabulated { knots } = law else { unreachable!("fit_table makes tables") };
    Ok(LawFile {
        machine: machine.title.clone(),
        machine_hash: format!("{:#018x}", machine.hash()),
        ramp: machine.engagement.map_or(EngagementKind::None, |e| e.kind),
        measured: None,
        domain_hz: domain_hz.map(digits),
        relative_uncertainty: digits(worst.hypot(ring).min(1.0)),
        law: Law::Tabulated { knots: knots.into_iter().map(|(f, b)| (digits(f), digits(b))).collect() },
    })
}

/// The longest stretch without a jump or a missing edge, in the ratio of its ends.
fn longest(points: &[Point]) -> Option<&[Point]> {
    let follows = |a: &Point, b: &Point| (b.bandwidth_hz / a.bandwidth_hz).ln().abs() < JUMP;
    let span = |part: &[Point]| part[part.len() - 1].shaft_hz / part[0].shaft_hz;
    points
        .chunk_by(follows)
        .filter(|part| part[0].bandwidth_hz.is_finite() && span(part) >= LEAST_SPAN)
        .max_by(|a, b| span(a).total_cmp(&span(b)))
}
