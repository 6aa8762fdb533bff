//! Adaptive Gauss-Legendre quadrature for the beam integrals.
//!
//! Healthy teeth have smooth integrands and pass at the first look (relative 1e-12); a crack adds a kink,
//! which bisection encloses. Cost: 45 evaluations for a smooth integrand.

use std::sync::OnceLock;

const POINTS: usize = 15;
const TOLERANCE: f64 = 1e-12;

/// Nodes and weights on [-1, 1].
fn rule() -> &'static [(f64, f64); POINTS] {
    static RULE: OnceLock<[(f64, f64); POINTS]> = OnceLock::new();
    RULE.get_or_init(|| {
        std::array::from_fn(|i| {
            let n = POINTS as f64;
            let mut x = (std::f64::consts::PI * (i as f64 + 0.75) / (n + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..20 {
                let (mut before, mut now) = (1.0, x);
                for k in 2..=POINTS {
                    let k = k as f64;
                    (before, now) = (now, ((2.0 * k - 1.0) * x * now - (k - 1.0) * before) / k);
                }
                slope = n * (x * now - before) / (x * x - 1.0);
                x -= now / slope;
            }
            (x, 2.0 / ((1.0 - x * x) * slope * slope))
        })
    })
}

/// Integrals of the `N` components of `f` over `[from, to]`.
pub fn integrate<const N: usize>(from: f64, to: f64, f: &impl Fn(f64) -> [f64; N]) -> [f64; N] {
    refine(from, to, f, panel(from, to, f), [0.0; N], 0)
}

/// The same of an integrand that one rule of 15 points is enough for.
pub fn panel<const N: usize>(from: f64, to: f64, f: &impl Fn(f64) -> [f64; N]) -> [f64; N] {
    let (half, middle) = (0.5 * (to - from), 0.5 * (to + from));
    let mut sum = [0.0; N];
    for &(x, w) in rule() {
        for (sum, value) in sum.iter_mut().zip(f(middle + half * x)) {
            *sum += w * half * value;
        }
    }
    sum
}

fn refine<const N: usize>(
    from: f64,
    to: f64,
    f: &impl Fn(f64) -> [f64; N],
    whole: [f64; N],
    scale: [f64; N],
    depth: u32,
) -> [f64; N] {
    let middle = 0.5 * (from + to);
    let (left, right) = (panel(from, middle, f), panel(middle, to, f));
    let both: [f64; N] = std::array::from_fn(|i| left[i] + right[i]);
    let scale: [f64; N] = std::array::from_fn(|i| scale[i].max(both[i].abs()));
    if depth >= 40 || (0..N).all(|i| (both[i] - whole[i]).abs() <= TOLERANCE * scale[i]) {
        return both;
    }
    let left = refine(from, middle, f, left, scale, depth + 1);
    let right = refine(middle, to, f, right, scale, depth + 1);
    std::array::from_fn(|i| left[i] + right[i])
}
