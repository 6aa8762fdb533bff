//! Alarm bands: a limit on one indicator inside a speed band, with hysteresis in level, in count and in time, and a
//! latch.
//!
//! An alarm is raised after `persistence` consecutive values beyond `raise`, over at least the holding's time, and
//! cleared after as many within `clear`; a latching one then still stands until it is acknowledged. What a value may do
//! is said with it ([`Use`]). Outside all bands of its quantity, and without a speed, the least strict one applies
//! ([`AlarmBand::applies`]): what exceeds the limit of every speed is an alarm whatever the speed is.

use crate::units::Hertz;
use serde::{Deserialize, Serialize};

/// What an alarm watches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Watched {
    /// Root mean square, m/s^2.
    Rms,
    /// Peak, m/s^2.
    Peak,
    /// Crest factor.
    Crest,
    /// Kurtosis (3 for Gaussian noise).
    Kurtosis,
    /// FM0.
    Fm0,
    /// FM4 of the difference signal.
    Fm4,
    /// Sideband energy ratio of the first mesh harmonic.
    SidebandEnergyRatio,
    /// Amplitude of the first mesh harmonic, m/s^2.
    MeshAmplitude,
    /// Measured over law bandwidth.
    BandwidthRatio,
    /// Root mean square of the velocity in its band, m/s.
    VelocityRms,
    /// Once per turn of the pinion, m/s^2.
    OncePerTurn,
    /// Largest departure from the expected levels, in its standard uncertainties ([`crate::levels`]).
    Departure,
    /// Root mean square at the second sensor, m/s^2.
    SecondRms,
    /// Peak at the second sensor, m/s^2.
    SecondPeak,
    /// Crest factor at the second sensor.
    SecondCrest,
    /// Kurtosis at the second sensor.
    SecondKurtosis,
    /// Root mean square of the velocity at the second sensor, m/s.
    SecondVelocityRms,
}

impl Watched {
    /// Whether every gear of a train has it.
    pub fn is_of_gear(self) -> bool {
        use Watched::{Fm0, Fm4, MeshAmplitude, SidebandEnergyRatio};
        matches!(self, Fm0 | Fm4 | SidebandEnergyRatio | MeshAmplitude)
    }

    /// Whether it is a value of the second sensor.
    pub fn is_of_second(self) -> bool {
        use Watched::{SecondCrest, SecondKurtosis, SecondPeak, SecondRms, SecondVelocityRms};
        matches!(self, SecondRms | SecondPeak | SecondCrest | SecondKurtosis | SecondVelocityRms)
    }
}

/// What a value may do to an alarm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Use {
    /// Raise and clear: it says what the machine does.
    Both,
    /// Raise only: of a part of what there was. It clears nothing.
    RaiseOnly,
    /// Raise only, and no limit at the low side: the true value is at least as large.
    LowerBound,
    /// Neither.
    Neither,
}

/// Which side of a limit is wrong.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Side {
    /// Above it.
    #[default]
    Above,
    /// Below it; `clear` is then at least `raise`.
    Below,
    /// A rise: the value less its own mean over the last minutes ([`RISE_S`]) is above it.
    Rise,
}

/// What an alarm asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Severity {
    /// The alarm output.
    #[default]
    Danger,
    /// To be told and shown, nothing else.
    Alert,
}

/// Side and severity of an alarm. The first values are those of configurations that knew nothing else.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct AlarmMode {
    /// Which side of the limit is wrong.
    pub side: Side,
    /// What the alarm asks for.
    pub severity: Severity,
}

impl AlarmMode {
    /// Of a list of modes, by an alarm's place; those behind its end are the first ones.
    pub fn of(modes: &[AlarmMode], index: usize) -> Self {
        modes.get(index).copied().unwrap_or_default()
    }
}

/// Time constant of the mean that a rise is measured against, s.
pub const RISE_S: f32 = 600.0;

/// One limit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AlarmBand {
    /// Indicator watched.
    pub watched: Watched,
    /// Lowest pinion rate at which the limit applies.
    pub from: Hertz,
    /// Highest pinion rate at which the limit applies.
    pub to: Hertz,
    /// Level that raises.
    pub raise: f32,
    /// Level that clears: at most `raise`, on the low side at least `raise`.
    pub clear: f32,
    /// Consecutive values needed, 1 to 255.
    pub persistence: u8,
}

impl AlarmBand {
    /// Whether the limit at a place of a list applies at a speed: its band contains it, or there is no such band of its
    /// quantity, gear, side and severity, and it is the least strict of them. `gears` are those of the alarms, 0 behind
    /// the list's end.
    pub fn applies(index: usize, speed: Option<Hertz>, all: &[AlarmBand], modes: &[AlarmMode], gears: &[u8]) -> bool {
        let gear = |index: usize| gears.get(index).copied().unwrap_or(0);
        let Some(band) = all.get(index) else { return false };
        let mode = AlarmMode::of(modes, index);
        let contains = |band: &AlarmBand| speed.is_some_and(|at| at.0 >= band.from.0 && at.0 <= band.to.0);
        if contains(band) {
            return true;
        }
        let alike = all.iter().enumerate();
        let mut alike = alike.filter(|&(n, other)| {
            other.watched == band.watched && gear(n) == gear(index) && AlarmMode::of(modes, n) == mode
        });
        alike.all(|(_, other)| {
            let as_strict =
                if mode.side == Side::Below { other.raise >= band.raise } else { other.raise <= band.raise };
            !contains(other) && as_strict
        })
    }

    /// Whether limits are finite and ordered.
    pub fn is_sane(&self, side: Side) -> bool {
        let speeds = self.from.0 >= 0.0 && self.from.0 < self.to.0 && self.to.0.is_finite();
        let ordered = if side == Side::Below { self.clear >= self.raise } else { self.clear <= self.raise };
        speeds && self.raise.is_finite() && self.clear.is_finite() && ordered && self.persistence > 0
    }
}

/// How all alarms are held.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AlarmHolding {
    /// An alarm that was raised stands until it is acknowledged, through restarts and power cuts too.
    pub latching: bool,
    /// A level must contradict the alarm for at least this long as well, s, 0 to 3600.
    pub persistence_s: f32,
    /// A sensor or signal that is not in order is an alarm of its own ([`crate::watch`]).
    pub watch_signal: bool,
}

impl Default for AlarmHolding {
    fn default() -> Self {
        Self { latching: false, persistence_s: 0.0, watch_signal: true }
    }
}

impl AlarmHolding {
    /// Whether the time is in its range.
    pub fn is_sane(&self) -> bool {
        (0.0..=3600.0).contains(&self.persistence_s)
    }
}

/// State of one alarm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    /// Left when values above the limit have persisted.
    #[default]
    Quiet,
    /// Left when values below the limit have persisted: to latched, or to quiet where alarms do not latch or it was
    /// acknowledged.
    Raised {
        /// Someone has seen it.
        acknowledged: bool,
    },
    /// The value is well again. Left by an acknowledgement, or to raised.
    Latched,
}

/// One alarm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Alarm {
    state: State,
    streak: u8,
    /// Tick of the first value of the streak.
    since: u64,
    /// Raised by a value whose speed was known.
    at_a_speed: bool,
    /// What a rise is measured against, and when it was followed last; at no tick yet.
    mean: f32,
    followed: u64,
}

/// A value put to a limit.
#[derive(Clone, Copy, Debug)]
pub struct Put {
    /// Tick of the value.
    pub tick: u64,
    /// The value, in the unit of its quantity.
    pub value: f32,
    /// What it may do.
    pub may: Use,
}

/// What a value or a person did to an alarm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AlarmChange {
    /// Now raised.
    Raised,
    /// No longer standing.
    Cleared,
}

impl Alarm {
    /// One that stood when the node last ran, and nobody has acknowledged.
    pub const LATCHED: Self =
        Self { state: State::Latched, streak: 0, since: 0, at_a_speed: false, mean: 0.0, followed: 0 };

    /// Feeds one value to which the band applies; `persistence_ticks` is the holding's time, `rise_ticks` that of
    /// [`RISE_S`]. Undefined values change nothing.
    pub fn update(
        &mut self,
        band: &AlarmBand,
        side: Side,
        holding: &AlarmHolding,
        [persistence_ticks, rise_ticks]: [u64; 2],
        put: Put,
    ) -> Option<AlarmChange> {
        if put.value.is_nan() || put.may == Use::Neither || (put.may == Use::LowerBound && side == Side::Below) {
            return None;
        }
        let value = if side == Side::Rise { self.rise(put, rise_ticks) } else { put.value };
        let raised = self.is_raised();
        let below = side == Side::Below;
        let contradicts = match (raised, below) {
            (true, false) => value < band.clear,
            (true, true) => value > band.clear,
            (false, false) => value > band.raise,
            (false, true) => value < band.raise,
        };
        // What may only raise is no evidence of health: it neither clears nor ends a row of values that raise.
        if put.may != Use::Both && contradicts == raised {
            return None;
        }
        if !contradicts {
            self.streak = 0;
            return None;
        }
        if self.streak == 0 {
            self.since = put.tick;
        }
        self.streak = self.streak.saturating_add(1);
        if self.streak < band.persistence || put.tick.saturating_sub(self.since) < persistence_ticks {
            return None;
        }
        self.streak = 0;
        let was_standing = self.stands();
        self.state = match self.state {
            State::Raised { acknowledged } if !holding.latching || acknowledged => State::Quiet,
            State::Raised { .. } => State::Latched,
            State::Quiet | State::Latched => State::Raised { acknowledged: false },
        };
        match (raised, self.stands()) {
            (true, true) => None,
            (true, false) => Some(AlarmChange::Cleared),
            (false, _) => (!was_standing).then_some(AlarmChange::Raised),
        }
    }

    /// The value less its mean over the last minutes; the first one is its own mean, and so is one after a pause as
    /// long.
    fn rise(&mut self, put: Put, rise_ticks: u64) -> f32 {
        let is_recent = self.followed > 0 && put.tick.saturating_sub(self.followed) < rise_ticks;
        let (mean, tick) = if is_recent { (self.mean, self.followed) } else { (put.value, put.tick) };
        let passed = put.tick.saturating_sub(tick) as f32;
        let mean = mean + (put.value - mean) * passed / (passed + rise_ticks.max(1) as f32);
        // The node counts from 2^32 on.
        (self.mean, self.followed) = (mean, put.tick.max(1));
        put.value - mean
    }

    /// A person has seen it.
    pub fn acknowledge(&mut self) -> Option<AlarmChange> {
        match self.state {
            State::Quiet => None,
            State::Raised { .. } => {
                self.state = State::Raised { acknowledged: true };
                None
            }
            State::Latched => {
                self.state = State::Quiet;
                Some(AlarmChange::Cleared)
            }
        }
    }

    /// Says whether the speed was known of the value that raised it.
    pub(crate) fn raised_by(&mut self, speed: Option<Hertz>) {
        self.at_a_speed = speed.is_some();
    }

    /// Whether a value can be put to it: one without a speed says nothing of what was wrong at a speed, which may
    /// have changed.
    pub(crate) fn can_judge(&self, speed: Option<Hertz>) -> bool {
        speed.is_some() || !(self.is_raised() && self.at_a_speed)
    }

    /// Whether the value is beyond its limit.
    pub fn is_raised(&self) -> bool {
        matches!(self.state, State::Raised { .. })
    }

    /// Whether the alarm stands: raised, or latched.
    pub fn stands(&self) -> bool {
        self.state != State::Quiet
    }

    /// Whether it stands and nobody has acknowledged it.
    pub fn is_unseen(&self) -> bool {
        matches!(self.state, State::Latched | State::Raised { acknowledged: false })
    }
}
