//! The declared machine: what its owner states about gears, shafts and acquisition, in SI units.
//!
//! The same tables appear in `machines/*.toml` and in the `record.toml` of a record folder, so that a
//! record carries its machine with it. Reading checks every value and names table and key of the first
//! one that makes no sense.

use serde::{Deserialize, Serialize};

/// A gear pair with its shafts, as declared.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Machine {
    /// Short name for reports.
    pub title: String,
    /// Geometry, material and mesh of the pair.
    pub pair: Pair,
    /// Inertias, masses, couplings and bearings.
    pub shafts: Shafts,
}

/// Two external spur gears; index 0 is the pinion (driving), 1 the gear.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pair {
    /// Numbers of teeth.
    pub teeth: [u32; 2],
    /// Module, m.
    pub module_m: f64,
    /// Pressure angle at the pitch circle, degrees.
    #[serde(default = "Pair::default_pressure_angle")]
    pub pressure_angle_deg: f64,
    /// Common face width, m.
    pub face_width_m: f64,
    /// Bore (hub) radii, m.
    pub bore_radius_m: [f64; 2],
    /// Young's modulus, Pa.
    pub youngs_modulus_pa: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Table of one tooth pair's stiffness along the path of contact (CSV, relative to the declaration's folder).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pair_stiffness: Option<std::path::PathBuf>,
    /// Damping of each tooth pair: this time, s, times its stiffness.
    pub mesh_damping_s: f64,
}

impl Pair {
    fn default_pressure_angle() -> f64 {
        20.0
    }
}

/// Everything that turns or carries the gears; index 0 is the pinion's side.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shafts {
    /// Moment of inertia of the motor, kg m2.
    pub inertia_motor_kg_m2: f64,
    /// Moment of inertia of the pinion, kg m2.
    pub inertia_pinion_kg_m2: f64,
    /// Moment of inertia of the gear, kg m2.
    pub inertia_gear_kg_m2: f64,
    /// Moment of inertia of the load, kg m2.
    pub inertia_load_kg_m2: f64,
    /// Torsional stiffness motor-pinion and gear-load, N m/rad.
    pub coupling_stiffness_n_m_per_rad: [f64; 2],
    /// Torsional damping motor-pinion and gear-load, N m s/rad.
    pub coupling_damping_n_m_s_per_rad: [f64; 2],
    /// Masses of the gear bodies with their share of the shaft, kg.
    pub mass_kg: [f64; 2],
    /// Bearing stiffness of each shaft, N/m, equal along and across the line of action.
    pub bearing_stiffness_n_per_m: [f64; 2],
    /// Bearing damping of each shaft, N s/m.
    pub bearing_damping_n_s_per_m: [f64; 2],
}
