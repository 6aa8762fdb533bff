//! ISO 6336-1 method B: single stiffness c' and mesh stiffness c_gamma, a sanity figure beside the energy method.
//!
//! Fitted to steel gears with solid or webbed blanks; per unit of face width. With hubs about a third of the root
//! radius the energy method lands within a few per cent; more than a quarter off means an unusual blank or a fault.

use crate::machine::Geometry;
use crate::machine::Pair;

/// Deviation of the mean mesh stiffness from method B beyond which something is unusual.
pub const SPREAD: f64 = 0.25;

/// Theoretical single stiffness c'th, N/m per m of width, of teeth with `virtual_teeth` and profile shifts `x`.
pub fn theoretical_single(virtual_teeth: [f64; 2], x: [f64; 2]) -> f64 {
    let [z1, z2] = virtual_teeth;
    let [x1, x2] = x;
    let q = 0.04723 + 0.15551 / z1 + 0.25791 / z2 - 0.00635 * x1 - 0.11654 * x1 / z1 - 0.00193 * x2 - 0.24188 * x2 / z2
        + 0.00529 * x1 * x1
        + 0.00182 * x2 * x2;
    1e9 / q
}

/// Basic rack factor C_B from dedendum (in modules) and normal pressure angle, degrees.
pub fn basic_rack_factor(dedendum: f64, pressure_angle_deg: f64) -> f64 {
    (1.0 + 0.5 * (1.2 - dedendum)) * (1.0 - 0.02 * (20.0 - pressure_angle_deg))
}

/// Single stiffness c', N/m per m of width: `0.8 c'th C_R C_B cos b` with the blank factor C_R and helix angle b, rad.
pub fn single(theoretical: f64, blank_factor: f64, basic_rack: f64, helix_angle: f64) -> f64 {
    0.8 * theoretical * blank_factor * basic_rack * helix_angle.cos()
}

/// Mesh stiffness c_gamma_alpha, N/m per m of width, the mean over the cycle.
pub fn mesh(single: f64, contact_ratio: f64) -> f64 {
    single * (0.75 * contact_ratio + 0.25)
}

/// Method B of one spur pair.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct MethodB {
    /// Stiffness of one pair, N/m.
    pub single_n_per_m: f64,
    /// Mean mesh stiffness, N/m.
    pub mean_n_per_m: f64,
}

/// Method B with solid blanks; the modulus scales it from steel's 206 GPa.
pub fn method_b(pair: &Pair, geometry: &Geometry) -> MethodB {
    let rack = basic_rack_factor(pair.addendum_coefficient + pair.clearance_coefficient, pair.pressure_angle_deg);
    let theoretical = theoretical_single(pair.teeth.map(f64::from), pair.profile_shift);
    let per_width = single(theoretical, 1.0, rack, 0.0) * pair.youngs_modulus_pa / 206e9;
    MethodB {
        single_n_per_m: per_width * pair.face_width_m,
        mean_n_per_m: mesh(per_width, geometry.contact_ratio) * pair.face_width_m,
    }
}

impl MethodB {
    /// A line of warning where a mean mesh stiffness lies beyond the spread.
    pub fn warning(&self, mean_n_per_m: f64) -> Option<String> {
        let off = mean_n_per_m / self.mean_n_per_m - 1.0;
        (off.abs() > SPREAD).then(|| {
            format!(
                "mean mesh stiffness is {:+.0} % off ISO 6336-1 method B: an unusual blank, or a wrong value",
                100.0 * off
            )
        })
    }
}
