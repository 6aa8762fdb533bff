//! Detection floor of an effect: the strength at which its strongest line reaches 6 sqrt(S/T) in three runs.
//!
//! Two records without noise, with the effect at a reference strength and without it; the difference's lines against
//! the noise density give the factor to the floor. Effects are taken as linear in their strength, which holds near
//! the floor. Source: reference recipe, detection theory.

use crate::Result;
use crate::effects::hypothesis::{Draw, Hidden};
use crate::generate::{Scenario, record};
use crate::model_based::base_fit::Base;
use crate::observation::input::Record;
use crate::observation::spectrum::Analyser;
use crate::spectral::{Window, amplitude_spectrum};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// One-sided density of the generator's noise and of its converter's steps at `hz`, (m/s2)^2/Hz.
fn density(scenario: &Scenario, rate_hz: f64, hz: f64) -> f64 {
    let c = scenario.noise_colour;
    let shape = (1.0 - c * c) / (1.0 - 2.0 * c * (TAU * hz / rate_hz).cos() + c * c);
    2.0 * (scenario.noise_rms.powi(2) * shape + scenario.step_m_s2.powi(2) / 12.0) / rate_hz
}

/// NRMSE of the whole signal that what was put in at random alone would leave on `runs` of a record: noise, the
/// converter's steps, and the jitter of the tachometer's edges, which are all that a prediction knows of a run's
/// angle and speed.
pub fn true_floor(record: &Record, scenario: &Scenario, runs: &[usize]) -> f64 {
    let samples = record.runs.iter().map(|r| r.channels[0].len()).min().unwrap_or(0);
    let analyser = Analyser::new(samples, record.sample_rate_hz);
    let per_density = 0.5 * record.sample_rate_hz * analyser.bin_power_of_unit_variance();
    let lowest = (3.0 * analyser.duration_s()) as usize;
    let own: f64 = (lowest..analyser.bins)
        .map(|b| density(scenario, record.sample_rate_hz, b as f64 / analyser.duration_s()) * per_density)
        .sum();
    let base = Base::new(record);
    let (mut whole, mut timing) = (1e-300, 0.0);
    let above = |bins: &mut dyn Iterator<Item = f64>| bins.skip(lowest).sum::<f64>();
    for &r in runs {
        whole += base.runs[r].measured.iter().map(|bins| above(&mut bins.iter().map(|x| x.norm_sqr()))).sum::<f64>();
        timing += base.timing_power(r).iter().map(|power| above(&mut power.iter().copied())).sum::<f64>();
    }
    ((2.0 * runs.len() as f64 * own + timing) / whole).sqrt()
}

/// Strength of `hidden` at the detection floor for the noise of `scenario`, and the largest acceleration of each
/// channel without it.
///
/// # Errors
/// Those of [`record`].
pub fn strength(
    declared: &Record,
    scenario: &Scenario,
    hidden: &Hidden,
    random: &mut ChaCha8Rng,
) -> Result<(f64, [f64; 2])> {
    let mut quiet = scenario.clone();
    quiet.effects.clear();
    quiet.noise_rms = 0.0;
    let make = |s: &Scenario| record(&declared.pair, &declared.shafts, &declared.curve, s);
    let plain = make(&quiet)?;
    let peak = |c: usize| plain.runs.iter().flat_map(|r| &r.channels[c]).fold(0.0_f64, |m, x| m.max(x.abs()));
    let peak_m_s2 = [0, 1].map(peak);
    if !hidden.has_floor {
        return Ok((hidden.reference, peak_m_s2));
    }
    let mut with = quiet.clone();
    let mut draw = Draw { teeth: declared.pair.teeth, peak_m_s2, random };
    with.effects.extend((hidden.draw)(hidden.reference, &mut draw));
    let with = make(&with)?;
    let mut ratios: Vec<f64> = plain
        .runs
        .iter()
        .zip(&with.runs)
        .map(|(a, b)| {
            [0, 1]
                .map(|c| {
                    let difference: Vec<f64> = b.channels[c].iter().zip(&a.channels[c]).map(|(b, a)| b - a).collect();
                    let lines = amplitude_spectrum(&difference, plain.sample_rate_hz, Window::Hann);
                    let seconds = difference.len() as f64 / plain.sample_rate_hz;
                    (1..lines.values.len())
                        .map(|i| (lines.frequency(i), lines.values[i]))
                        .filter(|(hz, _)| (8.0..15_000.0).contains(hz))
                        .map(|(hz, a)| a / (6.0 * (density(scenario, plain.sample_rate_hz, hz) / seconds).sqrt()))
                        .fold(0.0, f64::max)
                })
                .into_iter()
                .fold(0.0, f64::max)
        })
        .collect();
    ratios.sort_by(|a, b| b.total_cmp(a));
    let third = ratios.get(2).or(ratios.last()).copied().unwrap_or(0.0);
    Ok((hidden.reference / third.max(1e-9), peak_m_s2))
}
