//! Taylor series integration of the gear pair: order [`ORDER`], restarted at every contact change.
//!
//! Within a step stiffness, damping, errors and forces are polynomials, so the coefficients of `q` follow
//! from the recurrence `q[n+2] = h^2 a[n] / ((n+1)(n+2))` with
//! `a = M^-1 (f - K0 q - C0 q' - sum out (k*(in.q) + c*(in.q') - g))`: the time-varying part costs scalar
//! convolutions only (reference/simulation-and-correction.md 2.4). The step's own coefficients tell how far
//! it may be used, so no step is ever rejected; the polynomial is the dense output.
//!
//! Cost: about 0.5-1 us per step of 8 coordinates; explicit, so stiff printed damping needs tiny steps.

use super::assembly::System;
use super::mesh::{Channel, MESH, Mesh, Terms};
use super::series::{LENGTH, ORDER, Series};
use crate::{Error, Result};
use serde::Serialize;

/// Accuracy and limits of an integration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Truncation error of a step's acceleration, relative to the largest acceleration so far.
    pub tolerance: f64,
    /// Longest step, s.
    pub longest_step_s: f64,
    /// Shortest step, s; anything below means that the model is too stiff for this method.
    pub shortest_step_s: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { tolerance: 1e-11, longest_step_s: 1e-3, shortest_step_s: 1e-13 }
    }
}

/// What an integration took.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Statistics {
    /// Steps taken.
    pub steps: u64,
    /// Evaluations of the recurrence (one per step and order).
    pub evaluations: u64,
    /// Steps that ended at a contact change or another break.
    pub breaks: u64,
    /// Changes of a pair's contact regime.
    pub contact_events: u64,
}

impl Statistics {
    /// Adds another integration's counts.
    pub fn add(&mut self, other: &Self) {
        self.steps += other.steps;
        self.evaluations += other.evaluations;
        self.breaks += other.breaks;
        self.contact_events += other.contact_events;
    }
}

/// Deflections and velocities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State<const N: usize> {
    /// Deflection, m or rad.
    pub q: [f64; N],
    /// Velocity, m/s or rad/s.
    pub v: [f64; N],
}

/// A finished step: polynomials of everything over `[start_s, start_s + end length_s]`.
pub struct Step<'s> {
    /// Start, s.
    pub start_s: f64,
    /// Unit of the series' time, s.
    pub length_s: f64,
    /// Part of the unit for which the step holds, 0..=1.
    pub end: f64,
    /// What acted.
    pub terms: &'s Terms,
    coefficients: &'s [f64],
    coordinates: usize,
}

impl Step<'_> {
    /// Number of coordinates.
    pub fn coordinates(&self) -> usize {
        self.coordinates
    }

    /// Deflection of a coordinate.
    pub fn deflection(&self, coordinate: usize) -> Series {
        let mut c = [0.0; LENGTH];
        for (n, c) in c.iter_mut().enumerate() {
            *c = self.coefficients[n * self.coordinates + coordinate];
        }
        Series::from_slice(&c)
    }

    /// Velocity of a coordinate.
    pub fn velocity(&self, coordinate: usize) -> Series {
        self.deflection(coordinate).derivative().scaled(1.0 / self.length_s)
    }

    /// Acceleration of a coordinate.
    pub fn acceleration(&self, coordinate: usize) -> Series {
        let mut c = [0.0; ORDER - 1];
        let scale = 1.0 / (self.length_s * self.length_s);
        for (n, c) in c.iter_mut().enumerate() {
            *c = scale * ((n + 1) * (n + 2)) as f64 * self.coefficients[(n + 2) * self.coordinates + coordinate];
        }
        Series::from_slice(&c)
    }

    /// `direction . q`.
    pub fn along(&self, direction: &[f64]) -> Series {
        let mut c = [0.0; LENGTH];
        for (c, row) in c.iter_mut().zip(self.coefficients.chunks_exact(self.coordinates)) {
            *c = row.iter().zip(direction).map(|(a, b)| a * b).sum();
        }
        Series::from_slice(&c)
    }
}

/// The system with everything premultiplied by the inverse mass, columns contiguous.
pub struct Solver<const N: usize> {
    stiffness: [[f64; N]; N],
    damping: [[f64; N]; N],
    force: [f64; N],
    directions: Vec<[f64; N]>,
    outputs: Vec<[f64; N]>,
    root_mass: [f64; N],
}

impl<const N: usize> Solver<N> {
    /// Prepares a system under a constant force.
    ///
    /// # Panics
    /// If the system does not have `N` coordinates: a programming error.
    pub fn new(system: &System, force: &nalgebra::DVector<f64>) -> Self {
        assert_eq!(system.len(), N, "coordinates");
        let inverse: [f64; N] = std::array::from_fn(|i| 1.0 / system.mass[i]);
        let columns =
            |m: &nalgebra::DMatrix<f64>| std::array::from_fn(|j| std::array::from_fn(|i| inverse[i] * m[(i, j)]));
        let directions = Mesh::directions::<N>(system);
        let outputs = directions.iter().map(|d| std::array::from_fn(|i| d[i] * inverse[i])).collect();
        Self {
            stiffness: columns(&system.stiffness),
            damping: columns(&system.damping),
            force: std::array::from_fn(|i| inverse[i] * force[i]),
            directions,
            outputs,
            root_mass: std::array::from_fn(|i| system.mass[i].sqrt()),
        }
    }

    /// Replaces the constant force.
    pub fn set_force(&mut self, force: &[f64]) {
        for ((own, given), root) in self.force.iter_mut().zip(force).zip(&self.root_mass) {
            *own = given / (root * root);
        }
    }

    /// Integrates from `from_s` to `to_s`, calling `sink` for every step.
    ///
    /// # Errors
    /// When the step falls below its limit or a value stops being finite.
    pub fn integrate(
        &self,
        mesh: &mut Mesh,
        state: &mut State<N>,
        (from_s, to_s): (f64, f64),
        options: &Options,
        mut sink: impl FnMut(&Step),
    ) -> Result<Statistics> {
        let mut statistics = Statistics::default();
        let mut terms = Terms::default();
        let mut table = [[0.0; N]; LENGTH];
        let mut t = from_s;
        let mut usable = options.longest_step_s;
        let mut scale = self.norm(&self.force);
        // Rounding of the clock: what is left of the interval below this is none.
        let clock = 4.0 * f64::EPSILON * from_s.abs().max(to_s.abs()).max(1e-6);
        while to_s - t > clock {
            let rest = to_s - t;
            let approach = dot(&self.directions[MESH], &state.q);
            let h = mesh.begin(t, rest.min(1.25 * usable).min(options.longest_step_s), approach, &mut terms);
            self.expand(&terms, state, h, &mut table);
            scale = scale.max(self.acceleration_norm(&table, 0, h));
            let limit = self.usable_part(&table, h, options.tolerance * scale);
            let mut end = limit.min(1.0);
            usable = limit.min(8.0) * h;
            let mut switch = None;
            if mesh.is_nonlinear() {
                let approach = series_along(&table, &self.directions[MESH]);
                switch = mesh.first_switch(&terms, &approach, end);
                end = switch.map_or(end, |(tau, ..)| tau);
            }
            if !(end * h >= options.shortest_step_s || switch.is_some() || h < options.shortest_step_s) {
                return Err(Error::impossible(
                    "dynamics",
                    format!("step below {} s at {t:.6} s: the model is too stiff or unstable", options.shortest_step_s),
                ));
            }
            sink(&Step {
                start_s: t,
                length_s: h,
                end,
                terms: &terms,
                coefficients: table.as_flattened(),
                coordinates: N,
            });
            advance(&table, end, h, state);
            if let Some((_, number, regime)) = switch {
                mesh.switch(number, regime);
                statistics.contact_events += 1;
            }
            statistics.steps += 1;
            statistics.evaluations += (ORDER - 1) as u64;
            statistics.breaks += u64::from(limit > 1.0 && h < rest);
            t += end * h;
            if !state.q.iter().chain(&state.v).all(|x| x.is_finite()) {
                return Err(Error::impossible("dynamics", format!("the motion is no longer finite at {t:.6} s")));
            }
        }
        Ok(statistics)
    }

    /// Taylor coefficients of the deflections from a state.
    fn expand(&self, terms: &Terms, state: &State<N>, h: f64, table: &mut [[f64; N]; LENGTH]) {
        let mut d = [[0.0; LENGTH]; 8];
        let mut w = [[0.0; LENGTH]; 8];
        let channels = &terms.channels[..terms.channels.len().min(8)];
        table[0] = state.q;
        table[1] = state.v.map(|v| v * h);
        let per_h = 1.0 / h;
        for n in 0..=ORDER - 2 {
            let q = table[n];
            let rate = (n + 1) as f64 * per_h;
            let v = table[n + 1].map(|c| c * rate);
            let mut a = if n == 0 { self.force } else { [0.0; N] };
            for ((stiffness, damping), (q, v)) in self.stiffness.iter().zip(&self.damping).zip(q.iter().zip(&v)) {
                for ((a, k), c) in a.iter_mut().zip(stiffness).zip(damping) {
                    *a -= k * q + c * v;
                }
            }
            for (index, channel) in channels.iter().enumerate() {
                let input = &self.directions[channel.input];
                d[index][n] = dot(input, &q);
                w[index][n] = dot(input, &v);
                let force = channel_force(channel, &d[index], &w[index], n);
                let output = &self.outputs[channel.output];
                for (a, o) in a.iter_mut().zip(output) {
                    *a -= force * o;
                }
            }
            for (direction, series) in &terms.forces {
                let value = series.coefficient(n);
                for (a, o) in a.iter_mut().zip(&self.outputs[*direction]) {
                    *a += value * o;
                }
            }
            let factor = h * h / ((n + 1) * (n + 2)) as f64;
            table[n + 2] = a.map(|a| a * factor);
        }
    }

    fn norm(&self, a: &[f64; N]) -> f64 {
        a.iter().zip(&self.root_mass).map(|(a, m)| (a * m).powi(2)).sum::<f64>().sqrt()
    }

    /// Mass-weighted norm of the acceleration's coefficient `n`.
    fn acceleration_norm(&self, table: &[[f64; N]; LENGTH], n: usize, h: f64) -> f64 {
        self.norm(&table[n + 2]) * ((n + 1) * (n + 2)) as f64 / (h * h)
    }

    /// Part of the step's unit within which the last acceleration terms stay below `limit`.
    fn usable_part(&self, table: &[[f64; N]; LENGTH], h: f64, limit: f64) -> f64 {
        [ORDER - 2, ORDER - 3]
            .into_iter()
            .map(|n| {
                let last = self.acceleration_norm(table, n, h);
                if last > 0.0 { (limit / last).powf(1.0 / n as f64) } else { f64::INFINITY }
            })
            .fold(f64::INFINITY, f64::min)
    }
}

fn channel_force(channel: &Channel, d: &[f64; LENGTH], w: &[f64; LENGTH], n: usize) -> f64 {
    let mut force = -channel.g.coefficient(n);
    for (j, k) in channel.k.coefficients().iter().enumerate().take(n + 1) {
        force += k * d[n - j];
    }
    for (j, c) in channel.c.coefficients().iter().enumerate().take(n + 1) {
        force += c * w[n - j];
    }
    force
}

fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn series_along<const N: usize>(table: &[[f64; N]; LENGTH], direction: &[f64; N]) -> Series {
    let mut c = [0.0; LENGTH];
    for (c, row) in c.iter_mut().zip(table) {
        *c = dot(row, direction);
    }
    Series::from_slice(&c)
}

/// State at `end` of the step.
fn advance<const N: usize>(table: &[[f64; N]; LENGTH], end: f64, h: f64, state: &mut State<N>) {
    let (mut q, mut v) = ([0.0; N], [0.0; N]);
    for row in table.iter().rev() {
        for i in 0..N {
            v[i] = v[i] * end + q[i];
            q[i] = q[i] * end + row[i];
        }
    }
    state.q = q;
    state.v = v.map(|v| v / h);
}
