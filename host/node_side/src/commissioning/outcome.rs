//! Everything that a commissioning gave: what is written as JSON and shown as a report.

use super::coverage::Coverage;
use super::limits::Proposal;
use super::run_up::{Heard, TimedEdge};
use super::settings_text::Change;
use super::step::{Finding, StepRecord};
use crate::law::file::LawFile;
use crate::levels::learn::Learned;
use meshband::config::Configuration;
use meshband::message::Identification;
use serde::Serialize;

/// Version of the JSON file.
pub const SCHEMA: u32 = 1;

/// A commissioning, whole or as far as it came.
#[derive(Debug, Clone, Serialize)]
pub struct Commissioning {
    /// Version of this schema.
    pub schema: u32,
    /// Where the node is.
    pub port: String,
    /// Title of the machine.
    pub machine: String,
    /// Who the node is.
    pub node: Identification,
    /// Steps taken, in order.
    pub steps: Vec<StepRecord>,
    /// Speeds seen, by class.
    pub coverage: Option<Coverage>,
    /// Bandwidths timed by the node.
    pub edges: Vec<TimedEdge>,
    /// Law learned here.
    pub law: Option<LawFile>,
    /// Expected levels.
    pub levels: Option<Learned>,
    /// Limits.
    pub alarms: Option<Proposal>,
    /// Settings that differ from those found.
    pub changes: Vec<Change>,
    /// The configuration that was made.
    pub configuration: Option<Configuration>,
    /// Whether the node holds it.
    pub stored: bool,
    /// What the baseline was learned from; for the pictures.
    #[serde(skip)]
    pub heard: Option<Heard>,
}

impl Commissioning {
    /// Before the first step.
    pub fn new(port: &str, machine: &str, node: Identification) -> Self {
        Self {
            schema: SCHEMA,
            port: port.into(),
            machine: machine.into(),
            node,
            steps: Vec::new(),
            coverage: None,
            edges: Vec::new(),
            law: None,
            levels: None,
            alarms: None,
            changes: Vec::new(),
            configuration: None,
            stored: false,
            heard: None,
        }
    }

    /// The step and the finding that ended it, if one did.
    pub fn refusal(&self) -> Option<(&StepRecord, &Finding)> {
        self.steps.iter().find_map(|step| Some((step, step.refusal()?)))
    }
}
