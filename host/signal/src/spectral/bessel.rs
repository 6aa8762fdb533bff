//! Modified Bessel function of order zero, which the Kaiser windows of filters and interpolators are made of.

/// `I0(x)` by its power series (Abramowitz, Stegun 9.6.12), to rounding. Terms grow until `k = x / 2`: meant for
/// window parameters, `|x| < 50`.
pub fn bessel_i0(x: f64) -> f64 {
    let quarter = 0.25 * x * x;
    let (mut term, mut sum, mut k) = (1.0, 1.0, 1.0);
    while term > 1e-17 * sum {
        term *= quarter / (k * k);
        sum += term;
        k += 1.0;
    }
    sum
}
