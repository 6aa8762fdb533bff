//! Universal file format, dataset 58, as text and binary (58b): functions at nodal degrees of freedom.
//!
//! Source: SDRC universal file dataset 58. Read: time responses (function type 0 or 1) with even abscissa,
//! real ordinates in single (type 2) or double (type 4) precision; uneven abscissae are accepted where they
//! are regular to 1 %. Binary data: IEEE numbers of either byte order. Not read: complex ordinates, numbers of VAX
//! and IBM machines.

use super::signals::{Signal, Signals};
use super::stamps::{Stamps, look, rate_hz};
use super::units;
use crate::{Error, Result, text};
use std::borrow::Cow;
use std::path::Path;

/// Lines from the dataset number to the first data line.
const HEADER_LINES: usize = 12;

/// Whether the content starts like a universal file.
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    let start = String::from_utf8_lossy(&bytes[..bytes.len().min(200)]).into_owned();
    let mut lines = start.lines().map(str::trim);
    lines.next() == Some("-1") && lines.next().is_some_and(|line| line.starts_with("58"))
}

pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Signals> {
    let mut lines = Lines { bytes, at: 0, number: 0 };
    let mut found = Signals::default();
    let (mut skipped, mut si) = (0, None);
    while let Some(line) = lines.next(path)? {
        if line.trim() != "-1" {
            continue;
        }
        let start = lines.number;
        let refuse = |line: usize, what: &str| Error::invalid(format!("{}:{}", path.display(), line + 1), what);
        let Some(kind) = lines.next(path)? else { return Err(refuse(start, "dataset has no end")) };
        let set = match kind.trim() {
            "58" => Some(dataset(&kind, &lines.until_end(path, start)?)),
            head if head.starts_with("58b") => {
                let head_lines =
                    (1..HEADER_LINES).map_while(|_| lines.next(path).transpose()).collect::<Result<Vec<_>>>()?;
                let set = binary(head, &head_lines, &mut lines);
                if set.is_ok() {
                    lines.until_end(path, start)?;
                }
                Some(set)
            }
            "164" => {
                si = length_factor(&lines.until_end(path, start)?);
                None
            }
            _ => {
                lines.until_end(path, start)?;
                skipped += 1;
                None
            }
        };
        match set {
            None => {}
            Some(Ok(set)) => found.signals.push(set),
            // A spectrum beside the time signals is no damage.
            Some(Err((FUNCTION_LINE, what))) => found.remarks.push(format!("a dataset 58 is left out: {what}")),
            Some(Err((line, what))) => return Err(refuse(start + line, &what)),
        }
    }
    if found.signals.is_empty() {
        let why = found.remarks.first().map_or(String::new(), |remark| format!(" of a time signal ({remark})"));
        return Err(Error::invalid(path.display(), format!("holds no dataset 58{why}")));
    }
    if skipped > 0 {
        found.remarks.push(format!("{skipped} datasets of other kinds than 58 were skipped"));
    }
    for signal in &mut found.signals {
        // Without a label the units are those of dataset 164, which states a factor to metres.
        let length = si.and_then(|factor: f64| LENGTHS.iter().find(|row| (row.0 / factor - 1.0).abs() < 1e-3));
        if let (Some("?acceleration"), Some((_, unit))) = (signal.unit.as_deref(), length) {
            signal.unit = Some((*unit).to_owned());
        } else if signal.unit.as_deref() == Some("?acceleration") {
            signal.unit = None;
        }
    }
    Ok(found)
}

/// Line of a dataset that says what function it is.
const FUNCTION_LINE: usize = 6;
/// Factors to metres of dataset 164, and what its accelerations are in.
const LENGTHS: [(f64, &str); 4] = [(1.0, "m/s2"), (1000.0, "mm/s2"), (39.370_08, "in/s2"), (3.280_839, "ft/s2")];

/// Units of length per metre that dataset 164 states.
fn length_factor(lines: &[Cow<str>]) -> Option<f64> {
    let factors: Vec<f64> =
        lines.iter().skip(1).flat_map(|line| cells(line).into_iter().filter_map(number).collect::<Vec<_>>()).collect();
    factors.first().copied().filter(|factor| *factor > 0.0)
}

/// Lines of a file that may have binary data between them.
struct Lines<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Lines read.
    number: usize,
}

impl<'a> Lines<'a> {
    fn next(&mut self, path: &Path) -> Result<Option<Cow<'a, str>>> {
        let rest = &self.bytes[self.at..];
        if rest.is_empty() {
            return Ok(None);
        }
        let end = rest.iter().position(|b| *b == b'\n').map_or(rest.len(), |at| at + 1);
        self.at += end;
        self.number += 1;
        let line = rest[..end].trim_ascii_end();
        if line.contains(&0) {
            return Err(Error::invalid(format!("{}:{}", path.display(), self.number), "is not text"));
        }
        // Labels are often written in a Windows code page.
        Ok(Some(match std::str::from_utf8(line) {
            Ok(line) => Cow::Borrowed(line),
            Err(_) => Cow::Owned(line.iter().map(|b| char::from(*b)).collect()),
        }))
    }

    /// Lines up to the one that ends the dataset.
    fn until_end(&mut self, path: &Path, start: usize) -> Result<Vec<Cow<'a, str>>> {
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

type Parsed = Signal;

/// What the header of a dataset says.
struct Header {
    name: String,
    double: bool,
    points: f64,
    even: bool,
    start: f64,
    step: f64,
    /// Unit label; `?acceleration` where only the quantity is stated.
    unit: Option<String>,
}

/// The header from its number line on; an error carries the line offset.
fn header(lines: &[Cow<str>]) -> std::result::Result<Header, (usize, String)> {
    if lines.len() < HEADER_LINES {
        return Err((0, "dataset 58 is truncated".into()));
    }
    let name = lines[1].trim();
    let function = lines[6].split_whitespace().next().unwrap_or_default();
    if !["0", "1"].contains(&function) {
        return Err((FUNCTION_LINE, format!("function type {function} is no time response (0 or 1)")));
    }
    let form: Vec<f64> = lines[7].split_whitespace().map_while(number).collect();
    let [ordinate, points, even, start, step, ..] = form[..] else {
        return Err((7, "data form needs type, count, spacing, start and step".into()));
    };
    if ordinate != 2.0 && ordinate != 4.0 {
        return Err((FUNCTION_LINE, format!("ordinate type {ordinate} is not real single (2) or double (4)")));
    }
    let axis = |line: &str| -> (String, String, String) {
        let fixed =
            |from: usize, to: usize| line.chars().skip(from).take(to - from).collect::<String>().trim().to_owned();
        (line.split_whitespace().next().unwrap_or_default().to_owned(), fixed(26, 46), fixed(47, 67))
    };
    let (abscissa, ordinate_axis) = (axis(&lines[8]), axis(&lines[9]));
    let plain =
        |text: &str| text.is_empty() || text.eq_ignore_ascii_case("none") || text.eq_ignore_ascii_case("unknown");
    if ["18", "19"].contains(&abscissa.0.as_str()) {
        return Err((FUNCTION_LINE, "its abscissa is no time".into()));
    }
    let unit = match (plain(&ordinate_axis.2), ordinate_axis.0.as_str()) {
        (false, _) => Some(ordinate_axis.2),
        (true, "12") => Some("?acceleration".into()),
        (true, _) => None,
    };
    let seconds = units::measure(&abscissa.2)
        .filter(|unit| unit.quantity == units::Quantity::Time)
        .map_or(1.0, |unit| unit.factor);
    // The first line is the name only by habit: many write the model there, and the point measured into the
    // function's line.
    let point: Vec<String> = response(&lines[6]).into_iter().collect();
    let name = match (plain(name), point.first()) {
        (false, Some(point)) => format!("{name} {point}"),
        (false, None) => name.to_owned(),
        (true, Some(point)) => point.clone(),
        (true, None) => "uff58".into(),
    };
    Ok(Header {
        name,
        double: ordinate == 4.0,
        points,
        even: even == 1.0,
        start: start * seconds,
        step: step * seconds,
        unit,
    })
}

/// Entity, node and direction of the response in the function's line, where they are stated.
fn response(line: &str) -> Option<String> {
    let fixed = |from: usize, to: usize| line.chars().skip(from).take(to - from).collect::<String>().trim().to_owned();
    let (entity, node, direction) = (fixed(31, 41), fixed(41, 51), fixed(51, 55));
    let node: i64 = node.parse().ok().filter(|node| *node != 0)?;
    let direction = match direction.parse::<i64>().ok()? {
        sign @ -3..=3 if sign != 0 => {
            format!("{}{}", if sign < 0 { "-" } else { "+" }, ["X", "Y", "Z"][sign.unsigned_abs() as usize - 1])
        }
        _ => String::new(),
    };
    let entity =
        if entity.is_empty() || entity.eq_ignore_ascii_case("none") { String::new() } else { format!("{entity} ") };
    Some(format!("{entity}{node}{direction}"))
}

/// A binary dataset whose data begin at `lines`.
fn binary(first: &str, head: &[Cow<str>], lines: &mut Lines) -> std::result::Result<Parsed, (usize, String)> {
    let whole: Vec<Cow<str>> = [Cow::Borrowed(first)].into_iter().chain(head.iter().cloned()).collect();
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
fn dataset(first: &str, rest: &[Cow<str>]) -> std::result::Result<Parsed, (usize, String)> {
    let lines: Vec<Cow<str>> = [Cow::Borrowed(first)].into_iter().chain(rest.iter().cloned()).collect();
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
fn finished(header: Header, mut values: Vec<f64>) -> std::result::Result<Parsed, (usize, String)> {
    let Header { name, points, even, start, step, unit, .. } = header;
    // Some programs fill the last line up: not a whole line, and with nothing.
    let wanted = points * if even { 1.0 } else { 2.0 };
    let beyond = values.len() as f64 - wanted;
    if beyond > 0.0 && beyond < MAX_NUMBERS_PER_LINE && values[wanted as usize..].iter().all(|x| *x == 0.0) {
        values.truncate(wanted as usize);
    }
    let (rate, start, values) = if even {
        (rate_hz(step, PRINT_ERROR_SHARE), start, values)
    } else {
        let times: Vec<f64> = values.iter().step_by(2).copied().collect();
        let values: Vec<f64> = values.into_iter().skip(1).step_by(2).collect();
        let rate = match look(&times) {
            Stamps::Even { step, uncertain, .. } if uncertain < 1e-4 => rate_hz(step, uncertain),
            Stamps::Uneven { index, step, usual, .. } => {
                return Err((
                    7,
                    format!(
                        "uneven abscissa: a step of {step:.4e} at value {index} where steps are {usual:.4e}; cut the \
                         set there"
                    ),
                ));
            }
            _ => {
                return Err((
                    7,
                    "uneven abscissa gives no sampling rate: write an even one (abscissa spacing 1)".into(),
                ));
            }
        };
        (rate, times.first().copied().unwrap_or(0.0), values)
    };
    if !(rate.is_finite() && rate > 0.0) {
        return Err((7, format!("abscissa step {step} gives no sampling rate")));
    }
    if values.len() as f64 != points {
        let what = if (values.len() as f64) < points { "is truncated" } else { "holds more than it says" };
        return Err((7, format!("{what}: {points} points announced, {} found", values.len())));
    }
    Ok(Signal { unit, rate_hz: Some(rate), start_s: Some(start), ..Signal::new(name, values) })
}

/// Share that a printed step is rounded by.
const PRINT_ERROR_SHARE: f64 = 1e-5;
/// Most numbers in a line.
const MAX_NUMBERS_PER_LINE: f64 = 6.0;

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
