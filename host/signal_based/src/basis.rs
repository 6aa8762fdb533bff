//! How an amplitude may move with the speed: a natural cubic spline, and resonances that the line is swept through.
//!
//! One node is a constant, two a straight line, more a spline between nodes at equal shares of the fitted turns,
//! straight on beyond them. A path's response is smooth, so a spline of few nodes leaves a fifteenth of the power
//! that as many straight pieces do (on the course of the test), and unlike a polynomial it does not swing out far
//! where a stretch was not fitted. A resonance of the path stands at a frequency, not at a speed: its function of the
//! line's own frequency and how fast that moves ([`super::swept_mode`]) is shared by every line and channel
//! ([`super::pole_search`]), only the residue is free. It carries across a gap of speeds what no interpolation can. A
//! speed that changes takes a torque, which the mesh carries beside the load's: a function of the rate of change. Every
//! function of every line is a complex unknown and is counted.

use super::swept_mode::{Pole, resonance};
use nalgebra::{DMatrix, DVector};
use rustfft::num_complex::Complex64;
use std::sync::Arc;

/// Weight of the second differences, and of residues, against the data's.
const CURVATURE_WEIGHT: f64 = 1e-3;
const RESIDUE_WEIGHT: f64 = 1e-5;

/// How a shaft turns during a turn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Speed, Hz.
    pub speed_hz: f64,
    /// Rate of change of the speed, Hz/s.
    pub sweep_hz_s: f64,
    /// The same over the run's usual one.
    pub swing: f64,
}

impl State {
    /// At a constant speed.
    pub fn steady(speed_hz: f64) -> Self {
        Self { speed_hz, sweep_hz_s: 0.0, swing: 0.0 }
    }

    /// At which a line of another order had the frequency that one of `factor` times its order has at this.
    pub fn scaled(self, factor: f64) -> Self {
        Self { speed_hz: self.speed_hz * factor, sweep_hz_s: self.sweep_hz_s * factor, ..self }
    }

    /// A share of the way to another.
    pub fn towards(self, other: Self, share: f64) -> Self {
        let of = |a: f64, b: f64| a + share * (b - a);
        Self {
            speed_hz: of(self.speed_hz, other.speed_hz),
            sweep_hz_s: of(self.sweep_hz_s, other.sweep_hz_s),
            swing: of(self.swing, other.swing),
        }
    }

    /// A share of a turn later, or earlier.
    fn later(self, turns: f64) -> Self {
        Self { speed_hz: self.speed_hz + self.sweep_hz_s * turns / self.speed_hz, ..self }
    }
}

/// Share of its distance from a pole, at least of the half-width, by which a line may move from one point to the
/// next, and most points of a turn.
const STEP_SHARE: f64 = 0.25;
const MOST_POINTS: f64 = 16.0;
/// Half-widths from a pole within which a mode that was passed rings on.
const RINGING_HALF_WIDTHS: f64 = 4.0;

/// How far beyond the outer nodes a spline goes straight on, share of the outer piece.
const EXTRAPOLATION_SHARE: f64 = 0.2;

/// Functions of the speed and its rate of change.
#[derive(Debug, Clone, PartialEq)]
pub struct Basis {
    nodes_hz: Vec<f64>,
    /// Second derivatives of the spline at the nodes, from its values there.
    bends: DMatrix<f64>,
    poles: Vec<Pole>,
    swings: bool,
    carried: Option<Carried>,
}

/// A line with its fitted amplitude (peak, record's unit).
#[derive(Debug, Clone, PartialEq)]
pub struct FittedLine {
    /// Order of the pinion.
    pub order: f64,
    /// Functions that it moves with.
    pub basis: Basis,
    /// Their coefficients.
    pub coefficients: Vec<Complex64>,
}

impl FittedLine {
    /// Amplitude at a state.
    pub fn at(&self, state: State) -> Complex64 {
        self.basis.value(self.order, &self.coefficients, state)
    }
}

/// Another line through the same path, which had the frequency of this one at another speed, and what makes its
/// amplitude about one.
#[derive(Debug, Clone, PartialEq)]
struct Carried {
    line: Arc<FittedLine>,
    scale: f64,
}

impl Carried {
    fn at(&self, order: f64, state: State) -> Complex64 {
        self.line.at(state.scaled(order / self.line.order)) * self.scale
    }
}

impl Basis {
    /// A constant.
    pub fn constant() -> Self {
        Self::of_nodes(vec![0.0])
    }

    /// A constant and one resonance.
    pub fn of_pole(pole: Pole) -> Self {
        Self::constant().with_poles(&[pole])
    }

    fn of_nodes(nodes_hz: Vec<f64>) -> Self {
        Self { bends: bends(&nodes_hz), nodes_hz, poles: Vec::new(), swings: false, carried: None }
    }

    /// A spline of `count` nodes over the speeds of the fitted turns; fewer where these hardly differ.
    pub fn of_speeds(states: &[State], count: usize) -> Self {
        let mut sorted: Vec<f64> = states.iter().map(|state| state.speed_hz).collect();
        sorted.sort_by(f64::total_cmp);
        let Some(last) = sorted.len().checked_sub(1).filter(|_| count > 1) else { return Self::constant() };
        let mut nodes_hz: Vec<f64> = (0..count).map(|i| sorted[i * last / (count - 1)]).collect();
        nodes_hz.dedup_by(|a, b| *a - *b < 1e-9 * b.abs());
        Self::of_nodes(nodes_hz)
    }

    /// The same with resonances.
    pub fn with_poles(&self, poles: &[Pole]) -> Self {
        Self { poles: poles.to_vec(), ..self.clone() }
    }

    /// The same with the rate of change.
    pub fn with_swings(&self) -> Self {
        Self { swings: true, ..self.clone() }
    }

    /// The same times the course of another line at the speeds where it had this one's frequency; its amplitude has
    /// this mean square over the fitted turns.
    pub fn carried_by(&self, line: &Arc<FittedLine>, mean_square: f64) -> Self {
        let scale = 1.0 / mean_square.sqrt().max(f64::MIN_POSITIVE);
        Self { carried: Some(Carried { line: Arc::clone(line), scale }), ..self.clone() }
    }

    /// Whether another line's course carries it.
    pub fn is_carried(&self) -> bool {
        self.carried.is_some()
    }

    /// Number of functions.
    pub fn len(&self) -> usize {
        self.nodes_hz.len() + self.poles.len() + usize::from(self.swings)
    }

    /// Never: there is always the constant.
    pub fn is_empty(&self) -> bool {
        self.nodes_hz.is_empty()
    }

    /// The spline's functions, one for the value at each node, at a speed.
    fn spline(&self, speed_hz: f64) -> impl Iterator<Item = f64> + '_ {
        let nodes = &self.nodes_hz;
        let last = nodes.len() - 1;
        let i = nodes.partition_point(|n| *n <= speed_hz).clamp(1, last.max(1)) - 1;
        let length = if last > 0 { nodes[i + 1] - nodes[i] } else { 1.0 };
        let u = ((speed_hz - nodes[i]) / length).clamp(-EXTRAPOLATION_SHARE, 1.0 + EXTRAPOLATION_SHARE);
        let (left, right) = if last > 0 { (1.0 - u, u) } else { (1.0, 0.0) };
        // Weights of the second derivatives at both nodes: a cubic between them, straight on beyond the outer ones,
        // where they vanish.
        let [of_left, of_right] = match u {
            u if u < 0.0 => [0.0, -u],
            u if u > 1.0 => [u - 1.0, 0.0],
            _ => [left.powi(3) - left, right.powi(3) - right],
        }
        .map(|weight| weight * length * length / 6.0);
        (0..=last).map(move |j| {
            let straight = if j == i { left } else { 0.0 } + if j == i + 1 { right } else { 0.0 };
            if last < 2 {
                straight
            } else {
                straight + of_left * self.bends[(i, j)] + of_right * self.bends[(i + 1, j)]
            }
        })
    }

    /// Functions of a line of this order at a state, by number.
    fn functions(&self, order: f64, state: State) -> impl Iterator<Item = (usize, Complex64)> + '_ {
        let path = self.carried.as_ref().map_or(Complex64::ONE, |line| line.at(order, state));
        let spline = self.spline(state.speed_hz).map(move |u| path * u);
        let of_pole = move |pole: &Pole| resonance(*pole, order * state.speed_hz, order * state.sweep_hz_s);
        let last = self.swings.then(|| Complex64::new(state.swing, 0.0));
        spline.chain(self.poles.iter().map(of_pole)).chain(last).enumerate()
    }

    /// A value at a state from the coefficients of a line of this order.
    pub fn value(&self, order: f64, coefficients: &[Complex64], state: State) -> Complex64 {
        self.functions(order, state).map(|(i, u)| coefficients[i] * u).sum()
    }

    /// Points of a turn between which a line's amplitude goes straight on: one where no pole is near.
    pub fn points(&self, order: f64, state: State) -> usize {
        let moves = (order * state.sweep_hz_s / state.speed_hz).abs();
        let of_pole = |[own_hz, damping]: &Pole| {
            let half_width = own_hz * damping;
            let apart = (order * state.speed_hz - own_hz).abs() - RINGING_HALF_WIDTHS * half_width;
            moves / (STEP_SHARE * apart.max(half_width))
        };
        let most = self.poles.iter().map(of_pole).fold(1.0, f64::max).min(MOST_POINTS).ceil() as usize;
        let carrier =
            |carried: &Carried| carried.line.basis.points(carried.line.order, state.scaled(order / carried.line.order));
        self.carried.as_ref().map_or(most, |carried| most.max(carrier(carried)))
    }

    /// The functions meaned over turns, one row each.
    pub fn rows(&self, order: f64, states: &[State]) -> Vec<Complex64> {
        let n = self.len();
        let mut rows = vec![Complex64::ZERO; n * states.len()];
        for (row, state) in rows.chunks_mut(n).zip(states) {
            let points = self.points(order, *state);
            for point in 0..points {
                let state = state.later((point as f64 + 0.5) / points as f64 - 0.5);
                self.functions(order, state).for_each(|(i, u)| row[i] += u / points as f64);
            }
        }
        rows
    }

    /// Least squares of values with weights at states: the coefficients.
    pub fn fit(&self, order: f64, states: &[State], weights: &[f64], weighted_values: &[Complex64]) -> Vec<Complex64> {
        self.solved(&self.rows(order, states), weights, weighted_values)
    }

    /// The same from rows of functions.
    pub fn solved(&self, rows: &[Complex64], weights: &[f64], weighted_values: &[Complex64]) -> Vec<Complex64> {
        let n = self.len();
        let mut matrix = DMatrix::<Complex64>::zeros(n, n);
        let mut right = DVector::<Complex64>::zeros(n);
        for ((row, &weight), value) in rows.chunks(n).zip(weights).zip(weighted_values) {
            for (i, u) in row.iter().enumerate() {
                right[i] += u.conj() * value;
                for (j, v) in row.iter().enumerate() {
                    matrix[(i, j)] += u.conj() * v * weight;
                }
            }
        }
        let scale = matrix.trace().re / n as f64;
        for nodes in self.nodes_hz.windows(3).enumerate().map(|(i, x)| bend(i, x)) {
            for (a, u) in nodes {
                for (b, v) in nodes {
                    matrix[(a, b)] += CURVATURE_WEIGHT * scale * u * v;
                }
            }
        }
        for i in 0..n {
            let own = if i < self.nodes_hz.len() { 1e-9 } else { RESIDUE_WEIGHT };
            matrix[(i, i)] += own * scale;
        }
        let Some(solved) = matrix.cholesky().map(|c| c.solve(&right)) else { return vec![Complex64::default(); n] };
        solved.iter().copied().collect()
    }
}

/// Second derivatives at the nodes of the natural cubic spline, as a matrix on its values there.
fn bends(nodes_hz: &[f64]) -> DMatrix<f64> {
    let n = nodes_hz.len();
    let mut none = DMatrix::zeros(n, n);
    if n < 3 {
        return none;
    }
    let (mut of_bends, mut of_values) = (DMatrix::<f64>::identity(n, n), DMatrix::<f64>::zeros(n, n));
    for i in 1..n - 1 {
        let (left, right) = (nodes_hz[i] - nodes_hz[i - 1], nodes_hz[i + 1] - nodes_hz[i]);
        for (j, bend, value) in [
            (i - 1, left / 6.0, 1.0 / left),
            (i, (left + right) / 3.0, -1.0 / left - 1.0 / right),
            (i + 1, right / 6.0, 1.0 / right),
        ] {
            (of_bends[(i, j)], of_values[(i, j)]) = (bend, value);
        }
    }
    if let Some(solved) = of_bends.lu().solve(&of_values) {
        none = solved;
    }
    none
}

/// Index and weight of three neighbouring nodes in the departure of the middle one from the straight line through the
/// others.
fn bend(first: usize, nodes_hz: &[f64]) -> [(usize, f64); 3] {
    let (left, right) = (nodes_hz[1] - nodes_hz[0], nodes_hz[2] - nodes_hz[1]);
    [(first, right / (left + right)), (first + 1, -1.0), (first + 2, left / (left + right))]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_a_straight_course_is_fitted_and_carried_across_a_gap() {
        let truth = |s: f64| Complex64::new(2.0 * s - 3.0, 1.0 - s);
        let speeds: Vec<State> = (0..200)
            .map(|i| State::steady(10.0 + 0.05 * f64::from(i)))
            .filter(|s| !(14.0..16.0).contains(&s.speed_hz))
            .collect();
        for count in [2, 3, 6] {
            let basis = Basis::of_speeds(&speeds, count);
            let values: Vec<Complex64> = speeds.iter().map(|s| truth(s.speed_hz)).collect();
            let fit = basis.fit(1.0, &speeds, &vec![1.0; speeds.len()], &values);
            assert!((basis.value(1.0, &fit, State::steady(15.0)) - truth(15.0)).norm() < 1e-5, "{count}");
        }
        assert_eq!(Basis::of_speeds(&[State::steady(20.0); 50], 5).len(), 1);
    }

    #[test]
    fn theory_a_smooth_course_is_followed_far_better_than_by_straight_pieces() {
        let truth = |s: f64| Complex64::from_polar(1.0 + 0.2 * (3.0 * (s - 10.0)).sin(), 2.0 * (s - 10.0));
        let speeds: Vec<State> = (0..200).map(|i| State::steady(10.0 + 0.005 * f64::from(i))).collect();
        let basis = Basis::of_speeds(&speeds, 6);
        let values: Vec<Complex64> = speeds.iter().map(|s| truth(s.speed_hz)).collect();
        let fit = basis.fit(1.0, &speeds, &vec![1.0; speeds.len()], &values);
        let errors = speeds.iter().map(|s| (basis.value(1.0, &fit, *s) - truth(s.speed_hz)).norm_sqr());
        let error = (errors.sum::<f64>() / speeds.len() as f64).sqrt();
        // Five straight pieces between the same nodes leave 9.4e-3.
        assert!(error < 3e-3, "{error}");
        let beyond = |s: f64| basis.value(1.0, &fit, State::steady(s));
        assert!((beyond(11.01) - 2.0 * beyond(10.995) + beyond(10.98)).norm() < 1e-3);
    }

    #[test]
    fn theory_a_resonance_in_a_gap_is_carried_by_its_pole_alone() {
        let truth =
            |s: f64| Complex64::new(0.3, 0.1) + Complex64::new(1.0, -2.0) * resonance([150.0, 0.02], 10.0 * s, 0.0);
        let speeds: Vec<State> = (0..200)
            .map(|i| State::steady(10.0 + 0.05 * f64::from(i)))
            .filter(|s| !(14.5..15.5).contains(&s.speed_hz))
            .collect();
        let values: Vec<Complex64> = speeds.iter().map(|s| truth(s.speed_hz)).collect();
        let error = |basis: &Basis| {
            let fit = basis.fit(10.0, &speeds, &vec![1.0; speeds.len()], &values);
            (basis.value(10.0, &fit, State::steady(15.0)) - truth(15.0)).norm()
        };
        let spline = Basis::of_speeds(&speeds, 28);
        assert!(error(&spline) > 0.5 && error(&Basis::constant().with_poles(&[[150.0, 0.02]])) < 0.02);
    }
}
