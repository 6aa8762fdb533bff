//! What stands above the noise although nothing that was tried fits it: said, with its place, rather than passed over
//! in silence.
//!
//! The residual's power next to the declared parameters is compared with that of the local noise. Records with
//! nothing hidden leave 0.98 to 1.03 times their noise (`meshband prove --null 12 --seconds 1 --verbose`, seeds 94
//! and 95), so the gate's threshold ([`accept`]) is far outside chance. Limit: a machine that is declared badly
//! leaves a remainder as well; the verdict says that something is missing, not what.

use super::accept;
use super::base_fit::Base;
use super::least_squares::Data;
use super::outcome::{Effect, Evidence};
use super::probability::Probability;
use crate::observation::spectrum::Bins;

/// Bound of its probability by chance: none of 200 records with nothing hidden reached it (rule of three).
const CHANCE: f64 = 0.015;

/// Power of a residual, and of the local noise and the model's own slack in it.
pub fn power_and_noise(base: &Base, residual: &[[Bins; 2]], runs: &[usize]) -> (f64, f64) {
    let (mut power, mut noise) = (0.0, 1e-300);
    let lowest = (8.0 * base.analyser.duration_s()) as usize;
    for &r in runs {
        for (channel, bins) in residual[r].iter().enumerate() {
            power += bins.iter().skip(lowest).map(|x| x.norm_sqr()).sum::<f64>();
            noise += base.unexplainable(r, channel, bins).iter().skip(lowest).sum::<f64>();
        }
    }
    (power, noise)
}

/// Power beyond noise at mesh orders, at other orders of the shafts, and elsewhere; and the noise.
fn by_place(base: &Base, rest: &Data, runs: &[usize]) -> ([f64; 3], f64) {
    let duration_s = base.analyser.duration_s();
    let teeth = base.machine.teeth.map(f64::from);
    let ratio = teeth[0] / teeth[1];
    let (mut beyond, mut noise) = ([0.0; 3], 1e-300);
    for &r in runs {
        let per_bin = 1.0 / (duration_s * base.runs[r].angle.shaft_hz);
        // Within one bin and a half of a whole multiple, which is the main lobe.
        let near = |order: f64, step: f64| (order / step - (order / step).round()).abs() * step < 1.5 * per_bin;
        for (channel, bins) in rest.residual[r].iter().enumerate() {
            let levels = base.unexplainable(r, channel, bins);
            for (b, (x, level)) in bins.iter().zip(levels).enumerate().skip((8.0 * duration_s) as usize) {
                let order = b as f64 * per_bin;
                let place = match () {
                    () if near(order, teeth[0]) => 0,
                    () if near(order, 1.0) || near(order, ratio) => 1,
                    () => 2,
                };
                beyond[place] += x.norm_sqr() - level;
                noise += level;
            }
        }
    }
    (beyond, noise)
}

/// A generic verdict on the remainder `rest` of the runs seen, where it stands above the noise.
pub fn remainder(base: &Base, rest: &Data, runs: &[usize]) -> Option<Effect> {
    let (beyond, noise) = by_place(base, rest, runs);
    let over = 1.0 + beyond.iter().sum::<f64>() / noise;
    if !accept::remainder_is_there(over) {
        return None;
    }
    let largest = (0..3).max_by(|&a, &b| beyond[a].total_cmp(&beyond[b])).unwrap_or(2);
    let family = ["mesh-order", "shaft-order", "other"][largest];
    let place = ["at mesh orders", "at orders of the shafts", "at orders of neither shaft"][largest];
    Some(Effect {
        verdict: "generic".into(),
        name: format!(
            "remainder of {over:.2} times the noise's power that nothing in the library fits, mostly {place}"
        ),
        family: family.into(),
        shaft: "none".into(),
        evidence: Evidence { chance: Some(Probability::of(CHANCE)), left_at_its_lines: 1.0, ..Evidence::default() },
        deciding_experiment: Some("runs at more speeds and torques, and with the sensor at a second place".into()),
        ..Effect::default()
    })
}
