//! A line at a frequency: supply hum, another machine, an electronic tone.
//!
//! Bases are the strongest lines of the residual's spectrum over frequency. What decides: while the speed moves, a line at a frequency is narrow there
//! and smeared over orders. Where the speed sweeps it over less than four bins the two cannot be told, which is said (`sharpness`). Harmonics of 50 or 60 Hz read as the
//! supply's; a line near them that follows the load would be a motor's.

use super::Context;
use crate::analysis::search::{self, Range};
use crate::kinematic::candidate::{Candidate, Domain, Kind, Place};

/// Lines of one channel that are tried.
const LINES: usize = 12;
/// Harmonics.
const HARMONICS: usize = 3;
/// Supplies, Hz, and how far their frequency strays.
const SUPPLIES_HZ: [f64; 2] = [50.0, 60.0];
const STRAYS: f64 = 4e-3;

/// Every strong line over frequency.
pub fn candidates(context: &Context) -> Vec<Candidate> {
    let spectra = context.frequency;
    let mut bases: Vec<f64> = Vec::new();
    for channels in &spectra.levels {
        for levels in &channels[..context.scene.searched] {
            let known = |hz: f64, half: f64| context.taken[2].near(hz, half);
            let range = Range { lowest: spectra.lowest, highest: spectra.highest, known: &known };
            let mut lines = search::lines(levels, &range);
            lines.sort_by(|a, b| a.ln_probability.total_cmp(&b.ln_probability));
            bases.extend(lines.iter().take(LINES).map(|line| line.order));
        }
    }
    bases.sort_by(f64::total_cmp);
    bases.dedup_by(|a, b| *a - *b < 2.0 * spectra.bin(0));
    let bins = spectra.highest / spectra.bin(0);
    let shape = |&hz: &f64| {
        [1, HARMONICS].map(|most| Candidate {
            kind: Kind::FixedFrequency,
            base: hz,
            domain: Domain::Frequency,
            places: (1..=most).map(|j| place(hz, j)).filter(|p| p.order < spectra.highest).collect(),
            locked: false,
            // The line was chosen from all bins.
            alternatives: 2.0 * bins,
        })
    };
    bases.iter().flat_map(shape).collect()
}

fn place(hz: f64, j: usize) -> Place {
    Place { order: j as f64 * hz, spacing: j as f64 * hz, label: format!("{j} f") }
}

/// The supply that a frequency is a harmonic of.
pub fn supply_hz(hz: f64) -> Option<f64> {
    SUPPLIES_HZ.into_iter().find(|supply| {
        let n = (hz / supply).round();
        (1.0..=6.0).contains(&n) && (hz / n / supply - 1.0).abs() < STRAYS
    })
}
