//! What is wrong with a record, found before anything is inferred from it.
//!
//! In: the loop's view of a record ([`Record`]). Out: [`Findings`] (what, where, figure, limit, severity) and the
//! record as it may be used ([`Checked::record`]): runs set aside, and undone what can be undone exactly (edges,
//! clock ratio, lag of the tach, a channel's sign, order or delay). Rules go from the samples (`samples`) over the
//! tach (`edges`) and the mesh line (`mesh`, `lag`) to the declared machine's prediction (`prediction`); each
//! measures a figure and later ones see what earlier ones mended. An undeclared effect of the machine is no fault of
//! its record: limits are set so that the library's effects pass.

mod compared;
pub(crate) mod edges;
mod finding;
mod lag;
mod levels;
mod mesh;
mod prediction;
mod samples;

pub use finding::{Finding, Findings, Kind, Severity};

use crate::observation::input::Record;

/// Runs that the loop needs at least.
const LEAST_RUNS: usize = 3;

/// A record that was checked.
#[derive(Debug, Clone)]
pub struct Checked {
    /// What was found.
    pub findings: Findings,
    /// The record as it may be used.
    pub record: Record,
    /// Index of each of its runs in the record as it was.
    pub runs: Vec<usize>,
    /// Time by which the tach's edges were moved later for a lag that all runs share, s; parameters that are a little
    /// off may pass for one.
    pub tach_lag_s: Option<f64>,
}

/// Checks `record`.
pub fn record(record: &Record) -> Findings {
    mended(record).findings
}

/// Checks `record`, and mends what can be mended.
pub fn mended(record: &Record) -> Checked {
    let mut checked = Checked {
        findings: Findings { list: Vec::new(), not_checked: not_checked(record) },
        record: record.clone(),
        runs: (0..record.runs.len()).collect(),
        tach_lag_s: None,
    };
    type Rule = fn(&mut Checked);
    let rules: [Rule; 5] = [samples::check, edges::check, mesh::check, lag::check, prediction::check];
    for rule in rules {
        if checked.findings.refused() {
            break;
        }
        rule(&mut checked);
        checked.set_aside();
    }
    checked
}

impl Checked {
    /// Indices in the record as it was of runs at `places` in the record as it may be used.
    fn named(&self, places: &[usize]) -> Vec<usize> {
        places.iter().map(|&place| self.runs[place]).collect()
    }

    /// "in runs 0, 4" for runs at `places`.
    fn in_runs(&self, places: &[usize]) -> String {
        finding::in_runs(&self.named(places), self.runs.len())
    }

    /// Adds `make` once for all runs at `places`: with `whole` where they are all runs in use (or too few stay), else
    /// with `some`.
    fn add_for_runs(&mut self, places: &[usize], some: Severity, whole: Severity, finding: Finding) {
        if places.is_empty() {
            return;
        }
        let all = places.len() == self.runs.len() || (some == Severity::SetAside && self.too_few_without(places));
        let named = self.named(places);
        self.findings.add(Finding { severity: if all { whole } else { some }, ..finding.in_runs(named) });
    }

    fn too_few_without(&self, places: &[usize]) -> bool {
        self.runs.len() - places.len() < LEAST_RUNS
    }

    /// Takes the runs that the findings set aside out of the record.
    fn set_aside(&mut self) {
        let out = self.findings.set_aside();
        let keep: Vec<bool> = self.runs.iter().map(|run| !out.contains(run)).collect();
        let mut runs = keep.iter();
        self.record.runs.retain(|_| *runs.next().unwrap_or(&true));
        let mut runs = keep.iter();
        self.runs.retain(|_| *runs.next().unwrap_or(&true));
    }
}

fn not_checked(record: &Record) -> Vec<String> {
    vec![
        format!("teeth of the gear ({}): a sound gear shows no line that tells them", record.pair.teeth[1]),
        "which turn of the hunting period a run starts in".into(),
    ]
}
