//! What moves in each mode: shares of kinetic energy by coordinate, share of the mesh in the strain energy.
//!
//! By Rayleigh's quotient a coordinate's share is how much the frequency answers to its mass, `-2 (df/f) / (dm/m)`,
//! and the mesh's share how much it answers to its stiffness. Taken by differences of one part in 10 000, good to
//! three digits; modes that lie closer together than that change places, and their shares are then of the pair.

use super::assembly::{Coordinate, System};

/// Relative change that the shares are taken from.
const CHANGE: f64 = 1e-4;

/// A mode of a machine at its mean mesh stiffness.
#[derive(Debug, Clone, serde::Serialize)]
pub struct Mode {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// What moves most, with its share of the kinetic energy, largest first; shares above a tenth.
    pub moves: Vec<(String, f64)>,
    /// Share of the mesh in the strain energy.
    pub mesh_share: f64,
}

/// All modes but the rigid rotation, ascending.
pub fn modes(system: &System, mesh_stiffness_n_per_m: f64) -> Vec<Mode> {
    let base = system.natural_frequencies_hz(mesh_stiffness_n_per_m);
    let stiffer = system.natural_frequencies_hz(mesh_stiffness_n_per_m * (1.0 + CHANGE));
    let heavier: Vec<Vec<f64>> = (0..system.len())
        .map(|i| {
            let mut changed = system.clone();
            changed.mass[i] *= 1.0 + CHANGE;
            changed.natural_frequencies_hz(mesh_stiffness_n_per_m)
        })
        .collect();
    let answer = |changed: &[f64], mode: usize| 2.0 * (changed[mode] / base[mode] - 1.0) / CHANGE;
    (1..base.len())
        .map(|mode| {
            let mut moves: Vec<(String, f64)> = (0..system.len())
                .map(|i| (name(system.coordinates[i]).to_owned(), -answer(&heavier[i], mode)))
                .filter(|(_, share)| *share > 0.1)
                .collect();
            moves.sort_by(|a, b| b.1.total_cmp(&a.1));
            Mode { frequency_hz: base[mode], moves, mesh_share: answer(&stiffer, mode).clamp(0.0, 1.0) }
        })
        .collect()
}

fn name(coordinate: Coordinate) -> &'static str {
    match coordinate {
        Coordinate::Motor => "motor turns",
        Coordinate::Rotation(0) => "pinion turns",
        Coordinate::Rotation(_) => "gear turns",
        Coordinate::Load => "load turns",
        Coordinate::Across(0) => "pinion moves across the line of action",
        Coordinate::Across(_) => "gear moves across the line of action",
        Coordinate::Along(0) => "pinion moves along the line of action",
        Coordinate::Along(_) => "gear moves along the line of action",
        Coordinate::CasingAcross => "casing moves across the line of action",
        Coordinate::CasingAlong => "casing moves along the line of action",
    }
}
