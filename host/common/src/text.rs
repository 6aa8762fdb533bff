//! Foreign text (cells, names, paths, numbers) as part of a message: one line, of bearable length.
//!
//! Every [`crate::Error`] passes through here when it is shown, so that no reader of files has to think of line
//! breaks, escape sequences or a cell of a megabyte in what it quotes.

/// Longest message part, characters.
const MAX_PART_CHARACTERS: usize = 320;
/// Longest place: a path and a key, characters.
const LONGEST_PLACE: usize = 300;
/// Longest cell or name quoted, characters.
const LONGEST_QUOTE: usize = 60;
/// Longest cell of a table, characters.
const LONGEST_CELL: usize = 200;
/// Longest number left as it is, characters: 2^63 has 19 digits, f64 prints up to 17 behind the point.
const LONGEST_NUMBER: usize = 24;

/// The text as one line: no control characters, no endless numbers, shortened in its middle where it is too long.
pub fn one_line(text: &str) -> String {
    shortened(&with_short_numbers(&without_controls(text)), MAX_PART_CHARACTERS)
}

/// As [`one_line`], with the digits of file names left as they are.
pub fn one_line_place(text: &str) -> String {
    shortened(&without_controls(text), LONGEST_PLACE)
}

/// A cell or a name from a file in quotation marks, shortened.
pub fn quoted(text: &str) -> String {
    format!("'{}'", name(text))
}

/// A cell of a table for people.
pub fn cell(text: &str) -> String {
    shortened(without_controls(text).trim(), LONGEST_CELL)
}

/// A name from a file, fit for tables and messages.
pub fn name(text: &str) -> String {
    shortened(without_controls(text).trim(), LONGEST_QUOTE)
}

/// A quantity for a message: plain where that is short, with an exponent where it is not.
pub fn number(value: f64) -> String {
    with_short_numbers(&value.to_string())
}

/// Control characters, line separators and marks of direction as single spaces.
fn without_controls(text: &str) -> String {
    let unseen = |c: char| c.is_control() || matches!(c, '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match unseen(c) {
            false => out.push(c),
            true if out.ends_with(' ') => {}
            true => out.push(' '),
        }
    }
    out
}

/// Numbers of many digits in exponent form.
fn with_short_numbers(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(start) = rest.find(|c: char| c.is_ascii_digit()) {
        out.push_str(&rest[..start]);
        rest = &rest[start..];
        let end = rest.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(rest.len());
        let (token, after) = rest.split_at(end);
        match token.parse::<f64>() {
            Ok(value) if token.len() > LONGEST_NUMBER && value.is_finite() => out.push_str(&format!("{value:e}")),
            _ => out.push_str(token),
        }
        rest = after;
    }
    out.push_str(rest);
    out
}

fn shortened(text: &str, most: usize) -> String {
    let count = text.chars().count();
    if count <= most {
        return text.to_owned();
    }
    let head: String = text.chars().take(most * 2 / 3).collect();
    let tail: String = text.chars().skip(count - most / 4).collect();
    format!("{head} ... {tail}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_foreign_text_becomes_one_bearable_line() {
        assert_eq!(one_line("a\r\n\tb\u{1b}[2Jc\u{2028}d"), "a b [2Jc d");
        assert_eq!(one_line(&format!("{} Hz lies outside", 1e300)), "1e300 Hz lies outside");
        assert_eq!(one_line(&format!("{} s", 1e-300)), "1e-300 s");
        assert_eq!(
            one_line("9223372036854775808 N/m, 0.1234567890123456"),
            "9223372036854775808 N/m, 0.1234567890123456"
        );
        assert_eq!(one_line_place("/data/2024010112000000000000000000.csv"), "/data/2024010112000000000000000000.csv");
        assert!(one_line(&"x".repeat(1 << 20)).chars().count() < 800);
        assert!(quoted(&"\u{e4}".repeat(1 << 20)).chars().count() < 80);
    }
}
