//! A line at a frequency: supply hum, another machine, an electronic tone.
//!
//! Bases are the strongest lines of the residual's spectrum over frequency. What decides: while the speed moves, a
//! line at a frequency is narrow there and smeared over orders. Where the speed sweeps it over less than four bins
//! the two cannot be told, which is said (`line_axis`). Harmonics of 50 or 60 Hz read as the supply's; a line near
//! them that follows the load would be a motor's.

use super::Context;
use crate::analysis::lines::LOBE_BINS;
use crate::analysis::search::{self, Range};
use crate::candidate::{Candidate, Domain, Kind, Place};

/// Lines of one channel that are tried.
const LINES: usize = 12;
/// Share of the frequencies that a mesh line sweeps by which it reaches beyond them: its angle swings.
const SWEEP_MARGIN_SHARE: f64 = 0.25;
/// Harmonics.
const HARMONICS: usize = 3;
/// Supplies, Hz, and how far their frequency strays: 0.1 Hz of 50, which large grids hold but for disturbances (EN
/// 50160 allows 0.5 Hz), so that a tone near a harmonic is not called one.
const SUPPLIES_HZ: [f64; 2] = [50.0, 60.0];
const SUPPLY_DRIFT_SHARE: f64 = 2e-3;
/// Harmonics of a supply that are its own.
const SUPPLY_HARMONICS: u32 = 6;

/// Every strong line over frequency; what speckles where a mesh line is smeared is asked for where nothing else stands.
pub fn candidates(context: &Context) -> Vec<Candidate> {
    let beside = bases(context, |hz| is_swept(context, hz));
    shaped(context, if beside.is_empty() { bases(context, |_| false) } else { beside })
}

/// Strongest lines that are neither spoken for nor left out.
fn bases(context: &Context, left_out: impl Fn(f64) -> bool) -> Vec<f64> {
    let spectra = context.frequency;
    let mut bases: Vec<f64> = Vec::new();
    for channels in &spectra.levels {
        for levels in &channels[..context.scene.searched] {
            let known = |hz: f64, half: f64| context.taken[Domain::Frequency as usize].near(hz, half) || left_out(hz);
            let range = Range { lowest: spectra.lowest, highest: spectra.highest, known: &known };
            let mut lines = search::lines(levels, &range);
            lines.sort_by(|a, b| a.ln_probability.total_cmp(&b.ln_probability));
            bases.extend(lines.iter().take(LINES).map(|line| line.order));
        }
    }
    bases.sort_by(f64::total_cmp);
    bases.dedup_by(|a, b| *a - *b < 2.0 * spectra.bin(0));
    bases
}

fn shaped(context: &Context, bases: Vec<f64>) -> Vec<Candidate> {
    let spectra = context.frequency;
    let bins = spectra.highest / spectra.bin(0);
    let shape = |&hz: &f64| {
        [1, HARMONICS].map(|most| Candidate {
            kind: Kind::FixedFrequency,
            base: hz,
            domain: Domain::Frequency,
            places: (1..=most).map(|j| place(hz, j)).filter(|p| p.order < spectra.highest).collect(),
            locked: false,
            // The line was chosen from all bins, or from those that a supply has.
            alternatives: 2.0 * if supply_hz(hz).is_some() { bins_of_supplies(spectra.bin(0)) } else { bins },
        })
    };
    bases.iter().flat_map(shape).collect()
}

/// Whether a mesh line is swept across a frequency.
fn is_swept(context: &Context, hz: f64) -> bool {
    let meshes = context.scene.meshes();
    let by = |z: f64| {
        context.scene.runs.iter().any(|run| {
            let speed = run.angle.speed;
            let k = (hz / z / speed.mean_hz).round().max(1.0);
            let lobes = LOBE_BINS * context.frequency.bin(0)
                + SWEEP_MARGIN_SHARE * k * z * (speed.fastest_hz - speed.slowest_hz);
            let is_of = |k: f64| (k * z * speed.slowest_hz - lobes..=k * z * speed.fastest_hz + lobes).contains(&hz);
            [k - 1.0, k, k + 1.0].into_iter().any(is_of)
        })
    };
    meshes.into_iter().any(by)
}

fn place(hz: f64, j: usize) -> Place {
    Place { order: j as f64 * hz, spacing: j as f64 * hz, label: format!("{j} f") }
}

/// The supply that a frequency is a harmonic of.
pub fn supply_hz(hz: f64) -> Option<f64> {
    SUPPLIES_HZ.into_iter().find(|supply| {
        let n = (hz / supply).round();
        (1..=SUPPLY_HARMONICS).contains(&(n as u32)) && (hz / n / supply - 1.0).abs() < SUPPLY_DRIFT_SHARE
    })
}

/// Bins that a supply or one of its harmonics may stand in, one at least for each.
fn bins_of_supplies(bin: f64) -> f64 {
    let strays =
        |supply: f64| (1..=SUPPLY_HARMONICS).map(move |n| 1.0 + 2.0 * SUPPLY_DRIFT_SHARE * f64::from(n) * supply / bin);
    SUPPLIES_HZ.into_iter().flat_map(strays).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn golden_supplies_have_few_bins_of_all() {
        // Twelve harmonics with a bin each, and two five hundredths of the sum of their frequencies.
        assert!((bins_of_supplies(0.4) - (12.0 + 2.0 * 2e-3 * 21.0 * 110.0 / 0.4)).abs() < 1e-9);
        assert!(bins_of_supplies(1e9) < 12.001, "one for each at least");
    }

    #[test]
    fn golden_a_supplys_harmonics_are_its_own_to_the_sixth_and_to_a_five_hundredth() {
        for (hz, supply) in [(50.0, Some(50.0)), (149.8, Some(50.0)), (360.0, Some(60.0)), (350.0, None), (50.2, None)]
        {
            assert_eq!(supply_hz(hz), supply, "{hz}");
        }
    }
}
