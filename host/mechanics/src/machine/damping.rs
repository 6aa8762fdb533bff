//! Damping of shafts whose file has none: no catalogue states it, and a machine must not be refused for what nobody
//! knows.
//!
//! Couplings get 5 % of critical between the two inertias that they join, bearings 4 % on the mass of their gear:
//! what `machine new` guesses for ball bearings. The loop fits damping anyway where it is not declared well.

use super::Shafts;
use serde::Deserialize;

/// Damping ratio of a coupling.
pub const COUPLING: f64 = 0.05;
/// Damping ratio of a rolling bearing.
pub const BEARING: f64 = 0.04;

/// `[shafts]` as a file has it: damping may be missing.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DeclaredShafts {
    inertia_motor_kg_m2: f64,
    inertia_pinion_kg_m2: f64,
    inertia_gear_kg_m2: f64,
    inertia_load_kg_m2: f64,
    coupling_stiffness_n_m_per_rad: [f64; 2],
    coupling_damping_n_m_s_per_rad: Option<[f64; 2]>,
    mass_kg: [f64; 2],
    bearing_stiffness_n_per_m: [f64; 2],
    bearing_damping_n_s_per_m: Option<[f64; 2]>,
}

impl From<DeclaredShafts> for Shafts {
    fn from(declared: DeclaredShafts) -> Self {
        let DeclaredShafts {
            inertia_motor_kg_m2,
            inertia_pinion_kg_m2,
            inertia_gear_kg_m2,
            inertia_load_kg_m2,
            coupling_stiffness_n_m_per_rad,
            coupling_damping_n_m_s_per_rad,
            mass_kg,
            bearing_stiffness_n_per_m,
            bearing_damping_n_s_per_m,
        } = declared;
        let ends = [[inertia_motor_kg_m2, inertia_pinion_kg_m2], [inertia_gear_kg_m2, inertia_load_kg_m2]];
        let coupling = |i: usize| of_coupling(COUPLING, coupling_stiffness_n_m_per_rad[i], ends[i]);
        let bearing = |i: usize| of_bearing(BEARING, bearing_stiffness_n_per_m[i], mass_kg[i]);
        Self {
            inertia_motor_kg_m2,
            inertia_pinion_kg_m2,
            inertia_gear_kg_m2,
            inertia_load_kg_m2,
            coupling_stiffness_n_m_per_rad,
            coupling_damping_n_m_s_per_rad: coupling_damping_n_m_s_per_rad.unwrap_or_else(|| [0, 1].map(coupling)),
            mass_kg,
            bearing_stiffness_n_per_m,
            bearing_damping_n_s_per_m: bearing_damping_n_s_per_m.unwrap_or_else(|| [0, 1].map(bearing)),
        }
    }
}

/// Damping of a coupling, N m s/rad, from its ratio, its stiffness and the inertias at its ends.
pub fn of_coupling(ratio: f64, stiffness_n_m_per_rad: f64, [a, b]: [f64; 2]) -> f64 {
    2.0 * ratio * (stiffness_n_m_per_rad * a * b / (a + b)).sqrt()
}

/// Damping of a bearing, N s/m, from its ratio, its stiffness and the mass on it.
pub fn of_bearing(ratio: f64, stiffness_n_per_m: f64, mass_kg: f64) -> f64 {
    2.0 * ratio * (stiffness_n_per_m * mass_kg).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: &str = "inertia_motor_kg_m2 = 0.004\ninertia_pinion_kg_m2 = 0.001\ninertia_gear_kg_m2 = 0.01\n\
        inertia_load_kg_m2 = 0.02\ncoupling_stiffness_n_m_per_rad = [3e4, 5e4]\nmass_kg = [1.0, 4.0]\n\
        bearing_stiffness_n_per_m = [1e8, 1e8]\n";

    #[test]
    fn claim_shafts_without_damping_get_shares_of_critical_and_declared_damping_is_kept() {
        let shafts: Shafts = toml::from_str(TABLE).expect("damping may be missing");
        assert!((shafts.bearing_damping_n_s_per_m[1] - 0.08 * 2e4).abs() < 1e-9, "{shafts:?}");
        assert!((shafts.coupling_damping_n_m_s_per_rad[0] - 0.1 * 24.0_f64.sqrt()).abs() < 1e-9, "{shafts:?}");
        let declared = format!("{TABLE}coupling_damping_n_m_s_per_rad = [0.5, 1.2]\n");
        let shafts: Shafts = toml::from_str(&declared).expect("declared damping");
        assert_eq!(shafts.coupling_damping_n_m_s_per_rad, [0.5, 1.2]);
    }

    #[test]
    fn fault_an_unknown_key_of_shafts_is_refused() {
        let wrong = format!("{TABLE}coupling_dampling = [0.5, 1.2]\n");
        assert!(toml::from_str::<Shafts>(&wrong).is_err());
    }
}
