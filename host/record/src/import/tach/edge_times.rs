//! Edge times of a tachometer as owners have them: one ascending column of any name, in s, ms, us, ns or samples.
//!
//! The unit is that of the name where it has one; otherwise the one in which the edges fill the run, which must be
//! the only one. Text may have a header or none; arrays and variables of NumPy, MATLAB and HDF5 files are read by
//! their own readers.

use crate::budget::{self, EDGES};
use crate::{Error, Result, text};
use std::path::Path;

/// Share of the run that edges of the right unit span.
const FILLS: std::ops::RangeInclusive<f64> = 0.3..=1.05;
/// Names of units in the last part of a column's name, and their length, s; 0 stands for a sample.
const NAMED_UNITS: [(&str, f64); 14] = [
    ("ms", 1e-3),
    ("msec", 1e-3),
    ("us", 1e-6),
    ("usec", 1e-6),
    ("\u{b5}s", 1e-6),
    ("ns", 1e-9),
    ("sec", 1.0),
    ("seconds", 1.0),
    ("s", 1.0),
    ("samples", 0.0),
    ("sample", 0.0),
    ("index", 0.0),
    ("idx", 0.0),
    ("min", 60.0),
];
/// Units that are tried where the name has none, s; a sample comes with the rate.
const TRIAL_UNITS: [(&str, f64); 4] = [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)];

/// How long a run lasts, and where its file says that it begins.
pub(super) struct Lasts {
    pub length_s: f64,
    pub start_s: Option<f64>,
}

impl Lasts {
    /// Edges from the run's first sample on; those that count from the file's own zero are moved.
    ///
    /// # Errors
    /// Edges that lie elsewhere.
    pub(super) fn placed(&self, place: &str, mut edges_s: Vec<f64>) -> Result<Vec<f64>> {
        let (first, last) = (edges_s[0], edges_s[edges_s.len() - 1]);
        let within = |start_s: f64| first - start_s >= -self.length_s && last - start_s <= 2.0 * self.length_s;
        if within(0.0) {
            return Ok(edges_s);
        }
        if let Some(start_s) = self.start_s.filter(|start_s| within(*start_s)) {
            edges_s.iter_mut().for_each(|edge| *edge -= start_s);
            return Ok(edges_s);
        }
        let what = format!(
            "edges from {first} s to {last} s do not belong to a run of {} s that begins at {} s; count both from the \
             same zero",
            self.length_s,
            self.start_s.unwrap_or(0.0)
        );
        Err(Error::invalid(place, what))
    }
}

/// A column of numbers and its name.
pub(super) struct Column {
    pub name: String,
    pub values: Vec<f64>,
}

/// One column of numbers with a header or none; `None` where the text is anything else.
pub(super) fn of_text(path: &Path) -> Result<Option<Column>> {
    let Ok(content) = budget::read_text(path) else { return Ok(None) };
    let (mut name, mut values) = (String::new(), Vec::new());
    let cell = |line: &str| line.trim().trim_end_matches([',', ';']).trim_matches('"').trim().to_string();
    for line in content.trim_start_matches('\u{feff}').lines().map(cell).filter(|line| !line.is_empty()) {
        // A comma among digits alone is a decimal one.
        let number = line.parse().ok().or_else(|| line.replacen(',', ".", 1).parse::<f64>().ok());
        match number {
            Some(value) => values.push(value),
            None if values.is_empty() && !line.contains([',', ';', '\t']) => name = line,
            None => return Ok(None),
        }
        if EDGES.check(path.display(), values.len() as f64, "cut the run into parts").is_err() {
            return Ok(None);
        }
    }
    Ok((values.len() > 1).then_some(Column { name, values }))
}

impl Column {
    /// Whether the values can be edge times: they ascend.
    pub(super) fn ascends(&self) -> bool {
        self.values.windows(2).all(|w| w[1] > w[0]) && self.values.iter().all(|x| x.is_finite())
    }

    /// Seconds from the run's first sample, and the unit for people.
    ///
    /// # Errors
    /// No unit in which the edges belong to the run, or more than one.
    pub(super) fn seconds(&self, place: &str, run: &Lasts, rate_hz: f64) -> Result<(Vec<f64>, String)> {
        let length_s = run.length_s;
        let span = self.values[self.values.len() - 1] - self.values[0];
        let of_unit = |unit_s: f64| if unit_s == 0.0 { 1.0 / rate_hz } else { unit_s };
        let fills = |unit_s: &f64| FILLS.contains(&(span * unit_s / length_s));
        let (unit_s, unit) = match self.named_unit() {
            Some((name, unit_s)) => (of_unit(unit_s), name),
            None => {
                let tried = TRIAL_UNITS.iter().map(|(name, s)| (*s, *name)).chain([(1.0 / rate_hz, "samples")]);
                let mut fits: Vec<(f64, &str)> = tried.filter(|(s, _)| fills(s)).collect();
                fits.dedup_by(|a, b| (a.0 / b.0 - 1.0).abs() < 1e-9);
                match fits.as_slice() {
                    [(unit_s, name)] => (*unit_s, (*name).to_string()),
                    _ => return Err(self.no_unit(place, length_s)),
                }
            }
        };
        let seconds: Vec<f64> = self.values.iter().map(|x| unit_s * x).collect();
        Ok((run.placed(place, seconds)?, unit))
    }

    fn named_unit(&self) -> Option<(String, f64)> {
        let mut words = self.name.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty());
        let last = words.next_back()?.to_lowercase();
        NAMED_UNITS.iter().find(|(name, _)| *name == last).map(|(name, unit_s)| ((*name).to_string(), *unit_s))
    }

    fn no_unit(&self, place: &str, length_s: f64) -> Error {
        let (first, last) = (self.values[0], self.values[self.values.len() - 1]);
        let what = format!(
            "edge times from {first} to {last} fill a run of {length_s:.3} s neither in s, ms, us, ns nor in \
              samples; name the column by its unit (edge_time_s, edge_ms, edge_samples), in ticks divide by the \
              counter's frequency"
        );
        Error::invalid(place, what)
    }

    /// Standard deviation of what the steps of the written numbers add to an edge, in their unit.
    pub(super) fn rounding(&self) -> f64 {
        let on_grid = |step: f64| self.values.iter().all(|x| (x / step - (x / step).round()).abs() < 1e-4);
        let steps = (0..=9).map(|digits| 10.0_f64.powi(-digits));
        steps.into_iter().find(|step| on_grid(*step)).map_or(0.0, |step| step / 12.0_f64.sqrt())
    }
}

/// Words for a source whose numbers are no edges and no signal.
pub(super) fn wanted(name: &str) -> String {
    format!(
        "{} is neither as long as the run nor ascending: edge times are one ascending column (csv with the header \
          edge_time_s, or named by its unit)",
        text::quoted(name)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn column(name: &str, scale: f64) -> Column {
        Column { name: name.into(), values: (1..99).map(|k| scale * 0.04 * f64::from(k)).collect() }
    }

    #[test]
    fn theory_units_come_from_the_name_or_fill_the_run() {
        let run = Lasts { length_s: 4.0, start_s: None };
        for (name, scale, unit) in [
            ("time", 1.0, "s"),
            ("", 1e3, "ms"),
            ("tacho", 1e6, "us"),
            ("t (ms)", 1e3, "ms"),
            ("edge_us", 1e6, "us"),
            ("x", 12_800.0, "samples"),
            ("edge_samples", 12_800.0, "samples"),
        ] {
            let (seconds, found) = column(name, scale).seconds("here", &run, 12_800.0).expect("a unit");
            assert_eq!(found, unit, "{name}");
            assert!((seconds[24] - 1.0).abs() < 1e-9, "{name}");
        }
        let refused = column("x", 84e6).seconds("here", &run, 12_800.0).expect_err("no unit").to_string();
        assert!(refused.contains("ticks divide"), "{refused}");
        let later = Lasts { length_s: 4.0, start_s: Some(100.0) };
        assert_eq!(later.placed("here", vec![100.5, 101.0]).expect("moved"), [0.5, 1.0]);
        assert!((column("x", 1e3).rounding() - 1.0 / 12.0_f64.sqrt()).abs() < 1e-9);
    }
}
