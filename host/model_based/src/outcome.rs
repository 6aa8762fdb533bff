//! What the loop says of a record: the JSON of the blind task, and a short text.

use super::candidate::{Parameter, Tuning};
use super::null_records::NullRecords;
use super::probability::Probability;
use super::refusal::Refused;
use super::start::Start;
use crate::check::Findings;
use crate::observation::spectrum::Bins;
use crate::{Error, Result};
use serde::Serialize;
use std::collections::BTreeMap;

/// NRMSE of one part of the signal at three stages, beside what noise alone leaves. What a stage gains, it gains over
/// the one before: an effect is worth `corrected` against `calibrated`, never against `declared`.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Stages {
    /// The machine as declared.
    pub declared: f64,
    /// Declared parameters fitted within their tolerances, no effect.
    pub calibrated: f64,
    /// Parameters and effects fitted.
    pub corrected: f64,
    /// Share that the local noise of the corrected residual leaves.
    pub noise_floor: f64,
}

/// Error of one group of runs.
#[derive(Debug, Clone, Default, Serialize)]
pub struct StagedError {
    /// Bins within one bin of an order of either shaft, both channels pooled.
    pub shaft_synchronous: Stages,
    /// The whole signal below 15 kHz, both channels pooled.
    pub whole_signal: Stages,
    /// The whole signal, channel by channel.
    pub per_channel: [Stages; 2],
}

impl StagedError {
    /// Every part, with its name.
    pub fn parts(&self) -> [(&'static str, Stages); 4] {
        [
            ("shaft-synchronous, pooled", self.shaft_synchronous),
            ("whole signal, pooled", self.whole_signal),
            ("whole signal, channel 0", self.per_channel[0]),
            ("whole signal, channel 1", self.per_channel[1]),
        ]
    }
}

/// Error table.
#[derive(Debug, Clone, Default, Serialize)]
pub struct ErrorTable {
    /// What the numbers are.
    pub metric: String,
    /// Runs used for finding and fitting.
    pub fit_runs: StagedError,
    /// Runs read once at the end.
    pub held_out_runs: StagedError,
}

/// Error of one held-out run beside a floor that a run's own failure does not lift.
#[derive(Debug, Clone, Serialize)]
pub struct HeldOut {
    /// Index of the run in the record.
    pub run: usize,
    /// NRMSE with parameters and effects, shaft-synchronous part and whole signal.
    pub corrected: [f64; 2],
    /// Noise, the equations' own error, and twice what the tachometer's declared jitter and the uncertainty of the
    /// declared parameters do, of the same.
    pub floor: [f64; 2],
}

/// Error over floor from which a held-out run contradicts the verdict.
pub const MAX_FLOOR_RATIO: f64 = 2.0;
/// Error that no prediction of anything leaves.
const LARGEST_ERROR: f64 = 1e3;

impl HeldOut {
    /// The larger ratio of error to floor.
    pub fn over_floor(&self) -> f64 {
        (0..2).map(|i| self.corrected[i] / self.floor[i].max(1e-300)).fold(0.0, f64::max)
    }
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
    /// Fall of the held-out NRMSE of the shaft-synchronous part (whole signal for fixed frequencies) when this effect
    /// is added last; of an only effect, corrected against calibrated.
    pub held_out_gain: f64,
    /// Probability of such a gain by chance, after correction for the search (`p_value`, `log10_p`); none where it is
    /// not counted.
    #[serde(flatten)]
    pub chance: Option<Probability>,
    /// Penalised log likelihood less that of the best explanation of another library name, nats: half the gain in
    /// chi-square less 5 per unknown and the logarithm of the alternatives searched. Like half a difference of BIC
    /// with a fixed penalty; no Bayes factor, since no prior of the strengths is integrated over.
    pub score_over_next: Option<f64>,
    /// Share of the residual power at the effect's own lines that it leaves beyond noise.
    pub left_at_its_lines: f64,
    /// Names considered next, with the drop of the same penalised log likelihood against the chosen one.
    pub next: Vec<(String, f64)>,
}

/// The run that would tell an ambiguous effect best from the name that it tells least.
#[derive(Debug, Clone, Serialize)]
pub struct NextMeasurement {
    /// Speed of the pinion, Hz.
    pub speed_hz: f64,
    /// Input torque, N m.
    pub torque_n_m: f64,
    /// Length of the run, s: that of the record's runs.
    pub seconds: f64,
    /// Channel that tells most.
    pub channel: usize,
    /// Expected evidence of both channels, nats, against the rival told least.
    pub nats: f64,
    /// The same of that channel alone.
    pub nats_of_channel: f64,
    /// That rival.
    pub against: String,
    /// Whether it decides.
    pub decides: bool,
}

/// One effect.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Effect {
    /// named, ambiguous, generic, or abstained: resembles the name, which something contradicts.
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
    /// Why a name is withheld.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub withheld_because: Option<String>,
    /// Experiment that would decide between the names in question.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub deciding_experiment: Option<String>,
    /// The run that would decide, where the model can say.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next_measurement: Option<NextMeasurement>,
    /// Effects of the gear: turns of the pinion by which every run starts later in the hunting period than its pulse
    /// 0 says, against the first run. Teeth and phases hold with these.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pinion_turns_of_runs: Option<Vec<u32>>,
    /// Orders of neither shaft: phase of every run against the first, rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub phase_of_runs_rad: Option<Vec<f64>>,
}

impl Effect {
    /// "named: NAME" and the like.
    pub fn verdict_and_name(&self) -> String {
        match self.withheld_because {
            Some(_) => format!("{}: resembles {}", self.verdict, self.name),
            None => format!("{}: {}", self.verdict, self.name),
        }
    }
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
    /// Power of torque in its excitation beyond the unit of its strength.
    pub torque_exponent: f64,
    /// Starts of the runs.
    pub start: Start,
}

/// Outcome of the loop.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// The answer in one line; what contradicts it comes first.
    pub headline: String,
    /// What is wrong with the record itself.
    pub findings: Findings,
    /// Name of the record.
    pub record: String,
    /// Error before and after.
    pub error: ErrorTable,
    /// Held-out runs one by one.
    pub held_out: Vec<HeldOut>,
    /// Effects found, strongest first.
    pub effects: Vec<Effect>,
    /// Effects not found: the strength from which on they would have been. Empty where nothing can be said, or nobody
    /// asked.
    pub limits: Vec<Limit>,
    /// The rest.
    pub unexplained: Vec<Unexplained>,
    /// Declared parameters as adopted, relative change.
    pub declared_parameter_changes: BTreeMap<String, f64>,
    /// The same with what they moved by next to the effects in the last fit: the corrected machine.
    pub corrected_parameter_changes: BTreeMap<String, f64>,
    /// Runs (index in the record) used to fit, to select, held out.
    pub split: [Vec<usize>; 3],
    /// Runs (index in the record) that were used at all: terms and residuals are in this order.
    pub runs_used: Vec<usize>,
    /// Scores given in the search (candidates, with their shapes, strengths and starts of runs): the trials that
    /// probabilities are corrected for.
    pub candidates_tried: usize,
    /// How often a record without any effect would have shown as much; none where nobody asked, or the record is
    /// distorted as a whole.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub null_records: Option<NullRecords>,
    /// Explanations considered and refused, with their best score and the gate's reason.
    pub refused: Vec<Refused>,
    /// Accepted terms as fitted, in the order of the first effects. Not written to JSON.
    #[serde(skip)]
    pub terms: Vec<Term>,
    /// Residual spectra of every run and channel: as declared, corrected. Not written to JSON.
    #[serde(skip)]
    pub residual: [Vec<[Bins; 2]>; 2],
}

impl Outcome {
    /// Places of the held-out runs among those used.
    pub fn held_out_places(&self) -> Vec<usize> {
        self.split[2].iter().filter_map(|run| self.runs_used.iter().position(|used| used == run)).collect()
    }

    /// Takes the limits of effects that no verdict names or has in question.
    pub fn state(&mut self, limits: Vec<Limit>) {
        let in_question = |l: &Limit| self.effects.iter().any(|e| e.name.split(" or ").any(|name| name == l.family));
        self.limits = limits.into_iter().filter(|l| !in_question(l)).collect();
    }

    /// Takes the record's check into the answer: findings first, runs by their index in the record, no name next to a
    /// contradiction.
    ///
    /// # Errors
    /// Errors that are no numbers or absurdly large: nothing was predicted.
    pub fn checked(mut self, findings: Findings, runs: &[usize]) -> Result<Self> {
        let all = [&self.error.fit_runs, &self.error.held_out_runs];
        let figures = all.iter().flat_map(|e| [e.shaft_synchronous, e.whole_signal]);
        let figures = figures.flat_map(|s| [s.declared, s.calibrated, s.corrected, s.noise_floor]);
        if let Some(absurd) = figures.into_iter().find(|x| x.is_nan() || *x > LARGEST_ERROR) {
            return Err(Error::impossible(
                "loop",
                format!("an error of {absurd:.3e} is no result: nothing was predicted"),
            ));
        }
        let named = |run: &mut usize| *run = runs[*run];
        self.split.iter_mut().flatten().for_each(named);
        self.held_out.iter_mut().for_each(|held| named(&mut held.run));
        self.runs_used = runs.to_vec();
        self.findings = findings;
        self.contradict();
        Ok(self)
    }

    /// Withholds "nothing" and names where held-out runs or the record's check contradict them, and writes the
    /// headline.
    fn contradict(&mut self) {
        let worst = self.held_out.iter().max_by(|a, b| a.over_floor().total_cmp(&b.over_floor()));
        let contradiction = worst.filter(|held| held.over_floor() > MAX_FLOOR_RATIO).map(|held| {
            let i = usize::from(held.corrected[1] * held.floor[0] > held.corrected[0] * held.floor[1]);
            let part = ["of the shaft-synchronous part", "of the whole signal"][i];
            let (run, error, floor) = (held.run, held.corrected[i], held.floor[i]);
            format!("held-out run {run} is not explained: error {part} {error:.4} at a noise floor of {floor:.4}")
        });
        let withheld = self.findings.withholding_names().map(|finding| finding.text.clone());
        if contradiction.is_some() && self.effects.is_empty() {
            self.effects.push(Effect {
                verdict: "generic".into(),
                name: "held-out runs that the declared machine does not explain".into(),
                family: "other".into(),
                shaft: "none".into(),
                ..Effect::default()
            });
        }
        if let Some(reason) = contradiction.clone().or(withheld) {
            self.limits.clear();
            for effect in self.effects.iter_mut().filter(|e| e.verdict == "named" || e.verdict == "ambiguous") {
                effect.verdict = "abstained".into();
                effect.withheld_because = Some(reason.clone());
            }
        }
        let verdict = match self.effects.as_slice() {
            [] => "nothing beyond the declared machine".to_string(),
            effects => effects.iter().map(Effect::verdict_and_name).collect::<Vec<_>>().join("; "),
        };
        self.headline = match (contradiction, self.findings.list.len()) {
            (Some(contradiction), _) => format!("{contradiction}; {verdict}"),
            (None, 0) => verdict,
            (None, n) => format!("{verdict} (findings about the record: {n})"),
        };
    }
}

/// What would have been found.
#[derive(Debug, Clone, Serialize)]
pub struct Limit {
    /// Name of the effect.
    pub family: String,
    /// The body or channel that it sits on, and the band that its order, frequency or length is from where that
    /// matters; empty where there is no choice.
    pub at: String,
    /// Strength found in half of the places tried; none where nothing in range would have been.
    pub found_in_half: Option<f64>,
    /// Strength found in nine of ten.
    pub found_in_90_percent: Option<f64>,
    /// Unit of the strength.
    pub unit: String,
    /// The simulator's effect and key that the strength is a value of, as for `--effect`.
    pub strength: String,
    /// Places tried.
    pub places: usize,
    /// The simulator's keys that say where it sits.
    #[serde(skip)]
    pub keys: Vec<(&'static str, f64)>,
    /// Whether it is locked to an order of the pinion.
    #[serde(skip)]
    pub at_order: bool,
    /// The simulator's key that is drawn from a band, and the band.
    #[serde(skip)]
    pub within: Option<(&'static str, [f64; 2])>,
}
