//! What survives of the paper's numbers, and what follows from them without a simulation.
//!
//! Source: Zhang et al. 2013, doi 10.1155/2013/462401; only its text is left, tables and equations are lost.

use serde::Serialize;

/// Bandwidth of a healthy pulse in the crack study, by simulation, Hz.
pub const HEALTHY_HZ: f64 = 42_070.0;
/// The same by the paper's equation (10), Hz.
pub const EQUATION_10_HZ: f64 = 43_090.0;
/// Bandwidths of the three peaks and three troughs while the cracked tooth works, Hz.
pub const CRACKED_HZ: [f64; 6] = [42_020.0, 41_920.0, 42_020.0, 41_320.0, 41_220.0, 41_270.0];
/// Pinion speed of those pulses, Hz: inferred (870 rpm), not printed.
pub const INFERRED_HZ: f64 = 14.5;
/// Sampling rates the paper compares, Hz.
pub const RATES_HZ: [f64; 3] = [10e3, 100e3, 1000e3];
/// Pinion teeth, inferred.
pub const TEETH: f64 = 55.0;

/// A pair of lines that the paper calls unknown.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct UnknownLines {
    /// Which of the paper's spectra.
    pub case: &'static str,
    /// Whether the spectrum is of the cracked gear.
    pub cracked: bool,
    /// Whether it was measured; else simulated.
    pub measured: bool,
    /// The lines, Hz.
    pub lines_hz: [f64; 2],
    /// Mesh harmonics that explain them at 10 kHz.
    pub harmonics: [u32; 2],
    /// Mesh frequency quoted beside them, Hz.
    pub quoted_mesh_hz: f64,
}

/// All lines that the paper calls unknown.
pub const UNKNOWN_LINES: [UnknownLines; 4] = [
    UnknownLines {
        case: "healthy, simulated",
        cracked: false,
        measured: false,
        lines_hz: [265.6, 559.0],
        harmonics: [35, 36],
        quoted_mesh_hz: 293.4,
    },
    UnknownLines {
        case: "healthy, measured",
        cracked: false,
        measured: true,
        lines_hz: [263.7, 560.4],
        harmonics: [35, 36],
        quoted_mesh_hz: 293.7,
    },
    UnknownLines {
        case: "cracked, simulated",
        cracked: true,
        measured: false,
        lines_hz: [733.7, 1531.0],
        harmonics: [26, 27],
        quoted_mesh_hz: 797.5,
    },
    UnknownLines {
        case: "cracked, measured",
        cracked: true,
        measured: true,
        lines_hz: [733.4, 1530.0],
        harmonics: [26, 27],
        quoted_mesh_hz: 797.2,
    },
];

/// What a pair of folded lines says about the mesh frequency.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ImpliedMesh {
    /// Mesh frequency by each line alone, Hz.
    pub by_line_hz: [f64; 2],
    /// Mesh frequency that fits both best (least squares in the lines), Hz.
    pub mesh_hz: f64,
    /// Line minus folded harmonic at that mesh frequency, Hz.
    pub residual_hz: [f64; 2],
    /// Relative difference of the two single values: the pair's consistency.
    pub disagreement: f64,
    /// Relative difference of the implied from the quoted mesh frequency.
    pub from_quoted: f64,
}

impl UnknownLines {
    /// The true frequencies if the lines are the harmonics named, folded at `rate_hz`.
    pub fn unfolded_hz(&self, rate_hz: f64) -> [f64; 2] {
        let folds = |i: usize| (f64::from(self.harmonics[i]) * self.quoted_mesh_hz / rate_hz).floor();
        [0, 1].map(|i| folds(i) * rate_hz + self.lines_hz[i])
    }

    /// The mesh frequency that the lines imply at a sampling rate of 10 kHz.
    pub fn implied(&self) -> ImpliedMesh {
        let true_hz = self.unfolded_hz(RATES_HZ[0]);
        let n = self.harmonics.map(f64::from);
        let by_line_hz = [0, 1].map(|i| true_hz[i] / n[i]);
        let mesh_hz = (n[0] * true_hz[0] + n[1] * true_hz[1]) / (n[0] * n[0] + n[1] * n[1]);
        ImpliedMesh {
            by_line_hz,
            mesh_hz,
            residual_hz: [0, 1].map(|i| true_hz[i] - n[i] * mesh_hz),
            disagreement: (by_line_hz[1] - by_line_hz[0]) / mesh_hz,
            from_quoted: mesh_hz / self.quoted_mesh_hz - 1.0,
        }
    }
}
