//! Which of the machine's speeds have been seen, and how often: classes of equal ratio over the range.

use crate::law::domain::Domain;
use serde::Serialize;

/// Ratio of a class's ends, at most.
const RATIO: f64 = 1.2;
/// Most classes: one less than points in the node's table.
const MOST: usize = 11;

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
        let count = ((span.ln() / RATIO.ln()).ceil() as usize).clamp(2, MOST);
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

    /// Whether all are.
    pub fn is_complete(&self) -> bool {
        self.filled().count() == self.classes.len()
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
