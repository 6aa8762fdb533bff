//! The watch: limits of all quantities, and the state of the sensor, from values and what they may do.
//!
//! Whoever makes a value says what it may do ([`use_of`]): raise and clear, raise only, or neither. One place puts it
//! to the limits. A limit of the whole signal to which nothing could be put for [`BLIND_S`] is as bad as a sensor that
//! is cut: the state of the sensor then says so, and with it the output. Nothing here knows of blocks, filters or the
//! link.
//!
//! The sensor has one state with several reasons ([`reason`]), held and latched as alarms are, after
//! [`SIGNAL_PERSISTENCE`] records. Practice of machinery protection: "not OK" of a transducer stands beside alert and
//! danger (API 670, section on circuit faults).

use crate::alarm::{Alarm, AlarmBand, AlarmChange, AlarmMode, Put, RISE_S, Severity, Side, Use, Watched};
use crate::config::{Configuration, MAX_ALARMS, OkOutput};
use crate::levels::Departure;
use crate::message::{AlarmState, Quality, SensorStatus};
use crate::units::{Hertz, TicksPerSecond};

/// Records in a row that change the state of the sensor.
pub const SIGNAL_PERSISTENCE: u8 = 3;
/// Time without a value that could raise a limit of the whole signal, s: three of the longest records.
pub const BLIND_S: f32 = 30.0;
/// Standard uncertainties that a level must lie below its expectation, beside the decibels, to be no signal.
const FAR_BELOW_SIGMA: f32 = 6.0;

/// Why a sensor is not in order, as bits.
pub mod reason {
    /// Codes of the first sensor were clipped.
    pub const CLIPPING: u16 = 1 << 0;
    /// The first sensor's signal did not move.
    pub const STANDSTILL: u16 = 1 << 1;
    /// Codes of the second sensor were clipped.
    pub const SECOND_CLIPPING: u16 = 1 << 2;
    /// The second sensor's signal did not move.
    pub const SECOND_STANDSTILL: u16 = 1 << 3;
    /// The bias at the sensor is out of its band.
    pub const BIAS: u16 = 1 << 4;
    /// The mean of the codes is out of its band.
    pub const MEAN: u16 = 1 << 5;
    /// The shaft turns, and the RMS is below the floor.
    pub const FLOOR: u16 = 1 << 6;
    /// The RMS is far below what is expected at this speed.
    pub const LEVEL_DROP: u16 = 1 << 7;
    /// A limit had nothing to judge for too long.
    pub const BLINDNESS: u16 = 1 << 8;
}

/// What a record shows of the sensors.
#[derive(Clone, Copy, Debug, Default)]
pub struct Evidence {
    /// Of the first sensor's record.
    pub quality: Quality,
    /// Of the second one's.
    pub second: Option<Quality>,
    /// Mean code of the first one.
    pub mean_code: f32,
    /// Root mean square of the first one, m/s^2.
    pub rms: f32,
    /// Its departure, where one is expected.
    pub departure: Option<Departure>,
    /// The tach has a locked speed.
    pub turns: bool,
    /// Bias at the board's input for it, V.
    pub bias_v: Option<f32>,
}

/// What the watch has decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    /// An alarm was raised or cleared.
    Alarm(u8, AlarmChange),
    /// The sensor is not in order, for these reasons.
    SensorBad(u16),
    /// It is in order again.
    SensorGood,
}

/// What an overall value may do, by what its record rests on; `starting`: the sensor or its filters had not settled
/// after a start.
pub fn use_of(watched: Watched, quality: &Quality, starting: bool) -> Use {
    use Watched::{Crest, Kurtosis, SecondCrest, SecondKurtosis, SecondVelocityRms, VelocityRms};
    let shape = matches!(watched, Crest | Kurtosis | SecondCrest | SecondKurtosis);
    let filtered = matches!(watched, VelocityRms | SecondVelocityRms);
    if starting || quality.stuck || (filtered && (quality.settling || quality.gap)) || (shape && quality.overload) {
        Use::Neither
    } else if quality.overload {
        // Clipping takes from RMS and peak.
        Use::LowerBound
    } else if quality.gap {
        // What a gap has swallowed is not known.
        Use::RaiseOnly
    } else {
        Use::Both
    }
}

/// All alarms and the state of the sensor.
#[derive(Clone, Debug)]
pub struct Watch {
    alarms: [Alarm; MAX_ALARMS],
    /// When a value could last have raised each.
    judged: [u64; MAX_ALARMS],
    sensor: Alarm,
    reasons: u16,
}

impl Watch {
    /// As a configuration left it: alarms that nobody had acknowledged stand. `tick`: from when on values are expected.
    pub fn new(config: &Configuration, tick: u64) -> Self {
        let latching = config.holding.latching;
        let alarms = core::array::from_fn(|index| {
            let kept = latching && index < config.alarms.len() && config.latched >> index & 1 != 0;
            if kept { Alarm::LATCHED } else { Alarm::default() }
        });
        let sensor = if latching && config.sensor_latched { Alarm::LATCHED } else { Alarm::default() };
        Self { alarms, judged: [tick; MAX_ALARMS], sensor, reasons: 0 }
    }

    /// Values are expected from a tick on: a start, a gain that settles.
    pub fn expect_from(&mut self, tick: u64) {
        self.judged = [tick; MAX_ALARMS];
    }

    /// Puts a value to the limits of its quantity and of the gear that it is of (0 the pinion, and whatever is of no
    /// gear); `speed` of the pinion where there is one to believe.
    pub fn put(
        &mut self,
        config: &Configuration,
        clock: TicksPerSecond,
        (watched, gear): (Watched, u8),
        speed: Option<Hertz>,
        put: Put,
        mut decided: impl FnMut(Decision),
    ) {
        let times = [config.holding.persistence_s, RISE_S].map(|seconds| (seconds * clock.0 as f32) as u64);
        for (index, band) in config.alarms.iter().enumerate() {
            let (Some(alarm), Some(judged)) = (self.alarms.get_mut(index), self.judged.get_mut(index)) else { return };
            if band.watched != watched || config.gear_of_alarm(index) != gear {
                continue;
            }
            let side = AlarmMode::of(&config.modes, index).side;
            if put.may != Use::Neither && !put.value.is_nan() {
                *judged = put.tick;
            }
            if !AlarmBand::applies(index, speed, &config.alarms, &config.modes, &config.alarm_gears)
                || !alarm.can_judge(speed)
            {
                continue;
            }
            let was_raised = alarm.is_raised();
            let change = alarm.update(band, side, &config.holding, times, put);
            if alarm.is_raised() && !was_raised {
                alarm.raised_by(speed);
            }
            if let Some(change) = change {
                decided(Decision::Alarm(index as u8, change));
            }
        }
    }

    /// What a record shows of the sensors.
    pub fn look_at(
        &mut self,
        config: &Configuration,
        clock: TicksPerSecond,
        tick: u64,
        evidence: &Evidence,
    ) -> Option<Decision> {
        let reasons = reasons(config, evidence) | self.blindness(config, clock, tick);
        self.follow_sensor(config, clock, tick, reasons)
    }

    /// Looks whether limits had nothing to judge, where no record came.
    pub fn look_for_blindness(&mut self, config: &Configuration, clock: TicksPerSecond, tick: u64) -> Option<Decision> {
        match self.blindness(config, clock, tick) {
            0 => None,
            blind => self.follow_sensor(config, clock, tick, self.reasons | blind),
        }
    }

    fn blindness(&self, config: &Configuration, clock: TicksPerSecond, tick: u64) -> u16 {
        let longest = (BLIND_S * clock.0 as f32) as u64;
        let mut limits = config.alarms.iter().zip(&self.judged);
        let is_blind =
            limits.any(|(band, &judged)| is_of_the_whole(band.watched) && tick.saturating_sub(judged) > longest);
        if is_blind { reason::BLINDNESS } else { 0 }
    }

    fn follow_sensor(
        &mut self,
        config: &Configuration,
        clock: TicksPerSecond,
        tick: u64,
        reasons: u16,
    ) -> Option<Decision> {
        const SENSOR_BAND: AlarmBand = AlarmBand {
            watched: Watched::Rms,
            from: Hertz(0.0),
            to: Hertz(1.0),
            raise: 0.5,
            clear: 0.5,
            persistence: SIGNAL_PERSISTENCE,
        };
        self.reasons = reasons;
        let persistence = (config.holding.persistence_s * clock.0 as f32) as u64;
        let put = Put { tick, value: if reasons != 0 { 1.0 } else { 0.0 }, may: Use::Both };
        match self.sensor.update(&SENSOR_BAND, Side::Above, &config.holding, [persistence, 1], put)? {
            AlarmChange::Raised => Some(Decision::SensorBad(reasons)),
            AlarmChange::Cleared => Some(Decision::SensorGood),
        }
    }

    /// A person has seen all that stands; gives what ends with it.
    pub fn acknowledge(&mut self, mut decided: impl FnMut(Decision)) {
        for (index, alarm) in self.alarms.iter_mut().enumerate() {
            if alarm.acknowledge() == Some(AlarmChange::Cleared) {
                decided(Decision::Alarm(index as u8, AlarmChange::Cleared));
            }
        }
        if self.sensor.acknowledge() == Some(AlarmChange::Cleared) {
            decided(Decision::SensorGood);
        }
    }

    /// Whether the alarm output is to say so: an alarm of severity danger, or the sensor where it has no output of its
    /// own.
    pub fn alarm_stands(&self, config: &Configuration) -> bool {
        let alerts = alerts(config);
        let danger = mask(&self.alarms, Alarm::stands) & !alerts != 0;
        let sensor = config.holding.watch_signal && config.sensor_check.output == OkOutput::WithAlarm;
        danger || (sensor && self.sensor.stands())
    }

    /// Whether the sensor is in order.
    pub fn sensor_is_ok(&self) -> bool {
        !self.sensor.stands()
    }

    /// What is to be kept over a power cut: alarms that nobody has seen, and the sensor's state.
    pub fn unseen(&self) -> (u8, bool) {
        (mask(&self.alarms, Alarm::is_unseen), self.sensor.is_unseen())
    }

    /// The alarms as a status shows them.
    pub fn alarm_state(&self) -> AlarmState {
        AlarmState {
            raised: mask(&self.alarms, Alarm::is_raised),
            standing: mask(&self.alarms, Alarm::stands),
            unseen: mask(&self.alarms, Alarm::is_unseen),
            signal_bad: self.sensor.stands(),
        }
    }

    /// The sensor as a status shows it.
    pub fn sensor_status(&self) -> SensorStatus {
        SensorStatus { reasons: self.reasons, standing: self.sensor.stands(), unseen: self.sensor.is_unseen() }
    }
}

/// Alarms of severity alert, the first one lowest.
pub fn alerts(config: &Configuration) -> u8 {
    let is_alert = |index: usize| AlarmMode::of(&config.modes, index).severity == Severity::Alert;
    (0..config.alarms.len()).fold(0, |bits, index| bits | u8::from(is_alert(index)) << index)
}

/// Whether a quantity is made of every record, whatever the shaft does.
fn is_of_the_whole(watched: Watched) -> bool {
    use Watched::{Crest, Kurtosis, Peak, Rms, VelocityRms};
    matches!(watched, Rms | Peak | Crest | Kurtosis | VelocityRms) || watched.is_of_second()
}

fn reasons(config: &Configuration, evidence: &Evidence) -> u16 {
    let check = &config.sensor_check;
    let of = |holds: bool, bit: u16| if holds { bit } else { 0 };
    let second = evidence.second.unwrap_or_default();
    let bias = evidence.bias_v.map(|volts| volts * check.bias_divider);
    let [low, high] = check.bias_v;
    let [lowest, highest] = check.mean.map(f32::from);
    let far_below = evidence.departure.is_some_and(|departure| {
        departure.departure_db < check.lowest_departure_db() && departure.normalised() < -FAR_BELOW_SIGMA
    });
    of(evidence.quality.overload, reason::CLIPPING)
        | of(evidence.quality.stuck, reason::STANDSTILL)
        | of(second.overload, reason::SECOND_CLIPPING)
        | of(second.stuck, reason::SECOND_STANDSTILL)
        | of(high > 0.0 && bias.is_some_and(|volts| !(low..=high).contains(&volts)), reason::BIAS)
        | of(highest > 0.0 && !(lowest..=highest).contains(&evidence.mean_code), reason::MEAN)
        | of(evidence.turns && evidence.rms < check.floor.0, reason::FLOOR)
        | of(far_below, reason::LEVEL_DROP)
}

/// One bit per alarm, the first one lowest.
fn mask(alarms: &[Alarm; MAX_ALARMS], is: fn(&Alarm) -> bool) -> u8 {
    alarms.iter().enumerate().fold(0, |bits, (index, alarm)| bits | u8::from(is(alarm)) << index)
}

const _: () = assert!(MAX_ALARMS <= 8);
