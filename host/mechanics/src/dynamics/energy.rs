//! Energy balance of a run: where the energy that enters goes.
//!
//! `E = v'Mv/2 + q'K0q/2 + sum k_i d_i^2 / 2` with each pair's deflection `d_i = delta - e_i`. Its change
//! equals input (external forces) minus dissipation (shafts and bearings, mesh, friction) plus the work of
//! errors (`-F_i e_i'`), of modulated bearings, and the *parametric* work `sum k_i' d_i^2 / 2` of stiffness
//! that is prescribed to change, its jumps included.
//!
//! The parametric work is what the usual equations with prescribed stiffness take from or give to the drive
//! without saying so (Oh, Grosh and Barber 2005). A smooth curve does that work continuously. A step curve
//! does it in jumps: a pair that engages under deflection brings stored energy `k d^2 / 2` from nowhere, one
//! that leaves takes it away. Both are counted as a term, so the balance closes whenever the solution is
//! right, and the term stands beside the dissipation so that its size is seen: for step curves it is of the
//! dissipation's order, the price of the form.
//!
//! Integrals over a step by 16-point Gauss-Legendre: exact to degree 31.

use super::assembly::System;
use super::mesh::{Mesh, PairTerm, Regime, UNIT};
use super::taylor::Step;
use serde::Serialize;

/// Nodes (positive half) and weights of 16-point Gauss-Legendre on [-1, 1].
const GAUSS: [(f64, f64); 8] = [
    (0.0950125098376374, 0.1894506104550685),
    (0.2816035507792589, 0.1826034150449236),
    (0.4580167776572274, 0.1691565193950025),
    (0.6178762444026438, 0.1495959888165767),
    (0.755404408355003, 0.1246289712555339),
    (0.8656312023878318, 0.0951585116824928),
    (0.9445750230732326, 0.0622535239386479),
    (0.9894009349916499, 0.0271524594117541),
];

/// Energies of an interval, J.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Balance {
    /// Work of external forces on the deviations from rigid rotation.
    pub input_j: f64,
    /// Dissipated in shafts and bearings.
    pub dissipated_shafts_j: f64,
    /// Dissipated in the mesh.
    pub dissipated_mesh_j: f64,
    /// Lost to friction of the flanks and to modulated bearings (negative: gained).
    pub modulated_j: f64,
    /// Work of errors.
    pub errors_j: f64,
    /// Work of the prescribed change of stiffness, jumps included.
    pub parametric_j: f64,
    /// Part of the parametric work done in jumps.
    pub jumps_j: f64,
    /// Change of the stored energy.
    pub stored_j: f64,
    /// Sum of the magnitudes exchanged, the scale of [`Balance::residual`].
    pub exchanged_j: f64,
}

impl Balance {
    /// What does not close, relative to the energy exchanged ([`Balance::exchanged_j`]).
    pub fn residual(&self) -> f64 {
        let lost = self.dissipated_shafts_j + self.dissipated_mesh_j + self.modulated_j;
        let open = self.input_j - lost + self.errors_j + self.parametric_j - self.stored_j;
        open.abs() / self.exchanged_j.max(f64::MIN_POSITIVE)
    }

    fn add(&mut self, other: &Self) {
        self.input_j += other.input_j;
        self.dissipated_shafts_j += other.dissipated_shafts_j;
        self.dissipated_mesh_j += other.dissipated_mesh_j;
        self.modulated_j += other.modulated_j;
        self.errors_j += other.errors_j;
        self.parametric_j += other.parametric_j;
        self.jumps_j += other.jumps_j;
        self.stored_j += other.stored_j;
        self.exchanged_j += other.exchanged_j;
    }
}

/// Collects the balance over steps.
pub struct Meter<'a> {
    system: &'a System,
    force: Vec<f64>,
    directions: Vec<Vec<f64>>,
    balance: Balance,
    before: Option<f64>,
}

impl<'a> Meter<'a> {
    /// A meter for a system under a constant force.
    pub fn new(system: &'a System, force: &nalgebra::DVector<f64>) -> Self {
        let directions = Mesh::all_directions(system);
        Self { system, force: force.iter().copied().collect(), directions, balance: Balance::default(), before: None }
    }

    /// The balance so far.
    pub fn balance(&self) -> Balance {
        self.balance
    }

    /// Takes the balance so far and starts a new interval at the same state.
    pub fn take(&mut self) -> Balance {
        std::mem::take(&mut self.balance)
    }

    /// Adds a step.
    pub fn add(&mut self, step: &Step) {
        let n = self.system.len();
        let (mut q, mut v) = (vec![0.0; n], vec![0.0; n]);
        step.state(0.0, &mut q, &mut v);
        let start = self.stored(step, 0.0, &q, &v);
        let mut balance = Balance::default();
        if let Some(before) = self.before {
            // Deflections are continuous, so a jump of stored energy is a jump of stiffness.
            let jump = start - before;
            balance.parametric_j += jump;
            balance.jumps_j += jump;
            balance.exchanged_j += jump.abs();
            balance.stored_j += jump;
        }
        for (node, weight) in GAUSS.iter().flat_map(|&(x, w)| [(x, w), (-x, w)]) {
            let tau = 0.5 * step.end * (1.0 + node);
            step.state(tau, &mut q, &mut v);
            self.rates(step, tau, 0.5 * step.end * step.length_s * weight, (&q, &v), &mut balance);
        }
        step.state(step.end, &mut q, &mut v);
        let end = self.stored(step, step.end, &q, &v);
        balance.stored_j += end - start;
        self.before = Some(end);
        self.balance.add(&balance);
    }

    /// Stored energy.
    fn stored(&self, step: &Step, tau: f64, q: &[f64], v: &[f64]) -> f64 {
        let kinetic: f64 = v.iter().zip(self.system.mass.iter()).map(|(v, m)| 0.5 * m * v * v).sum();
        let springs = 0.5 * quadratic(&self.system.stiffness, q);
        let delta = dot(self.system.mesh.as_slice(), q);
        let pairs = touching(step).map(|p| {
            let d = delta - p.e.value(tau) + p.clearance_m;
            0.5 * p.k.value(tau) * d * d
        });
        kinetic + springs + pairs.sum::<f64>()
    }

    /// Adds the powers at `tau`, weighted with the time `dt`.
    fn rates(&self, step: &Step, tau: f64, dt: f64, (q, v): (&[f64], &[f64]), balance: &mut Balance) {
        let h = step.length_s;
        let mut input = dot(v, &self.force);
        input += step.terms.forces.iter().map(|(unit, f)| f.value(tau) * v[unit - UNIT]).sum::<f64>();
        let shafts = quadratic(&self.system.damping, v);
        balance.input_j += input * dt;
        balance.dissipated_shafts_j += shafts * dt;
        balance.exchanged_j += (input.abs() + shafts) * dt;
        let (delta, rate) = (dot(self.system.mesh.as_slice(), q), dot(self.system.mesh.as_slice(), v));
        for pair in touching(step) {
            let e_rate = pair.e.derivative().value(tau) / h;
            let (d, d_rate) = (delta - pair.e.value(tau) + pair.clearance_m, rate - e_rate);
            let (k, c) = (pair.k.value(tau), pair.c.value(tau));
            let errors = -(k * d + c * d_rate) * e_rate;
            let parametric = 0.5 * pair.k.derivative().value(tau) / h * d * d;
            balance.dissipated_mesh_j += c * d_rate * d_rate * dt;
            balance.errors_j += errors * dt;
            balance.parametric_j += parametric * dt;
            balance.exchanged_j += (c * d_rate * d_rate + errors.abs() + parametric.abs()) * dt;
        }
        // Everything but the mesh itself: friction and modulated bearings.
        for channel in step.terms.channels().iter().skip(1) {
            let (input, output) = (&self.directions[channel.input], &self.directions[channel.output]);
            let (k, c, g) = (channel.k.value(tau), channel.c.value(tau), channel.g.value(tau));
            let power = (k * dot(input, q) + c * dot(input, v) - g) * dot(output, v);
            balance.modulated_j += power * dt;
            balance.exchanged_j += power.abs() * dt;
        }
    }
}

fn touching<'s>(step: &'s Step) -> impl Iterator<Item = &'s PairTerm> {
    step.terms.pairs.iter().filter(|p| p.regime != Regime::Free)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn quadratic(m: &nalgebra::DMatrix<f64>, x: &[f64]) -> f64 {
    (0..x.len()).map(|i| (0..x.len()).map(|j| x[i] * m[(i, j)] * x[j]).sum::<f64>()).sum()
}

/// Balance of single mesh periods of a run, and what the flanks carried.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Report {
    /// Sum over the periods looked at.
    pub sum: Balance,
    /// Mesh periods looked at, from time 0 on.
    pub mesh_periods: u32,
    /// Largest residual of one mesh period, relative to the mean energy exchanged per period.
    pub worst_residual: f64,
    /// Least mesh force over the whole run, N; below zero linear contact made the teeth pull.
    pub least_mesh_force_n: f64,
    /// When that was, s.
    pub least_at_s: f64,
}

/// Mesh periods whose balance is taken; a step's balance costs ten times the step itself.
const PERIODS: u32 = 20;

/// Watches a run from time 0 on: balance of its first 20 mesh periods, and the least mesh force.
pub struct Watch<'a> {
    meter: Meter<'a>,
    mesh: Vec<f64>,
    period: Option<i64>,
    parts: Vec<Balance>,
    least: (f64, f64),
}

impl<'a> Watch<'a> {
    /// A watch on a system under a constant force.
    pub fn new(system: &'a System, force: &nalgebra::DVector<f64>) -> Self {
        let mesh = system.mesh.iter().copied().collect();
        Self { meter: Meter::new(system, force), mesh, period: None, parts: Vec::new(), least: (f64::INFINITY, 0.0) }
    }

    /// Adds a step.
    pub fn add(&mut self, step: &Step) {
        if step.start_s < 0.0 {
            return;
        }
        let force = mesh_force(step, &self.mesh);
        if force < self.least.0 {
            self.least = (force, step.start_s);
        }
        if self.parts.len() as u32 >= PERIODS {
            return;
        }
        // A period ends where a pair enters: a knot of the curve, hence the border of a step.
        let period = (step.terms.position + 1e-6).floor() as i64;
        if self.period.is_some_and(|before| before != period) {
            self.parts.push(self.meter.take());
        }
        self.period = Some(period);
        self.meter.add(step);
    }

    /// What was seen.
    pub fn report(mut self) -> Report {
        if self.parts.is_empty() {
            self.parts.push(self.meter.take());
        }
        // The first part may be less than a period; residuals are measured on a common scale.
        let mut sum = Balance::default();
        self.parts.iter().for_each(|p| sum.add(p));
        let scale = sum.exchanged_j / self.parts.len() as f64;
        let open = |p: &Balance| p.residual() * p.exchanged_j / scale.max(f64::MIN_POSITIVE);
        Report {
            sum,
            mesh_periods: self.parts.len() as u32,
            worst_residual: self.parts.iter().map(open).fold(0.0, f64::max),
            least_mesh_force_n: self.least.0,
            least_at_s: self.least.1,
        }
    }
}

/// Mesh force at the start of a step, N.
fn mesh_force(step: &Step, mesh: &[f64]) -> f64 {
    let channel = &step.terms.channels()[0];
    let (delta, rate) = step.start_along(mesh);
    channel.k.coefficient(0) * delta + channel.c.coefficient(0) * rate - channel.g.coefficient(0)
}
