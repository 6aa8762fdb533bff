//! Machines: read, written, their stiffness, natural frequencies, law and simulated records.

use crate::errors::{invalid, raised};
use crate::law::{self, Law};
use crate::outcome::Outcome;
use crate::record::Record;
use crate::{record, work};
use meshband_host::dynamics::assembly::{Damping, Model};
use meshband_host::dynamics::simulate::{Acquisition, Simulated, run_seed, simulate};
use meshband_host::dynamics::{Motion, Rig};
use meshband_host::stiffness::mesh::total;
use meshband_host::stiffness::{page::page, report};
use meshband_host::{Error, Result, effects, machine};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use std::path::PathBuf;

/// A declared machine, checked.
#[pyclass(frozen, module = "meshband._meshband", skip_from_py_object)]
pub struct Machine {
    pub inner: machine::Machine,
}

/// How a machine is simulated.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Simulation {
    speeds_hz: Vec<f64>,
    run_up: Option<(f64, f64, f64)>,
    torques_n_m: Vec<f64>,
    effects: Vec<String>,
    model: String,
    rate_hz: f64,
    duration_s: f64,
    pulses_per_turn: u32,
    jitter_s: f64,
    noise_m_s2: f64,
    seed: u64,
}

#[pymethods]
impl Machine {
    /// Reads a machine file, or the machine of a record folder.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        raised(py, machine::Machine::read(&path)).map(|inner| Self { inner })
    }

    /// Reads a machine from TOML text; tables it names are looked up in `folder`.
    #[staticmethod]
    fn from_toml(py: Python<'_>, text: &str, folder: PathBuf) -> PyResult<Self> {
        raised(py, machine::Machine::from_toml(text, "machine", &folder)).map(|inner| Self { inner })
    }

    /// The declaration as JSON.
    fn to_json(&self, py: Python<'_>) -> PyResult<String> {
        serde_json::to_string(&self.inner).map_err(|error| invalid(py, &self.inner.title, error))
    }

    #[getter]
    fn title(&self) -> &str {
        &self.inner.title
    }

    #[getter]
    fn teeth(&self) -> (u32, u32) {
        (self.inner.pair.teeth[0], self.inner.pair.teeth[1])
    }

    #[getter]
    fn hash(&self) -> String {
        format!("{:#018x}", self.inner.hash())
    }

    /// Mesh stiffness, components and ISO 6336, as `meshband stiffness`.
    fn stiffness(&self, py: Python<'_>, points: usize) -> PyResult<Outcome> {
        let machine = self.inner.clone();
        work::run(py, move || {
            let found = report::Report::new(&machine, points)?;
            let page = page(&found, &machine)?;
            Outcome::new(&found, found.to_string(), page.into())
        })
    }

    /// Stiffness at positions in base pitches: of one pair from the start of contact, or of all pairs (periodic), N/m.
    fn stiffness_at<'py>(
        &self,
        py: Python<'py>,
        positions: PyReadonlyArray1<'py, f64>,
        all_pairs: bool,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let positions = positions.as_array().to_vec();
        let machine = self.inner.clone();
        let values = work::run(py, move || {
            let pair = machine.pair_stiffness()?;
            let mesh = total(&pair);
            let at = |&s: &f64| if all_pairs { mesh.value(s.rem_euclid(1.0)) } else { pair.value(s) };
            Ok(positions.iter().map(at).collect::<Vec<f64>>())
        })?;
        Ok(values.into_pyarray(py))
    }

    /// Natural frequencies at the mean mesh stiffness, Hz, without the rigid rotation.
    fn natural_frequencies_hz<'py>(&self, py: Python<'py>, model: &str) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let values = raised(py, self.natural(model))?;
        Ok(values.into_pyarray(py))
    }

    /// Law and its check; `domain_hz` are the slowest and fastest pinion speed.
    fn law(&self, py: Python<'_>, domain_hz: Option<(f64, f64)>) -> PyResult<(Law, Outcome)> {
        law::fit(py, self.inner.clone(), domain_hz)
    }

    /// A record in memory, one run per pair of speed and torque.
    fn simulate(&self, py: Python<'_>, simulation: Simulation) -> PyResult<Record> {
        let machine = self.inner.clone();
        work::run(py, move || simulated(&machine, &simulation)).map(Record::from)
    }
}

impl Machine {
    fn natural(&self, model: &str) -> Result<Vec<f64>> {
        let rig = Rig::new(&self.inner, model.parse::<Model>()?, Damping::Declared)?;
        Ok(rig.system.natural_frequencies_hz(rig.mean_stiffness_n_per_m()).into_iter().skip(1).collect())
    }
}

/// Every run of a simulation, in the order and with the seeds of `meshband simulate`.
fn simulated(machine: &machine::Machine, s: &Simulation) -> Result<meshband_host::record::Record> {
    let nominal = |given: &[f64], value: Option<f64>, name: &str| match (given, value) {
        ([], None) => Err(Error::invalid(name, "is needed: the machine declares no [nominal]")),
        ([], Some(value)) => Ok(vec![value]),
        (given, _) => Ok(given.to_vec()),
    };
    let motions = match s.run_up {
        Some((from_hz, to_hz, duration_s)) => vec![Motion::RunUp { from_hz, to_hz, duration_s }],
        None => nominal(&s.speeds_hz, machine.nominal.map(|n| n.speed_hz), "speed_hz")?
            .into_iter()
            .map(|speed_hz| Motion::Constant { speed_hz, turns_at_zero: 0.0 })
            .collect(),
    };
    let torques = nominal(&s.torques_n_m, machine.nominal.map(|n| n.torque_n_m), "torque_n_m")?;
    let rig = Rig::new(machine, s.model.parse()?, Damping::Declared)?;
    let effects = s.effects.iter().map(|text| effects::parse(text)).collect::<Result<Vec<_>>>()?;
    let mut runs: Vec<(f64, Simulated)> = Vec::new();
    for motion in &motions {
        for &torque_n_m in &torques {
            let acquisition = Acquisition {
                rate_hz: s.rate_hz,
                duration_s: s.duration_s,
                pulses_per_turn: s.pulses_per_turn,
                jitter_s: s.jitter_s,
                noise_m_s2: s.noise_m_s2,
                seed: run_seed(s.seed, runs.len()),
            };
            rig.work(motion, s.duration_s).check_against(s.rate_hz)?;
            rig.work(motion, s.duration_s).check()?;
            runs.push((torque_n_m, simulate(&rig, motion, torque_n_m, &effects, &acquisition)?));
        }
    }
    record::of_machine(machine, s.rate_hz, s.pulses_per_turn, s.jitter_s, &runs)
}
