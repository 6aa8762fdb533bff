//! What is found in a record: check, analysis, prediction, closed loop.

use crate::outcome::Outcome;
use crate::record::Record;
use crate::work;
use meshband_host::analysis::{self, Choice, report, view};
use meshband_host::model_based::replay::replay;
use meshband_host::model_based::{self, Options};
use meshband_host::dynamics::assembly::Damping;
use meshband_host::predict::Predictor;
use meshband_host::dynamics::rig::Rig;
use meshband_host::signal_based::preflight::{Level, Preflight};
use meshband_host::observation::input;
use meshband_host::report::Report;
use meshband_host::{Error, Result, check as checking, effects, signal_based, machine};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use std::sync::Arc;

/// Order spectrum, sidebands, averages, envelope and unexplained orders, as `meshband analyse`.
#[pyfunction]
pub fn analyse(py: Python<'_>, record: &Record, run: Option<usize>, channel: Option<usize>) -> PyResult<Outcome> {
    let record = Arc::clone(&record.inner);
    work::run(py, move || {
        let found = analysis::record(&record, Choice { run, channel })?;
        let html = report::report(&found, &Default::default())?.html();
        Outcome::new(&found, view::text(&found), html)
    })
}

/// What is wrong with a record that declares its machine, as `meshband check`.
#[pyfunction]
pub fn check(py: Python<'_>, record: &Record) -> PyResult<Outcome> {
    let record = Arc::clone(&record.inner);
    work::run(py, move || {
        let findings = checking::record(&input::view(&record)?);
        let page = Report::new(&format!("Check: {}", record.declaration.title()), "What is wrong with the record");
        let html = model_based::report::findings(page, &findings).html();
        Outcome::new(&findings, findings.text(), html)
    })
}

/// The closed loop, as `meshband loop`; `level` is "signal-based" or "model-based" (before:
/// "kinematic", "dynamic"), or the highest possible.
#[pyfunction]
pub fn close_loop(
    py: Python<'_>,
    record: &Record,
    seed: u64,
    level: Option<String>,
    with_report: bool,
) -> PyResult<Outcome> {
    let record = Arc::clone(&record.inner);
    work::run(py, move || closed(&record, seed, level.as_deref(), with_report))
}

fn closed(
    record: &meshband_host::record::Record,
    seed: u64,
    level: Option<&str>,
    with_report: bool,
) -> Result<Outcome> {
    let wanted = match level {
        None => None,
        Some("signal-based" | "kinematic") => Some(Level::SignalBased),
        Some("model-based" | "dynamic") => Some(Level::ModelBased),
        Some(other) => {
            return Err(Error::invalid("level", format!("'{other}' is neither signal-based nor model-based")));
        }
    };
    let preflight = Preflight::of(record);
    let place = record.folder.join("record.toml").display().to_string();
    let name = record.folder.file_name().map(|name| name.to_string_lossy().into_owned());
    if preflight.level(wanted, &place)? == Level::SignalBased {
        if preflight.lacks_only_speeds() {
            // A machine that is declared wrongly is refused, not passed over.
            input::view(record)?;
        }
        let mut found = signal_based::run(record, &preflight)?;
        found.record = name.unwrap_or(found.record);
        let html =
            if with_report { signal_based::report::report(&found, &Default::default())?.html() } else { String::new() };
        return Outcome::new(&found, signal_based::view::text(&found), html);
    }
    let seen = input::view(record)?;
    checking::record(&seen).require_usable()?;
    let mut found = model_based::close_loop(&seen, &Options { seed, limits: true, ..Options::default() })?;
    found.record = name.unwrap_or(found.record);
    let html = match with_report {
        true => model_based::report::report(&found, &replay(&seen, &found), &Default::default())?.html(),
        false => String::new(),
    };
    Outcome::new(&found, found.summary(), html)
}

/// What a machine gives for each run of a record: two channels per run, m/s2.
#[pyfunction]
pub fn predict<'py>(
    py: Python<'py>,
    record: &Record,
    machine: Option<&crate::machine::Machine>,
    effect_texts: Vec<String>,
    model: String,
) -> PyResult<Vec<[Bound<'py, PyArray1<f64>>; 2]>> {
    let record = Arc::clone(&record.inner);
    let machine: Option<machine::Machine> = machine.map(|machine| machine.inner.clone());
    let runs = work::run(py, move || {
        if record.folder.as_os_str().is_empty() {
            return Err(Error::invalid(
                "record",
                "is not on disk: write it first, a prediction reads its machine there",
            ));
        }
        let model = model.parse()?;
        let mut predictor = Predictor::new(&record, model, Damping::Declared)?;
        if let Some(machine) = &machine {
            predictor.rig = Rig::new(machine, model, Damping::Declared)?;
        }
        let effects = effect_texts.iter().map(|text| effects::parse(text)).collect::<Result<Vec<_>>>()?;
        record.runs.iter().map(|run| Ok(predictor.predict(run, &effects)?.0)).collect::<Result<Vec<_>>>()
    })?;
    Ok(runs.into_iter().map(|channels| channels.map(|channel| channel.into_pyarray(py))).collect())
}
