//! Periodic steady state without waiting for transients, and the stability of the motion.
//!
//! The linear pair maps a state over one period as `y(T) = Phi y(0) + g`. The columns of `Phi` (homogeneous
//! solutions) and `g` are integrated together with common steps; `(I - Phi) y = g` gives the periodic state at once.
//! The train's rigid rotation makes that singular twice: its angle is pinned to zero, and a constant load torque
//! correction (friction losses, rounding) is an unknown that keeps its speed periodic. The period may be the mesh, a
//! shaft or the hunting period, whichever all excitation repeats in. Eigenvalues of `Phi` are the Floquet
//! multipliers: one pair at 1 is the rigid rotation, any other beyond 1 is parametric instability. Cost: 2 N + 2
//! columns over one period; the eigenvalues are computed only when asked for.

use super::assembly::{Coordinate, System};
use super::mesh::Mesh;
use super::taylor::{Column, Options, Solver, State, Statistics};
use crate::{Error, Result};
use nalgebra::{Complex, DMatrix, DVector};

/// What keeps the mean speed where friction takes or an effect brings power.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Balance {
    /// A torque on the load, N m: the speed is constant.
    Load,
    /// The inertia of all bodies: the train speeds up or slows down as a whole, as it does in a run that nothing
    /// holds, and the unknown is the pinion's mean acceleration, rad/s2. For meshes that do not follow that.
    Inertia,
}

/// A periodic motion.
#[derive(Debug, Clone)]
pub struct SteadyState<const N: usize> {
    /// State at the start of the period.
    pub state: State<N>,
    /// Generalised force added to keep the mean speed, in coordinates.
    pub correction: DVector<f64>,
    /// Cost.
    pub statistics: Statistics,
    /// The period map, in units that make its entries comparable.
    monodromy: DMatrix<f64>,
}

impl<const N: usize> SteadyState<N> {
    /// Floquet multipliers.
    pub fn multipliers(&self) -> Vec<Complex<f64>> {
        self.monodromy.complex_eigenvalues().iter().copied().collect()
    }

    /// Largest multiplier besides the two of the rigid rotation; above 1 the motion is unstable.
    pub fn largest_multiplier(&self) -> f64 {
        let mut others = self.multipliers();
        others.sort_by(|a, b| (a - 1.0).norm().total_cmp(&(b - 1.0).norm()));
        others.iter().skip(2).map(|m| m.norm()).fold(0.0, f64::max)
    }
}

/// Finds the periodic state at `start_s` under `force` for a mesh that repeats every `period_s`.
///
/// # Errors
/// A mesh with contact loss (its map is not linear), a period that is not positive, or a singular map.
pub fn steady_state<const N: usize>(
    system: &System,
    mesh: &mut Mesh,
    force: &DVector<f64>,
    (start_s, period_s): (f64, f64),
    balance: Balance,
    options: &Options,
) -> Result<SteadyState<N>> {
    if mesh.is_nonlinear() {
        return Err(Error::impossible("steady state", "with contact loss the motion has no linear period map"));
    }
    if !(period_s.is_finite() && period_s > 0.0) {
        return Err(Error::invalid("steady state", format!("a period of {period_s} s is not positive")));
    }
    let rigid = system.rigid_rotation();
    let pinned = DVector::from_fn(N, |i, _| rigid[i] * system.mass[i]);
    let balancing = balancing(system, &pinned, force, balance)?;
    let solver = Solver::<N>::new(system, force);
    // Columns of the size of the static deflection and its natural velocity, so that the map is well scaled.
    let largest = system.stiffness.diagonal().amax();
    let stiffness = if largest > 0.0 { largest } else { 1e8 };
    let deflection = system.static_deflection(force, stiffness)?.amax().max(1e-9);
    let full = |i: usize| system.stiffness[(i, i)] + stiffness * system.mesh[i] * system.mesh[i];
    let rate = (0..N).map(|i| full(i) / system.mass[i]).fold(1.0, f64::max).sqrt();
    let size = |j: usize| if j < N { deflection } else { deflection * rate };
    let rest = State { q: [0.0; N], v: [0.0; N] };
    let homogeneous = solver.force_drive(&[0.0; N]);
    let balance_alone = solver.force_drive(&std::array::from_fn(|i| balancing[i]));
    let mut columns: Vec<Column<N>> = (0..2 * N)
        .map(|j| {
            let mut state = rest;
            if j < N {
                state.q[j] = size(j)
            } else {
                state.v[j - N] = size(j)
            }
            Column { state, drive: homogeneous }
        })
        .collect();
    columns.push(Column { state: rest, drive: solver.full_drive() });
    columns.push(Column { state: rest, drive: balance_alone });
    let statistics = solver.propagate(mesh, &mut columns, (start_s, start_s + period_s), options)?;
    let end = |j: usize, i: usize| if i < N { columns[j].state.q[i] } else { columns[j].state.v[i - N] };
    let monodromy = DMatrix::from_fn(2 * N, 2 * N, |i, j| end(j, i) / size(i));
    let left = DMatrix::from_fn(2 * N + 1, 2 * N + 1, |i, j| match (i < 2 * N, j < 2 * N) {
        (true, true) => f64::from(u8::from(i == j)) - monodromy[(i, j)],
        (true, false) => -end(2 * N + 1, i) / size(i),
        (false, true) if j < N => pinned[j],
        _ => 0.0,
    });
    let right = DVector::from_fn(2 * N + 1, |i, _| if i < 2 * N { end(2 * N, i) / size(i) } else { 0.0 });
    let solution = left.full_piv_lu().solve(&right);
    let solution = solution.ok_or_else(|| Error::impossible("steady state", "the period map is singular"))?;
    let state = State {
        q: std::array::from_fn(|i| solution[i] * size(i)),
        v: std::array::from_fn(|i| solution[N + i] * size(N + i)),
    };
    Ok(SteadyState { state, correction: balancing * solution[2 * N], statistics, monodromy })
}

/// The unit of the force that keeps the mean speed, about as large as `force`.
fn balancing(system: &System, inertia: &DVector<f64>, force: &DVector<f64>, balance: Balance) -> Result<DVector<f64>> {
    let size = force.amax().max(1.0);
    match balance {
        Balance::Load => {
            let load = system.index(Coordinate::Load).or(system.index(Coordinate::Rotation(1)));
            let load = load.ok_or_else(|| Error::impossible("steady state", "the model has no gear rotation"))?;
            Ok(DVector::from_fn(force.len(), |i, _| if i == load { size } else { 0.0 }))
        }
        Balance::Inertia => Ok(inertia * (size / inertia.amax())),
    }
}
