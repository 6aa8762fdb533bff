//! Supply and temperature of the chip, and the bias of the sensor behind a divider: ADC1, started by software, of the
//! internal reference, of the temperature sensor and of PA4 in turn.
//!
//! The signals are ADC2's and ADC3's, so that no reading here delays one of theirs. A reading waits for nothing: each
//! call takes the result of the one before and starts the next. Readings are averaged, because a single one of the
//! temperature scatters by more than a kelvin.
//!
//! Supply: the reference's code at 3.3 V, written at the factory, over its code now. Temperature: the straight line
//! between two factory codes at 30 and 110 degrees Celsius, read at 3.3 V; without them the data sheet's typical
//! values, which scatter by tens of kelvins from chip to chip. Sources: RM0090 section 13.10 and 13.11, DS8626 tables
//! of the embedded reference and of the temperature sensor.

use crate::pac::adc1;

/// Channel of the temperature sensor, ADC1 only.
pub const TEMPERATURE_CHANNEL: u8 = 16;
/// Channel of the internal reference, ADC1 only.
pub const REFERENCE_CHANNEL: u8 = 17;
/// Channel of the sensor's bias, PA4.
pub const BIAS_CHANNEL: u8 = 4;
/// Codes of the converter's full scale.
const FULL_SCALE: f32 = 4_096.0;
/// Address of the reference's code; those of the temperature sensor follow.
pub const FACTORY_CODES: u32 = 0x1fff_7a2a;
/// Supply at which the factory codes were read, V.
const FACTORY_SUPPLY_V: f32 = 3.3;
/// Temperatures of the two codes, degrees Celsius.
const FACTORY_TEMPERATURES_C: [f32; 2] = [30.0, 110.0];
/// Plausible factory codes: the reference is 1.18 V to 1.24 V, the sensor falls into the lower half.
const REFERENCE_CODES: core::ops::RangeInclusive<u16> = 1_400..=1_600;
const TEMPERATURE_CODES: core::ops::RangeInclusive<u16> = 700..=2_000;
/// Typical codes at 3.3 V (DS8626): 1.21 V, and 0.76 V at 25 degrees Celsius with 2.5 mV/K.
const TYPICAL_CODES: [u16; 3] = [1_502, 959, 1_207];
/// Share of a new reading in the mean.
const SHARE: f32 = 1.0 / 16.0;
/// Longest sampling time, 480 clocks: 23 us at 21 MHz, of at least 10 us.
const LONGEST_SAMPLING: u32 = 7;

/// What the factory wrote: codes of the reference and of the sensor at its two temperatures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    reference: f32,
    temperature: [f32; 2],
}

impl Calibration {
    /// From the three half-words; what cannot be a code is replaced by the typical one.
    pub fn of(codes: [u16; 3]) -> Self {
        let [reference, cold, hot] = codes;
        let known = TEMPERATURE_CODES.contains(&cold) && TEMPERATURE_CODES.contains(&hot) && hot > cold;
        let [cold, hot] = if known { [cold, hot] } else { [TYPICAL_CODES[1], TYPICAL_CODES[2]] };
        let reference = if REFERENCE_CODES.contains(&reference) { reference } else { TYPICAL_CODES[0] };
        Self { reference: reference.into(), temperature: [cold.into(), hot.into()] }
    }

    /// Supply by the reference's mean code, V.
    pub fn supply_v(&self, reference: f32) -> f32 {
        FACTORY_SUPPLY_V * self.reference / reference.max(1.0)
    }

    /// Temperature by the sensor's mean code at a supply, degrees Celsius.
    pub fn temperature_c(&self, code: f32, supply_v: f32) -> f32 {
        let [cold, hot] = self.temperature;
        let [from, to] = FACTORY_TEMPERATURES_C;
        from + (code * supply_v / FACTORY_SUPPLY_V - cold) / (hot - cold) * (to - from)
    }
}

/// The readings so far.
#[derive(Clone, Copy, Debug)]
pub struct Housekeeping {
    calibration: Calibration,
    /// Channel of the reading under way.
    channel: u8,
    reference: Option<f32>,
    temperature: Option<f32>,
    bias: Option<f32>,
}

impl Housekeeping {
    /// Sets ADC1 up and starts the first reading. The sensor and the reference must be on in the converters' common
    /// register ([`crate::adc::configure`]); the readings of the first 10 us, while they settle, vanish in the mean.
    pub fn start(adc: &adc1::RegisterBlock, calibration: Calibration) -> Self {
        adc.cr1().write(|w| w.res().twelve_bit().scan().disabled());
        let place = |channel: u8| LONGEST_SAMPLING << (3 * (u32::from(channel) - 10));
        // SAFETY: both channels have their three bits there.
        adc.smpr1().write(|w| unsafe { w.bits(place(TEMPERATURE_CHANNEL) | place(REFERENCE_CHANNEL)) });
        // SAFETY: as above; a divider of tens of kilohms charges the converter in that time.
        adc.smpr2().write(|w| unsafe { w.bits(LONGEST_SAMPLING << (3 * u32::from(BIAS_CHANNEL))) });
        adc.sqr1().write(|w| w.l().set(0));
        adc.cr2().write(|w| w.adon().enabled().align().right().cont().single());
        convert(adc, REFERENCE_CHANNEL);
        Self { calibration, channel: REFERENCE_CHANNEL, reference: None, temperature: None, bias: None }
    }

    /// Takes a complete reading and starts the next one; nothing while one is under way.
    pub fn follow(&mut self, adc: &adc1::RegisterBlock) {
        if adc.sr().read().eoc().bit_is_clear() {
            return;
        }
        // Reading the result clears its flag.
        let code = f32::from(adc.dr().read().data().bits());
        let (mean, next) = match self.channel {
            REFERENCE_CHANNEL => (&mut self.reference, TEMPERATURE_CHANNEL),
            TEMPERATURE_CHANNEL => (&mut self.temperature, BIAS_CHANNEL),
            _ => (&mut self.bias, REFERENCE_CHANNEL),
        };
        *mean = Some(mean.map_or(code, |mean| mean + SHARE * (code - mean)));
        self.channel = next;
        convert(adc, self.channel);
    }

    /// Supply, V, once read.
    pub fn supply_v(&self) -> Option<f32> {
        self.reference.map(|code| self.calibration.supply_v(code))
    }

    /// Voltage at the input for the sensor's bias, V, once read.
    pub fn sensor_bias_v(&self) -> Option<f32> {
        Some(self.bias? / FULL_SCALE * self.supply_v()?)
    }

    /// Temperature of the chip, degrees Celsius, once read.
    pub fn temperature_c(&self) -> Option<f32> {
        Some(self.calibration.temperature_c(self.temperature?, self.supply_v()?))
    }
}

fn convert(adc: &adc1::RegisterBlock, channel: u8) {
    // SAFETY: all three channels exist.
    adc.sqr3().write(|w| unsafe { w.sq1().bits(channel) });
    adc.cr2().modify(|_, w| w.swstart().start());
}
