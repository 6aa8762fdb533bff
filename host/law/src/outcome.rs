//! All studies of a machine in one run: what `meshband law study` prints, reports and judges the paper by.
//!
//! The studies are independent and mostly parallel inside; together they take a few seconds on two cores.

use super::derive::{Check, Laws, OPERATING_POINTS, check, derive, study_torque};
use super::domain::Domain;
use super::estimator::{Convergence, convergence};
use super::operating::{Bench, Event};
use super::paper::{self, ImpliedMesh, UNKNOWN_LINES};
use super::sampling::{SamplingStudy, sampling_study};
use super::study::{self, Calibration, CrackStudy, RampStudy, Sweep};
use crate::machine::Machine;
use crate::{Error, Result};
use serde::Serialize;

/// Everything found.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// Title of the machine.
    pub machine: String,
    /// Speed of the studies that do not vary it, Hz.
    pub shaft_hz: f64,
    /// Torque, N m.
    pub torque_n_m: f64,
    /// Natural frequencies at the mean mesh stiffness, Hz; the last is the mesh mode's.
    pub natural_frequencies_hz: Vec<f64>,
    /// The paper's ramp on this machine.
    pub calibration: Calibration,
    /// Studies that need the geometry; absent for declared stiffness tables.
    pub module: Option<Sweep>,
    /// As above.
    pub teeth: Option<Sweep>,
    /// Over pinion speed.
    pub speed: Sweep,
    /// Over torque.
    pub torque: Sweep,
    /// Over the engagement ramp.
    pub ramps: Vec<RampStudy>,
    /// Over the crack's depth; absent for declared stiffness tables.
    pub crack: Option<Vec<CrackStudy>>,
    /// The fitted laws.
    pub laws: Laws,
    /// Their check at held-out speeds.
    pub check: Check,
    /// The sampled estimator against the polynomial.
    pub estimator: Convergence,
    /// Three sampling rates; absent for declared stiffness tables.
    pub sampling: Option<Vec<SamplingStudy>>,
    /// What the paper's unknown lines imply, in the order of [`UNKNOWN_LINES`].
    pub implied: Vec<ImpliedMesh>,
    /// Pictures' data.
    #[serde(skip)]
    pub pictures: Pictures,
}

/// Waveforms for the report: (time, acceleration).
#[derive(Debug, Clone, Default)]
pub struct Pictures {
    /// The exit edge, us about its steepest point.
    pub edge: Vec<(f64, f64)>,
    /// Begin, 10 %, 90 % and end of the edge, on the same axis.
    pub edge_marks: Vec<(f64, f64)>,
    /// Healthy acceleration over the cracked tooth's two mesh periods, ms.
    pub healthy: Vec<(f64, f64)>,
    /// The same with the deepest crack.
    pub cracked: Vec<(f64, f64)>,
}

/// Steps of the progress bar.
pub const STEPS: u64 = OPERATING_POINTS + 18;

/// Runs every study.
///
/// # Errors
/// A machine without an engagement ramp or operating point, and everything that stops a simulation.
pub fn run(machine: &Machine, step: &(impl Fn() + Sync)) -> Result<Outcome> {
    let torque_n_m = study_torque(machine)?;
    let nominal = machine.nominal.map(|n| n.speed_hz);
    let shaft_hz = nominal.ok_or_else(|| Error::invalid("[nominal] speed_hz", "missing: the studies need a speed"))?;
    let bench = Bench::new(machine)?;
    let tabled = machine.pair.pair_stiffness.is_some() || machine.pair.total_stiffness.is_some();
    let laws = derive(machine, &bench, Domain::PAPER, step)?;
    let check = check(&laws, &bench, step)?;
    let calibration = study::calibrate(machine)?;
    step();
    let module = if tabled { None } else { Some(study::module_sweep(machine, shaft_hz)?) };
    let teeth = if tabled { None } else { Some(study::teeth_sweep(machine, shaft_hz)?) };
    step();
    let speed = study::speed_sweep(machine, &bench)?;
    step();
    let torque = study::torque_sweep(machine, shaft_hz)?;
    step();
    let ramps = study::ramp_study(machine, step)?;
    let crack = if tabled { None } else { Some(study::crack_study(machine, shaft_hz)?) };
    step();
    let estimator = convergence(&bench.healthy(shaft_hz, torque_n_m)?)?;
    step();
    let table = laws.fits.last().expect("derive fits several forms").law.clone();
    let sampling = if tabled { None } else { Some(sampling_study(machine, &|f| table.bandwidth_hz(f))?) };
    step();
    Ok(Outcome {
        machine: machine.title.clone(),
        shaft_hz,
        torque_n_m,
        natural_frequencies_hz: bench.natural_frequencies_hz(),
        calibration,
        module,
        teeth,
        speed,
        torque,
        ramps,
        crack,
        laws,
        check,
        estimator,
        sampling,
        implied: UNKNOWN_LINES.iter().map(paper::UnknownLines::implied).collect(),
        pictures: pictures(machine, &bench, shaft_hz, torque_n_m, tabled)?,
    })
}

fn pictures(machine: &Machine, bench: &Bench, shaft_hz: f64, torque: f64, tabled: bool) -> Result<Pictures> {
    let healthy = bench.healthy(shaft_hz, torque)?;
    let mut pictures = Pictures::default();
    if let Some(edge) = healthy.edge(0, Event::Exit) {
        let centre = 0.5 * (edge.ends_s[0] + edge.ends_s[1]);
        let reach = 6.0 * edge.rise_time_s;
        let at = |t: f64| (1e6 * (t - centre), healthy.value(t));
        pictures.edge = (0..=600).map(|i| at(centre + reach * (f64::from(i) / 300.0 - 1.0))).collect();
        let level = |share: f64| edge.levels[0] + share * (edge.levels[1] - edge.levels[0]);
        let crossing = |share: f64| {
            let (mut low, mut high) = (edge.ends_s[0], edge.ends_s[1]);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if healthy.value(middle) < level(share) { low = middle } else { high = middle }
            }
            0.5 * (low + high)
        };
        pictures.edge_marks =
            [edge.ends_s[0], crossing(0.1), crossing(0.9), edge.ends_s[1]].into_iter().map(at).collect();
    }
    if !tabled {
        let mut cracked = machine.clone();
        cracked.crack = Some(study::crack_of(machine, machine.pair.module_m));
        let faulty = Bench::new(&cracked)?.cracked(shaft_hz, torque)?;
        let t = healthy.mesh_period_s;
        let at = |i: i32| t * (-1.0 + 4.5 * f64::from(i) / 3000.0);
        pictures.healthy = (0..=3000).map(|i| (1e3 * at(i), healthy.value(at(i)))).collect();
        pictures.cracked = (0..=3000).map(|i| (1e3 * at(i), faulty.value(at(i)))).collect();
    }
    Ok(pictures)
}
