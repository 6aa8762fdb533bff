//! Taylor series integration of the gear pair: order [`ORDER`], restarted at every contact change.
//!
//! Within a step stiffness, damping, errors and forces are polynomials, so the coefficients of `q` follow
//! from the recurrence `q[n+2] = h^2 a[n] / ((n+1)(n+2))` with
//! `a = M^-1 (f - K0 q - C0 q' - sum out (k*(in.q) + c*(in.q') - g))`: the time-varying part costs scalar
//! convolutions only (reference/simulation-and-correction.md 2.4). The step's own coefficients tell how far
//! it may be used, so only one whose terms overflow is repeated; the polynomial is the dense output. Where a break
//! cuts a step far below that limit the series ends as soon as its terms no longer matter.
//!
//! Shafts and bearings couple few coordinates: their matrices are kept as a diagonal and a short list.
//! Cost: below 1 us per step of 8 coordinates, bound by the latency of the recurrence, so coordinates
//! at rest cost nothing that can be measured. Explicit: the printed damping needs tiny steps.

use super::assembly::System;
use super::expansion::{Expansion, Premultiplied, Start, along, in_order, place, placed};
use super::mesh::{MESH, Mesh, Terms};
use super::series::{LENGTH, ORDER, Series};
use crate::lanes::{LANES, Lane, Several};
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
    /// One row per power of the normalised time, coordinates at their place.
    coefficients: &'s [f64],
    coordinates: usize,
}

impl Step<'_> {
    /// Number of coordinates.
    pub fn coordinates(&self) -> usize {
        self.coordinates
    }

    /// End, s.
    pub fn end_s(&self) -> f64 {
        self.start_s + self.end * self.length_s
    }

    fn rows(&self) -> std::slice::ChunksExact<'_, f64> {
        self.coefficients.chunks_exact(self.coordinates)
    }

    /// Deflection of a coordinate.
    pub fn deflection(&self, coordinate: usize) -> Series {
        let mut c = [0.0; LENGTH];
        let place = place(coordinate, self.coordinates);
        let rows = self.rows();
        let count = rows.len();
        c.iter_mut().zip(rows).for_each(|(c, row)| *c = row[place]);
        Series::from_slice(&c[..count])
    }

    /// Velocity of a coordinate.
    pub fn velocity(&self, coordinate: usize) -> Series {
        self.deflection(coordinate).derivative().scaled(1.0 / self.length_s)
    }

    /// Acceleration of a coordinate.
    pub fn acceleration(&self, coordinate: usize) -> Series {
        let mut c = [0.0; ORDER - 1];
        let place = place(coordinate, self.coordinates);
        let scale = 1.0 / (self.length_s * self.length_s);
        let rows = self.rows().skip(2);
        let count = rows.len();
        for (n, (c, row)) in c.iter_mut().zip(rows).enumerate() {
            *c = scale * ((n + 1) * (n + 2)) as f64 * row[place];
        }
        Series::from_slice(&c[..count])
    }

    /// `direction . q`.
    pub fn along(&self, direction: &[f64]) -> Series {
        let mut c = [0.0; LENGTH];
        let rows = self.rows();
        let count = rows.len();
        for (c, row) in c.iter_mut().zip(rows) {
            *c = self.dot(direction, row);
        }
        Series::from_slice(&c[..count])
    }

    /// `direction . q` and `direction . q'` at the start.
    pub fn start_along(&self, direction: &[f64]) -> (f64, f64) {
        let (q, v) = self.coefficients.split_at(self.coordinates);
        (self.dot(direction, q), self.dot(direction, &v[..self.coordinates]) / self.length_s)
    }

    fn dot(&self, direction: &[f64], row: &[f64]) -> f64 {
        direction.iter().enumerate().map(|(i, d)| d * row[place(i, self.coordinates)]).sum()
    }

    /// Deflections and velocities of all coordinates at `tau`.
    pub fn state(&self, tau: f64, deflection: &mut [f64], velocity: &mut [f64]) {
        deflection.fill(0.0);
        velocity.fill(0.0);
        for row in self.rows().rev() {
            for (i, (q, v)) in deflection.iter_mut().zip(velocity.iter_mut()).enumerate() {
                *v = *v * tau + *q;
                *q = *q * tau + row[place(i, self.coordinates)];
            }
        }
        velocity.iter_mut().for_each(|v| *v /= self.length_s);
    }
}

/// What drives one column of a propagation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive<const N: usize> {
    /// Constant generalised force over mass.
    acceleration: [f64; N],
    /// Whether errors and external forces of the mesh act.
    errors: bool,
}

/// One solution among several that share their steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Column<const N: usize> {
    /// Present state.
    pub state: State<N>,
    /// What drives it.
    pub drive: Drive<N>,
}

/// What a propagation holds of [`LANES`] columns.
struct Lanes<const N: usize> {
    start: Start<N, Several>,
    expansion: Expansion<N, Several>,
    /// Largest acceleration so far.
    scales: Several,
}

/// A usable part that no finite terms lead to.
const MIN_USABLE_PART: f64 = 1e-20;

/// The integrator of one system under a constant force.
pub struct Solver<const N: usize> {
    system: Premultiplied<N>,
    /// Constant generalised force over mass.
    force: [f64; N],
}

impl<const N: usize> Solver<N> {
    /// Prepares a system under a constant force.
    ///
    /// # Panics
    /// If the system does not have `N` coordinates: a programming error.
    pub fn new(system: &System, force: &nalgebra::DVector<f64>) -> Self {
        assert_eq!(system.len(), N, "coordinates");
        let force = std::array::from_fn(|i| force[i] * (1.0 / system.mass[i]));
        Self { system: Premultiplied::new(system), force }
    }

    /// The drive of the solver's own force with the mesh's errors.
    pub fn full_drive(&self) -> Drive<N> {
        Drive { acceleration: self.force, errors: true }
    }

    /// The drive of a constant generalised force alone; zero for the homogeneous equations.
    pub fn force_drive(&self, force: &[f64; N]) -> Drive<N> {
        let acceleration = std::array::from_fn(|i| force[i] / self.system.root_mass[place(i, N)].powi(2));
        Drive { acceleration, errors: false }
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
        let mut expansion = Expansion::<N, f64>::new();
        let mut start =
            Start { q: placed(&state.q), v: placed(&state.v), acceleration: placed(&self.force), errors: 1.0 };
        let mut t = from_s;
        let mut usable = options.longest_step_s;
        let mut scale = self.norm(&self.force);
        let clock = clock_rounding(from_s, to_s);
        while to_s - t > clock {
            let rest = to_s - t;
            let approach = along(&self.system.directions[MESH], &start.q);
            let h = mesh.begin(t, rest.min(1.25 * usable).min(options.longest_step_s), approach, &mut terms);
            let square = expansion.compute(&self.system, &terms, &start, h, options.tolerance * scale);
            scale = scale.max(square.sqrt());
            let limit = expansion.usable_part(options.tolerance * scale);
            if limit <= MIN_USABLE_PART {
                usable = shortened(h, t, options)?;
                continue;
            }
            let mut end = limit.min(1.0);
            usable = limit.min(8.0) * h;
            let mut switch = None;
            if mesh.is_nonlinear() {
                let approach = expansion.series_along(&self.system.directions[MESH]);
                switch = mesh.first_switch(&terms, &approach, end);
                end = switch.map_or(end, |(tau, ..)| tau);
            }
            if !(end * h >= options.shortest_step_s || switch.is_some() || h < options.shortest_step_s) {
                return Err(too_stiff(t, options));
            }
            sink(&Step {
                start_s: t,
                length_s: h,
                end,
                terms: &terms,
                coefficients: expansion.rows().as_flattened(),
                coordinates: N,
            });
            (start.q, start.v) = expansion.state(&self.system, end, h);
            if let Some((_, number, regime)) = switch {
                mesh.switch(number, regime);
                statistics.contact_events += 1;
            }
            statistics.steps += 1;
            statistics.evaluations += (expansion.degree - 1) as u64;
            statistics.breaks += u64::from(limit > 1.0 && h < rest);
            t += end * h;
            finite(&start, t)?;
        }
        *state = State { q: in_order(&start.q), v: in_order(&start.v) };
        Ok(statistics)
    }

    /// Integrates several columns with common steps: what varies with time is set up once for all of them.
    ///
    /// # Errors
    /// As [`Solver::integrate`], and for a mesh with contact loss, whose solutions do not share their breaks.
    pub fn propagate(
        &self,
        mesh: &mut Mesh,
        columns: &mut [Column<N>],
        (from_s, to_s): (f64, f64),
        options: &Options,
    ) -> Result<Statistics> {
        if mesh.is_nonlinear() {
            return Err(Error::impossible("dynamics", "with contact loss solutions cannot share their steps"));
        }
        let mut statistics = Statistics::default();
        let mut terms = Terms::default();
        let mut lanes: Vec<Lanes<N>> = columns.chunks(LANES).map(|columns| self.lanes(columns)).collect();
        let mut t = from_s;
        let mut usable = options.longest_step_s;
        let clock = clock_rounding(from_s, to_s);
        while to_s - t > clock {
            let rest = to_s - t;
            let h = mesh.begin(t, rest.min(1.1 * usable).min(options.longest_step_s), 0.0, &mut terms);
            let mut limit = f64::INFINITY;
            for Lanes { start, expansion, scales } in &mut lanes {
                let tolerance = Several::of(options.tolerance);
                let squares = expansion.compute(&self.system, &terms, start, h, tolerance * *scales);
                scales.0.iter_mut().zip(squares.0).for_each(|(scale, square)| *scale = scale.max(square.sqrt()));
                limit = limit.min(expansion.usable_part(tolerance * *scales));
                statistics.evaluations += (expansion.degree - 1) as u64;
            }
            if limit <= MIN_USABLE_PART {
                usable = shortened(h, t, options)?;
                continue;
            }
            let end = limit.min(1.0);
            usable = limit.min(8.0) * h;
            if end * h < options.shortest_step_s && h >= options.shortest_step_s {
                return Err(too_stiff(t, options));
            }
            t += end * h;
            for Lanes { start, expansion, .. } in &mut lanes {
                (start.q, start.v) = expansion.state(&self.system, end, h);
                finite(start, t)?;
            }
            statistics.steps += 1;
            statistics.breaks += u64::from(limit > 1.0 && h < rest);
        }
        for (columns, Lanes { start, .. }) in columns.chunks_mut(LANES).zip(&lanes) {
            for (l, column) in columns.iter_mut().enumerate() {
                let of = |values: &[Several; N]| in_order(&values.map(|value| value.0[l]));
                column.state = State { q: of(&start.q), v: of(&start.v) };
            }
        }
        Ok(statistics)
    }

    /// At most [`LANES`] columns side by side; what is left over repeats the first one.
    fn lanes(&self, columns: &[Column<N>]) -> Lanes<N> {
        let of: [&Column<N>; LANES] = std::array::from_fn(|l| columns.get(l).unwrap_or(&columns[0]));
        let gather = |value: &dyn Fn(&Column<N>, usize) -> f64| -> [Several; N] {
            placed(&std::array::from_fn(|i| Several(of.map(|column| value(column, i)))))
        };
        Lanes {
            start: Start {
                q: gather(&|column, i| column.state.q[i]),
                v: gather(&|column, i| column.state.v[i]),
                acceleration: gather(&|column, i| column.drive.acceleration[i]),
                errors: Several(of.map(|column| f64::from(u8::from(column.drive.errors)))),
            },
            expansion: Expansion::new(),
            scales: Several(of.map(|column| self.norm(&column.drive.acceleration))),
        }
    }

    /// Mass-weighted norm of an acceleration.
    fn norm(&self, a: &[f64; N]) -> f64 {
        self.system.squared_norm(&placed(a)).sqrt()
    }
}

/// A tenth of a step whose highest terms left the range of numbers, which happens far beyond its usable part only.
fn shortened(h: f64, t: f64, options: &Options) -> Result<f64> {
    if h < options.shortest_step_s { Err(too_stiff(t, options)) } else { Ok(0.1 * h) }
}

/// Rounding of the clock: what is left of an interval below this is none.
fn clock_rounding(from_s: f64, to_s: f64) -> f64 {
    4.0 * f64::EPSILON * from_s.abs().max(to_s.abs()).max(1e-6)
}

fn too_stiff(t: f64, options: &Options) -> Error {
    let what = format!("step below {} s at {t:.6} s: the model is too stiff or unstable", options.shortest_step_s);
    Error::impossible("dynamics", what)
}

fn finite<const N: usize, V: Lane>(start: &Start<N, V>, t: f64) -> Result<()> {
    if start.q.iter().chain(&start.v).all(|x| x.each().iter().all(|x| x.is_finite())) {
        return Ok(());
    }
    Err(Error::impossible("dynamics", format!("the motion is no longer finite at {t:.6} s")))
}
