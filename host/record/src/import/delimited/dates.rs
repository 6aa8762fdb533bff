//! Dates and times of day as numbers: nanoseconds, so that microseconds of today keep their digits.
//!
//! Read: `2024-03-01 12:00:00.000078`, with `T`, `/` or `.` between, `01.03.2024 12:00:00,5`, `3/1/2024 1:02:03 PM`,
//! `01-Mar-2024 12:00:00`, `12:00:00.5`, `12:00:00:500`, `59:00.5` (minutes and seconds); a zone at the end is
//! taken off, so that the hour of summer time is no jump. Only differences are used, so which of two small numbers is
//! the month does not matter within a day.

/// Nanoseconds of a day.
const DAY_NS: i64 = 86_400_000_000_000;
/// Names of the months; any three first letters or more are one.
const MONTHS: [&str; 12] = [
    "JANUARY",
    "FEBRUARY",
    "MARCH",
    "APRIL",
    "MAY",
    "JUNE",
    "JULY",
    "AUGUST",
    "SEPTEMBER",
    "OCTOBER",
    "NOVEMBER",
    "DECEMBER",
];

/// A date, a time of day or both, ns; `None` for anything else.
pub(in crate::import) fn stamp(cell: &str) -> Option<i64> {
    let cell = cell.trim().trim_matches('"');
    if cell.len() < 5 || !cell.starts_with(|c: char| c.is_ascii_digit()) {
        return None;
    }
    let upper = cell.to_ascii_uppercase();
    let (upper, afternoon) = match (upper.strip_suffix("PM"), upper.strip_suffix("AM")) {
        (Some(rest), _) => (rest.trim_end().to_owned(), Some(true)),
        (_, Some(rest)) => (rest.trim_end().to_owned(), Some(false)),
        _ => (upper, None),
    };
    let upper = upper.trim_end_matches('Z').trim_end_matches("UTC").trim_end();
    let Some((date, time)) = parted(upper) else {
        let time = if upper.contains(':') {
            time_of_day(upper, afternoon).or_else(|| minutes_and_seconds(upper))?
        } else {
            days(upper)?.checked_mul(DAY_NS)?
        };
        return Some(time);
    };
    // A time of day may have its zone behind a blank.
    if date.contains(':') {
        return time_of_day(upper, afternoon);
    }
    days(date)?.checked_mul(DAY_NS)?.checked_add(time_of_day(time.trim(), afternoon)?)
}

/// Whether a cell is a date without a time of day.
pub(in crate::import) fn is_date(cell: &str) -> bool {
    !cell.contains(':') && stamp(cell).is_some()
}

/// Date and time of day, where a blank or a `T` between digits parts them: `OCT` holds one, too.
fn parted(text: &str) -> Option<(&str, &str)> {
    let bytes = text.as_bytes();
    let digit = |at: Option<usize>| at.and_then(|at| bytes.get(at)).is_some_and(u8::is_ascii_digit);
    let parts = |&i: &usize| bytes[i] == b' ' || (bytes[i] == b'T' && digit(i.checked_sub(1)) && digit(Some(i + 1)));
    let at = (0..bytes.len()).find(parts)?;
    Some((&text[..at], &text[at + 1..]))
}

/// The month that a word names, from 1.
fn month(word: &str) -> Option<i64> {
    let mut months = MONTHS.iter().zip(1_i64..);
    months.find(|(name, _)| word.len() >= 3 && name.starts_with(word)).map(|(_, month)| month)
}

fn days(date: &str) -> Option<i64> {
    let sign = date.chars().find(|c| !c.is_ascii_digit()).filter(|c| ['-', '/', '.'].contains(c))?;
    let parts: Vec<&str> = date.split(sign).collect();
    let &[a, b, c] = parts.as_slice() else { return None };
    let named = month(b);
    let number = |part: &str| part.parse::<i64>().ok();
    let (a, b, c) = (number(a)?, named.or_else(|| number(b))?, number(c)?);
    let (year, month, day) = if a > 31 {
        (a, b, c)
    } else if a > 12 || sign == '.' || named.is_some() {
        (c, b, a)
    } else {
        (c, a, b)
    };
    if !(1..=12).contains(&month) || !(1..=31).contains(&day) || !(1000..10_000).contains(&year) {
        return None;
    }
    // Days since 1970 of the proleptic Gregorian calendar.
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let era = year.div_euclid(400);
    let of_era = year.rem_euclid(400);
    let of_year = (153 * month + 2) / 5 + day - 1;
    Some(era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + of_year - 719_468)
}

fn time_of_day(time: &str, afternoon: Option<bool>) -> Option<i64> {
    let (time, zone_ns) = parted_zone(time)?;
    let mut parts = time.split(':');
    let mut hours: i64 = parts.next()?.parse().ok()?;
    let minutes: i64 = parts.next()?.parse().ok()?;
    let (whole, mut part) = match parts.next() {
        None => ("0", ""),
        Some(seconds) => seconds.split_once(['.', ',']).unwrap_or((seconds, "")),
    };
    // Milliseconds or microseconds behind a colon; two digits could be frames or hundredths.
    if let Some(behind) = parts.next() {
        if !part.is_empty() || ![3, 6, 9].contains(&behind.len()) {
            return None;
        }
        part = behind;
    }
    let seconds: i64 = whole.parse().ok()?;
    if !part.bytes().all(|b| b.is_ascii_digit()) || parts.next().is_some() {
        return None;
    }
    if !(0..24).contains(&hours) || !(0..60).contains(&minutes) || !(0..=60).contains(&seconds) {
        return None;
    }
    match afternoon {
        Some(true) if hours < 12 => hours += 12,
        Some(false) if hours == 12 => hours = 0,
        _ => {}
    }
    Some(((hours * 60 + minutes) * 60 + seconds) * 1_000_000_000 + nanos(part)? - zone_ns)
}

/// Nanoseconds of the digits behind the point.
fn nanos(part: &str) -> Option<i64> {
    format!("{part:0<9}")[..9].parse().ok()
}

/// A time of day and its zone, ns east of Greenwich, which stands behind a plus, or west of it behind a minus.
fn parted_zone(time: &str) -> Option<(&str, i64)> {
    let Some(at) = time.find(['+', '-']) else { return Some((time, 0)) };
    let zone = &time[at + 1..];
    let is_zone = !zone.is_empty() && zone.len() <= 8 && zone.bytes().all(|b| b.is_ascii_digit() || b == b':');
    if !is_zone {
        return None;
    }
    let digits: String = zone.chars().filter(char::is_ascii_digit).collect();
    let number = |part: Option<&str>| part.and_then(|part| part.parse::<i64>().ok());
    let (hours, minutes) = (number(digits.get(..digits.len().min(2)))?, number(digits.get(2..4)).unwrap_or(0));
    let east_ns = (hours * 60 + minutes) * 60 * 1_000_000_000;
    Some((time[..at].trim_end(), if time.as_bytes()[at] == b'-' { -east_ns } else { east_ns }))
}

/// `59:00.5`, as spreadsheets show a time of day: without its hour.
fn minutes_and_seconds(time: &str) -> Option<i64> {
    let (minutes, seconds) = time.split_once(':')?;
    let (whole, part) = seconds.split_once(['.', ','])?;
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    if !digits(minutes) || !digits(whole) || !digits(part) || minutes.len() > 2 || whole.len() != 2 {
        return None;
    }
    let (minutes, seconds): (i64, i64) = (minutes.parse().ok()?, whole.parse().ok()?);
    let able = minutes < 60 && seconds < 60;
    able.then_some((minutes * 60 + seconds) * 1_000_000_000 + nanos(part)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_dates_are_told_as_loggers_write_them() {
        let first = stamp("2024-03-01 12:00:00.000078").expect("a date");
        assert_eq!(first, 19_783 * DAY_NS + 43_200_000_078_000);
        for same in [
            "2024-03-01T12:00:00.000078Z",
            "2024/03/01 12:00:00,000078",
            "01.03.2024 12:00:00.000078",
            "3/1/2024 12:00:00.000078 PM",
        ] {
            assert_eq!(stamp(same), Some(first), "{same}");
        }
        assert_eq!(stamp("12:00:00.5"), Some(43_200_500_000_000));
        // Zones are taken off, so that the end of summer time is no jump.
        const HOUR_NS: i64 = 3_600_000_000_000;
        assert_eq!(stamp("2024-03-01 12:00:00+01:00"), Some(first - 78_000 - HOUR_NS));
        for same in
            ["2024-03-01T07:00:00.000078-05:00", "2024-03-01 07:00:00.000078 -0500", "01-Mar-2024 12:00:00.000078"]
        {
            assert_eq!(stamp(same), Some(first), "{same}");
        }
        let october = stamp("2024-10-01").expect("a date");
        assert_eq!(stamp("1/October/2024"), Some(october));
        assert_eq!(stamp("01-Oct-2024 12:00:00"), Some(october + 43_200_000_000_000));
        assert_eq!(stamp("59:00.15"), Some(3_540_150_000_000));
        assert_eq!(stamp("12:00:00:156"), Some(43_200_156_000_000));
        assert_eq!(stamp("13:00:00 +0100"), stamp("12:00:00"));
        assert!(is_date("2024-03-01") && !is_date("12:00:00"));
        for none in [
            "12:00:00:24",
            "12:00:00-abc",
            "1:2.5",
            "59:0.15",
            "01-Mai-2024",
            "1.5",
            "12",
            "1.2.3.4",
            "0.5,1",
            "abc",
            "25:00:00",
            "2024-13-01",
        ] {
            assert_eq!(stamp(none), None, "{none}");
        }
    }
}
