//! What `meshband simulate --field FILE` reads: wander, housing, channels, tachometer.
//!
//! Everything has a default or is drawn from the seed, so that a file may be as short as one `[[channel]]`. Unknown
//! keys are refused.

use crate::{Error, Result, budget};
use serde::Deserialize;
use std::path::Path;

/// Channels of one record: what the paths and the budget are made for.
const MOST_CHANNELS: usize = 32;
/// Modes of the housing.
const MOST_MODES: usize = 200;

/// A field-like record.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Field {
    /// How the speed departs from the one asked for.
    #[serde(default)]
    pub wander: Wander,
    /// Modes that all channels share, drawn.
    #[serde(default)]
    pub housing: Housing,
    /// Modes given one by one, instead of drawn ones.
    #[serde(default)]
    pub mode: Vec<Mode>,
    /// The sensors.
    pub channel: Vec<Channel>,
    /// A wheel with marks; none where absent.
    #[serde(default)]
    pub tach: Option<Wheel>,
}

/// `[wander]`: slow random changes of the speed and one swing.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Wander {
    /// Standard deviation of the random part over the speed, 0 to 0.2.
    pub share: f64,
    /// Band of the random part, Hz, 0.01 to 20.
    pub band_hz: [f64; 2],
    /// Amplitude of the swing over the speed, 0 to 0.2.
    pub swing: f64,
    /// Frequency of the swing, Hz, 0.01 to 20.
    pub swing_hz: f64,
    /// Whether the torque that the change of speed takes goes through the mesh.
    pub inertia: bool,
}

impl Default for Wander {
    fn default() -> Self {
        Self { share: 0.0, band_hz: [0.05, 0.5], swing: 0.0, swing_hz: 0.3, inertia: true }
    }
}

/// `[housing]`: how modes are drawn where none are given.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Housing {
    /// Number of modes, 1 to 200.
    pub modes: usize,
    /// Lowest and highest frequency, Hz; drawn evenly over the logarithm.
    pub band_hz: [f64; 2],
    /// Smallest and largest damping ratio, 1e-4 to 0.5.
    pub damping: [f64; 2],
    /// Modal mass, kg: a residue is drawn with standard deviation 1 / mass.
    pub mass_kg: f64,
}

impl Default for Housing {
    fn default() -> Self {
        Self { modes: 8, band_hz: [300.0, 8000.0], damping: [0.01, 0.04], mass_kg: 20.0 }
    }
}

/// `[[mode]]`: one shared pole.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mode {
    /// Natural frequency, Hz.
    pub frequency_hz: f64,
    /// Damping ratio, 1e-4 to 0.5.
    pub damping: f64,
}

/// Unit of a channel in an acquisition system's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
pub enum FileUnit {
    /// m/s2.
    #[default]
    #[serde(rename = "m/s2")]
    Acceleration,
    /// Multiples of standard gravity.
    #[serde(rename = "g")]
    Gravity,
    /// Volts of a sensor.
    #[serde(rename = "V")]
    Volt,
}

/// `[[channel]]`: one sensor on the housing.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Channel {
    /// Name.
    pub name: String,
    /// Unit in files; the record folder is in m/s2.
    #[serde(default)]
    pub unit: FileUnit,
    /// Sensitivity, with `unit = "V"`.
    #[serde(default = "tenth")]
    pub volt_per_g: f64,
    /// What the sensor shows over what it should, an error of calibration; negative: mounted the other way round.
    #[serde(default = "one")]
    pub gain: f64,
    /// Constant that the file has beside the signal, in its unit.
    #[serde(default)]
    pub offset: f64,
    /// Noise, m/s2 root mean square.
    #[serde(default)]
    pub noise_rms_m_s2: f64,
    /// Its power falls with the frequency to this power: 0 white, 1 pink, 2 brown.
    #[serde(default)]
    pub noise_slope: f64,
    /// Residues of every mode, 1/kg: along pinion and gear, across pinion and gear; drawn where absent.
    #[serde(default)]
    pub residues_per_kg: Option<Vec<[f64; 4]>>,
}

fn tenth() -> f64 {
    0.1
}

fn one() -> f64 {
    1.0
}

/// Shaft with the wheel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum WheelShaft {
    /// The pinion's.
    #[default]
    Pinion,
    /// The gear's.
    Gear,
}

/// `[tach]`: a wheel with marks and the voltage of its pick-up.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Wheel {
    /// Its shaft.
    pub shaft: WheelShaft,
    /// Marks, 1 to 1000.
    pub pulses: u32,
    /// Standard deviation of the marks' places, per cent of the pitch, 0 to 10.
    pub irregularity_percent: f64,
    /// Part of the pitch for which the voltage is high, 0.02 to 0.9.
    pub duty: f64,
    /// Low and high level, V.
    pub levels_v: [f64; 2],
    /// Duration of an edge, s.
    pub rise_s: f64,
    /// White noise, V root mean square.
    pub noise_v: f64,
}

impl Default for Wheel {
    fn default() -> Self {
        let (shaft, levels_v) = (WheelShaft::Pinion, [0.1, 4.9]);
        Self { shaft, pulses: 1, irregularity_percent: 0.0, duty: 0.3, levels_v, rise_s: 1e-4, noise_v: 0.01 }
    }
}

impl Field {
    /// Reads and checks a file.
    ///
    /// # Errors
    /// One line with file, line or key, and what is wrong.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(&budget::read_text(path)?, &path.display().to_string())
    }

    /// [`Field::read`] of text; `place` names it.
    ///
    /// # Errors
    /// As [`Field::read`].
    pub fn parse(text: &str, place: &str) -> Result<Self> {
        let field: Self = toml::from_str(text).map_err(|error| {
            let line = error.span().map_or(0, |span| text[..span.start.min(text.len())].lines().count().max(1));
            Error::invalid(format!("{place}:{line}"), error.message())
        })?;
        field.check(place)?;
        Ok(field)
    }

    fn check(&self, place: &str) -> Result<()> {
        let within = |key: &str, value: f64, [low, high]: [f64; 2]| {
            let what = format!("{value} is not within {low} to {high}");
            if value >= low && value <= high { Ok(()) } else { Err(Error::invalid(format!("{place} {key}"), what)) }
        };
        let rising = |key: &str, band: [f64; 2], range: [f64; 2]| {
            band.iter().try_for_each(|value| within(key, *value, range))?;
            within(key, band[1], [band[0], range[1]])
        };
        let w = &self.wander;
        within("[wander] share", w.share, [0.0, 0.2])?;
        within("[wander] swing", w.swing, [0.0, 0.2])?;
        rising("[wander] band_hz", w.band_hz, [0.01, 20.0])?;
        within("[wander] swing_hz", w.swing_hz, [0.01, 20.0])?;
        within("[housing] modes", self.housing.modes as f64, [1.0, MOST_MODES as f64])?;
        rising("[housing] band_hz", self.housing.band_hz, [1.0, 1e6])?;
        rising("[housing] damping", self.housing.damping, [1e-4, 0.5])?;
        within("[housing] mass_kg", self.housing.mass_kg, [1e-3, 1e6])?;
        within("[[mode]] count", self.mode.len() as f64, [0.0, MOST_MODES as f64])?;
        for mode in &self.mode {
            within("[[mode]] frequency_hz", mode.frequency_hz, [1.0, 1e6])?;
            within("[[mode]] damping", mode.damping, [1e-4, 0.5])?;
        }
        within("[[channel]] count", self.channel.len() as f64, [1.0, MOST_CHANNELS as f64])?;
        let modes = if self.mode.is_empty() { self.housing.modes } else { self.mode.len() };
        for (i, c) in self.channel.iter().enumerate() {
            let key = |name: &str| format!("[[channel]] {i} {name}");
            within(&key("volt_per_g"), c.volt_per_g, [1e-9, 1e9])?;
            within(&key("gain"), c.gain, [-1e6, 1e6])?;
            within(&key("offset"), c.offset, [-1e9, 1e9])?;
            within(&key("noise_rms_m_s2"), c.noise_rms_m_s2, [0.0, 1e6])?;
            within(&key("noise_slope"), c.noise_slope, [0.0, 4.0])?;
            let Some(residues) = &c.residues_per_kg else { continue };
            if residues.len() != modes {
                let what = format!("has {} rows for {modes} modes", residues.len());
                return Err(Error::invalid(format!("{place} {}", key("residues_per_kg")), what));
            }
            residues.iter().flatten().try_for_each(|r| within(&key("residues_per_kg"), *r, [-1e6, 1e6]))?;
        }
        self.tach.as_ref().map_or(Ok(()), |tach| tach.check(within))
    }
}

impl Wheel {
    fn check(&self, within: impl Fn(&str, f64, [f64; 2]) -> Result<()>) -> Result<()> {
        within("[tach] pulses", f64::from(self.pulses), [1.0, 1000.0])?;
        within("[tach] irregularity_percent", self.irregularity_percent, [0.0, 10.0])?;
        within("[tach] duty", self.duty, [0.02, 0.9])?;
        within("[tach] levels_v", self.levels_v[0], [-1e3, 1e3])?;
        within("[tach] levels_v", self.levels_v[1], [-1e3, 1e3])?;
        within("[tach] rise_s", self.rise_s, [0.0, 1.0])?;
        within("[tach] noise_v", self.noise_v, [0.0, 1e3])
    }

    /// Turns of the wheel's shaft per turn of the pinion.
    pub fn ratio(&self, teeth: [u32; 2]) -> f64 {
        match self.shaft {
            WheelShaft::Pinion => 1.0,
            WheelShaft::Gear => f64::from(teeth[0]) / f64::from(teeth[1]),
        }
    }

    /// Name of the shaft in a record.
    pub fn shaft_name(&self) -> &'static str {
        match self.shaft {
            WheelShaft::Pinion => "pinion",
            WheelShaft::Gear => "gear",
        }
    }
}
