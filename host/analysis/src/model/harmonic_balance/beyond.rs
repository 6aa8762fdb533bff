//! Mesh harmonics above those that the steady state is solved for: what a missing anti-alias filter folds into the
//! band.
//!
//! Solving for them as well would cost the cube of their number. Up there the bodies hardly move: what the solved
//! orders' approach makes of the stiffness is nearly the whole force, and the rest follows in a few sweeps. Cost: the
//! square of their number.

use super::{Dynamics, Machine, Solution};
use crate::model::forward::Line;
use rustfft::num_complex::Complex64 as C;
use std::f64::consts::TAU;
use std::ops::RangeInclusive;

/// Sweeps; each gains the square of the mesh's highest mode over the frequency.
const SWEEPS: usize = 6;

impl Machine {
    /// Accelerations at the mesh harmonics `range`, above the orders of `own`, the mesh's steady state at a speed:
    /// the stiffness answers the approach of these orders with forces on bodies that its mean ties together, and what
    /// the harmonics do to each other follows in a few sweeps (Jacobi), since the bodies hardly move up there.
    pub fn beyond(&self, own: &Solution, shaft_hz: f64, range: RangeInclusive<i64>) -> Vec<Line> {
        let half = (own.approach.len() / 2) as i64;
        let omega = |n: i64| TAU * shaft_hz * n as f64 * f64::from(self.teeth[0]);
        let harmonics: Vec<(i64, Dynamics, C)> = range
            .filter(|n| *n > half)
            .map(|n| {
                let answered = (-half..=half).map(|l| self.stiffness(n - l) * own.approach[(l + half) as usize]).sum();
                (n, self.dynamics(omega(n)), answered)
            })
            .collect();
        let approach_by = |n: i64, d: &Dynamics| -self.compliance(d) * C::new(1.0, omega(n) * self.tau_s);
        let mut force: Vec<C> = vec![C::ZERO; harmonics.len()];
        for _ in 0..SWEEPS {
            let approach: Vec<C> = harmonics.iter().zip(&force).map(|((n, d, _), f)| approach_by(*n, d) * f).collect();
            let next = |(n, d, answered): &(i64, Dynamics, C)| {
                let others = harmonics.iter().zip(&approach).filter(|((m, ..), _)| m != n);
                let others: C = others.map(|((m, ..), a)| self.stiffness(n - m) * a).sum();
                (answered + others) / (C::ONE - approach_by(*n, d) * self.coefficients[0])
            };
            force = harmonics.iter().map(next).collect();
        }
        let line = |((n, d, _), force): (&(i64, Dynamics, C), C)| {
            let [pinion, gear] = d.translation.map(|y| y * force * omega(*n).powi(2));
            Line { order: *n as f64 * f64::from(self.teeth[0]), amplitude: [pinion, -gear] }
        };
        harmonics.iter().zip(force).map(line).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drawn;
    use crate::model::forward::{ForwardModel, Operating};
    use rand::SeedableRng;

    /// Of a small machine with modes at 9 kHz: the steady state cut at 20 kHz gives the harmonics from there to 25
    /// kHz. What lies above 26 kHz is in none of both.
    #[test]
    fn theory_harmonics_above_a_cut_are_those_of_the_whole_steady_state() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1001);
        let declared = drawn::machine(&mut random).unwrap();
        let machine = Machine::new(&declared.pair, &declared.shafts, &declared.curve);
        let shaft_hz = 10.0;
        let whole = machine.run(Operating { shaft_hz, torque_n_m: 20.0 }).solution;
        let mesh_hz = shaft_hz * f64::from(machine.teeth[0]);
        let [cut, top] = [20_000.0, 25_000.0].map(|hz: f64| (hz / mesh_hz) as usize);
        let made = machine.beyond(&whole.within(cut), shaft_hz, cut as i64..=top as i64);
        let middle = whole.lines.len() / 2;
        let truth = &whole.lines[middle + cut + 1..=middle + top];
        assert_eq!(made.len(), truth.len());
        let power = |lines: &mut dyn Iterator<Item = [C; 2]>| lines.flatten().map(|a| a.norm_sqr()).sum::<f64>();
        let difference = |(a, b): (&Line, &Line)| [0, 1].map(|c| a.amplitude[c] - b.amplitude[c]);
        let error = power(&mut made.iter().zip(truth).map(difference)) / power(&mut truth.iter().map(|l| l.amplitude));
        assert!(error.sqrt() < 0.02, "{:.4}", error.sqrt());
    }
}
