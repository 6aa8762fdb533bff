//! A mode's response to a line that is swept through it.
//!
//! A mode remembers for about `1 / (2 pi zeta f)`. Where the line moves on meanwhile, its response is late, lower and
//! broader than the steady one, and rings on at the mode's own frequency when the line has passed. With a half-width
//! of 6 Hz and the fourth mesh harmonic moving by 60 Hz a second the difference is more than a fifth of the peak; it
//! stands beside the mesh line, where sidebands are looked for. For a rate of change that holds as long as the mode
//! remembers the response is known: `integral over tau > 0 of exp(-s tau + i r tau^2 / 2)`, with `s` the distance
//! from the pole and `r` the rate, an error function of complex argument (Lewis 1932, Trans. ASME 54; Hok 1948, J.
//! Appl. Phys. 19), here as Faddeeva's w by Weideman's rational series (SIAM J. Numer. Anal. 31, 1994). Cost: forty
//! multiplications. Limit: a rate that changes within the mode's memory, as where a run-up begins.

use rustfft::num_complex::Complex64;
use std::f64::consts::{PI, SQRT_2, TAU};
use std::sync::LazyLock;

/// A pole: frequency, Hz, and damping ratio.
pub type Pole = [f64; 2];

/// Terms of the series: errors below 1e-6.
const TERMS: usize = 16;
/// Square of the distance from the pole over the rate from which the first terms in the rate are enough.
const MIN_ASYMPTOTE_RATIO: f64 = 400.0;
/// Nepers by which a ringing has decayed that is left out.
const DECAY_NEPERS: f64 = 16.0;

/// The series' scale and coefficients, the highest power first.
static SERIES: LazyLock<(f64, [f64; TERMS])> = LazyLock::new(|| {
    let scale = (TERMS as f64 / SQRT_2).sqrt();
    let points = 2 * TERMS;
    let value = |k: i32| {
        let t = scale * (f64::from(k) * PI / (2.0 * points as f64)).tan();
        (-t * t).exp() * (scale * scale + t * t)
    };
    let last = points as i32 - 1;
    let coefficient = |n: usize| {
        let part = |k: i32| value(k) * (n as f64 * f64::from(k) * PI / points as f64).cos();
        (-last..=last).map(part).sum::<f64>() / (2.0 * points as f64)
    };
    (scale, std::array::from_fn(|i| coefficient(TERMS - i)))
});

/// Faddeeva's w in the upper half-plane.
fn faddeeva(z: Complex64) -> Complex64 {
    let (scale, coefficients) = &*SERIES;
    let iz = Complex64::new(-z.im, z.re);
    let below = 1.0 / (*scale - iz);
    let ratio = (*scale + iz) * below;
    let sum = coefficients.iter().fold(Complex64::ZERO, |sum, a| sum * ratio + *a);
    (2.0 * sum * below + 1.0 / PI.sqrt()) * below
}

/// `integral over tau > 0 of exp(-s tau + i r tau^2 / 2)`, with a positive real part of `s`.
fn memory(s: Complex64, r: f64) -> Complex64 {
    let rate = Complex64::new(0.0, r);
    let square = s * s;
    // What rings on: `exp(i s^2 / (2 r))`, once the line has passed.
    let has_passed = s.im * r.signum() > s.re;
    let rings = has_passed && s.re * s.im.abs() < DECAY_NEPERS * r.abs();
    if square.norm_sqr() > MIN_ASYMPTOTE_RATIO * MIN_ASYMPTOTE_RATIO * r * r && !rings {
        let small = rate / square;
        return (1.0 + small * (1.0 + 3.0 * small)) / s;
    }
    // sqrt(-i r / 2), in the right half-plane.
    let root = Complex64::new(1.0, -r.signum()) * (0.5 * r.abs().sqrt());
    let z = Complex64::I * s / (2.0 * root);
    let half = 0.5 * PI.sqrt() / root;
    if z.im >= 0.0 { half * faddeeva(z) } else { half * (2.0 * (-z * z).exp() - faddeeva(-z)) }
}

/// A mode's response at a frequency that moves by `sweep_hz_s`, over that of a steady line; about one in size at its
/// peak.
pub fn resonance([own_hz, damping]: Pole, hz: f64, sweep_hz_s: f64) -> Complex64 {
    if sweep_hz_s == 0.0 || damping >= 1.0 {
        return 2.0 * damping * hz * hz / Complex64::new(own_hz * own_hz - hz * hz, 2.0 * damping * hz * own_hz);
    }
    let own = TAU * own_hz;
    let pole = own * Complex64::new(-damping, (1.0 - damping * damping).sqrt());
    let residue = (2.0 * damping * own * pole + own * own) / Complex64::new(0.0, 2.0 * pole.im);
    let (q, r) = (Complex64::new(0.0, TAU * hz), TAU * sweep_hz_s);
    -2.0 * damping * (1.0 - residue * memory(q - pole, r) - residue.conj() / (q - pole.conj()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By small steps through time.
    fn stepped([own_hz, damping]: Pole, from_hz: f64, to_hz: f64, sweep_hz_s: f64) -> Complex64 {
        let own = TAU * own_hz;
        let pole = own * Complex64::new(-damping, (1.0 - damping * damping).sqrt());
        let residue = (2.0 * damping * own * pole + own * own) / Complex64::new(0.0, 2.0 * pole.im);
        let steps = 400_000;
        let step_s = (to_hz - from_hz) / sweep_hz_s / f64::from(steps);
        let mut states = [
            1.0 / (Complex64::new(0.0, TAU * from_hz) - pole),
            1.0 / (Complex64::new(0.0, TAU * from_hz) - pole.conj()),
        ];
        for i in 0..steps {
            let hz = from_hz + sweep_hz_s * step_s * (f64::from(i) + 0.5);
            for (state, pole) in states.iter_mut().zip([pole, pole.conj()]) {
                let rate = pole - Complex64::new(0.0, TAU * hz);
                let turned = (rate * step_s).exp();
                *state = *state * turned + (turned - 1.0) / rate;
            }
        }
        -2.0 * damping * (1.0 - residue * states[0] - residue.conj() * states[1])
    }

    #[test]
    fn theory_a_swept_mode_answers_as_its_equation_of_motion_does() {
        let pole = [500.0, 0.012];
        for (from, sweep) in [(300.0, 60.0), (700.0, -150.0), (300.0, 15.0)] {
            for to in [470.0, 495.0, 500.0, 503.0, 510.0, 530.0] {
                let (own, steady) = (resonance(pole, to, sweep), resonance(pole, to, 0.0));
                let truth = stepped(pole, from, to, sweep);
                assert!(
                    (own - truth).norm() < 1e-4,
                    "{to} Hz, {sweep} Hz/s: {own} instead of {truth}, steady {steady}"
                );
            }
        }
        assert!((resonance(pole, 500.0, 60.0) - resonance(pole, 500.0, 0.0)).norm() > 0.2);
    }

    #[test]
    fn theory_a_slow_sweep_is_a_steady_line() {
        for hz in [100.0, 480.0, 500.0, 530.0, 2000.0] {
            let [slow, none] = [1e-4, 0.0].map(|sweep| resonance([500.0, 0.012], hz, sweep));
            assert!((slow - none).norm() < 1e-5, "{hz}");
        }
    }
}
