//! What was recorded beside the accelerations: torque, speed, temperature, and signals of another rate or start.
//!
//! `[[run.beside]]` names a file of float32 values for each. Only people and exports read them; analysis and loop do
//! not.

use super::npy;
use crate::confined;
use crate::{Error, Result, text};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Values of one signal.
pub type Beside = Vec<f32>;

/// One `[[run.beside]]` table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BesideDeclaration {
    /// File of the values, relative to the record folder.
    pub file: String,
    /// Name as the source gives it.
    pub name: String,
    /// What it is, where that is known: "torque", "temperature", "speed" and so on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quantity: Option<String>,
    /// Unit of the values, "unknown" where the source states none.
    pub unit: String,
    /// Its own sampling rate, Hz; absent where the source states none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sample_rate_hz: Option<f64>,
    /// First value after the run's first sample, s; absent for 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_s: Option<f64>,
}

/// Reads the values that a table names.
pub(super) fn read(folder: &Path, declaration: &BesideDeclaration) -> Result<Beside> {
    let path = confined::inside(folder, &declaration.file)?;
    let (values, columns) = npy::read_f32(&path)?;
    if columns != 1 {
        return Err(Error::invalid(
            path.display(),
            format!("has {columns} columns, {} is one", text::quoted(&declaration.name)),
        ));
    }
    if let Some(i) = values.iter().position(|x| !x.is_finite()) {
        return Err(Error::invalid(path.display(), format!("value {i} is {}", values[i])));
    }
    Ok(values)
}
