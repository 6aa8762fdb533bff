//! The declared machine: what its owner states about gears, shafts and acquisition, in SI units.
//!
//! The same tables appear in `machines/*.toml` and in the `record.toml` of a record folder, so that a
//! record carries its machine with it. Reading checks every value and names table and key of all that make
//! no sense; a non-finite number, an unknown key or a missing one is refused before.

pub mod bearing;
pub mod bearing_table;
mod check;
pub mod damping;
pub mod estimate;
mod geometry;
mod hash;
mod hunting;
pub mod keys;
mod options;
mod read;

pub use check::MOST_TORQUE_N_M;
pub use geometry::{Geometry, involute};
pub use hunting::{Freedom, Hunting};
pub use options::Side;
pub use options::{Casing, Crack, CrackRule, Engagement, EngagementKind, Load, Motor, Nominal, RootAngle, RootShape};

pub use read::check_lists;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

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
    /// How a pair takes up and gives off its share; absent: the stiffness curve as it is (hard switch for geometry).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub engagement: Option<Engagement>,
    /// One cracked tooth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crack: Option<Crack>,
    /// Motor characteristic; absent: constant torque.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motor: Option<Motor>,
    /// Load characteristic; absent: constant torque that balances the motor's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub load: Option<Load>,
    /// Elastically mounted housing of the 10-DOF model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub casing: Option<Casing>,
    /// Operating point used where a command is given none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nominal: Option<Nominal>,
    /// Folder that relative paths refer to; not part of the declaration.
    #[serde(skip)]
    pub folder: PathBuf,
}

/// Two external spur gears; index 0 is the pinion (driving), 1 the gear.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pair {
    /// Numbers of teeth.
    pub teeth: [u32; 2],
    /// Module, m.
    pub module_m: f64,
    /// Pressure angle at the reference circle, degrees.
    #[serde(default = "default_pressure_angle")]
    pub pressure_angle_deg: f64,
    /// Common face width, m.
    pub face_width_m: f64,
    /// Bore (hub) radii, m.
    pub bore_radius_m: [f64; 2],
    /// Young's modulus, Pa.
    pub youngs_modulus_pa: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Tooth addendum in modules.
    #[serde(default = "default_addendum")]
    pub addendum_coefficient: f64,
    /// Tip clearance in modules; the cutter's tip rounding follows from it.
    #[serde(default = "default_clearance")]
    pub clearance_coefficient: f64,
    /// Profile shift coefficients, in modules; the centre distance follows without backlash.
    #[serde(default)]
    pub profile_shift: [f64; 2],
    /// Shape of the tooth between root circle and involute.
    #[serde(default)]
    pub root: RootShape,
    /// Which half angle of the tooth at the root circle enters the gear body's compliance.
    #[serde(default)]
    pub root_angle: RootAngle,
    /// Whether the gear bodies' compliance (Sainsot) is included.
    #[serde(default = "yes")]
    pub body: bool,
    /// Table of one tooth pair's stiffness along the path of contact (CSV, relative to the declaration's folder).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pair_stiffness: Option<PathBuf>,
    /// Table of the total mesh stiffness over one base pitch instead (CSV, relative to the declaration's folder).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub total_stiffness: Option<PathBuf>,
    /// Damping of each tooth pair: this time, s, times its stiffness. Filled in on reading where the ratio is given.
    #[serde(default)]
    pub mesh_damping_s: f64,
    /// Damping ratio of the gears on their mesh at its mean stiffness, instead of the time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh_damping_ratio: Option<f64>,
}

impl Pair {
    /// A steel pair (206 GPa, 0.3) with 20 degrees, addendum 1, clearance 0.25, no shift, hard engagement, undamped.
    pub fn spur(teeth: [u32; 2], module_m: f64, face_width_m: f64, bore_radius_m: [f64; 2]) -> Self {
        Self {
            teeth,
            module_m,
            pressure_angle_deg: default_pressure_angle(),
            face_width_m,
            bore_radius_m,
            youngs_modulus_pa: 206e9,
            poisson: 0.3,
            addendum_coefficient: default_addendum(),
            clearance_coefficient: default_clearance(),
            profile_shift: [0.0; 2],
            root: RootShape::default(),
            root_angle: RootAngle::default(),
            body: true,
            pair_stiffness: None,
            total_stiffness: None,
            mesh_damping_s: 0.0,
            mesh_damping_ratio: None,
        }
    }
}

fn default_pressure_angle() -> f64 {
    20.0
}

fn default_addendum() -> f64 {
    1.0
}

fn default_clearance() -> f64 {
    0.25
}

fn yes() -> bool {
    true
}

/// Everything that turns or carries the gears; index 0 is the pinion's side.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(from = "damping::DeclaredShafts")]
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
    /// Torsional damping motor-pinion and gear-load, N m s/rad; 5 % of critical where the file has none.
    pub coupling_damping_n_m_s_per_rad: [f64; 2],
    /// Masses of the gear bodies with their share of the shaft, kg.
    pub mass_kg: [f64; 2],
    /// Bearing stiffness of each shaft, N/m, equal along and across the line of action.
    pub bearing_stiffness_n_per_m: [f64; 2],
    /// Bearing damping of each shaft, N s/m; 4 % of critical where the file has none.
    pub bearing_damping_n_s_per_m: [f64; 2],
}
