//! The civil day of an instant, for the partitions; UTC.

/// `YYYY-MM-DD` of microseconds since 1970.
pub fn of(us: i64) -> String {
    // Days from civil, H. Hinnant, "chrono-compatible low-level date algorithms".
    let days = us.div_euclid(DAY_US) + 719_468;
    let era = days.div_euclid(146_097);
    let of_era = days.rem_euclid(146_097);
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * of_year + 2) / 153;
    let day = of_year - (153 * shifted + 2) / 5 + 1;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}")
}

/// Microseconds of a day.
pub const DAY_US: i64 = 86_400_000_000;

/// First instant of a day `YYYY-MM-DD`, microseconds since 1970; `None` where it is no day.
pub fn begin(day: &str) -> Option<i64> {
    let (year, rest) = day.split_once('-')?;
    let (month, number) = rest.split_once('-')?;
    let (year, month, number): (i64, i64, i64) = (year.parse().ok()?, month.parse().ok()?, number.parse().ok()?);
    // Civil to days, as above: the year begins in March.
    let year = year - i64::from(month <= 2);
    let era = year.div_euclid(400);
    let of_year = (153 * (month + if month > 2 { -3 } else { 9 }) + 2) / 5 + number - 1;
    let of_era = year.rem_euclid(400) * 365 + year.rem_euclid(400) / 4 - year.rem_euclid(400) / 100 + of_year;
    let us = (era * 146_097 + of_era - 719_468) * DAY_US;
    // What is no day of the calendar comes back as another one.
    (of(us) == day).then_some(us)
}

#[cfg(test)]
mod tests {
    #[test]
    fn ref_days_of_known_instants() {
        for (seconds, day) in [
            (0, "1970-01-01"),
            (-1, "1969-12-31"),
            (951_782_399, "2000-02-28"),
            (951_782_400, "2000-02-29"),
            (1_709_251_200, "2024-03-01"),
            (4_107_542_399, "2100-02-28"),
            (4_107_542_400, "2100-03-01"),
        ] {
            assert_eq!(super::of(seconds * 1_000_000), day);
            assert_eq!(super::begin(day), Some(i64::div_euclid(seconds, 86_400) * super::DAY_US));
        }
    }

    #[test]
    fn fault_what_is_no_day_has_no_begin() {
        for text in ["", "2026", "2026-13-01", "2026-02-29", "2026-2-3", "2026-02-03x", "m"] {
            assert_eq!(super::begin(text), None, "{text}");
        }
    }
}
