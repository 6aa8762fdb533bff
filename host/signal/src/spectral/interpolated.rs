//! Values between equally spaced ones, by the polynomial through the sixteen nearest.
//!
//! A cubic spline leaves images of a slow change, at the rate of the knots less its own, of about `f^4` of it at `f`
//! periods per knot: with one knot per turn of a shaft they stand beside the first sidebands of that shaft, and where
//! a channel has hardly any noise they pass for them. Through sixteen values they are 6e-8 of it at an eighth of a
//! period per knot, not 1e-4. Towards the ends it goes through as many as there are on both sides, at least four:
//! more to one side would multiply the noise of the outer values. Limit: exact values are asked for; beyond the ends
//! nothing is.

/// Values that the polynomial goes through on each side, and at least where there are fewer.
const EACH_SIDE: usize = 8;
const MIN_SIDE_VALUES: usize = 2;

/// The value at `place` of those at 0, 1, 2, and so on; places beyond the ends are those ends.
///
/// Zero where there are none.
pub fn interpolated(values: &[f64], place: f64) -> f64 {
    let place = place.clamp(0.0, values.len().saturating_sub(1) as f64);
    let before = place.floor() as usize + 1;
    let side = before.min(values.len().saturating_sub(before)).clamp(MIN_SIDE_VALUES, EACH_SIDE);
    let nodes = (2 * side).min(values.len());
    let first = before.saturating_sub(side).min(values.len() - nodes);
    through(first..first + nodes, values, place)
}

/// The value at `place` of the polynomial through those of `values` at some distinct places (Lagrange's form).
pub fn through(nodes: impl Iterator<Item = usize> + Clone, values: &[f64], place: f64) -> f64 {
    let weight = |i: usize| {
        let others = nodes.clone().filter(|j| *j != i);
        others.map(|j| (place - j as f64) / (i as f64 - j as f64)).product::<f64>()
    };
    nodes.clone().map(|i| weight(i) * values[i]).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn theory_a_polynomial_of_the_seventh_degree_is_met_inside_and_a_cubic_everywhere() {
        let truth = |x: f64, seventh: f64| seventh * (x - 4.0).powi(7) / 1e4 - (x - 9.0).powi(3) + x;
        for (seventh, from, to) in [(1.0, 30, 160), (0.0, 0, 190)] {
            let values: Vec<f64> = (0..20).map(|i| truth(f64::from(i), seventh)).collect();
            for step in from..=to {
                let x = 0.1 * f64::from(step);
                let exact = truth(x, seventh);
                assert!((interpolated(&values, x) - exact).abs() < 1e-8 * (1.0 + exact.abs()), "{x}");
            }
        }
    }

    #[test]
    fn theory_images_of_a_change_over_eight_values_are_below_a_millionth() {
        let slow = |x: f64| (TAU * 0.125 * x).sin();
        let values: Vec<f64> = (0..200).map(|i| slow(f64::from(i))).collect();
        let off = |i: usize| (interpolated(&values, 0.125 * i as f64) - slow(0.125 * i as f64)).abs();
        assert!((80..1500).map(off).fold(0.0, f64::max) < 1e-6);
    }

    #[test]
    fn few_values_and_places_beyond_the_ends_are_met_as_well() {
        assert_eq!(interpolated(&[], 1.0), 0.0);
        assert_eq!(interpolated(&[3.0], 7.0), 3.0);
        assert_eq!(
            [interpolated(&[1.0, 2.0], 0.5), interpolated(&[1.0, 2.0], -3.0), interpolated(&[1.0, 2.0], 9.0)],
            [1.5, 1.0, 2.0]
        );
    }
}
