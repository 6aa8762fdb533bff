//! Records: folders read and written, signals and edges as arrays.

use crate::errors::{invalid, raised};
use crate::work;
use meshband_host::dynamics::simulate::Simulated;
use meshband_host::output::{Content, Outputs};
use meshband_host::record::{self, Acquisition, Declaration, FLOAT_BITS, RunDeclaration, Tach};
use meshband_host::{Result, machine};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// A record in memory.
#[pyclass(frozen, module = "meshband._meshband", skip_from_py_object)]
pub struct Record {
    pub inner: Arc<record::Record>,
}

impl From<record::Record> for Record {
    fn from(record: record::Record) -> Self {
        Self { inner: Arc::new(record) }
    }
}

#[pymethods]
impl Record {
    /// Reads a record folder.
    #[staticmethod]
    fn read(py: Python<'_>, folder: PathBuf) -> PyResult<Self> {
        work::run(py, move || record::Record::read(&folder)).map(Self::from)
    }

    /// A record of one run from samples x channels; `tach` is shaft, pulses per turn and edge times, s.
    #[staticmethod]
    #[pyo3(signature = (samples, rate_hz, channels, title, teeth, tach, torque_n_m, unit))]
    #[allow(clippy::too_many_arguments, reason = "keywords on the Python side")]
    fn from_arrays(
        py: Python<'_>,
        samples: PyReadonlyArray2<'_, f64>,
        rate_hz: f64,
        channels: Vec<String>,
        title: &str,
        teeth: Option<(u32, u32)>,
        tach: Option<(String, u32, PyReadonlyArray1<'_, f64>)>,
        torque_n_m: Option<f64>,
        unit: Option<String>,
    ) -> PyResult<Self> {
        let samples = samples.as_array();
        let signals: Vec<Vec<f64>> = samples.columns().into_iter().map(|column| column.to_vec()).collect();
        let acquisition = Acquisition {
            sample_rate_hz: rate_hz,
            channels,
            full_scale_m_s2: record::suggested_full_scale(&signals),
            code_bits: FLOAT_BITS,
            unit,
            other: Default::default(),
        };
        let edges_s = tach.as_ref().map_or_else(Vec::new, |(_, _, edges)| edges.as_array().to_vec());
        let tach = tach.map(|(shaft, pulses_per_rev, _)| Tach {
            shaft,
            turns_per_pinion_turn: None,
            pulses_per_rev,
            jitter_s: None,
            source: Some("measured".into()),
            other: Default::default(),
        });
        let run = RunDeclaration::numbered(0, tach.is_some(), torque_n_m);
        let mut declaration = Declaration::of_import(title, teeth.map(Into::into), acquisition.clone(), tach);
        declaration.runs.push(run.clone());
        raised(py, declaration.to_toml())?;
        let run = raised(py, record::Run::from_signals(run, &acquisition, &signals, edges_s))?;
        Ok(record::Record { folder: PathBuf::new(), declaration, runs: vec![run] }.into())
    }

    /// Writes the record as a folder; with `force` over a former record.
    fn write(&self, py: Python<'_>, folder: PathBuf, force: bool) -> PyResult<()> {
        let record = Arc::clone(&self.inner);
        work::run(py, move || {
            let mut outputs = Outputs::new(force);
            if !record.folder.as_os_str().is_empty() {
                outputs.reads(&record.folder);
            }
            let target = outputs.folder(&folder, Content::Record)?;
            record.write_to(target)
        })
    }

    #[getter]
    fn folder(&self) -> PathBuf {
        self.inner.folder.clone()
    }

    #[getter]
    fn title(&self) -> &str {
        self.inner.declaration.title()
    }

    #[getter]
    fn teeth(&self) -> Option<(u32, u32)> {
        self.inner.declaration.teeth().map(Into::into)
    }

    #[getter]
    fn channels(&self) -> Vec<String> {
        self.inner.declaration.acquisition.channels.clone()
    }

    #[getter]
    fn unit(&self) -> &str {
        self.inner.declaration.acquisition.unit.as_deref().unwrap_or("m/s2")
    }

    #[getter]
    fn sample_rate_hz(&self) -> f64 {
        self.inner.declaration.acquisition.sample_rate_hz
    }

    #[getter]
    fn pulses_per_turn(&self) -> Option<u32> {
        self.inner.declaration.tach.as_ref().map(|tach| tach.pulses_per_rev)
    }

    fn __len__(&self) -> usize {
        self.inner.runs.len()
    }

    /// The record.toml as text.
    fn to_toml(&self, py: Python<'_>) -> PyResult<String> {
        raised(py, self.inner.declaration.to_toml())
    }

    /// Samples of a run, samples x channels, in the record's unit.
    fn signals<'py>(&self, py: Python<'py>, run: usize) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let run = raised(py, self.inner.run(run))?;
        let (rows, columns) = (run.samples(), run.channels());
        let channels: Vec<Vec<f64>> = (0..columns).map(|c| run.signal_m_s2(c)).collect();
        let values: Vec<f64> = (0..rows).flat_map(|i| channels.iter().map(move |channel| channel[i])).collect();
        values.into_pyarray(py).reshape([rows, columns])
    }

    /// Codes of a run, samples x channels.
    fn codes<'py>(&self, py: Python<'py>, run: usize) -> PyResult<Bound<'py, PyArray2<i16>>> {
        let run = raised(py, self.inner.run(run))?;
        run.codes().into_owned().into_pyarray(py).reshape([run.samples(), run.channels()])
    }

    /// Tach edges of a run, s.
    fn edges_s<'py>(&self, py: Python<'py>, run: usize) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(raised(py, self.inner.run(run))?.edges_s.clone().into_pyarray(py))
    }

    /// Declared torque of a run, N m.
    fn torque_n_m(&self, py: Python<'_>, run: usize) -> PyResult<Option<f64>> {
        Ok(raised(py, self.inner.run(run))?.declaration.input_torque_n_m)
    }

    /// Mean speed of the pinion over a run, Hz.
    fn speed_hz(&self, py: Python<'_>, run: usize) -> PyResult<f64> {
        let tach = raised(py, self.inner.require_tach())?;
        let run = raised(py, self.inner.run(run))?;
        let ratio = tach.turns_per_pinion_turn(self.inner.declaration.teeth());
        let ratio =
            ratio.ok_or_else(|| invalid(py, "tach", "on the gear's shaft, and no tooth counts are declared"))?;
        run.mean_speed_hz(tach.pulses_per_rev)
            .map(|speed| speed / ratio)
            .ok_or_else(|| invalid(py, "tach", "fewer than two edges give no speed"))
    }
}

/// The record of simulated runs (torque, N m, and signals), declared as `meshband simulate` declares it.
pub fn of_machine(
    machine: &machine::Machine,
    rate_hz: f64,
    pulses_per_rev: u32,
    jitter_s: f64,
    simulated: &[(f64, Simulated)],
) -> Result<record::Record> {
    let all: Vec<Vec<f64>> = simulated.iter().flat_map(|(_, run)| run.channels.iter().cloned()).collect();
    let acquisition = Acquisition {
        sample_rate_hz: rate_hz,
        channels: vec!["pinion bearing, line of action".into(), "gear bearing, line of action".into()],
        full_scale_m_s2: record::suggested_full_scale(&all),
        code_bits: 16,
        unit: None,
        other: Default::default(),
    };
    let tach = Tach {
        shaft: "pinion".into(),
        turns_per_pinion_turn: None,
        pulses_per_rev,
        jitter_s: Some(jitter_s),
        source: None,
        other: Default::default(),
    };
    let mut declaration = Declaration::of_machine(machine, acquisition.clone(), Some(tach))?;
    let mut runs = Vec::new();
    for (index, (torque_n_m, run)) in simulated.iter().enumerate() {
        let mut table = RunDeclaration::numbered(index, true, Some(*torque_n_m));
        table.first_pulse_index = run.first_pulse_index;
        declaration.runs.push(table.clone());
        runs.push(record::Run::from_signals(table, &acquisition, &run.channels, run.edges_s.clone())?);
    }
    Ok(record::Record { folder: machine.folder.clone(), declaration, runs })
}
