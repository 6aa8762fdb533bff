//! A clock spread over columns: hour, minute, second, microsecond (the bearing tests of PRONOSTIA write it so) as one
//! time.

use crate::import::signals::{Signal, Signals};

/// Rows that are looked at to tell a clock.
const PROBED_ROWS: usize = 5000;

/// Puts the columns of a clock together as one column of seconds.
pub(super) fn take(found: &mut Signals) {
    let Some(parts) = parts(&found.signals) else { return };
    let clock: Vec<&Signal> = found.signals.iter().take(parts.len()).collect();
    let rows = clock[0].values.len();
    let mut midnights = 0.0;
    let mut before = f64::NEG_INFINITY;
    let mut seconds = Vec::with_capacity(rows);
    for i in 0..rows {
        let day: f64 = clock.iter().zip(parts).map(|(signal, unit_s)| signal.values[i] * unit_s).sum();
        if day + midnights + 43_200.0 < before {
            midnights += 86_400.0;
        }
        before = day + midnights;
        seconds.push(before);
    }
    let mut time = Signal::new("time", seconds);
    time.unit = Some("s".into());
    let names: Vec<&str> = clock.iter().map(|signal| signal.name.as_str()).collect();
    found.remarks.push(format!("columns {} are the hours, minutes, seconds and parts of a clock", names.join(", ")));
    found.signals.splice(..parts.len(), [time]);
}

/// Seconds per unit of the clock's columns, where the first columns are those of a clock.
fn parts(signals: &[Signal]) -> Option<&'static [f64]> {
    let [hour, minute, second, part, _, ..] = signals else { return None };
    let whole = |signal: &Signal, most: f64| {
        signal.values.iter().take(PROBED_ROWS).all(|x| x.fract() == 0.0 && (0.0..most).contains(x))
    };
    let (from, to) = (part.values.first()?, part.values.get(1)?);
    let forward = part.values.windows(2).take(PROBED_ROWS).filter(|w| w[1] > w[0]).count();
    let moves = forward as f64 > 0.9 * part.values.len().min(PROBED_ROWS) as f64 - 1.0;
    // Names that only count the columns say nothing.
    let fits = |own: &String, word: &str| own.starts_with("column ") || own.to_lowercase().starts_with(word);
    let named = |signal: &Signal, word: &str| signal.own.as_ref().is_none_or(|own| fits(own, word));
    let are = whole(hour, 24.0) && whole(minute, 60.0) && whole(second, 60.0) && moves && from != to;
    if !are || !named(hour, "h") || !named(minute, "m") || !named(second, "s") {
        return None;
    }
    let most = part.values.iter().copied().fold(0.0, f64::max);
    let least = part.values.iter().copied().fold(f64::INFINITY, f64::min);
    match most {
        _ if least < 0.0 => None,
        ..1.0 => Some(&[3600.0, 60.0, 1.0, 1.0]),
        ..1e3 => Some(&[3600.0, 60.0, 1.0, 1e-3]),
        ..=1e6 => Some(&[3600.0, 60.0, 1.0, 1e-6]),
        _ => None,
    }
}
