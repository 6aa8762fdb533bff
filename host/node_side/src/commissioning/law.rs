//! Fourth step: the law that the node will follow. One that is given or that the node already has of this machine
//! stays; else it is made of the bandwidths that the node timed on the way through the speeds, by the same knots as
//! `meshband law learn` on a record.

use super::run_up::TimedEdge;
use super::step::{Finding, Step, StepRecord};
use crate::law::file::{LawFile, Measured};
use crate::law::forms;
use crate::law::learn::Seen;
use crate::law::learn::knots::{Knot, knots, relative_uncertainty};
use crate::law::learn::occupied::LockedPower;
use crate::machine::{EngagementKind, Machine};
use meshband::law::Law;

/// A kept law is doubted beyond this share on top of twice its uncertainty, as on the node.
const DEPARTURE: f64 = 0.3;

/// Where the law comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum Chosen {
    /// The configuration's stays.
    Kept,
    /// Learned here.
    Learned(Box<LawFile>),
}

/// Decides; `given` is a law file of the command line that the configuration already has.
pub fn choose(
    edges: &[TimedEdge],
    law: &Law,
    given: bool,
    machine: &Machine,
    covered_hz: [f64; 2],
) -> (Chosen, StepRecord) {
    let mut notes = Vec::new();
    let found = of_edges(edges, &mut notes);
    let own = given || (law.machine_hash == machine.hash() && !law.provisional);
    let mut findings = vec![timed(edges, &found)];
    if !own && found.len() >= 2 {
        let file = file(&found, machine);
        let seen = format!(
            "learned: {} knots, {:.0} Hz at {:.2} Hz to {:.0} Hz at {:.2} Hz, standard uncertainty {:.1} %",
            found.len(),
            found[0].bandwidth_hz,
            found[0].speed_hz,
            found[found.len() - 1].bandwidth_hz,
            found[found.len() - 1].speed_hz,
            100.0 * file.relative_uncertainty
        );
        findings.push(Finding::passed("law", seen));
        findings.push(domain([file.domain_hz[0], file.domain_hz[1]], covered_hz));
        return (Chosen::Learned(Box::new(file)), StepRecord::new(Step::Law, findings));
    }
    let seen = format!(
        "kept: {:.0} Hz at {:.2} Hz to {:.0} Hz at {:.2} Hz{}",
        law.bandwidth(law.lowest).bandwidth.0,
        law.lowest.0,
        law.bandwidth(law.highest).bandwidth.0,
        law.highest.0,
        if given { ", as given" } else { "" }
    );
    findings.push(if own {
        Finding::passed("law", seen)
    } else {
        let advice = "it is not this machine's: `meshband law fit MACHINE -o law.toml`, then --law law.toml";
        Finding::warned("law", seen, advice)
    });
    findings.push(against(edges, law));
    findings.push(domain([f64::from(law.lowest.0), f64::from(law.highest.0)], covered_hz));
    (Chosen::Kept, StepRecord::new(Step::Law, findings))
}

fn of_edges(edges: &[TimedEdge], notes: &mut Vec<String>) -> Vec<Knot> {
    let seen: Vec<Seen> = edges
        .iter()
        .map(|edge| Seen { speed_hz: edge.speed_hz, locked: LockedPower::default(), edge_hz: Some(edge.bandwidth_hz) })
        .collect();
    knots(&seen, Measured::Edges, notes)
}

fn timed(edges: &[TimedEdge], found: &[Knot]) -> Finding {
    let seen = format!("{} measurements, {} speeds with three or more", edges.len(), found.len());
    let what = "engagement edges timed by the node";
    if edges.is_empty() { Finding::not_judged(what, seen) } else { Finding::passed(what, seen) }
}

fn file(found: &[Knot], machine: &Machine) -> LawFile {
    // Six digits are what a node's f32 holds.
    let digits = |x: f64| format!("{x:.5e}").parse::<f64>().unwrap_or(x);
    let knots: Vec<(f64, f64)> = found.iter().map(|knot| (digits(knot.speed_hz), digits(knot.bandwidth_hz))).collect();
    LawFile {
        machine: machine.title.clone(),
        machine_hash: format!("{:#018x}", machine.hash()),
        ramp: machine.engagement.map_or(EngagementKind::None, |engagement| engagement.kind),
        measured: Some(Measured::Edges),
        domain_hz: [knots[0].0, knots[knots.len() - 1].0],
        relative_uncertainty: digits(relative_uncertainty(found).min(1.0)),
        law: forms::Law::Tabulated { knots },
    }
}

/// Median of what was measured over what the law says.
fn against(edges: &[TimedEdge], law: &Law) -> Finding {
    let mut ratios: Vec<f64> = edges.iter().map(|edge| edge.bandwidth_hz / edge.law_hz).collect();
    ratios.sort_by(f64::total_cmp);
    let what = "measured over law";
    let Some(&median) = ratios.get(ratios.len() / 2) else {
        return Finding::not_judged(what, "not measured: the rate does not time edges at these speeds");
    };
    let seen = format!("{median:.2}, median of {}", ratios.len());
    if median.ln().abs() > (1.0 + DEPARTURE).ln() + 2.0 * f64::from(law.relative_uncertainty) {
        let advice =
            "the law does not describe this machine behind this sensor: learn one from a record (`meshband law learn`)";
        return Finding::warned(what, seen, advice);
    }
    Finding::passed(what, seen)
}

fn domain([lowest, highest]: [f64; 2], [slowest, fastest]: [f64; 2]) -> Finding {
    let seen = format!("{lowest:.2} to {highest:.2} Hz, machine {slowest:.2} to {fastest:.2} Hz");
    // A tenth beyond its ends a law is still near.
    if slowest < 0.9 * lowest || fastest > 1.1 * highest {
        let advice = "beyond its ends the law is held at its end values; give one over all speeds (--law)";
        return Finding::warned("law's domain", seen, advice);
    }
    Finding::passed("law's domain", seen)
}
