//! Commas in a comma-separated file: between columns, or in numbers.
//!
//! `0,50` is one number or two, and the two readings are told apart by what only one of them can be (`-0`, `05`, the
//! header's count of names); else the user has to say it.

use super::cells::is_header;
use super::data_lines;

/// What the commas of a comma-separated file are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Commas {
    Separate,
    Decimal,
    Unknown,
}

/// Whether the commas between whole numbers separate columns or decimals.
pub(super) fn commas(content: &str) -> Commas {
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
