//! Universal file format, dataset 58, as text and binary (58b): functions at nodal degrees of freedom.
//!
//! Source: SDRC universal file dataset 58. Read: time responses (function type 0 or 1) with even abscissa,
//! real ordinates in single (type 2) or double (type 4) precision; uneven abscissae are accepted where they
//! are regular to 1 %. Binary data: IEEE numbers of either byte order. Not read: complex ordinates, numbers of VAX
//! and IBM machines.

use super::Columns;
use crate::{Error, Result, text};
use std::path::Path;

/// Lines from the dataset number to the first data line.
const HEADER_LINES: usize = 12;

/// Whether the content starts like a universal file.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    let start = String::from_utf8_lossy(&bytes[..bytes.len().min(200)]).into_owned();
    let mut lines = start.lines().map(str::trim);
    lines.next() == Some("-1") && lines.next().is_some_and(|line| line.starts_with("58"))
}

pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Columns> {
    let mut lines = Lines { bytes, at: 0, number: 0 };
    let mut columns =
        Columns { names: Vec::new(), channels: Vec::new(), rate_hz: None, remarks: Vec::new(), largest: None };
    let mut skipped = 0;
    while let Some(line) = lines.next(path)? {
        if line.trim() != "-1" {
            continue;
        }
        let start = lines.number;
        let refuse = |line: usize, what: &str| Error::invalid(format!("{}:{}", path.display(), line + 1), what);
        let Some(kind) = lines.next(path)? else { return Err(refuse(start, "dataset has no end")) };
        let found = match kind.trim() {
            "58" => Some(dataset(kind, &lines.until_end(path, start)?)),
            head if head.starts_with("58b") => {
                let head_lines =
                    (1..HEADER_LINES).map_while(|_| lines.next(path).transpose()).collect::<Result<Vec<_>>>()?;
                let found = binary(head, &head_lines, &mut lines);
                if found.is_ok() {
                    lines.until_end(path, start)?;
                }
                Some(found)
            }
            _ => {
                lines.until_end(path, start)?;
                skipped += 1;
                None
            }
        };
        let Some(found) = found else { continue };
        let (name, rate, values) = found.map_err(|(line, what)| refuse(start + line, &what))?;
        if columns.rate_hz.is_some_and(|other| (other / rate - 1.0).abs() > 1e-6) {
            return Err(refuse(start, "datasets have different sampling rates"));
        }
        columns.rate_hz = Some(rate);
        columns.names.push(name);
        columns.channels.push(values);
    }
    if columns.channels.is_empty() {
        return Err(Error::invalid(path.display(), "holds no dataset 58"));
    }
    if skipped > 0 {
        columns.remarks.push(format!("{skipped} datasets other than 58 were skipped"));
    }
    Ok(columns)
}

/// Lines of a file that may have binary data between them.
struct Lines<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Lines read.
    number: usize,
}

impl<'a> Lines<'a> {
    fn next(&mut self, path: &Path) -> Result<Option<&'a str>> {
        let rest = &self.bytes[self.at..];
        if rest.is_empty() {
            return Ok(None);
        }
        let end = rest.iter().position(|b| *b == b'\n').map_or(rest.len(), |at| at + 1);
        self.at += end;
        self.number += 1;
        let text = std::str::from_utf8(&rest[..end]);
        let text = text.map_err(|_| Error::invalid(format!("{}:{}", path.display(), self.number), "is not text"))?;
        Ok(Some(text.trim_end_matches(['\n', '\r'])))
    }

    /// Lines up to the one that ends the dataset.
    fn until_end(&mut self, path: &Path, start: usize) -> Result<Vec<&'a str>> {
        let mut own = Vec::new();
        while let Some(line) = self.next(path)? {
            if line.trim() == "-1" {
                return Ok(own);
            }
            own.push(line);
        }
        Err(Error::invalid(format!("{}:{start}", path.display()), "dataset has no end"))
    }

    /// The next bytes, as many as announced and no fewer.
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let taken = self.bytes[self.at..].get(..count)?;
        self.at += count;
        Some(taken)
    }
}

type Parsed = (String, f64, Vec<f64>);

/// What the header of a dataset says.
struct Header {
    name: String,
    double: bool,
    points: f64,
    even: bool,
    step: f64,
}

/// The header from its number line on; an error carries the line offset.
fn header(lines: &[&str]) -> std::result::Result<Header, (usize, String)> {
    if lines.len() < HEADER_LINES {
        return Err((0, "dataset 58 is truncated".into()));
    }
    let name = lines[1].trim();
    let function = lines[6].split_whitespace().next().unwrap_or_default();
    if !["0", "1"].contains(&function) {
        return Err((6, format!("function type {function} is no time response (0 or 1)")));
    }
    let form: Vec<f64> = lines[7].split_whitespace().map_while(number).collect();
    let [ordinate, points, even, _, step, ..] = form[..] else {
        return Err((7, "data form needs type, count, spacing, start and step".into()));
    };
    if ordinate != 2.0 && ordinate != 4.0 {
        return Err((7, format!("ordinate type {ordinate} is not real single (2) or double (4)")));
    }
    let name = if name.is_empty() { "uff58".into() } else { name.into() };
    Ok(Header { name, double: ordinate == 4.0, points, even: even == 1.0, step })
}

/// A binary dataset whose data begin at `lines`.
fn binary(first: &str, head: &[&str], lines: &mut Lines) -> std::result::Result<Parsed, (usize, String)> {
    let whole: Vec<&str> = [first].into_iter().chain(head.iter().copied()).collect();
    let header = header(&whole)?;
    let form: Vec<&str> = first.split_whitespace().collect();
    let [_, order, floating, ascii_lines, count, ..] = form[..] else {
        return Err((0, "58b needs byte order, number format, lines and bytes".into()));
    };
    if floating != "2" || !["1", "2"].contains(&order) || ascii_lines != "11" {
        return Err((0, "58b of other than IEEE numbers behind eleven lines is not read".into()));
    }
    let data = count.parse().ok().and_then(|count| lines.take(count));
    let data = data.ok_or_else(|| (0, format!("is truncated: {} bytes of data announced", text::quoted(count))))?;
    macro_rules! read {
        ($type:ty, $cell:expr) => {{
            let cell = $cell.try_into().expect("chunks have the size of the type");
            f64::from(if order == "2" { <$type>::from_be_bytes(cell) } else { <$type>::from_le_bytes(cell) })
        }};
    }
    // Uneven abscissae are single numbers between the ordinates.
    let size = if header.double { 8 } else { 4 };
    if !header.even {
        return Err((7, "58b with uneven abscissa is not read".into()));
    }
    let cells = data.chunks_exact(size);
    let values =
        if header.double { cells.map(|c| read!(f64, c)).collect() } else { cells.map(|c| read!(f32, c)).collect() };
    finished(header, values)
}

/// A text dataset from its number line and what follows it.
fn dataset(first: &str, rest: &[&str]) -> std::result::Result<Parsed, (usize, String)> {
    let lines: Vec<&str> = [first].into_iter().chain(rest.iter().copied()).collect();
    let header = header(&lines)?;
    let mut values = Vec::new();
    for (k, line) in lines[HEADER_LINES..].iter().enumerate() {
        for cell in cells(line) {
            values.push(number(cell).ok_or_else(|| (HEADER_LINES + k, format!("'{cell}' is no number")))?);
        }
    }
    finished(header, values)
}

/// Rate and ordinates, as many as announced.
fn finished(header: Header, values: Vec<f64>) -> std::result::Result<Parsed, (usize, String)> {
    let Header { name, points, even, step, .. } = header;
    let (rate, values) = if even {
        (1.0 / step, values)
    } else {
        let times: Vec<f64> = values.iter().step_by(2).copied().collect();
        let mean = (times.last().unwrap_or(&0.0) - times.first().unwrap_or(&0.0)) / (times.len() as f64 - 1.0);
        if times.windows(2).any(|w| ((w[1] - w[0]) / mean - 1.0).abs() > 0.01) {
            return Err((7, "uneven abscissa steps differ by more than 1 %".into()));
        }
        (1.0 / mean, values.into_iter().skip(1).step_by(2).collect())
    };
    if !(rate.is_finite() && rate > 0.0) {
        return Err((7, format!("abscissa step {step} gives no sampling rate")));
    }
    if values.len() as f64 != points {
        return Err((7, format!("is truncated: {points} points announced, {} found", values.len())));
    }
    Ok((name, rate, values))
}

/// Numbers of a data line; fixed-width fields may touch where a number is negative ("1.0E+00-2.0E+00").
fn cells(line: &str) -> Vec<&str> {
    let mut cells = Vec::new();
    for word in line.split_whitespace() {
        let mut from = 0;
        let bytes = word.as_bytes();
        for k in 1..bytes.len() {
            if bytes[k] == b'-' && bytes[k - 1].is_ascii_digit() {
                cells.push(&word[from..k]);
                from = k;
            }
        }
        cells.push(&word[from..]);
    }
    cells
}

/// A number, with Fortran's D exponent too.
fn number(cell: &str) -> Option<f64> {
    cell.parse().ok().or_else(|| cell.replace(['D', 'd'], "E").parse().ok())
}
