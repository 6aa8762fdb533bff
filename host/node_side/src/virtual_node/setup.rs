//! The node's configuration for a signal: tooth counts, tach, rate policy.

use super::signal::Signal;
use crate::{Error, Result};
use meshband::board::Timing;
use meshband::config::{Configuration, GearPair, SecondSensor, TachWheel};
use meshband::rate_plan::RatePolicy;
use meshband::units::Hertz;

/// A configuration that the node accepts.
///
/// # Errors
/// [`Error::Invalid`] naming the first field out of the node's range.
pub fn configuration(signal: &Signal, forced_rate_hz: Option<f64>) -> Result<Configuration> {
    let small = |value: u32, what: &str| {
        u16::try_from(value).map_err(|_| Error::invalid(what, format!("{value} is beyond the node's range")))
    };
    let defaults = Configuration::default();
    let [pinion, gear] = signal.teeth;
    let mut config = Configuration {
        gears: GearPair { pinion_teeth: small(pinion, "[pair] teeth")?, gear_teeth: small(gear, "[pair] teeth")? },
        tach: TachWheel {
            pulses_per_turn: small(signal.pulses_per_turn, "[tach] pulses_per_rev")?,
            pinion_per_tach: signal.pinion_per_tach as f32,
            ..defaults.tach
        },
        train: signal.train.iter().copied().collect(),
        ..defaults
    };
    let board = if signal.second.is_some() { Timing::STM32F405 } else { Timing::AN386 };
    if let (Some(_), Some(highest)) = (&signal.second, board.highest_of_two) {
        config.second = Some(SecondSensor::default());
        config.limits.highest_adc = highest;
    }
    if let Some(rate) = forced_rate_hz {
        let highest = f64::from(config.limits.highest_adc.0);
        if !(100.0..=highest).contains(&rate) {
            return Err(Error::invalid("--rate", format!("{rate} Hz is not within the converter's 100 to {highest}")));
        }
        config.policy = RatePolicy::Forced { rate: Hertz(rate as f32) };
    }
    config.validate(board).map_err(|error| Error::invalid("the node's configuration", error))?;
    Ok(config)
}
