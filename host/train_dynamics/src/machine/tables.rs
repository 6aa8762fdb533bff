//! The tables of a train machine as they stand in its file, without defaults.
//!
//! Numbers are checked here against their range, so that what follows may rely on them; a refusal names table and key.
//! Everything but module and face width may be missing: `defaults` fills it in from the geometry.

use crate::{Error, Result};
use serde::Deserialize;
use std::ops::RangeInclusive;
use toml::{Table, Value};

/// Modules, mm.
const MODULES_MM: RangeInclusive<f64> = 0.1..=100.0;
/// Face widths and bore radii, mm.
const WIDTHS_MM: RangeInclusive<f64> = 0.5..=5000.0;
/// Pressure angles, degrees.
const PRESSURE_ANGLES_DEG: RangeInclusive<f64> = 10.0..=30.0;
/// Angles of centre lines and places, degrees.
const ANGLES_DEG: RangeInclusive<f64> = -360.0..=360.0;
/// Young's moduli, GPa.
const MODULI_GPA: RangeInclusive<f64> = 1.0..=1000.0;
/// Poisson's ratios.
const POISSON_RATIOS: RangeInclusive<f64> = 0.0..=0.49;
/// Damping ratios.
const DAMPING_RATIOS: RangeInclusive<f64> = 0.0..=0.5;
/// Damping time of a mesh, s.
const DAMPING_TIMES_S: RangeInclusive<f64> = 0.0..=1e-3;
/// Ramp of engagement, base pitches.
const RAMPS_BASE_PITCHES: RangeInclusive<f64> = 0.01..=0.5;
/// Amplitudes of errors, um.
const ERRORS_UM: RangeInclusive<f64> = -500.0..=500.0;
/// Stiffness along and across, N/m.
const STIFFNESSES_N_PER_M: RangeInclusive<f64> = 1e3..=1e12;
/// Stiffness against twist, N m/rad.
const TORSIONS_N_M_PER_RAD: RangeInclusive<f64> = 1.0..=1e12;
/// Dampers along and across, N s/m, or against twist, N m s/rad.
const DAMPERS: RangeInclusive<f64> = 0.0..=1e9;
/// Masses, kg.
const MASSES_KG: RangeInclusive<f64> = 1e-4..=1e6;
/// Moments of inertia, kg m2.
const INERTIAS_KG_M2: RangeInclusive<f64> = 1e-9..=1e8;
/// Speeds of the input, Hz.
pub const SPEEDS_HZ: RangeInclusive<f64> = 0.01..=1000.0;
/// Torques of the load, N m.
pub const TORQUES_N_M: RangeInclusive<f64> = 1e-3..=1e9;

/// `[[mesh]]`: the toothing of one stage.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshTable {
    /// Normal module, mm.
    pub module_mm: Option<f64>,
    /// Common face width, mm.
    pub face_width_mm: Option<f64>,
    /// Normal pressure angle, degrees.
    pub pressure_angle_deg: Option<f64>,
    /// Direction from the driver's centre to the driven one's, degrees from the housing's x axis.
    pub centre_line_deg: Option<f64>,
    /// Bore radii of driver and driven gear; of sun and planet of a set, mm.
    pub bore_radius_mm: Option<[f64; 2]>,
    /// Young's modulus, GPa.
    pub youngs_modulus_gpa: Option<f64>,
    /// Poisson's ratio.
    pub poisson: Option<f64>,
    /// Length of the raised-cosine ramp at either end of a pair's contact, base pitches.
    pub engagement_base_pitches: Option<f64>,
    /// Damping ratio of the mesh at its mean stiffness.
    pub mesh_damping_ratio: Option<f64>,
    /// Instead: damping is this time, s, times the stiffness.
    pub mesh_damping_s: Option<f64>,
    /// Amplitudes of the transmission error at the mesh's harmonics 1, 2, ..., um.
    #[serde(default)]
    pub transmission_error_um: Vec<f64>,
    /// Masses of driver and driven gear, kg.
    pub mass_kg: Option<[f64; 2]>,
    /// Moments of inertia of driver and driven gear, kg m2.
    pub inertia_kg_m2: Option<[f64; 2]>,
}

/// `[[shaft]]`: one shaft with the bearings of its gears.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShaftTable {
    /// Stiffness of the shaft between two neighbouring gears, N m/rad.
    pub torsional_stiffness_n_m_per_rad: Option<f64>,
    /// Damping there, N m s/rad.
    pub torsional_damping_n_m_s_per_rad: Option<f64>,
    /// Stiffness of the bearings under each gear along x and y, N/m.
    pub bearing_stiffness_n_per_m: Option<[f64; 2]>,
    /// Their damping, N s/m.
    pub bearing_damping_n_s_per_m: Option<[f64; 2]>,
    /// Moment of inertia beside that of the gears, shared among them, kg m2.
    pub extra_inertia_kg_m2: Option<f64>,
}

/// `[drive]` or `[load]`: what turns at an end of the train.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EndTable {
    /// Its shaft: the input of the drive, the last one of the load where absent.
    pub shaft: Option<usize>,
    /// Moment of inertia, kg m2.
    pub inertia_kg_m2: Option<f64>,
    /// Stiffness of the coupling, N m/rad.
    pub coupling_stiffness_n_m_per_rad: Option<f64>,
    /// Damping of the coupling, N m s/rad.
    pub coupling_damping_n_m_s_per_rad: Option<f64>,
}

/// `[[planetary]]`: one planetary stage beyond its toothing.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanetaryTable {
    /// Its stage, counted from 1.
    pub stage: usize,
    /// Stiffness of a planet's bearing along either direction, N/m.
    pub pin_stiffness_n_per_m: Option<f64>,
    /// Stiffness of the supports of sun, ring and carrier along either direction, N/m.
    pub support_stiffness_n_per_m: Option<[f64; 3]>,
    /// Stiffness that keeps the fixed member from turning, N m/rad.
    pub fixed_torsion_n_m_per_rad: Option<f64>,
    /// Damping ratio of pins and supports.
    pub damping_ratio: Option<f64>,
    /// Masses of sun, planet, ring and carrier, kg.
    pub mass_kg: Option<[f64; 4]>,
    /// Moments of inertia of sun, planet, ring and carrier, kg m2.
    pub inertia_kg_m2: Option<[f64; 4]>,
}

/// `[nominal]`: the operating point used where none is given.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Nominal {
    /// Speed of the input shaft, Hz.
    pub speed_hz: f64,
    /// Torque of the load, N m.
    pub load_torque_n_m: f64,
}

/// All tables of a file that are not the train's own.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tables {
    /// One per stage.
    pub meshes: Vec<MeshTable>,
    /// None, or one per shaft.
    pub shafts: Vec<ShaftTable>,
    /// Drive.
    pub drive: EndTable,
    /// Load.
    pub load: EndTable,
    /// Planetary stages that declare more than their toothing.
    pub planetary: Vec<PlanetaryTable>,
    /// Operating point.
    pub nominal: Option<Nominal>,
}

/// Keys of these tables.
const KEYS: [&str; 6] = ["mesh", "shaft", "drive", "load", "planetary", "nominal"];

impl Tables {
    /// Takes these tables out of a file's; what remains is the train's.
    ///
    /// # Errors
    /// An unknown key, a wrong type or a value out of range, with table and key.
    pub fn take(table: &mut Table, place: &str) -> Result<Self> {
        let mut own = Table::new();
        for key in KEYS {
            own.extend(table.remove(key).map(|value| (key.to_owned(), value)));
        }
        let tables = Self {
            meshes: list(&own, place, "mesh")?,
            shafts: list(&own, place, "shaft")?,
            drive: one(&own, place, "drive")?.unwrap_or_default(),
            load: one(&own, place, "load")?.unwrap_or_default(),
            planetary: list(&own, place, "planetary")?,
            nominal: one(&own, place, "nominal")?,
        };
        tables.check(place)?;
        Ok(tables)
    }

    fn check(&self, place: &str) -> Result<()> {
        for (i, mesh) in self.meshes.iter().enumerate() {
            mesh.check(&format!("{place} [[mesh]] {}", i + 1))?;
        }
        for (i, shaft) in self.shafts.iter().enumerate() {
            shaft.check(&format!("{place} [[shaft]] {i}"))?;
        }
        self.drive.check(&format!("{place} [drive]"))?;
        self.load.check(&format!("{place} [load]"))?;
        for (i, set) in self.planetary.iter().enumerate() {
            set.check(&format!("{place} [[planetary]] {}", i + 1))?;
        }
        let Some(nominal) = self.nominal else { return Ok(()) };
        let own = format!("{place} [nominal]");
        within(&own, "speed_hz", Some(nominal.speed_hz), &SPEEDS_HZ)?;
        within(&own, "load_torque_n_m", Some(nominal.load_torque_n_m), &TORQUES_N_M)
    }
}

impl MeshTable {
    fn check(&self, place: &str) -> Result<()> {
        for (key, value) in [("module_mm", self.module_mm), ("face_width_mm", self.face_width_mm)] {
            if value.is_none() {
                return Err(Error::invalid(format!("{place} {key}"), "missing: every mesh needs it"));
            }
        }
        within(place, "module_mm", self.module_mm, &MODULES_MM)?;
        within(place, "face_width_mm", self.face_width_mm, &WIDTHS_MM)?;
        within(place, "pressure_angle_deg", self.pressure_angle_deg, &PRESSURE_ANGLES_DEG)?;
        within(place, "centre_line_deg", self.centre_line_deg, &ANGLES_DEG)?;
        within(place, "bore_radius_mm", self.bore_radius_mm.into_iter().flatten(), &WIDTHS_MM)?;
        within(place, "youngs_modulus_gpa", self.youngs_modulus_gpa, &MODULI_GPA)?;
        within(place, "poisson", self.poisson, &POISSON_RATIOS)?;
        within(place, "engagement_base_pitches", self.engagement_base_pitches, &RAMPS_BASE_PITCHES)?;
        within(place, "mesh_damping_ratio", self.mesh_damping_ratio, &DAMPING_RATIOS)?;
        within(place, "mesh_damping_s", self.mesh_damping_s, &DAMPING_TIMES_S)?;
        within(place, "transmission_error_um", self.transmission_error_um.iter().copied(), &ERRORS_UM)?;
        within(place, "mass_kg", self.mass_kg.into_iter().flatten(), &MASSES_KG)?;
        within(place, "inertia_kg_m2", self.inertia_kg_m2.into_iter().flatten(), &INERTIAS_KG_M2)?;
        if self.mesh_damping_ratio.is_some() && self.mesh_damping_s.is_some() {
            return Err(Error::invalid(
                format!("{place} mesh_damping_s"),
                "stands beside mesh_damping_ratio; keep one",
            ));
        }
        Ok(())
    }
}

impl ShaftTable {
    fn check(&self, place: &str) -> Result<()> {
        within(place, "torsional_stiffness_n_m_per_rad", self.torsional_stiffness_n_m_per_rad, &TORSIONS_N_M_PER_RAD)?;
        within(place, "torsional_damping_n_m_s_per_rad", self.torsional_damping_n_m_s_per_rad, &DAMPERS)?;
        let stiffness = self.bearing_stiffness_n_per_m.into_iter().flatten();
        within(place, "bearing_stiffness_n_per_m", stiffness, &STIFFNESSES_N_PER_M)?;
        within(place, "bearing_damping_n_s_per_m", self.bearing_damping_n_s_per_m.into_iter().flatten(), &DAMPERS)?;
        within(place, "extra_inertia_kg_m2", self.extra_inertia_kg_m2, &INERTIAS_KG_M2)
    }
}

impl EndTable {
    fn check(&self, place: &str) -> Result<()> {
        within(place, "inertia_kg_m2", self.inertia_kg_m2, &INERTIAS_KG_M2)?;
        within(place, "coupling_stiffness_n_m_per_rad", self.coupling_stiffness_n_m_per_rad, &TORSIONS_N_M_PER_RAD)?;
        within(place, "coupling_damping_n_m_s_per_rad", self.coupling_damping_n_m_s_per_rad, &DAMPERS)
    }
}

impl PlanetaryTable {
    fn check(&self, place: &str) -> Result<()> {
        within(place, "pin_stiffness_n_per_m", self.pin_stiffness_n_per_m, &STIFFNESSES_N_PER_M)?;
        let supports = self.support_stiffness_n_per_m.into_iter().flatten();
        within(place, "support_stiffness_n_per_m", supports, &STIFFNESSES_N_PER_M)?;
        within(place, "fixed_torsion_n_m_per_rad", self.fixed_torsion_n_m_per_rad, &TORSIONS_N_M_PER_RAD)?;
        within(place, "damping_ratio", self.damping_ratio, &DAMPING_RATIOS)?;
        within(place, "mass_kg", self.mass_kg.into_iter().flatten(), &MASSES_KG)?;
        within(place, "inertia_kg_m2", self.inertia_kg_m2.into_iter().flatten(), &INERTIAS_KG_M2)
    }
}

/// Refuses a value outside its range; not a number lies outside every range.
///
/// # Errors
/// The value with its table, key and range.
pub fn within(
    place: &str,
    key: &str,
    values: impl IntoIterator<Item = f64>,
    range: &RangeInclusive<f64>,
) -> Result<()> {
    match values.into_iter().find(|value| !range.contains(value)) {
        None => Ok(()),
        Some(value) => {
            let what = format!("{value} is not within {} to {}", range.start(), range.end());
            Err(Error::invalid(format!("{place} {key}"), what))
        }
    }
}

/// An array of tables; a single table counts as one.
fn list<T: serde::de::DeserializeOwned>(table: &Table, place: &str, key: &str) -> Result<Vec<T>> {
    let values = match table.get(key) {
        None => return Ok(Vec::new()),
        Some(Value::Array(values)) => values.clone(),
        Some(value) => vec![value.clone()],
    };
    let typed = |(i, value): (usize, Value)| typed(value, format!("{place} [[{key}]] {}", i + 1));
    values.into_iter().enumerate().map(typed).collect()
}

/// A table of its own.
fn one<T: serde::de::DeserializeOwned>(table: &Table, place: &str, key: &str) -> Result<Option<T>> {
    table.get(key).map(|value| typed(value.clone(), format!("{place} [{key}]"))).transpose()
}

fn typed<T: serde::de::DeserializeOwned>(value: Value, place: String) -> Result<T> {
    value
        .try_into()
        .map_err(|error: toml::de::Error| Error::invalid(place, meshband_common::text::one_line(error.message())))
}
