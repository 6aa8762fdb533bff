//! Compliance of the gear body under one tooth (Sainsot, Velex and Duverger 2004): an elastic ring.
//!
//! `1/kf = cos^2 a / (E b) (L (u/S)^2 + M u/S + P (1 + Q tan^2 a))`, with u measured from the root circle to
//! where the line of action cuts the tooth's centre line (not the height of the contact point, as some
//! codes have it: 11 % too soft at the pitch point). It is the largest single term, about 60 % of the
//! pair's compliance, and P grows with the square of the hub ratio: an unknown hub makes the figure a guess.
//! Two loaded teeth on one body are not coupled here: double contact comes out a little stiff.

use crate::machine::Geometry;
use crate::machine::{Pair, RootAngle};

/// Coefficients A to F of L*, M*, P*, Q*.
const FIT: [[f64; 6]; 4] = [
    [-5.574e-5, -1.9986e-3, -2.3015e-4, 4.7702e-3, 0.0271, 6.8045],
    [60.111e-5, 28.100e-3, -83.431e-4, -9.9256e-3, 0.1624, 0.9086],
    [-50.952e-5, 185.50e-3, 0.0538e-4, 53.300e-3, 0.2895, 0.9236],
    [-6.2042e-5, 9.0889e-3, -4.0964e-4, 7.8297e-3, -0.1472, 0.6904],
];

/// Range of root radius over hub radius that the fit covers.
pub const HUB_RATIO_RANGE: (f64, f64) = (1.4, 7.0);
/// Range of the tooth's half angle at the root circle that the fit covers, rad.
pub const ROOT_ANGLE_RANGE: (f64, f64) = (0.01, 0.12);

/// The fit at one gear's proportions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyCompliance {
    /// L*, M*, P*, Q*.
    pub factors: [f64; 4],
    /// Root radius over hub radius.
    pub hub_ratio: f64,
    /// Half angle of the tooth at the root circle, rad.
    pub root_half_angle: f64,
    root_radius_m: f64,
    base_radius_m: f64,
    /// `E b`, N/m.
    modulus_width: f64,
}

/// The body of gear `index` of the pair.
pub fn body_compliance(pair: &Pair, geometry: &Geometry, index: usize) -> BodyCompliance {
    let theta = root_half_angle(pair, geometry, index);
    let root = geometry.root_radius_m[index];
    let h = root / pair.bore_radius_m[index];
    let factors = FIT.map(|[a, b, c, d, e, f]| a / (theta * theta) + b * h * h + c * h / theta + d / theta + e * h + f);
    BodyCompliance {
        factors,
        hub_ratio: h,
        root_half_angle: theta,
        root_radius_m: root,
        base_radius_m: geometry.base_radius_m[index],
        modulus_width: pair.youngs_modulus_pa * pair.face_width_m,
    }
}

/// Half angle of the tooth at the root circle, rad.
fn root_half_angle(pair: &Pair, geometry: &Geometry, index: usize) -> f64 {
    let a = geometry.pressure_angle;
    let rounding = pair.clearance_coefficient / (1.0 - a.sin());
    let addendum = match pair.root_angle {
        RootAngle::Literature => pair.addendum_coefficient,
        RootAngle::Fillet => pair.addendum_coefficient + pair.clearance_coefficient,
    };
    let width = 0.5 * std::f64::consts::PI + 2.0 * a.tan() * (addendum - rounding) + 2.0 * rounding / a.cos();
    width / f64::from(geometry.teeth[index])
}

impl BodyCompliance {
    /// Compliance, m/N, at load angle `a` (rad, force against the perpendicular to the centre line).
    pub fn at(&self, load_angle: f64) -> f64 {
        self.with_lever(load_angle, self.base_radius_m / load_angle.cos() - self.root_radius_m)
    }

    /// The same with a given u, m; lets codes that measure u otherwise be reproduced.
    pub fn with_lever(&self, load_angle: f64, u_m: f64) -> f64 {
        let [l, m, p, q] = self.factors;
        let ratio = u_m / (2.0 * self.root_half_angle * self.root_radius_m);
        let bracket = l * ratio * ratio + m * ratio + p * (1.0 + q * load_angle.tan().powi(2));
        load_angle.cos().powi(2) / self.modulus_width * bracket
    }

    /// What lies outside the range that the published fit covers, one line each.
    pub fn warnings(&self) -> Vec<String> {
        let mut list = Vec::new();
        let mut look = |what: &str, value: f64, (from, to): (f64, f64)| {
            if !(from..=to).contains(&value) {
                list.push(format!("{what} {value:.4} lies outside {from} to {to}: the body term is extrapolated"));
            }
        };
        look("root radius over hub radius", self.hub_ratio, HUB_RATIO_RANGE);
        look("half angle of the tooth at the root circle (rad)", self.root_half_angle, ROOT_ANGLE_RANGE);
        list
    }
}
