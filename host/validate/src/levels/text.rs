//! Detection and false alarms as the page that `meshband levels curves` prints.

use super::bench::{FAULTS, STEPS};
use super::hours::NOISE_M_S2;
use super::judge::{PARTS, Row};
use serde::Serialize;

/// Hours that were run.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Spent {
    /// Sound, to learn the levels and the absolute alarms' units.
    pub taught: usize,
    /// Sound, to count false alarms.
    pub sound: usize,
    /// Of each fault.
    pub each_fault: usize,
}

impl Spent {
    /// Shares of a number of hours: one in ten teaches, half of the rest is sound.
    pub fn of(hours: usize) -> Self {
        let taught = (hours / 10).max(1);
        let each_fault = ((hours - taught) / 2 / FAULTS.len()).max(1);
        Self { taught, sound: hours - taught - FAULTS.len() * each_fault, each_fault }
    }

    /// All of them.
    pub fn all(self) -> usize {
        self.taught + self.sound + FAULTS.len() * self.each_fault
    }
}

/// The page.
pub fn page(command: &str, title: &str, spent: Spent, range_hz: (f64, f64), rows: &[Row]) -> String {
    let mut text = format!(
        "# Departure alarms against absolute alarms\n\nMade by `{command}`; edit nothing here.\n\n\
         Machine {title}, pinion at {} to {} Hz at random, load 0.7 to 1.3 of the nominal torque at random, noise of \
         {NOISE_M_S2} m/s2 per code. \
         {} hours of machine time through the host's node: {} sound ones teach the levels and the absolute alarms' \
         units, {} sound ones count false alarms, \
         {} for each fault, in which it grows evenly from nothing to all of it:\n\n",
        range_hz.0,
        range_hz.1,
        spent.all(),
        spent.taught,
        spent.sound,
        spent.each_fault
    );
    for fault in &FAULTS {
        text += &format!("* {}: {}\n", fault.name, fault.full);
    }
    text += &format!(
        "\nThe machine is put together from steady states (24 speeds, {STEPS} steps of severity; \
         `host/validate/src/levels/bench.rs`), the converter runs at 25 kHz to 50 kHz \
         behind a 5 kHz filter; the node's code is the one that boards run. All alarms need three values in a row. A \
         limit is the lowest that gives no more false alarms than allowed \
         in the sound hours, for every policy alike, and is chosen on those hours. What is not in it: other faults, \
         a gear with errors, temperature, sensors that age.\n\n\
         ## First alarm\n\nMedian severity at which the first alarm came, 1 being all of the fault; - where most \
         hours had none.\n\n"
    );
    let allowed: Vec<usize> = distinct(rows);
    text += "| alarms on |";
    for fault in &FAULTS {
        for n in &allowed {
            text += &format!(" {}, {n} in {} h |", fault.name, spent.sound);
        }
    }
    text += "\n|---|";
    text += &"---|".repeat(FAULTS.len() * allowed.len());
    text += "\n";
    for policy in policies(rows) {
        text += &format!("| {policy} |");
        for fault in 0..FAULTS.len() {
            for n in &allowed {
                let row = rows.iter().find(|row| row.policy == policy && row.allowed == *n);
                let first = row.and_then(|row| row.detection[fault].first);
                text += &first.map_or(" - |".into(), |severity| format!(" {severity:.2} |"));
            }
        }
        text += "\n";
    }
    text + &curves(rows, &allowed, spent)
}

/// Share of the time with an alarm, by severity.
fn curves(rows: &[Row], allowed: &[usize], spent: Spent) -> String {
    let mut text = String::from(
        "\n## Detection by severity\n\nShare of the values at which an alarm stood, per cent, by severity.\n",
    );
    for (fault, n) in (0..FAULTS.len()).flat_map(|fault| allowed.iter().map(move |n| (fault, n))) {
        text += &format!(
            "\n### {}, {n} false alarms in {} h\n\n| alarms on | limit | false alarms |",
            FAULTS[fault].name, spent.sound
        );
        for part in 0..PARTS {
            let edge = |k: usize| k as f64 / PARTS as f64;
            text += &format!(" {:.1} to {:.1} |", edge(part), edge(part + 1));
        }
        text += "\n|---|---|---|";
        text += &"---|".repeat(PARTS);
        text += "\n";
        for row in rows.iter().filter(|row| row.allowed == *n) {
            text += &format!("| {} | {:.2} | {} |", row.policy, row.limit, row.false_alarms);
            for share in row.detection[fault].standing {
                text += &format!(" {:.0} |", 100.0 * share);
            }
            text += "\n";
        }
    }
    text
}

fn distinct(rows: &[Row]) -> Vec<usize> {
    let mut allowed: Vec<usize> = rows.iter().map(|row| row.allowed).collect();
    allowed.sort_unstable();
    allowed.dedup();
    allowed
}

fn policies(rows: &[Row]) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for row in rows {
        if !names.contains(&row.policy.as_str()) {
            names.push(&row.policy);
        }
    }
    names
}
