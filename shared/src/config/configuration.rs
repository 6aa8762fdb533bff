//! Configuration of a node: one value, validated once, never changed while it is in force.
//!
//! Postcard-serialisable and bounded ([`Configuration::MAX_SERIALISED`]); the first field is the schema version, so
//! that stored configurations of another schema are recognised before anything else is believed. Fields are only ever
//! appended to [`Configuration`] itself, and what is appended means at its first value what was so before:
//! configurations of older schemas are thus read by the present layout ([`crate::schema`]).

use super::{
    CaptureConfig, CodeRange, LinkConfig, MAX_FURTHER_STAGES, MAX_TRAIN_GEARS, ModbusOptions, SensorCheck, StageLaw,
    TrainGear, train, watch,
};
use crate::alarm::{AlarmBand, AlarmHolding, AlarmMode};
use crate::board::Timing;
use crate::law::{Law, LawError};
use crate::levels::{self, LevelPoint, LocalPoint, MAX_LEVELS};
use crate::link::compact;
use crate::message::Bound;
use crate::rate_plan::{RateLimits, RatePolicy};
use crate::schema;
use crate::units::{Acceleration, Hertz};
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Version of [`Configuration`]'s layout: 1 without [`FrontEnd`], 2 without holding, pass bands and latch, 3 without
/// levels, 4 without link, 5 without capture, 6 without second sensor, 7 without local levels, 8 without modes of
/// alarms, codes of the front end, check of the sensor, velocity's edge and Modbus' options, 9 without further gears.
pub const SCHEMA: u16 = 10;

/// Oldest layout that is still read.
pub const OLDEST_SCHEMA: u16 = 1;

/// Samples per block on every board.
pub const BLOCK_SAMPLES: usize = 512;

/// Lowest ADC rate, Hz: a block then lasts half a second. A board whose blocks stay away for a second counts as dead,
/// and its watchdog starts it again; a rate that does that would do it for ever once it is stored.
pub const LOWEST_ADC_HZ: f32 = 2.0 * BLOCK_SAMPLES as f32;

/// Most mesh harmonics in a spectrum. With more, what the lowest rate may carry would fold into the bands on the
/// finest grid of the order domain ([`crate::zoom::SAMPLES_PER_PITCH`]).
pub const MAX_HARMONICS: usize = 6;

/// Most sideband pairs per harmonic.
pub const MAX_SIDEBANDS: usize = 4;

/// Most alarm bands.
pub const MAX_ALARMS: usize = 8;

/// Gear pair.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GearPair {
    /// Teeth of the pinion, 12 to 1000: with fewer the bands of neighbouring mesh harmonics would overlap.
    pub pinion_teeth: u16,
    /// Teeth of the gear, 4 to 1000.
    pub gear_teeth: u16,
}

/// Tachometer wheel and its gearing to the pinion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TachWheel {
    /// Pulse positions per turn of the tach shaft, missing ones included, 1 to 1024.
    pub pulses_per_turn: u16,
    /// Adjacent positions without a tooth (2 for a 60-2 wheel); at most a quarter of the positions, with at least 12.
    pub missing: u16,
    /// Turns of the pinion per turn of the tach shaft, 0.001 to 1000.
    pub pinion_per_tach: f32,
    /// Highest believable tach shaft rate: faster pulses are rejected as glitches.
    pub highest: Hertz,
    /// Tach shaft rate below which the shaft counts as standing.
    pub lowest: Hertz,
}

/// Accelerometer and its converter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sensor {
    /// Acceleration per ADC code (16-bit, left-aligned), m/s^2; may be negative for an inverted sensor.
    pub acceleration_per_code: Acceleration,
    /// Code of zero acceleration.
    pub zero_code: u16,
}

/// Accelerometer at the second converter, sampled at the same instants as the first.
///
/// Overall values and alarms are made of it ([`crate::message::ChannelValues`]); spectra, orders, averages and
/// waveforms are the first one's. No amplifier: its sensitivity is that at the converter. A board takes a change up
/// at once; its sampling begins anew.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SecondSensor {
    /// Acceleration per ADC code (16-bit, left-aligned), m/s^2; may be negative for an inverted sensor.
    pub acceleration_per_code: Acceleration,
    /// Code of zero acceleration.
    pub zero_code: u16,
    /// Upper edge of its band, Hz; 0 for not declared.
    pub band: Hertz,
}

impl SecondSensor {
    fn is_sane(&self) -> bool {
        is_sensitivity(self.acceleration_per_code) && is_sane_edge(self.band, HIGHEST_SENSOR_HZ)
    }
}

/// As the first sensor's default.
impl Default for SecondSensor {
    fn default() -> Self {
        Self { acceleration_per_code: Acceleration(0.03), zero_code: 32_768, band: Hertz(0.0) }
    }
}

fn is_sensitivity(per_code: Acceleration) -> bool {
    per_code.0.is_finite() && per_code.0 != 0.0
}

/// Edge of the tach's signal that counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum TachEdge {
    /// From low to high.
    #[default]
    Rising,
    /// From high to low.
    Falling,
}

/// Gain of the analogue front end's amplifier (MCP6S21 class).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Gain {
    /// 1, also where there is no such amplifier.
    #[default]
    X1,
    /// 2
    X2,
    /// 4
    X4,
    /// 5
    X5,
    /// 8
    X8,
    /// 10
    X10,
    /// 16
    X16,
    /// 32
    X32,
}

impl Gain {
    /// All of them, ascending.
    pub const ALL: [Self; 8] = [Self::X1, Self::X2, Self::X4, Self::X5, Self::X8, Self::X10, Self::X16, Self::X32];

    /// The number that the amplifier's gain register takes, 0 to 7.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The amplification.
    pub const fn factor(self) -> u8 {
        [1, 2, 4, 5, 8, 10, 16, 32][self as usize]
    }
}

/// Switch of the sensor's supply, on boards that have one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum SensorSupply {
    /// Switched on.
    #[default]
    On,
    /// Switched off.
    Off,
}

/// What a board switches in front of its inputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrontEnd {
    /// Edge of the tach's signal that counts.
    pub tach_edge: TachEdge,
    /// Gain wanted of the amplifier. `sensor.acceleration_per_code` is the sensitivity at gain 1; the node scales
    /// with the gain that the board reports as in use ([`crate::node::Node::set_gain`]).
    pub gain: Gain,
    /// The sensor's supply.
    pub sensor_supply: SensorSupply,
}

/// Mesh-band product.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeshBandConfig {
    /// Mesh harmonics reported, 1 to [`MAX_HARMONICS`].
    pub harmonics: u8,
    /// Sideband pairs of the pinion shaft per harmonic, 0 to [`MAX_SIDEBANDS`].
    pub sidebands: u8,
}

/// Upper edges of what comes before the converter; 0 stands for not declared. The law asks for a bandwidth; rates are
/// only granted for what passes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PassBand {
    /// Pass edge of the analogue filter.
    pub analogue: Hertz,
    /// Upper edge of the sensor's band.
    pub sensor: Hertz,
}

impl PassBand {
    /// The part of a bandwidth that filter and sensor pass.
    pub fn carried(&self, bandwidth: Hertz) -> Hertz {
        Hertz(declared(self.analogue).min(declared(self.sensor)).min(bandwidth.0))
    }

    /// Upper edge of what filter and sensor pass together; 0 where neither is declared.
    pub fn upper_edge(&self) -> Hertz {
        let edge = declared(self.analogue).min(declared(self.sensor));
        Hertz(if edge < f32::MAX { edge } else { 0.0 })
    }

    /// Bandwidth that is really there of the law's, and what bounds it; `usable` is what the granted rate carries.
    pub fn available(&self, law: Hertz, usable: Hertz) -> (f32, Bound) {
        let bounds = [
            (declared(self.analogue), Bound::AnalogueFilter),
            (declared(self.sensor), Bound::Sensor),
            (usable.0, Bound::Rate),
        ];
        bounds.into_iter().fold((law.0, Bound::Law), |least, bound| if bound.0 < least.0 { bound } else { least })
    }

    fn is_sane(&self, stop: Hertz) -> bool {
        is_sane_edge(self.analogue, stop.0) && is_sane_edge(self.sensor, HIGHEST_SENSOR_HZ)
    }
}

/// Highest edge of a sensor's band that is believed, Hz.
const HIGHEST_SENSOR_HZ: f32 = 5.0e6;

fn is_sane_edge(edge: Hertz, highest: f32) -> bool {
    edge.0 == 0.0 || (10.0..=highest).contains(&edge.0)
}

fn declared(edge: Hertz) -> f32 {
    if edge.0 > 0.0 { edge.0 } else { f32::MAX }
}

/// Everything a node needs to know.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Configuration {
    /// Layout version, [`SCHEMA`].
    pub schema: u16,
    /// Gear pair.
    pub gears: GearPair,
    /// Tachometer.
    pub tach: TachWheel,
    /// Sensor.
    pub sensor: Sensor,
    /// Analogue filter and ADC.
    pub limits: RateLimits,
    /// Bandwidth law.
    pub law: Law,
    /// Rate policy.
    pub policy: RatePolicy,
    /// Mesh bands.
    pub mesh: MeshBandConfig,
    /// Alarm bands.
    pub alarms: Vec<AlarmBand, MAX_ALARMS>,
    /// Tach edge, gain, sensor supply.
    pub front_end: FrontEnd,
    /// How alarms are held.
    pub holding: AlarmHolding,
    /// What filter and sensor pass.
    pub pass: PassBand,
    /// Alarms that stand unseen, one bit each; the node keeps them here through power cuts, a host's value is ignored.
    pub latched: u8,
    /// Levels expected over speed; empty where none are known.
    pub levels: Vec<LevelPoint, MAX_LEVELS>,
    /// What the line speaks from the next start on.
    pub link: LinkConfig,
    /// Which waveforms are kept.
    pub capture: CaptureConfig,
    /// A second accelerometer, where there is one.
    pub second: Option<SecondSensor>,
    /// Levels expected over speed of what a local fault changes; empty where none are known.
    pub local_levels: Vec<LocalPoint, MAX_LEVELS>,
    /// Side and severity of the alarms, in their order; those behind the list's end are upper limits of severity
    /// danger.
    pub modes: Vec<AlarmMode, MAX_ALARMS>,
    /// Codes between which the front end does not clip, of both sensors.
    pub range: CodeRange,
    /// What a sensor in order shows.
    pub sensor_check: SensorCheck,
    /// The sensor's state stands unseen; kept by the node as `latched` is, a host's value is ignored.
    pub sensor_latched: bool,
    /// Lower edge of the velocity's band, 1 to 100 Hz; 0 stands for 10.
    pub velocity_from: Hertz,
    /// Word order and commands of Modbus, at once in force.
    pub modbus: ModbusOptions,
    /// Further gears that are followed in turns with the pinion, stages ascending; empty for a pair.
    pub train: Vec<TrainGear, MAX_TRAIN_GEARS>,
    /// Laws of the stages 2 to 4, in their order.
    pub stage_laws: Vec<StageLaw, MAX_FURTHER_STAGES>,
    /// Gear that each alarm watches where its quantity is one of a gear, in their order: 0 the pinion, 1 the first of
    /// `train`; those behind the list's end watch the pinion.
    pub alarm_gears: Vec<u8, MAX_ALARMS>,
}

/// The first field found wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ConfigurationError {
    /// Another schema version.
    Schema,
    /// `gears.pinion_teeth`
    PinionTeeth,
    /// `gears.gear_teeth`
    GearTeeth,
    /// `tach.pulses_per_turn`
    PulsesPerTurn,
    /// `tach.missing`
    MissingTeeth,
    /// `tach.pinion_per_tach`
    PinionPerTach,
    /// `tach.highest` or `tach.lowest`: not 0 < lowest < highest <= 1000 Hz.
    TachRange,
    /// `tach.highest` puts pulses closer than four ticks of this board's time base.
    TachTooFastForClock,
    /// `sensor.acceleration_per_code`: zero or not finite.
    Sensitivity,
    /// `limits.analogue_stop`: not in 512 Hz (half of [`LOWEST_ADC_HZ`]) to 5 MHz.
    AnalogueStop,
    /// `limits.highest_adc`: not in [`LOWEST_ADC_HZ`] to 10 MHz, below twice the analogue stop edge, or above what
    /// the board keeps up with ([`Timing::highest_adc`]).
    HighestAdc,
    /// `policy`: multiple not in 2 to 100, or forced rate not in [`LOWEST_ADC_HZ`] to `limits.highest_adc`.
    Policy,
    /// `law`
    Law(LawError),
    /// `mesh.harmonics`
    Harmonics,
    /// `mesh.sidebands`
    Sidebands,
    /// `alarms[n]`
    Alarm(u8),
    /// `holding.persistence_s`
    Holding,
    /// `pass.analogue` or `pass.sensor`
    PassBand,
    /// `levels`
    Levels,
    /// `link.address` or `link.bits_per_second`
    Link,
    /// `capture.rate`: neither 0 nor 4 to 100 kHz.
    Capture,
    /// `second`: sensitivity zero or not finite, or its band.
    Second,
    /// `second`: this board has one converter.
    OneConverter,
    /// `limits.highest_adc` is above what the board keeps up with on two channels ([`Timing::highest_of_two`]).
    HighestOfTwo,
    /// `local_levels`
    LocalLevels,
    /// `range`, `sensor_check` or `velocity_from`
    Sensor,
    /// `modes`: more of them than alarms.
    Modes,
    /// `tach.highest` times `tach.pulses_per_turn` is more than this board keeps up with ([`Timing::highest_pulses`]).
    TachTooManyPulses,
    /// `train`, `stage_laws` or `alarm_gears`
    Train,
}

impl ConfigurationError {
    /// What is asked of the field.
    pub fn wanted(self) -> &'static str {
        match self {
            Self::Schema => "must be the one this node knows",
            Self::PinionTeeth => "must be 12 to 1000",
            Self::GearTeeth => "must be 4 to 1000",
            Self::PulsesPerTurn => "must be 1 to 1024",
            Self::MissingTeeth => "must be 0, or with at least 12 positions at most a quarter of them",
            Self::PinionPerTach => "must be 0.001 to 1000",
            Self::TachRange => "must be 0.01 Hz <= lowest < highest <= 1000 Hz",
            Self::TachTooFastForClock => "puts pulses closer than four ticks of the node's clock",
            Self::Sensitivity => "must be a finite number other than 0",
            Self::AnalogueStop => {
                "must be 512 Hz to 5 MHz: at lower ADC rates a block outlasts the watchdog's patience, and the node \
                 restarts for ever"
            }
            Self::HighestAdc => {
                "must be 1024 Hz to 10 MHz, at least twice limits.analogue_stop, at most the node's clock"
            }
            Self::Policy => "must have a multiple of 2 to 100, or a forced rate of 1024 Hz to limits.highest_adc",
            Self::Law(_) => "is not sound",
            Self::Harmonics => "must be 1 to 6",
            Self::Sidebands => "must be 0 to 4",
            Self::Alarm(_) => {
                "needs 0 <= from < to, finite raise >= clear (of a low side: raise <= clear), \
                 persistence of 1 or more, and the second sensor where it watches that"
            }
            Self::Holding => "must be 0 to 3600 s",
            Self::PassBand => "must be 0 for not declared, or 10 Hz up to limits.analogue_stop (sensor: 5 MHz)",
            Self::Levels | Self::LocalLevels => {
                "needs two points or none, ascending speeds of 0.01 to 1000 Hz, levels of -200 to 200 dB, \
                 uncertainties of 0.01 to 60 dB or 0"
            }
            Self::Link => {
                "must be a Modbus address of 1 to 247 (0 only without Modbus), and 2400 to 115200 bit/s or 0 for 19200"
            }
            Self::Capture => "must be 0 for 10 kHz, or 4000 Hz to 100 kHz",
            Self::Second => "needs a sensitivity other than 0, and a band of 0 for not declared, or 10 Hz to 5 MHz",
            Self::OneConverter => "cannot be had: this board samples one channel",
            Self::Sensor => {
                "needs highest at least 256 codes above lowest, ordered bands (bias with a divider of 1 to \
                 100), floor and far_below_db of 0 or more, velocity_from of 0 or 1 to 100 Hz"
            }
            Self::Modes => "must not be longer than the list of alarms",
            Self::TachTooManyPulses => {
                "times tach.pulses_per_turn must be at most what the board keeps up with, 15000 a \
                 second on an STM32F405: lower it, or take a coarser wheel or track"
            }
            Self::Train => {
                "needs stages of 1 to 4 that do not descend, 12 to 800 teeth (mate: 4 to 1000), whole turns in a \
                 ratio of 0.001 to 1000 and at most one per tach pulse, laws below a turn and a second, and alarms of \
                 gears that are listed on MeshAmplitude, SidebandEnergyRatio, Fm0 or Fm4"
            }
            Self::HighestOfTwo => "must be lower with a second sensor: what this board keeps up with on two channels",
        }
    }

    /// Name of the field, as written in configuration files.
    pub fn field(self) -> &'static str {
        match self {
            Self::Schema => "schema",
            Self::PinionTeeth => "gears.pinion_teeth",
            Self::GearTeeth => "gears.gear_teeth",
            Self::PulsesPerTurn => "tach.pulses_per_turn",
            Self::MissingTeeth => "tach.missing",
            Self::PinionPerTach => "tach.pinion_per_tach",
            Self::TachRange => "tach.lowest, tach.highest",
            Self::TachTooFastForClock => "tach.highest",
            Self::Sensitivity => "sensor.acceleration_per_code",
            Self::AnalogueStop => "limits.analogue_stop",
            Self::HighestAdc => "limits.highest_adc",
            Self::Policy => "policy",
            Self::Law(_) => "law",
            Self::Harmonics => "mesh.harmonics",
            Self::Sidebands => "mesh.sidebands",
            Self::Alarm(_) => "alarms",
            Self::Holding => "holding.persistence_s",
            Self::PassBand => "pass.analogue, pass.sensor",
            Self::Levels => "levels",
            Self::LocalLevels => "local_levels",
            Self::Link => "link.address, link.bits_per_second",
            Self::Capture => "capture.rate",
            Self::Second | Self::OneConverter => "second",
            Self::HighestOfTwo => "limits.highest_adc",
            Self::Sensor => "range, sensor_check, velocity_from",
            Self::Modes => "modes",
            Self::TachTooManyPulses => "tach.highest",
            Self::Train => "train, stage_laws, alarm_gears",
        }
    }
}

impl core::fmt::Display for ConfigurationError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Law(error) => write!(f, "law {}: {error:?}", self.wanted()),
            Self::Alarm(index) => write!(f, "alarm {} (alarms) {}", index + 1, self.wanted()),
            other => write!(f, "{} {}", other.field(), other.wanted()),
        }
    }
}

impl core::error::Error for ConfigurationError {}

impl Default for Configuration {
    /// A pair of 20 and 30 teeth, one pulse per pinion turn, a filter that stops at 100 kHz and the paper rig's law:
    /// for a node that has not been told its machine.
    fn default() -> Self {
        Self {
            schema: SCHEMA,
            gears: GearPair { pinion_teeth: 20, gear_teeth: 30 },
            tach: TachWheel {
                pulses_per_turn: 1,
                missing: 0,
                pinion_per_tach: 1.0,
                highest: Hertz(100.0),
                lowest: Hertz(0.25),
            },
            sensor: Sensor { acceleration_per_code: Acceleration(0.03), zero_code: 32_768 },
            limits: RateLimits { analogue_stop: Hertz(100_000.0), highest_adc: Hertz(420_000.0) },
            // Another machine's law: nearer than any guess, and still flagged.
            law: Law { provisional: true, ..crate::law::data::law() },
            policy: RatePolicy::Spectrum,
            mesh: MeshBandConfig { harmonics: 5, sidebands: 3 },
            alarms: Vec::new(),
            front_end: FrontEnd::default(),
            holding: AlarmHolding::default(),
            pass: PassBand::default(),
            latched: 0,
            levels: Vec::new(),
            link: LinkConfig::default(),
            capture: CaptureConfig::default(),
            second: None,
            local_levels: Vec::new(),
            modes: Vec::new(),
            range: CodeRange::default(),
            sensor_check: SensorCheck::default(),
            sensor_latched: false,
            velocity_from: Hertz(0.0),
            modbus: ModbusOptions::default(),
            train: Vec::new(),
            stage_laws: Vec::new(),
            alarm_gears: Vec::new(),
        }
    }
}

impl Configuration {
    /// Upper bound of the postcard form, bytes.
    pub const MAX_SERIALISED: usize = 1336;

    /// Writes the postcard form to the beginning of `room`: how many bytes, or `None` where they do not fit. One copy
    /// of its code in an image.
    #[inline(never)]
    pub fn to_stored(&self, room: &mut [u8]) -> Option<usize> {
        compact::write(self, room)
    }

    /// A configuration in postcard form, of this schema or brought up to it from an older one; `None` for one that is
    /// not understood, a newer one above all.
    pub fn from_stored(bytes: &[u8]) -> Option<Self> {
        let (written, _) = postcard::take_from_bytes::<u16>(bytes).ok()?;
        if !(OLDEST_SCHEMA..=SCHEMA).contains(&written) {
            return None;
        }
        // Changed in its place: another kilobyte on the stack would be at its deepest here.
        let mut config: Option<Self> = schema::read(bytes, written.cmp(&SCHEMA));
        if let Some(config) = &mut config {
            config.schema = SCHEMA;
        }
        config
    }

    /// A stored configuration on a board that keeps up with less than an earlier version promised: its highest rates
    /// are lowered to what the board does, so that the rest of it is kept.
    pub fn lower_to(&mut self, board: Timing) {
        let highest = self.highest_on(board).unwrap_or(board.highest_adc).0;
        let lowered = |rate: Hertz| if rate.0 > highest { Hertz(highest) } else { rate };
        self.limits.highest_adc = lowered(self.limits.highest_adc);
        if let RatePolicy::Forced { rate } = self.policy {
            self.policy = RatePolicy::Forced { rate: lowered(rate) };
        }
        let pulses = f32::from(self.tach.pulses_per_turn.max(1));
        if self.tach.highest.0 * pulses > board.highest_pulses.0 {
            // Rounded down, so that the product stays below.
            self.tach.highest = Hertz(board.highest_pulses.0 / pulses * (1.0 - 1e-6));
        }
    }

    /// Checks every field against its range and the board.
    pub fn validate(&self, board: impl Into<Timing>) -> Result<(), ConfigurationError> {
        use ConfigurationError as E;
        let board = board.into();
        let Timing { clock, highest_adc, .. } = board;
        let clock_hz = clock.0;
        let teeth = 4..=1000;
        let ensure = |holds: bool, error: E| if holds { Ok(()) } else { Err(error) };
        ensure(self.schema == SCHEMA, E::Schema)?;
        ensure((12..=1000).contains(&self.gears.pinion_teeth), E::PinionTeeth)?;
        ensure(teeth.contains(&self.gears.gear_teeth), E::GearTeeth)?;
        let tach = &self.tach;
        ensure((1..=1024).contains(&tach.pulses_per_turn), E::PulsesPerTurn)?;
        let wheel_can_miss = tach.pulses_per_turn >= 12 && tach.missing <= tach.pulses_per_turn / 4;
        ensure(tach.missing == 0 || wheel_can_miss, E::MissingTeeth)?;
        ensure((0.001..=1000.0).contains(&tach.pinion_per_tach), E::PinionPerTach)?;
        let (lowest, highest) = (tach.lowest.0, tach.highest.0);
        ensure(lowest >= 0.01 && lowest < highest && highest <= 1000.0, E::TachRange)?;
        ensure(highest * f32::from(tach.pulses_per_turn) * 4.0 <= clock_hz as f32, E::TachTooFastForClock)?;
        ensure(highest * f32::from(tach.pulses_per_turn) <= board.highest_pulses.0, E::TachTooManyPulses)?;
        ensure(is_sensitivity(self.sensor.acceleration_per_code), E::Sensitivity)?;
        let (stop, adc) = (self.limits.analogue_stop.0, self.limits.highest_adc.0);
        ensure((LOWEST_ADC_HZ / 2.0..=5.0e6).contains(&stop), E::AnalogueStop)?;
        ensure(
            (LOWEST_ADC_HZ..=1.0e7).contains(&adc) && adc >= 2.0 * stop && adc <= highest_adc.0.min(clock_hz as f32),
            E::HighestAdc,
        )?;
        ensure(self.policy_is_sane(), E::Policy)?;
        self.law.validate().map_err(E::Law)?;
        ensure((1..=MAX_HARMONICS as u8).contains(&self.mesh.harmonics), E::Harmonics)?;
        ensure(self.mesh.sidebands <= MAX_SIDEBANDS as u8, E::Sidebands)?;
        for (index, alarm) in self.alarms.iter().enumerate() {
            let watches_something = self.second.is_some() || !alarm.watched.is_of_second();
            let side = AlarmMode::of(&self.modes, index).side;
            ensure(alarm.is_sane(side) && watches_something, E::Alarm(index as u8))?;
        }
        ensure(self.modes.len() <= self.alarms.len(), E::Modes)?;
        let of_alarms = (self.alarms.as_slice(), self.alarm_gears.as_slice());
        ensure(train::are_sane(&self.train, &self.stage_laws, of_alarms, tach), E::Train)?;
        ensure(watch::are_sane(self.range, &self.sensor_check, self.velocity_from), E::Sensor)?;
        ensure(self.holding.is_sane(), E::Holding)?;
        ensure(self.pass.is_sane(self.limits.analogue_stop), E::PassBand)?;
        ensure(levels::are_sane(&self.levels), E::Levels)?;
        ensure(levels::are_sane(&self.local_levels), E::LocalLevels)?;
        ensure(self.link.is_sane(), E::Link)?;
        ensure(self.capture.is_sane(), E::Capture)?;
        ensure(self.second.as_ref().is_none_or(SecondSensor::is_sane), E::Second)?;
        let highest = self.highest_on(board).ok_or(E::OneConverter)?;
        ensure(adc <= highest.0, E::HighestOfTwo)
    }

    /// Highest ADC rate on a board with as many sensors as there are; `None` where it has no second converter.
    fn highest_on(&self, board: Timing) -> Option<Hertz> {
        if self.second.is_some() { board.highest_of_two } else { Some(board.highest_adc) }
    }

    /// Gear that an alarm watches: 0 the pinion, 1 the first of the train's further gears.
    pub fn gear_of_alarm(&self, index: usize) -> u8 {
        self.alarm_gears.get(index).copied().unwrap_or(0)
    }

    fn policy_is_sane(&self) -> bool {
        match self.policy {
            RatePolicy::Critical | RatePolicy::Spectrum => true,
            RatePolicy::Waveform { multiple } => (2.0..=100.0).contains(&multiple),
            RatePolicy::Forced { rate } => rate.0 >= LOWEST_ADC_HZ && rate.0 <= self.limits.highest_adc.0,
        }
    }
}
