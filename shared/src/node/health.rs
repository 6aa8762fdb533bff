//! The node as a device: what it is fed with, how warm it is, where its sensors rest, how right its clock is.
//!
//! The board measures supply and temperature ([`crate::board::Housekeeping`]); the bias of a sensor is the mean of
//! its codes in the latest values, as a voltage of the measured supply: codes are shares of it. [`HealthWatch`] says
//! what the board notes as events.
//!
//! Nothing is corrected by any of it: a supply that is 3 % high makes all accelerations 3 % low, and the event says so.

use super::Node;
use crate::buffers::Arrays;
use crate::node::second_pulse::SecondPulse;
use crate::node::wall_time::{ToldTime, WallTime};
use crate::update::StartCause;
use serde::{Deserialize, Serialize};

/// Supply that the sensors' scale is declared at, V.
pub const NOMINAL_SUPPLY_V: f32 = 3.3;
/// Relative departure of the supply that is worth an event: as much as accelerations are then wrong.
pub const SUPPLY_TOLERANCE: f32 = 0.03;
/// Range of the chip's temperature without an event, degrees Celsius: DS8626's ambient range of the industrial part.
pub const TEMPERATURE_C: [f32; 2] = [-40.0, 85.0];
/// Share of the tolerance within which the supply counts as good again.
const SUPPLY_RETURN: f32 = 2.0 / 3.0;
/// Back inside the range by so much the temperature counts as good again, K.
const TEMPERATURE_RETURN_K: f32 = 3.0;
/// Codes of the converter's full scale.
const FULL_SCALE: f32 = 65_536.0;

/// What a board measures of itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BoardHealth {
    /// Supply and reference of the converters, V.
    pub supply_v: Option<f32>,
    /// Temperature of the chip, degrees Celsius.
    pub temperature_c: Option<f32>,
    /// Voltage at the input for a sensor's bias, behind its divider, V.
    pub sensor_bias_v: Option<f32>,
}

/// The node as a device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Health {
    /// Latest tick the node knew, since start.
    pub tick: u64,
    /// Since the start, s.
    pub uptime_s: u32,
    /// Why it started.
    pub started: StartCause,
    /// Supply and reference of the converters, V.
    pub supply_v: Option<f32>,
    /// Temperature of the chip, degrees Celsius.
    pub temperature_c: Option<f32>,
    /// Mean of the first sensor's signal at the converter, V; none without values or without a measured supply.
    pub bias_v: Option<f32>,
    /// The same of the second sensor.
    pub second_bias_v: Option<f32>,
    /// The node's clock against a pulse per second; none without such pulses.
    pub second_pulse: Option<SecondPulse>,
    /// Time of day; none until a host has told it.
    pub wall_time: Option<WallTime>,
    /// Bias at the sensor itself, V; none without a divider for it.
    pub sensor_bias_v: Option<f32>,
}

/// A change worth an event.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HealthChange {
    /// The supply has left its tolerance, V.
    Supply(f32),
    /// The temperature has left its range, degrees Celsius.
    Temperature(f32),
}

/// Whether supply and temperature were good when last looked at.
#[derive(Clone, Copy, Debug, Default)]
pub struct HealthWatch {
    supply_bad: bool,
    temperature_bad: bool,
}

impl HealthWatch {
    /// Looks at what the board measures; gives each departure once, and again only after a return well within the
    /// limits.
    pub fn follow(&mut self, board: BoardHealth) -> [Option<HealthChange>; 2] {
        let supply = board.supply_v.and_then(|volts| {
            let off = (volts / NOMINAL_SUPPLY_V - 1.0).abs();
            let bound = if self.supply_bad { SUPPLY_TOLERANCE * SUPPLY_RETURN } else { SUPPLY_TOLERANCE };
            rises(&mut self.supply_bad, off > bound).then_some(HealthChange::Supply(volts))
        });
        let temperature = board.temperature_c.and_then(|celsius| {
            let margin = if self.temperature_bad { TEMPERATURE_RETURN_K } else { 0.0 };
            let bad = celsius < TEMPERATURE_C[0] + margin || celsius > TEMPERATURE_C[1] - margin;
            rises(&mut self.temperature_bad, bad).then_some(HealthChange::Temperature(celsius))
        });
        [supply, temperature]
    }
}

fn rises(state: &mut bool, now: bool) -> bool {
    !core::mem::replace(state, now) && now
}

impl<A: Arrays> Node<A> {
    /// Tells the node what the board measures of itself.
    pub fn set_board_health(&mut self, health: BoardHealth) {
        self.board_health = health;
    }

    /// Tells the node that its clock is no better than this, parts per million.
    pub fn set_clock_tolerance(&mut self, tolerance_ppm: f32) {
        self.wall_clock.set_tolerance(tolerance_ppm);
    }

    /// The pulse per second has come, captured at a tick.
    pub fn on_second_pulse(&mut self, tick: u32) {
        let instant = self.extend(tick);
        self.pulse_clock.on_pulse(instant, self.clock);
    }

    /// The host's time of day, as of now.
    pub(super) fn set_wall_time(&mut self, told: ToldTime) {
        self.wall_clock.set(self.lifetime().0, told);
    }

    /// Bias at the sensor itself, V.
    fn sensor_bias_v(&self) -> Option<f32> {
        let divider = self.config.sensor_check.bias_divider;
        self.board_health.sensor_bias_v.filter(|_| divider > 0.0).map(|volts| volts * divider)
    }

    /// The node as a device, at the latest tick known.
    pub fn health(&self) -> Health {
        let (now, started) = self.lifetime();
        let second_pulse = self.pulse_clock.report(now, self.clock);
        let bias_v = |code: Option<f32>| Some(code? / FULL_SCALE * self.board_health.supply_v?);
        Health {
            tick: now,
            uptime_s: (now.saturating_sub(started) / u64::from(self.clock.0.max(1))).min(u64::from(u32::MAX)) as u32,
            started: self.identity.image.started,
            supply_v: self.board_health.supply_v,
            temperature_c: self.board_health.temperature_c,
            bias_v: bias_v(self.bias_codes[0]),
            second_bias_v: bias_v(self.bias_codes[1]),
            second_pulse,
            wall_time: self.wall_clock.at(now, self.clock, second_pulse.as_ref()),
            sensor_bias_v: self.sensor_bias_v(),
        }
    }
}
