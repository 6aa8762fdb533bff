//! Mesh harmonics with the sidebands of both shafts, and what modulation they speak of.
//!
//! A modulation `(1 + m cos(s + a)) cos(c + b sin(s + d))` of a harmonic `C` by a shaft gives the lines `U` above and
//! `L` below; of small indices `U/C + conj(L/C)` has the magnitude of the amplitude modulation and `U/C - conj(L/C)`
//! that of the phase modulation (rad). They are given where both lines stand over the floor with a probability by
//! chance of 1e-3. Limits: a path whose gain differs between the sidebands turns one modulation into a mixture;
//! indices of phase beyond 0.5 rad come out too small (they are 2 J1/J0).

use super::angle::Angle;
use super::lines::OrderLines;
use super::search::Level;
use rustfft::num_complex::Complex64;
use serde::Serialize;

/// Harmonics looked at, sidebands on each side.
const HARMONICS: usize = 12;
const SIDEBANDS: usize = 3;
/// Power over the floor's expectation that noise exceeds once in a thousand lines.
const MIN_FLOOR_POWER_RATIO: f64 = 6.9;

/// A line of known order.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct KnownLine {
    /// Order of the pinion.
    pub order: f64,
    /// Peak amplitude, record's unit.
    pub amplitude: f64,
    /// Whether noise gives such a line less than once in a thousand.
    pub stands: bool,
}

/// A pair of sidebands.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Pair {
    /// Order of the sidebands in turns of their shaft, 1 to 3.
    pub number: usize,
    /// Below the harmonic.
    pub lower: KnownLine,
    /// Above it.
    pub upper: KnownLine,
    /// Mean of both in dB re the harmonic.
    pub level_db: f64,
    /// Index of amplitude modulation, where harmonic and both sidebands stand.
    pub amplitude_index: Option<f64>,
    /// Index of phase modulation, rad, where harmonic and both sidebands stand.
    pub phase_index: Option<f64>,
    /// Whether the other shaft's sidebands (or the mesh's own lines) have the same orders.
    pub shared: bool,
}

/// A mesh harmonic.
#[derive(Debug, Clone, Serialize)]
pub struct Harmonic {
    /// Number, from 1.
    pub number: usize,
    /// Its line.
    pub line: KnownLine,
    /// Frequency at the mean speed, Hz.
    pub frequency_hz: f64,
    /// Sidebands of the pinion's shaft.
    pub pinion: Vec<Pair>,
    /// Sidebands of the gear's shaft.
    pub gear: Vec<Pair>,
    /// Sum of the amplitudes of the sidebands +-1 to +-3 over that of the harmonic, pinion and gear: the definition
    /// of the node (`meshband::zoom::MeshZoom::sideband_energy_ratio`) on these lines; absent where there is no
    /// harmonic.
    pub sideband_energy_ratio: Option<[f64; 2]>,
}

/// The harmonics that the record holds; `floor` is a spectrum over all turns.
pub fn harmonics(lines: &OrderLines, floor: &Level, angle: &Angle, pinion_teeth: u32) -> Vec<Harmonic> {
    let teeth = f64::from(pinion_teeth);
    let reach = SIDEBANDS as f64 * angle.gear_order.max(1.0);
    let count = (((angle.highest_order - reach) / teeth) as usize).min(HARMONICS);
    (1..=count).map(|number| harmonic(lines, floor, angle, teeth, number)).collect()
}

fn harmonic(lines: &OrderLines, floor: &Level, angle: &Angle, teeth: f64, number: usize) -> Harmonic {
    let order = number as f64 * teeth;
    let read = |order: f64| {
        let value = lines.at(order);
        let noise = floor.floor_amplitude(order);
        (
            value,
            KnownLine {
                order,
                amplitude: value.norm(),
                stands: value.norm_sqr() > MIN_FLOOR_POWER_RATIO * noise * noise,
            },
        )
    };
    let (carrier, line) = read(order);
    let of_shaft = |shaft: f64, other: f64| -> Vec<Pair> {
        (1..=SIDEBANDS).map(|n| pair((carrier, &line), n, n as f64 * shaft, other, &read)).collect()
    };
    let (pinion, gear) = (of_shaft(1.0, angle.gear_order), of_shaft(angle.gear_order, 1.0));
    let ratio =
        |pairs: &[Pair]| pairs.iter().map(|p| p.lower.amplitude + p.upper.amplitude).sum::<f64>() / line.amplitude;
    Harmonic {
        number,
        line,
        frequency_hz: order * angle.speed.mean_hz,
        sideband_energy_ratio: line.stands.then(|| [ratio(&pinion), ratio(&gear)]),
        pinion,
        gear,
    }
}

fn pair(
    (carrier, line): (Complex64, &KnownLine),
    number: usize,
    away: f64,
    other: f64,
    read: &impl Fn(f64) -> (Complex64, KnownLine),
) -> Pair {
    let ((below, lower), (above, upper)) = (read(line.order - away), read(line.order + away));
    let stand = line.stands && lower.stands && upper.stands;
    let (up, down) = (above / carrier, (below / carrier).conj());
    let mean = 0.5 * (lower.amplitude + upper.amplitude);
    let multiple = away / other;
    Pair {
        number,
        lower,
        upper,
        level_db: 20.0 * (mean / line.amplitude).log10(),
        // Beyond 1 the carrier is not what is modulated.
        amplitude_index: stand.then(|| (up + down).norm()).filter(|depth| *depth <= 1.0),
        phase_index: stand.then(|| (up - down).norm()),
        shared: multiple > 0.5 && (multiple - multiple.round()).abs() < 1e-9,
    }
}
