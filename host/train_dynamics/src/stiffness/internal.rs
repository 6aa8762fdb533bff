//! A pinion inside a ring: contact ratio in closed form, stiffness by the energy method on the ring's own outline.
//!
//! A ring's tooth is the gap of the external gear of the same base circle: it is thicker the further out, and its load
//! presses it outwards to its root. With contact at radius r the flank's normal touches the base circle, so the moment
//! about a section at height x is `x cos a - rb`, with `a = tan(alpha_r) + pi/(2 z) - inv(alpha)` between force and the
//! perpendicular to the tooth's centre line. Assumptions: clamped at the root circle with the involute as outline up to
//! there (no fillet), a rigid rim, and a pinion whose tooth and body are those of an external pair; the contact term is
//! the linear one of external pairs. Source: the energy method as of `meshband_mechanics::stiffness::Tooth`; Liang,
//! Zuo and Patel, Proc. IMechE C 228 (2014) for ring teeth.

use super::transverse_pair;
use crate::machine::Toothing;
use crate::{Error, Result};
use meshband_mechanics::machine::{Geometry, Pair, involute};
use meshband_mechanics::stiffness::{BodyCompliance, Tooth, body_compliance, hertz_stiffness};
use std::f64::consts::PI;

/// Panels of Simpson's rule over a ring tooth: its outline is smooth, the error is below 1e-10 of the compliance.
const PANELS: usize = 64;

/// One tooth of a ring.
#[derive(Debug, Clone, PartialEq)]
pub struct RingTooth {
    base_radius_m: f64,
    root_radius_m: f64,
    /// `(pi/2 - 2 x tan(alpha)) / z - inv(alpha)`: half angle of the tooth at its (virtual) base circle.
    base_half_angle: f64,
    youngs_modulus_pa: f64,
    poisson: f64,
    width_m: f64,
}

impl RingTooth {
    /// Tooth of a ring of `teeth` cut to the standard depth, its profile shifted outwards by so many modules.
    fn new(pair: &Pair, teeth: u32, shift: f64) -> Self {
        let alpha = pair.pressure_angle_deg.to_radians();
        let radius = 0.5 * pair.module_m * f64::from(teeth);
        let dedendum = pair.addendum_coefficient + pair.clearance_coefficient;
        Self {
            base_radius_m: radius * alpha.cos(),
            root_radius_m: radius + (dedendum + shift) * pair.module_m,
            base_half_angle: (0.5 * PI - 2.0 * shift * alpha.tan()) / f64::from(teeth) - involute(alpha),
            youngs_modulus_pa: pair.youngs_modulus_pa,
            poisson: pair.poisson,
            width_m: pair.face_width_m,
        }
    }

    /// Height from the ring's centre and half thickness, m, at roll angle `roll` (the tangent of the pressure angle).
    pub fn section(&self, roll: f64) -> (f64, f64) {
        let radius = self.base_radius_m * roll.hypot(1.0);
        let half = self.base_half_angle + roll - roll.atan();
        (radius * half.cos(), radius * half.sin())
    }

    /// Compliance as a beam, m/N, with contact at roll angle `roll`: bending, shear and compression.
    pub fn compliance(&self, roll: f64) -> f64 {
        let root = ((self.root_radius_m / self.base_radius_m).powi(2) - 1.0).sqrt();
        let (sine, cosine) = (roll + self.base_half_angle).sin_cos();
        let shear = 1.2 * 2.0 * (1.0 + self.poisson) * cosine * cosine + sine * sine;
        // Simpson's rule in the roll angle, the height's derivative taken from the outline's own.
        let integrand = |g: f64| {
            let (height, half) = self.section(g);
            let thickness = 2.0 * half;
            let moment = height * cosine - self.base_radius_m;
            (12.0 * moment * moment / thickness.powi(3) + shear / thickness) * self.height_slope(g)
        };
        let step = (root - roll) / PANELS as f64;
        let sum: f64 = (0..PANELS)
            .map(|i| {
                let from = roll + step * i as f64;
                (integrand(from) + 4.0 * integrand(from + 0.5 * step) + integrand(from + step)) * step / 6.0
            })
            .sum();
        sum / (self.youngs_modulus_pa * self.width_m)
    }

    /// Derivative of the height with respect to the roll angle, m.
    fn height_slope(&self, roll: f64) -> f64 {
        let half = self.base_half_angle + roll - roll.atan();
        let radius = self.base_radius_m * roll.hypot(1.0);
        let slope = roll * roll / (1.0 + roll * roll);
        self.base_radius_m * roll / roll.hypot(1.0) * half.cos() - radius * half.sin() * slope
    }
}

/// Angle, rad, whose involute this is, by bisection between 0 and 60 degrees; not a number beyond.
pub fn inverse_involute(value: f64) -> f64 {
    let (mut low, mut high) = (0.0, PI / 3.0);
    if !(value > 0.0 && value < involute(high)) {
        return f64::NAN;
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if involute(middle) < value { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// A pinion and a ring.
#[derive(Debug, Clone, PartialEq)]
pub struct InternalPair {
    /// Contact ratio.
    pub contact_ratio: f64,
    /// Base pitch, m.
    pub base_pitch_m: f64,
    /// Distance of the first contact from the pinion's base tangent point, m, where the pinion drives.
    path_start_m: f64,
    /// Distance of the two base tangent points, m.
    line_m: f64,
    /// Working pressure angle, rad.
    pressure_angle: f64,
    pinion: Tooth,
    body: BodyCompliance,
    pinion_base_radius_m: f64,
    pinion_half_angle: f64,
    ring: RingTooth,
    hertz_n_per_m: f64,
}

impl InternalPair {
    /// The pair of pinion and ring of these teeth and profile shifts, the pinion with this bore radius, m.
    ///
    /// # Errors
    /// A ring too small for its pinion: interference, or a tip within the base circle.
    pub fn new(
        toothing: &Toothing,
        [pinion, ring]: [u32; 2],
        bore: f64,
        [own_shift, ring_shift]: [f64; 2],
    ) -> Result<Self> {
        // The pinion's tooth is the same in any mesh: here beside its own likeness, which cannot interfere with it.
        let pair = Pair { profile_shift: [own_shift; 2], ..transverse_pair(toothing, [pinion; 2], [bore; 2]) };
        let geometry = Geometry::new(&pair)?;
        let alpha = geometry.pressure_angle;
        let [ring_radius, pinion_radius] = [ring, pinion].map(|z| 0.5 * pair.module_m * f64::from(z));
        let tip = ring_radius - (pair.addendum_coefficient - ring_shift) * pair.module_m;
        let ring_base = ring_radius * alpha.cos();
        if tip <= ring_base {
            let what = format!("a ring of {ring} teeth has its tips within its base circle");
            return Err(Error::invalid("ring", what));
        }
        let apart = f64::from(ring) - f64::from(pinion);
        let working = inverse_involute(involute(alpha) + 2.0 * alpha.tan() * (ring_shift - own_shift) / apart);
        let line = (ring_radius - pinion_radius) * alpha.cos() * working.tan();
        let start = (tip * tip - ring_base * ring_base).sqrt() - line;
        let own_tip = pinion_radius + (pair.addendum_coefficient + own_shift) * pair.module_m;
        let end = (own_tip.powi(2) - geometry.base_radius_m[0].powi(2)).sqrt();
        if start <= 0.0 {
            let what =
                format!("interference: the tips of a ring of {ring} teeth reach below the base of {pinion} teeth");
            return Err(Error::invalid("ring", what));
        }
        let contact_ratio = (end - start) / geometry.base_pitch_m;
        if contact_ratio < 1.0 {
            let what = format!("contact ratio {contact_ratio:.3} of {pinion} teeth in {ring} is below 1");
            return Err(Error::invalid("ring", what));
        }
        Ok(Self {
            contact_ratio,
            base_pitch_m: geometry.base_pitch_m,
            path_start_m: start,
            line_m: line,
            pressure_angle: working,
            pinion: Tooth::new(&pair, &geometry, 0)?,
            body: body_compliance(&pair, &geometry, 0),
            pinion_base_radius_m: geometry.base_radius_m[0],
            pinion_half_angle: geometry.base_half_angle[0],
            ring: RingTooth::new(&pair, ring, ring_shift),
            hertz_n_per_m: hertz_stiffness(pair.youngs_modulus_pa, pair.poisson, pair.face_width_m),
        })
    }

    /// Stiffness, N/m, at `s` base pitches from the first contact, the pinion driving.
    pub fn at(&self, s: f64) -> f64 {
        let roll = self.path_start_m + s * self.base_pitch_m;
        let load_angle = roll / self.pinion_base_radius_m - self.pinion_half_angle;
        let pinion = self.pinion.compliance(load_angle).total() + self.body.at(load_angle);
        let ring = self.ring.compliance((roll + self.line_m) / self.ring.base_radius_m);
        1.0 / (1.0 / self.hertz_n_per_m + pinion + ring)
    }

    /// Position of the pitch point, base pitches from the first contact, the pinion driving.
    pub fn pitch_point(&self) -> f64 {
        (self.pinion_base_radius_m * self.pressure_angle.tan() - self.path_start_m) / self.base_pitch_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair() -> Pair {
        Pair::spur([31, 31], 2e-3, 20e-3, [8e-3; 2])
    }

    fn toothing() -> Toothing {
        let text = "[[stage]]\nkind = \"planetary\"\nsun = 31\nplanet = 31\nring = 95\nplanets = 3\nfixed = \
            \"ring\"\ninput = \"sun\"\n[[mesh]]\nmodule_mm = 2.0\nface_width_mm = 20\n";
        crate::machine::TrainMachine::parse(text, "m.toml").expect("a machine").toothings[0].clone()
    }

    #[test]
    fn theory_the_contact_ratio_is_the_textbooks_and_exceeds_the_external_pairs() {
        let own = InternalPair::new(&toothing(), [31, 95], 8e-3, [0.0; 2]).expect("a pair");
        // Both tip circles' pressure angles: (z1 (tan a1 - tan a) - z2 (tan a2 - tan a)) / (2 pi).
        let tangent = |z: f64, addendum: f64| (z * 20f64.to_radians().cos() / (z + 2.0 * addendum)).acos().tan();
        let tan = 20f64.to_radians().tan();
        let closed = (31.0 * (tangent(31.0, 1.0) - tan) - 95.0 * (tangent(95.0, -1.0) - tan)) / (2.0 * PI);
        assert!((own.contact_ratio - closed).abs() < 1e-12, "{} {closed}", own.contact_ratio);
        assert!(own.contact_ratio > Geometry::new(&pair()).expect("external").contact_ratio);
        assert!(own.pitch_point() > 0.0 && own.pitch_point() < own.contact_ratio);
    }

    #[test]
    fn theory_a_ring_tooth_is_a_pitch_wide_with_its_gap_and_thickens_outwards() {
        let tooth = RingTooth::new(&pair(), 95, 0.0);
        let (height, half) = tooth.section(20f64.to_radians().tan());
        // At the pitch circle tooth and gap are alike.
        assert!(((half / height).atan() - 0.5 * PI / 95.0).abs() < 1e-12);
        let widths: Vec<f64> = [0.30, 0.34, 0.38, 0.42].map(|roll| tooth.section(roll).1).to_vec();
        assert!(widths.windows(2).all(|w| w[1] > w[0]), "{widths:?}");
        let slope = (tooth.section(0.36 + 1e-6).0 - tooth.section(0.36 - 1e-6).0) / 2e-6;
        assert!((tooth.height_slope(0.36) / slope - 1.0).abs() < 1e-6);
    }

    #[test]
    fn theory_of_a_ring_with_endless_teeth_the_beam_is_that_of_a_rack() {
        // A rack's flank is straight: half thickness pi m / 4 + y tan(alpha), y from the pitch line to the root.
        let pair = pair();
        let tooth = RingTooth::new(&pair, 1_000_000, 0.0);
        let (tan, cos) = (20f64.to_radians().tan(), 20f64.to_radians().cos());
        let sin = 20f64.to_radians().sin();
        let m = pair.module_m;
        let steps = 20_000;
        let depth = 1.25 * m;
        let sum: f64 = (0..steps)
            .map(|i| {
                let y = depth * (f64::from(i) + 0.5) / f64::from(steps);
                let t = 2.0 * (0.25 * PI * m + y * tan);
                let moment = y * cos - 0.25 * PI * m * sin;
                (12.0 * moment * moment / t.powi(3) + (3.12 * cos * cos + sin * sin) / t) * depth / f64::from(steps)
            })
            .sum();
        let rack = sum / (pair.youngs_modulus_pa * pair.face_width_m);
        let own = tooth.compliance(tan);
        assert!((own / rack - 1.0).abs() < 1e-4, "{own:e} {rack:e}");
    }

    #[test]
    fn theory_a_ring_tooth_is_softer_at_its_tip_and_stiffer_than_the_pinions() {
        let own = InternalPair::new(&toothing(), [31, 95], 8e-3, [0.0; 2]).expect("a pair");
        let tooth = &own.ring;
        let compliances = [0.30, 0.34, 0.38, 0.42].map(|roll| tooth.compliance(roll));
        assert!(compliances.windows(2).all(|c| c[1] < c[0]), "{compliances:?}");
        let pitch = 20f64.to_radians().tan();
        let pinion = own.pinion.compliance(pitch - own.pinion_half_angle).total();
        assert!(tooth.compliance(pitch) < pinion, "{:e} {pinion:e}", tooth.compliance(pitch));
    }
}
