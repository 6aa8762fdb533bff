//! An alarm as a configuration has it: its limit with side and severity, and how these are said.

use super::words::name_and_unit;
use meshband::alarm::{AlarmBand, AlarmMode, RISE_S, Severity, Side};
use meshband::config::Configuration;

/// An alarm as it is configured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limit {
    /// What is watched, from where to where.
    pub band: AlarmBand,
    /// Which side is wrong, and what it asks for.
    pub mode: AlarmMode,
    /// Gear of a train that is watched: 0 the pinion.
    pub gear: u8,
}

impl Limit {
    /// All of a configuration.
    pub fn all(config: &Configuration) -> Vec<Self> {
        let alarms = config.alarms.iter().enumerate();
        alarms
            .map(|(n, band)| Self { band: *band, mode: AlarmMode::of(&config.modes, n), gear: config.gear_of_alarm(n) })
            .collect()
    }

    /// Its name in capitals.
    pub fn call(&self) -> &'static str {
        call(self.mode.severity)
    }

    /// Beyond what, as "above 2 m/s2".
    pub fn beyond(&self) -> String {
        beyond(self.mode.side, self.band.raise, name_and_unit(self.band.watched).1)
    }
}

/// The name of a severity in capitals.
pub(super) fn call(severity: Severity) -> &'static str {
    match severity {
        Severity::Danger => "ALARM",
        Severity::Alert => "ALERT",
    }
}

/// Beyond what a limit of a side is exceeded.
pub(super) fn beyond(side: Side, limit: f32, unit: &str) -> String {
    let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
    match side {
        Side::Above => format!("above {limit}{unit}"),
        Side::Below => format!("below {limit}{unit}"),
        Side::Rise => format!("more than {limit}{unit} over its mean of {:.0} min", RISE_S / 60.0),
    }
}
