//! What a command found: JSON for machines, text and a report for people.

use meshband_host::{Error, Result};
use pyo3::prelude::*;
use serde::Serialize;

/// An outcome; `meshband.Result` wraps it.
#[pyclass(frozen, get_all, skip_from_py_object)]
pub struct Outcome {
    /// The JSON that the command writes with `--json`.
    json: String,
    /// What the command shows.
    text: String,
    /// The page that the command writes with `--report`; empty where none was asked for.
    html: String,
}

impl Outcome {
    /// From a value, what the command shows of it, and its report.
    ///
    /// # Errors
    /// A value that JSON cannot hold.
    pub fn new(value: &impl Serialize, text: String, html: String) -> Result<Self> {
        let json = serde_json::to_string_pretty(value).map_err(|error| Error::invalid("JSON", error))? + "\n";
        Ok(Self { json, text, html })
    }
}
