//! Taylor coefficients of all coordinates over one step.
//!
//! `q[n+2] = h^2 a[n] / ((n+1)(n+2))` with `a = M^-1 (f - K q - C q' - sum d F)`. Each mesh measures
//! `u = d.q + T d.q'` along its direction, so that its force is one convolution of its stiffness with `u` less the
//! force of its errors. Matrices are kept as a diagonal and a list; a mesh touches six coordinates. Cost: about
//! `6 n + (4 l + 2 m (12 + p))` operations per order for `n` coordinates, `l` couplings and `m` meshes of degree `p`.

use crate::assembly::System;
use crate::terms::Terms;
use meshband_mechanics::dynamics::Series;
use meshband_mechanics::dynamics::series::{LENGTH, ORDER};

/// Share of the allowed truncation error below which further terms of a short step are left out.
const NEGLIGIBLE_ERROR_SHARE: f64 = 1e-2;
/// Share of the diagonal below which an element beside it is rounding.
const ROUNDING_SHARE: f64 = 1e-14;
/// Fewest powers of a series.
const MIN_POWERS: usize = 4;

/// An element off the diagonal over the negative mass.
struct Coupling {
    row: usize,
    column: usize,
    stiffness: f64,
    damping: f64,
}

/// A mesh's direction, and what its unit force accelerates.
struct Direction {
    at: [usize; 2],
    seen: [[f64; 3]; 2],
    moved: [[f64; 3]; 2],
    damping_s: f64,
}

/// Scalar product in four sums: a single one would wait for itself.
fn product(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (a_parts, b_parts) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = a_parts.remainder().iter().zip(b_parts.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a_parts.zip(b_parts) {
        for i in 0..4 {
            sums[i] += a[i] * b[i];
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

/// A system over its masses, and the coefficients of the present step.
pub(crate) struct Expansion {
    n: usize,
    stiffness: Vec<f64>,
    damping: Vec<f64>,
    couplings: Vec<Coupling>,
    directions: Vec<Direction>,
    root_mass: Vec<f64>,
    /// Acceleration by the constant load.
    load: Vec<f64>,
    /// Acceleration per unit angular acceleration of shaft 0.
    inertial: Vec<f64>,
    /// One row per power.
    rows: Vec<f64>,
    /// What each mesh measures, newest first from the end: `measured[LENGTH - 1 - n]`.
    measured: Vec<[f64; LENGTH]>,
    /// Mesh forces, N.
    forces: Vec<[f64; LENGTH]>,
    a: Vec<f64>,
    v: Vec<f64>,
    /// Highest power in use.
    pub degree: usize,
    last: [f64; 2],
}

impl Expansion {
    /// Of a system under a load, N m.
    pub fn new(system: &System, load_torque_n_m: f64) -> Self {
        let n = system.len();
        let over = |value: f64, i: usize| value / system.mass[i];
        let mut couplings = Vec::new();
        for (row, column) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))).filter(|(i, j)| i != j) {
            let (stiffness, damping) = (system.stiffness[(row, column)], system.damping[(row, column)]);
            // What planets around a carrier leave of one another is rounding.
            let share = |m: &nalgebra::DMatrix<f64>| {
                m[(row, column)].abs() / m[(row, row)].abs().max(m[(column, column)].abs())
            };
            if share(&system.stiffness) > ROUNDING_SHARE || share(&system.damping) > ROUNDING_SHARE {
                let (stiffness, damping) = (-over(stiffness, row), -over(damping, row));
                couplings.push(Coupling { row, column, stiffness, damping });
            }
        }
        let directions = system.meshes.iter().map(|mesh| {
            let at = mesh.bodies.map(|body| system.bodies[body].at);
            let moved = |side: usize| std::array::from_fn(|i| over(mesh.directions[side][i], at[side] + i));
            Direction { at, seen: mesh.directions, moved: [moved(0), moved(1)], damping_s: mesh.damping_s }
        });
        let directions: Vec<Direction> = directions.collect();
        // The drive supplies what speeds the whole train up.
        let whole: f64 = (0..n).map(|i| system.mass[i] * system.rigid[i] * system.rigid[i]).sum();
        let driven = |i: usize| if i == 0 { over(whole, 0) } else { 0.0 };
        Self {
            n,
            stiffness: (0..n).map(|i| -over(system.stiffness[(i, i)], i)).collect(),
            damping: (0..n).map(|i| -over(system.damping[(i, i)], i)).collect(),
            couplings,
            root_mass: system.mass.iter().map(|mass| mass.sqrt()).collect(),
            load: (0..n).map(|i| over(load_torque_n_m * system.force_per_load[i], i)).collect(),
            inertial: (0..n).map(|i| driven(i) - system.rigid[i]).collect(),
            rows: vec![0.0; n * LENGTH],
            measured: vec![[0.0; LENGTH]; directions.len()],
            forces: vec![[0.0; LENGTH]; directions.len()],
            directions,
            a: vec![0.0; n],
            v: vec![0.0; n],
            degree: ORDER,
            last: [0.0; 2],
        }
    }

    /// Mass-weighted norm of the acceleration by the load.
    pub fn load_norm(&self) -> f64 {
        self.load.iter().zip(&self.root_mass).map(|(a, m)| (a * m) * (a * m)).sum::<f64>().sqrt()
    }

    /// Computes the coefficients from a state over a step of `h`; gives the norm of the acceleration at its start.
    ///
    /// Ends early once two terms in a row are negligible beside `allowed`.
    pub fn compute(&mut self, terms: &Terms, [q, v]: [&[f64]; 2], h: f64, allowed: f64) -> f64 {
        let n = self.n;
        let enough = (allowed * NEGLIGIBLE_ERROR_SHARE).powi(2);
        self.rows[..n].copy_from_slice(q);
        self.rows[n..2 * n].iter_mut().zip(v).for_each(|(row, v)| *row = h * v);
        self.v.copy_from_slice(v);
        let mut first = 0.0;
        let mut squares = [0.0; 2];
        for order in 0..=ORDER - 2 {
            self.elastic(order, terms);
            self.push_meshes(order, terms);
            if order == 0 {
                first = self.square();
            } else if order % 4 >= 2 || order + 4 > ORDER {
                squares = [self.square(), squares[0]];
            }
            let (once, both) = (h / (order + 1) as f64, ((order + 1) * (order + 2)) as f64);
            let twice = h * h / both;
            let row = &mut self.rows[(order + 2) * n..(order + 3) * n];
            for ((row, v), a) in row.iter_mut().zip(&mut self.v).zip(&self.a) {
                *row = twice * a;
                *v = once * a;
            }
            self.degree = order + 2;
            if order % 4 == 3 && order > MIN_POWERS && squares.iter().all(|square| *square < enough) {
                break;
            }
        }
        self.last = squares;
        first.sqrt()
    }

    /// Acceleration of this order by constant matrices, load and change of speed.
    fn elastic(&mut self, order: usize, terms: &Terms) {
        let q = &self.rows[order * self.n..(order + 1) * self.n];
        for ((((a, q), v), stiffness), damping) in
            self.a.iter_mut().zip(q).zip(&self.v).zip(&self.stiffness).zip(&self.damping)
        {
            *a = stiffness * q + damping * v;
        }
        for c in &self.couplings {
            self.a[c.row] += c.stiffness * q[c.column] + c.damping * self.v[c.column];
        }
        if order == 0 {
            self.a.iter_mut().zip(&self.load).for_each(|(a, load)| *a += load);
        }
        if let Some(&acceleration) = terms.acceleration.get(order) {
            self.a.iter_mut().zip(&self.inertial).for_each(|(a, inertial)| *a += acceleration * inertial);
        }
    }

    /// Adds what the meshes' forces of this order accelerate.
    fn push_meshes(&mut self, order: usize, terms: &Terms) {
        let q = &self.rows[order * self.n..(order + 1) * self.n];
        for (index, direction) in self.directions.iter().enumerate() {
            let term = &terms.meshes[index];
            let mut u = 0.0;
            for (at, seen) in direction.at.iter().zip(&direction.seen) {
                let (q, v) = (&q[*at..at + 3], &self.v[*at..at + 3]);
                for i in 0..3 {
                    u += seen[i] * (q[i] + direction.damping_s * v[i]);
                }
            }
            let measured = &mut self.measured[index];
            let newest = LENGTH - 1 - order;
            measured[newest] = u;
            let used = term.k.len().min(order + 1);
            let mut force = product(&term.k[..used], &measured[newest..newest + used]);
            force -= term.g.get(order).copied().unwrap_or(0.0);
            self.forces[index][order] = force;
            for (at, moved) in direction.at.iter().zip(&direction.moved) {
                let a = &mut self.a[*at..at + 3];
                for i in 0..3 {
                    a[i] -= moved[i] * force;
                }
            }
        }
    }

    /// Squared mass-weighted norm of the present acceleration.
    fn square(&self) -> f64 {
        self.a.iter().zip(&self.root_mass).map(|(a, m)| (a * m) * (a * m)).sum()
    }

    /// Part of the step within which the last acceleration terms stay below `limit`.
    pub fn usable_part(&self, limit: f64) -> f64 {
        let n = (self.degree - 2) as f64;
        let part = |square: f64, power: f64| match square {
            0.0 => f64::INFINITY,
            square if square.is_finite() => (square / (limit * limit)).powf(-0.5 / power),
            _ => 0.0,
        };
        part(self.last[0], n).min(part(self.last[1], n - 1.0))
    }

    /// Deflections and velocities at `end` of a step of `h`.
    pub fn state(&self, end: f64, h: f64, q: &mut [f64], v: &mut [f64]) {
        q.fill(0.0);
        v.fill(0.0);
        for row in self.rows[..(self.degree + 1) * self.n].chunks_exact(self.n).rev() {
            for ((q, v), c) in q.iter_mut().zip(v.iter_mut()).zip(row) {
                *v = *v * end + *q;
                *q = *q * end + c;
            }
        }
        v.iter_mut().for_each(|v| *v /= h);
    }

    /// Deflection of a coordinate.
    pub fn deflection(&self, coordinate: usize) -> Series {
        let mut c = [0.0; LENGTH];
        let used = self.degree + 1;
        c[..used].iter_mut().enumerate().for_each(|(n, c)| *c = self.rows[n * self.n + coordinate]);
        Series::from_slice(&c[..used])
    }

    /// Force of a mesh at the start, N.
    pub fn first_force(&self, mesh: usize) -> f64 {
        self.forces[mesh][0]
    }

    /// Force of a mesh, N.
    pub fn force(&self, mesh: usize) -> Series {
        Series::from_slice(&self.forces[mesh][..self.degree - 1])
    }
}
