//! Time columns: which column is time, in which unit, and the sampling rate and start that it gives.
//!
//! Time is what ascends: a name that ends in `time` is not enough (`X097_DE_time` is an acceleration over time). A
//! counter of rows, an angle or an encoder's counts ascend as evenly and are no time. The unit is the name's
//! (`Time (ms)`), the unit row's, or that of the values where only one is possible (seconds since 1970, the rate
//! given with `--rate`); otherwise it is asked for. Time with gaps, repetitions or steps back is refused with the
//! place: every angle behind it would be wrong.

use super::Reading;
use super::signals::{Signal, Signals};
use super::stamps::{MIN_STAMPS, Stamps, look, rate_hz};
use super::units::{self, Quantity};
use crate::{Error, Result, text};
use std::path::Path;

/// Rates that vibration is sampled at, Hz: of stamps in seconds, and where the unit has to be found.
const SECONDS_HZ: std::ops::Range<f64> = 50.0..1e7;
const FOUND_HZ: std::ops::Range<f64> = 200.0..2e6;
/// A rate of `--rate` that stamps agree with, share.
const RATE_TOLERANCE_SHARE: f64 = 2e-3;
/// Share that a rate may be uncertain by without `--rate`.
const MAX_RATE_ERROR_SHARE: f64 = 1e-4;
/// Units of time, s, that stamps without one are tried for.
const UNITS: [(f64, &str); 7] =
    [(1.0, "s"), (1e-3, "ms"), (1e-6, "us"), (1e-9, "ns"), (60.0, "min"), (3600.0, "h"), (86_400.0, "days")];
/// Seconds since 1970 of the years 2001 to 2049.
const SINCE_1970: std::ops::Range<f64> = 1e9..2.5e9;
/// Days since 1900 of the years 1982 to 2064, as spreadsheets count.
const SINCE_1900: std::ops::Range<f64> = 3e4..6e4;
/// Share of equal steps of a counter.
const COUNTS: f64 = 0.95;

/// What a column is.
enum Kind {
    /// Time of this rate and start, and how well the rate is known.
    Time {
        rate_hz: f64,
        start_s: f64,
        uncertain: f64,
        remark: Option<String>,
    },
    /// A counter of rows, or time that says nothing beside `--rate`; the reason.
    Nothing(String),
    Channel,
}

/// Why a column that is time gives none.
enum Refusal {
    /// Gaps, repetitions, steps back.
    Broken(String),
    /// Its unit or its rate cannot be told.
    Unknown(String),
}

/// Takes the time columns out of the signals, and gives their rate and start to the signals of their length.
///
/// # Errors
/// Time that is not even, whose unit or rate cannot be told, or that contradicts the file.
pub(super) fn take(path: &Path, found: &mut Signals, reading: &Reading) -> Result<()> {
    let mut lengths: Vec<usize> = found.signals.iter().map(|signal| signal.values.len()).collect();
    lengths.sort_unstable();
    lengths.dedup();
    for length in lengths.into_iter().filter(|length| *length > 2) {
        let members: Vec<usize> =
            (0..found.signals.len()).filter(|&i| found.signals[i].values.len() == length).collect();
        if members.len() > 1 {
            of_length(path, found, &members, reading)?;
        }
    }
    // Marked by emptiness while the places were needed.
    let before = found.signals.len();
    found.signals.retain(|signal| !signal.values.is_empty());
    if before > 0 && found.signals.is_empty() {
        return Err(Error::invalid(path.display(), "holds time and no channel"));
    }
    Ok(())
}

fn of_length(path: &Path, found: &mut Signals, members: &[usize], reading: &Reading) -> Result<()> {
    let mut times: Vec<(usize, f64, f64, f64)> = Vec::new();
    let mut unknown: Vec<(usize, String)> = Vec::new();
    let called = |i: &usize| is_called_time(&found.signals[*i]);
    let mut order: Vec<usize> = members.to_vec();
    // What is called time speaks before what only looks like it.
    order.sort_by_key(|i| !called(i));
    for i in order {
        let signal = &found.signals[i];
        let known = times.iter().any(|time| found.signals[time.0].folder == signal.folder);
        let name = text::quoted(&signal.name);
        let kind = match kind(signal, reading, known) {
            Ok(kind) => kind,
            // Another column may give what this one cannot.
            Err(Refusal::Unknown(what)) => {
                unknown.push((i, what));
                continue;
            }
            Err(Refusal::Broken(what)) => return Err(Error::invalid(path.display(), what)),
        };
        match kind {
            Kind::Channel => {}
            Kind::Nothing(what) => {
                found.remarks.push(format!("column {name} {what}; it is no channel"));
                found.signals[i].values = Vec::new();
            }
            Kind::Time { rate_hz, start_s, uncertain, remark } => {
                let remark = remark.map_or(String::new(), |remark| format!(" ({remark})"));
                found.remarks.push(format!("column {name} is time at {rate_hz:.6} Hz{remark}"));
                times.push((i, rate_hz, start_s, uncertain));
            }
        }
    }
    let Some(&best) = times.iter().min_by(|a, b| a.3.total_cmp(&b.3)) else {
        return unknown.pop().map_or(Ok(()), |(_, what)| Err(Error::invalid(path.display(), what)));
    };
    for (i, _) in unknown {
        let name = text::quoted(&found.signals[i].name);
        found.remarks.push(format!("column {name} is time, too, but coarser; it is no channel"));
        found.signals[i].values = Vec::new();
    }
    for &i in members {
        if times.iter().any(|time| time.0 == i) {
            continue;
        }
        let own = times.iter().find(|time| found.signals[time.0].folder == found.signals[i].folder).unwrap_or(&best);
        let stated = found.signals[i].rate_hz.or(found.rate_hz);
        if let Some(other) = stated.filter(|other| (other / own.1 - 1.0).abs() > own.3.max(1e-4)) {
            let what = format!(
                "time column {} says {} Hz, the file {} Hz elsewhere; leave one out with --skip, or say which with \
                 --rate and --override-rate --no-time",
                text::quoted(&found.signals[own.0].name),
                text::number(own.1),
                text::number(other)
            );
            return Err(Error::invalid(path.display(), what));
        }
        found.signals[i].rate_hz = Some(own.1);
        found.signals[i].start_s = Some(own.2);
    }
    for time in &times {
        if (time.1 / best.1 - 1.0).abs() > (time.3 + best.3).max(1e-4)
            && found.signals[time.0].folder == found.signals[best.0].folder
        {
            let what = format!(
                "columns {} and {} are both time, at {} and {} Hz; leave one out with --skip",
                text::quoted(&found.signals[best.0].name),
                text::quoted(&found.signals[time.0].name),
                text::number(best.1),
                text::number(time.1)
            );
            return Err(Error::invalid(path.display(), what));
        }
    }
    times.iter().for_each(|time| found.signals[time.0].values = Vec::new());
    Ok(())
}

/// What a signal is; `known` where another column of its set has given the time.
fn kind(signal: &Signal, reading: &Reading, known: bool) -> std::result::Result<Kind, Refusal> {
    if reading.tach.iter().any(|source| source.parse::<usize>().is_err() && signal.is_called(source)) {
        return Ok(Kind::Channel);
    }
    let called = is_called_time(signal);
    let quantity = if called { None } else { signal.quantity() };
    let named_counter = is_called_counter(signal) && !called;
    let name = text::quoted(&signal.name);
    if named_counter || (!called && quantity.is_none()) {
        match counted(&signal.values) {
            Counter::Even => return Ok(Kind::Nothing("counts rows".into())),
            Counter::Jumps { index, missing } if named_counter => {
                return Err(Refusal::Broken(format!(
                    "counter {name} jumps at value {index}: {missing} samples are missing; cut the file there, or \
                     leave it out with --skip"
                )));
            }
            _ if named_counter => return Ok(Kind::Channel),
            _ => {}
        }
    }
    // A shaft's angle or speed ascends as evenly as time.
    if quantity.is_some_and(|quantity| quantity != Quantity::Time) {
        return Ok(Kind::Channel);
    }
    match look(&signal.values) {
        Stamps::Other if called && runs_backwards(&signal.values) => Err(Refusal::Broken(format!(
            "time column {name} runs backwards; turn the rows of the file around, or leave it out with --skip"
        ))),
        Stamps::Other => Ok(Kind::Channel),
        Stamps::Even { step, uncertain, coarse } => {
            if called
                && signal.unit.is_none()
                && unit_of_name(signal).is_none()
                && matches!(counted(&signal.values), Counter::Even)
                && known
            {
                return Ok(Kind::Nothing("counts rows".into()));
            }
            even(signal, reading, step, uncertain, coarse)
        }
        // A set whose time is stated or found needs no column for it.
        Stamps::Uneven { .. } if !called && (known || signal.rate_hz.is_some() || signal.values.len() < MIN_STAMPS) => {
            Ok(Kind::Channel)
        }
        Stamps::Uneven { mostly, .. } if !called && !mostly => Ok(Kind::Channel),
        Stamps::Uneven { jitter: true, .. } if called && reading.rate_hz.is_some() => {
            Ok(Kind::Nothing("has stamps that jitter; the rate is that of --rate".into()))
        }
        Stamps::Uneven { index, step, usual, jitter, .. } => {
            let missing = (step / usual).round() - 1.0;
            let what = if step <= 0.0 {
                if step == 0.0 { "the value before is repeated".to_owned() } else { "it turns back".to_owned() }
            } else if jitter {
                "its steps jitter; if the converter is even and the stamps are not, give --rate HZ".to_owned()
            } else if (1.0..1e9).contains(&missing) {
                format!("{missing} samples are missing")
            } else {
                "it does not go on evenly".into()
            };
            Err(Refusal::Broken(format!(
                "time column {name}: a step of {step:.4e} at value {index} where steps are {usual:.4e}, {what}; cut \
                 the file there, or give --no-time \
                 if it is a channel, --skip if it is of no use"
            )))
        }
    }
}

/// Whether stamps go on evenly from the last to the first.
fn runs_backwards(values: &[f64]) -> bool {
    let turned: Vec<f64> = values.iter().rev().copied().collect();
    matches!(look(&turned), Stamps::Even { .. })
}

/// Even stamps: their unit and rate.
fn even(
    signal: &Signal,
    reading: &Reading,
    step: f64,
    uncertain: f64,
    coarse: Option<f64>,
) -> std::result::Result<Kind, Refusal> {
    let name = text::quoted(&signal.name);
    let Some((unit_s, said)) = unit(signal, reading, step) else {
        let rate = 1.0 / step;
        return Err(Refusal::Unknown(format!(
            "column {name} is time and states no unit: {} Hz if it is in s, {} Hz if in ms, {} Hz if in us; give \
             --time-unit, or --no-time if it is no time",
            text::number(figures(rate)),
            text::number(figures(1e3 * rate)),
            text::number(figures(1e6 * rate))
        )));
    };
    let rate = rate_hz(step * unit_s, uncertain);
    let start_s = signal.values[0] * unit_s;
    let mut remarks: Vec<String> = said.into_iter().collect();
    if let Some(resolution) = coarse {
        let resolution_s = resolution * unit_s;
        match reading.rate_hz {
            Some(given) if (given / rate - 1.0).abs() < RATE_TOLERANCE_SHARE.max(uncertain) => {
                return Ok(Kind::Nothing(format!(
                    "has stamps to {resolution_s:.1e} s, too coarse for {given} Hz; the rate is that of --rate, gaps \
                     shorter than {:.0} samples cannot be seen",
                    resolution_s * given
                )));
            }
            _ if uncertain > MAX_RATE_ERROR_SHARE => {
                return Err(Refusal::Unknown(format!(
                    "time column {name} has stamps to {resolution_s:.1e} s: the rate lies between {} and {} Hz; give \
                     --rate HZ",
                    text::number(figures(rate * (1.0 - uncertain))),
                    text::number(figures(rate * (1.0 + uncertain)))
                )));
            }
            _ => remarks.push(format!(
                "stamps to {resolution_s:.1e} s, so gaps shorter than {:.0} samples cannot be seen",
                resolution_s * rate
            )),
        }
    }
    let remark = (!remarks.is_empty()).then(|| remarks.join("; "));
    Ok(Kind::Time { rate_hz: rate, start_s, uncertain, remark })
}

/// Seconds per unit of the stamps, with what was concluded; `None` where it has to be asked for.
fn unit(signal: &Signal, reading: &Reading, step: f64) -> Option<(f64, Option<String>)> {
    if let Some(unit_s) = reading.time_unit_s {
        return Some((unit_s, None));
    }
    let stated = signal.unit.as_deref().and_then(units::measure).filter(|unit| unit.quantity == Quantity::Time);
    if let Some(unit_s) = stated.map(|unit| unit.factor).or_else(|| unit_of_name(signal)) {
        return Some((unit_s, None));
    }
    let rate = |unit_s: f64| 1.0 / (step * unit_s);
    if let Some(given) = reading.rate_hz {
        let fits = UNITS.iter().find(|(unit_s, _)| (rate(*unit_s) / given - 1.0).abs() < RATE_TOLERANCE_SHARE);
        if let Some((unit_s, name)) = fits {
            return Some((*unit_s, (*unit_s != 1.0).then(|| format!("in {name}, by --rate"))));
        }
    }
    let first = signal.values[0];
    for (unit_s, name) in &UNITS[..4] {
        if SINCE_1970.contains(&(first * unit_s)) && SECONDS_HZ.contains(&rate(*unit_s)) {
            return Some((*unit_s, Some(format!("in {name} since 1970"))));
        }
    }
    if SECONDS_HZ.contains(&rate(1.0)) {
        return Some((1.0, None));
    }
    if SINCE_1900.contains(&first) && SECONDS_HZ.contains(&rate(86_400.0)) {
        return Some((86_400.0, Some("in days since 1900".into())));
    }
    let whole = step > 1.5 && signal.values.iter().all(|x| x.fract() == 0.0);
    let mut able = UNITS[1..4].iter().filter(|(unit_s, _)| FOUND_HZ.contains(&rate(*unit_s)));
    match (able.next(), able.next()) {
        (Some((unit_s, name)), None) if whole && is_called_time(signal) => {
            Some((*unit_s, Some(format!("states no unit and is taken for {name}; --time-unit if it is another"))))
        }
        _ => None,
    }
}

/// A frequency to six figures.
fn figures(hz: f64) -> f64 {
    format!("{hz:.5e}").parse().unwrap_or(hz)
}

/// A column of whole numbers.
enum Counter {
    Even,
    Jumps { index: usize, missing: f64 },
    No,
}

fn counted(values: &[f64]) -> Counter {
    if values.len() < 3 || values.iter().any(|x| x.fract() != 0.0) {
        return Counter::No;
    }
    let steps = || values.windows(2).map(|w| w[1] - w[0]);
    let ones = steps().filter(|step| *step == 1.0).count();
    match steps().enumerate().find(|(_, step)| *step > 1.0) {
        _ if ones == values.len() - 1 => Counter::Even,
        // A counter that begins again (a packet's) is one; what it counts is whole.
        None if ones as f64 > COUNTS * values.len() as f64 => Counter::Even,
        Some((at, step)) if ones as f64 > COUNTS * values.len() as f64 => {
            Counter::Jumps { index: at + 2, missing: step - 1.0 }
        }
        _ => Counter::No,
    }
}

/// Whether a signal's name or unit says time.
pub(super) fn is_called_time(signal: &Signal) -> bool {
    let unit = signal.unit.as_deref().and_then(units::measure);
    if unit.is_some_and(|unit| unit.quantity == Quantity::Time) {
        return true;
    }
    const TIME: [&str; 17] = [
        "t",
        "time",
        "times",
        "timestamp",
        "timestamps",
        "zeit",
        "temps",
        "tiempo",
        "tempo",
        "elapsed",
        "date",
        "datetime",
        "clock",
        "millis",
        "micros",
        "nanos",
        "uptime",
    ];
    const UNIT: [&str; 12] =
        ["s", "sec", "secs", "seconds", "ms", "us", "ns", "msec", "usec", "milliseconds", "microseconds", "min"];
    let words = signal.words();
    let named = words.iter().any(|word| TIME.contains(&word.as_str()));
    // `X_Value` is what LabVIEW calls its time; a column called by its unit alone is time.
    named || words == ["x", "value"] || (words.len() == 1 && UNIT[1..].contains(&words[0].as_str()))
}

/// Seconds per unit that a name states behind an underscore or a blank.
fn unit_of_name(signal: &Signal) -> Option<f64> {
    let words = signal.words();
    let last = words.last()?;
    let whole = ["millis", "micros", "nanos"].contains(&last.as_str());
    (words.len() > 1 || whole || last.len() > 1)
        .then(|| units::measure(last))
        .flatten()
        .filter(|unit| unit.quantity == Quantity::Time && last != "d" && last != "h")
        .map(|unit| unit.factor)
}

fn is_called_counter(signal: &Signal) -> bool {
    const COUNTERS: [&str; 22] = [
        "index",
        "idx",
        "sample",
        "samples",
        "n",
        "no",
        "nr",
        "num",
        "number",
        "count",
        "counter",
        "row",
        "id",
        "record",
        "packet",
        "seq",
        "sequence",
        "frame",
        "unnamed",
        "point",
        "sampleindex",
        "i",
    ];
    let words = signal.words();
    signal.own.is_some()
        && (words.is_empty()
            || words.iter().all(|word| COUNTERS.contains(&word.as_str()) || word.parse::<u32>().is_ok()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn signal(name: &str, step: f64) -> Signal {
        Signal::new(name, (0..2000).map(|i| f64::from(i) * step).collect())
    }

    fn rate(name: &str, step: f64, rate_hz: Option<f64>) -> Option<f64> {
        let reading = Reading { rate_hz, ..Reading::default() };
        match kind(&signal(name, step), &reading, false) {
            Ok(Kind::Time { rate_hz, .. }) => Some(rate_hz),
            _ => None,
        }
    }

    #[test]
    fn theory_the_unit_of_time_is_stated_or_asked_for() {
        let step = 1.0 / 12_800.0;
        for (name, unit) in
            [("t", 1.0), ("time_ms", 1e3), ("Time_us", 1e6), ("timestamp_ns", 1e9), ("micros", 1e6), ("time_s", 1.0)]
        {
            assert_eq!(rate(name, step * unit, None), Some(12_800.0), "{name}");
        }
        assert_eq!(rate("time", 0.078125, None), None);
        assert_eq!(rate("time", 0.078125, Some(12_800.0)), Some(12_800.0));
        assert_eq!(rate("time", 100.0, None), Some(10_000.0));
        assert_eq!(rate("index", 1.0, None), None);
        assert_eq!(rate("angle", step, None), None);
        assert_eq!(rate("encoder", step, None), None);
    }
}
