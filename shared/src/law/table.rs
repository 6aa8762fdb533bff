//! The tabulated law: knots in speed and bandwidth with a monotone cubic between their logarithms.
//!
//! Around the knee between the mode-limited and the ramp-limited range no form with two or three coefficients follows
//! the bandwidth. Piecewise cubic Hermite in log speed and log bandwidth, its slopes weighted harmonic means of the
//! secants (Fritsch and Butland 1984), follows it and never overshoots its knots. Above the last knot the bandwidth
//! is proportional to speed (ramp-limited), below the first constant (mode-limited). The host's `law::table` is the
//! same in double precision; the two agree within 1e-5.
//!
//! Cost: four to nine logarithms and an exponential, about 900 instructions; once per block.

use crate::law::LawError;
use crate::math;
use crate::units::Hertz;
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Most knots of a table.
pub const MAX_KNOTS: usize = 24;

/// One point of a tabulated law.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LawKnot {
    /// Pinion rate.
    pub speed: Hertz,
    /// Bandwidth at that rate.
    pub bandwidth: Hertz,
}

/// Knots of ascending speed; serialised as a sequence of the knots in use.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(from = "Vec<LawKnot, MAX_KNOTS>", into = "Vec<LawKnot, MAX_KNOTS>")]
pub struct LawTable {
    knots: [LawKnot; MAX_KNOTS],
    count: u8,
}

impl From<Vec<LawKnot, MAX_KNOTS>> for LawTable {
    fn from(used: Vec<LawKnot, MAX_KNOTS>) -> Self {
        let mut table = Self { knots: [LawKnot::default(); MAX_KNOTS], count: used.len() as u8 };
        for (place, knot) in table.knots.iter_mut().zip(&used) {
            *place = *knot;
        }
        table
    }
}

impl From<LawTable> for Vec<LawKnot, MAX_KNOTS> {
    fn from(table: LawTable) -> Self {
        table.knots().iter().copied().collect()
    }
}

impl LawTable {
    /// A checked table.
    ///
    /// # Errors
    /// [`LawError::Table`] unless there are 2 to [`MAX_KNOTS`] knots, all positive and finite, with ascending speeds.
    pub fn new(knots: &[LawKnot]) -> Result<Self, LawError> {
        let table: Self = Vec::from_slice(knots).map_err(|_| LawError::Table)?.into();
        if table.is_sound() { Ok(table) } else { Err(LawError::Table) }
    }

    /// The knots, by ascending speed.
    pub fn knots(&self) -> &[LawKnot] {
        &self.knots[..usize::from(self.count).min(MAX_KNOTS)]
    }

    /// Whether the table could have come from [`LawTable::new`]; received ones may not.
    pub(crate) fn is_sound(&self) -> bool {
        let positive = |x: Hertz| x.0.is_finite() && x.0 > 0.0;
        let knots = self.knots();
        knots.len() >= 2
            && knots.iter().all(|knot| positive(knot.speed) && positive(knot.bandwidth))
            && knots.windows(2).all(|pair| pair[0].speed.0 < pair[1].speed.0)
    }

    /// Bandwidth at a pinion rate, both in Hz; 0 for a table without knots.
    pub(crate) fn evaluate(&self, speed_hz: f32) -> f32 {
        let knots = self.knots();
        let (Some(first), Some(last)) = (knots.first(), knots.last()) else { return 0.0 };
        if speed_hz >= last.speed.0 {
            return last.bandwidth.0 * (speed_hz / last.speed.0);
        }
        if speed_hz > first.speed.0 {
            let above = knots.partition_point(|knot| knot.speed.0 <= speed_hz);
            return between(knots, above - 1, speed_hz);
        }
        first.bandwidth.0
    }
}

/// The cubic from knot `i` to the next one.
fn between(knots: &[LawKnot], i: usize, speed_hz: f32) -> f32 {
    // Relative to knot i, so that the logarithms stay small and keep their digits.
    let knot = |k: usize| knots.get(k).copied().unwrap_or_default();
    let (speed, bandwidth) = (knot(i).speed.0, knot(i).bandwidth.0);
    let x = |k: usize| math::ln(knot(k).speed.0 / speed);
    let y = |k: usize| math::ln(knot(k).bandwidth.0 / bandwidth);
    let last = knots.len() - 1;
    let secant = |k: usize| (y(k + 1) - y(k)) / (x(k + 1) - x(k));
    let slope = |k: usize| {
        if k == 0 || k == last {
            return secant(k.min(last - 1));
        }
        let (before, after) = (secant(k - 1), secant(k));
        if before * after <= 0.0 {
            return 0.0;
        }
        let (left, right) = (x(k) - x(k - 1), x(k + 1) - x(k));
        let (w1, w2) = (2.0 * right + left, right + 2.0 * left);
        (w1 + w2) / (w1 / before + w2 / after)
    };
    let (h, rise) = (x(i + 1), y(i + 1));
    let t = math::ln(speed_hz / speed) / h;
    let rest = 1.0 - t;
    let log = h * slope(i) * t * rest * rest + rise * t * t * (3.0 - 2.0 * t) - h * slope(i + 1) * t * t * rest;
    bandwidth * math::exp(log)
}
