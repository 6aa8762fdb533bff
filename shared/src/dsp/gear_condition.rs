//! From a synchronous average to the gear condition indicators that are sent.
//!
//! FM0 of the average, NA4 of the residual, kurtosis (FM4) and M6A of the difference signal, by the definitions of
//! [`crate::indicators`]. Regular lines are the constant, shaft orders 1 and 2 and all mesh harmonics; the difference
//! signal also lacks their first sidebands.
//!
//! The regular signal itself is not needed: its power is that of its lines. Cost: two FFTs and two inverse ones,
//! about 0.35 M instructions for 1024 samples, once per average.

use crate::indicators::{Moments, fm0_of};
use crate::message::GearIndicators;
use crate::spectrum::{SpectrumError, real_fft};
use crate::tsa::{self, RegularLines};

/// Shaft orders that count as regular.
const SHAFT_ORDERS: u16 = 2;
/// Sidebands on each side that the difference signal lacks.
const SIDEBANDS: u16 = 1;

/// Indicators of one average of the pinion. `work` and `split` are as long as `average` and overwritten; `na4` gives
/// the indicator of the residual's moments against an ensemble. Time and turns of the result are the caller's to fill.
///
/// # Errors
/// Lengths that differ, or no supported power of two.
pub fn of_average(
    average: &[f32],
    pinion_teeth: u16,
    na4: impl FnOnce(&Moments) -> f32,
    work: &mut [f32],
    split: &mut [f32],
) -> Result<GearIndicators, SpectrumError> {
    let lines = RegularLines { teeth: pinion_teeth, shaft_orders: SHAFT_ORDERS, sidebands: SIDEBANDS };
    let whole = Moments::of(average);
    if work.len() != average.len() {
        return Err(SpectrumError::Output);
    }
    work.copy_from_slice(average);
    let bins = real_fft(work)?;
    let fm0 = fm0_of(bins, pinion_teeth, &whole);
    let regular_rms = tsa::regular_rms(bins, &lines);
    tsa::residual_of(bins, &lines, split)?;
    let residual = Moments::of(split);
    tsa::difference(average, &lines, work, split)?;
    let difference = Moments::of(split);
    Ok(GearIndicators {
        rms: whole.rms(),
        crest: whole.crest(),
        kurtosis: whole.kurtosis,
        regular_rms,
        residual_rms: residual.rms(),
        difference_rms: difference.rms(),
        fm0: fm0.unwrap_or(0.0),
        fm4: difference.kurtosis,
        m6a: difference.sixth,
        na4: na4(&residual),
        ..GearIndicators::default()
    })
}
