//! Periodic steady state without waiting for transients, and the stability of the motion.
//!
//! The linear pair maps a state over one period as `y(T) = Phi y(0) + g`. `Phi` and `g` come from one
//! integration per column; `(I - Phi) y = g` gives the periodic state at once. The train's rigid rotation
//! makes that singular twice: its angle is pinned to zero, and a constant load torque correction (friction
//! losses, rounding) is an unknown that keeps its speed periodic. The period may be the mesh, a shaft or the
//! hunting period, whichever all excitation repeats in. Eigenvalues of `Phi` are the Floquet multipliers:
//! one pair at 1 is the rigid rotation, any other beyond 1 is parametric instability.
//! Cost: 2 N + 2 integrations of one period.

use super::assembly::{Coordinate, System};
use super::mesh::Mesh;
use super::taylor::{Options, Solver, State, Statistics};
use crate::{Error, Result};
use nalgebra::{Complex, DMatrix, DVector};

/// A periodic motion.
#[derive(Debug, Clone)]
pub struct SteadyState<const N: usize> {
    /// State at the start of the period.
    pub state: State<N>,
    /// Load torque added to keep the mean speed, N m.
    pub load_correction_n_m: f64,
    /// Floquet multipliers.
    pub multipliers: Vec<Complex<f64>>,
    /// Cost.
    pub statistics: Statistics,
}

impl<const N: usize> SteadyState<N> {
    /// Largest multiplier besides the two of the rigid rotation; above 1 the motion is unstable.
    pub fn largest_multiplier(&self) -> f64 {
        let mut others = self.multipliers.clone();
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
    options: &Options,
) -> Result<SteadyState<N>> {
    if mesh.is_nonlinear() {
        return Err(Error::impossible("steady state", "with contact loss the motion has no linear period map"));
    }
    if !(period_s.is_finite() && period_s > 0.0) {
        return Err(Error::invalid("steady state", format!("a period of {period_s} s is not positive")));
    }
    let mut statistics = Statistics::default();
    let mut solver = Solver::<N>::new(system, force);
    let mut map = |solver: &Solver<N>, start: DVector<f64>| -> Result<DVector<f64>> {
        let mut state = State { q: std::array::from_fn(|i| start[i]), v: std::array::from_fn(|i| start[N + i]) };
        let end = start_s + period_s;
        statistics.add(&solver.integrate(mesh, &mut state, (start_s, end), options, |_| {})?);
        Ok(DVector::from_iterator(2 * N, state.q.into_iter().chain(state.v)))
    };
    // Columns of the size of the static deflection, so that the forced part does not drown them.
    let deflection = system.static_deflection(force, mean_stiffness(system))?.amax().max(1e-9);
    let rate = system.natural_frequencies_hz(mean_stiffness(system)).last().copied().unwrap_or(1.0);
    let size = |j: usize| if j < N { deflection } else { deflection * rate };
    let forced = map(&solver, DVector::zeros(2 * N))?;
    let mut monodromy = DMatrix::zeros(2 * N, 2 * N);
    for j in 0..2 * N {
        let mut unit = DVector::zeros(2 * N);
        unit[j] = size(j);
        let column = (map(&solver, unit)? - &forced) / size(j);
        monodromy.set_column(j, &column);
    }
    let load = system.index(Coordinate::Load).or(system.index(Coordinate::Rotation(1)));
    let load = load.ok_or_else(|| Error::impossible("steady state", "the model has no gear rotation"))?;
    let torque = force[load].abs().max(1.0);
    let mut changed = force.clone();
    changed[load] += torque;
    solver.set_force(changed.as_slice());
    let correction = (map(&solver, DVector::zeros(2 * N))? - &forced) / torque;
    let rigid = system.rigid_rotation();
    let size_of = 2 * N + 1;
    let left = DMatrix::from_fn(size_of, size_of, |i, j| match (i < 2 * N, j < 2 * N) {
        (true, true) => (f64::from(u8::from(i == j)) - monodromy[(i, j)]) * size(j) / size(i),
        (true, false) => -correction[i] * torque / size(i),
        (false, true) if j < N => rigid[j] * system.mass[j],
        _ => 0.0,
    });
    let right = DVector::from_fn(size_of, |i, _| if i < 2 * N { forced[i] / size(i) } else { 0.0 });
    let solution = left.full_piv_lu().solve(&right);
    let solution = solution.ok_or_else(|| Error::impossible("steady state", "the period map is singular"))?;
    let state = State {
        q: std::array::from_fn(|i| solution[i] * size(i)),
        v: std::array::from_fn(|i| solution[N + i] * size(N + i)),
    };
    let load_correction_n_m = solution[2 * N] * torque;
    let scaled = DMatrix::from_fn(2 * N, 2 * N, |i, j| monodromy[(i, j)] * size(j) / size(i));
    let multipliers = scaled.complex_eigenvalues().iter().copied().collect();
    Ok(SteadyState { state, load_correction_n_m, multipliers, statistics })
}

/// A mesh stiffness of the usual size, for scaling only.
fn mean_stiffness(system: &System) -> f64 {
    let largest = system.stiffness.diagonal().amax();
    if largest > 0.0 { largest } else { 1e8 }
}
