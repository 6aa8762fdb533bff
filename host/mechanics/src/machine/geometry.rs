//! Geometry of the pair on the line of action: base circles, path of contact, contact ratio.
//!
//! External spur gears cut by a rack, with profile shift at zero backlash. Positions on the line of action
//! are measured from the point where it touches the pinion's base circle; the path of contact runs from
//! where the gear's tip circle cuts it to where the pinion's does. Units: m, rad.

use super::{Pair, Shafts};
use crate::{Error, Result};

/// Everything the contact kinematics of a pair needs.
#[derive(Debug, Clone, PartialEq)]
pub struct Geometry {
    /// Pressure angle at the reference circle, rad.
    pub pressure_angle: f64,
    /// Working pressure angle, rad; differs from the reference one by the profile shift.
    pub working_pressure_angle: f64,
    /// Centre distance, m.
    pub centre_distance_m: f64,
    /// Reference (pitch) radii, m.
    pub pitch_radius_m: [f64; 2],
    /// Base radii, m.
    pub base_radius_m: [f64; 2],
    /// Tip radii, m.
    pub tip_radius_m: [f64; 2],
    /// Root radii, m.
    pub root_radius_m: [f64; 2],
    /// Base pitch, m.
    pub base_pitch_m: f64,
    /// Length of the path of contact in base pitches.
    pub contact_ratio: f64,
    /// Distance of the start of contact from the pinion's base tangent point, m.
    pub path_start_m: f64,
    /// Half angle of each tooth on its base circle, rad.
    pub base_half_angle: [f64; 2],
    /// Teeth.
    pub teeth: [u32; 2],
}

/// `tan a - a`.
pub fn involute(angle: f64) -> f64 {
    angle.tan() - angle
}

impl Geometry {
    /// Works out the pair's geometry.
    ///
    /// # Errors
    /// Interference (the tip circle of one gear passes the other's base tangent point), contact ratio below
    /// one, pointed teeth, or a profile shift no centre distance can satisfy; the message names the key.
    pub fn new(pair: &Pair) -> Result<Self> {
        let a = pair.pressure_angle_deg.to_radians();
        let m = pair.module_m;
        let z = pair.teeth.map(f64::from);
        let shift = pair.profile_shift;
        let involute_working = involute(a) + 2.0 * a.tan() * (shift[0] + shift[1]) / (z[0] + z[1]);
        if involute_working <= 0.0 {
            return Err(Error::invalid(
                "profile_shift",
                "so negative that the gears cannot mesh at any centre distance",
            ));
        }
        let working = inverse_involute(involute_working, a);
        let centre = 0.5 * m * (z[0] + z[1]) * a.cos() / working.cos();
        // Tips are shortened by the part of the shift that the centre distance does not take up.
        let shortening = shift[0] + shift[1] - (centre / m - 0.5 * (z[0] + z[1]));
        let pitch = z.map(|z| 0.5 * m * z);
        let base = pitch.map(|r| r * a.cos());
        let tip = [0, 1].map(|i| pitch[i] + m * (pair.addendum_coefficient + shift[i] - shortening));
        let root = [0, 1].map(|i| pitch[i] - m * (pair.addendum_coefficient + pair.clearance_coefficient - shift[i]));
        let half = [0, 1].map(|i| (0.5 * std::f64::consts::PI + 2.0 * shift[i] * a.tan()) / z[i] + involute(a));
        for i in 0..2 {
            if tip[i] <= base[i] {
                return Err(Error::invalid(
                    "addendum_coefficient",
                    format!("gear {i} has no involute above its base circle"),
                ));
            }
            if half[i] <= involute((base[i] / tip[i]).acos()) {
                return Err(Error::invalid(
                    "addendum_coefficient",
                    format!("the teeth of gear {i} become pointed below their tips"),
                ));
            }
        }
        // The cutter's flat tip must have a width left beside its two roundings.
        let rounding = pair.clearance_coefficient / (1.0 - a.sin());
        let depth = pair.addendum_coefficient + pair.clearance_coefficient - rounding;
        if std::f64::consts::FRAC_PI_4 - depth * a.tan() - rounding / a.cos() < 0.0 {
            return Err(Error::invalid(
                "clearance_coefficient",
                "a cutter with this addendum, clearance and pressure angle would be pointed: no such tooth can be cut",
            ));
        }
        let line = centre * working.sin();
        let reach = [0, 1].map(|i| (tip[i] * tip[i] - base[i] * base[i]).sqrt());
        if let Some(i) = (0..2).find(|&i| reach[i] >= line) {
            let (other, least) = (1 - i, 2.0 * pair.addendum_coefficient / a.sin().powi(2));
            return Err(Error::invalid(
                "teeth",
                format!(
                    "interference: the tip of gear {i} meets gear {other} below its base circle ({} teeth; without \
                     profile shift {least:.0} teeth never interfere)",
                    pair.teeth[other]
                ),
            ));
        }
        let base_pitch = std::f64::consts::PI * m * a.cos();
        let contact_ratio = (reach[0] + reach[1] - line) / base_pitch;
        if contact_ratio < 1.0 {
            return Err(Error::invalid(
                "addendum_coefficient",
                format!(
                    "contact ratio {contact_ratio:.4} is below 1: the pair would lose contact in every mesh period"
                ),
            ));
        }
        Ok(Self {
            pressure_angle: a,
            working_pressure_angle: working,
            centre_distance_m: centre,
            pitch_radius_m: pitch,
            base_radius_m: base,
            tip_radius_m: tip,
            root_radius_m: root,
            base_pitch_m: base_pitch,
            contact_ratio,
            path_start_m: line - reach[1],
            base_half_angle: half,
            teeth: pair.teeth,
        })
    }

    /// Distance between the two base tangent points, m.
    pub fn line_length_m(&self) -> f64 {
        self.centre_distance_m * self.working_pressure_angle.sin()
    }

    /// Distances of the contact from the base tangent points of pinion and gear, m, at `s` base pitches.
    pub fn roll_m(&self, s: f64) -> [f64; 2] {
        let pinion = self.path_start_m + s * self.base_pitch_m;
        [pinion, self.line_length_m() - pinion]
    }

    /// Angle between the contact force and the perpendicular to each tooth's centre line, rad.
    pub fn load_angle(&self, s: f64) -> [f64; 2] {
        let roll = self.roll_m(s);
        [0, 1].map(|i| roll[i] / self.base_radius_m[i] - self.base_half_angle[i])
    }

    /// Position of the pitch point on the path, base pitches from the start of contact.
    pub fn pitch_point(&self) -> f64 {
        (self.base_radius_m[0] * self.working_pressure_angle.tan() - self.path_start_m) / self.base_pitch_m
    }

    /// Pinion rotation of `radians` as base pitches on the path.
    pub fn base_pitches_per_rotation(&self, radians: f64) -> f64 {
        radians * f64::from(self.teeth[0]) / (2.0 * std::f64::consts::PI)
    }

    /// Mass that the two gears present to each other along the line of action, kg: `1/(rb1^2/I1 + rb2^2/I2)`.
    pub fn equivalent_mass_kg(&self, shafts: &Shafts) -> f64 {
        let [r1, r2] = self.base_radius_m;
        1.0 / (r1 * r1 / shafts.inertia_pinion_kg_m2 + r2 * r2 / shafts.inertia_gear_kg_m2)
    }
}

/// Angle whose involute is `target`, by Newton's method from `start`.
fn inverse_involute(target: f64, start: f64) -> f64 {
    let mut angle: f64 = start;
    for _ in 0..60 {
        let step = (involute(angle) - target) / angle.tan().powi(2).max(1e-6);
        angle = (angle - step).clamp(1e-3, 1.4);
        if step.abs() < 1e-16 {
            break;
        }
    }
    angle
}
