//! The node's configuration for a signal: tooth counts, tach, policy, and which shaft's turns count as orders.

use super::image::TICKS_PER_SECOND;
use super::signal::Signal;
use crate::{Error, Result};
use meshband::config::{Configuration, GearPair, MAX_SIDEBANDS, TachWheel};
use meshband::law::{Law, LawForm};
use meshband::rate_plan::RatePolicy;
use meshband::units::Hertz;

/// The shaft whose turns the node counts, and whose sidebands it reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OrderShaft {
    /// The driving gear's.
    #[default]
    Pinion,
    /// The driven gear's: finer sidebands where it is the slower one.
    Gear,
}

impl OrderShaft {
    /// Teeth of the gear on this shaft and of the other.
    pub fn teeth(self, signal: &Signal) -> [u32; 2] {
        match self {
            OrderShaft::Pinion => signal.teeth,
            OrderShaft::Gear => [signal.teeth[1], signal.teeth[0]],
        }
    }

    /// Turns of this shaft per turn of the tach's.
    pub fn per_tach(self, signal: &Signal) -> f64 {
        match self {
            OrderShaft::Pinion => signal.pinion_per_tach,
            OrderShaft::Gear => signal.pinion_per_tach * f64::from(signal.teeth[0]) / f64::from(signal.teeth[1]),
        }
    }

    /// For tables.
    pub fn name(self) -> &'static str {
        match self {
            OrderShaft::Pinion => "pinion",
            OrderShaft::Gear => "gear",
        }
    }
}

/// A configuration that the node accepts.
///
/// # Errors
/// [`Error::Invalid`] naming the first field out of the node's range.
pub fn configuration(signal: &Signal, shaft: OrderShaft, forced_rate_hz: Option<f64>) -> Result<Configuration> {
    let small = |value: u32, what: &str| {
        u16::try_from(value).map_err(|_| Error::invalid(what, format!("{value} is beyond the node's range")))
    };
    let defaults = Configuration::default();
    let [own, other] = shaft.teeth(signal);
    let ratio = shaft.per_tach(signal) / signal.pinion_per_tach;
    let mut config = Configuration {
        gears: GearPair { pinion_teeth: small(own, "[pair] teeth")?, gear_teeth: small(other, "[pair] teeth")? },
        tach: TachWheel {
            pulses_per_turn: small(signal.pulses_per_turn, "[tach] pulses_per_rev")?,
            pinion_per_tach: shaft.per_tach(signal) as f32,
            ..defaults.tach
        },
        law: geared(defaults.law, ratio)?,
        ..defaults
    };
    if shaft == OrderShaft::Gear {
        config.mesh.sidebands = MAX_SIDEBANDS as u8;
    }
    if let Some(rate) = forced_rate_hz {
        let highest = f64::from(config.limits.highest_adc.0);
        if !(100.0..=highest).contains(&rate) {
            return Err(Error::invalid("--rate", format!("{rate} Hz is not within the converter's 100 to {highest}")));
        }
        config.policy = RatePolicy::Forced { rate: Hertz(rate as f32) };
    }
    config.validate(TICKS_PER_SECOND).map_err(|error| Error::invalid("the node's configuration", error))?;
    Ok(config)
}

/// The law over the speed of a shaft that turns `ratio` times as fast as the pinion.
fn geared(law: Law, ratio: f64) -> Result<Law> {
    if ratio == 1.0 {
        return Ok(law);
    }
    let ratio = ratio as f32;
    let form = match law.form {
        LawForm::Quadratic { a_per_hz, b, c_hz } => {
            LawForm::Quadratic { a_per_hz: a_per_hz / (ratio * ratio), b: b / ratio, c_hz }
        }
        _ => return Err(Error::invalid("--orders-of", "only a quadratic law can be put on the other shaft")),
    };
    Ok(Law { form, lowest: Hertz(law.lowest.0 * ratio), highest: Hertz(law.highest.0 * ratio), ..law })
}
