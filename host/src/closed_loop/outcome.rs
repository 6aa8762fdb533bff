//! What the loop says of a record: the JSON of the blind task, and a short text.

use super::candidate::{Parameter, Tuning};
use super::spectrum::Bins;
use super::start::Start;
use serde::Serialize;
use std::collections::BTreeMap;

/// Error of one group of runs.
#[derive(Debug, Clone, Default, Serialize)]
pub struct ErrorPair {
    /// NRMSE of the shaft-synchronous part, declared machine, pooled.
    pub before: f64,
    /// NRMSE of the shaft-synchronous part with the effects, pooled.
    pub after: f64,
    /// Share that local noise alone leaves.
    pub noise_floor: f64,
    /// The same for the whole signal below 15 kHz: before, after, floor.
    pub whole_signal: [f64; 3],
    /// Whole signal per channel: before, after, floor.
    pub per_channel: [[f64; 3]; 2],
}

/// Error table.
#[derive(Debug, Clone, Default, Serialize)]
pub struct ErrorTable {
    /// What the numbers are.
    pub metric: String,
    /// Runs used for finding and fitting.
    pub fit_runs: ErrorPair,
    /// Runs read once at the end.
    pub held_out_runs: ErrorPair,
}

/// Value with interval.
#[derive(Debug, Clone, Serialize)]
pub struct Value {
    /// Estimate.
    pub value: f64,
    /// 95 % interval.
    pub ci95: [f64; 2],
    /// Unit.
    pub unit: String,
}

/// Evidence of an effect.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Evidence {
    /// Exponent of shaft speed in the excitation.
    pub speed_exponent: Option<f64>,
    /// Its 95 % interval.
    pub speed_exponent_ci95: Option<[f64; 2]>,
    /// Exponent of torque in the excitation.
    pub torque_exponent: Option<f64>,
    /// Its 95 % interval.
    pub torque_exponent_ci95: Option<[f64; 2]>,
    /// Fall of the held-out NRMSE of the shaft-synchronous part (whole signal for fixed frequencies) when this effect is added last.
    pub held_out_gain: f64,
    /// Probability of such a gain by chance, after correction for the search.
    pub p_value: f64,
    /// Bayes factor over the best explanation of another name (capped at 1e6).
    pub bayes_factor_over_next: Option<f64>,
    /// Share of the residual power at the effect's own lines that it leaves beyond noise.
    pub left_at_its_lines: f64,
    /// Names considered next, with the drop in log likelihood against the chosen one.
    pub next: Vec<(String, f64)>,
}

/// One effect.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Effect {
    /// named, ambiguous or generic.
    pub verdict: String,
    /// Library name, names in question, or plain description.
    pub name: String,
    /// Family word.
    pub family: String,
    /// pinion, gear, none.
    pub shaft: String,
    /// Order of the pinion.
    pub order_of_pinion: Option<f64>,
    /// Frequency, Hz.
    pub frequency_hz: Option<f64>,
    /// Parameters.
    pub parameters: BTreeMap<String, Value>,
    /// Evidence.
    pub evidence: Evidence,
    /// Experiment that would decide between the names in question.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub deciding_experiment: Option<String>,
    /// Effects of the gear: turns of the pinion by which every run starts later in the hunting period than its pulse 0 says, against the first
    /// run. Teeth and phases hold with these.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pinion_turns_of_runs: Option<Vec<u32>>,
    /// Orders of neither shaft: phase of every run against the first, rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub phase_of_runs_rad: Option<Vec<f64>>,
}

/// What stays unexplained.
#[derive(Debug, Clone, Serialize)]
pub struct Unexplained {
    /// In words.
    pub description: String,
    /// Share of the variance below 15 kHz.
    pub variance_share: f64,
}

/// An accepted term as fitted: what the simulator must know of it beyond the reported values.
#[derive(Debug, Clone)]
pub struct Term {
    /// Name of the candidate.
    pub name: String,
    /// What the unknowns mean.
    pub parameters: Vec<Parameter>,
    /// Unknowns of the templates.
    pub unknowns: Vec<f64>,
    /// Size of the templates in each channel over the larger one.
    pub channel_share: [f64; 2],
    /// Phase is arbitrary in every run: the unknowns are a quadrature pair per run, zero in runs not seen.
    pub phase_free: bool,
    /// Shape found by search.
    pub tuning: Option<Tuning>,
    /// Starts of the runs.
    pub start: Start,
}

/// Outcome of the loop.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// Name of the record.
    pub record: String,
    /// Error before and after.
    pub error: ErrorTable,
    /// Effects found, strongest first.
    pub effects: Vec<Effect>,
    /// The rest.
    pub unexplained: Vec<Unexplained>,
    /// Declared parameters as adopted, relative change.
    pub declared_parameter_changes: BTreeMap<String, f64>,
    /// The same with what they moved by next to the effects in the last fit: the corrected machine.
    pub corrected_parameter_changes: BTreeMap<String, f64>,
    /// Runs (index) used to fit, to select, held out.
    pub split: [Vec<usize>; 3],
    /// Candidates considered and refused, with score.
    pub refused: Vec<(String, f64)>,
    /// Accepted terms as fitted, in the order of the first effects. Not written to JSON.
    #[serde(skip)]
    pub terms: Vec<Term>,
    /// Residual spectra of every run and channel: declared machine, corrected machine. Not written to JSON.
    #[serde(skip)]
    pub residual: [Vec<[Bins; 2]>; 2],
}

impl Outcome {
    /// A few lines for the terminal.
    pub fn summary(&self) -> String {
        let mut text = String::new();
        for (who, e) in [("fit", &self.error.fit_runs), ("held out", &self.error.held_out_runs)] {
            text += &format!(
                "{who:9} NRMSE shaft-synchronous {:.4} -> {:.4} (noise {:.4}), whole {:.4} -> {:.4} (noise {:.4})\n",
                e.before, e.after, e.noise_floor, e.whole_signal[0], e.whole_signal[1], e.whole_signal[2]
            );
        }
        for e in &self.effects {
            let seat = e
                .order_of_pinion
                .map(|o| format!("order {o:.4}"))
                .or(e.frequency_hz.map(|f| format!("{f:.2} Hz")))
                .unwrap_or_default();
            text += &format!("{}: {} [{}, {}] {seat}\n", e.verdict, e.name, e.family, e.shaft);
            for (name, v) in e.parameters.iter().take(6) {
                text += &format!("    {name} = {:.4e} [{:.4e}, {:.4e}] {}\n", v.value, v.ci95[0], v.ci95[1], v.unit);
            }
            if let Some(turns) = &e.pinion_turns_of_runs {
                text += &format!("    runs start {turns:?} turns of the pinion later than counted\n");
            }
            text += &format!(
                "    left at its lines {:.4}, p {:.1e}, Bayes factor {:?}, held-out gain {:.4}, speed^{:?} torque^{:?}, next {:?}\n",
                e.evidence.left_at_its_lines,
                e.evidence.p_value,
                e.evidence.bayes_factor_over_next,
                e.evidence.held_out_gain,
                e.evidence.speed_exponent,
                e.evidence.torque_exponent,
                e.evidence.next
            );
        }
        if self.effects.is_empty() {
            text += "nothing beyond the declared machine\n";
        }
        for u in &self.unexplained {
            text += &format!("unexplained: {} ({:.3} % of variance)\n", u.description, 100.0 * u.variance_share);
        }
        text
    }
}
