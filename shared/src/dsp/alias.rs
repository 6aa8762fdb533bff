//! Which folded mesh harmonic explains a spectral line.
//!
//! Sampled at a rate R, harmonic n of the mesh frequency appears at |n f - R round(n f / R)|. A line there may be no
//! property of the machine at all: at 10 kHz the 35th harmonic of 293.303 Hz shows up at 265.6 Hz, next to the true
//! first harmonic. The node marks such lines; the host uses the same code. Single precision holds 0.004 Hz at 60 kHz.

use crate::math;

/// What the mesh harmonics say about a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Origin {
    /// A harmonic below the Nyquist frequency.
    Genuine(Match),
    /// A harmonic above the Nyquist frequency, folded.
    Folded(Match),
    /// No harmonic within the tolerance.
    Unexplained,
}

/// A harmonic that falls on a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// Number of the harmonic, 1 for the mesh frequency.
    pub harmonic: u32,
    /// Its true frequency, Hz.
    pub true_hz: f32,
    /// Where it appears, Hz.
    pub appears_hz: f32,
}

/// Where a frequency appears when sampled at `rate_hz`, 0 to half the rate.
pub fn fold(true_hz: f32, rate_hz: f32) -> f32 {
    (true_hz - rate_hz * math::round(true_hz / rate_hz)).abs()
}

/// Explains a line at `line_hz` by harmonics 1..=`highest` of `mesh_hz` sampled at `rate_hz`.
///
/// A genuine harmonic within `tolerance_hz` always wins; among folded ones the nearest, then the lowest. Inputs that
/// are not positive and finite explain nothing.
pub fn explain(line_hz: f32, mesh_hz: f32, rate_hz: f32, tolerance_hz: f32, highest: u32) -> Origin {
    let positive = |x: f32| x.is_finite() && x > 0.0;
    if !(positive(mesh_hz) && positive(rate_hz) && line_hz.is_finite() && tolerance_hz >= 0.0) {
        return Origin::Unexplained;
    }
    let mut best: Option<Match> = None;
    for harmonic in 1..=highest {
        let true_hz = mesh_hz * harmonic as f32;
        let appears_hz = fold(true_hz, rate_hz);
        let distance = (appears_hz - line_hz).abs();
        if distance > tolerance_hz {
            continue;
        }
        let found = Match { harmonic, true_hz, appears_hz };
        if true_hz <= 0.5 * rate_hz {
            return Origin::Genuine(found);
        }
        if best.is_none_or(|best| distance < (best.appears_hz - line_hz).abs()) {
            best = Some(found);
        }
    }
    best.map_or(Origin::Unexplained, Origin::Folded)
}
