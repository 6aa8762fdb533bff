//! Lines as cells, and cells as numbers: separators, quotation marks, decimal commas, dates, missing values.

use super::dates;

/// What stands between two cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::import) enum Separator {
    Sign(u8),
    /// Any number of blanks and tabs.
    Blanks,
}

/// A cell's content.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::import) enum Cell {
    Number(f64),
    /// A date or time of day, ns; whether it is a date alone.
    Stamp(i64, bool),
    Missing,
}

/// The cells of a line without the blanks around them.
pub(in crate::import) fn split(line: &str, separator: Separator) -> Vec<&str> {
    match separator {
        Separator::Blanks => line.split_ascii_whitespace().collect(),
        Separator::Sign(sign) if line.contains('"') => quoted(line, sign),
        Separator::Sign(sign) => line.split(char::from(sign)).map(str::trim).collect(),
    }
}

/// Cells in quotation marks may hold the separator.
fn quoted(line: &str, sign: u8) -> Vec<&str> {
    let mut cells = Vec::new();
    let (mut from, mut inside) = (0, false);
    for (at, b) in line.bytes().enumerate() {
        if b == b'"' {
            inside = !inside;
        } else if b == sign && !inside {
            cells.push(&line[from..at]);
            from = at + 1;
        }
    }
    cells.push(&line[from..]);
    cells.into_iter().map(|cell| cell.trim().trim_matches('"').trim()).collect()
}

/// What a cell holds; `None` for text.
pub(in crate::import) fn read(cell: &str) -> Option<Cell> {
    if let Ok(number) = cell.parse::<f64>() {
        return Some(if number.is_nan() { Cell::Missing } else { Cell::Number(number) });
    }
    if is_missing(cell) {
        return Some(Cell::Missing);
    }
    // A key or a switch as a programming language prints it.
    if let Some(on) = truth(cell) {
        return Some(Cell::Number(f64::from(u8::from(on))));
    }
    if cell.matches(',').count() == 1
        && let Ok(number) = cell.replace(',', ".").parse()
    {
        return Some(Cell::Number(number));
    }
    // Fortran's exponent.
    if cell.contains(['D', 'd'])
        && let Ok(number) = cell.replace(['D', 'd'], "E").parse()
    {
        return Some(Cell::Number(number));
    }
    dates::stamp(cell).map(|ns| Cell::Stamp(ns, dates::is_date(cell)))
}

fn truth(cell: &str) -> Option<bool> {
    let is = |word: &str| cell.eq_ignore_ascii_case(word);
    (is("true") || is("false")).then(|| is("true"))
}

fn is_missing(cell: &str) -> bool {
    cell.is_empty()
        || ["na", "n/a", "null", "none", "-", "#n/a", "1.#qnan", "-1.#ind", "1.#ind"]
            .contains(&cell.to_ascii_lowercase().as_str())
}

/// A row of names: no cell is a number or begins like one.
pub(in crate::import) fn is_header<S: AsRef<str>>(cells: &[S]) -> bool {
    cells.iter().all(|cell| !begins_like_a_number(cell.as_ref()))
}

/// Whether a cell is a number, or a damaged one.
pub(in crate::import) fn begins_like_a_number(cell: &str) -> bool {
    let cell = cell.trim();
    let rest = cell.strip_prefix(['-', '+']).unwrap_or(cell);
    let rest = rest.strip_prefix(['.', ',']).unwrap_or(rest);
    rest.starts_with(|c: char| c.is_ascii_digit()) || cell.parse::<f64>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_truth_is_one_and_zero() {
        for (cell, value) in [("True", 1.0), ("false", 0.0), ("TRUE", 1.0), ("1.5", 1.5)] {
            assert_eq!(read(cell), Some(Cell::Number(value)), "{cell}");
        }
        assert_eq!(read("truth"), None);
    }
}
