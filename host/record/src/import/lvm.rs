//! LabVIEW measurement files (`.lvm`): segments of tab- or comma-separated text with a head that states rate, start
//! and unit per channel.
//!
//! Source: National Instruments, "Specification for the LabVIEW Measurement File". Read: one segment or several that
//! go on with the same channels, no, one or several time columns, decimal points and commas. Where a head states the
//! interval the time columns are left out unread.

use super::delimited::{Cell, Separator, read_cell, split_cells};
use super::signals::{Signal, Signals};
use crate::budget::VALUES;
use crate::{Error, Result, text};
use std::collections::BTreeMap;
use std::path::Path;

const END: &str = "***End_of_Header***";

/// Whether text is a LabVIEW measurement file, whatever it is called.
pub(super) fn looks_like(content: &str) -> bool {
    content.trim_start().starts_with("LabVIEW Measurement")
}

/// Keys of a head with their values, one per channel.
type Head = BTreeMap<String, Vec<String>>;

pub(super) fn read(path: &Path, content: &str) -> Result<Signals> {
    let refuse = |line: usize, what: String| Error::invalid(format!("{}:{line}", path.display()), what);
    let separator = if content.lines().take(50).any(|line| line.starts_with("Separator") && line.contains("Comma")) {
        b','
    } else {
        b'\t'
    };
    let mut lines = content.lines().enumerate().map(|(i, line)| (i + 1, line));
    let file = head(&mut lines, separator).ok_or_else(|| refuse(1, format!("is a LabVIEW file without {END}")))?;
    let x_columns = file.get("X_Columns").and_then(|values| values.first()).map_or("One", String::as_str).to_owned();
    let mut found = Signals::default();
    let (mut segments, mut values) = (0, 0);
    let mut pending: Option<(usize, &str)> = None;
    // Blank lines may stand before a segment's head.
    while let Some((number, first)) = pending.take().or_else(|| lines.find(|(_, line)| !line.trim().is_empty())) {
        let Some(own) = head(&mut [(number, first)].into_iter().chain(lines.by_ref()), separator) else {
            return Err(refuse(number, "is a LabVIEW file whose segment has no head".into()));
        };
        segments += 1;
        let (number, names) = lines.next().ok_or_else(|| refuse(number, "is truncated before its names".into()))?;
        let mut segment = Segment::new(&own, &split_cells(names, Separator::Sign(separator)), &x_columns)
            .map_err(|what| refuse(number, what))?;
        for (number, line) in lines.by_ref() {
            if line.trim().is_empty() {
                continue;
            }
            let cells = split_cells(line, Separator::Sign(separator));
            if !cells[0].is_empty() && read_cell(cells[0]).is_none() {
                pending = Some((number, line));
                break;
            }
            segment.row(&cells).map_err(|what| refuse(number, what))?;
            values += segment.columns.len();
            if number.is_multiple_of(4096) {
                VALUES.check(path.display(), values as f64, "cut the file into parts")?;
            }
        }
        segment.join(&mut found).map_err(|what| refuse(number, what))?;
    }
    if found.signals.is_empty() {
        return Err(Error::invalid(path.display(), "is a LabVIEW file without a segment"));
    }
    if segments > 1 {
        found.remarks.push(format!("{segments} segments are read one behind the other"));
    }
    Ok(found)
}

/// The keys up to the end of a head.
fn head<'a>(lines: &mut impl Iterator<Item = (usize, &'a str)>, separator: u8) -> Option<Head> {
    let mut keys = Head::new();
    for (_, line) in lines {
        if line.trim_start().starts_with(END) {
            return Some(keys);
        }
        let cells = split_cells(line, Separator::Sign(separator));
        let (key, values) = cells.split_first()?;
        keys.insert((*key).to_owned(), values.iter().map(|value| (*value).to_owned()).collect());
    }
    None
}

/// One segment: where every channel's column is, and what its head says.
struct Segment {
    /// Column in the file, name, unit, interval and start of every channel.
    columns: Vec<(usize, Signal)>,
}

impl Segment {
    fn new(head: &Head, names: &[&str], x_columns: &str) -> std::result::Result<Self, String> {
        let stated = head.get("Channels").and_then(|values| values.first()?.parse::<usize>().ok());
        let count =
            stated.unwrap_or_else(|| names.iter().filter(|name| !["X_Value", "Comment", ""].contains(name)).count());
        if count == 0 || count > names.len() {
            return Err(format!("names {} columns for {count} channels", names.len()));
        }
        // Without a time column its place is kept, empty.
        let multi = x_columns.eq_ignore_ascii_case("multi");
        let place = |c: usize| if multi { 2 * c + 1 } else { c + 1 };
        // Between several time columns the head's values stand as far apart as the channels.
        let beyond =
            |key: &&str| head.get(*key).is_some_and(|values| values.iter().skip(count).any(|value| !value.is_empty()));
        let apart = multi && ["Samples", "Y_Unit_Label", "X_Dimension", "X0", "Delta_X"].iter().any(beyond);
        let value = |key: &str, c: usize| {
            let at = if apart { place(c) - 1 } else { c };
            head.get(key).and_then(|values| values.get(at)).filter(|value| !value.is_empty())
        };
        let mut columns = Vec::new();
        for c in 0..count {
            let name = names.get(place(c)).copied().unwrap_or_default();
            let mut signal =
                Signal::new(if name.is_empty() { format!("channel {c}") } else { name.to_owned() }, Vec::new());
            signal.unit = value("Y_Unit_Label", c).cloned();
            let number = |key: &str| match value(key, c).and_then(|cell| read_cell(cell)) {
                Some(Cell::Number(number)) => Some(number),
                _ => None,
            };
            let time = value("X_Dimension", c).is_none_or(|dimension| dimension.eq_ignore_ascii_case("time"));
            if !time {
                return Err(format!("channel {} is no signal over time", text::quoted(name)));
            }
            if let Some(step) = number("Delta_X") {
                if !(step.is_finite() && step > 0.0) {
                    return Err(format!("Delta_X {step} gives no sampling rate"));
                }
                signal.rate_hz = Some(super::stamps::rate_hz(step, 1e-6));
                signal.start_s = Some(number("X0").unwrap_or(0.0));
            }
            columns.push((place(c), signal));
        }
        Ok(Self { columns })
    }

    fn row(&mut self, cells: &[&str]) -> std::result::Result<(), String> {
        for (place, signal) in &mut self.columns {
            match cells.get(*place).map(|cell| (read_cell(cell), *cell)) {
                Some((Some(Cell::Number(number)), _)) => signal.values.push(number),
                // A channel may end before the others.
                None | Some((Some(Cell::Missing), _)) => {}
                Some((_, cell)) => return Err(format!("{} is no number", text::quoted(cell))),
            }
        }
        Ok(())
    }

    /// Appends the segment to what was read.
    fn join(self, found: &mut Signals) -> std::result::Result<(), String> {
        if found.signals.is_empty() {
            found.signals = self.columns.into_iter().map(|(_, signal)| signal).collect();
            return Ok(());
        }
        if found.signals.len() != self.columns.len() {
            return Err(format!("a segment has {} channels, the first {}", self.columns.len(), found.signals.len()));
        }
        for (signal, (_, own)) in found.signals.iter_mut().zip(self.columns) {
            if own.rate_hz != signal.rate_hz || own.name != signal.name {
                return Err("a segment has other channels or another rate than the first".into());
            }
            if let (Some(rate), Some(start), Some(own_start)) = (signal.rate_hz, signal.start_s, own.start_s) {
                let expected = start + signal.values.len() as f64 / rate;
                if own_start != start && (own_start - expected).abs() > 0.5 / rate {
                    return Err(format!(
                        "a segment begins at {own_start} s, the one before ends at {expected} s; import them one by one"
                    ));
                }
            }
            signal.values.extend(own.values);
        }
        Ok(())
    }
}
