//! Options for what only the installation knows; `configure` and `commission` share them.

use clap::Args as ClapArgs;
use meshband_host::link::setup::Installation;

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
            acceleration_per_code: self.sensitivity,
            analogue_stop_hz: self.analogue_stop,
            highest_adc_hz: self.highest_adc,
            harmonics: self.harmonics,
            sidebands: self.sidebands,
        }
    }
}
