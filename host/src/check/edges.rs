//! Rules on the tach edges: lost and doubled edges, speeds that cannot be.
//!
//! The node's tracker bridges a lost edge and rejects a doubled one; the same is done here on the whole run. Limit: an edge lost at
//! either end of a run cannot be seen, and does no harm to the angle but by whole turns where there is one pulse per turn.

use super::Checked;
use super::finding::{Finding, Kind, Severity};
use crate::observation::spectrum::BAND_HZ;

/// Departure from a whole number of intervals up to which edges count as lost, in intervals; a speed that sways stays below.
const NEAR_WHOLE: f64 = 0.12;
/// Interval, as a share of the usual one, below which an edge is one too many.
const TOO_SHORT: f64 = 0.5;
/// Share of edges up to which they are repaired.
pub(crate) const MOST_REPAIRED: f64 = 0.2;
/// Intervals on each side of one that say what is usual there.
const NEAR_BY: usize = 10;

/// Applies the rules on edges and repairs them.
pub fn check(checked: &mut Checked) {
    speeds(checked);
    let (mut repaired, mut beyond, mut words) = (Vec::new(), Vec::new(), Vec::new());
    for r in 0..checked.record.runs.len() {
        let repair = Repair::of(&checked.record.runs[r].edges_s);
        if repair.changes() == 0 {
            continue;
        }
        if repair.changes() as f64 > MOST_REPAIRED * repair.edges_s.len() as f64 {
            beyond.push(r);
            continue;
        }
        words.push(format!("run {} {}", checked.runs[r], repair.words()));
        repaired.push(r);
        checked.record.runs[r].edges_s = repair.edges_s;
    }
    let text = format!("tach edges repaired as the node does: {}", words.join("; "));
    let finding = Finding::new(Severity::Say, Kind::Edges, repaired.len() as f64, 0.0, "runs", text);
    checked.add_for_runs(&repaired, Severity::Say, Severity::Say, finding);
    let text = format!("tach edges too irregular to repair {}", checked.in_runs(&beyond));
    let finding = Finding::new(Severity::SetAside, Kind::Edges, beyond.len() as f64, 0.0, "runs", text);
    checked.add_for_runs(&beyond, Severity::SetAside, Severity::Refuse, finding);
}

fn speeds(checked: &mut Checked) {
    let teeth = f64::from(checked.record.pair.teeth[0]);
    let most = BAND_HZ.min(0.45 * checked.record.sample_rate_hz);
    let mesh = |r: usize| {
        let edges = &checked.record.runs[r].edges_s;
        let turns = (edges.len() - 1) as f64 / f64::from(checked.record.pulses_per_rev);
        turns / (edges[edges.len() - 1] - edges[0]) * teeth
    };
    let all: Vec<f64> = (0..checked.record.runs.len()).map(mesh).collect();
    let places: Vec<usize> = (0..all.len()).filter(|&r| !(all[r] > 0.0 && all[r] < most)).collect();
    let worst = all.iter().copied().fold(0.0, f64::max);
    let text = format!(
        "the tach edges put the mesh at {worst:.4e} Hz, above what can be compared ({most:.0} Hz) {}",
        checked.in_runs(&places)
    );
    let finding = Finding::new(Severity::SetAside, Kind::Speed, worst, most, "Hz", text);
    checked.add_for_runs(&places, Severity::SetAside, Severity::Refuse, finding);
    checked.set_aside();
}

/// Edges of a run as they should have been.
pub(crate) struct Repair {
    pub(crate) edges_s: Vec<f64>,
    added: Vec<f64>,
    removed: Vec<f64>,
}

impl Repair {
    /// Repairs at least two edges; what is usual is taken from the intervals near by, so that a run-up passes.
    pub(crate) fn of(edges: &[f64]) -> Self {
        let usual = usual_intervals(edges);
        let mut repair = Self { edges_s: vec![edges[0]], added: Vec::new(), removed: Vec::new() };
        let mut next = 1;
        while next < edges.len() {
            let (last, edge, usual) = (repair.edges_s[repair.edges_s.len() - 1], edges[next], usual[next - 1]);
            let count = (edge - last) / usual;
            if count < TOO_SHORT {
                // Of two edges close together the one that is in time with the others stays.
                let before = repair.edges_s.len().checked_sub(2).map(|i| repair.edges_s[i]);
                let off = |at: f64| match (before, edges.get(next + 1)) {
                    (Some(before), _) => (at - before - usual).abs(),
                    (None, Some(after)) => (after - at - usual).abs(),
                    (None, None) => 0.0,
                };
                if off(edge) < off(last) {
                    repair.removed.push(last);
                    repair.edges_s.pop();
                    repair.edges_s.push(edge);
                } else {
                    repair.removed.push(edge);
                }
            } else {
                let whole = count.round();
                if whole >= 2.0 && (count - whole).abs() < NEAR_WHOLE * whole {
                    let step = (edge - last) / whole;
                    let lost = (1..whole as usize).map(|i| last + i as f64 * step);
                    repair.added.extend(lost.clone());
                    repair.edges_s.extend(lost);
                }
                repair.edges_s.push(edge);
            }
            next += 1;
        }
        repair
    }

    pub(crate) fn changes(&self) -> usize {
        self.added.len() + self.removed.len()
    }

    pub(crate) fn words(&self) -> String {
        let mut words = Vec::new();
        for (edges, what) in [(&self.added, "lost"), (&self.removed, "too many")] {
            if let Some(first) = edges.first() {
                words.push(format!("{} {what} (at {first:.4} s)", edges.len()));
            }
        }
        words.join(", ")
    }
}

/// Median interval about each interval.
fn usual_intervals(edges: &[f64]) -> Vec<f64> {
    let intervals: Vec<f64> = edges.windows(2).map(|w| w[1] - w[0]).collect();
    let about = |i: usize| {
        let mut near = intervals[i.saturating_sub(NEAR_BY)..(i + NEAR_BY + 1).min(intervals.len())].to_vec();
        let middle = near.len() / 2;
        *near.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    (0..intervals.len()).map(about).collect()
}
