//! Energy balance of a run: where the energy that enters goes.
//!
//! `E = v'Mv/2 + q'K0q/2 + sum k_i (delta - e_i)^2 / 2`. Its change equals input (external forces) minus
//! dissipation (shafts and bearings, mesh) plus the work of errors (`-F_i e_i'`) plus the *parametric* work
//! `sum k_i' (delta - e_i)^2 / 2` of stiffness that is prescribed to change, its jumps included. The latter
//! is what the usual time-varying-stiffness equations take from or give to the drive without saying so
//! (Oh, Grosh and Barber 2005): it is counted as a term, so the balance closes whenever the solution is
//! right, and is reported beside the input so that its size is seen.
//!
//! Integrals over a step by 16-point Gauss-Legendre: exact to degree 31.

use super::assembly::System;
use super::mesh::{Regime, UNIT};
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
    /// Work of errors.
    pub errors_j: f64,
    /// Work of the prescribed change of stiffness, jumps included.
    pub parametric_j: f64,
    /// Change of the stored energy.
    pub stored_j: f64,
    /// Sum of the magnitudes exchanged, the scale of [`Balance::residual`].
    pub exchanged_j: f64,
}

impl Balance {
    /// What does not close, relative to the energy dissipated.
    pub fn residual(&self) -> f64 {
        let lost = self.dissipated_shafts_j + self.dissipated_mesh_j;
        let open = self.input_j - lost + self.errors_j + self.parametric_j - self.stored_j;
        open.abs() / self.exchanged_j.max(f64::MIN_POSITIVE)
    }
}

/// Collects the balance over steps; linear contact, no friction.
pub struct Meter<'a> {
    system: &'a System,
    force: Vec<f64>,
    balance: Balance,
    before: Option<f64>,
}

impl<'a> Meter<'a> {
    /// A meter for a system under a constant force.
    pub fn new(system: &'a System, force: &nalgebra::DVector<f64>) -> Self {
        Self { system, force: force.iter().copied().collect(), balance: Balance::default(), before: None }
    }

    /// The balance so far.
    pub fn balance(&self) -> Balance {
        self.balance
    }

    /// Adds a step.
    pub fn add(&mut self, step: &Step) {
        let n = self.system.len();
        let q: Vec<_> = (0..n).map(|i| step.deflection(i)).collect();
        let v: Vec<_> = (0..n).map(|i| step.velocity(i)).collect();
        let delta = step.along(self.system.mesh.as_slice());
        let pairs: Vec<_> = step
            .terms
            .pairs
            .iter()
            .filter(|p| p.regime == Regime::Drive)
            .map(|p| {
                let mut deflection = delta;
                deflection.add_scaled(&p.e, -1.0);
                (p, deflection)
            })
            .collect();
        let stored = |tau: f64| {
            let (qs, vs): (Vec<f64>, Vec<f64>) = (0..n).map(|i| (q[i].value(tau), v[i].value(tau))).unzip();
            let kinetic: f64 = (0..n).map(|i| 0.5 * self.system.mass[i] * vs[i] * vs[i]).sum();
            let springs = 0.5 * quadratic(&self.system.stiffness, &qs);
            let mesh: f64 = pairs.iter().map(|(p, d)| 0.5 * p.k.value(tau) * d.value(tau).powi(2)).sum();
            kinetic + springs + mesh
        };
        let start = stored(0.0);
        if let Some(before) = self.before {
            // Deflections are continuous, so a jump of stored energy is a jump of stiffness.
            self.balance.parametric_j += start - before;
            self.balance.exchanged_j += (start - before).abs();
            self.balance.stored_j += start - before;
        }
        let end = stored(step.end);
        self.balance.stored_j += end - start;
        self.before = Some(end);
        let h = step.length_s;
        for (node, weight) in GAUSS.iter().flat_map(|&(x, w)| [(x, w), (-x, w)]) {
            let tau = 0.5 * step.end * (1.0 + node);
            let dt = 0.5 * step.end * h * weight;
            let vs: Vec<f64> = v.iter().map(|v| v.value(tau)).collect();
            let mut input: f64 = vs.iter().zip(&self.force).map(|(v, f)| v * f).sum();
            input += step.terms.forces.iter().map(|(unit, f)| f.value(tau) * vs[unit - UNIT]).sum::<f64>();
            let shafts = quadratic(&self.system.damping, &vs);
            self.balance.input_j += input * dt;
            self.balance.dissipated_shafts_j += shafts * dt;
            self.balance.exchanged_j += (input.abs() + shafts) * dt;
            for (pair, deflection) in &pairs {
                let (d, rate) = (deflection.value(tau), deflection.derivative().value(tau) / h);
                let (k, c) = (pair.k.value(tau), pair.c.value(tau));
                let errors = -(k * d + c * rate) * pair.e.derivative().value(tau) / h;
                let parametric = 0.5 * pair.k.derivative().value(tau) / h * d * d;
                self.balance.dissipated_mesh_j += c * rate * rate * dt;
                self.balance.errors_j += errors * dt;
                self.balance.parametric_j += parametric * dt;
                self.balance.exchanged_j += (c * rate * rate + errors.abs() + parametric.abs()) * dt;
            }
        }
    }
}

fn quadratic(m: &nalgebra::DMatrix<f64>, x: &[f64]) -> f64 {
    (0..x.len()).map(|i| (0..x.len()).map(|j| x[i] * m[(i, j)] * x[j]).sum::<f64>()).sum()
}
