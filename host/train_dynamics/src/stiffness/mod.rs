//! Stiffness of one mesh of a train in its transverse plane, over the path of contact in base pitches.
//!
//! A spur pair is the energy method's pair curve with a raised-cosine ramp at both ends; a helical pair is made of
//! slices of its face ([`helical`]), a pinion in a ring has its own outline ([`internal`]). What is kept is the curve
//! of one pair and the sum over all pairs in contact, which repeats every base pitch. A helical mesh's flank force has
//! an axial part, its transverse force times [`MeshStiffness::axial_force_factor`]; bodies do not move along their
//! axes here, so that part is for bearings to know.

pub mod helical;
pub mod internal;

use crate::machine::Toothing;
use crate::{Error, Result};
use internal::InternalPair;
use meshband_mechanics::machine::{Geometry, Pair};
use meshband_mechanics::piecewise::PiecewisePolynomial;
use meshband_mechanics::stiffness::{PairModel, event_knots, fit_adaptive, mesh};
use std::f64::consts::PI;

/// Deviation of a fitted curve from its definition, relative to its largest value.
const FIT_TOLERANCE: f64 = 1e-9;
/// Addendum of a standard tooth, normal modules.
const ADDENDUM_MODULES: f64 = 1.0;
/// Tip clearance of a standard tooth, normal modules.
const CLEARANCE_MODULES: f64 = 0.25;

/// Two gears in mesh as their stiffness sees them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// Both have their teeth outside; driver and driven.
    External([u32; 2]),
    /// A pinion inside a ring; whether the pinion drives.
    Internal {
        /// Teeth of the pinion.
        pinion: u32,
        /// Teeth of the ring.
        ring: u32,
        /// Whether the pinion drives; where not, contact runs along the path the other way.
        pinion_drives: bool,
    },
}

/// Two gears in mesh with what their toothing does not say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gears {
    /// Teeth.
    pub form: Form,
    /// Bore radii of driver and driven gear, m; a ring's does not matter.
    pub bores_m: [f64; 2],
    /// Profile shifts of driver and driven gear in transverse modules, a ring's positive outwards.
    pub profile_shift: [f64; 2],
}

impl Gears {
    /// Gears without profile shift.
    pub fn standard(form: Form, bores_m: [f64; 2]) -> Self {
        Self { form, bores_m, profile_shift: [0.0; 2] }
    }
}

/// Stiffness of a mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshStiffness {
    /// Stiffness of one pair, N/m, over base pitches from its first contact.
    pub pair: PiecewisePolynomial,
    /// Stiffness of the mesh, N/m, over one base pitch.
    pub total: PiecewisePolynomial,
    /// Position of the pitch point, base pitches from a pair's first contact, in the middle of the face.
    pub pitch_point: f64,
    /// Transverse base pitch, m.
    pub base_pitch_m: f64,
    /// Transverse contact ratio.
    pub contact_ratio: f64,
    /// Overlap ratio, 0 of spur gears.
    pub overlap_ratio: f64,
    /// Axial force over the force in the transverse plane.
    pub axial_force_factor: f64,
}

impl MeshStiffness {
    /// The stiffness of gears of this toothing.
    ///
    /// # Errors
    /// Gears that cannot mesh, with the place of their toothing.
    pub fn new(toothing: &Toothing, gears: &Gears, place: &str) -> Result<Self> {
        let named = |error: Error| Error::invalid(place, error);
        let (pair, contact_ratio, pitch_point) = match gears.form {
            Form::External(teeth) => external(toothing, teeth, gears).map_err(named)?,
            Form::Internal { pinion, ring, pinion_drives } => {
                let side = usize::from(!pinion_drives);
                let shifts = [gears.profile_shift[side], gears.profile_shift[1 - side]];
                let pair = InternalPair::new(toothing, [pinion, ring], gears.bores_m[side], shifts).map_err(named)?;
                let (ratio, pitch) = (pair.contact_ratio, pair.pitch_point());
                let along = |s: f64| if pinion_drives { s } else { ratio - s };
                let curve = fit_adaptive(event_knots(ratio, &[]), FIT_TOLERANCE, |s| pair.at(along(s)));
                (curve, ratio, along(pitch))
            }
        };
        Self::of_pair(&pair, contact_ratio, pitch_point, toothing).map_err(named)
    }

    fn of_pair(hard: &PiecewisePolynomial, ratio: f64, pitch_point: f64, toothing: &Toothing) -> Result<Self> {
        let helix = toothing.helix_angle_deg.to_radians();
        let overlap_ratio = toothing.face_width_m * helix.sin().abs() / (PI * toothing.module_m);
        let ramped = ramp(hard, toothing.ramp_base_pitches)?;
        let pair = helical::averaged(&ramped, overlap_ratio);
        let base_helix = (helix.tan() * toothing.transverse_pressure_angle().cos()).atan();
        Ok(Self {
            total: mesh::total(&pair),
            pair,
            pitch_point: pitch_point + 0.5 * overlap_ratio,
            base_pitch_m: PI * toothing.transverse_module_m() * toothing.transverse_pressure_angle().cos(),
            contact_ratio: ratio,
            overlap_ratio,
            axial_force_factor: base_helix.tan().abs(),
        })
    }

    /// Mean mesh stiffness, N/m: one pair enters per base pitch, so it is the integral of the pair's curve.
    pub fn mean_n_per_m(&self) -> f64 {
        self.pair.integral()
    }

    /// The same mesh with its stiffness replaced by the mean: the time-invariant system of modal theory.
    #[must_use]
    pub fn averaged(&self) -> Self {
        let total = PiecewisePolynomial::new(vec![0.0, 1.0], vec![vec![self.mean_n_per_m()]]);
        Self { total, ..self.clone() }
    }
}

/// The transverse section of a toothing as a spur pair: the cutter's normal depth in transverse modules.
pub fn transverse_pair(toothing: &Toothing, teeth: [u32; 2], bores_m: [f64; 2]) -> Pair {
    let cosine = toothing.helix_angle_deg.to_radians().cos();
    Pair {
        pressure_angle_deg: toothing.transverse_pressure_angle().to_degrees(),
        youngs_modulus_pa: toothing.youngs_modulus_pa,
        poisson: toothing.poisson,
        addendum_coefficient: ADDENDUM_MODULES * cosine,
        clearance_coefficient: CLEARANCE_MODULES * cosine,
        ..Pair::spur(teeth, toothing.transverse_module_m(), toothing.face_width_m, bores_m)
    }
}

/// Hard pair curve, contact ratio and pitch point of external gears, driver first.
fn external(toothing: &Toothing, teeth: [u32; 2], gears: &Gears) -> Result<(PiecewisePolynomial, f64, f64)> {
    let (bores_m, profile_shift) = (gears.bores_m, gears.profile_shift);
    let pair = Pair { profile_shift, ..transverse_pair(toothing, teeth, bores_m) };
    let geometry = Geometry::new(&pair)?;
    if let Some(i) = (0..2).find(|&i| bores_m[i] >= geometry.root_radius_m[i]) {
        let (bore, root) = (1e3 * bores_m[i], 1e3 * geometry.root_radius_m[i]);
        return Err(Error::invalid("bore_radius_mm", format!("{bore:.3} mm reaches the root circle of {root:.3} mm")));
    }
    let model = PairModel::new(&pair)?;
    Ok((model.curve(), geometry.contact_ratio, geometry.pitch_point()))
}

/// Multiplies a hard curve with a raised-cosine rise and fall of this length inside its ends.
fn ramp(curve: &PiecewisePolynomial, length: f64) -> Result<PiecewisePolynomial> {
    let knots = curve.knots();
    let (start, end) = (knots[0], knots[knots.len() - 1]);
    if end - start <= 1.0 + 2.0 * length {
        let most = 0.5 * (end - start - 1.0);
        let what =
            format!("{length} at both ends of a path of {:.3} leaves no full pair; at most {most:.3}", end - start);
        return Err(Error::invalid("engagement_base_pitches", what));
    }
    let mut fine = knots.to_vec();
    fine.extend([start + length, end - length]);
    fine.sort_by(f64::total_cmp);
    fine.dedup_by(|b, a| *b - *a < 1e-9);
    let rise = |u: f64| 0.5 - 0.5 * (PI * u.clamp(0.0, 1.0)).cos();
    let at = |s: f64| curve.value(s) * rise((s - start) / length) * rise((end - s) / length);
    Ok(fit_adaptive(fine, FIT_TOLERANCE, at))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::TrainMachine;

    const BORES_M: [f64; 2] = [8e-3, 22e-3];

    fn toothing(helix_deg: f64) -> Toothing {
        let text = format!(
            "[[stage]]\nkind = \"pair\"\nteeth = [23, 61]\nhelix_angle_deg = {helix_deg}\n[[mesh]]\nmodule_mm = \
             2.0\nface_width_mm = 20\n"
        );
        TrainMachine::parse(&text, "m.toml").expect("a machine").toothings[0].clone()
    }

    #[test]
    fn theory_zero_helix_is_the_spur_pair_exactly_and_a_small_helix_lies_beside_it() {
        let spur =
            MeshStiffness::new(&toothing(0.0), &Gears::standard(Form::External([23, 61]), BORES_M), "m").expect("spur");
        let model = PairModel::new(&Pair::spur([23, 61], 2e-3, 20e-3, BORES_M)).expect("a pair");
        for s in [0.3, 0.7, 1.0, 1.3] {
            let (ours, own) = (spur.pair.value(s), model.at(s));
            assert!((ours / own - 1.0).abs() < 1e-8, "{s}: {ours} {own}");
        }
        assert_eq!((spur.overlap_ratio, spur.axial_force_factor), (0.0, 0.0));
        let small = MeshStiffness::new(&toothing(0.05), &Gears::standard(Form::External([23, 61]), BORES_M), "m")
            .expect("helical");
        assert!((small.mean_n_per_m() / spur.mean_n_per_m() - 1.0).abs() < 1e-4);
        assert!((small.pair.value(0.8) / spur.pair.value(0.8) - 1.0).abs() < 1e-3);
    }

    #[test]
    fn theory_the_axial_force_is_the_transverse_one_times_the_base_helix_tangent() {
        let toothing = toothing(15.0);
        let stiffness =
            MeshStiffness::new(&toothing, &Gears::standard(Form::External([23, 61]), BORES_M), "m").expect("helical");
        // sin(base helix) = sin(helix) cos(normal pressure angle).
        let base = (15f64.to_radians().sin() * 20f64.to_radians().cos()).asin();
        assert!((stiffness.axial_force_factor - base.tan()).abs() < 1e-12);
        let overlap = 20.0 * 15f64.to_radians().sin() / (PI * 2.0);
        assert!((stiffness.overlap_ratio - overlap).abs() < 1e-12);
    }

    #[test]
    fn theory_a_reversed_internal_mesh_has_the_same_mean_and_the_mirrored_curve() {
        let form = |pinion_drives| Form::Internal { pinion: 31, ring: 95, pinion_drives };
        let of =
            |way, bores| MeshStiffness::new(&toothing(0.0), &Gears::standard(form(way), bores), "m").expect("ring");
        let (forth, back) = (of(true, BORES_M), of(false, [BORES_M[1], BORES_M[0]]));
        assert!((forth.mean_n_per_m() / back.mean_n_per_m() - 1.0).abs() < 1e-9);
        for s in [0.2, 0.9, 1.4] {
            let mirrored = back.pair.value(forth.contact_ratio - s);
            assert!((forth.pair.value(s) / mirrored - 1.0).abs() < 1e-7, "{s}");
        }
        assert!((forth.pitch_point + back.pitch_point - forth.contact_ratio).abs() < 1e-12);
    }

    #[test]
    fn fault_gears_that_cannot_mesh_are_refused_with_their_place() {
        let external = Form::External([8, 200]);
        let error = MeshStiffness::new(&toothing(0.0), &Gears::standard(external, BORES_M), "x [[mesh]] 1")
            .expect_err("refused");
        assert!(error.to_string().contains("x [[mesh]] 1") && error.to_string().contains("interference"), "{error}");
        let ring = Form::Internal { pinion: 31, ring: 33, pinion_drives: true };
        let error = MeshStiffness::new(&toothing(0.0), &Gears::standard(ring, BORES_M), "x [[mesh]] 1")
            .expect_err("refused")
            .to_string();
        assert!(error.contains("ring"), "{error}");
    }
}
