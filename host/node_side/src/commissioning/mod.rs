//! From wired to watching: one way through everything that stands between a node on its wires and one that watches
//! its machine.
//!
//! Steps ([`step`]) follow each other: [`identify`], [`wiring`] with [`tach`] and [`mesh_fit`], [`run_up`] with
//! [`coverage`], [`law`], [`baseline`],
//! [`limits`], and storing. Each says what it saw, judges it, and says what to do; a refused one ends the course. All
//! of it is asked of the node by the messages that every host has ([`ear`]), and what is learned are the node's own
//! values: nothing here computes one of them a second time.
//!
//! The node gets the facts of the machine at the beginning, without storing them, because its values depend on them.
//! Whatever ends the course before the end (a refusal, an interrupt, a lost link), the former configuration is sent
//! again; the stored one is not touched before the last step, so a lost link costs a restart at worst. Sent again
//! means not stored by a latch until the next start ([`meshband::node`]).

pub mod baseline;
pub mod coverage;
pub mod ear;
pub mod identify;
pub mod law;
pub mod limits;
pub mod mesh_fit;
pub mod outcome;
pub mod report;
pub mod run_up;
pub mod settings_text;
pub mod step;
pub mod store;
pub mod tach;
pub mod wiring;

use crate::law::domain::Domain;
use crate::link::Client;
use crate::link::setup::{Installation, Sources};
use crate::machine::Machine;
use crate::{Error, Result};
use coverage::Coverage;
use ear::{Ear, Operator};
use law::Chosen;
use meshband::board::Timing;
use meshband::config::Configuration;
use meshband::units::TicksPerSecond;
use outcome::Commissioning;
use run_up::Heard;
use step::{Outcome, Step, StepRecord};

/// What is asked for.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Name of the port, for the report.
    pub port: String,
    /// The machine.
    pub machine: Machine,
    /// Machine, law and settings as the node gets them.
    pub sources: Sources,
    /// What only the installation knows.
    pub installation: Installation,
    /// Whether a law file is among the sources.
    pub law_given: bool,
    /// Speeds to go through.
    pub range: Domain,
    /// Values that fill a class of speeds.
    pub values: usize,
    /// Time for one way through the speeds, s of the node.
    pub seconds: f64,
    /// Standard uncertainty for what the baseline does not show, dB.
    pub allowance_db: f64,
    /// False alarms per year of turning.
    pub false_alarms_per_year: f64,
    /// Stored without asking.
    pub yes: bool,
}

/// Goes through all steps, as far as none is refused.
///
/// # Errors
/// Of the link and of the node, and where the end was asked for; the former configuration is then in force again as
/// far as the node can be reached.
pub fn commission(client: &mut Client, plan: &Plan, operator: &mut dyn Operator) -> Result<Commissioning> {
    let node = client.identify()?;
    let former = client.configuration()?;
    let mut config = former.clone();
    config.latched = 0;
    plan.sources.apply(&mut config, &plan.installation)?;
    let timing = Timing::of(&node.board, TicksPerSecond(node.ticks_per_second));
    config.validate(timing).map_err(|error| Error::invalid("configuration", format!("{error} on this node")))?;
    let mut done = Commissioning::new(&plan.port, &plan.machine.title, node);
    let mut ear = Ear::new(client, done.node.ticks_per_second);
    let result = Course { plan, former: &former, timing, done: &mut done }.run(&mut ear, config, operator);
    if done.stored {
        return result
            .map(|()| done)
            .map_err(|error| Error::tool("commission", format!("{error}; the new configuration is stored")));
    }
    let in_force = ear.client.configuration();
    let restored = match in_force {
        Ok(held) if Configuration { latched: 0, ..held.clone() } == Configuration { latched: 0, ..former.clone() } => {
            Ok(())
        }
        _ => ear.client.set_configuration(&former),
    };
    match (result, restored) {
        (Ok(()), restored) => restored.map(|()| done),
        (Err(error), Ok(())) => {
            Err(Error::tool("commission", format!("{error}; the former configuration is in force")))
        }
        (Err(error), Err(other)) => {
            let what = format!(
                "{error}; the former configuration could not be sent again ({other}): it is in force from the node's \
                 next start"
            );
            Err(Error::tool("commission", what))
        }
    }
}

/// One way through the steps.
struct Course<'a> {
    plan: &'a Plan,
    former: &'a Configuration,
    timing: Timing,
    done: &'a mut Commissioning,
}

impl Course<'_> {
    fn run(&mut self, ear: &mut Ear<'_>, mut config: Configuration, operator: &mut dyn Operator) -> Result<()> {
        let record = identify::identify(ear, &self.done.node, self.former, operator)?;
        if !self.ends(record, operator)? {
            return Ok(());
        }
        self.put_in_force(ear, &config, operator)?;
        let record = wiring(ear, &config, operator)?;
        if !self.ends(record, operator)? {
            return Ok(());
        }
        let Some(mut heard) = self.run_up(ear, operator)? else { return Ok(()) };
        let covered_hz = heard.coverage.covered_hz().unwrap_or([self.plan.range.lowest_hz, self.plan.range.highest_hz]);
        let (chosen, record) =
            law::choose(&heard.edges, &config.law, self.plan.law_given, &self.plan.machine, covered_hz);
        self.done.edges = heard.edges.clone();
        self.ends(record, operator)?;
        if let Chosen::Learned(file) = chosen {
            config.law = file.for_node()?;
            self.done.law = Some(*file);
            self.put_in_force(ear, &config, operator)?;
            operator
                .tell("law: rates follow the new law from here on, so the levels are measured with it once more")?;
            // The former way's record goes: the levels are those of the second one.
            self.done.steps.retain(|record| record.step != Step::RunUp);
            let Some(again) = self.run_up(ear, operator)? else { return Ok(()) };
            heard = again;
        }
        let goes_on = self.propose(&mut heard, &mut config, operator)?;
        self.done.heard = Some(heard);
        if goes_on { self.store(ear, &config, operator) } else { Ok(()) }
    }

    /// Keeps and tells a step's record; false where it ends the course.
    fn ends(&mut self, record: StepRecord, operator: &mut dyn Operator) -> Result<bool> {
        for finding in &record.findings {
            let advice = if finding.advice.is_empty() { String::new() } else { format!(": {}", finding.advice) };
            operator.tell(&format!(
                "{}: {:<7} {}: {}{advice}",
                record.step.name(),
                finding.outcome.name(),
                finding.what,
                finding.seen
            ))?;
        }
        let goes_on = record.outcome != Outcome::Refused;
        self.done.steps.push(record);
        Ok(goes_on)
    }

    fn put_in_force(&self, ear: &mut Ear<'_>, config: &Configuration, operator: &mut dyn Operator) -> Result<()> {
        if *config != (Configuration { latched: 0, ..self.former.clone() }) {
            ear.client.set_configuration(config)?;
        }
        ear.settle(operator)
    }

    fn run_up(&mut self, ear: &mut Ear<'_>, operator: &mut dyn Operator) -> Result<Option<Heard>> {
        let coverage = Coverage::new(self.plan.range, self.plan.values);
        let heard = run_up::run_up(ear, coverage, self.plan.seconds, operator)?;
        self.done.coverage = Some(heard.coverage.clone());
        let goes_on = self.ends(run_up::judged(&heard), operator)?;
        Ok(goes_on.then_some(heard))
    }

    /// Levels and limits into the configuration; false where nothing can be expected of the machine.
    fn propose(&mut self, heard: &mut Heard, config: &mut Configuration, operator: &mut dyn Operator) -> Result<bool> {
        let plan = self.plan;
        let (learned, spreads, record) = baseline::baseline(heard, plan.allowance_db)?;
        if !self.ends(record, operator)? {
            return Ok(false);
        }
        let taught = (&learned, &spreads);
        let (proposal, record) =
            limits::propose(heard, taught, plan.allowance_db, plan.false_alarms_per_year, &config.alarms);
        self.ends(record, operator)?;
        (config.levels, config.local_levels) = (learned.levels().collect(), learned.local_levels().collect());
        config.alarms = proposal.alarms.iter().copied().collect();
        // The proposal is of the pinion.
        config.alarm_gears.clear();
        config.holding.watch_signal = true;
        config
            .validate(self.timing)
            .map_err(|error| Error::invalid("configuration", format!("{error} on this node")))?;
        self.done.levels = Some(learned);
        self.done.alarms = Some(proposal);
        self.done.changes = settings_text::changes(self.former, config);
        self.done.configuration = Some(config.clone());
        Ok(true)
    }

    fn store(&mut self, ear: &mut Ear<'_>, config: &Configuration, operator: &mut dyn Operator) -> Result<()> {
        for change in &self.done.changes {
            operator.tell(&format!("store: {}: {} -> {}", change.key, change.before, change.after))?;
        }
        let wanted = self.plan.yes || operator.ask("Store this configuration on the node?")?;
        if wanted {
            store::store(ear, config)?;
            self.done.stored = true;
        }
        // What is stored stays so: what ends the watching is a finding, and everything is written.
        let record = match wanted {
            true => store::watching(ear, config, operator).unwrap_or_else(|error| store::unwatched(&error)),
            false => store::left(),
        };
        self.ends(record, operator)?;
        Ok(())
    }
}

fn wiring(ear: &mut Ear<'_>, config: &Configuration, operator: &mut dyn Operator) -> Result<StepRecord> {
    let mut findings = wiring::signal(ear, config, operator)?;
    if findings.iter().all(|finding| finding.outcome != Outcome::Refused) {
        findings.extend(tach::tach(ear, config, operator)?);
    }
    Ok(StepRecord::new(Step::Wiring, findings))
}
