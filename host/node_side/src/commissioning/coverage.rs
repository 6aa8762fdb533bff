//! Which of the machine's speeds have been seen, and how often: classes of equal ratio over the range.
//!
//! A machine of one speed has one class, which is filled by time: [`STRETCHES`] times as many values, so that load and
//! temperature have had some minutes to show. Its slow part is said by comparing so many stretches of that time
//! ([`super::baseline`]).

use crate::law::domain::Domain;
use serde::Serialize;

/// Ratio of a class's ends, at most.
const RATIO: f64 = 1.2;
/// Most classes: one less than points in the node's table.
const MAX_CLASSES: usize = 11;

/// Values of a machine of one speed, times those of a class.
pub const STRETCHES: usize = 5;

/// A class of speeds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SpeedClass {
    /// Slowest pinion speed, Hz.
    pub from_hz: f64,
    /// Fastest, Hz.
    pub to_hz: f64,
    /// Values of good quality at a locked speed.
    pub values: usize,
}

/// All classes of a range.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Coverage {
    /// Ascending.
    pub classes: Vec<SpeedClass>,
    /// Values that fill a class.
    pub wanted: usize,
}

impl Coverage {
    /// Classes over a range, each filled by so many values.
    pub fn new(range: Domain, wanted: usize) -> Self {
        let span = range.highest_hz / range.lowest_hz;
        let count = ((span.ln() / RATIO.ln()).ceil() as usize).clamp(1, MAX_CLASSES);
        let wanted = if count == 1 { STRETCHES * wanted } else { wanted };
        let edge = |n: usize| range.lowest_hz * span.powf(n as f64 / count as f64);
        let class = |n| SpeedClass { from_hz: edge(n), to_hz: edge(n + 1), values: 0 };
        Self { classes: (0..count).map(class).collect(), wanted }
    }

    /// Counts a value; true where it fills its class just now.
    pub fn take(&mut self, speed_hz: f64) -> bool {
        let wanted = self.wanted;
        let class = self.classes.iter_mut().find(|class| (class.from_hz..=class.to_hz).contains(&speed_hz));
        class.is_some_and(|class| {
            class.values += 1;
            class.values == wanted
        })
    }

    /// Classes that are filled.
    pub fn filled(&self) -> impl Iterator<Item = &SpeedClass> {
        self.classes.iter().filter(|class| class.values >= self.wanted)
    }

    /// Whether all are, or the machine has stayed at one speed for as long as a machine of one speed is listened to.
    pub fn is_complete(&self) -> bool {
        self.filled().count() == self.classes.len() || self.has_one_speed()
    }

    /// Whether one class alone has values, and enough for a machine of one speed.
    pub fn has_one_speed(&self) -> bool {
        let mut seen = self.classes.iter().filter(|class| class.values > 0);
        let (only, other) = (seen.next(), seen.next());
        let enough = if self.classes.len() == 1 { self.wanted } else { STRETCHES * self.wanted };
        other.is_none() && only.is_some_and(|class| class.values >= enough)
    }

    /// Slowest and fastest speed of the filled classes, Hz.
    pub fn covered_hz(&self) -> Option<[f64; 2]> {
        let slowest = self.filled().map(|class| class.from_hz).reduce(f64::min)?;
        Some([slowest, self.filled().map(|class| class.to_hz).reduce(f64::max)?])
    }

    /// What is still to come, in words.
    pub fn missing(&self) -> String {
        let open = self.classes.iter().filter(|class| class.values < self.wanted);
        let parts: Vec<String> = open
            .map(|class| format!("{:.2} to {:.2} Hz ({} of {})", class.from_hz, class.to_hz, class.values, self.wanted))
            .collect();
        parts.join(", ")
    }
}
