//! What stands above the numbers: names, units, and lines that state the rate.
//!
//! The row of names is the last one without numbers that has as many cells as the data, or the comment above them; a
//! row of units may follow. Lines above the names, and lines of another width, are free text, searched for a sampling
//! rate or interval and a unit. A line of the data's width that begins with a number and is none is damage, never a
//! name.

use super::cells::{Cell, Separator, begins_like_a_number, is_header, read, split};
use crate::import::units;

/// Lines above the data that are looked at.
pub(super) const MOST_LINES: usize = 2_000;

/// What the head says.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Head {
    pub names: Option<Vec<String>>,
    pub units: Option<Vec<String>>,
    pub rate_hz: Option<f64>,
    /// Unit of all channels, where one line states it.
    pub unit: Option<String>,
    pub remarks: Vec<String>,
}

/// A line above the data.
pub(super) struct Line<'a> {
    pub number: usize,
    pub text: &'a str,
    pub comment: bool,
}

/// Whether all cells are numbers, dates or missing, and one is a number.
pub(super) fn is_data<S: AsRef<str>>(cells: &[S]) -> bool {
    let mut numbers = 0;
    for cell in cells {
        match read(cell.as_ref()) {
            Some(Cell::Number(_)) => numbers += 1,
            Some(Cell::Stamp(..) | Cell::Missing) => {}
            None => return false,
        }
    }
    numbers > 0
}

/// Reads the head of data of `width` columns; an error is a line's number and its cell that is no number.
pub(super) fn of(lines: &[Line], separator: Separator, width: usize) -> Result<Head, (usize, String)> {
    let mut head = Head::default();
    let cells: Vec<Vec<String>> = lines.iter().map(|line| trimmed(&split(line.text, separator), width)).collect();
    let wide =
        |i: &usize| cells[*i].len() == width && is_header(&cells[*i]) && cells[*i].iter().any(|cell| !cell.is_empty());
    let last_comment = lines.iter().rposition(|line| line.comment).filter(|i| i + 1 == lines.len());
    let mut named: Vec<usize> =
        (0..lines.len()).filter(|i| (!lines[*i].comment || Some(*i) == last_comment) && wide(i)).collect();
    // One word in a column of its own is a name; a sentence above one column is a remark.
    if width == 1 {
        named.retain(|&i| !lines[i].text.contains([':', '=']) || units::of_name(lines[i].text).is_some());
    }
    if let Some(last) = named.pop() {
        let before = named.pop().filter(|before| is_units(&cells[last]) && !is_units(&cells[*before]));
        let names = before.unwrap_or(last);
        if before.is_some() {
            head.units = Some(cells[last].clone());
        }
        head.names = Some(cells[names].clone());
        head.search(&lines[..names]);
        for (line, cells) in lines[..names].iter().zip(&cells).filter(|(line, _)| !line.comment) {
            if cells.len() != width || !is_data(cells) {
                continue;
            }
            // A row of numbers above the names is a rate, or no head at all.
            match equal(cells) {
                Some(rate) => {
                    head.remarks
                        .push(format!("line {} above the names states the sampling rate, {rate} Hz", line.number));
                    head.rate_hz = head.rate_hz.or(Some(rate));
                }
                None => return Err((lines[names].number, damaged(&head.names.unwrap_or_default()))),
            }
        }
        let between = lines[names + 1..].iter().zip(&cells[names + 1..]);
        for (line, cells) in between.filter(|(line, _)| !line.comment) {
            if cells.len() == width && width > 1 && cells.iter().any(|cell| begins_like_a_number(cell)) {
                return Err((line.number, damaged(cells)));
            }
        }
        return Ok(head);
    }
    for (line, cells) in lines.iter().zip(&cells).filter(|(line, _)| !line.comment) {
        let first = cells.first().map_or("", String::as_str);
        if cells.len() == width
            && cells.iter().any(|cell| begins_like_a_number(cell))
            && (width > 1 || begins_like_a_number(first))
        {
            return Err((line.number, damaged(cells)));
        }
    }
    head.search(lines);
    Ok(head)
}

/// The whole number of at least a hundred that all cells are.
fn equal(cells: &[String]) -> Option<f64> {
    let first: f64 = cells.first()?.parse().ok()?;
    let all = cells.iter().all(|cell| cell.parse() == Ok(first));
    (all && first.fract() == 0.0 && first >= 100.0).then_some(first)
}

/// The first cell that is no number.
fn damaged(cells: &[String]) -> String {
    cells.iter().find(|cell| read(cell).is_none()).cloned().unwrap_or_default()
}

/// Cells without empty ones beyond the width: a closing separator is no column.
pub(super) fn trimmed(cells: &[&str], width: usize) -> Vec<String> {
    let mut cells: Vec<String> = cells.iter().map(|cell| (*cell).to_owned()).collect();
    while cells.len() > width && cells.last().is_some_and(String::is_empty) {
        cells.pop();
    }
    cells
}

/// A row of units: at least half of what stands there is one, and nothing is long.
fn is_units(cells: &[String]) -> bool {
    let stated: Vec<&String> = cells.iter().filter(|cell| !cell.is_empty()).collect();
    let are = stated.iter().filter(|cell| units::measure(cell).is_some() || units::is_empty(cell)).count();
    !stated.is_empty() && 2 * are >= stated.len()
}

impl Head {
    /// Looks for a rate, an interval and a unit in free text.
    fn search(&mut self, lines: &[Line]) {
        for line in lines {
            let lower = line.text.to_lowercase().replace(['_', '-'], " ");
            let place = format!("line {}", line.number);
            if let Some(value) = rate(&lower) {
                self.remarks.push(format!("{place} states the sampling rate, {value} Hz"));
                self.rate_hz = self.rate_hz.or(Some(value));
            } else if let Some(value) = interval(&lower) {
                self.remarks.push(format!("{place} states the sampling interval, {value} s"));
                self.rate_hz = self.rate_hz.or(Some(1.0 / value));
            } else if let Some(unit) = unit(line.text) {
                self.remarks.push(format!("{place} states the unit, {unit}"));
                self.unit = self.unit.take().or(Some(unit));
            }
        }
    }
}

/// Text behind the first of `keys` that stands at the beginning of a word.
fn behind<'a>(lower: &'a str, keys: &[&str]) -> Option<&'a str> {
    keys.iter().find_map(|key| {
        let at = lower.find(key)?;
        let word = lower[..at].chars().next_back().is_none_or(|c| !c.is_alphanumeric());
        let rest = &lower[at + key.len()..];
        (word && !rest.starts_with(|c: char| c.is_alphanumeric())).then_some(rest)
    })
}

/// The first number of a text, and what follows it.
fn number(text: &str) -> Option<(f64, &str)> {
    let at = text.find(|c: char| c.is_ascii_digit())?;
    let from = if text[..at].ends_with('.') { at - 1 } else { at };
    let rest = &text[from..];
    let end =
        rest.find(|c: char| !(c.is_ascii_digit() || ['.', ',', 'e', '-', '+'].contains(&c))).unwrap_or(rest.len());
    let digits = rest[..end].trim_end_matches(['.', ',', '-', '+', 'e']);
    let value = digits.parse().ok().or_else(|| {
        // One comma is a decimal comma where three digits do not follow it, else it groups thousands.
        let (whole, part) = digits.split_once(',')?;
        if part.len() == 3 { format!("{whole}{part}").parse().ok() } else { format!("{whole}.{part}").parse().ok() }
    })?;
    Some((value, rest[digits.len()..].trim_start()))
}

fn rate(lower: &str) -> Option<f64> {
    const KEYS: [&str; 13] = [
        "sampling rate",
        "sample rate",
        "samplerate",
        "samplingrate",
        "sampling frequency",
        "sample frequency",
        "samplefrequency",
        "sampling freq",
        "sample freq",
        "scan rate",
        "acquisition rate",
        "abtastrate",
        "fs",
    ];
    let (value, unit) = number(behind(lower, &KEYS)?)?;
    let before = behind(lower, &KEYS)?;
    let factor = if unit.starts_with("khz") || before.contains("khz") || unit.starts_with("ks/s") {
        1e3
    } else if unit.starts_with("mhz") {
        1e6
    } else {
        1.0
    };
    Some(value * factor).filter(|rate| rate.is_finite() && *rate >= 1.0)
}

fn interval(lower: &str) -> Option<f64> {
    const KEYS: [&str; 10] = [
        "sample interval",
        "sampling interval",
        "sample period",
        "sampling period",
        "time increment",
        "time step",
        "timestep",
        "delta t",
        "delta x",
        "dt",
    ];
    let rest = behind(lower, &KEYS)?;
    let (value, unit) = number(rest)?;
    let unit: String = unit.chars().take_while(|c| c.is_alphabetic() || *c == '\u{b5}').collect();
    // A unit in brackets stands before the number.
    let inner = rest.split_once(['(', '[']).and_then(|(_, inner)| inner.split_once([')', ']'])).map(|(unit, _)| unit);
    let of =
        |text: &str| units::measure(text).filter(|unit| unit.quantity == units::Quantity::Time).map(|unit| unit.factor);
    let factor = of(&unit).or_else(|| inner.and_then(of)).unwrap_or(1.0);
    Some(value * factor).filter(|interval| *interval > 0.0 && *interval <= 1.0)
}

fn unit(line: &str) -> Option<String> {
    let line = line.trim_start_matches(['#', '%', '/', ' ', '"']);
    let (key, value) = line.split_once([':', '=', ',', ';', '\t'])?;
    let key = key.trim().to_lowercase();
    let value = value.trim().trim_matches(['"', ',', ';', '\t', ' ']);
    let named = ["unit", "units", "y unit", "yunit", "y_unit", "acceleration unit", "signal unit", "einheit"]
        .contains(&key.as_str());
    (named && units::measure(value).is_some()).then(|| value.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_rates_are_told_in_free_text() {
        assert_eq!(rate("# sampling rate: 12800 hz"), Some(12_800.0));
        assert_eq!(rate("fs = 25.6 khz"), Some(25_600.0));
        assert_eq!(rate("sample rate (hz),51200"), Some(51_200.0));
        assert_eq!(rate("sampling frequency;12,8;khz"), Some(12_800.0));
        assert_eq!(rate("offset 12"), None);
        assert_eq!(interval("delta x,7.8125e-05"), Some(7.8125e-5));
        assert_eq!(interval("sample interval: 0.1 ms"), Some(1e-4));
        assert_eq!(unit("# Unit: g"), Some("g".into()));
    }
}
