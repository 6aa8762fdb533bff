//! What stands above the numbers: names, units, and lines that state the rate.
//!
//! The row of names is the last one without numbers that has as many cells as the data, or the comment above them; a
//! row of units may follow. Lines above the names, and lines of another width, are free text, searched for a sampling
//! rate or interval and a unit; where two of them contradict each other neither rate is taken. A line of the data's
//! width that begins with a number and is none is damage, never a name.

use super::cells::{Cell, Separator, begins_like_a_number, is_header, read, split};
use crate::import::{stamps, units};
use crate::text;

/// Lines above the data that are looked at.
pub(super) const MOST_LINES: usize = 2_000;
/// Share by which two lines that state one rate may differ.
const SAME_RATE: f64 = 1e-6;
/// Share that an interval of few digits is known to at best.
const MAX_INTERVAL_ERROR_SHARE: f64 = 0.01;
/// Rates below this one, Hz, are nothing that vibration is sampled at where another line states more.
const LEAST_HZ: f64 = 50.0;

/// What the head says.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Head {
    pub names: Option<Vec<String>>,
    pub units: Option<Vec<String>>,
    pub rate_hz: Option<f64>,
    /// Unit of all channels, where one line states it.
    pub unit: Option<String>,
    pub remarks: Vec<String>,
}

/// A line above the data.
pub(super) struct Line<'a> {
    pub number: usize,
    pub text: &'a str,
    pub comment: bool,
}

/// Whether all cells are numbers, dates or missing, and one is a number.
pub(super) fn is_data<S: AsRef<str>>(cells: &[S]) -> bool {
    let mut numbers = 0;
    for cell in cells {
        match read(cell.as_ref()) {
            Some(Cell::Number(_)) => numbers += 1,
            Some(Cell::Stamp(..) | Cell::Missing) => {}
            None => return false,
        }
    }
    numbers > 0
}

/// Reads the head of data of `width` columns; an error is a line's number and its cell that is no number.
pub(super) fn of(lines: &[Line], separator: Separator, width: usize) -> Result<Head, (usize, String)> {
    let mut head = Head::default();
    let cells: Vec<Vec<String>> = lines.iter().map(|line| trimmed(&split(line.text, separator), width)).collect();
    let wide =
        |i: &usize| cells[*i].len() == width && is_header(&cells[*i]) && cells[*i].iter().any(|cell| !cell.is_empty());
    let last_comment = lines.iter().rposition(|line| line.comment).filter(|i| i + 1 == lines.len());
    let mut named: Vec<usize> =
        (0..lines.len()).filter(|i| (!lines[*i].comment || Some(*i) == last_comment) && wide(i)).collect();
    // One word in a column of its own is a name; a sentence above one column is a remark.
    if width == 1 {
        named.retain(|&i| !lines[i].text.contains([':', '=']) || units::of_name(lines[i].text).is_some());
    }
    if let Some(last) = named.pop() {
        let before = named.pop().filter(|before| is_units(&cells[last]) && !is_units(&cells[*before]));
        let names = before.unwrap_or(last);
        if before.is_some() {
            head.units = Some(cells[last].clone());
        }
        head.names = Some(cells[names].clone());
        head.search(&lines[..names]);
        for (line, cells) in lines[..names].iter().zip(&cells).filter(|(line, _)| !line.comment) {
            if cells.len() != width || !is_data(cells) {
                continue;
            }
            // A row of numbers above the names is a rate, or no head at all.
            match equal(cells) {
                Some(rate) => {
                    head.remarks
                        .push(format!("line {} above the names states the sampling rate, {rate} Hz", line.number));
                    head.rate_hz = head.rate_hz.or(Some(rate));
                }
                None => return Err((lines[names].number, damaged(&head.names.unwrap_or_default()))),
            }
        }
        let between = lines[names + 1..].iter().zip(&cells[names + 1..]);
        for (line, cells) in between.filter(|(line, _)| !line.comment) {
            if cells.len() == width && width > 1 && cells.iter().any(|cell| begins_like_a_number(cell)) {
                return Err((line.number, damaged(cells)));
            }
        }
        return Ok(head);
    }
    for (line, cells) in lines.iter().zip(&cells).filter(|(line, _)| !line.comment) {
        let first = cells.first().map_or("", String::as_str);
        if cells.len() == width
            && cells.iter().any(|cell| begins_like_a_number(cell))
            && (width > 1 || begins_like_a_number(first))
        {
            return Err((line.number, damaged(cells)));
        }
    }
    head.search(lines);
    Ok(head)
}

/// The whole number of at least a hundred that all cells are.
fn equal(cells: &[String]) -> Option<f64> {
    let first: f64 = cells.first()?.parse().ok()?;
    let all = cells.iter().all(|cell| cell.parse() == Ok(first));
    (all && first.fract() == 0.0 && first >= 100.0).then_some(first)
}

/// The first cell that is no number.
fn damaged(cells: &[String]) -> String {
    cells.iter().find(|cell| read(cell).is_none()).cloned().unwrap_or_default()
}

/// Cells without empty ones beyond the width: a closing separator is no column.
pub(super) fn trimmed(cells: &[&str], width: usize) -> Vec<String> {
    let mut cells: Vec<String> = cells.iter().map(|cell| (*cell).to_owned()).collect();
    while cells.len() > width && cells.last().is_some_and(String::is_empty) {
        cells.pop();
    }
    cells
}

/// A row of units: at least half of what stands there is one, and nothing is long.
fn is_units(cells: &[String]) -> bool {
    let stated: Vec<&String> = cells.iter().filter(|cell| !cell.is_empty()).collect();
    let are = stated.iter().filter(|cell| units::measure(cell).is_some() || units::is_empty(cell)).count();
    !stated.is_empty() && 2 * are >= stated.len()
}

/// What one line says of the rate.
struct Stated {
    line: usize,
    hz: f64,
    /// Share that it is known to, as it is written.
    known: f64,
    remark: String,
}

impl Head {
    /// Looks for a rate, an interval and a unit in free text.
    fn search(&mut self, lines: &[Line]) {
        let mut stated: Vec<Stated> = Vec::new();
        for line in lines {
            let lower = normalised(line.text);
            let place = format!("line {}", line.number);
            if let Some(hz) = rate(&lower) {
                let remark = format!("{place} states the sampling rate, {hz} Hz");
                stated.push(Stated { line: line.number, hz, known: 0.5 * SAME_RATE, remark });
            } else if let Some((step_s, known)) = interval(&lower) {
                let remark = format!("{place} states the sampling interval, {step_s} s");
                stated.push(Stated { line: line.number, hz: stamps::rate_hz(step_s, SAME_RATE), known, remark });
            } else if let Some(unit) = unit(line.text) {
                self.remarks.push(format!("{place} states the unit, {unit}"));
                self.unit = self.unit.take().or(Some(unit));
            }
        }
        if stated.iter().any(|stated| stated.hz >= LEAST_HZ) {
            stated.retain(|stated| stated.hz >= LEAST_HZ);
        }
        if let Some((a, b)) = contradiction(&stated) {
            self.remarks.push(format!(
                "lines {} and {} state two sampling rates, {} and {} Hz; neither is taken: --rate says it",
                a.line,
                b.line,
                text::number(a.hz),
                text::number(b.hz)
            ));
            return;
        }
        // A rounded interval says less than the rate itself.
        let best = stated.iter().min_by(|a, b| a.known.total_cmp(&b.known)).map(|stated| stated.hz);
        self.rate_hz = self.rate_hz.or(best);
        self.remarks.extend(stated.into_iter().map(|stated| stated.remark));
    }
}

/// The first two lines whose rates cannot both hold.
fn contradiction(stated: &[Stated]) -> Option<(&Stated, &Stated)> {
    let differ = |a: &Stated, b: &Stated| (a.hz / b.hz - 1.0).abs() > a.known + b.known;
    stated.iter().enumerate().find_map(|(i, b)| stated[..i].iter().find(|a| differ(a, b)).map(|a| (a, b)))
}

/// A line in lower case with blanks for what joins words; the minus of an exponent stays.
fn normalised(text: &str) -> String {
    let lower: Vec<char> = text.to_lowercase().chars().collect();
    let letter = |at: Option<usize>| at.and_then(|at| lower.get(at)).is_some_and(|c| c.is_alphabetic());
    let sign = |(i, &c): (usize, &char)| match c {
        '_' | '\u{a0}' | '\u{2009}' | '\u{202f}' => ' ',
        '\u{2019}' => '\'',
        '\u{2212}' => '-',
        '-' if letter(i.checked_sub(1)) && letter(Some(i + 1)) => ' ',
        _ => c,
    };
    lower.iter().enumerate().map(sign).collect()
}

/// Text behind the first of `keys` that stands as words of their own.
fn behind<'a>(lower: &'a str, keys: &[&str]) -> Option<&'a str> {
    keys.iter().find_map(|key| {
        lower.match_indices(*key).find_map(|(at, _)| {
            let word = lower[..at].chars().next_back().is_none_or(|c| !c.is_alphanumeric());
            let rest = &lower[at + key.len()..];
            (word && !rest.starts_with(|c: char| c.is_alphanumeric())).then_some(rest)
        })
    })
}

/// A number in free text.
struct Number {
    start: usize,
    end: usize,
    /// As it stands, without the signs between its thousands.
    written: String,
}

/// The numbers of a text; digits behind a letter (`ch1`) are a name's.
fn numbers(text: &str) -> Vec<Number> {
    let bytes = text.as_bytes();
    let mut found = Vec::new();
    let mut at = 0;
    while let Some(digit) = (at..bytes.len()).find(|&i| bytes[i].is_ascii_digit()) {
        let point = digit > at && bytes[digit - 1] == b'.';
        let start = if point { digit - 1 } else { digit };
        let glued = text[..start].chars().next_back().is_some_and(char::is_alphanumeric);
        let end = end_of_number(text, digit, point);
        if !glued {
            found.push(Number { start, end, written: text[start..end].replace([' ', '\''], "") });
        }
        at = end;
    }
    found
}

fn end_of_number(text: &str, from: usize, point: bool) -> usize {
    let bytes = text.as_bytes();
    let digit = |at: usize| bytes.get(at).is_some_and(u8::is_ascii_digit);
    let run = |at: usize| (at..bytes.len()).find(|&i| !digit(i)).unwrap_or(bytes.len());
    let mut end = run(from);
    if !point && end - from <= 3 {
        end = end_of_thousands(text, end);
    }
    while matches!(bytes.get(end), Some(b'.' | b',')) && digit(end + 1) {
        end = run(end + 1);
    }
    let sign = usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
    if bytes.get(end) == Some(&b'e') && digit(end + 1 + sign) {
        end = run(end + 1 + sign);
    }
    end
}

/// End of groups of three digits; behind those that blanks part no other word than a unit may follow.
fn end_of_thousands(text: &str, from: usize) -> usize {
    let bytes = text.as_bytes();
    let Some(&sign) = bytes.get(from).filter(|sign| [b' ', b'\''].contains(*sign)) else { return from };
    let group = |at: usize| bytes.get(at..at + 3).is_some_and(|group| group.iter().all(u8::is_ascii_digit));
    let mut end = from;
    while bytes.get(end) == Some(&sign) && group(end + 1) && !bytes.get(end + 4).is_some_and(u8::is_ascii_digit) {
        end += 4;
    }
    let behind = text[end..].trim_start();
    let word = word(behind);
    let sure = sign == b'\'' || word.is_empty() || hertz(behind).is_some() || units::measure(&word).is_some();
    if sure { end } else { from }
}

/// The letters that a text begins with.
fn word(text: &str) -> String {
    text.chars().take_while(|c| c.is_alphabetic()).collect()
}

/// The first number, or the one that a unit follows behind its equals sign or colon (`2.56 x = 12800 Hz`).
fn chosen(text: &str, has_unit: impl Fn(&str) -> bool) -> Option<Number> {
    let mut numbers = numbers(text).into_iter();
    let first = numbers.next()?;
    if has_unit(&text[first.end..]) {
        return Some(first);
    }
    let is_meant = |number: &Number| {
        let between = &text[first.end..number.start];
        has_unit(&text[number.end..]) && between.contains(['=', ':']) && !between.contains([',', ';', '\t', '('])
    };
    let meant = numbers.find(is_meant);
    meant.or(Some(first))
}

/// The value of a number as people write it; `hertz` where points and commas may part thousands of whole Hz.
fn value(written: &str, hertz: bool) -> Option<f64> {
    let groups = |sign: char| -> String {
        let mut parts = written.split(sign);
        let first = parts.next().unwrap_or_default();
        let thousands = first.len() <= 3 && parts.all(is_three_digits);
        // Cells of a line are no groups.
        if thousands { written.replace(sign, "") } else { first.to_owned() }
    };
    let plain = match (written.matches('.').count(), written.matches(',').count()) {
        (0, 0) => written.to_owned(),
        (1, 0) => {
            let (whole, part) = written.split_once('.')?;
            // Nothing vibrates that is sampled below 100 Hz to a thousandth.
            let thousands = hertz && is_three_digits(part) && (1..=2).contains(&whole.len()) && whole != "0";
            if thousands { format!("{whole}{part}") } else { written.to_owned() }
        }
        (0, 1) => {
            let (whole, part) = written.split_once(',')?;
            match part.len() {
                3 if hertz && is_three_digits(part) && whole != "0" => format!("{whole}{part}"),
                4.. if whole.len() > 3 && !part.contains('e') => whole.to_owned(),
                _ => format!("{whole}.{part}"),
            }
        }
        (_, 0) => groups('.'),
        (0, _) => groups(','),
        // The last sign is the decimal one.
        _ if written.rfind(',') > written.rfind('.') => written.replace('.', "").replace(',', "."),
        _ => written.replace(',', ""),
    };
    plain.parse().ok()
}

fn is_three_digits(part: &str) -> bool {
    part.len() == 3 && part.bytes().all(|b| b.is_ascii_digit())
}

/// Hertz per unit that a text begins with.
fn hertz(text: &str) -> Option<f64> {
    const UNITS: [(&str, f64); 16] = [
        ("khz", 1e3),
        ("kilohertz", 1e3),
        ("ks/s", 1e3),
        ("ksa/s", 1e3),
        ("ksps", 1e3),
        ("ksample", 1e3),
        ("mhz", 1e6),
        ("ms/s", 1e6),
        ("msa/s", 1e6),
        ("msps", 1e6),
        ("hz", 1.0),
        ("hertz", 1.0),
        ("s/s", 1.0),
        ("sa/s", 1.0),
        ("sps", 1.0),
        ("sample", 1.0),
    ];
    UNITS.iter().find(|(unit, _)| text.starts_with(*unit)).map(|(_, factor)| *factor)
}

/// What stands between a number and its unit in a cell of its own.
const UNIT_SEPARATORS: [char; 8] = [' ', ';', ',', '\t', '"', '[', '(', ':'];

/// Hertz per unit behind a number: at once, `12.8k`, or in the next cell.
fn hertz_behind(after: &str) -> Option<f64> {
    let direct = after.trim_start();
    let kilo = direct.strip_prefix('k').filter(|rest| !rest.starts_with(|c: char| c.is_alphanumeric() || c == '/'));
    hertz(direct).or(kilo.map(|_| 1e3)).or_else(|| hertz(direct.trim_start_matches(UNIT_SEPARATORS)))
}

fn rate(lower: &str) -> Option<f64> {
    const KEYS: [&str; 13] = [
        "sampling rate",
        "sample rate",
        "samplerate",
        "samplingrate",
        "sampling frequency",
        "sample frequency",
        "samplefrequency",
        "sampling freq",
        "sample freq",
        "scan rate",
        "acquisition rate",
        "abtastrate",
        "fs",
    ];
    // The digit of this unit is no rate.
    let rest = behind(lower, &KEYS)?.replace("[1/s]", "[hz]").replace("(1/s)", "(hz)");
    let number = chosen(&rest, |after| hertz(after.trim_start()).is_some())?;
    let (before, after) = (&rest[..number.start], &rest[number.end..]);
    let named = || before.split(|c: char| !c.is_alphanumeric() && c != '/').find_map(hertz);
    let factor = hertz_behind(after).or_else(named).unwrap_or(1.0);
    let hz = factor * value(&number.written, factor == 1.0)?;
    Some(hz).filter(|rate| rate.is_finite() && *rate >= 1.0)
}

/// Seconds per unit of time; nothing is sampled once in minutes.
fn seconds(unit: &str) -> Option<f64> {
    let measure = units::measure(unit).filter(|measure| measure.quantity == units::Quantity::Time)?;
    Some(measure.factor).filter(|factor| *factor <= 1.0)
}

/// A sampling interval, s, and the share that it is known to.
fn interval(lower: &str) -> Option<(f64, f64)> {
    const KEYS: [&str; 10] = [
        "sample interval",
        "sampling interval",
        "sample period",
        "sampling period",
        "time increment",
        "time step",
        "timestep",
        "delta t",
        "delta x",
        "dt",
    ];
    let rest = behind(lower, &KEYS)?;
    let unit_behind = |after: &str| seconds(&word(after.trim_start_matches(UNIT_SEPARATORS)));
    let number = chosen(rest, |after| seconds(&word(after.trim_start())).is_some())?;
    // A unit may stand before the number, in brackets or as a word of the key.
    let words = rest[..number.start].split(|c: char| !c.is_alphanumeric());
    let named = || words.filter(|word| word.len() > 1 || *word == "s").find_map(seconds);
    let factor = unit_behind(&rest[number.end..]).or_else(named).unwrap_or(1.0);
    let step_s = factor * value(&number.written, false)?;
    // One unit of the last digit.
    let digits: String = number.written.chars().take_while(|c| *c != 'e').filter(char::is_ascii_digit).collect();
    let known = (1.0 / digits.parse::<f64>().ok()?).clamp(0.5 * SAME_RATE, MAX_INTERVAL_ERROR_SHARE);
    (step_s > 0.0 && step_s <= 1.0).then_some((step_s, known))
}

fn unit(line: &str) -> Option<String> {
    let line = line.trim_start_matches(['#', '%', '/', ' ', '"']);
    let (key, value) = line.split_once([':', '=', ',', ';', '\t'])?;
    let key = key.trim().to_lowercase();
    let value = value.trim().trim_matches(['"', ',', ';', '\t', ' ']);
    let named = ["unit", "units", "y unit", "yunit", "y_unit", "acceleration unit", "signal unit", "einheit"]
        .contains(&key.as_str());
    (named && units::measure(value).is_some()).then(|| value.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_rates_are_told_in_free_text() {
        let rate = |line: &str| rate(&normalised(line));
        for (line, hz) in [
            ("# Sampling rate: 12800 Hz", 12_800.0),
            ("fs = 25.6 kHz", 25_600.0),
            ("Sample rate (Hz),51200", 51_200.0),
            ("Sampling frequency;12,8;kHz", 12_800.0),
            ("Sampling rate: 12 800 Hz", 12_800.0),
            ("Sampling rate: 12\u{a0}800", 12_800.0),
            ("Sampling rate: 12'800 Hz", 12_800.0),
            ("Sampling rate: 12\u{2019}800", 12_800.0),
            ("Sampling rate: 1 024 000 samples/s", 1_024_000.0),
            ("Sampling rate: 12.800 Hz", 12_800.0),
            ("Sampling rate: 25.600", 25_600.0),
            ("Sampling rate: 12,800 Hz", 12_800.0),
            ("Sampling rate: 12.800,00 Hz", 12_800.0),
            ("Sampling rate: 12,800.00 Hz", 12_800.0),
            ("Sampling rate: 12,800 kHz", 12_800.0),
            ("Sample rate (kHz): 12.800", 12_800.0),
            ("Sampling rate: 12.8k", 12_800.0),
            ("Sampling rate 12.8 kS/s, 3 channels", 12_800.0),
            ("sample_rate_khz: 25.6", 25_600.0),
            ("Sample Rate [S/s],12800", 12_800.0),
            ("Sampling rate [1/s]: 12800", 12_800.0),
            ("Max. frequency 5000 Hz, sampling rate 2.56 x = 12800 Hz", 12_800.0),
            ("Sampling rate (channel 1): 12800 Hz", 12_800.0),
            ("Sampling rate of ch1: 12800 Hz", 12_800.0),
            ("Date: 2024-03-01; fs 12800; low pass 5000 Hz", 12_800.0),
            ("Sampling rate 12800 Hz, bandwidth 5 kHz", 12_800.0),
            ("SampleRate=12800;Channels=3", 12_800.0),
            ("Sampling rate: 1.28e4 Hz", 12_800.0),
        ] {
            assert_eq!(rate(line), Some(hz), "{line}");
        }
        assert_eq!(rate("offset 12"), None);
        assert_eq!(unit("# Unit: g"), Some("g".into()));
    }

    #[test]
    fn regress_intervals_keep_the_sign_of_their_exponent() {
        for (line, hz) in [
            ("# dt = 1e-4", 10_000.0),
            ("Sampling interval: 1.0E-04 s", 10_000.0),
            ("dt [s];1,0E-4", 10_000.0),
            ("delta_t = 0.2e-3 s", 5_000.0),
            ("dt=7.8125e-5", 12_800.0),
            ("dt = 78.125 us", 12_800.0),
            ("Sample period 78,125 \u{b5}s", 12_800.0),
            ("Delta X,7.8125e-05", 12_800.0),
            ("sample-interval: 0.1 ms", 10_000.0),
            ("sampling_interval_ms: 0.078125", 12_800.0),
            ("sampling interval (ms);0,078125", 12_800.0),
        ] {
            let (step_s, _) = interval(&normalised(line)).unwrap_or_else(|| panic!("{line} states an interval"));
            assert!((step_s * hz - 1.0).abs() < 1e-9, "{line}: {step_s} s");
        }
        assert_eq!(interval("width 12"), None);
    }

    fn searched(lines: &[&str]) -> Head {
        let mut head = Head::default();
        let lines: Vec<Line> =
            lines.iter().zip(2..).map(|(&text, number)| Line { number, text, comment: true }).collect();
        head.search(&lines);
        head
    }

    #[test]
    fn theory_of_two_rates_that_contradict_each_other_neither_is_taken() {
        let head = searched(&["fs: 12800 Hz", "Unit: g", "Sampling rate: 51.2 kHz"]);
        let said = "lines 2 and 4 state two sampling rates, 12800 and 51200 Hz; neither is taken: --rate says it";
        assert_eq!(head.rate_hz, None);
        assert!(head.remarks.iter().any(|remark| remark == said), "{:?}", head.remarks);
        for agreeing in [
            ["fs: 12800 Hz", "Sampling rate: 12.8 kHz"],
            ["dt = 7.8e-5", "fs = 12800"],
            ["fs = 12800", "dt = 0.000078 s"],
            ["fs = 12800", "time step: 1"],
        ] {
            assert_eq!(searched(&agreeing).rate_hz, Some(12_800.0), "{agreeing:?}");
        }
        assert_eq!(searched(&["fs = 12800", "dt = 1e-4"]).rate_hz, None);
    }
}
