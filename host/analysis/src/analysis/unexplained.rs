//! Orders that the gear pair does not explain, in families, ranked by their energy.
//!
//! Looked for twice: in the order spectrum of what is locked to neither shaft (a line is lost there where it lies on
//! a whole order of a shaft), and in the squared envelope, where impacts show that excite resonances. Lines that
//! stand at one frequency while the speed wanders are said to: they are of something that does not turn with this
//! machine. Nothing is named as damage.

use super::angle::Angle;
use super::envelope::Envelope;
use super::explained::Explained;
use super::families::{self, Family, Orders};
use super::lines::WINDOW;
use super::order_spectrum::OrderSpectrum;
use super::search::{self, FALSE_ALARM, Level, Line};
use super::skirts::Skirts;
use crate::spectral::amplitude_spectrum;
use serde::Serialize;

/// Lowest order looked at, of the slower shaft's.
const MIN_ORDER_SHARE: f64 = 0.25;
/// Bins over which a fixed frequency must be swept before it can be told from an order.
const SWEPT_BINS: f64 = 4.0;
/// Amplitude over frequency against that over orders from which a line stands at a frequency.
const MIN_STILL_AMPLITUDE_RATIO: f64 = 1.4;
/// Relative distance of base orders that are the same.
const SAME_BASE_SHARE: f64 = 3e-3;

/// A family with where it was seen.
#[derive(Debug, Clone, Serialize)]
pub struct Found {
    /// Lines that belong together.
    #[serde(flatten)]
    pub family: Family,
    /// Whether a family of the same base stands in the other list.
    pub in_both: bool,
    /// Frequency at which its strongest line stands still while the speed wanders, Hz.
    pub fixed_frequency_hz: Option<f64>,
}

/// What the pair does not explain in one channel.
#[derive(Debug, Clone, Serialize)]
pub struct Unexplained {
    /// Probability of any false line in each of the two spectra.
    pub false_alarm: f64,
    /// Families of the order spectrum, most energy first; amplitudes in the record's unit.
    pub spectrum: Vec<Found>,
    /// Families of the squared envelope; amplitudes are shares of the band's mean power.
    pub envelope: Vec<Found>,
}

/// What is known of one channel.
pub struct Channel<'a> {
    /// What is locked to neither shaft, over time.
    pub rest: &'a [f64],
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Its order spectrum.
    pub order_spectrum: &'a OrderSpectrum,
    /// Lines of what is locked to neither shaft.
    pub lines: &'a [Line],
    /// Its envelope.
    pub envelope: &'a Envelope,
    /// RMS of the whole signal in the envelope's band.
    pub band_rms: f64,
}

/// Share of the strongest line below which nothing is listed (-80 dB): what a sensor and a 16-bit converter can hold
/// apart ends there, and a simulated record without noise has lines below it.
const MIN_LINE_SHARE: f64 = 1e-4;
/// Share of its band's RMS below which what is left of the envelope's band is the error of taking the mesh off.
const MIN_BAND_REMNANT_SHARE: f64 = 1e-2;

/// Lowest order that is looked at.
pub fn lowest_order(angle: &Angle) -> f64 {
    MIN_ORDER_SHARE * angle.slower_order()
}

/// Groups what the pair does not explain.
pub fn unexplained(channel: &Channel, angle: &Angle, explained: &Explained, pinion_teeth: u32) -> Unexplained {
    let power = |order: f64| power_near(channel.order_spectrum, order);
    let strongest = channel.order_spectrum.spectrum.values.iter().copied().fold(0.0, f64::max);
    let negligible = MIN_LINE_SHARE * strongest;
    let lines: Vec<Line> = channel
        .lines
        .iter()
        .filter(|line| line.amplitude >= negligible)
        .filter(|line| !explained.swings(line.order, 0.5 * line.amplitude.powi(2), power))
        .copied()
        .collect();
    let orders = Orders {
        teeth: f64::from(pinion_teeth),
        gear_order: angle.gear_order,
        lowest: lowest_order(angle),
        highest: angle.highest_order,
        mesh: true,
    };
    let skirts = Skirts::of(&channel.envelope.levels[0], angle, pinion_teeth, channel.envelope.highest_order);
    let in_its_envelope = explained.with_skirts(skirts);
    let of_shafts = |order: f64, half: f64| in_its_envelope.of_shafts(order, half);
    let in_envelope: Vec<Line> =
        channel.envelope.lines.iter().filter(|line| !of_shafts(line.order, 1.5 * line.bin)).copied().collect();
    // An envelope's lines are shares of what is left of its band: of what taking the mesh off leaves they say nothing.
    let left = channel.envelope.rms >= MIN_BAND_REMNANT_SHARE * channel.band_rms;
    let listed = |line: &Line| line.order >= lowest_order(angle) && left;
    let in_envelope: Vec<Line> = in_envelope.into_iter().filter(listed).collect();
    let envelope_orders = Orders { highest: channel.envelope.highest_order, mesh: false, ..orders };
    let spectrum = families::group(&lines, &orders, &|order, half| explained.at(order, half));
    let envelope = families::group(&in_envelope, &envelope_orders, &of_shafts);
    let both = |family: &Family, others: &[Family]| {
        others.iter().any(|other| (other.base_order - family.base_order).abs() < SAME_BASE_SHARE * family.base_order)
    };
    let fixed = FixedFrequencies::new(channel, angle);
    Unexplained {
        false_alarm: FALSE_ALARM,
        spectrum: spectrum
            .iter()
            .map(|f| Found {
                in_both: both(f, &envelope),
                fixed_frequency_hz: fixed.of(&f.members[0].line, channel.order_spectrum),
                family: f.clone(),
            })
            .collect(),
        envelope: envelope
            .iter()
            .map(|f| Found { in_both: both(f, &spectrum), fixed_frequency_hz: None, family: f.clone() })
            .collect(),
    }
}

/// Mean square of the highest bin within two of `order`.
fn power_near(spectrum: &OrderSpectrum, order: f64) -> f64 {
    let (bin, values) = (spectrum.bin_orders, &spectrum.spectrum.values);
    let centre = (order / bin).round() as usize;
    let last = (centre + 3).min(values.len());
    let near = values.get(centre.saturating_sub(2)..last).unwrap_or_default();
    0.5 * near.iter().copied().fold(0.0, f64::max).powi(2)
}

/// Spectra and lines of residual samples; `explained` learns the feet of the pair's lines.
pub fn lines(residual: &[f64], angle: &Angle, explained: &mut Explained, pinion_teeth: u32) -> (Vec<Level>, Vec<Line>) {
    let highest = angle.highest_order;
    let lowest = lowest_order(angle);
    let densities = search::densities(residual, angle.per_turn[0], angle.slower_order());
    let finest = densities[0].clone().with_floor(&search::Range {
        lowest,
        highest,
        known: &|order, half| explained.at(order, half),
    });
    explained.skirts = Skirts::of(&finest, angle, pinion_teeth, highest);
    let known = |order: f64, half: f64| explained.at(order, half);
    let range = search::Range { lowest, highest, known: &known };
    let levels: Vec<Level> = densities.into_iter().map(|density| density.with_floor(&range)).collect();
    let lines = search::lines(&levels, &range);
    (levels, lines)
}

/// The spectrum over frequency, against which lines over orders are held.
struct FixedFrequencies {
    spectrum: crate::spectral::Spectrum,
    slowest_hz: f64,
    fastest_hz: f64,
}

impl FixedFrequencies {
    fn new(channel: &Channel, angle: &Angle) -> Self {
        Self {
            spectrum: amplitude_spectrum(channel.rest, channel.rate_hz, WINDOW),
            slowest_hz: angle.speed.slowest_hz,
            fastest_hz: angle.speed.fastest_hz,
        }
    }

    /// The frequency at which a line stands higher than in the spectrum over orders.
    fn of(&self, line: &Line, over_orders: &OrderSpectrum) -> Option<f64> {
        let (low, high) = (line.order * self.slowest_hz, line.order * self.fastest_hz);
        if high - low < SWEPT_BINS * self.spectrum.bin {
            return None;
        }
        let margin = 2.0 * self.spectrum.bin;
        let peak = self.spectrum.peak_between(low - margin, high + margin)?;
        let amplitude = (2.0 * power_near(over_orders, line.order)).sqrt();
        (self.spectrum.values[peak] > MIN_STILL_AMPLITUDE_RATIO * amplitude).then(|| self.spectrum.frequency(peak))
    }
}
