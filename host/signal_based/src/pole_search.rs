//! Resonances that all lines of a run-up pass: poles shared by every line and channel.
//!
//! One after the other, the pole (frequency and damping on a grid) whose function of frequency, with a free residue
//! in every line that is swept near it, takes most off what the functions so far leave of all of them; until none
//! pays for its residues (Bayesian information criterion). All are refined together after each ([`super::pole_fit`]);
//! functions are meaned over stretches of turns as the courses are. The same idea as least-squares complex frequency
//! domain fits, on amplitudes of lines instead of a frequency response. Only where the speed moves by a tenth: a
//! wander hardly sweeps anything, and a spline follows it.

use super::basis::Basis;
use super::pole_fit;
use super::speed_sweep::{Course, Sweep};
use super::swept_mode::Pole;
use rayon::prelude::*;
use rustfft::num_complex::Complex64;

/// Most poles.
const MAX_POLES: usize = 20;
/// Steps of the frequency grid, and dampings.
const STEP: f64 = 1.02;
const DAMPINGS: [f64; 3] = [0.012, 0.025, 0.05];
/// Gain in the criterion that a pole must bring.
const LEAST_GAIN: f64 = 20.0;

/// The poles that the courses pay for, ascending.
pub fn found(sweep: &Sweep, courses: &[Course]) -> Vec<Pole> {
    let straight = Basis::of_speeds(&sweep.states, 2);
    let lines = pole_fit::lines(courses);
    let mut poles: Vec<Pole> = Vec::new();
    let mut best = pole_fit::total(sweep, &lines, &straight, &poles);
    while poles.len() < MAX_POLES {
        let Some(pole) = proposed(sweep, courses, &straight, &poles) else { break };
        let mut more = poles.clone();
        more.push(pole);
        let with = pole_fit::fit(sweep, &lines, &straight, &mut more);
        if with > best - LEAST_GAIN {
            break;
        }
        (poles, best) = (more, with);
    }
    poles.sort_by(|a, b| a[0].total_cmp(&b[0]));
    poles
}

/// The pole of the grid that takes most off what is left.
fn proposed(sweep: &Sweep, courses: &[Course], straight: &Basis, poles: &[Pole]) -> Option<Pole> {
    let rests: Vec<(f64, Vec<Complex64>, f64)> = courses
        .par_iter()
        .map(|course| {
            let left = sweep.left(course, &straight.with_poles(&sweep.near(poles, course.order)));
            let power = sweep.power(&left);
            (course.order, left, power)
        })
        .collect();
    let orders = || courses.iter().map(|c| c.order);
    let (low, high) = (orders().fold(f64::INFINITY, f64::min), orders().fold(0.0, f64::max));
    let (low, high) = (low * sweep.range_hz.0, high * sweep.range_hz.1);
    let steps = ((high / low).ln() / STEP.ln()).max(0.0) as usize;
    let count = sweep.effective();
    let gain = |pole: Pole| -> f64 {
        let near = rests.iter().filter(|(order, ..)| !sweep.near(&[pole], *order).is_empty());
        let of_line = |(order, left, power): &(f64, Vec<Complex64>, f64)| {
            let (mut product, mut size) = (Complex64::default(), 0.0);
            let resonances = sweep.rows(*order, &Basis::of_pole(pole));
            for ((u, w), l) in resonances.chunks(2).map(|row| row[1]).zip(&sweep.weights).zip(left) {
                product += u.conj() * l;
                size += w * u.norm_sqr();
            }
            let taken = (product.norm_sqr() / size.max(f64::MIN_POSITIVE)).min(0.999 * power);
            -count * (1.0 - taken / power.max(f64::MIN_POSITIVE)).ln() - count.ln()
        };
        near.map(of_line).sum()
    };
    let grid: Vec<Pole> = (0..=steps)
        .flat_map(|i| DAMPINGS.map(|damping| [low * STEP.powi(i as i32), damping]))
        .filter(|pole| poles.iter().all(|other| (pole[0] / other[0]).ln().abs() > 0.01))
        .collect();
    let best = grid.into_par_iter().map(|pole| (gain(pole), pole)).max_by(|a, b| a.0.total_cmp(&b.0))?;
    (best.0 > 0.0).then_some(best.1)
}

#[cfg(test)]
mod tests {
    use super::super::basis::State;
    use super::super::swept_mode::resonance;
    use super::*;

    #[test]
    fn theory_sharp_poles_are_placed_though_stretches_of_turns_cross_them_and_one_is_not_seen() {
        let truth = [[467.0, 0.012], [557.0, 0.02]];
        let speeds = (0..346).map(|turn| 18.0 + 25.0 * (f64::from(turn) / 345.0).sqrt());
        let turns: Vec<State> = speeds.map(State::steady).filter(|s| !(24.8..26.0).contains(&s.speed_hz)).collect();
        let sweep = Sweep::new(&turns, &vec![1.0; turns.len()], 4);
        let course = |order: f64| {
            let value = |state: &State| -> Complex64 {
                let own = |pole: Pole| resonance(pole, order * state.speed_hz, 0.0);
                Complex64::new(0.03, 0.01) + own(truth[0]) * Complex64::new(0.6, -0.8) + own(truth[1]) * 0.2
            };
            let turns: Vec<Complex64> = turns.iter().map(value).collect();
            Course { order, sums: turns.chunks(4).map(|part| part.iter().sum()).collect() }
        };
        let poles = found(&sweep, &[course(20.0), course(40.0)]);
        for own in truth {
            let best = poles.iter().map(|pole| (pole[0] / own[0] - 1.0).abs()).fold(f64::INFINITY, f64::min);
            assert!(best < 1e-3, "{own:?} among {poles:?}");
        }
        let sharpest = poles.iter().min_by(|a, b| (a[0] - 467.0).abs().total_cmp(&(b[0] - 467.0).abs()));
        assert!((sharpest.expect("a pole")[1] / 0.012 - 1.0).abs() < 0.1, "{poles:?}");
    }
}
