//! What signal-based inference says of a record: JSON for machines; `view` and `report` show the same.

use super::accept::Surrogates;
use super::errors::Errors;
use super::split::Split;
use serde::Serialize;
use std::collections::BTreeMap;

/// The answer.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// Name of the record.
    pub record: String,
    /// Level, and what was found, in one line.
    pub headline: String,
    /// "signal-based".
    pub level: &'static str,
    /// What model-based inference would need.
    pub to_raise_the_level: Vec<String>,
    /// What was left out or assumed.
    pub notes: Vec<String>,
    /// Unit of amplitudes.
    pub unit: String,
    /// What was held out.
    pub split: SplitUsed,
    /// Errors in three stages.
    pub error: ErrorTable,
    /// Waveform error on the held-out turns: the figures of `error`, as the field records ask for them.
    pub held_out: super::errors::Stages,
    /// Unknowns of the three stages.
    pub unknowns: [usize; 3],
    /// Most functions of speed that a mesh line has, per run.
    pub speed_functions: Vec<usize>,
    /// Families found.
    pub effects: Vec<Effect>,
    /// Combs of impacts: bands, depths, squared envelope spectra.
    #[serde(skip)]
    pub impacts: Vec<super::impacts::Impacts>,
    /// Orders read together as a bearing.
    pub bearing: Option<BearingRead>,
    /// Speed against load, where the runs declare loads.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slip: Option<super::motor_slip::Law>,
    /// Families not found: what would have been.
    pub limits: Vec<Limit>,
    /// What the surrogates of every family judged say.
    pub surrogates: Vec<Judged>,
    /// The rest.
    pub unexplained: Vec<Unexplained>,
    /// Candidates scored.
    pub candidates_tried: usize,
    /// Probability of any false family in the search.
    pub false_alarm: f64,
    /// Pictures' data.
    #[serde(skip)]
    pub pictures: Vec<Picture>,
}

impl Outcome {
    /// The same where the record contradicts what every family rests on: nothing is named, no limit stands.
    pub fn abstaining(mut self, finding: String) -> Self {
        self.headline = format!("abstained: {finding}; {}", self.headline.replace("nothing beyond the mesh; ", ""));
        self.limits.clear();
        self.notes.insert(0, finding);
        self
    }
}

/// The error table of the loop's JSON.
#[derive(Debug, Clone, Default, Serialize)]
pub struct ErrorTable {
    /// What the numbers are.
    pub metric: String,
    /// Errors.
    #[serde(flatten)]
    pub errors: Errors,
}

/// What was held out.
#[derive(Debug, Clone, Serialize)]
pub struct SplitUsed {
    /// In words.
    pub kind: String,
    /// Turns of every run.
    pub runs: Vec<(usize, Split)>,
    /// Channels that families were searched on.
    pub searched_channels: Vec<usize>,
    /// Channels that they were not.
    pub held_out_channels: Vec<usize>,
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

/// Evidence of a family.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Evidence {
    /// Not known at this level.
    pub speed_exponent: Option<f64>,
    /// Not known at this level.
    pub torque_exponent: Option<f64>,
    /// Fall of the unexplained share of the held-out power.
    pub held_out_gain: f64,
    /// Logarithm of the Bayes factor of its lines on the held-out turns.
    pub held_out_ln_bayes: f64,
    /// Probability of such a score by chance in the whole search.
    pub p_value: f64,
    /// Logarithm of the Bayes factor against no line, less the logarithm of the alternatives.
    pub ln_bayes: f64,
    /// Not computed: families do not share lines.
    pub bayes_factor_over_next: Option<f64>,
    /// Surrogates.
    pub surrogates: Option<Surrogates>,
    /// Spectrum it was read from.
    pub domain: Option<&'static str>,
}

/// One effect.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Effect {
    /// named, ambiguous, generic.
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
    /// Values.
    pub parameters: BTreeMap<String, Value>,
    /// Evidence.
    pub evidence: Evidence,
    /// What is predicted of it: "waveform" or "power".
    pub predicts: &'static str,
    /// What would decide, or why no name is given.
    pub remark: Option<String>,
    /// Sidebands about its lines, in words.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub carries: Vec<String>,
    /// Lines that stand: place and order.
    pub lines: Vec<(String, f64)>,
}

/// A bearing.
#[derive(Debug, Clone, Serialize)]
pub struct BearingRead {
    /// Shaft that it carries.
    pub shaft: &'static str,
    /// Rolling elements.
    pub elements: u32,
    /// Element over pitch diameter, times the cosine of the contact angle.
    pub ratio: f64,
    /// Order of the pinion and what it is.
    pub parts: Vec<(f64, &'static str)>,
    /// Largest relative distance of an order from the reading.
    pub worst: f64,
}

/// What would have been found.
#[derive(Debug, Clone, Serialize)]
pub struct Limit {
    /// Family.
    pub family: String,
    /// Strength found in half of the places tried.
    pub found_in_half: Option<f64>,
    /// Strength found in nine of ten.
    pub found_in_90_percent: Option<f64>,
    /// What the strength is.
    pub unit: String,
    /// Places tried.
    pub places: usize,
}

/// A family judged.
#[derive(Debug, Clone, Serialize)]
pub struct Judged {
    /// In words.
    pub family: String,
    /// Base order or frequency.
    pub base: f64,
    /// Logarithm of the Bayes factor after the choice.
    pub ln_bayes: f64,
    /// Why it was refused; none where it was adopted.
    pub refused: Option<String>,
    /// Surrogates.
    #[serde(flatten)]
    pub surrogates: Surrogates,
}

/// What stays.
#[derive(Debug, Clone, Serialize)]
pub struct Unexplained {
    /// In words.
    pub description: String,
    /// Share of the variance, mean over channels.
    pub variance_share: f64,
}

/// Spectra of one channel before and after, for the report.
#[derive(Debug, Clone)]
pub struct Picture {
    /// Run and channel of the record.
    pub place: (usize, usize),
    /// Name of the channel.
    pub name: String,
    /// Order and amplitude: record, calibrated residual, corrected residual.
    pub spectra: [Vec<(f64, f64)>; 3],
}
