//! The first lines of a report, as one would write them to a colleague: what was measured, what was found and how sure,
//! what to do next.

use super::facts::Facts;

/// A measurement as a letter names it.
#[derive(Debug, Clone, Default)]
pub struct About {
    /// First sentence: machine, when and how measured.
    pub how: String,
    /// Mean pinion speed of the first run, Hz: what orders are turned into frequencies with.
    pub speed_hz: Option<f64>,
    /// Teeth of the pinion, where declared.
    pub pinion_teeth: Option<u32>,
    /// What orders are multiples of: "pinion", a train's "input", or "shaft" of a machine without gears.
    pub turns_of: Option<&'static str>,
    /// For the page's foot.
    pub facts: Facts,
}

impl About {
    /// What orders are multiples of; the pinion where nothing else is said.
    pub fn of(&self) -> &'static str {
        self.turns_of.unwrap_or("pinion")
    }

    /// Frequency of an order at this speed.
    pub fn hz(&self, order: f64) -> Option<f64> {
        Some(order * self.speed_hz?)
    }
}

/// Several things in one clause: "a", "a and b", "a, b and c".
pub fn list(things: &[String]) -> String {
    match things {
        [] => String::new(),
        [only] => only.clone(),
        [rest @ .., last] => format!("{} and {last}", rest.join(", ")),
    }
}

/// A chance in words that need no powers of ten.
pub fn odds(chance: f64) -> String {
    match chance {
        p if p < 1e-6 => "less than one in a million".into(),
        p if p < 0.5 => format!("about one in {:.0}", round_two(1.0 / p)),
        p => format!("{:.0} %", 100.0 * p),
    }
}

fn round_two(x: f64) -> f64 {
    let step = 10f64.powf(x.log10().floor() - 1.0).max(1.0);
    (x / step).round() * step
}

/// A frequency with as many digits as a line has, and its unit.
pub fn hertz(hz: f64) -> String {
    format!("{hz:.1} Hz")
}

#[cfg(test)]
mod tests {
    use super::{list, odds};

    #[test]
    fn ref_clauses_and_odds_read_as_sentences() {
        assert_eq!(list(&["a".into(), "b".into(), "c".into()]), "a, b and c");
        assert_eq!(odds(1e-30), "less than one in a million");
        assert_eq!(odds(0.004), "about one in 250");
        assert_eq!(odds(3.3e-4), "about one in 3000");
    }
}
