//! Steps of a commissioning, what each found, and how it ended.

use serde::Serialize;

/// The steps, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Step {
    /// Which node this is, since when and why it runs.
    Identify,
    /// Sensor, converter, tach, and whether they belong to the declared machine.
    Wiring,
    /// The machine goes through its speeds.
    RunUp,
    /// The bandwidth law: given, kept or learned.
    Law,
    /// Levels of the sound machine over its speeds.
    Baseline,
    /// Limits from the baseline's own spread.
    Alarms,
    /// The configuration is stored and read back.
    Store,
}

impl Step {
    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Identify => "identify",
            Self::Wiring => "wiring",
            Self::RunUp => "run-up",
            Self::Law => "law",
            Self::Baseline => "baseline",
            Self::Alarms => "alarms",
            Self::Store => "store",
        }
    }
}

/// How a finding, and with it its step, ended; a later one is worse.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// It could not be looked at here.
    NotJudged,
    /// As it should be.
    Passed,
    /// Worth a look; the commissioning goes on.
    Warned,
    /// Nothing that follows would mean anything: the commissioning ends.
    Refused,
}

impl Outcome {
    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Self::NotJudged => "not judged",
            Self::Passed => "passed",
            Self::Warned => "warned",
            Self::Refused => "refused",
        }
    }
}

/// One thing looked at.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// What was looked at.
    pub what: String,
    /// The figure seen, with its unit.
    pub seen: String,
    /// Judgement.
    pub outcome: Outcome,
    /// What to do; empty where nothing is to be done.
    pub advice: String,
}

impl Finding {
    /// As it should be.
    pub fn passed(what: impl Into<String>, seen: impl Into<String>) -> Self {
        Self { what: what.into(), seen: seen.into(), outcome: Outcome::Passed, advice: String::new() }
    }

    /// It could not be looked at; `seen` says why.
    pub fn not_judged(what: impl Into<String>, seen: impl Into<String>) -> Self {
        Self { outcome: Outcome::NotJudged, ..Self::passed(what, seen) }
    }

    /// Worth a look; `advice` says what to do.
    pub fn warned(what: impl Into<String>, seen: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { outcome: Outcome::Warned, advice: advice.into(), ..Self::passed(what, seen) }
    }

    /// The end of the commissioning; `advice` says what to do.
    pub fn refused(what: impl Into<String>, seen: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { outcome: Outcome::Refused, advice: advice.into(), ..Self::passed(what, seen) }
    }
}

/// A step that was taken.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StepRecord {
    /// Which.
    pub step: Step,
    /// The worst of its findings.
    pub outcome: Outcome,
    /// What was seen, in the order of looking.
    pub findings: Vec<Finding>,
}

impl StepRecord {
    /// From what was found.
    pub fn new(step: Step, findings: Vec<Finding>) -> Self {
        let outcome = findings.iter().map(|finding| finding.outcome).max().unwrap_or(Outcome::Passed);
        Self { step, outcome, findings }
    }

    /// The finding that ended it.
    pub fn refusal(&self) -> Option<&Finding> {
        self.findings.iter().find(|finding| finding.outcome == Outcome::Refused)
    }
}
