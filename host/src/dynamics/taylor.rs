//! Taylor series integration of the gear pair: order [`ORDER`], restarted at every contact change.
//!
//! Within a step stiffness, damping, errors and forces are polynomials, so the coefficients of `q` follow
//! from the recurrence `q[n+2] = h^2 a[n] / ((n+1)(n+2))` with
//! `a = M^-1 (f - K0 q - C0 q' - sum out (k*(in.q) + c*(in.q') - g))`: the time-varying part costs scalar
//! convolutions only (reference/simulation-and-correction.md 2.4). The step's own coefficients tell how far
//! it may be used, so only one whose terms overflow is repeated; the polynomial is the dense output. Where a break cuts a
//! step far below that limit the series ends as soon as its terms no longer matter.
//!
//! Shafts and bearings couple few coordinates: their matrices are kept as a diagonal and a short list.
//! Cost: below 1 us per step of 8 coordinates, bound by the latency of the recurrence, so coordinates
//! at rest cost nothing that can be measured. Explicit: the printed damping needs tiny steps.

use super::assembly::System;
use super::mesh::{CHANNELS, MESH, Mesh, Terms};
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
    /// One row per power of the normalised time.
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
        let rows = self.rows();
        let count = rows.len();
        c.iter_mut().zip(rows).for_each(|(c, row)| *c = row[coordinate]);
        Series::from_slice(&c[..count])
    }

    /// Velocity of a coordinate.
    pub fn velocity(&self, coordinate: usize) -> Series {
        self.deflection(coordinate).derivative().scaled(1.0 / self.length_s)
    }

    /// Acceleration of a coordinate.
    pub fn acceleration(&self, coordinate: usize) -> Series {
        let mut c = [0.0; ORDER - 1];
        let scale = 1.0 / (self.length_s * self.length_s);
        let rows = self.rows().skip(2);
        let count = rows.len();
        for (n, (c, row)) in c.iter_mut().zip(rows).enumerate() {
            *c = scale * ((n + 1) * (n + 2)) as f64 * row[coordinate];
        }
        Series::from_slice(&c[..count])
    }

    /// `direction . q`.
    pub fn along(&self, direction: &[f64]) -> Series {
        let mut c = [0.0; LENGTH];
        let rows = self.rows();
        let count = rows.len();
        for (c, row) in c.iter_mut().zip(rows) {
            *c = row.iter().zip(direction).map(|(a, b)| a * b).sum();
        }
        Series::from_slice(&c[..count])
    }

    /// `direction . q` and `direction . q'` at the start.
    pub fn start_along(&self, direction: &[f64]) -> (f64, f64) {
        let along = |row: &[f64]| -> f64 { row.iter().zip(direction).map(|(a, b)| a * b).sum() };
        let (q, v) = self.coefficients.split_at(self.coordinates);
        (along(q), along(&v[..self.coordinates]) / self.length_s)
    }

    /// Deflections and velocities of all coordinates at `tau`.
    pub fn state(&self, tau: f64, deflection: &mut [f64], velocity: &mut [f64]) {
        deflection.fill(0.0);
        velocity.fill(0.0);
        for row in self.rows().rev() {
            for ((q, v), c) in deflection.iter_mut().zip(velocity.iter_mut()).zip(row) {
                *v = *v * tau + *q;
                *q = *q * tau + c;
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

/// An element off the diagonal, premultiplied by the inverse mass.
#[derive(Debug, Clone, Copy)]
struct Coupling {
    row: usize,
    column: usize,
    stiffness: f64,
    damping: f64,
}

/// Working memory of one expansion.
struct Scratch<const N: usize> {
    /// Coefficients of the deflections, one row per power.
    table: [[f64; N]; LENGTH],
    /// Coefficients of each channel's measured deflection and rate.
    d: [[f64; LENGTH]; CHANNELS],
    w: [[f64; LENGTH]; CHANNELS],
    /// Highest power computed.
    degree: usize,
    /// Mass-weighted norms of the last two acceleration coefficients, the last first.
    last: [f64; 2],
}

impl<const N: usize> Default for Scratch<N> {
    fn default() -> Self {
        let d = [[0.0; LENGTH]; CHANNELS];
        Self { table: [[0.0; N]; LENGTH], d, w: d, degree: ORDER, last: [0.0; 2] }
    }
}

/// The system with everything premultiplied by the inverse mass.
pub struct Solver<const N: usize> {
    stiffness: [f64; N],
    damping: [f64; N],
    /// Elements that couple a coordinate with its neighbour `i ^ 1`: motor and pinion, gear and load.
    neighbour_stiffness: [f64; N],
    neighbour_damping: [f64; N],
    /// All others: casing, modal damping.
    couplings: Vec<Coupling>,
    force: [f64; N],
    directions: Vec<[f64; N]>,
    outputs: Vec<[f64; N]>,
    root_mass: [f64; N],
}

/// `1 / ((n + 1) (n + 2))`.
const TWICE_INTEGRATED: [f64; LENGTH] = {
    let mut table = [0.0; LENGTH];
    let mut n = 0;
    while n < LENGTH {
        table[n] = 1.0 / ((n + 1) * (n + 2)) as f64;
        n += 1;
    }
    table
};
/// Share of the allowed truncation error below which further terms of a short step are left out.
const NEGLIGIBLE: f64 = 1e-2;
/// A usable part that no finite terms lead to.
const OVERFLOWED: f64 = 1e-20;
/// Fewest powers of a series.
const LEAST: usize = 4;

impl<const N: usize> Solver<N> {
    /// Prepares a system under a constant force.
    ///
    /// # Panics
    /// If the system does not have `N` coordinates: a programming error.
    pub fn new(system: &System, force: &nalgebra::DVector<f64>) -> Self {
        assert_eq!(system.len(), N, "coordinates");
        let inverse: [f64; N] = std::array::from_fn(|i| 1.0 / system.mass[i]);
        let directions = Mesh::directions::<N>(system);
        let outputs = directions.iter().map(|d| std::array::from_fn(|i| d[i] * inverse[i])).collect();
        let mut couplings = Vec::new();
        for (row, column) in (0..N).flat_map(|i| (0..N).map(move |j| (i, j))).filter(|(i, j)| i != j && *j != i ^ 1) {
            let (stiffness, damping) = (system.stiffness[(row, column)], system.damping[(row, column)]);
            if stiffness != 0.0 || damping != 0.0 {
                let (stiffness, damping) = (inverse[row] * stiffness, inverse[row] * damping);
                couplings.push(Coupling { row, column, stiffness, damping });
            }
        }
        let neighbour = |m: &nalgebra::DMatrix<f64>| {
            std::array::from_fn(|i| if i ^ 1 < N { inverse[i] * m[(i, i ^ 1)] } else { 0.0 })
        };
        Self {
            stiffness: std::array::from_fn(|i| inverse[i] * system.stiffness[(i, i)]),
            damping: std::array::from_fn(|i| inverse[i] * system.damping[(i, i)]),
            neighbour_stiffness: neighbour(&system.stiffness),
            neighbour_damping: neighbour(&system.damping),
            couplings,
            force: std::array::from_fn(|i| inverse[i] * force[i]),
            directions,
            outputs,
            root_mass: std::array::from_fn(|i| system.mass[i].sqrt()),
        }
    }

    /// The drive of the solver's own force with the mesh's errors.
    pub fn full_drive(&self) -> Drive<N> {
        Drive { acceleration: self.force, errors: true }
    }

    /// The drive of a constant generalised force alone; zero for the homogeneous equations.
    pub fn force_drive(&self, force: &[f64; N]) -> Drive<N> {
        let acceleration = std::array::from_fn(|i| force[i] / (self.root_mass[i] * self.root_mass[i]));
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
        let mut scratch = Scratch::<N>::default();
        let drive = self.full_drive();
        let mut t = from_s;
        let mut usable = options.longest_step_s;
        let mut scale = self.norm(&self.force);
        let clock = clock_rounding(from_s, to_s);
        while to_s - t > clock {
            let rest = to_s - t;
            let approach = dot(&self.directions[MESH], &state.q);
            let h = mesh.begin(t, rest.min(1.25 * usable).min(options.longest_step_s), approach, &mut terms);
            scale = scale.max(self.expand(&terms, state, h, &drive, options.tolerance * scale, &mut scratch));
            let limit = usable_part(&scratch, options.tolerance * scale);
            if limit <= OVERFLOWED {
                usable = shortened(h, t, options)?;
                continue;
            }
            let mut end = limit.min(1.0);
            usable = limit.min(8.0) * h;
            let mut switch = None;
            if mesh.is_nonlinear() {
                let approach = series_along(&scratch, &self.directions[MESH]);
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
                coefficients: scratch.table[..=scratch.degree].as_flattened(),
                coordinates: N,
            });
            advance(&scratch, end, h, state);
            if let Some((_, number, regime)) = switch {
                mesh.switch(number, regime);
                statistics.contact_events += 1;
            }
            statistics.steps += 1;
            statistics.evaluations += (scratch.degree - 1) as u64;
            statistics.breaks += u64::from(limit > 1.0 && h < rest);
            t += end * h;
            finite(state, t)?;
        }
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
        let mut scratches: Vec<Scratch<N>> = columns.iter().map(|_| Scratch::default()).collect();
        let mut scales: Vec<f64> = columns.iter().map(|c| self.norm(&c.drive.acceleration)).collect();
        let mut t = from_s;
        let mut usable = options.longest_step_s;
        let clock = clock_rounding(from_s, to_s);
        while to_s - t > clock {
            let rest = to_s - t;
            let h = mesh.begin(t, rest.min(1.1 * usable).min(options.longest_step_s), 0.0, &mut terms);
            let mut limit = f64::INFINITY;
            for ((column, scratch), scale) in columns.iter().zip(&mut scratches).zip(&mut scales) {
                let enough = options.tolerance * *scale;
                *scale = scale.max(self.expand(&terms, &column.state, h, &column.drive, enough, scratch));
                limit = limit.min(usable_part(scratch, options.tolerance * *scale));
                statistics.evaluations += (scratch.degree - 1) as u64;
            }
            if limit <= OVERFLOWED {
                usable = shortened(h, t, options)?;
                continue;
            }
            let end = limit.min(1.0);
            usable = limit.min(8.0) * h;
            if end * h < options.shortest_step_s && h >= options.shortest_step_s {
                return Err(too_stiff(t, options));
            }
            t += end * h;
            for (column, scratch) in columns.iter_mut().zip(&scratches) {
                advance(scratch, end, h, &mut column.state);
                finite(&column.state, t)?;
            }
            statistics.steps += 1;
            statistics.breaks += u64::from(limit > 1.0 && h < rest);
        }
        Ok(statistics)
    }

    /// Taylor coefficients of the deflections from a state; gives the norm of the acceleration at the start.
    ///
    /// Ends early once two acceleration terms in a row are negligible beside `allowed`.
    fn expand(
        &self,
        terms: &Terms,
        state: &State<N>,
        h: f64,
        drive: &Drive<N>,
        allowed: f64,
        scratch: &mut Scratch<N>,
    ) -> f64 {
        let Scratch { table, d, w, degree, last } = scratch;
        let channels = terms.channels();
        let square = h * h;
        let per_h = 1.0 / h;
        let enough = (NEGLIGIBLE * allowed).powi(2);
        table[0] = state.q;
        table[1] = state.v.map(|v| v * h);
        for (channel, d) in channels.iter().zip(d.iter_mut()) {
            d[0] = dot(&self.directions[channel.input], &table[0]);
        }
        let mut start = 0.0;
        let mut squares = [0.0; 2];
        for n in 0..=ORDER - 2 {
            let (q, next) = (table[n], table[n + 1]);
            let rate = (n + 1) as f64 * per_h;
            let mut a: [f64; N] = if n == 0 { drive.acceleration } else { [0.0; N] };
            for i in 0..N {
                let j = (i ^ 1).min(N - 1);
                a[i] -= self.stiffness[i] * q[i] + self.damping[i] * (rate * next[i]);
                a[i] -= self.neighbour_stiffness[i] * q[j] + self.neighbour_damping[i] * (rate * next[j]);
            }
            for c in &self.couplings {
                a[c.row] -= c.stiffness * q[c.column] + c.damping * (rate * next[c.column]);
            }
            for ((channel, d), w) in channels.iter().zip(d.iter_mut()).zip(w.iter_mut()) {
                d[n + 1] = dot(&self.directions[channel.input], &next);
                w[n] = rate * d[n + 1];
                let mut force = convolution(&channel.k, d, n) + convolution(&channel.c, w, n);
                if drive.errors {
                    force -= channel.g.coefficient(n);
                }
                let output = &self.outputs[channel.output];
                for i in 0..N {
                    a[i] -= force * output[i];
                }
            }
            if drive.errors {
                for (direction, series) in &terms.forces {
                    let value = series.coefficient(n);
                    for (a, o) in a.iter_mut().zip(&self.outputs[*direction]) {
                        *a += value * o;
                    }
                }
            }
            let factor = square * TWICE_INTEGRATED[n];
            table[n + 2] = a.map(|a| a * factor);
            *degree = n + 2;
            let square = self.squared_norm(&a);
            if n == 0 {
                start = square;
            }
            squares = [square, squares[0]];
            if n >= LEAST && squares[0] < enough && squares[1] < enough {
                break;
            }
        }
        *last = squares.map(f64::sqrt);
        start.sqrt()
    }

    /// Mass-weighted norm of an acceleration.
    fn norm(&self, a: &[f64; N]) -> f64 {
        self.squared_norm(a).sqrt()
    }

    #[inline(always)]
    fn squared_norm(&self, a: &[f64; N]) -> f64 {
        let weighted: [f64; N] = std::array::from_fn(|i| a[i] * self.root_mass[i]);
        dot(&weighted, &weighted)
    }
}

/// Part of the step's unit within which the last acceleration terms stay below `limit`.
fn usable_part<const N: usize>(scratch: &Scratch<N>, limit: f64) -> f64 {
    let n = (scratch.degree - 2) as f64;
    let part = |last: f64, power: f64| match last {
        0.0 => f64::INFINITY,
        last if last.is_finite() => (limit / last).powf(1.0 / power),
        _ => 0.0,
    };
    part(scratch.last[0], n).min(part(scratch.last[1], n - 1.0))
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

fn finite<const N: usize>(state: &State<N>, t: f64) -> Result<()> {
    if state.q.iter().chain(&state.v).all(|x| x.is_finite()) {
        return Ok(());
    }
    Err(Error::impossible("dynamics", format!("the motion is no longer finite at {t:.6} s")))
}

/// `sum s_j x_{n-j}`.
#[inline(always)]
fn convolution(s: &Series, x: &[f64; LENGTH], n: usize) -> f64 {
    let s = s.coefficients();
    if let [constant] = s {
        return constant * x[n];
    }
    let used = s.len().min(n + 1);
    s[..used].iter().zip(x[..=n].iter().rev()).map(|(s, x)| s * x).sum()
}

/// Scalar product with four partial sums: the sum's latency bounds the recurrence.
#[inline(always)]
fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    let mut sums = [0.0; 4];
    for i in 0..N {
        sums[i % 4] += a[i] * b[i];
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

fn series_along<const N: usize>(scratch: &Scratch<N>, direction: &[f64; N]) -> Series {
    let mut c = [0.0; LENGTH];
    for (c, row) in c.iter_mut().zip(&scratch.table[..=scratch.degree]) {
        *c = dot(row, direction);
    }
    Series::from_slice(&c[..=scratch.degree])
}

/// State at `end` of the step.
fn advance<const N: usize>(scratch: &Scratch<N>, end: f64, h: f64, state: &mut State<N>) {
    let (mut q, mut v) = ([0.0; N], [0.0; N]);
    for row in scratch.table[..=scratch.degree].iter().rev() {
        for i in 0..N {
            v[i] = v[i] * end + q[i];
            q[i] = q[i] * end + row[i];
        }
    }
    state.q = q;
    state.v = v.map(|v| v / h);
}
