//! First step: which node this is, since when and why it runs.
//!
//! A node whose link or configuration has another schema has been refused by the client before anything is judged
//! here. Supply, chip temperature and the bias itself are not among what a node says of itself: the bias is judged
//! from a waveform's mean ([`super::wiring`]), the other two are said to be missing.

use super::ear::{Ear, Operator};
use super::step::{Finding, Step, StepRecord};
use crate::Result;
use crate::link::view::FIRST_TICK;
use crate::link::{report, text};
use meshband::config::{Configuration, Personality, SensorSupply};
use meshband::events::{Event, EventKind};
use meshband::message::{Identification, Message, Status, WIRE_SCHEMA};
use meshband::node::State;
use meshband::update::ImageStanding;

/// How long what the node has to tell of its past is listened to, s.
const PAST_S: f64 = 2.0;
/// Classes of the board's own events.
const CRASH: u32 = 1;
const INTERNAL_OSCILLATOR: u32 = 2;
const BROWN_OUT: u32 = 6;
const SAFE_START: u32 = 7;
/// Brown-out levels by the chip's option bits BOR_LEV (RM0090).
const BROWN_OUT_LEVELS: [&str; 4] = ["level 3", "level 2", "level 1", "off"];
/// Reset causes as the event of a start has them.
const CAUSES: [&str; 5] = ["power", "reset pin", "software", "watchdog", "another cause"];

/// Looks at who the node is.
///
/// # Errors
/// Of the link.
pub fn identify(
    ear: &mut Ear<'_>,
    node: &Identification,
    held: &Configuration,
    operator: &mut dyn Operator,
) -> Result<StepRecord> {
    let mut events = Vec::new();
    ear.client.events()?;
    ear.listen(PAST_S, operator, |message, _, _| {
        if let Message::Event(event) = message {
            events.push(*event);
        }
        Ok(false)
    })?;
    let mut findings = vec![Finding::passed("node", text::identity(node)), schemas(node), image(node)];
    findings.push(Finding::passed("running for", format!("{:.0} s", running_s(ear, &events))));
    findings.extend(starts(&events));
    findings.extend(state(ear.status(), held));
    findings.push(Finding::passed("self-test so far", report::self_test(node.self_test)));
    findings.push(Finding::not_judged("supply and chip temperature", "not reported by this firmware"));
    if held.link.personality == Personality::Modbus {
        let advice = "it speaks Modbus from its next start on: `meshband configure PORT --at-start` is the way back";
        findings.push(Finding::warned("line", "Modbus", advice));
    }
    Ok(StepRecord::new(Step::Identify, findings))
}

/// Seconds since the node's start, by its clock: from the event of the start, where the node still has it.
fn running_s(ear: &Ear<'_>, events: &[Event]) -> f64 {
    let origin = events.iter().find(|event| event.kind == EventKind::Started).map(|event| event.first_tick);
    ear.status().map_or(0.0, |status| ear.seconds(status.tick.saturating_sub(origin.unwrap_or(0).max(FIRST_TICK))))
}

fn schemas(node: &Identification) -> Finding {
    let seen = format!("link {}, configuration {}", node.wire_schema, node.configuration_schema);
    if node.wire_schema == WIRE_SCHEMA {
        return Finding::passed("schemas", seen);
    }
    let advice = format!(
        "this program knows link {WIRE_SCHEMA}: what the newer side has more is left aside; update the older one"
    );
    Finding::warned("schemas", seen, advice)
}

fn state(status: Option<&Status>, held: &Configuration) -> Vec<Finding> {
    let mut findings = Vec::new();
    if status.is_some_and(|status| status.state == State::Stopped) {
        findings.push(Finding::refused("state", "stopped", "start it: `meshband configure PORT --start`"));
    }
    if held.front_end.sensor_supply == SensorSupply::Off {
        let advice = "the sensor's supply is switched off by the configuration: [front_end] sensor_supply";
        findings.push(Finding::warned("sensor supply", "off", advice));
    }
    findings
}

fn image(node: &Identification) -> Finding {
    match node.image.standing {
        ImageStanding::OnTrial => {
            let advice = "the image may still be given up: confirm it by `meshband update` first";
            Finding::refused("image", "on trial", advice)
        }
        _ => match node.image.given_up {
            Some([major, minor, patch]) => {
                let advice = "a newer image was given up: the node runs the one before";
                Finding::warned("image", format!("{major}.{minor}.{patch} given up"), advice)
            }
            None => Finding::passed("image", "as built"),
        },
    }
}

/// Why the node runs, and what the board has noted since.
fn starts(events: &[Event]) -> Vec<Finding> {
    let cause = events.iter().rev().find(|event| event.kind == EventKind::Started).map(|event| event.detail as usize);
    let mut findings = vec![match cause {
        Some(3) => {
            Finding::warned("started by", CAUSES[3], "it had hung before: look at its events by `meshband monitor`")
        }
        Some(cause) => Finding::passed("started by", CAUSES[cause.min(CAUSES.len() - 1)]),
        None => Finding::passed("started by", "not told any more"),
    }];
    for event in events.iter().filter(|event| event.kind == EventKind::Board) {
        let (class, number) = (event.detail >> 24, event.detail & 0x00ff_ffff);
        let (seen, advice) = match class {
            CRASH => {
                (format!("crash, number {number}"), "it restarted after a crash; the number belongs into a report")
            }
            INTERNAL_OSCILLATOR => {
                ("internal oscillator".into(), "no crystal: frequencies within 1 %; see to the crystal")
            }
            BROWN_OUT => (
                format!("brown-out reset: {}", BROWN_OUT_LEVELS[BROWN_OUT_LEVELS.len().min(number as usize + 1) - 1]),
                "flash may be programmed at too low a voltage: set BOR_LEV to level 3 by a probe \
                 (book/src/howto/flash.md)",
            ),
            SAFE_START => (
                format!("safe start after {number} failures"),
                "the stored configuration is not in force: read it, mend it, and begin again",
            ),
            _ => continue,
        };
        // Told again with every look at its events.
        if findings.iter().all(|finding| finding.seen != seen) {
            findings.push(Finding::warned("board", seen, advice));
        }
    }
    findings
}
