//! Which orders the gear pair explains: mesh harmonics, orders of both shafts, sidebands of both about the mesh.
//!
//! A pair that is sound or damaged, but alone, has lines at `k z1`, `k z1 +- n`, `k z1 +- m z1/z2`, `n` and
//! `m z1/z2`: the whole orders of either shaft. Both shafts at once (`k z1 +- n +- m z1/z2`) are taken up to the
//! second order of each: all of them together would be every multiple of one over the hunting period and explain
//! anything. Limit: a ghost line on a whole order of a shaft is explained here; the averages show it.

use super::angle::Angle;
use super::skirts::Skirts;

/// Highest order of each shaft in sidebands of both at once.
const BOTH: i32 = 2;
/// Share of the slower shaft's order within which a weaker line belongs to a strong one: slow swings of load and speed.
const SLOW: f64 = 0.25;
/// Power by which the known line must exceed a slow swing's.
const STRONGER: f64 = 4.0;

/// The pair's orders, in orders of the pinion.
#[derive(Debug, Clone)]
pub struct Explained {
    teeth: f64,
    gear_order: f64,
    highest: f64,
    /// Feet of its lines in the spectrum at hand.
    pub skirts: Skirts,
}

impl Explained {
    /// Of a pair with `pinion_teeth`, up to `highest` order.
    pub fn new(pinion_teeth: u32, angle: &Angle, highest: f64) -> Self {
        Self { teeth: f64::from(pinion_teeth), gear_order: angle.gear_order, highest, skirts: Skirts::default() }
    }

    /// The same pair with the feet of another spectrum.
    pub fn with_skirts(&self, skirts: Skirts) -> Self {
        Self { skirts, ..self.clone() }
    }

    /// Whether a whole order of a shaft, or of both about the mesh, lies within `half_width` of `order`.
    pub fn at(&self, order: f64, half_width: f64) -> bool {
        distance(order, 1.0) <= half_width
            || distance(order, self.gear_order) <= half_width
            || self.about_mesh(order, half_width)
            || self.skirts.at(order, half_width)
    }

    /// Shaft orders and mesh harmonics only, with their feet: what an envelope shows of a sound pair.
    pub fn of_shafts(&self, order: f64, half_width: f64) -> bool {
        distance(order, 1.0) <= half_width
            || distance(order, self.gear_order) <= half_width
            || self.skirts.at(order, half_width)
    }

    fn about_mesh(&self, order: f64, half_width: f64) -> bool {
        let nearest = (order / self.teeth).round();
        (-1..=1).map(|k| (nearest + f64::from(k)) * self.teeth).filter(|mesh| *mesh > 0.0).any(|mesh| {
            let away = order - mesh;
            (-BOTH..=BOTH).any(|m| {
                let rest = away - f64::from(m) * self.gear_order;
                rest.abs() <= f64::from(BOTH) + 0.5 && distance(rest, 1.0) <= half_width
            })
        })
    }

    /// Whether a line of mean square `power` is a slow swing of a known line near it: next to a mesh harmonic always,
    /// next to other whole orders where those are stronger. `known` gives the power near an order.
    pub fn swings(&self, order: f64, power: f64, known: impl Fn(f64) -> f64) -> bool {
        let reach = SLOW * self.gear_order.min(1.0);
        let mesh = (order / self.teeth).round() * self.teeth;
        if mesh > 0.0 && mesh <= self.highest + reach && (order - mesh).abs() <= reach {
            return true;
        }
        [1.0, self.gear_order].into_iter().any(|shaft| {
            let nearest = (order / shaft).round() * shaft;
            nearest > 0.0 && (order - nearest).abs() <= reach && known(nearest) > STRONGER * power
        })
    }
}

/// Distance to the nearest multiple, from the first on.
fn distance(order: f64, of: f64) -> f64 {
    (order - (order / of).round().max(1.0) * of).abs()
}
