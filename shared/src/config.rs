//! Configuration of a node: one value, validated once, never changed while it is in force.
//!
//! Postcard-serialisable and bounded ([`Configuration::MAX_SERIALISED`]); the first field is the schema version, so that
//! stored configurations of another schema are recognised before anything else is believed.

use crate::alarm::AlarmBand;
use crate::law::{Law, LawError};
use crate::rate_plan::{RateLimits, RatePolicy};
use crate::units::{Acceleration, Hertz};
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Version of [`Configuration`]'s layout.
pub const SCHEMA: u16 = 1;

/// Most mesh harmonics in a spectrum. With more, what the lowest rate may carry would fold into the bands on the finest grid of
/// the order domain ([`crate::zoom::SAMPLES_PER_PITCH`]).
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

/// Mesh-band product.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeshBandConfig {
    /// Mesh harmonics reported, 1 to [`MAX_HARMONICS`].
    pub harmonics: u8,
    /// Sideband pairs of the pinion shaft per harmonic, 0 to [`MAX_SIDEBANDS`].
    pub sidebands: u8,
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
    /// `limits.analogue_stop`: not in 10 Hz to 5 MHz.
    AnalogueStop,
    /// `limits.highest_adc`: not in 100 Hz to 10 MHz, below twice the analogue stop edge, or above the time base.
    HighestAdc,
    /// `policy`: multiple not in 2 to 100, or forced rate outside the limits.
    Policy,
    /// `law`
    Law(LawError),
    /// `mesh.harmonics`
    Harmonics,
    /// `mesh.sidebands`
    Sidebands,
    /// `alarms[n]`
    Alarm(u8),
}

impl ConfigurationError {
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
        }
    }
}

impl core::fmt::Display for ConfigurationError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Law(error) => write!(f, "law: {error:?}"),
            Self::Alarm(index) => write!(f, "alarms[{index}] out of range"),
            other => write!(f, "{} out of range", other.field()),
        }
    }
}

impl core::error::Error for ConfigurationError {}

impl Default for Configuration {
    /// A pair of 20 and 30 teeth, one pulse per pinion turn, a filter that stops at 100 kHz and the paper rig's law: for
    /// a node that has not been told its machine.
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
            limits: RateLimits { analogue_stop: Hertz(100_000.0), highest_adc: Hertz(500_000.0) },
            // Another machine's law: nearer than any guess, and still flagged.
            law: Law { provisional: true, ..crate::law_data::law() },
            policy: RatePolicy::Spectrum,
            mesh: MeshBandConfig { harmonics: 5, sidebands: 3 },
            alarms: Vec::new(),
        }
    }
}

impl Configuration {
    /// Upper bound of the postcard form, bytes.
    pub const MAX_SERIALISED: usize = 512;

    /// Checks every field; `clock_hz` is the board's time base.
    pub fn validate(&self, clock_hz: u32) -> Result<(), ConfigurationError> {
        use ConfigurationError as E;
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
        let sensitivity = self.sensor.acceleration_per_code.0;
        ensure(sensitivity.is_finite() && sensitivity != 0.0, E::Sensitivity)?;
        let (stop, adc) = (self.limits.analogue_stop.0, self.limits.highest_adc.0);
        ensure((10.0..=5.0e6).contains(&stop), E::AnalogueStop)?;
        ensure((100.0..=1.0e7).contains(&adc) && adc >= 2.0 * stop && adc <= clock_hz as f32, E::HighestAdc)?;
        ensure(self.policy_is_sane(), E::Policy)?;
        self.law.validate().map_err(E::Law)?;
        ensure((1..=MAX_HARMONICS as u8).contains(&self.mesh.harmonics), E::Harmonics)?;
        ensure(self.mesh.sidebands <= MAX_SIDEBANDS as u8, E::Sidebands)?;
        for (index, alarm) in self.alarms.iter().enumerate() {
            ensure(alarm.is_sane(), E::Alarm(index as u8))?;
        }
        Ok(())
    }

    fn policy_is_sane(&self) -> bool {
        match self.policy {
            RatePolicy::Critical | RatePolicy::Spectrum => true,
            RatePolicy::Waveform { multiple } => (2.0..=100.0).contains(&multiple),
            RatePolicy::Forced { rate } => rate.0 >= 100.0 && rate.0 <= self.limits.highest_adc.0,
        }
    }
}
