//! Which orders the gear pair explains: mesh harmonics, orders of both shafts, sidebands of both about the mesh.
//!
//! A pair that is sound or damaged, but alone, has lines at `k z1`, `k z1 +- n`, `k z1 +- m z1/z2`, `n` and
//! `m z1/z2`: the whole orders of either shaft. Both shafts at once (`k z1 +- n +- m z1/z2`) are taken up to the
//! second order of each: all of them together would be every multiple of one over the hunting period and explain
//! anything. Limit: a ghost line on a whole order of a shaft is explained here; the averages show it.

use super::angle::Angle;
use super::skirts::Skirts;
use crate::spectral;
use crate::train::{Gear, Train, families, lines};
use std::sync::Arc;

/// Highest order of each shaft in sidebands of both at once.
const MAX_COMMON_ORDER: i32 = 2;
/// Share of the slower shaft's order within which a weaker line belongs to a strong one: slow swings of load and speed.
const SWING_ORDER_SHARE: f64 = 0.25;
/// Power by which the known line must exceed a slow swing's.
const MIN_SWING_POWER_RATIO: f64 = 4.0;
/// Power of the mirror image of a slow swing's line, of the line's.
const MIN_MIRROR_POWER_RATIO: f64 = 0.25;
/// Bins on each side of an owned order that are locked to it.
const LOCKED_BINS: f64 = 1.0;

/// Orders that the parts of a train own, per turn of its input.
#[derive(Debug, Clone, Default)]
pub struct Owned {
    /// Shafts and members of sets, whose multiples are owned.
    pub shafts: Vec<f64>,
    /// Other orders, ascending.
    pub orders: Vec<f64>,
}

impl Owned {
    /// Of a train, up to `highest` order: what its sound meshes have, the lines of every fault, what motor and driven
    /// part bring along.
    pub fn of_train(train: &Train, highest: f64) -> Self {
        let all = families::all(train, highest);
        let mut orders: Vec<f64> = all.iter().flat_map(|family| family.lines.iter().map(|line| line.order)).collect();
        orders.extend(lines::of_sound_meshes(train, highest));
        orders.extend(lines::table(train).unwrap_or_default().iter().filter(|line| line.exact).map(|line| line.value));
        orders.sort_by(f64::total_cmp);
        let exact = (0..train.shafts.len()).filter(|shaft| train.exact[*shaft]);
        let mut shafts: Vec<f64> = exact.map(|shaft| train.shaft_order(shaft).value()).collect();
        let is_exact = |gear: &&Gear| train.mesh(gear.stage).is_some_and(|mesh| mesh.exact);
        let members = train.gears.iter().filter(is_exact).flat_map(|gear| [gear.rate, gear.speed]);
        shafts.extend(members.map(|speed| speed.magnitude().value()));
        shafts.retain(|order| *order > 0.0);
        shafts.sort_by(f64::total_cmp);
        shafts.dedup_by(|a, b| (*a - *b).abs() < 1e-12);
        Self { shafts, orders }
    }

    /// What is locked to any part of the train in samples of `turns` whole turns of its input: the bins about all
    /// owned orders.
    pub fn locked_part(&self, samples: &[f64], turns: usize) -> Vec<f64> {
        let forward = spectral::forward(samples.len());
        let (mut input, mut bins) = (samples.to_vec(), forward.make_output_vec());
        forward.process(&mut input, &mut bins).expect("buffers have the planned lengths");
        let half = LOCKED_BINS / turns as f64;
        for (i, bin) in bins.iter_mut().enumerate() {
            if !self.at(i as f64 / turns as f64, half) {
                *bin = Default::default();
            }
        }
        let mut locked = vec![0.0; samples.len()];
        let inverse = spectral::backward(samples.len());
        inverse.process(&mut bins, &mut locked).expect("buffers have the planned lengths");
        locked.iter_mut().for_each(|x| *x /= samples.len() as f64);
        locked
    }

    /// Whether an owned order lies within `half_width`.
    pub fn at(&self, order: f64, half_width: f64) -> bool {
        let after = self.orders.partition_point(|own| *own < order - half_width);
        self.of_shafts(order, half_width) || self.orders.get(after).is_some_and(|own| *own <= order + half_width)
    }

    /// Whether a multiple of a shaft's or member's order does.
    pub fn of_shafts(&self, order: f64, half_width: f64) -> bool {
        self.shafts.iter().any(|own| distance(order, *own) <= half_width)
    }
}

/// The pair's orders, in orders of the pinion; a train's in those of its input.
#[derive(Debug, Clone)]
pub struct Explained {
    teeth: f64,
    gear_order: f64,
    highest: f64,
    train: Option<Arc<Owned>>,
    /// Feet of its lines in the spectrum at hand.
    pub skirts: Skirts,
}

impl Explained {
    /// Of a pair with `pinion_teeth`, up to `highest` order.
    pub fn new(pinion_teeth: u32, angle: &Angle, highest: f64) -> Self {
        Self {
            teeth: f64::from(pinion_teeth),
            gear_order: angle.gear_order,
            highest,
            train: None,
            skirts: Skirts::default(),
        }
    }

    /// Of a train.
    pub fn of_train(owned: &Arc<Owned>, pinion_teeth: u32, angle: &Angle, highest: f64) -> Self {
        Self { train: Some(owned.clone()), ..Self::new(pinion_teeth, angle, highest) }
    }

    /// The same pair with the feet of another spectrum.
    pub fn with_skirts(&self, skirts: Skirts) -> Self {
        Self { skirts, ..self.clone() }
    }

    /// Whether a whole order of a shaft, or of both about the mesh, lies within `half_width` of `order`.
    pub fn at(&self, order: f64, half_width: f64) -> bool {
        if let Some(owned) = &self.train {
            return owned.at(order, half_width) || self.skirts.at(order, half_width);
        }
        distance(order, 1.0) <= half_width
            || distance(order, self.gear_order) <= half_width
            || self.about_mesh(order, half_width)
            || self.skirts.at(order, half_width)
    }

    /// Shaft orders and mesh harmonics only, with their feet: what an envelope shows of a sound pair.
    pub fn of_shafts(&self, order: f64, half_width: f64) -> bool {
        if let Some(owned) = &self.train {
            return owned.of_shafts(order, half_width) || self.skirts.at(order, half_width);
        }
        distance(order, 1.0) <= half_width
            || distance(order, self.gear_order) <= half_width
            || self.skirts.at(order, half_width)
    }

    fn about_mesh(&self, order: f64, half_width: f64) -> bool {
        let nearest = (order / self.teeth).round();
        (-1..=1).map(|k| (nearest + f64::from(k)) * self.teeth).filter(|mesh| *mesh > 0.0).any(|mesh| {
            let away = order - mesh;
            (-MAX_COMMON_ORDER..=MAX_COMMON_ORDER).any(|m| {
                let rest = away - f64::from(m) * self.gear_order;
                rest.abs() <= f64::from(MAX_COMMON_ORDER) + 0.5 && distance(rest, 1.0) <= half_width
            })
        })
    }

    /// Whether a line of mean square `power` is a slow swing of a known line near it: next to a mesh harmonic always,
    /// next to other whole orders where those are stronger by far, or where its mirror image stands on their other
    /// side, as modulation has it: a line that sweeps through a resonance leaves little in its own place. `known`
    /// gives the power near an order.
    pub fn swings(&self, order: f64, power: f64, known: impl Fn(f64) -> f64) -> bool {
        let reach = SWING_ORDER_SHARE * self.gear_order.min(1.0);
        let mesh = (order / self.teeth).round() * self.teeth;
        if mesh > 0.0 && mesh <= self.highest + reach && (order - mesh).abs() <= reach {
            return true;
        }
        [1.0, self.gear_order].into_iter().any(|shaft| {
            let nearest = (order / shaft).round() * shaft;
            if nearest <= 0.0 || (order - nearest).abs() > reach {
                return false;
            }
            let own = known(order);
            let is_mirrored = || known(nearest) > own && known(2.0 * nearest - order) > MIN_MIRROR_POWER_RATIO * own;
            known(nearest) > MIN_SWING_POWER_RATIO * power || is_mirrored()
        })
    }
}

/// Distance to the nearest multiple, from the first on.
fn distance(order: f64, of: f64) -> f64 {
    (order - (order / of).round().max(1.0) * of).abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_a_weaker_line_with_its_mirror_image_about_a_shaft_order_is_a_slow_swing() {
        let pair = Explained { teeth: 20.0, gear_order: 0.5, highest: 200.0, train: None, skirts: Skirts::default() };
        let power = |order: f64| match order {
            o if (o - 88.5).abs() < 1e-9 => 1.0,
            o if (o - 88.486).abs() < 1e-6 || (o - 88.514).abs() < 1e-6 => 0.3,
            o if (o - 68.486).abs() < 1e-6 => 0.3,
            o if (o - 68.5).abs() < 1e-9 => 1.0,
            _ => 1e-4,
        };
        assert!(pair.swings(88.486, 0.5, power) && pair.swings(88.514, 0.5, power));
        assert!(!pair.swings(68.486, 0.5, power), "on one side only: a line of its own");
        assert!(!pair.swings(88.7, 0.5, power), "out of reach");
    }
}
