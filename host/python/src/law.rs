//! Bandwidth laws: fitted to a machine, read from a file, evaluated over arrays.

use crate::errors::raised;
use crate::outcome::Outcome;
use crate::work;
use meshband_host::law::derive::{check, derive};
use meshband_host::law::domain::Domain;
use meshband_host::law::file::LawFile;
use meshband_host::law::operating::Bench;
use meshband_host::law::report::{LAW_HEAD, check_section, law_rows, law_section};
use meshband_host::report::Report;
use meshband_host::{machine, terminal};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use std::path::PathBuf;

/// A law as law.toml holds it.
#[pyclass(frozen, module = "meshband._meshband", skip_from_py_object)]
pub struct Law {
    pub file: LawFile,
}

#[pymethods]
impl Law {
    /// Reads a law.toml.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        raised(py, LawFile::read(&path)).map(|file| Self { file })
    }

    /// Reads a law from TOML text.
    #[staticmethod]
    fn from_toml(py: Python<'_>, text: &str) -> PyResult<Self> {
        raised(py, LawFile::from_toml(text, "law")).map(|file| Self { file })
    }

    /// The text of its law.toml.
    fn to_toml(&self) -> String {
        self.file.to_toml()
    }

    /// Bandwidth at pinion speeds, Hz; outside the domain the form's own continuation.
    fn bandwidth_hz<'py>(&self, py: Python<'py>, speeds_hz: PyReadonlyArray1<'py, f64>) -> Bound<'py, PyArray1<f64>> {
        let values: Vec<f64> = speeds_hz.as_array().iter().map(|&speed| self.file.law.bandwidth_hz(speed)).collect();
        values.into_pyarray(py)
    }

    #[getter]
    fn machine(&self) -> &str {
        &self.file.machine
    }

    #[getter]
    fn domain_hz(&self) -> (f64, f64) {
        (self.file.domain_hz[0], self.file.domain_hz[1])
    }

    #[getter]
    fn relative_uncertainty(&self) -> f64 {
        self.file.relative_uncertainty
    }
}

/// Fits and checks every form on a machine, as `meshband law fit` does.
pub fn fit(py: Python<'_>, machine: machine::Machine, domain: Option<(f64, f64)>) -> PyResult<(Law, Outcome)> {
    work::run(py, move || {
        let domain = match domain {
            Some((lowest, highest)) => format!("{lowest}..{highest}").parse()?,
            None => Domain::of(&machine),
        };
        let bench = Bench::new(&machine)?;
        let laws = derive(&machine, &bench, domain, &|| ())?;
        let checked = check(&laws, &bench, &|| ())?;
        let page = law_section(Report::new("Bandwidth law: fit", &laws.machine), &laws)?;
        let html = check_section(page, &checked)?.html();
        let text = format!("{}\n{}\n", terminal::table(&LAW_HEAD, &law_rows(&laws)), checked.reliance());
        let file = laws.file(checked.relative_uncertainty());
        let value = serde_json::json!({ "laws": laws, "check": checked });
        Ok((Law { file }, Outcome::new(&value, text, html)?))
    })
}
