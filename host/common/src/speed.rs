//! A speed as people write it: `24.75Hz`, `1485rpm`, or a bare number in the unit that the option names.
//!
//! Everything inside is in Hz (turns per second). A bare number that would be an unlikely speed of a shaft is asked
//! about: 1485 is mostly meant in turns per minute.

use std::fmt;
use std::str::FromStr;

/// Fastest shaft that a bare number in Hz is believed for, Hz: 6000 turns per minute. Faster ones are written with
/// their unit.
pub const MAX_BARE_HZ: f64 = 100.0;

/// Turns per second.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Speed(pub f64);

impl Speed {
    /// In turns per minute, for people.
    pub fn rpm(self) -> f64 {
        60.0 * self.0
    }
}

impl fmt::Display for Speed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} Hz ({:.0} rpm)", self.0, self.rpm())
    }
}

impl FromStr for Speed {
    type Err = String;

    /// A number with `Hz` or `rpm` behind it, or a bare one in Hz; any case, spaces allowed.
    fn from_str(text: &str) -> Result<Self, String> {
        let lower = text.trim().to_ascii_lowercase();
        let units = [("hz", 1.0), ("rpm", 60.0), ("/min", 60.0), ("1/s", 1.0)];
        let found = units.iter().find_map(|(unit, per)| Some((lower.strip_suffix(unit)?, Some(*per))));
        let (number, per) = found.unwrap_or((&lower, None));
        let value: f64 = number.trim().parse().map_err(|_| {
            format!("'{}' is no speed: a number with its unit, as 24.75Hz or 1485rpm", crate::text::name(text))
        })?;
        if !value.is_finite() {
            return Err("that is no finite speed".into());
        }
        if per.is_none() && value > MAX_BARE_HZ {
            let rpm = 60.0 * value;
            return Err(format!("{value} Hz would be {rpm} rpm: write {value}rpm, or {value}Hz where that is meant"));
        }
        Ok(Self(value / per.unwrap_or(1.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::Speed;

    #[test]
    fn ref_speeds_are_read_with_either_unit_and_doubtful_ones_are_asked_about() {
        for (text, hz) in
            [("24.75", 24.75), ("24.75Hz", 24.75), (" 1485 rpm", 24.75), ("1485RPM", 24.75), ("150hz", 150.0)]
        {
            assert_eq!(text.parse(), Ok(Speed(hz)), "{text}");
        }
        let asked = "1485".parse::<Speed>().expect_err("a motor's turns per minute");
        assert!(asked.contains("89100 rpm") && asked.contains("1485rpm"), "{asked}");
        assert!("fast".parse::<Speed>().is_err());
        assert!("9".repeat(400).parse::<Speed>().is_err(), "beyond any number");
        assert_eq!(Speed(24.75).to_string(), "24.75 Hz (1485 rpm)");
    }
}
