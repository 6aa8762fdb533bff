//! Delimited text: commas, semicolons, tabs or one column; with or without a header; with or without a time column.
//!
//! The separator is the one that the first data line has. A first row with more cells than the others (as
//! some exporters write scale values into it) loses the extra cells; any other ragged row is an error. A
//! column that starts anywhere, ascends strictly and does so in equal steps to 1 % is a time column: it gives
//! the rate and is not a channel.

use super::Columns;
use crate::{Error, Result};
use std::path::Path;

pub(super) fn read(path: &Path, text: &str, stem: &str) -> Result<Columns> {
    let delimiter = delimiter(text);
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .delimiter(delimiter)
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_reader(text.as_bytes());
    let mut header: Option<Vec<String>> = None;
    let mut rows: Vec<Vec<f64>> = Vec::new();
    let mut remarks = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|error| Error::invalid(path.display(), error))?;
        let line = record.position().map_or(0, |p| p.line());
        let cells: Vec<&str> = trimmed(&record);
        if cells.is_empty() {
            continue;
        }
        let numbers: std::result::Result<Vec<f64>, &str> =
            cells.iter().map(|cell| number(cell, delimiter).ok_or(*cell)).collect();
        match numbers {
            Ok(numbers) => rows.push(numbers),
            Err(_) if rows.is_empty() && header.is_none() => {
                header = Some(cells.iter().map(|c| c.to_string()).collect())
            }
            Err(cell) => {
                return Err(Error::invalid(format!("{}:{line}", path.display()), format!("'{cell}' is no number")));
            }
        }
        if let [.., before, last] = rows.as_mut_slice()
            && before.len() != last.len()
        {
            let (wide, narrow) = (before.len(), last.len());
            if rows.len() != 2 || wide < narrow || header.is_some() {
                let what = format!("has {narrow} cells, the line before has {wide}");
                return Err(Error::invalid(format!("{}:{line}", path.display()), what));
            }
            remarks.push(format!("the first row has {} more cells than the others; they are dropped", wide - narrow));
            rows[0].truncate(narrow);
        }
    }
    let width = rows.first().map_or(0, Vec::len);
    let mut channels: Vec<Vec<f64>> = (0..width).map(|c| rows.iter().map(|row| row[c]).collect()).collect();
    let mut names = match header {
        Some(names) if names.len() == width => names,
        _ if width == 1 => vec![stem.to_string()],
        _ => (0..width).map(|c| format!("{stem} {c}")).collect(),
    };
    let mut rate_hz = None;
    if width > 1
        && let Some(rate) = rate_of_time(&channels[0])
    {
        rate_hz = Some(rate);
        remarks.push(format!("the first column is time at {rate:.6} Hz"));
        channels.remove(0);
        names.remove(0);
    }
    Ok(Columns { names, channels, rate_hz, remarks })
}

fn delimiter(text: &str) -> u8 {
    let line = text.lines().find(|line| !line.trim().is_empty() && !line.starts_with('#')).unwrap_or_default();
    [b';', b'\t', b','].into_iter().find(|&d| line.bytes().any(|b| b == d)).unwrap_or(b',')
}

/// Cells without empty ones at the end (a closing separator is not a column).
fn trimmed(record: &csv::StringRecord) -> Vec<&str> {
    let mut cells: Vec<&str> = record.iter().collect();
    while cells.last().is_some_and(|cell| cell.is_empty()) {
        cells.pop();
    }
    cells
}

/// A number; with semicolons as separator also with a decimal comma.
fn number(cell: &str, delimiter: u8) -> Option<f64> {
    cell.parse().ok().or_else(|| (delimiter == b';').then(|| cell.replace(',', ".").parse().ok()).flatten())
}

fn rate_of_time(column: &[f64]) -> Option<f64> {
    let (first, last) = (column.first()?, column.last()?);
    let step = (last - first) / (column.len() as f64 - 1.0);
    let regular =
        column.len() > 2 && step > 0.0 && column.windows(2).all(|w| ((w[1] - w[0]) / step - 1.0).abs() < 0.01);
    // Printed times are rounded: their mean step is a round rate to one part in 1e5 or better.
    let rate = 1.0 / step;
    regular.then(|| if (rate / rate.round() - 1.0).abs() < 1e-5 { rate.round() } else { rate })
}
