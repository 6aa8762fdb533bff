//! Units as files write them: the quantity, and the factor to the unit that a record keeps it in.
//!
//! Prefixes are told by their case (`mg` is not `Mg`), the rest is not. What is not in the table is unknown, never
//! assumed. A unit stands in brackets behind a name (`Ax [g]`, `Time (ms)`), in a row of its own, or in an attribute.
//! Single letters behind an underscore are no units: `acc_g` is as often the gear's accelerometer.

use serde::Serialize;

/// Standard acceleration of gravity, m/s2.
pub const GRAVITY: f64 = 9.80665;

/// What a channel holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Quantity {
    /// The quantity of a record's channels.
    Acceleration,
    /// Of vibration.
    Velocity,
    /// Of vibration, or a position.
    Displacement,
    /// Newtons.
    Force,
    /// Newton metres.
    Torque,
    /// Sound pressure, too.
    Pressure,
    /// Volts of a sensor whose sensitivity is not stated.
    Voltage,
    /// Amperes.
    Current,
    /// Degrees Celsius.
    Temperature,
    /// Of a shaft.
    Speed,
    /// Of a shaft, in degrees.
    Angle,
    /// Hertz.
    Frequency,
    /// Watts.
    Power,
    /// Coulombs.
    Charge,
    /// Amounts per time: of oil, of air.
    Flow,
    /// Length over length.
    Strain,
    /// Seconds.
    Time,
    /// Codes of a converter, counts of an encoder, numbers of rows.
    Count,
}

/// A unit: value in the record = `factor * number + offset`, in `symbol`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measure {
    /// What is measured.
    pub quantity: Quantity,
    /// Factor to the record's unit.
    pub factor: f64,
    /// Added behind the factor.
    pub offset: f64,
    /// The record's unit.
    pub symbol: &'static str,
}

/// Feet per metre and its like.
const INCH: f64 = 0.0254;
const FOOT: f64 = 0.3048;
const POUND_FORCE: f64 = 4.448_221_615_260_5;

/// Factor and plain unit by what stands in the file, in lower case, without blanks, `^`, `*` and dots.
#[rustfmt::skip]
const PLAIN_UNITS: &[(&[&str], Quantity, f64, f64, &str)] = {
    use Quantity::*;
    &[
        (&["m/s2", "m/s/s", "ms-2", "mps2", "m/sec2", "m/sec/sec", "meter/second2", "meters/second2",
            "metre/second2", "metres/second2",
           "meterspersecondsquared", "meterpersecondsquared", "metrespersecondsquared", "meters/sec2", "m_s2",
               "meterpersquaresecond"],
         Acceleration, 1.0, 0.0, "m/s2"),
        (&["g", "gn", "g0", "gs", "gee", "gees", "g's", "gravity", "gravities", "standardgravity", "grms", "gpk",
            "gpeak", "g-force", "gforce"],
         Acceleration, GRAVITY, 0.0, "m/s2"),
        (&["milli-g", "millig", "milligs", "milligee"], Acceleration, 1e-3 * GRAVITY, 0.0, "m/s2"),
        (&["micro-g", "microg"], Acceleration, 1e-6 * GRAVITY, 0.0, "m/s2"),
        (&["gal", "cm/s2"], Acceleration, 0.01, 0.0, "m/s2"),
        (&["mm/s2", "mm/s/s", "mms-2", "mm/sec2", "millimeter/second2"], Acceleration, 1e-3, 0.0, "m/s2"),
        (&["um/s2", "um/s/s"], Acceleration, 1e-6, 0.0, "m/s2"),
        (&["in/s2", "in/s/s", "in/sec2", "inch/s2", "inches/s2", "ips2"], Acceleration, INCH, 0.0, "m/s2"),
        (&["ft/s2", "ft/s/s", "ft/sec2", "feet/s2"], Acceleration, FOOT, 0.0, "m/s2"),
        (&["m/s", "m/sec", "ms-1", "meter/second"], Velocity, 1.0, 0.0, "m/s"),
        (&["mm/s", "mm/sec", "mms-1", "mm/srms"], Velocity, 1e-3, 0.0, "m/s"),
        (&["um/s", "um/sec"], Velocity, 1e-6, 0.0, "m/s"),
        (&["in/s", "in/sec", "ips", "inch/s"], Velocity, INCH, 0.0, "m/s"),
        (&["ft/s"], Velocity, FOOT, 0.0, "m/s"),
        (&["km/h", "kmh", "kph"], Velocity, 1.0 / 3.6, 0.0, "m/s"),
        (&["m/min"], Velocity, 1.0 / 60.0, 0.0, "m/s"),
        (&["mm/min"], Velocity, 1e-3 / 60.0, 0.0, "m/s"),
        (&["m", "meter", "meters", "metre", "metres"], Displacement, 1.0, 0.0, "m"),
        (&["cm"], Displacement, 0.01, 0.0, "m"),
        (&["mm", "millimeter", "millimeters"], Displacement, 1e-3, 0.0, "m"),
        (&["um", "micron", "microns", "micrometer", "mic"], Displacement, 1e-6, 0.0, "m"),
        (&["nm_length"], Displacement, 1e-9, 0.0, "m"),
        (&["mil", "mils"], Displacement, 1e-3 * INCH, 0.0, "m"),
        (&["in", "inch", "inches"], Displacement, INCH, 0.0, "m"),
        (&["ft", "foot", "feet"], Displacement, FOOT, 0.0, "m"),
        (&["n", "newton", "newtons"], Force, 1.0, 0.0, "N"),
        (&["kn"], Force, 1e3, 0.0, "N"),
        (&["lbf", "lb", "lbs"], Force, POUND_FORCE, 0.0, "N"),
        (&["kgf"], Force, GRAVITY, 0.0, "N"),
        (&["nm", "n-m", "newtonmeter", "newtonmeters", "newtonmetre", "newton-meter", "n_m"], Torque, 1.0, 0.0, "N m"),
        (&["mnm"], Torque, 1e-3, 0.0, "N m"),
        (&["ncm"], Torque, 1e-2, 0.0, "N m"),
        (&["knm"], Torque, 1e3, 0.0, "N m"),
        (&["lbfft", "lbf-ft", "ft-lb", "ftlb", "lb-ft", "lbft", "ft-lbf", "ftlbf"], Torque, POUND_FORCE * FOOT, 0.0,
            "N m"),
        (&["lbfin", "lbf-in", "in-lb", "inlb", "lb-in", "lbin", "in-lbf"], Torque, POUND_FORCE * INCH, 0.0, "N m"),
        (&["pa", "pascal", "pascals"], Pressure, 1.0, 0.0, "Pa"),
        (&["hpa", "mbar"], Pressure, 100.0, 0.0, "Pa"),
        (&["kpa"], Pressure, 1e3, 0.0, "Pa"),
        (&["bar"], Pressure, 1e5, 0.0, "Pa"),
        (&["psi"], Pressure, 6_894.757_293_168, 0.0, "Pa"),
        (&["v", "volt", "volts", "voltage", "vdc"], Voltage, 1.0, 0.0, "V"),
        (&["millivolt", "millivolts"], Voltage, 1e-3, 0.0, "V"),
        (&["a", "amp", "amps", "ampere", "amperes"], Current, 1.0, 0.0, "A"),
        (&["degc", "c", "celsius", "deg_c", "degreec", "degreescelsius", "degreecelsius"], Temperature, 1.0, 0.0,
            "degC"),
        (&["k", "kelvin", "degk"], Temperature, 1.0, -273.15, "degC"),
        (&["degf", "f", "fahrenheit"], Temperature, 5.0 / 9.0, -32.0 * 5.0 / 9.0, "degC"),
        (&["rpm", "1/min", "r/min", "min-1", "rev/min", "u/min", "/min", "revolutionsperminute"], Speed, 1.0, 0.0,
            "rpm"),
        (&["krpm"], Speed, 1e3, 0.0, "rpm"),
        (&["rps", "rev/s", "r/s", "turns/s", "1/s_speed"], Speed, 60.0, 0.0, "rpm"),
        (&["rad/s", "rad/sec", "rads-1"], Speed, 30.0 / std::f64::consts::PI, 0.0, "rpm"),
        (&["deg/s", "deg/sec", "dps"], Speed, 1.0 / 6.0, 0.0, "rpm"),
        (&["deg", "degree", "degrees", "grad"], Angle, 1.0, 0.0, "deg"),
        (&["rad", "radian", "radians"], Angle, 180.0 / std::f64::consts::PI, 0.0, "deg"),
        (&["rev", "revs", "turn", "turns", "revolution", "revolutions"], Angle, 360.0, 0.0, "deg"),
        (&["hz", "hertz", "1/s"], Frequency, 1.0, 0.0, "Hz"),
        (&["khz"], Frequency, 1e3, 0.0, "Hz"),
        (&["w", "watt", "watts"], Power, 1.0, 0.0, "W"),
        (&["kw"], Power, 1e3, 0.0, "W"),
        (&["pc"], Charge, 1e-12, 0.0, "C"),
        (&["l/min", "lpm"], Flow, 1.0, 0.0, "l/min"),
        (&["l/s"], Flow, 60.0, 0.0, "l/min"),
        (&["l/h"], Flow, 1.0 / 60.0, 0.0, "l/min"),
        (&["m3/h"], Flow, 1000.0 / 60.0, 0.0, "l/min"),
        (&["ue", "ustrain", "microstrain", "um/m", "usn"], Strain, 1e-6, 0.0, "m/m"),
        (&["strain", "m/m"], Strain, 1.0, 0.0, "m/m"),
        (&["s", "sec", "secs", "second", "seconds"], Time, 1.0, 0.0, "s"),
        (&["ms", "msec", "msecs", "millis", "millisecond", "milliseconds"], Time, 1e-3, 0.0, "s"),
        (&["us", "usec", "usecs", "micros", "microsecond", "microseconds"], Time, 1e-6, 0.0, "s"),
        (&["ns", "nsec", "nanos", "nanosecond", "nanoseconds"], Time, 1e-9, 0.0, "s"),
        (&["min", "mins", "minute", "minutes"], Time, 60.0, 0.0, "s"),
        (&["h", "hr", "hrs", "hour", "hours"], Time, 3600.0, 0.0, "s"),
        (&["d", "day", "days"], Time, 86_400.0, 0.0, "s"),
        (&["count", "counts", "cnt", "lsb", "raw", "digits", "code", "codes", "adc", "adccounts", "ticks"], Count,
            1.0, 0.0, "counts"),
    ]
};

/// What only its case tells from another unit.
#[rustfmt::skip]
const CASE_UNITS: &[(&str, Quantity, f64, &str)] = {
    use Quantity::*;
    &[
        ("mg", Acceleration, 1e-3 * GRAVITY, "m/s2"), ("mG", Acceleration, 1e-3 * GRAVITY, "m/s2"), ("ug",
            Acceleration, 1e-6 * GRAVITY, "m/s2"),
        ("kg", Force, f64::NAN, ""), ("mV", Voltage, 1e-3, "V"), ("uV", Voltage, 1e-6, "V"), ("mA", Current, 1e-3,
            "A"), ("mPa", Pressure, 1e-3, "Pa"),
        ("MPa", Pressure, 1e6, "Pa"), ("uPa", Pressure, 1e-6, "Pa"), ("mN", Force, 1e-3, "N"), ("MG", Acceleration,
            1e-3 * GRAVITY, "m/s2"),
        ("mW", Power, 1e-3, "W"), ("MW", Power, 1e6, "W"),
    ]
};

/// The unit that `text` is; `None` for what is no unit of the table.
pub fn measure(text: &str) -> Option<Measure> {
    let plain = plain(text);
    let by_case = CASE_UNITS.iter().find(|row| row.0 == plain && row.2.is_finite());
    if let Some(&(_, quantity, factor, symbol)) = by_case {
        return Some(Measure { quantity, factor, offset: 0.0, symbol });
    }
    // Nanometres and newton metres: only the case tells them, and shafts have torques.
    let lower = if plain == "nm" { "nm_length".to_owned() } else { plain.to_lowercase() };
    PLAIN_UNITS
        .iter()
        .find(|row| row.0.contains(&lower.as_str()))
        .map(|&(_, quantity, factor, offset, symbol)| Measure { quantity, factor, offset, symbol })
}

/// Whether a stated unit says nothing.
pub fn is_empty(text: &str) -> bool {
    let text = text.trim().trim_matches(['[', ']', '(', ')']).trim().to_lowercase();
    text.is_empty()
        || ["none", "-", "--", "n/a", "na", "eu", "unit", "units", "unknown", "null", "1", "?"].contains(&text.as_str())
}

/// One spelling of what differs in signs alone.
fn plain(text: &str) -> String {
    let text = text.trim().trim_start_matches(['[', '(', '<', '{']).trim_end_matches([']', ')', '>', '}']).trim();
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '\u{b5}' | '\u{3bc}' => out.push('u'),
            '\u{b0}' => out.push_str("deg"),
            '\u{b2}' => out.push('2'),
            '\u{207b}' | '\u{2212}' => out.push('-'),
            '\u{b9}' => out.push('1'),
            ' ' | '^' | '*' | '\u{b7}' | '\u{22c5}' | '.' | '(' | ')' | '_' if !out.is_empty() => {}
            _ if c.is_whitespace() => {}
            _ => out.push(c),
        }
    }
    out.replace("/s-2", "/s2").replace("ms(-2)", "ms-2")
}

/// A name and the unit written behind it in brackets, or behind an underscore or a blank where that can be no word.
pub fn of_name(name: &str) -> Option<(String, String)> {
    let name = name.trim();
    for (open, close) in [('[', ']'), ('(', ')'), ('{', '}'), ('<', '>')] {
        let Some(inner) = name.strip_suffix(close) else { continue };
        let Some((before, unit)) = inner.rsplit_once(open) else { continue };
        let nested = open == '(' && unit.contains(')');
        let before = before.trim().trim_end_matches(['_', '-', '/']).trim();
        // `A(1)` and `A(2)` are names.
        let says_none = is_empty(unit) && unit.trim() != "1";
        if !nested && !before.is_empty() && (measure(unit).is_some() || says_none) {
            return Some((before.to_owned(), unit.trim().to_owned()));
        }
    }
    // A bracket that encloses brackets: `m/(s2)`. A stroke within a bracket is the unit's: `Wind (km/h)` has no hours.
    let outside = |(before, unit): &(&str, &str)| measure(unit).is_some() && !is_inside_bracket(before);
    if let Some((before, unit)) = name.split_once([',', '/']).filter(outside) {
        if let Some((word, top)) = amount(before, unit) {
            let whole = format!("{top}/{}", unit.trim());
            return measure(&whole).map(|_| (word.to_owned(), whole));
        }
        let before = before.trim();
        // `mm/s` is a unit and no name with one.
        if before.chars().count() > 2 && measure(before).is_none() && measure(name).is_none() {
            return Some((before.to_owned(), unit.trim().to_owned()));
        }
    }
    const SUFFIXES: [&str; 18] = [
        "mg", "ms2", "m_s2", "mps2", "m/s2", "m/s^2", "mm/s2", "rpm", "nm", "degc", "kpa", "pa", "mv", "hz", "volts",
        "volt", "celsius", "newton",
    ];
    let lower = name.to_lowercase();
    SUFFIXES.iter().find_map(|unit| {
        let before = lower.strip_suffix(unit)?;
        let cut = before.strip_suffix(['_', ' '])?;
        let word = if *unit == "ms2" {
            "m/s2"
        } else if *unit == "nm" {
            "Nm"
        } else {
            unit
        };
        (!cut.is_empty()).then(|| (name[..cut.len()].trim_end_matches(['_', ' ']).to_owned(), word.to_owned()))
    })
}

/// Times that amounts are stated per, by their case: `(N/S)` is north and south.
const TIME_UNITS: [&str; 5] = ["s", "sec", "min", "h", "hr"];

/// Whether a bracket is open at the end of a text.
fn is_inside_bracket(before: &str) -> bool {
    let count = |signs: [char; 4]| before.chars().filter(|c| signs.contains(c)).count();
    count(['(', '[', '{', '<']) > count([')', ']', '}', '>'])
}

/// Name and amount of `Wind km/h`, where what stands before the stroke is of the unit.
fn amount<'a>(before: &'a str, unit: &str) -> Option<(&'a str, &'a str)> {
    let (name, top) = before.rsplit_once(' ')?;
    let glued = !top.is_empty() && top.chars().count() <= 3 && !unit.starts_with(' ');
    (glued && TIME_UNITS.contains(&unit.trim())).then(|| (name.trim(), top))
}

/// An amount per time in brackets, whether the table holds it or not: `Feed (kg/h)`.
fn is_per_time(name: &str) -> bool {
    let inner = name.trim().strip_suffix([')', ']', '}', '>']).and_then(|name| name.rsplit_once(['(', '[', '{', '<']));
    let parts = inner.and_then(|(_, unit)| unit.split_once('/'));
    parts.is_some_and(|(amount, time)| !amount.trim().is_empty() && TIME_UNITS.contains(&time.trim()))
}

/// What words of a name say where no unit is stated; only whole words count.
pub fn quantity_of_name(name: &str) -> Option<Quantity> {
    use Quantity::*;
    const WORDS: &[(&[&str], Quantity)] = &[
        (&["torque", "drehmoment", "torsion", "couple", "moment"], Torque),
        (&["temperature", "temperatur", "temp", "temps", "thermocouple", "thermo"], Temperature),
        (&["rpm", "drehzahl", "speed", "rotationalspeed", "shaftspeed"], Speed),
        (&["pressure", "microphone", "mic", "sound", "noise", "acoustic", "druck"], Pressure),
        (&["current", "strom"], Current),
        (&["voltage", "spannung"], Voltage),
        (&["force", "kraft", "loadcell"], Force),
        (&["displacement", "proximity", "prox", "gap"], Displacement),
        (&["velocity", "velo"], Velocity),
        (&["angle", "winkel", "theta", "azimuth"], Angle),
        (&["encoder", "counter", "count", "counts", "index", "sampleindex", "samplenumber", "samples"], Count),
        (&["humidity", "latitude", "longitude"], Count),
        (&["power", "leistung"], Power),
        (&["strain"], Strain),
    ];
    let words = words(name);
    let is_acceleration =
        |word: &String| ["acc", "accel", "vib"].iter().any(|start| word.starts_with(start)) || word == "beschleunigung";
    if words.iter().any(is_acceleration) {
        return Some(Acceleration);
    }
    let said = WORDS.iter().find(|row| words.iter().any(|word| row.0.contains(&word.as_str()))).map(|row| row.1);
    said.or_else(|| is_per_time(name).then_some(Flow))
}

/// The words of a name in lower case: split at signs, at blanks, and where a capital letter follows a small one.
pub fn words(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut small = false;
    for c in name.chars() {
        let capital = c.is_uppercase();
        if !c.is_alphanumeric() || (capital && small) {
            words.push(String::new());
        }
        if c.is_alphanumeric() {
            words.last_mut().into_iter().for_each(|word| word.extend(c.to_lowercase()));
        }
        small = c.is_lowercase();
    }
    words.retain(|word| !word.is_empty());
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    fn factor(text: &str) -> (Quantity, f64) {
        let found = measure(text).unwrap_or_else(|| panic!("{text} is a unit"));
        (found.quantity, found.factor)
    }

    #[test]
    fn theory_units_are_told_as_people_write_them() {
        for text in [
            "m/s2",
            "m/s^2",
            "[m/s\u{b2}]",
            "m/s**2",
            "(m/s^2)",
            "m s^-2",
            "m\u{b7}s\u{207b}\u{b2}",
            "ms^-2",
            "M/S2",
            "m/sec^2",
        ] {
            assert_eq!(factor(text), (Quantity::Acceleration, 1.0), "{text}");
        }
        assert_eq!(factor("g"), (Quantity::Acceleration, GRAVITY));
        assert_eq!(factor("mg"), (Quantity::Acceleration, 1e-3 * GRAVITY));
        assert_eq!(factor("mm/s^2"), (Quantity::Acceleration, 1e-3));
        assert_eq!(factor("mm/s"), (Quantity::Velocity, 1e-3));
        assert_eq!(factor("N\u{b7}m"), (Quantity::Torque, 1.0));
        assert_eq!(factor("Nm"), (Quantity::Torque, 1.0));
        assert_eq!(factor("nm"), (Quantity::Displacement, 1e-9));
        assert_eq!(factor("MPa"), (Quantity::Pressure, 1e6));
        assert_eq!(factor("mV"), (Quantity::Voltage, 1e-3));
        assert_eq!(factor("\u{b5}s"), (Quantity::Time, 1e-6));
        assert_eq!(factor("1/min"), (Quantity::Speed, 1.0));
        assert_eq!(measure("furlong"), None);
        assert_eq!(measure("kg"), None);
    }

    #[test]
    fn theory_units_behind_names_are_told_from_parts_of_names() {
        let pair = |a: &str, b: &str| Some((a.to_owned(), b.to_owned()));
        assert_eq!(of_name("Ax [g]"), pair("Ax", "g"));
        assert_eq!(of_name("Time (ms)"), pair("Time", "ms"));
        assert_eq!(of_name("acc_mg"), pair("acc", "mg"));
        assert_eq!(of_name("acc_g"), None);
        assert_eq!(of_name("torque_Nm"), pair("torque", "Nm"));
        assert_eq!(of_name("Vib / g"), pair("Vib", "g"));
        assert_eq!(of_name("A(1)"), None);
        assert_eq!(of_name("pinion [left]"), None);
        assert_eq!(of_name("Wind (km/h)"), pair("Wind", "km/h"));
        assert_eq!(of_name("Oil (l/min)"), pair("Oil", "l/min"));
        assert_eq!(of_name("Feed (mm/min)"), pair("Feed", "mm/min"));
        assert_eq!(of_name("Air (kg/h)"), None);
        assert_eq!(quantity_of_name("Air (kg/h)"), Some(Quantity::Flow));
        assert_eq!(quantity_of_name("Side (N/S)"), None);
        assert_eq!(of_name("Wind km/h"), pair("Wind", "km/h"));
        assert_eq!(of_name("Vib 1 mm/s"), pair("Vib 1", "mm/s"));
        assert_eq!(of_name("Air kg/h"), None);
        assert_eq!(of_name("Zeit/s"), pair("Zeit", "s"));
        assert_eq!(of_name("Time, ms"), pair("Time", "ms"));
        assert_eq!(quantity_of_name("gearbox_vibration_x"), Some(Quantity::Acceleration));
        assert_eq!(quantity_of_name("Torque"), Some(Quantity::Torque));
        assert_eq!(quantity_of_name("X097_DE_time"), None);
        assert_eq!(quantity_of_name("A1"), None);
    }
}
