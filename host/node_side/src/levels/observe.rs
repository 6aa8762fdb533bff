//! The values of a sound machine, as the node that will watch it computed them.

use meshband::mesh_band::sideband_amplitude;
use meshband::message::{Message, Tag};
use meshband::tach::Validity;

/// Quantities that have expected levels, by their names in the node's tables: those of
/// [`meshband::levels::LevelPoint`], then those of
/// [`meshband::levels::LocalPoint`].
pub const QUANTITIES: [&str; 6] = ["rms", "velocity_rms", "mesh_amplitude", "residual_rms", "sidebands", "fm0"];

/// A value at a speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Pinion rate, Hz.
    pub speed_hz: f64,
    /// 20 log10 of the value in its unit, dB.
    pub level_db: f64,
}

/// Everything observed, by quantity.
#[derive(Debug, Clone, Default)]
pub struct Observations {
    /// In the order of [`QUANTITIES`].
    pub by_quantity: [Vec<Observation>; QUANTITIES.len()],
}

impl Observations {
    /// Takes what a message has of good quality and at a locked speed.
    pub fn take(&mut self, message: &Message) {
        match message {
            Message::Indicators(values) => {
                if values.quality.is_good() && is_locked(&values.tag) {
                    self.add(0, values.tag.speed_hz, values.rms);
                    self.add(1, values.tag.speed_hz, values.velocity_rms);
                }
                if let Some(gear) = &values.gear {
                    self.add(3, gear.speed_hz, gear.residual_rms);
                    self.add(5, gear.speed_hz, gear.fm0);
                }
            }
            Message::Spectrum(spectrum) if is_locked(&spectrum.tag) => {
                if let Some(band) = spectrum.bands.first() {
                    self.add(2, spectrum.tag.speed_hz, band.line.amplitude);
                    self.add(4, spectrum.tag.speed_hz, sideband_amplitude(&spectrum.bands, spectrum.inseparable));
                }
            }
            _ => {}
        }
    }

    /// All of another set as well.
    pub fn extend(&mut self, other: Self) {
        for (all, more) in self.by_quantity.iter_mut().zip(other.by_quantity) {
            all.extend(more);
        }
    }

    fn add(&mut self, quantity: usize, speed_hz: f32, value: f32) {
        if value > 0.0 && value.is_finite() && speed_hz > 0.0 {
            let level_db = 20.0 * f64::from(value).log10();
            self.by_quantity[quantity].push(Observation { speed_hz: f64::from(speed_hz), level_db });
        }
    }
}

fn is_locked(tag: &Tag) -> bool {
    tag.validity == Validity::Locked
}
