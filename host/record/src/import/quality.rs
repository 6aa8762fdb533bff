//! What a virtual tachometer is asked for and what it gives: pulses, and how far to trust them.

use serde::Serialize;

/// What to look for.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Teeth of pinion and gear.
    pub teeth: [u32; 2],
    /// Mesh frequency, Hz, as the user knows it (within 3 %); searched for where absent.
    pub mesh_guess_hz: Option<f64>,
}

/// Pulses and how far to trust them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct VirtualTach {
    /// One edge per pinion turn, s from the first sample.
    pub edges_s: Vec<f64>,
    /// Quality figures.
    pub quality: Quality,
}

/// How the pulses were made and how good they are.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Quality {
    /// Mean mesh frequency over the record, Hz.
    pub mesh_hz: f64,
    /// Frequency of the mesh line's highest peak, Hz: differs from the mean where the speed drifts.
    pub mesh_line_hz: f64,
    /// Channel whose line was used.
    pub channel: usize,
    /// Mesh harmonic used.
    pub harmonic: u32,
    /// Line power over the noise in the tracking filter, dB.
    pub line_snr_db: f64,
    /// Standard deviation of the line's phase due to noise, rad of the harmonic.
    pub phase_noise_rad: f64,
    /// The same as pulse time, s.
    pub jitter_s: f64,
    /// Measured check: standard deviation of the pulse times against the best candidate of another harmonic
    /// or channel, over sqrt 2, s; absent with a single candidate. Larger than `jitter_s` where the
    /// structure shifts the phase of one line against the other.
    pub cross_check_s: Option<f64>,
    /// Mean pinion speed, Hz.
    pub speed_hz: f64,
    /// Standard deviation of the pinion speed per turn, rpm.
    pub speed_std_rpm: f64,
    /// Mesh frequency over the frequency of the pinion's own line where one stands out: should equal the teeth.
    pub mesh_over_pinion_line: Option<f64>,
    /// Mean excess of the mesh comb over its surroundings, dB per line.
    pub comb_db: f64,
    /// Pulses at either end that are extrapolated.
    pub extrapolated_pulses: usize,
    /// Lines that gave the angle together where the speed had to be followed; absent where one line was steady enough.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub followed_lines: Option<usize>,
}
