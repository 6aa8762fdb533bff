//! Options for what only the installation knows; `configure` and `commission` share them.

use clap::Args as ClapArgs;
use meshband_host::link::setup::Installation;

/// Reference of the converter, V, and its codes.
const REFERENCE_V: f32 = 3.3;
const CODES: f32 = 65_536.0;
/// Standard gravity, m/s2.
const GRAVITY: f32 = 9.806_65;
/// Sensitivities that accelerometers have, V per g.
const SENSITIVITIES_V_PER_G: std::ops::RangeInclusive<f32> = 0.001..=10.0;

/// Acceleration per code, m/s2, of a sensor of so many V per g.
fn per_code(volt_per_g: f32) -> f32 {
    REFERENCE_V / CODES / volt_per_g * GRAVITY
}

fn volt_per_g(text: &str) -> Result<f32, String> {
    let value: f32 = text.parse().map_err(|_| format!("'{}' is no number", meshband_host::text::name(text)))?;
    if SENSITIVITIES_V_PER_G.contains(&value) {
        return Ok(value);
    }
    Err(format!("{value} V per g is outside 0.001 to 10: {value} mV/g is {}", value / 1000.0))
}

/// Tach wheel, sensor, filter.
#[derive(ClapArgs)]
pub struct InstallationArgs {
    /// Tach pulse positions per turn, missing ones included.
    #[arg(long)]
    pub pulses: Option<u16>,
    /// Adjacent missing teeth of the tach wheel.
    #[arg(long)]
    pub missing: Option<u16>,
    /// Turns of the pinion per turn of the tach shaft.
    #[arg(long)]
    pub ratio: Option<f32>,
    /// Acceleration per 16-bit ADC code, m/s2.
    #[arg(long, allow_negative_numbers = true)]
    pub sensitivity: Option<f32>,
    /// Sensor's sensitivity, V per g, instead of --sensitivity: as 0.1 for 100 mV/g, at a converter reference of 3.3
    /// V and gain 1.
    #[arg(long, conflicts_with = "sensitivity", value_parser = volt_per_g)]
    pub volt_per_g: Option<f32>,
    /// Stop edge of the analogue filter, Hz.
    #[arg(long)]
    pub analogue_stop: Option<f32>,
    /// Highest ADC rate, Hz.
    #[arg(long)]
    pub highest_adc: Option<f32>,
    /// Mesh harmonics to report.
    #[arg(long)]
    pub harmonics: Option<u8>,
    /// Sideband pairs to report per harmonic.
    #[arg(long)]
    pub sidebands: Option<u8>,
}

impl InstallationArgs {
    /// As the configuration takes them; `teeth` instead of a machine's.
    pub fn facts(&self, teeth: Option<[u16; 2]>) -> Installation {
        Installation {
            teeth,
            pulses_per_turn: self.pulses,
            missing: self.missing,
            pinion_per_tach: self.ratio,
            acceleration_per_code: self.sensitivity.or(self.volt_per_g.map(per_code)),
            analogue_stop_hz: self.analogue_stop,
            highest_adc_hz: self.highest_adc,
            harmonics: self.harmonics,
            sidebands: self.sidebands,
            machine_class: None,
        }
    }
}
