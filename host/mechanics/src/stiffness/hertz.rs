//! Contact stiffness of two teeth, constant along the path (Yang and Sun 1985): line contact of equal materials.

/// `pi E b / (4 (1 - nu^2))`, N/m, for Young's modulus in Pa and face width in m.
///
/// Linear in the load by construction: the local and the secant stiffness are the same.
pub fn hertz_stiffness(youngs_modulus_pa: f64, poisson: f64, face_width_m: f64) -> f64 {
    std::f64::consts::PI * youngs_modulus_pa * face_width_m / (4.0 * (1.0 - poisson * poisson))
}
