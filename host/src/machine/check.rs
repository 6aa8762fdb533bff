//! Physical sense of a declaration: every refusal names table and key and says what would be right.

use super::geometry::Geometry;
use super::{EngagementKind, Machine};
use crate::{Error, Result};

/// What is a machine at all: from a watch's wheel to a mill's, with room on both sides. Whether a machine can be computed for a
/// sampling rate is another question, answered by its natural frequencies.
const INERTIA_KG_M2: [f64; 2] = [1e-15, 1e12];
const MASS_KG: [f64; 2] = [1e-9, 1e9];
const STIFFNESS: [f64; 2] = [1e-9, 1e16];
const MOST_DAMPING: f64 = 1e12;
/// Largest torque, N m.
pub const MOST_TORQUE_N_M: f64 = 1e9;
/// Smallest bore, m: the gear body's compliance has no limit for none.
const SMALLEST_BORE_M: f64 = 1e-6;

impl Machine {
    /// Checks every value; `place` names the source in the error.
    pub fn check(&self, place: &str) -> Result<()> {
        self.check_pair(place)?;
        self.check_shafts(place)?;
        self.check_options(place)?;
        Geometry::new(&self.pair).map_err(|error| at(place, "[pair]", error))?;
        Ok(())
    }

    fn check_pair(&self, place: &str) -> Result<()> {
        let pair = &self.pair;
        let refuse = |key: &str, what: String| Err(Error::invalid(place, format!("[pair] {key}: {what}")));
        for (i, &z) in pair.teeth.iter().enumerate() {
            if !(6..=1000).contains(&z) {
                return refuse("teeth", format!("{z} teeth on gear {i}: a spur gear has 6 to 1000"));
            }
        }
        within(place, "[pair]", "module_m", pair.module_m, 5e-5, 0.2, "m")?;
        within(place, "[pair]", "pressure_angle_deg", pair.pressure_angle_deg, 10.0, 35.0, "degrees")?;
        within(place, "[pair]", "face_width_m", pair.face_width_m, 1e-5, 5.0, "m")?;
        within(place, "[pair]", "youngs_modulus_pa", pair.youngs_modulus_pa, 1e6, 2e12, "Pa")?;
        within(place, "[pair]", "poisson", pair.poisson, 0.0, 0.499, "")?;
        within(place, "[pair]", "addendum_coefficient", pair.addendum_coefficient, 0.3, 1.7, "modules")?;
        within(place, "[pair]", "clearance_coefficient", pair.clearance_coefficient, 0.02, 0.6, "modules")?;
        for (i, &x) in pair.profile_shift.iter().enumerate() {
            within(place, "[pair]", &format!("profile_shift[{i}]"), x, -1.0, 1.5, "modules")?;
        }
        for (i, &bore) in pair.bore_radius_m.iter().enumerate() {
            within(place, "[pair]", &format!("bore_radius_m[{i}]"), bore, SMALLEST_BORE_M, 10.0, "m")?;
            let root = pair.module_m
                * (0.5 * f64::from(pair.teeth[i]) - pair.addendum_coefficient - pair.clearance_coefficient
                    + pair.profile_shift[i]);
            if bore >= root {
                return refuse(
                    &format!("bore_radius_m[{i}]"),
                    format!("{bore} m is not inside the root circle of {root:.6} m"),
                );
            }
        }
        within(place, "[pair]", "mesh_damping_s", pair.mesh_damping_s, 0.0, 1.0, "s")?;
        if let Some(ratio) = pair.mesh_damping_ratio {
            within(place, "[pair]", "mesh_damping_ratio", ratio, 0.0, 2.0, "")?;
        }
        if pair.pair_stiffness.is_some() && pair.total_stiffness.is_some() {
            return refuse("total_stiffness", "give either this or pair_stiffness, not both".into());
        }
        Ok(())
    }

    fn check_shafts(&self, place: &str) -> Result<()> {
        let shafts = &self.shafts;
        for (key, value) in [
            ("inertia_motor_kg_m2", shafts.inertia_motor_kg_m2),
            ("inertia_pinion_kg_m2", shafts.inertia_pinion_kg_m2),
            ("inertia_gear_kg_m2", shafts.inertia_gear_kg_m2),
            ("inertia_load_kg_m2", shafts.inertia_load_kg_m2),
        ] {
            between(place, "[shafts]", key, value, INERTIA_KG_M2, "kg m2")?;
        }
        for i in 0..2 {
            for (key, value, range, unit) in [
                ("mass_kg", shafts.mass_kg[i], MASS_KG, "kg"),
                ("bearing_stiffness_n_per_m", shafts.bearing_stiffness_n_per_m[i], STIFFNESS, "N/m"),
                ("coupling_stiffness_n_m_per_rad", shafts.coupling_stiffness_n_m_per_rad[i], STIFFNESS, "N m/rad"),
            ] {
                between(place, "[shafts]", &format!("{key}[{i}]"), value, range, unit)?;
            }
            for (key, value, unit) in [
                ("bearing_damping_n_s_per_m", shafts.bearing_damping_n_s_per_m[i], "N s/m"),
                ("coupling_damping_n_m_s_per_rad", shafts.coupling_damping_n_m_s_per_rad[i], "N m s/rad"),
            ] {
                within(place, "[shafts]", &format!("{key}[{i}]"), value, 0.0, MOST_DAMPING, unit)?;
            }
        }
        Ok(())
    }

    fn check_options(&self, place: &str) -> Result<()> {
        if let Some(nominal) = &self.nominal {
            positive(place, "[nominal]", "speed_hz", nominal.speed_hz, "Hz")?;
            within(place, "[nominal]", "speed_hz", nominal.speed_hz, 0.0, crate::budget::SHAFT.most, "Hz")?;
            positive(place, "[nominal]", "torque_n_m", nominal.torque_n_m, "N m")?;
            within(place, "[nominal]", "torque_n_m", nominal.torque_n_m, 0.0, MOST_TORQUE_N_M, "N m")?;
        }
        if let Some(casing) = &self.casing {
            between(place, "[casing]", "mass_kg", casing.mass_kg, MASS_KG, "kg")?;
            for i in 0..2 {
                let stiffness = casing.stiffness_n_per_m[i];
                between(place, "[casing]", &format!("stiffness_n_per_m[{i}]"), stiffness, STIFFNESS, "N/m")?;
                let damping = casing.damping_n_s_per_m[i];
                within(place, "[casing]", &format!("damping_n_s_per_m[{i}]"), damping, 0.0, MOST_DAMPING, "N s/m")?;
            }
        }
        if let Some(motor) = &self.motor {
            positive(place, "[motor]", "line_frequency_hz", motor.line_frequency_hz, "Hz")?;
            within(place, "[motor]", "pole_pairs", f64::from(motor.pole_pairs), 1.0, 50.0, "")?;
            positive(place, "[motor]", "breakdown_torque_n_m", motor.breakdown_torque_n_m, "N m")?;
            within(place, "[motor]", "breakdown_slip", motor.breakdown_slip, 1e-3, 1.0, "")?;
        }
        if let Some(load) = &self.load {
            within(place, "[load]", "speed_exponent", load.speed_exponent, -1.0, 4.0, "")?;
        }
        if let Some(crack) = &self.crack {
            positive(place, "[crack]", "depth_m", crack.depth_m, "m")?;
            within(place, "[crack]", "angle_deg", crack.angle_deg, 10.0, 90.0, "degrees")?;
            let teeth = self.pair.teeth[crack.side.index()];
            if crack.tooth >= teeth {
                let what = format!("[crack] tooth: {} on a gear with teeth 0 to {}", crack.tooth, teeth - 1);
                return Err(Error::invalid(place, what));
            }
            if self.pair.pair_stiffness.is_some() || self.pair.total_stiffness.is_some() {
                let what = "[crack]: needs the pair's geometry; a stiffness table hides the tooth's shape";
                return Err(Error::invalid(place, what));
            }
        }
        self.check_engagement(place)
    }

    fn check_engagement(&self, place: &str) -> Result<()> {
        let Some(engagement) = &self.engagement else { return Ok(()) };
        let missing =
            |key: &str| Error::invalid(place, format!("[engagement] {key}: missing, this kind of engagement needs it"));
        if let Some(width) = engagement.width_rad {
            within(place, "[engagement]", "width_rad", width, 1e-7, 1.0, "rad")?;
        }
        match engagement.kind {
            EngagementKind::None | EngagementKind::Paper => {}
            EngagementKind::Linear | EngagementKind::RaisedCosine => {
                engagement.width_rad.ok_or_else(|| missing("width_rad"))?;
            }
            EngagementKind::TipRelief => {
                for relief in engagement.relief_m.ok_or_else(|| missing("relief_m"))? {
                    within(place, "[engagement]", "relief_m", relief, 0.0, 1e-3, "m")?;
                }
                let length =
                    engagement.relief_length_base_pitches.ok_or_else(|| missing("relief_length_base_pitches"))?;
                within(place, "[engagement]", "relief_length_base_pitches", length, 1e-4, 1.0, "base pitches")?;
                if let Some(exponent) = engagement.relief_exponent {
                    within(place, "[engagement]", "relief_exponent", f64::from(exponent), 1.0, 4.0, "")?;
                }
            }
            EngagementKind::Loaded => {}
        }
        if matches!(engagement.kind, EngagementKind::TipRelief | EngagementKind::Loaded) {
            let torque = engagement.torque_n_m.or(self.nominal.map(|n| n.torque_n_m));
            let torque = torque.ok_or_else(|| missing("torque_n_m (or [nominal] torque_n_m)"))?;
            positive(place, "[engagement]", "torque_n_m", torque, "N m")?;
        }
        Ok(())
    }

    /// Turns a damping ratio into the time that the equations of motion use.
    ///
    /// `tau = 2 zeta sqrt(m_e / k)` with the torsional equivalent mass and the mean stiffness, so that
    /// `tau k` is the damping of that ratio at the mean stiffness.
    pub(super) fn resolve_damping(&mut self, place: &str) -> Result<()> {
        let Some(ratio) = self.pair.mesh_damping_ratio else { return Ok(()) };
        let geometry = Geometry::new(&self.pair)?;
        let mean = self.pair_stiffness()?.integral();
        let seconds = 2.0 * ratio * (geometry.equivalent_mass_kg(&self.shafts) / mean).sqrt();
        let given = self.pair.mesh_damping_s;
        if given != 0.0 && (given - seconds).abs() > 1e-6 * seconds {
            let what =
                format!("[pair] mesh_damping_s: {given} s contradicts mesh_damping_ratio, which gives {seconds:e} s");
            return Err(Error::invalid(place, what));
        }
        self.pair.mesh_damping_s = seconds;
        Ok(())
    }
}

fn at(place: &str, table: &str, error: Error) -> Error {
    Error::invalid(place, format!("{table} {error}"))
}

fn within(place: &str, table: &str, key: &str, value: f64, from: f64, to: f64, unit: &str) -> Result<()> {
    if value.is_finite() && value >= from && value <= to {
        return Ok(());
    }
    let what = format!("{table} {key}: {value} {unit} lies outside {from} to {to}").replace("  ", " ");
    Err(Error::invalid(place, what))
}

fn positive(place: &str, table: &str, key: &str, value: f64, unit: &str) -> Result<()> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(Error::invalid(place, format!("{table} {key}: {value} {unit} must be positive")))
}

/// [`within`] a range that also excludes zero and below, said as such.
fn between(place: &str, table: &str, key: &str, value: f64, [from, to]: [f64; 2], unit: &str) -> Result<()> {
    positive(place, table, key, value, unit)?;
    if (from..=to).contains(&value) {
        return Ok(());
    }
    Err(Error::invalid(place, format!("{table} {key}: {value:e} {unit} lies outside {from:e} to {to:e}")))
}
