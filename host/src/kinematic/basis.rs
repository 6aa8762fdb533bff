//! How an amplitude may move with the speed: a few hat functions, with a weak preference for straight lines.
//!
//! One function is a constant, two a straight line, more are straight pieces between nodes at equal shares of the fitted turns. Between
//! nodes nothing can swing out, so a stretch that was not fitted is interpolated soberly; a polynomial is not. Every function of every line
//! is a complex unknown and is counted.

use rustfft::num_complex::Complex64;

/// Weight of the second differences against the data's.
const STRAIGHT: f64 = 1e-3;

/// Hat functions over the speed.
#[derive(Debug, Clone, PartialEq)]
pub struct Basis {
    nodes_hz: Vec<f64>,
}

impl Basis {
    /// A constant.
    pub fn constant() -> Self {
        Self { nodes_hz: vec![0.0] }
    }

    /// `count` functions over the speeds of the fitted turns; fewer where these hardly differ.
    pub fn of_speeds(speeds_hz: &[f64], count: usize) -> Self {
        let mut sorted = speeds_hz.to_vec();
        sorted.sort_by(f64::total_cmp);
        let Some(last) = sorted.len().checked_sub(1).filter(|_| count > 1) else { return Self::constant() };
        let mut nodes_hz: Vec<f64> = (0..count).map(|i| sorted[i * last / (count - 1)]).collect();
        nodes_hz.dedup_by(|a, b| *a - *b < 1e-9 * b.abs());
        Self { nodes_hz }
    }

    /// Number of functions.
    pub fn len(&self) -> usize {
        self.nodes_hz.len()
    }

    /// Never: there is always the constant.
    pub fn is_empty(&self) -> bool {
        self.nodes_hz.is_empty()
    }

    /// The two functions that are not zero at a speed: index and value; straight on beyond the ends.
    pub fn at(&self, speed_hz: f64) -> [(usize, f64); 2] {
        let nodes = &self.nodes_hz;
        if nodes.len() < 2 {
            return [(0, 1.0), (0, 0.0)];
        }
        let i = nodes.partition_point(|n| *n <= speed_hz).clamp(1, nodes.len() - 1) - 1;
        let u = ((speed_hz - nodes[i]) / (nodes[i + 1] - nodes[i])).clamp(-0.2, 1.2);
        [(i, 1.0 - u), (i + 1, u)]
    }

    /// A value at a speed from its coefficients.
    pub fn value(&self, coefficients: &[Complex64], speed_hz: f64) -> Complex64 {
        self.at(speed_hz).iter().map(|&(i, u)| coefficients[i] * u).sum()
    }

    /// Least squares of values with weights at speeds: the coefficients.
    pub fn fit(&self, speeds_hz: &[f64], weights: &[f64], weighted_values: &[Complex64]) -> Vec<Complex64> {
        let n = self.len();
        let mut matrix = nalgebra::DMatrix::<f64>::zeros(n, n);
        let mut right = nalgebra::DMatrix::<f64>::zeros(n, 2);
        for ((&speed, &weight), value) in speeds_hz.iter().zip(weights).zip(weighted_values) {
            for (i, u) in self.at(speed) {
                right[(i, 0)] += u * value.re;
                right[(i, 1)] += u * value.im;
                for (j, v) in self.at(speed) {
                    matrix[(i, j)] += weight * u * v;
                }
            }
        }
        let scale = matrix.trace() / n as f64;
        for nodes in self.nodes_hz.windows(3).enumerate().map(|(i, x)| bend(i, x)) {
            for (a, u) in nodes {
                for (b, v) in nodes {
                    matrix[(a, b)] += STRAIGHT * scale * u * v;
                }
            }
        }
        for i in 0..n {
            matrix[(i, i)] += 1e-9 * scale;
        }
        let Some(solved) = matrix.cholesky().map(|c| c.solve(&right)) else { return vec![Complex64::default(); n] };
        (0..n).map(|i| Complex64::new(solved[(i, 0)], solved[(i, 1)])).collect()
    }
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
        let speeds: Vec<f64> =
            (0..200).map(|i| 10.0 + 0.05 * f64::from(i)).filter(|s| !(14.0..16.0).contains(s)).collect();
        for count in [2, 3, 6] {
            let basis = Basis::of_speeds(&speeds, count);
            let values: Vec<Complex64> = speeds.iter().map(|s| truth(*s)).collect();
            let fit = basis.fit(&speeds, &vec![1.0; speeds.len()], &values);
            assert!((basis.value(&fit, 15.0) - truth(15.0)).norm() < 1e-5, "{count}");
        }
        assert_eq!(Basis::of_speeds(&[20.0; 50], 5).len(), 1);
    }
}
