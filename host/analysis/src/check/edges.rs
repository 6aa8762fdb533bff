//! Rules on the tach edges: lost and doubled edges, speeds that cannot be.
//!
//! The node's tracker bridges a lost edge and rejects a doubled one; on the whole run [`crate::pulses`] does the
//! same, with more behind an edge to judge it by. Limit: an edge lost at either end of a run cannot be seen, and does
//! no harm to the angle but by whole turns where there is one pulse per turn.

use super::Checked;
use super::finding::{Finding, Kind, Severity};
use crate::observation::spectrum::BAND_HZ;
use crate::pulses::{Place, counted};

/// Share of edges up to which they are repaired.
const MAX_REPAIRED_SHARE: f64 = 0.2;
/// Fewer edges than this say nothing about what is usual.
const MIN_EDGES: usize = 6;

/// Applies the rules on edges and repairs them.
pub fn check(checked: &mut Checked) {
    speeds(checked);
    let (mut repaired, mut beyond, mut words) = (Vec::new(), Vec::new(), Vec::new());
    for r in 0..checked.record.runs.len() {
        let repair = Repair::of(&checked.record.runs[r].edges_s);
        if repair.is_beyond() {
            beyond.push(r);
            continue;
        }
        if repair.changes() == 0 {
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
    removed: Vec<Place>,
    out_of_step: usize,
}

impl Repair {
    /// Repairs at least one edge; what is usual is taken from the intervals near by, so that a run-up passes.
    pub(crate) fn of(edges: &[f64]) -> Self {
        if edges.len() < MIN_EDGES {
            return Self { edges_s: edges.to_vec(), added: Vec::new(), removed: Vec::new(), out_of_step: 0 };
        }
        let pulses = counted(edges);
        let put_in = pulses.times_s.iter().zip(&pulses.measured).filter(|(_, measured)| !**measured);
        let added = put_in.map(|(t, _)| *t).collect();
        let out_of_step = pulses.out_of_step();
        Self { edges_s: pulses.times_s, added, removed: pulses.doubled, out_of_step }
    }

    pub(crate) fn changes(&self) -> usize {
        self.added.len() + self.removed.iter().map(|place| place.pulses).sum::<usize>()
    }

    /// Whether too many edges were changed or fit nowhere.
    pub(crate) fn is_beyond(&self) -> bool {
        (self.changes() + self.out_of_step) as f64 > MAX_REPAIRED_SHARE * self.edges_s.len() as f64
    }

    pub(crate) fn words(&self) -> String {
        let mut words = Vec::new();
        if let Some(first) = self.added.first() {
            words.push(format!("{} lost (at {first:.4} s)", self.added.len()));
        }
        if let Some(first) = self.removed.first() {
            let count: usize = self.removed.iter().map(|place| place.pulses).sum();
            words.push(format!("{count} too many (behind {:.4} s)", first.time_s));
        }
        words.join(", ")
    }
}
