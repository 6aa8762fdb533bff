//! Helical pairs from slices of the face.
//!
//! A slice is a thin spur pair of the transverse section; along the face each begins its contact later, by the overlap
//! ratio from end to end. Beams beside one another do not hold each other here. Of infinitely many slices the sum is
//! the mean of the spur curve over a window as long as the overlap ratio, which a piecewise polynomial gives exactly:
//! `k(s) = 1/e int_(s-e)^s k_spur(x) dx`. Two facts follow and are tested: the mean over the mesh cycle is the spur
//! pair's, and a whole overlap ratio leaves no variation. Source: Wan et al., Mech. Mach. Theory 94 (2015), slices of
//! the energy method.

use meshband_mechanics::piecewise::{PiecewisePolynomial, horner, shift_scale};

/// Overlap ratio below which a pair is a spur pair: rounding would otherwise exceed what the overlap does.
const MIN_OVERLAP_RATIO: f64 = 1e-6;
/// Distance of knots that are one, base pitches.
const KNOT_TOLERANCE: f64 = 1e-9;

/// The helical pair's curve from the transverse spur pair's, by the exact mean over the face.
pub fn averaged(spur: &PiecewisePolynomial, overlap_ratio: f64) -> PiecewisePolynomial {
    if overlap_ratio < MIN_OVERLAP_RATIO {
        return spur.clone();
    }
    let integral = Antiderivative::of(spur);
    let mut knots: Vec<f64> = spur.knots().iter().flat_map(|k| [*k, k + overlap_ratio]).collect();
    knots.sort_by(f64::total_cmp);
    knots.dedup_by(|b, a| *b - *a < KNOT_TOLERANCE);
    let pieces = knots
        .windows(2)
        .map(|w| {
            let middle = 0.5 * (w[0] + w[1]);
            let mut sum = integral.about(w[0], middle);
            let before = integral.about(w[0] - overlap_ratio, middle - overlap_ratio);
            sum.resize(sum.len().max(before.len()), 0.0);
            sum.iter_mut().zip(before).for_each(|(s, b)| *s -= b);
            sum.iter().map(|s| s / overlap_ratio).collect()
        })
        .collect();
    PiecewisePolynomial::new(knots, pieces)
}

/// The helical pair's stiffness at `s` base pitches from a number of slices, each of them hard at its own place.
pub fn sliced(spur: &PiecewisePolynomial, overlap_ratio: f64, slices: u32, s: f64) -> f64 {
    let place = |slice: u32| overlap_ratio * (f64::from(slice) + 0.5) / f64::from(slices);
    (0..slices).map(|slice| spur.value(s - place(slice))).sum::<f64>() / f64::from(slices)
}

/// Integral of a curve from its first knot.
struct Antiderivative<'c> {
    curve: &'c PiecewisePolynomial,
    /// Integrals of the pieces: coefficients in powers of the distance from the piece's knot.
    pieces: Vec<Vec<f64>>,
    whole: f64,
}

impl<'c> Antiderivative<'c> {
    fn of(curve: &'c PiecewisePolynomial) -> Self {
        let mut whole = 0.0;
        let mut pieces = Vec::new();
        for (i, w) in curve.knots().windows(2).enumerate() {
            let mut piece = vec![whole];
            piece.extend(curve.piece(i).iter().enumerate().map(|(n, c)| c / (n + 1) as f64));
            whole = horner(&piece, w[1] - w[0]);
            pieces.push(piece);
        }
        Self { curve, pieces, whole }
    }

    /// Coefficients in powers of `x - from` of the piece that holds `inside`.
    fn about(&self, from: f64, inside: f64) -> Vec<f64> {
        match self.curve.locate(inside) {
            Some(i) => shift_scale(&self.pieces[i], from - self.curve.knots()[i], 1.0),
            None if inside < self.curve.knots()[0] => vec![0.0],
            None => vec![self.whole],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use meshband_mechanics::machine::Pair;
    use meshband_mechanics::stiffness::{PairModel, mesh};

    fn spur() -> PiecewisePolynomial {
        PairModel::new(&Pair::spur([23, 61], 2e-3, 20e-3, [7e-3, 22e-3])).expect("a pair").curve()
    }

    /// A pair of constant stiffness 1 over a path of `contact_ratio`.
    fn rectangle(contact_ratio: f64) -> PiecewisePolynomial {
        PiecewisePolynomial::new(vec![0.0, contact_ratio], vec![vec![1.0]])
    }

    #[test]
    fn theory_slices_converge_on_the_mean_over_the_face_with_their_number() {
        let (spur, overlap) = (spur(), 0.83);
        let exact = averaged(&spur, overlap);
        let largest = exact.value(1.2);
        let places: Vec<f64> = (0..200).map(|i| f64::from(i) * 2.5 / 200.0).collect();
        let error = |slices| {
            let sum: f64 = places.iter().map(|&s| (sliced(&spur, overlap, slices, s) - exact.value(s)).powi(2)).sum();
            (sum / places.len() as f64).sqrt() / largest
        };
        let errors = [10, 40, 160, 640].map(error);
        // Hard slices: the error falls with their number.
        assert!(errors.windows(2).all(|e| e[1] < 0.4 * e[0]) && errors[3] < 1e-3, "{errors:?}");
    }

    #[test]
    fn theory_the_mean_is_the_slices_sum_and_a_whole_overlap_leaves_no_variation() {
        let spur = spur();
        for overlap in [0.4, 1.0, 1.37, 2.0] {
            let pair = averaged(&spur, overlap);
            assert!((pair.integral() / spur.integral() - 1.0).abs() < 1e-11, "{overlap}");
            let total = mesh::total(&pair);
            let values: Vec<f64> = (0..100).map(|i| total.value(f64::from(i) / 100.0)).collect();
            let spread = values.iter().fold(0.0_f64, |m, v| m.max((v / spur.integral() - 1.0).abs()));
            let whole = overlap == overlap.round();
            assert!(if whole { spread < 1e-9 } else { spread > 0.01 }, "{overlap}: {spread}");
        }
    }

    #[test]
    fn theory_of_rectangular_pairs_the_variation_is_that_of_the_contact_lines_length() {
        // Fourier coefficient n of the sum: sin(pi n e) / (pi n) of the path times sin(pi n o) / (pi n o) of the face.
        let (contact, overlap) = (1.62, 0.71);
        let total = mesh::total(&averaged(&rectangle(contact), overlap));
        let points = 20_000;
        for n in 1..=4 {
            let w = std::f64::consts::PI * f64::from(n);
            let closed = (w * contact).sin() / w * (w * overlap).sin() / (w * overlap);
            let (mut re, mut im) = (0.0, 0.0);
            for i in 0..points {
                let s = (f64::from(i) + 0.5) / f64::from(points);
                let (sin, cos) = (2.0 * w * s).sin_cos();
                re += total.value(s) * cos / f64::from(points);
                im += total.value(s) * sin / f64::from(points);
            }
            assert!((re.hypot(im) - closed.abs()).abs() < 1e-7, "{n}: {} {closed}", re.hypot(im));
        }
    }
}
