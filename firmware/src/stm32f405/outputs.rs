//! What the board switches: light, alarm output, sensor supply and the gain of the front end, each by its driver.
//!
//! The choices that a wiring depends on are the constants here; pins are in `meshband_stm32::pins`. Without an
//! amplifier at its pins the gain's words go nowhere, and the gain stays 1 by configuration.

use super::{port_b, port_c, spi2};
use meshband_drivers::alarm_output::{AlarmOutput, Practice};
use meshband_drivers::countdown::ticks_of_ms;
use meshband_drivers::gain_keeper::GainKeeper;
use meshband_drivers::programmable_gain::{Gain, ProgrammableGain};
use meshband_drivers::sensor_supply::{self, SensorSupply};
use meshband_drivers::status_light::StatusLight;
use meshband_drivers::switch::Polarity;
use meshband_stm32::design_parameters::TIMER_HZ;
use meshband_stm32::output::Output;
use meshband_stm32::pac::{gpiob, gpioi};
use meshband_stm32::pins;
use meshband_stm32::spi::{Bus, Device, Fault};

/// Level that lights the light.
const LIGHT: Polarity = Polarity::ActiveLow;
/// Level that energises the alarm output.
const ALARM: Polarity = Polarity::ActiveHigh;
/// When the alarm output is energised.
const ALARM_PRACTICE: Practice = Practice::EnergisedInHealth;
/// Shortest time an alarm is shown.
const ALARM_MINIMUM_MS: u32 = 2_000;
/// Level that switches the sensor on.
const SENSOR: Polarity = Polarity::ActiveHigh;
/// From power to a bias that stands still, for an IEPE sensor behind 1 uF and 100 kohm.
const SENSOR_SETTLING_MS: u32 = 3_000;
/// Pause before a gain that could not be written is tried again.
const RETRY_MS: u32 = 1_000;

type PinB = Output<'static, gpiob::RegisterBlock>;
type PinC = Output<'static, gpioi::RegisterBlock>;

/// The light; for code that has no board too.
pub fn light() -> StatusLight<PinC> {
    StatusLight::new(Output::new(port_c(), pins::LIGHT), LIGHT)
}

/// What is wanted of the outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wanted {
    /// An alarm of the node stands.
    pub alarm: bool,
    /// The sensor is in order.
    pub sensor_ok: bool,
    /// The sensor's supply is to be on.
    pub sensor: bool,
    /// Gain of the front end.
    pub gain: Gain,
}

/// All that is switched.
pub struct Outputs {
    light: StatusLight<PinC>,
    alarm: AlarmOutput<PinC>,
    /// The same driver with the sensor's state: energised while it is in order.
    sensor_ok: AlarmOutput<PinC>,
    supply: SensorSupply<PinC>,
    gain: GainKeeper<Device<'static, PinB>>,
}

impl Outputs {
    /// Everything as `pins` has left it: dark, not energised, off, gain unknown.
    pub fn start() -> Self {
        let pin = |number| Output::new(port_c(), number);
        let amplifier = Device::new(Bus::start(spi2()), Output::new(port_b(), pins::AMPLIFIER_SELECT));
        let minimum = ticks_of_ms(ALARM_MINIMUM_MS, TIMER_HZ);
        Self {
            light: light(),
            alarm: AlarmOutput::new(pin(pins::ALARM), ALARM, ALARM_PRACTICE, minimum),
            sensor_ok: AlarmOutput::new(pin(pins::SENSOR_OK), ALARM, Practice::EnergisedInHealth, minimum),
            supply: SensorSupply::new(pin(pins::SENSOR_SUPPLY), SENSOR, ticks_of_ms(SENSOR_SETTLING_MS, TIMER_HZ)),
            gain: GainKeeper::new(ProgrammableGain::new(amplifier), ticks_of_ms(RETRY_MS, TIMER_HZ)),
        }
    }

    /// Lights the light or puts it out.
    pub fn set_light(&mut self, lit: bool) {
        let Ok(()) = self.light.set(lit);
    }

    /// Once per turn of the main loop. While the sensor settles the alarm output says nothing: neither that all is
    /// well nor that a jump of the bias was an alarm.
    ///
    /// # Errors
    /// The gain could not be written; said once, tried again every second.
    pub fn follow(&mut self, wanted: Wanted, now: u32) -> Result<(), Fault> {
        let Ok(()) = if wanted.sensor { self.supply.switch_on(now) } else { self.supply.switch_off() };
        if !matches!(self.supply.poll(now), sensor_supply::State::Settling(_)) {
            let Ok(_) = self.alarm.update(wanted.alarm, now);
            let Ok(_) = self.sensor_ok.update(!wanted.sensor_ok, now);
        }
        self.gain.follow(wanted.gain, now)
    }

    /// Whether this gain is in use, without doubt.
    pub fn has_gain(&self, gain: Gain) -> bool {
        self.gain.in_use() == Some(gain)
    }
}
