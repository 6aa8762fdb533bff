//! The lines beside the mesh lines of the paper's own records (10 kHz sampling): quoted, not explained there.
//!
//! The model without acquisition has energy only at mesh harmonics and shaft sidebands; its nearest line is the error
//! before. The effect it lacks is aliasing: harmonics above the Nyquist frequency fold. One mesh frequency per record
//! is fitted to the pair of lines; the quoted mesh frequency serves as a check that is not fitted. Source: Zhang et
//! al. 2013, text of section 4.

use crate::Result;
use serde::Serialize;

const RATE_HZ: f64 = 10_000.0;
const MAX_HARMONIC: u32 = 60;

/// One record as quoted.
struct Quoted {
    case: &'static str,
    mesh_hz: f64,
    twice_mesh_hz: f64,
    lines_hz: [f64; 2],
}

const QUOTED_RECORDS: [Quoted; 4] = [
    Quoted { case: "healthy, measured", mesh_hz: 293.7, twice_mesh_hz: 587.1, lines_hz: [263.7, 560.4] },
    Quoted { case: "healthy, simulated", mesh_hz: 293.4, twice_mesh_hz: 586.6, lines_hz: [265.6, 559.0] },
    Quoted { case: "crack, measured", mesh_hz: 797.2, twice_mesh_hz: 1597.0, lines_hz: [733.4, 1530.0] },
    Quoted { case: "crack, simulated", mesh_hz: 797.5, twice_mesh_hz: 1595.0, lines_hz: [733.7, 1531.0] },
];

/// One explained line.
#[derive(Debug, Clone, Serialize)]
pub struct Line {
    /// Which record.
    pub case: String,
    /// Quoted line, Hz.
    pub line_hz: f64,
    /// Distance to the nearest mesh harmonic of the model without acquisition, Hz.
    pub error_before_hz: f64,
    /// Folded harmonic that explains it.
    pub harmonic: u32,
    /// Mesh frequency that this line alone implies, Hz.
    pub implied_mesh_hz: f64,
    /// Distance to the folded harmonic of the record's *quoted* mesh frequency (nothing fitted), Hz.
    pub error_quoted_mesh_hz: f64,
    /// Distance to it after one mesh frequency per record is fitted, Hz.
    pub error_after_hz: f64,
}

/// Result of one record.
#[derive(Debug, Clone, Serialize)]
pub struct Case {
    /// Which record.
    pub case: String,
    /// Quoted mesh frequency, Hz.
    pub quoted_mesh_hz: f64,
    /// Half of the quoted second harmonic, Hz.
    pub half_of_quoted_second_hz: f64,
    /// Fitted mesh frequency, Hz.
    pub fitted_mesh_hz: f64,
    /// Relative difference between the mesh frequencies implied by its two lines.
    pub disagreement: f64,
    /// Its lines.
    pub lines: Vec<Line>,
}

/// All records.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Name of the effect.
    pub effect: &'static str,
    /// Records.
    pub cases: Vec<Case>,
}

fn fold(hz: f64) -> f64 {
    (hz - RATE_HZ * (hz / RATE_HZ).round()).abs()
}

/// Mesh frequency near `guess` whose harmonic appears exactly at the line.
fn implied(line_hz: f64, harmonic: u32, guess: f64) -> f64 {
    let n = f64::from(harmonic);
    let turns = (n * guess / RATE_HZ).round();
    [turns * RATE_HZ - line_hz, turns * RATE_HZ + line_hz]
        .map(|hz| hz / n)
        .into_iter()
        .min_by(|a, b| (a - guess).abs().total_cmp(&(b - guess).abs()))
        .unwrap_or(guess)
}

/// The analysis; needs no data but the quoted numbers.
///
/// # Errors
/// None today; the signature is that of the other data sets.
pub fn run() -> Result<Outcome> {
    let cases = QUOTED_RECORDS.iter().map(case).collect();
    Ok(Outcome { rate_hz: RATE_HZ, effect: "aliasing: no effective filter below half the sampling rate", cases })
}

fn case(quoted: &Quoted) -> Case {
    // Pair of harmonics above the Nyquist frequency whose implied mesh frequencies agree best with each other and
    // with the quoted one; neighbours, because the lines lie beside neighbouring mesh harmonics.
    let nyquist = (0.5 * RATE_HZ / quoted.mesh_hz).ceil() as u32;
    let mut best: Option<(f64, u32, [f64; 2])> = None;
    for n in nyquist..MAX_HARMONIC {
        let m = [implied(quoted.lines_hz[0], n, quoted.mesh_hz), implied(quoted.lines_hz[1], n + 1, quoted.mesh_hz)];
        let cost = (m[0] - m[1]).abs() + 0.5 * (m[0] + m[1] - 2.0 * quoted.mesh_hz).abs();
        if best.is_none_or(|b| cost < b.0) {
            best = Some((cost, n, m));
        }
    }
    let (_, n, m) = best.unwrap_or((0.0, nyquist, [quoted.mesh_hz; 2]));
    // Equal reading errors of both lines: weights n^2.
    let (a, b) = (f64::from(n).powi(2), f64::from(n + 1).powi(2));
    let fitted = (a * m[0] + b * m[1]) / (a + b);
    let lines = [0, 1]
        .map(|i| {
            let harmonic = n + i as u32;
            let line_hz = quoted.lines_hz[i];
            let before =
                (1..=17).map(|h| (line_hz - f64::from(h) * quoted.mesh_hz).abs()).fold(f64::INFINITY, f64::min);
            Line {
                case: quoted.case.into(),
                line_hz,
                error_before_hz: before,
                harmonic,
                implied_mesh_hz: m[i],
                error_quoted_mesh_hz: (fold(f64::from(harmonic) * quoted.mesh_hz) - line_hz).abs(),
                error_after_hz: (fold(f64::from(harmonic) * fitted) - line_hz).abs(),
            }
        })
        .to_vec();
    Case {
        case: quoted.case.into(),
        quoted_mesh_hz: quoted.mesh_hz,
        half_of_quoted_second_hz: 0.5 * quoted.twice_mesh_hz,
        fitted_mesh_hz: fitted,
        disagreement: (m[0] - m[1]).abs() / fitted,
        lines,
    }
}

impl Outcome {
    /// Table for the terminal.
    pub fn summary(&self) -> String {
        let mut rows = Vec::new();
        for case in &self.cases {
            for l in &case.lines {
                rows.push(vec![
                    format!("{} {:.1}", case.case, l.line_hz),
                    format!("{:.1}", l.error_before_hz),
                    l.harmonic.to_string(),
                    format!("{:.3}", l.implied_mesh_hz),
                    format!("{:.2}", l.error_quoted_mesh_hz),
                    format!("{:.2}", l.error_after_hz),
                ]);
            }
        }
        let head = ["line, Hz", "before, Hz", "harmonic", "implied mesh", "quoted mesh, Hz off", "after, Hz"];
        let mut text = crate::terminal::table(&head, &rows);
        for c in &self.cases {
            text += &format!(
                "{}: fitted mesh {:.3} Hz, quoted {:.1} and {:.2}; its two lines disagree by {:.1e}\n",
                c.case, c.fitted_mesh_hz, c.quoted_mesh_hz, c.half_of_quoted_second_hz, c.disagreement
            );
        }
        text
    }
}
