//! Physical sense of a declaration: every refusal names table and key and says what would be right, all of them in
//! one line.

use super::geometry::Geometry;
use super::{EngagementKind, Machine};
use crate::{Error, Result};

/// What is a machine at all: from a watch's wheel to a mill's, with room on both sides. Whether a machine can be
/// computed for a sampling rate is another question, answered by its natural frequencies.
const INERTIA_KG_M2: [f64; 2] = [1e-15, 1e12];
const MASS_KG: [f64; 2] = [1e-9, 1e9];
const STIFFNESS: [f64; 2] = [1e-9, 1e16];
const MOST_DAMPING: f64 = 1e12;
/// Largest torque, N m.
pub const MOST_TORQUE_N_M: f64 = 1e9;
/// Smallest bore, m: the gear body's compliance has no limit for none.
const SMALLEST_BORE_M: f64 = 1e-6;

impl Machine {
    /// Checks every value; `place` names the source in the error, which holds everything that makes no sense.
    pub fn check(&self, place: &str) -> Result<()> {
        let mut faults = Faults::default();
        self.check_pair(&mut faults);
        self.check_shafts(&mut faults);
        self.check_options(&mut faults);
        faults.as_error(place)?;
        // Single values are right now; whether they make a gear pair together:
        Geometry::new(&self.pair).map_err(|error| Error::invalid(place, format!("[pair] {error}")))?;
        Ok(())
    }

    fn check_pair(&self, faults: &mut Faults) {
        let pair = &self.pair;
        for (i, &z) in pair.teeth.iter().enumerate() {
            if !(6..=1000).contains(&z) {
                faults.add("[pair]", "teeth", format!("{z} teeth on gear {i}: a spur gear has 6 to 1000"));
            }
        }
        faults.within("[pair]", "module_m", pair.module_m, 5e-5, 0.2, "m");
        faults.within("[pair]", "pressure_angle_deg", pair.pressure_angle_deg, 10.0, 35.0, "degrees");
        faults.within("[pair]", "face_width_m", pair.face_width_m, 1e-5, 5.0, "m");
        faults.within("[pair]", "youngs_modulus_pa", pair.youngs_modulus_pa, 1e6, 2e12, "Pa");
        faults.within("[pair]", "poisson", pair.poisson, 0.0, 0.499, "");
        faults.within("[pair]", "addendum_coefficient", pair.addendum_coefficient, 0.3, 1.7, "modules");
        faults.within("[pair]", "clearance_coefficient", pair.clearance_coefficient, 0.02, 0.6, "modules");
        for (i, &x) in pair.profile_shift.iter().enumerate() {
            faults.within("[pair]", &format!("profile_shift[{i}]"), x, -1.0, 1.5, "modules");
        }
        for (i, &bore) in pair.bore_radius_m.iter().enumerate() {
            let key = format!("bore_radius_m[{i}]");
            faults.within("[pair]", &key, bore, SMALLEST_BORE_M, 10.0, "m");
            let root = pair.module_m
                * (0.5 * f64::from(pair.teeth[i]) - pair.addendum_coefficient - pair.clearance_coefficient
                    + pair.profile_shift[i]);
            if bore >= root {
                let what = format!("{bore} m is not inside the root circle of {root:.6} m");
                faults.add("[pair]", &key, what);
            }
        }
        faults.within("[pair]", "mesh_damping_s", pair.mesh_damping_s, 0.0, 1.0, "s");
        if let Some(ratio) = pair.mesh_damping_ratio {
            faults.within("[pair]", "mesh_damping_ratio", ratio, 0.0, 2.0, "");
        }
        if pair.pair_stiffness.is_some() && pair.total_stiffness.is_some() {
            faults.add("[pair]", "total_stiffness", "give either this or pair_stiffness, not both".into());
        }
    }

    fn check_shafts(&self, faults: &mut Faults) {
        let shafts = &self.shafts;
        for (key, value) in [
            ("inertia_motor_kg_m2", shafts.inertia_motor_kg_m2),
            ("inertia_pinion_kg_m2", shafts.inertia_pinion_kg_m2),
            ("inertia_gear_kg_m2", shafts.inertia_gear_kg_m2),
            ("inertia_load_kg_m2", shafts.inertia_load_kg_m2),
        ] {
            faults.between("[shafts]", key, value, INERTIA_KG_M2, "kg m2");
        }
        for i in 0..2 {
            for (key, value, range, unit) in [
                ("mass_kg", shafts.mass_kg[i], MASS_KG, "kg"),
                ("bearing_stiffness_n_per_m", shafts.bearing_stiffness_n_per_m[i], STIFFNESS, "N/m"),
                ("coupling_stiffness_n_m_per_rad", shafts.coupling_stiffness_n_m_per_rad[i], STIFFNESS, "N m/rad"),
            ] {
                faults.between("[shafts]", &format!("{key}[{i}]"), value, range, unit);
            }
            for (key, value, unit) in [
                ("bearing_damping_n_s_per_m", shafts.bearing_damping_n_s_per_m[i], "N s/m"),
                ("coupling_damping_n_m_s_per_rad", shafts.coupling_damping_n_m_s_per_rad[i], "N m s/rad"),
            ] {
                faults.within("[shafts]", &format!("{key}[{i}]"), value, 0.0, MOST_DAMPING, unit);
            }
        }
    }

    fn check_options(&self, faults: &mut Faults) {
        if let Some(nominal) = &self.nominal {
            if faults.positive("[nominal]", "speed_hz", nominal.speed_hz, "Hz") {
                faults.within("[nominal]", "speed_hz", nominal.speed_hz, 0.0, crate::budget::SHAFT.most, "Hz");
            }
            if faults.positive("[nominal]", "torque_n_m", nominal.torque_n_m, "N m") {
                faults.within("[nominal]", "torque_n_m", nominal.torque_n_m, 0.0, MOST_TORQUE_N_M, "N m");
            }
        }
        if let Some(casing) = &self.casing {
            faults.between("[casing]", "mass_kg", casing.mass_kg, MASS_KG, "kg");
            for i in 0..2 {
                let stiffness = casing.stiffness_n_per_m[i];
                faults.between("[casing]", &format!("stiffness_n_per_m[{i}]"), stiffness, STIFFNESS, "N/m");
                let damping = casing.damping_n_s_per_m[i];
                faults.within("[casing]", &format!("damping_n_s_per_m[{i}]"), damping, 0.0, MOST_DAMPING, "N s/m");
            }
        }
        if let Some(motor) = &self.motor {
            faults.positive("[motor]", "line_frequency_hz", motor.line_frequency_hz, "Hz");
            faults.within("[motor]", "pole_pairs", f64::from(motor.pole_pairs), 1.0, 50.0, "");
            faults.positive("[motor]", "breakdown_torque_n_m", motor.breakdown_torque_n_m, "N m");
            faults.within("[motor]", "breakdown_slip", motor.breakdown_slip, 1e-3, 1.0, "");
        }
        if let Some(load) = &self.load {
            faults.within("[load]", "speed_exponent", load.speed_exponent, -1.0, 4.0, "");
        }
        if let Some(crack) = &self.crack {
            faults.positive("[crack]", "depth_m", crack.depth_m, "m");
            faults.within("[crack]", "angle_deg", crack.angle_deg, 10.0, 90.0, "degrees");
            let teeth = self.pair.teeth[crack.side.index()];
            if crack.tooth >= teeth {
                let what = format!("{} on a gear with teeth 0 to {}", crack.tooth, teeth.saturating_sub(1));
                faults.add("[crack]", "tooth", what);
            }
            if self.pair.pair_stiffness.is_some() || self.pair.total_stiffness.is_some() {
                faults.0.push("[crack]: needs the pair's geometry; a stiffness table hides the tooth's shape".into());
            }
        }
        self.check_engagement(faults);
    }

    fn check_engagement(&self, faults: &mut Faults) {
        let Some(engagement) = &self.engagement else { return };
        let table = "[engagement]";
        let mut needs = |key: &str| faults.add(table, key, "missing, this kind of engagement needs it".into());
        let relieved = engagement.kind == EngagementKind::TipRelief;
        if matches!(engagement.kind, EngagementKind::Linear | EngagementKind::RaisedCosine)
            && engagement.width_rad.is_none()
        {
            needs("width_rad");
        }
        if relieved && engagement.relief_m.is_none() {
            needs("relief_m");
        }
        if relieved && engagement.relief_length_base_pitches.is_none() {
            needs("relief_length_base_pitches");
        }
        let torque = engagement.torque_n_m.or(self.nominal.map(|n| n.torque_n_m));
        let loaded = relieved || engagement.kind == EngagementKind::Loaded;
        if loaded && torque.is_none() {
            needs("torque_n_m (or [nominal] torque_n_m)");
        }
        if let Some(width) = engagement.width_rad {
            faults.within(table, "width_rad", width, 1e-7, 1.0, "rad");
        }
        if relieved {
            for relief in engagement.relief_m.into_iter().flatten() {
                faults.within(table, "relief_m", relief, 0.0, 1e-3, "m");
            }
            if let Some(length) = engagement.relief_length_base_pitches {
                faults.within(table, "relief_length_base_pitches", length, 1e-4, 1.0, "base pitches");
            }
            if let Some(exponent) = engagement.relief_exponent {
                faults.within(table, "relief_exponent", f64::from(exponent), 1.0, 4.0, "");
            }
        }
        if let Some(torque) = engagement.torque_n_m.filter(|_| loaded) {
            faults.positive(table, "torque_n_m", torque, "N m");
        }
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

/// Everything that makes no sense, each with table and key.
#[derive(Default)]
struct Faults(Vec<String>);

impl Faults {
    fn add(&mut self, table: &str, key: &str, what: String) {
        self.0.push(format!("{table} {key}: {what}"));
    }

    fn as_error(&self, place: &str) -> Result<()> {
        if self.0.is_empty() { Ok(()) } else { Err(Error::invalid(place, self.0.join("; "))) }
    }

    fn within(&mut self, table: &str, key: &str, value: f64, from: f64, to: f64, unit: &str) {
        if !(value.is_finite() && value >= from && value <= to) {
            self.add(table, key, format!("{value} {unit} lies outside {from} to {to}").replace("  ", " "));
        }
    }

    /// Whether it is.
    fn positive(&mut self, table: &str, key: &str, value: f64, unit: &str) -> bool {
        let is = value.is_finite() && value > 0.0;
        if !is {
            self.add(table, key, format!("{value} {unit} must be positive"));
        }
        is
    }

    /// [`Self::within`] a range that also excludes zero and below, said as such.
    fn between(&mut self, table: &str, key: &str, value: f64, [from, to]: [f64; 2], unit: &str) {
        if self.positive(table, key, value, unit) && !(from..=to).contains(&value) {
            self.add(table, key, format!("{value:e} {unit} lies outside {from:e} to {to:e}"));
        }
    }
}
