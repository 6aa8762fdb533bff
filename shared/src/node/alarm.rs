//! Alarm bands: a limit on one indicator inside a speed band, with hysteresis in level, in count and in time, and a
//! latch.
//!
//! An alarm is raised after `persistence` consecutive values above `raise`, over at least the holding's time, and
//! cleared after as many below `clear`; a latching one then still stands until it is acknowledged. A value outside
//! the speed band leaves the alarm as it is: no evidence either way. Without a speed the least strict band of each
//! quantity applies ([`AlarmBand::applies`]): what exceeds the limit of every speed is an alarm whatever the speed
//! is.

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
    /// Whether it is a value of the second sensor.
    pub fn is_of_second(self) -> bool {
        use Watched::{SecondCrest, SecondKurtosis, SecondPeak, SecondRms, SecondVelocityRms};
        matches!(self, SecondRms | SecondPeak | SecondCrest | SecondKurtosis | SecondVelocityRms)
    }
}

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
    /// Level that clears, at most `raise`.
    pub clear: f32,
    /// Consecutive values needed, 1 to 255.
    pub persistence: u8,
}

impl AlarmBand {
    /// Whether the limit applies at a speed; without one, whether it is the least strict of its quantity in the list.
    pub fn applies(&self, speed: Option<Hertz>, all: &[AlarmBand]) -> bool {
        match speed {
            Some(speed) => speed.0 >= self.from.0 && speed.0 <= self.to.0,
            None => all.iter().all(|other| other.watched != self.watched || other.raise <= self.raise),
        }
    }

    /// Whether limits are finite and ordered.
    pub fn is_sane(&self) -> bool {
        let speeds = self.from.0 >= 0.0 && self.from.0 < self.to.0 && self.to.0.is_finite();
        let levels = self.raise.is_finite() && self.clear.is_finite() && self.clear <= self.raise;
        speeds && levels && self.persistence > 0
    }
}

/// How all alarms are held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AlarmHolding {
    /// An alarm that was raised stands until it is acknowledged, through restarts and power cuts too.
    pub latching: bool,
    /// A level must contradict the alarm for at least this long as well, s, 0 to 3600.
    pub persistence_s: f32,
    /// A signal that is clipped or does not move is an alarm of its own.
    pub watch_signal: bool,
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
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Alarm {
    state: State,
    streak: u8,
    /// Tick of the first value of the streak.
    since: u64,
    /// Raised by a value whose speed was known.
    at_a_speed: bool,
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
    pub const LATCHED: Self = Self { state: State::Latched, streak: 0, since: 0, at_a_speed: false };

    /// Feeds one value to which the band applies, at a tick; `persistence_ticks` is the holding's time. Undefined
    /// values change nothing.
    pub fn update(
        &mut self,
        band: &AlarmBand,
        holding: &AlarmHolding,
        persistence_ticks: u64,
        tick: u64,
        value: f32,
    ) -> Option<AlarmChange> {
        if value.is_nan() {
            return None;
        }
        let raised = matches!(self.state, State::Raised { .. });
        if !(if raised { value < band.clear } else { value > band.raise }) {
            self.streak = 0;
            return None;
        }
        if self.streak == 0 {
            self.since = tick;
        }
        self.streak = self.streak.saturating_add(1);
        if self.streak < band.persistence || tick.saturating_sub(self.since) < persistence_ticks {
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
