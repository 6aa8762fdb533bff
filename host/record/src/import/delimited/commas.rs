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
    // The part behind a decimal comma may end in an exponent, the one before it never.
    let fraction = |cell: &str| match cell.split_once(['e', 'E']) {
        Some((digits, exponent)) => whole(digits) && whole(exponent),
        None => whole(cell),
    };
    let mut names = None;
    let mut width = None;
    let mut proof = false;
    // `1,25e-3` all along: one digit and an exponent are how numbers are written, not columns.
    let mut scientific = true;
    for line in data_lines(content) {
        let cells: Vec<&str> = line.trim_end_matches(',').split(',').map(str::trim).collect();
        // Names, and a row of units below them.
        if width.is_none() && is_header(&cells) {
            names.get_or_insert(cells.len());
            continue;
        }
        let pairs = cells.len().is_multiple_of(2);
        // A point, quotation marks, a sign behind the comma, or another count of cells: commas separate.
        let able = cells.chunks(2).all(|pair| whole(pair[0]) && pair.get(1).is_some_and(|cell| fraction(cell)));
        if !pairs || *width.get_or_insert(cells.len()) != cells.len() || !able {
            return Commas::Separate;
        }
        let is_scientific =
            |pair: &[&str]| pair[0].trim_start_matches(['-', '+']).len() == 1 && pair[1].contains(['e', 'E']);
        scientific &= cells.chunks(2).all(is_scientific);
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
        _ if proof || scientific => Commas::Decimal,
        _ => Commas::Unknown,
    }
}
