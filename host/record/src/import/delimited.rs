//! Delimited text: semicolons, tabs, commas or one column; with or without a header; with or without a time column.
//!
//! The separator is the one that the first data line has. A first row with more cells than the others (as
//! some exporters write scale values into it) loses the extra cells; any other ragged row is an error.
//!
//! A first row is a header only if none of its cells is, or begins like, a number: a damaged number is an error,
//! never a name. Numbers may have decimal commas. Where commas separate, too, `0,50` is one number or two, and the
//! two readings are told apart by what only one of them can be (`-0`, `05`, the header's count of names); else the
//! user has to say it.

use super::{Columns, Reading, time_axis};
use crate::budget::VALUES;
use crate::{Error, Result, text};
use std::path::Path;

/// What the commas of a comma-separated file are.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Commas {
    Separate,
    Decimal,
    Unknown,
}

/// Rows of numbers, column by column, with the header where there is one.
struct Rows {
    header: Option<Vec<String>>,
    channels: Vec<Vec<f64>>,
    remarks: Vec<String>,
}

pub(super) fn read(path: &Path, content: &str, stem: &str, reading: &Reading) -> Result<Columns> {
    let separator = separator(content);
    let mut joined = false;
    if separator == b',' {
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
    let mut rows = rows(path, content, separator, joined)?;
    if joined {
        rows.remarks.push("commas are taken for decimal commas".into());
    }
    let width = rows.channels.len();
    let names = match rows.header {
        Some(names) if names.len() == width => names,
        _ if width == 1 => vec![stem.to_string()],
        _ => (0..width).map(|c| format!("{stem} {c}")).collect(),
    };
    let columns = Columns { names, channels: rows.channels, rate_hz: None, remarks: rows.remarks, largest: None };
    if reading.no_time { Ok(columns) } else { time_axis::take(path, columns, &[0]) }
}

fn rows(path: &Path, content: &str, separator: u8, joined: bool) -> Result<Rows> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .delimiter(separator)
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_reader(content.as_bytes());
    let mut rows = Rows { header: None, channels: Vec::new(), remarks: Vec::new() };
    let mut count = 0_usize;
    let mut record = csv::StringRecord::new();
    while reader.read_record(&mut record).map_err(|error| Error::invalid(path.display(), error))? {
        let line = record.position().map_or(0, |p| p.line());
        let refuse = |what: String| Err(Error::invalid(format!("{}:{line}", path.display()), what));
        let cells = trimmed(&record);
        if cells.is_empty() {
            continue;
        }
        let first = count == 0 && rows.header.is_none();
        let cells: Vec<String> = if joined && !(first && is_header(&cells)) { pairs(&cells) } else { owned(&cells) };
        let numbers: Vec<Option<f64>> = cells.iter().map(|cell| number(cell)).collect();
        if let Some(at) = numbers.iter().position(Option::is_none) {
            if first && is_header(&cells) {
                rows.header = Some(cells.iter().map(|cell| text::name(cell)).collect());
                continue;
            }
            return refuse(format!("{} is no number", text::quoted(&cells[at])));
        }
        if count == 0 {
            rows.channels = vec![Vec::new(); numbers.len()];
        }
        let (wide, narrow) = (rows.channels.len(), numbers.len());
        if wide != narrow {
            if count != 1 || wide < narrow || rows.header.is_some() {
                return refuse(format!("has {narrow} cells, the line before has {wide}"));
            }
            rows.remarks
                .push(format!("the first row has {} more cells than the others; they are dropped", wide - narrow));
            rows.channels.truncate(narrow);
        }
        count += 1;
        VALUES.check(path.display(), (count * narrow) as f64, "cut the file into parts")?;
        rows.channels.iter_mut().zip(numbers).for_each(|(channel, x)| channel.extend(x));
    }
    Ok(rows)
}

fn data_lines(content: &str) -> impl Iterator<Item = &str> {
    content.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'))
}

fn separator(content: &str) -> u8 {
    // A header may hold what the data do not: the first line with a number at its start decides.
    let is_data = |line: &&str| begins_like_a_number(line.trim_start_matches('"'));
    let line = data_lines(content).find(is_data).or_else(|| data_lines(content).next()).unwrap_or_default();
    [b';', b'\t', b','].into_iter().find(|&d| line.bytes().any(|b| b == d)).unwrap_or(b',')
}

/// Whether the commas between whole numbers separate columns or decimals.
fn commas(content: &str) -> Commas {
    let whole = |cell: &str| {
        let digits = cell.strip_prefix(['-', '+']).unwrap_or(cell);
        !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit())
    };
    let mut names = None;
    let mut width = None;
    let mut proof = false;
    for line in data_lines(content) {
        let cells: Vec<&str> = line.trim_end_matches(',').split(',').map(str::trim).collect();
        if names.is_none() && width.is_none() && is_header(&cells) {
            names = Some(cells.len());
            continue;
        }
        let pairs = cells.len().is_multiple_of(2);
        // A point, an exponent, quotation marks, a sign behind the comma, or another count of cells: commas separate.
        if !pairs || *width.get_or_insert(cells.len()) != cells.len() || !cells.iter().all(|cell| whole(cell)) {
            return Commas::Separate;
        }
        if cells.iter().skip(1).step_by(2).any(|cell| cell.starts_with(['-', '+'])) {
            return Commas::Separate;
        }
        let leading_zero = |cell: &&str| cell.len() > 1 && cell.starts_with('0');
        proof |= cells.iter().step_by(2).any(|&cell| cell == "-0");
        proof |= cells.iter().skip(1).step_by(2).any(leading_zero);
    }
    match (width, names) {
        (None, _) => Commas::Separate,
        (Some(width), Some(names)) if names == width => Commas::Separate,
        (Some(width), Some(names)) if 2 * names == width => Commas::Decimal,
        _ if proof => Commas::Decimal,
        _ => Commas::Unknown,
    }
}

/// A row of names: no cell is a number or begins like one.
fn is_header<S: AsRef<str>>(cells: &[S]) -> bool {
    cells.iter().all(|cell| !begins_like_a_number(cell.as_ref()))
}

fn begins_like_a_number(cell: &str) -> bool {
    let cell = cell.trim();
    let rest = cell.strip_prefix(['-', '+']).unwrap_or(cell);
    let rest = rest.strip_prefix(['.', ',']).unwrap_or(rest);
    rest.starts_with(|c: char| c.is_ascii_digit()) || cell.parse::<f64>().is_ok()
}

/// Cells without empty ones at the end (a closing separator is not a column).
fn trimmed(record: &csv::StringRecord) -> Vec<&str> {
    let mut cells: Vec<&str> = record.iter().collect();
    while cells.last().is_some_and(|cell| cell.is_empty()) {
        cells.pop();
    }
    cells
}

fn owned(cells: &[&str]) -> Vec<String> {
    cells.iter().map(|cell| cell.to_string()).collect()
}

/// Whole and decimal parts put together again.
fn pairs(cells: &[&str]) -> Vec<String> {
    cells.chunks(2).map(|pair| pair.join(".")).collect()
}

/// A number, with a decimal point or one decimal comma.
fn number(cell: &str) -> Option<f64> {
    let comma = || (cell.matches(',').count() == 1).then(|| cell.replace(',', ".").parse().ok()).flatten();
    cell.parse().ok().or_else(comma)
}
