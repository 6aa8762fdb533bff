//! Measurement files into a record in memory.

use crate::machine::Machine;
use crate::outcome::Outcome;
use crate::record::Record;
use crate::work;
use meshband_host::import::tach::{Shaft, TachOptions};
use meshband_host::import::{self, ImportOptions, Reading, TachChoice, Unit};
use meshband_host::{Error, Result};
use pyo3::prelude::*;
use std::path::PathBuf;

/// How files are read; the keywords of `meshband.import_files`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Choices {
    title: String,
    rate_hz: Option<f64>,
    override_rate: bool,
    teeth: Option<(u32, u32)>,
    mesh_hz: Option<f64>,
    mesh_range_hz: Option<(f64, f64)>,
    unit: Option<String>,
    override_unit: bool,
    volt_per_g: Option<f64>,
    columns: Vec<String>,
    skip: Vec<String>,
    channel_names: Option<Vec<String>>,
    full_scale: Option<f64>,
    source_full_scale: Vec<f64>,
    keep_float: bool,
    torques_n_m: Vec<f64>,
    files_are_runs: bool,
    tach: Vec<String>,
    no_tach: bool,
    pulses: u32,
    tach_shaft: String,
    remove_mean: bool,
}

/// Reads files as `meshband import` does.
#[pyfunction]
pub fn import_files(
    py: Python<'_>,
    files: Vec<PathBuf>,
    machine: Option<&Machine>,
    choices: Choices,
) -> PyResult<(Record, Outcome)> {
    let machine = machine.map(|machine| machine.inner.clone());
    let (record, outcome) = work::run(py, move || {
        let mut options = options(choices)?;
        options.teeth = import::teeth(machine.as_ref(), options.teeth)?;
        options.machine = machine;
        let (record, summary) = import::import(&files, &options)?;
        let text = summary.remarks.iter().map(|remark| format!("note: {remark}\n")).collect();
        Ok((record, Outcome::new(&summary, text, String::new())?))
    })?;
    Ok((record.into(), outcome))
}

fn options(c: Choices) -> Result<ImportOptions> {
    let sensitivity = c.volt_per_g.map(|volt_per_g| Unit::Volt(Some(volt_per_g)));
    let unit = match c.unit.as_deref().map(Unit::parse).transpose().map_err(|what| Error::invalid("unit", what))? {
        Some(Unit::Volt(_)) => Some(Unit::Volt(c.volt_per_g)),
        None => sensitivity,
        other => other,
    };
    let tach = match (c.tach.is_empty(), c.no_tach) {
        (false, true) => return Err(Error::invalid("no_tach", "a tachometer is named by `tach`")),
        (true, true) => TachChoice::None,
        (true, false) => TachChoice::Virtual,
        (false, false) => TachChoice::Measured(TachOptions {
            sources: c.tach,
            pulses: c.pulses,
            shaft: shaft(&c.tach_shaft)?,
            falling: None,
            threshold: None,
        }),
    };
    Ok(ImportOptions {
        title: c.title,
        rate_hz: c.rate_hz,
        override_rate: c.override_rate,
        teeth: c.teeth.map(Into::into),
        mesh_guess_hz: c.mesh_hz,
        mesh_range_hz: c.mesh_range_hz.map(Into::into),
        units: unit.into_iter().collect(),
        override_unit: c.override_unit,
        reading: Reading { columns: c.columns, skip: c.skip, ..Reading::default() },
        channel_names: c.channel_names,
        full_scale: c.full_scale,
        source_full_scale: c.source_full_scale,
        float: c.keep_float,
        torques_n_m: c.torques_n_m,
        files_are_runs: c.files_are_runs,
        tach,
        remove_mean: c.remove_mean,
        ..ImportOptions::default()
    })
}

fn shaft(text: &str) -> Result<Shaft> {
    match text {
        "pinion" => Ok(Shaft::Pinion),
        "gear" => Ok(Shaft::Gear),
        other => match other.parse::<f64>() {
            Ok(ratio) if ratio.is_finite() && ratio > 0.0 => Ok(Shaft::Ratio(ratio)),
            _ => Err(Error::invalid("tach_shaft", format!("'{other}' is neither pinion nor gear nor a ratio"))),
        },
    }
}
