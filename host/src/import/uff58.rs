//! Universal file format, dataset 58 (ASCII): functions at nodal degrees of freedom.
//!
//! Source: SDRC universal file dataset 58. Read: time responses (function type 0 or 1) with even abscissa,
//! real ordinates in single (type 2) or double (type 4) precision; uneven abscissae are accepted where they
//! are regular to 1 %. Not read: binary 58b, complex ordinates.

use super::Columns;
use crate::{Error, Result};
use std::path::Path;

/// Lines from the dataset number to the first data line.
const HEADER_LINES: usize = 12;

/// Whether the content starts like a universal file.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    let start = String::from_utf8_lossy(&bytes[..bytes.len().min(200)]).into_owned();
    let mut lines = start.lines().map(str::trim);
    lines.next() == Some("-1") && lines.next().is_some_and(|line| line.starts_with("58"))
}

pub(super) fn read(path: &Path, text: &str) -> Result<Columns> {
    let lines: Vec<&str> = text.lines().collect();
    let refuse = |line: usize, what: &str| Error::invalid(format!("{}:{}", path.display(), line + 1), what);
    let mut columns = Columns { names: Vec::new(), channels: Vec::new(), rate_hz: None, remarks: Vec::new() };
    let mut skipped = 0;
    let mut i = 0;
    while i < lines.len() {
        if lines[i].trim() != "-1" {
            i += 1;
            continue;
        }
        let start = i + 1;
        let end =
            (start..lines.len()).find(|&j| lines[j].trim() == "-1").ok_or_else(|| refuse(i, "dataset has no end"))?;
        i = end + 1;
        match lines.get(start).map(|line| line.trim()) {
            Some("58") => {}
            Some(kind) if kind.starts_with("58b") => return Err(refuse(start, "binary dataset 58b is not supported")),
            _ => {
                skipped += 1;
                continue;
            }
        }
        if end < start + HEADER_LINES {
            return Err(refuse(start, "dataset 58 is truncated"));
        }
        let (name, rate, values) = dataset(&lines[start..end]).map_err(|(line, what)| refuse(start + line, &what))?;
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

type Parsed = (String, f64, Vec<f64>);

/// One dataset from its number line; an error carries the line offset.
fn dataset(lines: &[&str]) -> std::result::Result<Parsed, (usize, String)> {
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
    let mut values = Vec::new();
    for (k, line) in lines[HEADER_LINES..].iter().enumerate() {
        for cell in cells(line) {
            values.push(number(cell).ok_or_else(|| (HEADER_LINES + k, format!("'{cell}' is no number")))?);
        }
    }
    let (rate, values) = if even == 1.0 {
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
    Ok((if name.is_empty() { "uff58".into() } else { name.into() }, rate, values))
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
