//! Last step: the configuration on the node, read back, and the first values that it judges.

use super::ear::{Ear, Operator};
use super::step::{Finding, Step, StepRecord};
use crate::{Error, Result};
use meshband::config::Configuration;
use meshband::message::Message;

/// How long the first values against the new levels are waited for, s of the node.
const WATCHED_S: f64 = 10.0;

/// Sends, reads back, stores.
///
/// # Errors
/// Of the link; a node that holds another configuration than it was sent, or could not store it.
pub fn store(ear: &mut Ear<'_>, config: &Configuration) -> Result<()> {
    ear.client.set_configuration(config)?;
    if ear.client.configuration()? != *config {
        return Err(Error::tool("node", "holds another configuration than it was sent"));
    }
    ear.client.commit()
}

/// Looks whether the node judges values now.
///
/// # Errors
/// Of the link.
pub fn watching(ear: &mut Ear<'_>, config: &Configuration, operator: &mut dyn Operator) -> Result<StepRecord> {
    ear.settle(operator)?;
    let (mut largest, mut raised): (Option<f32>, u8) = (None, 0);
    ear.listen(WATCHED_S, operator, |message, _, _| {
        match message {
            Message::Indicators(values) => {
                largest = values.largest_departure().into_iter().chain(largest).reduce(f32::max);
            }
            Message::Status(status) => raised = status.alarms.raised,
            _ => {}
        }
        Ok(false)
    })?;
    let seen = format!("{} points, {} alarms", config.levels.len(), config.alarms.len());
    let mut findings = vec![Finding::passed("stored and read back", seen)];
    let limit = config.alarms.first().map_or(f32::NAN, |alarm| alarm.raise);
    findings.push(match largest {
        _ if raised != 0 => {
            let advice = "the machine that has just been learned is beyond its limits: it has changed since, look at \
                `meshband monitor`";
            Finding::warned("watching", format!("alarms raised: {raised:#010b}"), advice)
        }
        Some(largest) => {
            Finding::passed("watching", format!("largest departure {largest:.2} of {limit:.2} standard uncertainties"))
        }
        None => {
            let advice = "no value came at a learned speed: turn the machine and look at `meshband monitor`";
            Finding::warned("watching", "nothing to judge yet", advice)
        }
    });
    Ok(StepRecord::new(Step::Store, findings))
}

/// What is said where the first values were not waited for.
pub fn unwatched(error: &Error) -> StepRecord {
    let advice = "the configuration is stored; whether values are judged shows in `meshband monitor`";
    let findings = vec![
        Finding::passed("stored and read back", "yes"),
        Finding::warned("watching", format!("not looked at: {error}"), advice),
    ];
    StepRecord::new(Step::Store, findings)
}

/// What is said where nothing was to be stored.
pub fn left() -> StepRecord {
    let advice = "the former configuration stays; `meshband configure PORT --settings node.toml` (and --law law.toml \
        where one was learned) stores this one";
    StepRecord::new(Step::Store, vec![Finding::warned("stored", "no", advice)])
}
