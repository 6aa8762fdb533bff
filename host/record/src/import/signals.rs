//! What a file holds, signal by signal, and which of its signals go together.
//!
//! Unit, rate and start belong to the signal that states them. Signals of one length, rate and start are the file's
//! channels; the others stay apart (a temperature once per second, a current at its own rate, edge times) and are
//! never laid beside them. Where more than one such set could be the vibration, the file is refused with the figures.

use super::{Columns, Reading, units};
use crate::part::Cut;
use crate::{Error, Result, text};
use std::path::Path;

/// Rates that agree to this share are one rate.
const SAME_RATE: f64 = 1e-6;
/// Starts that agree to this share of a sample are one start.
const SAME_START: f64 = 0.5;
/// Share of the length that signals of one rate and start may differ by: a logger stops somewhere.
const LENGTH_TOLERANCE_SHARE: f64 = 0.01;
/// Signals named in a remark.
const MAX_LISTED_SIGNALS: usize = 10;
/// Shortest signal that is kept apart with its values.
const MIN_SIGNAL_SAMPLES: usize = 2;

/// One recorded signal as its file gives it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Signal {
    /// Name for people.
    pub name: String,
    /// What the file itself calls it; absent where it gives no name. Only this says what a signal is.
    pub own: Option<String>,
    /// Group, structure or set that it lies in; empty at the top.
    pub folder: String,
    /// Values, with every scale and offset of the file applied.
    pub values: Vec<f64>,
    /// Unit as the file writes it.
    pub unit: Option<String>,
    /// Sampling rate, Hz, where it is stated for this signal.
    pub rate_hz: Option<f64>,
    /// First sample after the file's own zero, s.
    pub start_s: Option<f64>,
    /// The largest number that a source of integers can hold, in the numbers of `values`.
    pub largest: Option<f64>,
    /// Place in the file, from 1.
    pub number: usize,
}

impl Signal {
    /// A signal of which the file says the name.
    pub(super) fn new(name: impl Into<String>, values: Vec<f64>) -> Self {
        let name = name.into();
        Self { own: Some(name.clone()), name, values, ..Self::default() }
    }

    /// A signal without a name of its own, called after its file.
    pub(super) fn unnamed(name: impl Into<String>, values: Vec<f64>) -> Self {
        Self { name: name.into(), values, ..Self::default() }
    }

    /// Whether `wanted`, a number or a name, means this signal.
    pub(super) fn is_called(&self, wanted: &str) -> bool {
        if let Ok(number) = wanted.parse::<usize>() {
            return number == self.number;
        }
        let bare = units::of_name(wanted).map(|(name, _)| name);
        let inner = self.own.as_deref();
        let path = inner.filter(|_| !self.folder.is_empty()).map(|own| format!("{}/{own}", self.folder));
        let behind_stem = self.name.split_once(' ').map(|(_, variable)| variable);
        let names = [Some(self.name.as_str()), inner, path.as_deref(), behind_stem];
        [Some(wanted), bare.as_deref()].into_iter().flatten().any(|wanted| names.contains(&Some(wanted)))
    }

    /// Words of the file's own name.
    pub(super) fn words(&self) -> Vec<String> {
        units::words(self.own.as_deref().unwrap_or_default())
    }

    /// What it holds, by its unit or else by its name; `None` where neither says.
    pub fn quantity(&self) -> Option<units::Quantity> {
        let stated = self.unit.as_deref().filter(|unit| !units::is_empty(unit));
        let measured = stated.and_then(units::measure).map(|measure| measure.quantity);
        measured.or_else(|| units::quantity_of_name(self.own.as_deref()?))
    }

    /// Whether it may be an acceleration: not known to be anything else but volts.
    fn may_vibrate(&self) -> bool {
        use units::Quantity::{Acceleration, Voltage};
        self.quantity().is_none_or(|quantity| [Acceleration, Voltage].contains(&quantity))
    }
}

/// All signals of a file.
#[derive(Debug, Default)]
pub(super) struct Signals {
    pub signals: Vec<Signal>,
    /// Sampling rate that the file states for all of them, Hz.
    pub rate_hz: Option<f64>,
    /// What the reader did that the user should know.
    pub remarks: Vec<String>,
    /// Where they lie in the recording, where the reader took only a part.
    pub cut: Option<Cut>,
}

impl Signals {
    /// Numbers the signals, and takes units out of their names.
    pub fn prepare(&mut self) {
        const DIRECTIONS: [&str; 3] = ["(H)", "(V)", "(A)"];
        const OTHER_WORDS: [&str; 10] =
            ["time", "zeit", "elapsed", "tach", "tacho", "trigger", "voltage", "current", "spannung", "strom"];
        let ends = |signal: &Signal, sign: &str| {
            let named = signal.own.as_deref().is_some_and(|own| own.trim_end().ends_with(sign));
            named && !signal.words().iter().any(|word| OTHER_WORDS.contains(&word.as_str()))
        };
        // `Bearing 1 (H)` beside `Bearing 1 (V)` is a direction: neither holds hours, nor volts.
        let some = |sign: &str| self.signals.iter().any(|signal| ends(signal, sign));
        let directed = some("(H)") && some("(V)");
        let is_direction =
            |signal: &Signal| directed && DIRECTIONS.into_iter().any(|direction| ends(signal, direction));
        let directions: Vec<bool> = self.signals.iter().map(is_direction).collect();
        for (i, (signal, direction)) in self.signals.iter_mut().zip(directions).enumerate() {
            signal.number = i + 1;
            signal.name = text::name(&signal.name);
            signal.own = signal.own.as_deref().map(text::name);
            if signal.unit.as_deref().is_none_or(units::is_empty) {
                signal.unit = None;
                let own = signal.own.as_deref().filter(|_| !direction);
                if let Some((name, unit)) = own.and_then(units::of_name) {
                    if signal.own.as_deref() == Some(&signal.name) {
                        signal.name.clone_from(&name);
                    }
                    (signal.own, signal.unit) = (Some(name), Some(unit));
                }
            }
        }
    }

    fn rate_of(&self, signal: &Signal) -> Option<f64> {
        signal.rate_hz.or(self.rate_hz)
    }

    /// The channels, and what stays apart from them.
    ///
    /// # Errors
    /// No signal; several sets of signals that could be the channels.
    pub fn gather(mut self, path: &Path, reading: &Reading) -> Result<Columns> {
        self.cut_ends();
        let mut sets: Vec<Set> = Vec::new();
        for (i, signal) in self.signals.iter().enumerate() {
            let own = Set {
                samples: signal.values.len(),
                rate: self.rate_of(signal),
                start: signal.start_s,
                members: vec![i],
            };
            match sets.iter_mut().find(|set| set.holds(&own)) {
                Some(set) => set.members.push(i),
                None => sets.push(own),
            }
        }
        let chosen = self.chosen(path, &sets, reading)?;
        let rate_hz = sets[chosen].rate;
        let (mut main, mut apart) = (Vec::new(), Vec::new());
        let rates: Vec<Option<f64>> = self.signals.iter().map(|signal| self.rate_of(signal)).collect();
        for (i, mut signal) in std::mem::take(&mut self.signals).into_iter().enumerate() {
            signal.rate_hz = rates[i];
            if sets[chosen].members.contains(&i) { main.push(signal) } else { apart.push(signal) }
        }
        let said: Vec<String> = apart.iter().map(said).collect();
        if !said.is_empty() {
            let more = if said.len() > MAX_LISTED_SIGNALS {
                format!(" and {} more", said.len() - MAX_LISTED_SIGNALS)
            } else {
                String::new()
            };
            let list = said.iter().take(MAX_LISTED_SIGNALS).cloned().collect::<Vec<_>>().join(", ");
            self.remarks.push(format!("not of the channels' length, rate or start, and not channels: {list}{more}"));
        }
        apart.retain(|signal| signal.values.len() >= MIN_SIGNAL_SAMPLES);
        Ok(Columns {
            names: main.iter().map(|signal| signal.name.clone()).collect(),
            quantities: main.iter().map(Signal::quantity).collect(),
            units: main.iter().map(|signal| signal.unit.clone()).collect(),
            largest: main.first().and_then(|signal| signal.largest),
            start_s: main.first().and_then(|signal| signal.start_s),
            channels: main.into_iter().map(|signal| signal.values).collect(),
            rate_hz,
            apart,
            remarks: self.remarks,
            cut: self.cut,
        })
    }

    /// Cuts signals of one stated rate and start that end a little apart to the shortest of them.
    fn cut_ends(&mut self) {
        let longest = self.signals.iter().map(|signal| signal.values.len()).max().unwrap_or(0);
        let near = |signal: &Signal| signal.values.len() as f64 >= (1.0 - LENGTH_TOLERANCE_SHARE) * longest as f64;
        let members: Vec<usize> = (0..self.signals.len()).filter(|&i| near(&self.signals[i])).collect();
        let Some(&first) = members.first() else { return };
        let rate = self.rate_of(&self.signals[first]);
        let start = self.signals[first].start_s;
        let alike = |i: &usize| same(self.rate_of(&self.signals[*i]), rate) && self.signals[*i].start_s == start;
        let shortest = members.iter().map(|&i| self.signals[i].values.len()).min().unwrap_or(0);
        if rate.is_none() || shortest == longest || !members.iter().all(alike) {
            return;
        }
        self.remarks.push(format!("signals end up to {} samples apart; cut to the shortest", longest - shortest));
        members.iter().for_each(|&i| self.signals[i].values.truncate(shortest));
    }

    /// Index of the set that holds the channels.
    fn chosen(&self, path: &Path, sets: &[Set], reading: &Reading) -> Result<usize> {
        // The tachometer's number counts the signals that are left when time has gone.
        let is = |i: usize, source: &String| match source.parse::<usize>() {
            Ok(number) => number == i + 1,
            Err(_) => self.signals[i].is_called(source),
        };
        let tach = |i: &usize| reading.tach.iter().any(|source| is(*i, source));
        // Numbers that stand beside arrays say how they were made and are no signals.
        let longest = sets.iter().map(|set| set.samples).max().unwrap_or(0);
        let vibrates = |set: &Set| set.members.iter().any(|i| !tach(i) && self.signals[*i].may_vibrate());
        let of_rate = |set: &&Set| {
            set.samples >= MIN_SIGNAL_SAMPLES && vibrates(set) && (set.rate.is_some() || set.samples == longest)
        };
        let mut able: Vec<&Set> = sets.iter().filter(of_rate).collect();
        // Those that say that they are accelerations stand before those that say nothing.
        let said = |set: &Set| {
            set.members.iter().any(|i| !tach(i) && self.signals[*i].quantity() == Some(units::Quantity::Acceleration))
        };
        if able.iter().any(|set| said(set)) {
            able.retain(|set| said(set));
        }
        let at = |set: &Set| sets.iter().position(|other| other.members == set.members).unwrap_or(0);
        match able.as_slice() {
            [] => {
                let whole = sets.iter().filter(|set| !set.members.iter().all(tach));
                let longest = whole.max_by_key(|set| set.samples).or_else(|| sets.first());
                longest.map(at).ok_or_else(|| Error::invalid(path.display(), "holds no signal"))
            }
            [one] => Ok(at(one)),
            // Of one rate and start the longest are the channels; the others are said.
            [first, ..] if able.iter().all(|set| same(set.rate, first.rate) && set.starts_with(first)) => {
                let longest = able.iter().max_by_key(|set| set.samples).unwrap_or(first);
                Ok(at(longest))
            }
            several => {
                let list: Vec<String> = several.iter().map(|set| self.described(set)).collect();
                let what = format!(
                    "holds signals that are not sampled together: {}; choose with --columns, name a tachometer with \
                     --tach, or leave out with --skip",
                    list.join("; ")
                );
                Err(Error::invalid(path.display(), what))
            }
        }
    }

    fn described(&self, set: &Set) -> String {
        let names = set
            .members
            .iter()
            .take(MAX_LISTED_SIGNALS / 2)
            .map(|&i| self.signals[i].name.as_str())
            .collect::<Vec<_>>()
            .join(", ");
        let rate = set.rate.map_or("no stated rate".into(), |rate| format!("{} Hz", text::number(rate)));
        let start = set.start.filter(|start| *start != 0.0).map_or(String::new(), |start| format!(" from {start} s"));
        format!("{names}: {} samples at {rate}{start}", set.samples)
    }
}

fn said(signal: &Signal) -> String {
    let name = text::quoted(&signal.name);
    match (signal.values.as_slice(), signal.rate_hz) {
        ([value], _) => format!("{name} = {value}"),
        (values, None) => format!("{name} ({} values)", values.len()),
        (values, Some(rate)) => format!("{name} ({} values at {} Hz)", values.len(), text::number(rate)),
    }
}

/// Signals of one length, rate and start.
struct Set {
    samples: usize,
    rate: Option<f64>,
    start: Option<f64>,
    members: Vec<usize>,
}

impl Set {
    fn holds(&self, other: &Set) -> bool {
        self.samples == other.samples && same(self.rate, other.rate) && self.starts_with(other)
    }

    fn starts_with(&self, other: &Set) -> bool {
        let apart = (self.start.unwrap_or(0.0) - other.start.unwrap_or(0.0)).abs();
        apart <= self.rate.map_or(1e-9, |rate| SAME_START / rate)
    }
}

fn same(a: Option<f64>, b: Option<f64>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => (a / b - 1.0).abs() <= SAME_RATE,
        (None, None) => true,
        _ => false,
    }
}
