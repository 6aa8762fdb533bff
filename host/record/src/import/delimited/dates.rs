//! Dates and times of day as numbers: nanoseconds, so that microseconds of today keep their digits.
//!
//! Read: `2024-03-01 12:00:00.000078`, with `T`, `/` or `.` between, `01.03.2024 12:00:00,5`, `3/1/2024 1:02:03 PM`,
//! `12:00:00.5`; a zone at the end is left out. Only differences are used, so which of two small numbers is the month
//! does not matter within a day.

/// Nanoseconds of a day.
const DAY_NS: i64 = 86_400_000_000_000;

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
    let (date, time) = match upper.split_once([' ', 'T']) {
        Some((date, time)) => (Some(date), Some(time.trim())),
        None if upper.contains(':') => (None, Some(upper)),
        None => (Some(upper), None),
    };
    let days = date.map_or(Some(0), days)?;
    let time = time.map_or(Some(0), |time| time_of_day(time, afternoon))?;
    days.checked_mul(DAY_NS)?.checked_add(time)
}

/// Whether a cell is a date without a time of day.
pub(in crate::import) fn is_date(cell: &str) -> bool {
    !cell.contains(':') && stamp(cell).is_some()
}

fn days(date: &str) -> Option<i64> {
    let sign = date.chars().find(|c| !c.is_ascii_digit()).filter(|c| ['-', '/', '.'].contains(c))?;
    let parts: Vec<i64> = date.split(sign).map(|part| part.parse().ok()).collect::<Option<_>>()?;
    let [a, b, c] = parts[..] else { return None };
    let (year, month, day) = if a > 31 {
        (a, b, c)
    } else if a > 12 || sign == '.' {
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
    let time = time.split_once(['+']).map_or(time, |parts| parts.0);
    let mut parts = time.split(':');
    let mut hours: i64 = parts.next()?.parse().ok()?;
    let minutes: i64 = parts.next()?.parse().ok()?;
    let (whole, part) = match parts.next() {
        None => ("0", ""),
        Some(seconds) => seconds.split_once(['.', ',']).unwrap_or((seconds, "")),
    };
    // A zone west of Greenwich stands behind a minus.
    let part = part.split_once('-').map_or(part, |parts| parts.0);
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
    let nanos: i64 = format!("{part:0<9}")[..9].parse().ok()?;
    Some(((hours * 60 + minutes) * 60 + seconds) * 1_000_000_000 + nanos)
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
        assert_eq!(stamp("2024-03-01 12:00:00+01:00"), Some(first - 78_000));
        assert!(is_date("2024-03-01") && !is_date("12:00:00"));
        for none in ["1.5", "12", "1.2.3.4", "0.5,1", "abc", "25:00:00", "2024-13-01"] {
            assert_eq!(stamp(none), None, "{none}");
        }
    }
}
