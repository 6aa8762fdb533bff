//! Roots of a step's polynomial: event times without sampling.
//!
//! Intervals are bisected until the Taylor form about the middle proves either that the polynomial has
//! no zero in it (the constant term outweighs all others) or that it is monotone (the slope outweighs
//! its own variation); monotone intervals with a change of sign are finished by safeguarded Newton
//! steps. No root of odd multiplicity is missed; a double root is reported when it is resolved to
//! rounding. Cost: one O(degree^2) shift per interval looked at.

use crate::piecewise::{horner, shift_scale};

/// Smallest interval width looked at, relative to the normalised step.
const RESOLUTION: f64 = 1e-13;

/// The first zero of the polynomial `p` (lowest power first) in `(from, to]`, if any.
pub fn first_root(p: &[f64], from: f64, to: f64) -> Option<f64> {
    let mut pending = vec![(from, to)];
    while let Some((a, b)) = pending.pop() {
        let (middle, radius) = (0.5 * (a + b), 0.5 * (b - a));
        let local = shift_scale(p, middle, radius);
        let rest: f64 = local[1..].iter().map(|c| c.abs()).sum();
        if local[0].abs() > rest {
            continue;
        }
        let bend: f64 = local.iter().enumerate().skip(2).map(|(n, c)| n as f64 * c.abs()).sum();
        let monotone = local.get(1).is_some_and(|slope| slope.abs() > bend);
        if monotone || radius < RESOLUTION {
            let (pa, pb) = (horner(p, a), horner(p, b));
            if pb == 0.0 {
                return Some(b);
            }
            if pa != 0.0 && (pa < 0.0) != (pb < 0.0) {
                return Some(bracketed(p, a, b));
            }
            continue;
        }
        pending.push((middle, b));
        pending.push((a, middle));
    }
    None
}

/// All zeros of odd multiplicity of `p` in `(from, to]`, ascending.
pub fn all_roots(p: &[f64], from: f64, to: f64) -> Vec<f64> {
    let mut roots = Vec::new();
    let mut start = from;
    while let Some(root) = first_root(p, start, to) {
        roots.push(root);
        start = root + RESOLUTION.max(4.0 * f64::EPSILON * root.abs());
        if start >= to {
            break;
        }
    }
    roots
}

/// The zero of `p` in `[a, b]`, whose ends have opposite signs.
fn bracketed(p: &[f64], mut a: f64, mut b: f64) -> f64 {
    let rising = horner(p, b) > 0.0;
    let mut x = 0.5 * (a + b);
    for _ in 0..80 {
        let (mut value, mut slope) = (0.0, 0.0);
        for &c in p.iter().rev() {
            slope = slope * x + value;
            value = value * x + c;
        }
        if (value > 0.0) == rising {
            b = x
        } else {
            a = x
        }
        let newton = x - value / slope;
        if value == 0.0 || (newton - x).abs() <= 2.0 * f64::EPSILON * x.abs().max(1e-3) {
            return x;
        }
        x = if newton > a && newton < b { newton } else { 0.5 * (a + b) };
    }
    x
}
