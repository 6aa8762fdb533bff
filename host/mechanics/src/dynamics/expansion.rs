//! Taylor coefficients of one step, for one solution or for several side by side.
//!
//! `q[n+2] = h^2 a[n] / ((n+1)(n+2))` with `a = M^-1 (f - K0 q - C0 q' - sum out (k*(in.q) + c*(in.q') - g))`: what
//! varies with time costs scalar convolutions only. What a channel measures, `in.q`, has a recurrence of its own,
//! `(in.q)[n+2] = h^2/((n+1)(n+2)) (in.b - sum (in.out) force)` with `b` what the constant matrices give: its scalar
//! product does not wait for the force, which halves the chain of dependent operations that bounds one solution
//! (about 24 cycles per order). Several solutions in lanes are bound by the arithmetic units.
//!
//! Shafts and bearings couple few coordinates: their matrices are kept as a diagonal, the neighbour and a short list.
//! Inside, coordinates of even number come first, then those of odd number, so that neighbours are two rows of equal
//! length and the compiler needs no shuffles ([`place`]).

use super::assembly::System;
use super::mesh::{CHANNELS, Mesh, Terms};
use super::series::{LENGTH, ORDER, Series};
use crate::lanes::Lane;

/// `1 / (n + 1)` and `1 / ((n + 1) (n + 2))`: an order's acceleration integrated once and twice.
const INTEGRATION_FACTORS: [[f64; 2]; LENGTH] = {
    let mut table = [[0.0; 2]; LENGTH];
    let mut n = 0;
    while n < LENGTH {
        table[n] = [1.0 / (n + 1) as f64, 1.0 / ((n + 1) * (n + 2)) as f64];
        n += 1;
    }
    table
};
/// Share of the allowed truncation error below which further terms of a short step are left out.
const NEGLIGIBLE_ERROR_SHARE: f64 = 1e-2;
/// Fewest powers of a series.
const MIN_POWERS: usize = 4;

/// An element off the diagonal, premultiplied by the negative inverse mass.
#[derive(Debug, Clone, Copy)]
struct Coupling {
    row: usize,
    column: usize,
    stiffness: f64,
    damping: f64,
}

/// A system with everything premultiplied by the inverse mass, stiffness and damping by its negative, coordinates at
/// their [`place`].
pub(super) struct Premultiplied<const N: usize> {
    stiffness: [f64; N],
    damping: [f64; N],
    /// Elements that couple a coordinate with its neighbour `i ^ 1`: motor and pinion, gear and load.
    neighbour_stiffness: [f64; N],
    neighbour_damping: [f64; N],
    /// All others: casing, modal damping.
    couplings: Vec<Coupling>,
    /// Where channels measure.
    pub directions: Vec<[f64; N]>,
    /// Where channels act.
    outputs: Vec<[f64; N]>,
    /// What a direction (row) sees of a unit force on an output (column).
    seen: Vec<Vec<f64>>,
    pub root_mass: [f64; N],
    /// What the processor has; the results do not depend on it, because sums and products are not fused.
    units: pulp::Arch,
}

impl<const N: usize> Premultiplied<N> {
    pub fn new(system: &System) -> Self {
        assert!(N.is_multiple_of(2), "coordinates come in pairs");
        let coordinate = in_order_of::<N>();
        let mass: [f64; N] = coordinate.map(|i| system.mass[i]);
        let directions: Vec<[f64; N]> = Mesh::directions::<N>(system).iter().map(placed).collect();
        let outputs: Vec<[f64; N]> =
            directions.iter().map(|d| std::array::from_fn(|i| d[i] * (1.0 / mass[i]))).collect();
        let mut couplings = Vec::new();
        for (row, column) in (0..N).flat_map(|i| (0..N).map(move |j| (i, j))).filter(|(i, j)| i != j && *j != i ^ 1) {
            let (stiffness, damping) = (system.stiffness[(row, column)], system.damping[(row, column)]);
            if stiffness != 0.0 || damping != 0.0 {
                let inverse = -1.0 / system.mass[row];
                let (stiffness, damping) = (inverse * stiffness, inverse * damping);
                couplings.push(Coupling { row: place(row, N), column: place(column, N), stiffness, damping });
            }
        }
        let premultiplied =
            |m: &nalgebra::DMatrix<f64>, other: usize| coordinate.map(|i| -m[(i, i ^ other)] / system.mass[i]);
        Self {
            stiffness: premultiplied(&system.stiffness, 0),
            damping: premultiplied(&system.damping, 0),
            neighbour_stiffness: premultiplied(&system.stiffness, 1),
            neighbour_damping: premultiplied(&system.damping, 1),
            couplings,
            seen: directions.iter().map(|d| outputs.iter().map(|o| along(d, o)).collect()).collect(),
            directions,
            outputs,
            root_mass: mass.map(f64::sqrt),
            units: pulp::Arch::new(),
        }
    }

    /// What the constant matrices give of one order's deflections and velocities.
    #[inline(always)]
    fn elastic<V: Lane>(&self, q: &[V; N], v: &[V; N], a: &mut [V; N]) {
        let half = N / 2;
        for i in 0..half {
            a[i] = self.row(i, (q[i], q[i + half]), (v[i], v[i + half]));
        }
        for i in half..N {
            a[i] = self.row(i, (q[i], q[i - half]), (v[i], v[i - half]));
        }
        let given = |c: &Coupling| V::of(c.stiffness) * q[c.column] + V::of(c.damping) * v[c.column];
        if V::IN_REGISTERS {
            if self.couplings.is_empty() {
                return;
            }
            // Rows known at run time only would force `a` into memory: they get an array of their own.
            let mut coupled = [V::of(0.0); N];
            self.couplings.iter().for_each(|c| coupled[c.row] = coupled[c.row] + given(c));
            a.iter_mut().zip(&coupled).for_each(|(a, coupled)| *a = *a + *coupled);
        } else {
            self.couplings.iter().for_each(|c| a[c.row] = a[c.row] + given(c));
        }
    }

    #[inline(always)]
    fn row<V: Lane>(&self, i: usize, q: (V, V), v: (V, V)) -> V {
        let own = V::of(self.stiffness[i]) * q.0 + V::of(self.damping[i]) * v.0;
        let neighbour = V::of(self.neighbour_stiffness[i]) * q.1 + V::of(self.neighbour_damping[i]) * v.1;
        own + neighbour
    }

    /// Squared mass-weighted norm.
    #[inline(always)]
    pub fn squared_norm<V: Lane>(&self, a: &[V; N]) -> V {
        let mut sums = [V::of(0.0); 4];
        for i in 0..N {
            let weighted = a[i] * V::of(self.root_mass[i]);
            sums[i % 4] = sums[i % 4] + weighted * weighted;
        }
        (sums[0] + sums[1]) + (sums[2] + sums[3])
    }
}

/// Where a step starts, and what drives the solutions; coordinates at their [`place`].
#[derive(Clone, Copy)]
pub(super) struct Start<const N: usize, V> {
    pub q: [V; N],
    pub v: [V; N],
    /// Constant generalised force over mass.
    pub acceleration: [V; N],
    /// 1 where errors and external forces of the mesh act, 0 where not.
    pub errors: V,
}

/// Coefficients of one step.
pub(super) struct Expansion<const N: usize, V> {
    /// Of the deflections, one row per power.
    table: Box<[[V; N]; LENGTH]>,
    /// Of each channel's measured deflection and rate.
    d: Vec<[V; LENGTH]>,
    w: Vec<[V; LENGTH]>,
    /// Highest power computed.
    pub degree: usize,
    /// Mass-weighted norms of the last two acceleration coefficients, squared, the last first.
    last: [V; 2],
}

impl<const N: usize, V: Lane> Expansion<N, V> {
    pub fn new() -> Self {
        let zero = V::of(0.0);
        Self { table: Box::new([[zero; N]; LENGTH]), d: Vec::new(), w: Vec::new(), degree: ORDER, last: [zero; 2] }
    }

    /// Computes the coefficients over a step of unit `h`; gives the squared norms of the acceleration at the start.
    ///
    /// Ends early once two acceleration terms in a row are negligible beside `allowed`.
    pub fn compute(&mut self, system: &Premultiplied<N>, terms: &Terms, start: &Start<N, V>, h: f64, allowed: V) -> V {
        system.units.dispatch(Computation { expansion: self, system, terms, start, h, allowed })
    }

    /// [`Expansion::compute`] of at most `C` channels, of just one where `C` is one.
    #[inline(always)]
    fn compute_of<const C: usize>(
        &mut self,
        system: &Premultiplied<N>,
        terms: &Terms,
        start: &Start<N, V>,
        h: f64,
        allowed: V,
    ) -> V {
        let Self { table, d, w, degree, last } = self;
        let channels = terms.channels();
        let used = if C == 1 { 1 } else { channels.len().min(C) };
        for series in [&mut *d, &mut *w] {
            series.resize(used, [V::of(0.0); LENGTH]);
        }
        let square = h * h;
        let enough = allowed * V::of(NEGLIGIBLE_ERROR_SHARE);
        let enough = enough * enough;
        let disturbed = start.errors.each().iter().any(|&errors| errors != 0.0);
        table[0] = start.q;
        table[1] = start.v.map(|v| v * V::of(h));
        // Coefficients of the velocities, which are integrated once instead of being derived from the deflections.
        let mut v = start.v;
        // The newest coefficients of what each channel measures, deflection and velocity.
        let (mut newest, mut newest_rate) = ([V::of(0.0); C], [V::of(0.0); C]);
        let inputs: [&[f64; N]; C] = std::array::from_fn(|i| &system.directions[channels[i.min(used - 1)].input]);
        let outputs: [&[f64; N]; C] = std::array::from_fn(|i| &system.outputs[channels[i.min(used - 1)].output]);
        for i in 0..used {
            d[i][0] = along(inputs[i], &table[0]);
            newest[i] = along(inputs[i], &table[1]);
            newest_rate[i] = along(inputs[i], &v);
        }
        let mut first = V::of(0.0);
        // Of two neighbouring orders in four, and of the last two.
        let mut squares = [V::of(0.0); 2];
        for n in 0..=ORDER - 2 {
            let once = V::of(h * INTEGRATION_FACTORS[n][0]);
            let twice = V::of(square * INTEGRATION_FACTORS[n][1]);
            let (done, rest) = table.split_at_mut(n + 2);
            let mut a = [V::of(0.0); N];
            system.elastic(&done[n], &v, &mut a);
            if n == 0 {
                a.iter_mut().zip(&start.acceleration).for_each(|(a, start)| *a = *a + *start);
            }
            if disturbed {
                for (direction, series) in &terms.forces {
                    let value = start.errors * V::of(series.coefficient(n));
                    let output = &system.outputs[*direction];
                    a.iter_mut().zip(output).for_each(|(a, &output)| *a = *a + value * V::of(output));
                }
            }
            let mut forces = [V::of(0.0); C];
            for i in 0..used {
                let channel = &channels[i];
                let mut known = V::of(channel.k.coefficient(0)) * d[i][n] + older(&channel.k, &d[i], n);
                known = known + older(&channel.c, &w[i], n);
                if disturbed {
                    known = known - start.errors * V::of(channel.g.coefficient(n));
                }
                forces[i] = known + V::of(channel.c.coefficient(0)) * newest_rate[i];
                w[i][n] = newest_rate[i];
                d[i][n + 1] = newest[i];
            }
            for i in 0..used {
                let seen = &system.seen[channels[i].input];
                let mut sum = along(inputs[i], &a);
                for j in 0..used {
                    sum = sum - V::of(seen[channels[j].output]) * forces[j];
                }
                newest[i] = twice * sum;
                newest_rate[i] = once * sum;
            }
            for i in 0..used {
                a.iter_mut().zip(outputs[i]).for_each(|(a, &output)| *a = *a - forces[i] * V::of(output));
            }
            if n == 0 {
                first = system.squared_norm(&a);
            } else if n % 4 >= 2 || n + 4 > ORDER {
                squares = [system.squared_norm(&a), squares[0]];
            }
            for i in 0..N {
                rest[0][i] = twice * a[i];
                v[i] = once * a[i];
            }
            *degree = n + 2;
            let small = |square: &V| square.each().iter().zip(enough.each()).all(|(square, enough)| square < enough);
            if n % 4 == 3 && n > MIN_POWERS && squares.iter().all(small) {
                break;
            }
        }
        *last = squares;
        first
    }

    /// Part of the step's unit within which every solution's last acceleration terms stay below its limit.
    pub fn usable_part(&self, limits: V) -> f64 {
        let n = (self.degree - 2) as f64;
        // The largest share of the limit's square that a solution's term takes; not a number counts as infinite.
        let largest = |squares: &V| {
            let shares = squares.each().iter().zip(limits.each()).map(|(square, limit)| match square {
                0.0 => 0.0,
                square if square.is_finite() => square / (limit * limit),
                _ => f64::INFINITY,
            });
            shares.fold(0.0, f64::max)
        };
        let part = |share: f64, power: f64| if share == 0.0 { f64::INFINITY } else { share.powf(-0.5 / power) };
        part(largest(&self.last[0]), n).min(part(largest(&self.last[1]), n - 1.0))
    }

    /// The coefficients in use, powers ascending, coordinates at their [`place`].
    pub fn rows(&self) -> &[[V; N]] {
        &self.table[..=self.degree]
    }

    /// Deflections and velocities at `end` of the step.
    pub fn state(&self, system: &Premultiplied<N>, end: f64, h: f64) -> ([V; N], [V; N]) {
        system.units.dispatch(StateAt { rows: self.rows(), end, h })
    }
}

/// [`Expansion::state`] for the dispatch.
struct StateAt<'a, const N: usize, V> {
    rows: &'a [[V; N]],
    end: f64,
    h: f64,
}

impl<const N: usize, V: Lane> pulp::WithSimd for StateAt<'_, N, V> {
    type Output = ([V; N], [V; N]);

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> Self::Output {
        let zero = [V::of(0.0); N];
        // Even and odd powers by themselves, with their derivatives for the square: two chains of dependent
        // operations, each half as long.
        let (mut even, mut even_rate, mut odd, mut odd_rate) = (zero, zero, zero, zero);
        let square = V::of(self.end * self.end);
        let (pairs, rest) = self.rows.as_chunks::<2>();
        if let [highest] = rest {
            even = *highest;
        }
        for [lower, upper] in pairs.iter().rev() {
            for i in 0..N {
                even_rate[i] = even_rate[i] * square + even[i];
                even[i] = even[i] * square + lower[i];
                odd_rate[i] = odd_rate[i] * square + odd[i];
                odd[i] = odd[i] * square + upper[i];
            }
        }
        let (end, twice, per_h) = (V::of(self.end), V::of(2.0 * self.end), V::of(1.0 / self.h));
        let q = std::array::from_fn(|i| even[i] + end * odd[i]);
        let v = std::array::from_fn(|i| per_h * (odd[i] + twice * (even_rate[i] + end * odd_rate[i])));
        (q, v)
    }
}

/// [`Expansion::compute`] as what the vector units' dispatch takes: everything it calls must be compiled into it.
struct Computation<'a, const N: usize, V> {
    expansion: &'a mut Expansion<N, V>,
    system: &'a Premultiplied<N>,
    terms: &'a Terms,
    start: &'a Start<N, V>,
    h: f64,
    allowed: V,
}

impl<const N: usize, V: Lane> pulp::WithSimd for Computation<'_, N, V> {
    type Output = V;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> V {
        let Self { expansion, system, terms, start, h, allowed } = self;
        // Nearly always the mesh is alone; its recurrence then stays in registers.
        match terms.channels().len() {
            1 => expansion.compute_of::<1>(system, terms, start, h, allowed),
            _ => expansion.compute_of::<CHANNELS>(system, terms, start, h, allowed),
        }
    }
}

impl<const N: usize> Expansion<N, f64> {
    /// What a direction of the system sees, over the step.
    pub fn series_along(&self, direction: &[f64; N]) -> Series {
        let mut c = [0.0; LENGTH];
        c.iter_mut().zip(self.rows()).for_each(|(c, row)| *c = along(direction, row));
        Series::from_slice(&c[..=self.degree])
    }
}

/// Where a coordinate of `N` stands: even numbers first.
#[inline(always)]
pub(super) const fn place(coordinate: usize, n: usize) -> usize {
    (coordinate % 2) * (n / 2) + coordinate / 2
}

/// Number of the coordinate at each place.
fn in_order_of<const N: usize>() -> [usize; N] {
    placed(&std::array::from_fn(|i| i))
}

/// Values of all coordinates at their place.
pub(super) fn placed<const N: usize, V: Copy>(values: &[V; N]) -> [V; N] {
    let mut placed = *values;
    for (i, &value) in values.iter().enumerate() {
        placed[place(i, N)] = value;
    }
    placed
}

/// Values at their place in the order of the coordinates.
pub(super) fn in_order<const N: usize, V: Copy>(placed: &[V; N]) -> [V; N] {
    std::array::from_fn(|i| placed[place(i, N)])
}

/// `sum s_j x_{n-j}` over `j > 0`.
#[inline(always)]
fn older<V: Lane>(s: &Series, x: &[V; LENGTH], n: usize) -> V {
    let s = s.coefficients();
    if s.len() == 1 || n == 0 {
        return V::of(0.0);
    }
    let terms = s[1..s.len().min(n + 1)].iter().zip(x[..n].iter().rev());
    terms.fold(V::of(0.0), |sum, (&s, &x)| sum + V::of(s) * x)
}

/// Scalar product with four partial sums: the sum's latency bounds the recurrence.
#[inline(always)]
pub(super) fn along<const N: usize, V: Lane>(direction: &[f64; N], x: &[V; N]) -> V {
    let mut sums = [V::of(0.0); 4];
    for i in 0..N {
        sums[i % 4] = sums[i % 4] + V::of(direction[i]) * x[i];
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}
