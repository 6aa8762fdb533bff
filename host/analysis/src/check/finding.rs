//! What a check of a record says: findings as data, and in words.

use crate::{Error, Result};
use serde::Serialize;

/// What follows from a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Severity {
    /// Nothing can be inferred from the record before this is mended.
    Refuse,
    /// The runs named take no part; the others are used where enough are left.
    SetAside,
    /// Said, and undone where the text says so.
    Say,
}

/// What is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// The declared unit is no acceleration.
    Unit,
    /// Samples that are no acceleration of a machine: not finite, or far too large.
    Absurd,
    /// A channel that does not move.
    Dead,
    /// Both channels carry one signal.
    SameChannels,
    /// Two runs carry one signal.
    SameRuns,
    /// The signal stands still for a while.
    Dropout,
    /// Single samples far from their neighbours.
    Spikes,
    /// Samples pile up at a limit.
    Limited,
    /// Tach edges missing or too many.
    Edges,
    /// Speeds that no gear pair has, or none that the sampling rate can follow.
    Speed,
    /// No mesh line anywhere near teeth x speed.
    NoMesh,
    /// Declared pulses per turn against the mesh line.
    PulsesPerTurn,
    /// Declared teeth of the pinion against the mesh line.
    PinionTeeth,
    /// Mesh line off teeth x speed by one factor in all runs.
    Clock,
    /// A run's mesh line stands where another run's speed has it.
    OtherRunsSpeed,
    /// A run's mesh line stands elsewhere.
    MeshElsewhere,
    /// The mesh's phase jumps against the tach within a run.
    Jump,
    /// A channel's sign against the prediction.
    Inverted,
    /// The declaration's other order of channels predicts better.
    Swapped,
    /// The vibration of both channels is late or early against the tach.
    TachDelay,
    /// The index mark is not where tooth 0 is.
    IndexMark,
    /// One channel is late against the prediction.
    ChannelDelay,
    /// Level against the prediction by a factor that looks like a unit.
    Level,
    /// Levels of runs against their declared torques.
    Torque,
    /// Nothing passes above a frequency.
    PassBand,
}

/// One finding.
#[derive(Debug, Clone, Serialize)]
pub struct Finding {
    /// What follows.
    pub severity: Severity,
    /// What is wrong.
    pub kind: Kind,
    /// In words, with place, figure and what was done.
    pub text: String,
    /// Runs concerned, by index in the record.
    pub runs: Vec<usize>,
    /// Channel concerned, from 0, where it is one.
    pub channel: Option<usize>,
    /// Figure measured (the worst of the runs concerned).
    pub figure: f64,
    /// Limit that it passes.
    pub limit: f64,
    /// Unit of both.
    pub unit: &'static str,
    /// Names of effects cannot be trusted next to this finding.
    pub withholds_names: bool,
}

impl Finding {
    /// A finding without place.
    pub fn new(severity: Severity, kind: Kind, figure: f64, limit: f64, unit: &'static str, text: String) -> Self {
        Self { severity, kind, text, runs: Vec::new(), channel: None, figure, limit, unit, withholds_names: false }
    }

    /// The same in these runs.
    pub fn in_runs(mut self, runs: Vec<usize>) -> Self {
        self.runs = runs;
        self
    }

    /// The same in one channel.
    pub fn in_channel(mut self, channel: usize) -> Self {
        self.channel = Some(channel);
        self
    }

    /// The same, with names of effects withheld.
    pub fn withholding_names(mut self) -> Self {
        self.withholds_names = true;
        self
    }
}

/// Name of a channel in texts.
pub fn channel_name(channel: usize) -> &'static str {
    ["channel 1 (pinion)", "channel 2 (gear)"][channel.min(1)]
}

/// Runs in words: "in all 8 runs", "in run 3", "in runs 0, 4".
pub fn in_runs(runs: &[usize], count: usize) -> String {
    let list: Vec<String> = runs.iter().map(usize::to_string).collect();
    match runs {
        all if all.len() == count => format!("in all {count} runs"),
        [_] => format!("in run {}", list.join("")),
        _ => format!("in runs {}", list.join(", ")),
    }
}

/// Everything a check says of a record.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Findings {
    /// Most severe first.
    pub list: Vec<Finding>,
    /// What no check of the record alone can see.
    pub not_checked: Vec<String>,
}

impl Findings {
    /// Adds a finding.
    pub fn add(&mut self, finding: Finding) {
        self.list.push(finding);
        self.list.sort_by_key(|f| f.severity);
    }

    /// Whether nothing may be inferred.
    pub fn refused(&self) -> bool {
        self.list.iter().any(|f| f.severity == Severity::Refuse)
    }

    /// Runs that are set aside, ascending.
    pub fn set_aside(&self) -> Vec<usize> {
        let mut runs: Vec<usize> = Vec::new();
        for finding in self.list.iter().filter(|f| f.severity == Severity::SetAside) {
            runs.extend(&finding.runs);
        }
        runs.sort_unstable();
        runs.dedup();
        runs
    }

    /// The first finding next to which no name of an effect is to be trusted.
    pub fn withholding_names(&self) -> Option<&Finding> {
        self.list.iter().find(|f| f.withholds_names)
    }

    /// Findings of one kind.
    pub fn of(&self, kind: Kind) -> impl Iterator<Item = &Finding> {
        self.list.iter().filter(move |f| f.kind == kind)
    }

    /// One line per finding.
    pub fn text(&self) -> String {
        let word = |s| match s {
            Severity::Refuse => "refused",
            Severity::SetAside => "set aside",
            Severity::Say => "note",
        };
        self.list.iter().map(|f| format!("{}: {}\n", word(f.severity), f.text)).collect()
    }

    /// Refuses a record from which nothing may be inferred.
    ///
    /// # Errors
    /// The first reason, in one line, with the number of further ones.
    pub fn require_usable(&self) -> Result<()> {
        let reasons: Vec<&Finding> = self.list.iter().filter(|f| f.severity == Severity::Refuse).collect();
        let Some(first) = reasons.first() else { return Ok(()) };
        let more = match reasons.len() {
            1 => String::new(),
            n => format!(" (and {} more)", n - 1),
        };
        Err(Error::invalid("record.toml", format!("not usable: {}{more}", first.text)))
    }
}
