//! Parts round a meshband node as drivers over embedded-hal 1.0: they know traits of pins and buses, no chip.
//!
//! | driver | needs | does |
//! | --- | --- | --- |
//! | [`status_light::StatusLight`] | [`OutputPin`](embedded_hal::digital::OutputPin) | lights one light by codes |
//! | [`alarm_output::AlarmOutput`] | `OutputPin` | a relay or lamp that follows the node's alarms, fail-safe |
//! | [`sensor_supply::SensorSupply`] | `OutputPin` | feeds the sensor and says when its bias has settled |
//! | [`programmable_gain::ProgrammableGain`] | [`SpiDevice`](embedded_hal::spi::SpiDevice) | gain, MCP6S21 class; [`gain_keeper`] |
//!
//! Time is the board's 32-bit tick counter, which wraps (51 s at 84 MHz): every driver that measures time is polled
//! from the main loop, and [`countdown`] adds up what passed between polls, so any duration may be longer than the
//! wrap.
//!
//! Errors are data: a pin or bus that fails gives its own error back, the driver stays in a state that is named, and
//! the next call tries again. Nothing waits, nothing panics.
#![no_std]
#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod alarm_output;
pub mod countdown;
pub mod gain_keeper;
pub mod programmable_gain;
pub mod sensor_supply;
pub mod status_light;
pub mod switch;
