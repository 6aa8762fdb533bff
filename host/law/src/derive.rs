//! From a machine to its law: bandwidths at the fit's speeds, every form, and the check at other speeds.
//!
//! The law's timed edge is the one with which a pair gives its load off (acceleration of the pinion rises),
//! of one engagement alone: what the ramp and the modes make of it, free of the ring of other engagements.
//! The ring is no property of speed alone (it changes with every small change of it), so no law can hold it;
//! what it adds in the full simulation is measured here at every held-out speed and reported as scatter.
//! Where that scatter is small everywhere (at most `SMALL_RING`: short ramps, as the paper's) the table takes
//! the middle between the edge alone and the edge on its ring, which is nearest to both.

use super::domain::{Domain, RANDOM_SPEEDS};
use super::edges::Edge;
use super::file::LawFile;
use super::fit::{Fit, fit, fit_quadratic_absolute, fit_table, start_values};
use super::forms::{Law, RISE_TIME_PRODUCT};
use super::operating::{Bench, Event};
use super::point::Point;
use crate::machine::{EngagementKind, Machine};
use crate::{Error, Result};
use rayon::prelude::*;
use serde::Serialize;

/// Speeds from which the table's knots are chosen: log-spaced over the domain.
pub(super) const FIT_SPEEDS: usize = 577;
/// Relative error at which no more knots are added.
pub(super) const KNOT_TOLERANCE: f64 = 2e-4;
/// Largest scatter by the ring up to which the table takes the middle.
const SMALL_RING: f64 = 0.01;
/// Speeds to which the forms with coefficients are fitted: evenly spaced, in the paper's range the whole ones.
const EVEN_SPEEDS: usize = 25;

/// The fitted forms of a machine.
#[derive(Debug, Clone, Serialize)]
pub struct Laws {
    /// Title of the machine.
    pub machine: String,
    /// Fingerprint of the machine, hexadecimal.
    pub machine_hash: String,
    /// Kind of its engagement ramp.
    pub ramp: EngagementKind,
    /// Width of the exit ramp, rad of the pinion.
    pub ramp_width_rad: f64,
    /// Torque, N m.
    pub torque_n_m: f64,
    /// Pinion speeds that it is made for.
    pub domain: Domain,
    /// Bandwidths fitted.
    pub points: Vec<Point>,
    /// Quadratic (absolute errors, as the paper), root-sum-square, ramp-through-mode, tabulated.
    pub fits: Vec<Fit>,
}

/// How the forms do at speeds not fitted.
#[derive(Debug, Clone, Serialize)]
pub struct Check {
    /// Speeds of the first three rows, Hz.
    pub named_hz: [f64; 3],
    /// Speed of [`FormCheck::beyond`], Hz.
    pub beyond_hz: f64,
    /// One row per held-out speed.
    pub rows: Vec<CheckRow>,
    /// One entry per form.
    pub forms: Vec<FormCheck>,
    /// Held-out speeds at which the ring hides the edge.
    pub hidden: usize,
    /// Scatter of the full simulation's edges about the edge alone: largest relative difference.
    pub ring_worst: f64,
    /// Its root mean square.
    pub ring_rms: f64,
}

/// Bandwidths at a held-out speed.
#[derive(Debug, Clone, Serialize)]
pub struct CheckRow {
    /// Pinion speed, Hz.
    pub shaft_hz: f64,
    /// Bandwidth of the edge alone, Hz.
    pub bandwidth_hz: f64,
    /// Bandwidth of the edge in the full periodic simulation, Hz; absent where the ring hides it (no edge with a
    /// third of the height that it has alone).
    pub periodic_hz: Option<f64>,
    /// Bandwidth by each form, in the order of [`Laws::fits`], Hz.
    pub by_form_hz: Vec<f64>,
}

/// Largest errors of one form.
#[derive(Debug, Clone, Serialize)]
pub struct FormCheck {
    /// Name of the form.
    pub form: &'static str,
    /// At [`Check::named_hz`], relative, against the full simulation.
    pub at_named: Vec<f64>,
    /// Largest relative error against the edge alone over all held-out speeds.
    pub worst: f64,
    /// Largest relative error against the full simulation over all held-out speeds.
    pub worst_periodic: f64,
    /// Relative error at twice the highest fitted speed, against the edge alone.
    pub beyond: f64,
}

/// Bandwidth of an edge, Hz.
pub fn bandwidth_hz(edge: &Edge) -> f64 {
    RISE_TIME_PRODUCT / edge.rise_time_s
}

/// The torque a study runs at: the ramp's, else the nominal one.
///
/// # Errors
/// Where the machine declares neither.
pub fn study_torque(machine: &Machine) -> Result<f64> {
    machine
        .engagement
        .and_then(|e| e.torque_n_m)
        .or(machine.nominal.map(|n| n.torque_n_m))
        .ok_or_else(|| Error::invalid("[nominal] torque_n_m", "missing: the law needs an operating point"))
}

/// Bandwidth of the law's edge at a speed, Hz.
///
/// # Errors
/// As [`edge_alone`].
pub fn edge_bandwidth_hz(bench: &Bench, shaft_hz: f64, torque_n_m: f64) -> Result<f64> {
    Ok(bandwidth_hz(&edge_alone(bench, shaft_hz, torque_n_m)?))
}

/// The law's edge at a speed.
///
/// # Errors
/// What stops the simulation, and an edge that cannot be timed.
pub fn edge_alone(bench: &Bench, shaft_hz: f64, torque_n_m: f64) -> Result<Edge> {
    bench.isolated(Event::Exit, shaft_hz, torque_n_m)?.ok_or_else(|| {
        Error::impossible(
            "bandwidth law",
            format!("no engagement edge stands alone at {shaft_hz:.3} Hz, {torque_n_m} N m"),
        )
    })
}

/// Fits every form to a machine.
///
/// # Errors
/// What stops the simulation or a fit.
pub fn derive(machine: &Machine, bench: &Bench, domain: Domain, step: &(impl Fn() + Sync)) -> Result<Laws> {
    let torque_n_m = study_torque(machine)?;
    let at = |speeds: Vec<f64>| -> Result<Vec<Point>> {
        speeds
            .into_par_iter()
            .map(|shaft_hz| {
                let bandwidth_hz = edge_bandwidth_hz(bench, shaft_hz, torque_n_m)?;
                step();
                Ok(Point { shaft_hz, bandwidth_hz })
            })
            .collect()
    };
    // The knots need finer speeds around the knee.
    let even = at(domain.even_speeds(EVEN_SPEEDS))?;
    let dense = middle(bench, torque_n_m, at(domain.log_speeds(FIT_SPEEDS))?)?;
    let [_, root_sum_square, ramp_through_mode] = start_values(&even);
    let fits = vec![
        fit_quadratic_absolute(&even)?,
        fit(root_sum_square, &even)?,
        fit(ramp_through_mode, &even)?,
        fit_table(&dense, meshband::law::MAX_KNOTS, KNOT_TOLERANCE)?,
    ];
    let exit = bench.ramps().exit;
    let per_rad = f64::from(machine.pair.teeth[0]) / std::f64::consts::TAU;
    Ok(Laws {
        machine: machine.title.clone(),
        machine_hash: format!("{:#018x}", machine.hash()),
        ramp: machine.engagement.map_or(EngagementKind::None, |e| e.kind),
        ramp_width_rad: (exit[1] - exit[0]) / per_rad,
        torque_n_m,
        domain,
        points: even,
        fits,
    })
}

/// The edges alone, or the middle between them and the full simulation's where the ring is small at every speed.
fn middle(bench: &Bench, torque_n_m: f64, alone: Vec<Point>) -> Result<Vec<Point>> {
    let on_ring: Vec<Option<f64>> = alone
        .par_iter()
        .map(|p| Ok(bench.healthy(p.shaft_hz, torque_n_m)?.edge(0, Event::Exit).as_ref().map(bandwidth_hz)))
        .collect::<Result<_>>()?;
    let pairs = || alone.iter().zip(&on_ring);
    if pairs().any(|(p, ring)| ring.is_none_or(|ring| (ring / p.bandwidth_hz - 1.0).abs() > SMALL_RING)) {
        return Ok(alone);
    }
    let middle = |p: &Point, ring: &Option<f64>| (p.bandwidth_hz * ring.unwrap_or(p.bandwidth_hz)).sqrt();
    Ok(pairs().map(|(p, ring)| Point { shaft_hz: p.shaft_hz, bandwidth_hz: middle(p, ring) }).collect())
}

/// Number of operating points [`derive()`] and [`check`] compute, for progress.
pub const OPERATING_POINTS: u64 = (EVEN_SPEEDS + FIT_SPEEDS + 3 + RANDOM_SPEEDS) as u64;

/// Compares every form with simulations at speeds that were not fitted.
///
/// # Errors
/// What stops the simulation.
pub fn check(laws: &Laws, bench: &Bench, step: &(impl Fn() + Sync)) -> Result<Check> {
    let rows: Vec<CheckRow> = laws
        .domain
        .held_out_speeds()
        .into_par_iter()
        .map(|shaft_hz| {
            let alone = edge_alone(bench, shaft_hz, laws.torque_n_m)?;
            let periodic = bench.healthy(shaft_hz, laws.torque_n_m)?.edge(0, Event::Exit);
            step();
            Ok(CheckRow {
                shaft_hz,
                bandwidth_hz: bandwidth_hz(&alone),
                periodic_hz: periodic.filter(|p| p.height() > alone.height() / 3.0).as_ref().map(bandwidth_hz),
                by_form_hz: laws.fits.iter().map(|f| f.law.bandwidth_hz(shaft_hz)).collect(),
            })
        })
        .collect::<Result<_>>()?;
    let beyond_hz = laws.domain.beyond_hz();
    let beyond = edge_bandwidth_hz(bench, beyond_hz, laws.torque_n_m)?;
    let worst = |errors: &mut dyn Iterator<Item = f64>| errors.fold(0.0_f64, |w, e| w.max(e.abs()));
    let forms = laws
        .fits
        .iter()
        .enumerate()
        .map(|(i, fit)| {
            let periodic = |r: &CheckRow| r.periodic_hz.map(|p| r.by_form_hz[i] / p - 1.0);
            FormCheck {
                form: fit.law.name(),
                at_named: rows.iter().take(3).map(|r| periodic(r).unwrap_or(f64::NAN)).collect(),
                worst: worst(&mut rows.iter().map(|r| r.by_form_hz[i] / r.bandwidth_hz - 1.0)),
                worst_periodic: worst(&mut rows.iter().filter_map(periodic)),
                beyond: fit.law.bandwidth_hz(beyond_hz) / beyond - 1.0,
            }
        })
        .collect();
    let ring: Vec<f64> = rows.iter().filter_map(|r| r.periodic_hz.map(|p| p / r.bandwidth_hz - 1.0)).collect();
    Ok(Check {
        named_hz: laws.domain.named_speeds(),
        beyond_hz,
        hidden: rows.iter().filter(|r| r.periodic_hz.is_none()).count(),
        ring_worst: worst(&mut ring.iter().copied()),
        ring_rms: (ring.iter().map(|e| e * e).sum::<f64>() / ring.len().max(1) as f64).sqrt(),
        rows,
        forms,
    })
}

impl Laws {
    /// The tabulated law, the one handed to nodes; `relative_uncertainty` as found by [`check`].
    pub fn file(&self, relative_uncertainty: f64) -> LawFile {
        let table = self.fits.iter().find(|f| matches!(f.law, Law::Tabulated { .. })).expect("derive fits a table");
        // Six digits are what a node's f32 holds; more would only look exact.
        let digits = |x: f64| format!("{x:.5e}").parse::<f64>().expect("a number");
        let Law::Tabulated { knots } = &table.law else { unreachable!("just found") };
        let knots = knots.iter().map(|&(f, b)| (digits(f), digits(b))).collect();
        LawFile {
            machine: self.machine.clone(),
            machine_hash: self.machine_hash.clone(),
            ramp: self.ramp,
            measured: None,
            domain_hz: [self.domain.lowest_hz, self.domain.highest_hz],
            relative_uncertainty: digits(relative_uncertainty),
            law: Law::Tabulated { knots },
        }
    }
}

/// Largest error with the ring up to which the law says what single edges do, and up to which it still sets rates.
const MAX_RING_ERRORS: [f64; 2] = [0.02, 0.1];

impl Check {
    /// How far the tabulated law can be relied on, in one sentence, from its worst error with the ring.
    pub fn reliance(&self) -> String {
        let worst = self.forms.iter().find(|f| f.form == "tabulated").map_or(f64::INFINITY, |f| f.worst_periodic);
        let off = format!("{:.1} %, the ring of earlier engagements included", 100.0 * worst);
        match (self.hidden, worst) {
            (0, worst) if worst <= MAX_RING_ERRORS[0] => {
                format!("The tabulated law can be relied on for single edges: it is off by at most {off}.")
            }
            (0, worst) if worst <= MAX_RING_ERRORS[1] => {
                format!(
                    "The tabulated law can be relied on for sampling rates, not for single edges: it is off by up to \
                     {off}."
                )
            }
            (hidden, _) => format!(
                "The tabulated law does not predict single edges: they lie up to {off}, from it, and the ring hides \
                 them at {hidden} of {} speeds; \
                 it is an average: good for sampling rates with that margin; for single edges measure it on the \
                 machine (`meshband law learn`).",
                self.rows.len()
            ),
        }
    }

    /// Relative standard uncertainty of the tabulated law: its own error and the ring's scatter together.
    pub fn relative_uncertainty(&self) -> f64 {
        let table = self.forms.iter().find(|f| f.form == "tabulated").map_or(0.0, |f| f.worst);
        table.hypot(self.ring_rms).min(1.0)
    }
}
