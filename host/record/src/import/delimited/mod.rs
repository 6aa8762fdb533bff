//! Delimited text: semicolons, tabs, commas, bars, blanks or one column; with or without names, units and lines above
//! the numbers.
//!
//! The separator is the one that makes numbers of a line far enough down that it is data. A first row with more cells
//! than the others (as some exporters write scale values into it) loses the extra cells; any other ragged row is an
//! error. Dates become seconds. Missing values are kept as such: a column that has them is refused when it is wanted,
//! with the place. A first row of equal whole numbers far above all others is a sampling rate, as wearables write it. A
//! first row `0,1,2` above numbers with decimals counts the columns, as pandas writes those without names.

mod cells;
mod clock;
mod commas;
mod dates;
mod encoding;
mod first_rows;
mod head;

pub(super) use cells::{Cell, Separator, read as read_cell, split as split_cells};
pub(super) use encoding::decode;

use super::Reading;
use super::signals::{Signal, Signals};
use crate::budget::VALUES;
use crate::{Error, Result, text};
use cells::is_header;
use commas::{Commas, commas};
use std::collections::BTreeMap;
use std::path::Path;

/// Lines in which the data are looked for.
const PROBED_LINES: usize = 300;
/// Rows between two looks at the budget.
const ROWS_PER_CHECK: usize = 4096;
/// Most columns of a table without names that are channels; more are samples of channels in rows.
const MAX_CHANNEL_COLUMNS: usize = 64;
/// Rows of numbers that may stand above the names.
const ABOVE_NAMES: usize = 2;
/// Nanoseconds per second, and of half a day.
const NS: f64 = 1e9;
const HALF_DAY_NS: i64 = 43_200_000_000_000;

/// Whether bytes begin as a line of text does, whatever the file is called.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    let start = &bytes[..bytes.len().min(4096)];
    let control = start.iter().any(|b| *b < 0x20 && !matches!(b, b'\t' | b'\n' | b'\r' | 0x0c | 0x1a));
    let text = String::from_utf8_lossy(start);
    !control
        && text.lines().take(50).any(|line| line.trim_start().starts_with(|c: char| c.is_ascii_digit() || c == '-'))
}

pub(super) fn read(path: &Path, content: &str, stem: &str, reading: &Reading) -> Result<Signals> {
    let renamed = counted(content);
    let content = renamed.as_deref().unwrap_or(content);
    let separator = separator(content);
    let mut joined = false;
    if separator == Separator::Sign(b',') {
        joined = match (reading.decimal_comma, commas(content)) {
            (Some(decimal), _) => decimal,
            (None, Commas::Separate) => false,
            (None, Commas::Decimal) => true,
            (None, Commas::Unknown) => {
                let line = data_lines(content).last().unwrap_or_default();
                let what = format!(
                    "{} may be numbers with decimal commas or columns of whole numbers; say which with --decimal \
                     comma or --decimal point",
                    text::quoted(line)
                );
                return Err(Error::invalid(path.display(), what));
            }
        };
    }
    let (head, rows) = rows(path, content, separator, joined)?;
    let mut found = Signals { rate_hz: head.rate_hz, remarks: head.remarks, ..Signals::default() };
    found.remarks.extend(rows.remarks);
    if renamed.is_some() {
        found.remarks.push("the first line counts the columns from 0 and is taken for their names, column 0 on".into());
    }
    if joined {
        found.remarks.push("commas are taken for decimal commas".into());
    }
    let mut columns = rows.columns;
    let samples = columns.first().map_or(0, |column| column.values.len());
    if head.names.is_none() && columns.len() > MAX_CHANNEL_COLUMNS && columns.len() > samples {
        found.remarks.push(format!("{samples} rows of {} numbers are taken for channels x samples", columns.len()));
        columns = turned(&columns, samples);
    }
    let width = columns.len();
    for (c, column) in columns.into_iter().enumerate() {
        let name = head.names.as_ref().and_then(|names| names.get(c));
        let values = column.values;
        let mut signal = match name {
            Some(name) => Signal::new(name.clone(), values),
            None if width == 1 => Signal::unnamed(stem, values),
            None => Signal::unnamed(format!("{stem} {c}"), values),
        };
        signal.unit = head.units.as_ref().and_then(|units| units.get(c)).cloned();
        if column.stamps {
            signal.unit = Some("s".into());
        }
        found.signals.push(signal);
    }
    clock::take(&mut found);
    first_rows::take(path, &mut found, reading)?;
    missing(&mut found);
    if let Some(unit) = head.unit {
        found
            .signals
            .iter_mut()
            .filter(|signal| signal.unit.is_none())
            .for_each(|signal| signal.unit = Some(unit.clone()));
    }
    Ok(found)
}

/// Rows as columns.
fn turned(columns: &[Column], samples: usize) -> Vec<Column> {
    let row =
        |i: usize| Column { values: columns.iter().map(|column| column.values[i]).collect(), ..Column::default() };
    (0..samples).map(row).collect()
}

/// The text with names in its first line where that counts the columns from 0, as pandas writes columns without names,
/// with or without an empty cell above the index; `None` for any other text.
fn counted(content: &str) -> Option<String> {
    let mut lines = content.lines();
    let first = lines.next()?;
    let sign = [b';', b'\t', b',', b'|'].into_iter().find(|sign| first.as_bytes().contains(sign))?;
    let cells = split_cells(first, Separator::Sign(sign));
    let index = usize::from(cells[0].is_empty());
    let count = cells.len() - index;
    if count < 2 || !cells[index..].iter().enumerate().all(|(i, cell)| *cell == i.to_string()) {
        return None;
    }
    let rows: Vec<Vec<&str>> = lines.take(3).map(|line| split_cells(line, Separator::Sign(sign))).collect();
    // Between commas a point is wanted: `0,1` above `1,25e-3` are numbers with decimal commas.
    let signs: &[char] = if sign == b',' { &['.'] } else { &['.', ',', 'e', 'E'] };
    let broken = |cell: &&str| read_cell(cell).is_some() && cell.contains(signs);
    if rows.first().is_none_or(|row| row.len() != cells.len() || !row.iter().any(broken)) {
        return None;
    }
    // Time that goes on evenly from the nought of this line: it is a row of data.
    let times: Vec<f64> = rows.iter().filter_map(|row| row.first()?.replace(',', ".").parse().ok()).collect();
    let even = |i: usize, time: &f64| (time / times[0] - (i + 1) as f64).abs() < 0.01;
    if index == 0 && times.len() == 3 && times[0] > 0.0 && times.iter().enumerate().all(|(i, time)| even(i, time)) {
        return None;
    }
    let names: Vec<String> = (0..count).map(|i| format!("column {i}")).collect();
    let sign = char::from(sign).to_string();
    let above_index = if index == 1 { sign.as_str() } else { "" };
    Some(format!("{above_index}{}{}", names.join(&sign), &content[first.len()..]))
}

/// Leaves out columns without a value, and draws together those that have one in every so many rows.
fn missing(found: &mut Signals) {
    let mut remarks = Vec::new();
    found.signals.retain_mut(|signal| {
        let there: Vec<usize> = signal.values.iter().enumerate().filter(|(_, x)| !x.is_nan()).map(|(i, _)| i).collect();
        if there.is_empty() {
            remarks.push(format!("column {} holds no value and is left out", text::quoted(&signal.name)));
            return false;
        }
        let every = there.windows(2).map(|w| w[1] - w[0]).next().unwrap_or(1);
        if every > 1 && there.len() > 2 && there.windows(2).all(|w| w[1] - w[0] == every) {
            remarks.push(format!("column {} has a value in every {every}th row", text::quoted(&signal.name)));
            signal.values = there.iter().map(|&i| signal.values[i]).collect();
        }
        true
    });
    found.remarks.extend(remarks);
}

/// One column of numbers.
#[derive(Default)]
struct Column {
    values: Vec<f64>,
    /// Whether they were dates or times of day.
    stamps: bool,
    first_ns: Option<i64>,
    last_ns: i64,
}

impl Column {
    fn push(&mut self, cell: Cell) {
        let value = match cell {
            Cell::Number(value) => value,
            Cell::Missing => f64::NAN,
            Cell::Stamp(mut ns, _) => {
                self.stamps = true;
                // A time of day goes on after midnight.
                while self.first_ns.is_some() && ns.saturating_add(HALF_DAY_NS) < self.last_ns {
                    ns = ns.saturating_add(2 * HALF_DAY_NS);
                }
                self.last_ns = ns;
                ns.saturating_sub(*self.first_ns.get_or_insert(ns)) as f64 / NS
            }
        };
        self.values.push(value);
    }
}

/// Rows of numbers, column by column.
#[derive(Default)]
struct Rows {
    columns: Vec<Column>,
    remarks: Vec<String>,
}

fn rows(path: &Path, content: &str, separator: Separator, joined: bool) -> Result<(head::Head, Rows)> {
    let refuse = |line: usize, what: String| Error::invalid(format!("{}:{line}", path.display()), what);
    let width = width(content, separator, joined);
    let mut lines = content.lines().enumerate().map(|(i, line)| (i + 1, line));
    let above = begin(content, separator, joined, width);
    let mut head_lines = Vec::new();
    let mut head: Option<head::Head> = None;
    let mut rows = Rows::default();
    let mut count = 0;
    for (number, line) in lines.by_ref() {
        if line.trim().is_empty() {
            continue;
        }
        if head.is_none() && number <= above {
            let comment = is_comment(line);
            // One blank belongs to the mark; a tab behind it separates a first name that is empty.
            let text = if comment { line.trim_start().trim_start_matches(['#', '%', '/']) } else { line };
            let text = if comment { text.strip_prefix(' ').unwrap_or(text) } else { text };
            head_lines.push(head::Line { number, text, comment });
            continue;
        }
        if is_comment(line) {
            continue;
        }
        if head.is_none() {
            // No line so far was data: the one behind them says least.
            if above >= head::MOST_LINES && !head::is_data(&cells_of(line, separator, joined)) {
                let what = "holds no table of numbers in its first lines";
                let said = no_table(&head_lines, separator, joined).unwrap_or_else(|| (number, what.into()));
                return Err(refuse(said.0, said.1));
            }
            let made = head_of(&head_lines, separator, joined, width);
            head = Some(made.map_err(|(line, cell)| refuse(line, format!("{} is no number", text::quoted(&cell))))?);
        }
        let named = head.as_ref().is_some_and(|head| head.names.is_some());
        rows.row(line, separator, joined, count, named).map_err(|what| refuse(number, what))?;
        count += 1;
        if count.is_multiple_of(ROWS_PER_CHECK) {
            VALUES.check(path.display(), (count * rows.columns.len()) as f64, "cut the file into parts")?;
        }
    }
    if head.is_none()
        && let Some((line, what)) = no_table(&head_lines, separator, joined)
    {
        return Err(refuse(line, what));
    }
    Ok((head.unwrap_or_default(), rows))
}

/// Reads the head; with decimal commas its names stand once per part of a number, or once per number.
fn head_of(
    lines: &[head::Line],
    separator: Separator,
    joined: bool,
    width: usize,
) -> std::result::Result<head::Head, (usize, String)> {
    let made = head::of(lines, separator, if joined { 2 * width } else { width });
    let named = made.as_ref().is_ok_and(|head| head.names.is_some());
    if joined && !named { head::of(lines, separator, width) } else { made }
}

/// Place of the first line that begins like a number and is no data, or else of the first line, and what to say of it.
fn no_table(lines: &[head::Line], separator: Separator, joined: bool) -> Option<(usize, String)> {
    let damaged = |line: &head::Line| {
        let cells = cells_of(line.text, separator, joined);
        let begins = cells.first().is_some_and(|cell| cells::begins_like_a_number(cell));
        begins && cells.iter().any(|cell| read_cell(cell).is_none())
    };
    let own = || lines.iter().filter(|line| !line.comment);
    let line = own().find(|line| damaged(line)).or_else(|| own().next())?;
    let cells = cells_of(line.text, separator, joined);
    let bad = cells.into_iter().find(|cell| read_cell(cell).is_none()).unwrap_or_default();
    Some((line.number, format!("{} is no number, and no table of numbers follows", text::quoted(&bad))))
}

impl Rows {
    fn row(
        &mut self,
        line: &str,
        separator: Separator,
        joined: bool,
        count: usize,
        named: bool,
    ) -> std::result::Result<(), String> {
        if !joined
            && count > 1
            && let Separator::Sign(sign) = separator
            && self.plain(line.as_bytes(), sign)
        {
            return Ok(());
        }
        let mut cells = cells_of(line, separator, joined);
        let expected = if count == 0 { 0 } else { self.columns.len() };
        while cells.len() > expected && cells.last().is_some_and(String::is_empty) {
            cells.pop();
        }
        if count == 0 {
            self.columns.resize_with(cells.len(), Column::default);
        }
        let values: Vec<Cell> = cells
            .iter()
            .map(|cell| read_cell(cell).ok_or_else(|| format!("{} is no number", text::quoted(cell))))
            .collect::<std::result::Result<_, _>>()?;
        let (wide, narrow) = (self.columns.len(), values.len());
        if wide != narrow {
            if count != 1 || wide < narrow || named {
                return Err(format!("has {narrow} cells, the line before has {wide}"));
            }
            self.remarks
                .push(format!("the first row has {} more cells than the others; they are dropped", wide - narrow));
            self.columns.truncate(narrow);
        }
        self.columns.iter_mut().zip(values).for_each(|(column, cell)| column.push(cell));
        Ok(())
    }

    /// A line of plain numbers, as many as columns; anything else leaves the columns as they were.
    fn plain(&mut self, line: &[u8], sign: u8) -> bool {
        let before = self.columns.first().map_or(0, |column| column.values.len());
        let mut parts = line.split(|b| *b == sign);
        let mut whole = true;
        for column in &mut self.columns {
            let number = parts.next().and_then(|part| std::str::from_utf8(part.trim_ascii()).ok()?.parse::<f64>().ok());
            match number.filter(|number| number.is_finite() && !column.stamps) {
                Some(number) => column.values.push(number),
                None => {
                    whole = false;
                    break;
                }
            }
        }
        if whole && parts.next().is_none() {
            return true;
        }
        self.columns.iter_mut().for_each(|column| column.values.truncate(before));
        false
    }
}

/// The cells of a line; whole and decimal parts put together again where commas are decimal.
fn cells_of(line: &str, separator: Separator, joined: bool) -> Vec<String> {
    let cells = split_cells(line, separator);
    if !joined || is_header(&cells) {
        return cells.into_iter().map(str::to_owned).collect();
    }
    let mut cells = cells;
    while cells.last().is_some_and(|cell| cell.is_empty()) {
        cells.pop();
    }
    cells.chunks(2).map(|pair| pair.join(".")).collect()
}

fn is_comment(line: &str) -> bool {
    let line = line.trim_start();
    line.starts_with(['#', '%']) || line.starts_with("//")
}

fn data_lines(content: &str) -> impl Iterator<Item = &str> {
    content.lines().map(str::trim).filter(|line| !line.is_empty() && !is_comment(line))
}

/// Lines that are surely behind the head, nearest to the end of what is looked at first.
fn probes(content: &str) -> Vec<&str> {
    let mut lines: Vec<&str> = data_lines(content).take(PROBED_LINES).collect();
    lines.reverse();
    lines
}

fn separator(content: &str) -> Separator {
    const SIGNS: [u8; 4] = [b';', b'\t', b',', b'|'];
    for line in probes(content) {
        let several = |separator: Separator| {
            let cells = split_cells(line, separator);
            cells.len() > 1 && head::is_data(&cells)
        };
        let signs = SIGNS.into_iter().map(Separator::Sign);
        if let Some(found) = signs.chain([Separator::Blanks]).find(|separator| several(*separator)) {
            // A comma between two numbers that blanks separate is a decimal comma.
            return if found == Separator::Sign(b',') && line.contains(", ") { Separator::Sign(b',') } else { found };
        }
        if cells::read(line).is_some() {
            return Separator::Sign(b',');
        }
    }
    // No line of numbers: the first one that begins with one, or any, shows what was meant.
    let is_data = |line: &&str| cells::begins_like_a_number(line.trim_start_matches('"'));
    let line = data_lines(content).find(is_data).or_else(|| data_lines(content).next()).unwrap_or_default();
    let sign = SIGNS.into_iter().find(|&d| line.bytes().any(|b| b == d)).unwrap_or(b',');
    Separator::Sign(sign)
}

/// Cells of the data: those of most lines far down, and of two counts that are as frequent the larger.
fn width(content: &str, separator: Separator, joined: bool) -> usize {
    let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
    for line in probes(content) {
        let mut cells = cells_of(line, separator, joined);
        while cells.len() > 1 && cells.last().is_some_and(String::is_empty) {
            cells.pop();
        }
        if head::is_data(&cells) {
            *counts.entry(cells.len()).or_default() += 1;
        }
    }
    counts.into_iter().max_by_key(|(width, count)| (*count, *width)).map_or(1, |(width, _)| width)
}

/// Number of the last line above the data.
fn begin(content: &str, separator: Separator, joined: bool, width: usize) -> usize {
    let mut numbers = 0;
    let mut last = 0;
    let mut begun = None;
    for (i, line) in content.lines().enumerate().take(head::MOST_LINES) {
        if line.trim().is_empty() || is_comment(line) {
            if begun.is_none() {
                last = i + 1;
            }
            continue;
        }
        let cells = cells_of(line, separator, joined);
        if head::is_data(&cells) && cells.len() >= width {
            numbers += 1;
            begun.get_or_insert(last);
            if numbers > ABOVE_NAMES {
                break;
            }
        } else {
            // Names below a row or two of numbers: those are no data.
            let trimmed = head::trimmed(&split_cells(line, separator), width);
            let names = width > 1 && trimmed.len() == width && is_header(&trimmed);
            if begun.is_some() && !names {
                break;
            }
            begun = None;
            last = i + 1;
        }
    }
    begun.unwrap_or(last)
}
