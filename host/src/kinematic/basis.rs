//! How an amplitude may move with the speed: a natural cubic spline, and resonances that the line is swept through.
//!
//! One node is a constant, two a straight line, more a spline between nodes at equal shares of the fitted turns, straight on beyond them. A path's response is smooth, so a spline of few nodes leaves a
//! fifteenth of the power that as many straight pieces do (on the course of the test), and unlike a polynomial it does not swing out far where a stretch was not fitted. A resonance of the path stands at a frequency, not at a
//! speed: its function `f^2 / (f_m^2 - f^2 + 2 i zeta f f_m)` of the line's own frequency is shared by every line and channel ([`super::poles`]), only the residue is free. It
//! carries across a gap of speeds what no interpolation can. A speed that changes takes a torque, which the mesh carries beside the load's: a function of the rate of change. Every function of every line is a complex unknown and is counted.

use nalgebra::{DMatrix, DVector};
use rustfft::num_complex::Complex64;
use std::sync::Arc;

/// Weight of the second differences, and of residues, against the data's.
const STRAIGHT: f64 = 1e-3;
const SMALL: f64 = 1e-5;

/// A pole: frequency, Hz, and damping ratio.
pub type Pole = [f64; 2];

/// How a shaft turns: speed, Hz, and its rate of change over the usual one.
pub type State = [f64; 2];

/// How far beyond the outer nodes a spline goes straight on, share of the outer piece.
const BEYOND: f64 = 0.2;

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

/// Another line through the same path, which had the frequency of this one at another speed, and what makes its amplitude about one.
#[derive(Debug, Clone, PartialEq)]
struct Carried {
    line: Arc<FittedLine>,
    scale: f64,
}

impl Carried {
    fn at(&self, order: f64, [speed_hz, swing]: State) -> Complex64 {
        self.line.at([speed_hz * order / self.line.order, swing]) * self.scale
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
        let mut sorted: Vec<f64> = states.iter().map(|state| state[0]).collect();
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

    /// The same times the course of another line at the speeds where it had this one's frequency; its amplitude has this mean square over the fitted turns.
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
        let u = ((speed_hz - nodes[i]) / length).clamp(-BEYOND, 1.0 + BEYOND);
        let (left, right) = if last > 0 { (1.0 - u, u) } else { (1.0, 0.0) };
        // Weights of the second derivatives at both nodes: a cubic between them, straight on beyond the outer ones, where they vanish.
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
    fn functions(&self, order: f64, [speed_hz, swing]: State) -> impl Iterator<Item = (usize, Complex64)> + '_ {
        let path = self.carried.as_ref().map_or(Complex64::ONE, |line| line.at(order, [speed_hz, swing]));
        let spline = self.spline(speed_hz).map(move |u| path * u);
        let of_pole = move |pole: &Pole| resonance(*pole, order * speed_hz);
        let last = self.swings.then(|| Complex64::new(swing, 0.0));
        spline.chain(self.poles.iter().map(of_pole)).chain(last).enumerate()
    }

    /// A value at a state from the coefficients of a line of this order.
    pub fn value(&self, order: f64, coefficients: &[Complex64], state: State) -> Complex64 {
        self.functions(order, state).map(|(i, u)| coefficients[i] * u).sum()
    }

    /// The functions at states, one row each.
    pub fn rows(&self, order: f64, states: &[State]) -> Vec<Complex64> {
        states.iter().flat_map(|state| self.functions(order, *state).map(|(_, u)| u)).collect()
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
                    matrix[(a, b)] += STRAIGHT * scale * u * v;
                }
            }
        }
        for i in 0..n {
            let own = if i < self.nodes_hz.len() { 1e-9 } else { SMALL };
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

/// A mode's response at a frequency, about one in size at its peak.
pub fn resonance([own_hz, damping]: Pole, hz: f64) -> Complex64 {
    2.0 * damping * hz * hz / Complex64::new(own_hz * own_hz - hz * hz, 2.0 * damping * hz * own_hz)
}

/// Index and weight of three neighbouring nodes in the departure of the middle one from the straight line through the others.
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
        let speeds: Vec<State> =
            (0..200).map(|i| [10.0 + 0.05 * f64::from(i), 0.0]).filter(|s| !(14.0..16.0).contains(&s[0])).collect();
        for count in [2, 3, 6] {
            let basis = Basis::of_speeds(&speeds, count);
            let values: Vec<Complex64> = speeds.iter().map(|s| truth(s[0])).collect();
            let fit = basis.fit(1.0, &speeds, &vec![1.0; speeds.len()], &values);
            assert!((basis.value(1.0, &fit, [15.0, 0.0]) - truth(15.0)).norm() < 1e-5, "{count}");
        }
        assert_eq!(Basis::of_speeds(&[[20.0, 0.0]; 50], 5).len(), 1);
    }

    #[test]
    fn theory_a_smooth_course_is_followed_far_better_than_by_straight_pieces() {
        let truth = |s: f64| Complex64::from_polar(1.0 + 0.2 * (3.0 * (s - 10.0)).sin(), 2.0 * (s - 10.0));
        let speeds: Vec<State> = (0..200).map(|i| [10.0 + 0.005 * f64::from(i), 0.0]).collect();
        let basis = Basis::of_speeds(&speeds, 6);
        let values: Vec<Complex64> = speeds.iter().map(|s| truth(s[0])).collect();
        let fit = basis.fit(1.0, &speeds, &vec![1.0; speeds.len()], &values);
        let errors = speeds.iter().map(|s| (basis.value(1.0, &fit, *s) - truth(s[0])).norm_sqr());
        let error = (errors.sum::<f64>() / speeds.len() as f64).sqrt();
        // Five straight pieces between the same nodes leave 9.4e-3.
        assert!(error < 3e-3, "{error}");
        let beyond = |s: f64| basis.value(1.0, &fit, [s, 0.0]);
        assert!((beyond(11.01) - 2.0 * beyond(10.995) + beyond(10.98)).norm() < 1e-3);
    }

    #[test]
    fn theory_a_resonance_in_a_gap_is_carried_by_its_pole_alone() {
        let truth = |s: f64| Complex64::new(0.3, 0.1) + Complex64::new(1.0, -2.0) * resonance([150.0, 0.02], 10.0 * s);
        let speeds: Vec<State> =
            (0..200).map(|i| [10.0 + 0.05 * f64::from(i), 0.0]).filter(|s| !(14.5..15.5).contains(&s[0])).collect();
        let values: Vec<Complex64> = speeds.iter().map(|s| truth(s[0])).collect();
        let error = |basis: &Basis| {
            let fit = basis.fit(10.0, &speeds, &vec![1.0; speeds.len()], &values);
            (basis.value(10.0, &fit, [15.0, 0.0]) - truth(15.0)).norm()
        };
        let spline = Basis::of_speeds(&speeds, 28);
        assert!(error(&spline) > 0.5 && error(&Basis::constant().with_poles(&[[150.0, 0.02]])) < 0.02);
    }
}
