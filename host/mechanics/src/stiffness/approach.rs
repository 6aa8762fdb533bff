//! Separation of a pair outside the theoretical path of contact.
//!
//! Before the start of contact the gear's tip corner runs ahead of the pinion's flank by a gap that closes as
//! the square of the distance (the flanks are conjugate, so value and slope vanish at the start). Deflected
//! teeth close it early: contact begins where the gap equals the mesh deflection. The gap is exact here, from
//! the position of the corner and the polar equation of the involute; kappa is its curvature.

use crate::machine::{Geometry, Side, involute};

/// Gap along the line of action, m, at `distance` base pitches outside the path on one side.
///
/// `flank` is the gear whose flank is met: [`Side::Pinion`] before the start of contact, [`Side::Gear`] after its end.
pub fn gap_m(geometry: &Geometry, flank: Side, distance: f64) -> f64 {
    let (own, other) = (flank.index(), 1 - flank.index());
    let (rb, rb_other) = (geometry.base_radius_m[own], geometry.base_radius_m[other]);
    let (tip, centre) = (geometry.tip_radius_m[other], geometry.centre_distance_m);
    let turn = distance * geometry.base_pitch_m;
    let at_start = (rb_other / tip).acos() - geometry.working_pressure_angle;
    // Polar angle of the corner about the flank's gear, less the flank's own angle at the corner's radius.
    let behind = |turned: f64| {
        let angle = at_start + turned / rb_other;
        let (along, across) = (centre - tip * angle.cos(), tip * angle.sin());
        let radius = along.hypot(across);
        involute((rb / radius).min(1.0).acos()) + turned / rb - across.atan2(along)
    };
    rb * (behind(turn) - behind(0.0))
}

/// Coefficient kappa of `gap = kappa s^2`, 1/m with s in m, at the border of the path on one side.
pub fn gap_curvature_per_m(geometry: &Geometry, flank: Side) -> f64 {
    let step = 1e-3;
    let length = step * geometry.base_pitch_m;
    // Both signs of the distance cancel the cubic term.
    0.5 * (gap_m(geometry, flank, step) + gap_m(geometry, flank, -step)) / (length * length)
}
