//! The engagement ramp: over which angle a pair takes up and gives off its share of the load.
//!
//! The idealised pair switches on at once; then the acceleration jumps within a sample and its bandwidth is
//! infinite. Any bandwidth law is therefore a statement about this ramp, which is why it is a parameter here:
//!
//! * `linear`, `raised-cosine`: a given width inside the path at both ends. `paper` is a linear 1 mrad of pinion
//!   rotation, the step of a stiffness table, calibrated on the one bandwidth that the paper's text preserves.
//! * `tip-relief`, `loaded`: from the static share of the load. Pairs at separations `e_i` carry
//!   `k_i (delta - e_i)` where positive, together the mesh force; the curve is the *secant* `k_i (1 - e_i/delta)`
//!   at the torque given. It is exact for the static force at that torque and an approximation beside it.
//!   Outside the path the pair keeps the stiffness it has at the border (corner contact is not modelled).

use super::approach::gap_m;
use super::pair::fit_adaptive;
use crate::machine::{Engagement, EngagementKind, Geometry, Side};
use crate::piecewise::PiecewisePolynomial;
use crate::{Error, Result};

/// Width of the `paper` preset, pinion rotation in rad.
pub const PAPER_WIDTH_RAD: f64 = 1e-3;
/// Deviation of a ramped curve from its definition, relative to its largest value.
const TOLERANCE: f64 = 1e-9;

/// Puts the declared engagement on a pair's curve (abscissa in base pitches, from the start of contact).
///
/// The result may begin before 0 and end after the contact ratio (`loaded`).
///
/// # Errors
/// A ramp wider than half the path, a load-dependent kind without torque, or a load too small to keep a relieved
/// pair in contact.
pub fn engage(
    curve: &PiecewisePolynomial,
    geometry: &Geometry,
    engagement: &Engagement,
) -> Result<PiecewisePolynomial> {
    let width = engagement.width_rad.unwrap_or(PAPER_WIDTH_RAD);
    match engagement.kind {
        EngagementKind::None => Ok(curve.clone()),
        EngagementKind::Paper | EngagementKind::Linear => weigh(curve, geometry, width, |u| u),
        EngagementKind::RaisedCosine => weigh(curve, geometry, width, |u| 0.5 - 0.5 * (std::f64::consts::PI * u).cos()),
        EngagementKind::TipRelief | EngagementKind::Loaded => {
            let torque = engagement.torque_n_m.ok_or_else(|| {
                Error::invalid("[engagement] torque_n_m", "missing: this kind of engagement depends on the load")
            })?;
            Sharing::new(curve, geometry, engagement, torque / geometry.base_radius_m[0]).secant()
        }
    }
}

/// Multiplies with a rise and a fall of `width_rad` inside the path; `shape` maps 0..1 to 0..1.
fn weigh(
    curve: &PiecewisePolynomial,
    geometry: &Geometry,
    width_rad: f64,
    shape: impl Fn(f64) -> f64,
) -> Result<PiecewisePolynomial> {
    let width = geometry.base_pitches_per_rotation(width_rad);
    let (start, end) = ends(curve);
    if 2.0 * width > end - start {
        let longest = width_rad * 0.5 * (end - start) / width;
        return Err(Error::invalid(
            "[engagement] width_rad",
            format!("{width_rad} rad at both ends is longer than the path of contact; at most {longest:.4} rad"),
        ));
    }
    let mut knots = curve.knots().to_vec();
    knots.extend([start + width, end - width]);
    Ok(fit_adaptive(tidy(knots), TOLERANCE, |s| {
        curve.value(s) * shape(((s - start) / width).clamp(0.0, 1.0)) * shape(((end - s) / width).clamp(0.0, 1.0))
    }))
}

/// Static share of the load between neighbouring pairs with separations.
struct Sharing<'a> {
    curve: &'a PiecewisePolynomial,
    geometry: &'a Geometry,
    relief: [f64; 2],
    length: f64,
    exponent: i32,
    force: f64,
}

/// How far outside the path a contact is looked for, base pitches.
const REACH: f64 = 0.5;

impl<'a> Sharing<'a> {
    fn new(curve: &'a PiecewisePolynomial, geometry: &'a Geometry, engagement: &Engagement, force: f64) -> Self {
        let relieved = engagement.kind == EngagementKind::TipRelief;
        Self {
            curve,
            geometry,
            relief: if relieved { engagement.relief_m.unwrap_or([0.0; 2]) } else { [0.0; 2] },
            length: engagement.relief_length_base_pitches.unwrap_or(0.2),
            exponent: engagement.relief_exponent.unwrap_or(1) as i32,
            force,
        }
    }

    /// Separation of a pair at `s`, m: relief near the ends, the approach gap outside them.
    fn separation(&self, s: f64) -> f64 {
        let (start, end) = ends(self.curve);
        let relieved = |amount: f64, inside: f64| {
            if inside < self.length { amount * (1.0 - inside.max(0.0) / self.length).powi(self.exponent) } else { 0.0 }
        };
        // The gear's tip meets the pinion's root at the start, the pinion's tip works at the end.
        let mut gap = relieved(self.relief[1], s - start) + relieved(self.relief[0], end - s);
        if s < start {
            gap += gap_m(self.geometry, Side::Pinion, start - s);
        }
        if s > end {
            gap += gap_m(self.geometry, Side::Gear, s - end);
        }
        gap
    }

    /// Stiffness of a pair that touches at `s`, N/m.
    fn stiffness(&self, s: f64) -> f64 {
        let (start, end) = ends(self.curve);
        self.curve.value(s.clamp(start, end - 1e-12 * end))
    }

    /// Mesh deflection, m, with a pair at `s` and its neighbours one base pitch apart.
    fn deflection(&self, s: f64) -> f64 {
        let (start, end) = ends(self.curve);
        let first = ((start - REACH - s).ceil()) as i32;
        let last = ((end + REACH - s).floor()) as i32;
        let mut pairs: Vec<(f64, f64)> =
            (first..=last).map(|n| s + f64::from(n)).map(|p| (self.stiffness(p), self.separation(p))).collect();
        // Dropping a pair that does not touch lowers the deflection, so no dropped pair comes back.
        loop {
            let (stiff, pushed) = pairs.iter().fold((0.0, 0.0), |(k, f), &(ki, ei)| (k + ki, f + ki * ei));
            let deflection = (self.force + pushed) / stiff;
            let before = pairs.len();
            pairs.retain(|&(_, e)| e < deflection);
            if pairs.len() == before {
                return deflection;
            }
        }
    }

    fn share(&self, s: f64) -> f64 {
        (1.0 - self.separation(s) / self.deflection(s)).max(0.0)
    }

    /// The secant curve.
    fn secant(&self) -> Result<PiecewisePolynomial> {
        let (start, end) = ends(self.curve);
        let begin = self.border(start - REACH, 0.5 * (start + end))?;
        let finish = self.border(end + REACH, 0.5 * (start + end))?;
        // Where a pair is alone on a relieved flank the mesh follows the flank: a transmission error.
        let reach = [self.relief[1], self.relief[0]].map(|amount| if amount > 0.0 { self.length } else { 0.0 });
        if finish - begin < 1.0 || start + reach[0] > finish - 1.0 || end - reach[1] < begin + 1.0 {
            return Err(Error::impossible(
                "[engagement]",
                format!(
                    "at {:.1} N mesh force the relief reaches into single contact, where it is a transmission error \
                     and \
                     not a ramp: shorten it, reduce it, or declare it as a profile error",
                    self.force
                ),
            ));
        }
        // Every event of any pair bends this pair's share, one base pitch away.
        let mut knots = vec![begin, finish];
        for event in [begin, finish, start, end, start + self.length, end - self.length] {
            let relieved = self.relief != [0.0; 2];
            if !relieved && (event - start - self.length).abs().min((event - end + self.length).abs()) < 1e-12 {
                continue;
            }
            knots.extend((-4..=4).map(|n| event + f64::from(n)).filter(|&s| s > begin && s < finish));
        }
        for &knot in self.curve.knots() {
            knots.extend(Some(knot).filter(|&s| s > begin && s < finish));
        }
        Ok(fit_adaptive(tidy(knots), TOLERANCE, |s| self.stiffness(s) * self.share(s)))
    }

    /// Where the pair begins to touch, searched from `outside` towards `inside`.
    fn border(&self, outside: f64, inside: f64) -> Result<f64> {
        let (mut open, mut shut) = (outside, inside);
        if self.share(shut) <= 0.0 {
            return Err(Error::impossible("[engagement]", "the relief exceeds the deflection even in mid path"));
        }
        // The separation falls monotonically towards the path's middle, so the border is unique.
        for _ in 0..200 {
            let middle = 0.5 * (open + shut);
            if self.share(middle) > 0.0 { shut = middle } else { open = middle }
        }
        Ok(shut)
    }
}

/// First and last abscissa of a curve.
fn ends(curve: &PiecewisePolynomial) -> (f64, f64) {
    let knots = curve.knots();
    (knots[0], knots[knots.len() - 1])
}

/// Sorted knots without near-duplicates.
fn tidy(mut knots: Vec<f64>) -> Vec<f64> {
    knots.sort_by(f64::total_cmp);
    knots.dedup_by(|b, a| *b - *a < 1e-9);
    knots
}
