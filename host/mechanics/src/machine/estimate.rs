//! A whole machine from what its owner knows: teeth, module, width, power, speed, and a few more where they are known.
//!
//! Everything else is estimated by the rules below and named as a guess, with the factor that it may be off by, so that
//! `law::guesses` can say which of them move the bandwidth law. The rules are those of machine design handbooks
//! (Niemann/Winter, Roark): solid discs of steel, bores at the root radius over 2.6, shafts as long as four face
//! widths, bearings by their kind. They give orders of magnitude, no more; a measured or catalogued value in the file
//! is always better.

use super::{Engagement, EngagementKind, Machine, Nominal, Pair, Shafts, damping};
use crate::{Error, Result};
use std::f64::consts::{PI, TAU};
use std::path::Path;

/// Density of steel, kg/m3.
const STEEL_KG_M3: f64 = 7_850.0;
/// Shear modulus of steel, Pa.
const SHEAR_PA: f64 = 79.3e9;
/// Root radius over bore radius.
const ROOT_OVER_BORE: f64 = 2.6;
/// Ramp of engagement in base pitches, where nobody knows it.
const RAMP_BASE_PITCHES: f64 = 0.125;

/// Bearings by their kind: radial stiffness for one shaft's pair of small-machine bearings, N/m, and damping ratio.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Bearings {
    /// Deep-groove balls: 1e8 N/m.
    #[default]
    Ball,
    /// Cylinder or taper rollers: 3e8 N/m.
    Roller,
    /// Oil films: 2e8 N/m, strongly damped.
    Plain,
}

/// What the owner knows, SI units.
#[derive(Debug, Clone, PartialEq)]
pub struct Known {
    /// Title.
    pub title: String,
    /// Tooth counts of pinion and gear.
    pub teeth: [u32; 2],
    /// Module, m.
    pub module_m: f64,
    /// Face width, m.
    pub face_width_m: f64,
    /// Pinion speed, Hz.
    pub speed_hz: f64,
    /// Pinion torque, N m.
    pub torque_n_m: f64,
    /// Pressure angle, degrees.
    pub pressure_angle_deg: Option<f64>,
    /// Bores, m.
    pub bore_radius_m: Option<[f64; 2]>,
    /// Pinion rotation over which a pair takes up its load, rad.
    pub ramp_rad: Option<f64>,
    /// Tip relief, m.
    pub relief_m: Option<f64>,
    /// Kind of the bearings.
    pub bearings: Option<Bearings>,
}

/// How far a guess may be from the truth.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reach {
    /// The truth lies within this factor above or below.
    Factor(f64),
    /// The truth may as well be this.
    Or(&'static str),
}

impl std::fmt::Display for Reach {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Factor(factor) => write!(f, "within a factor {factor}"),
            Self::Or(other) => write!(f, "or {other}"),
        }
    }
}

/// A value that was estimated.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Guess {
    /// Table and key.
    pub key: &'static str,
    /// What stands in the file.
    pub value: String,
    /// How far off it may be.
    pub reach: Reach,
    /// How it was estimated.
    pub rule: &'static str,
}

/// A machine with what in it is guessed.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimated {
    /// The machine, checked.
    pub machine: Machine,
    /// The guesses, in the order of the file.
    pub guesses: Vec<Guess>,
}

/// Estimates the rest.
///
/// # Errors
/// Values that make no machine, with the key.
pub fn estimate(known: &Known) -> Result<Estimated> {
    let known = checked(known)?;
    let roots = known.teeth.map(|z| known.module_m * (0.5 * f64::from(z) - 1.25));
    let bores = known.bore_radius_m.unwrap_or(roots.map(|root| root / ROOT_OVER_BORE));
    let mut pair = Pair::spur(known.teeth, known.module_m, known.face_width_m, bores);
    pair.pressure_angle_deg = known.pressure_angle_deg.unwrap_or(pair.pressure_angle_deg);
    pair.mesh_damping_ratio = Some(0.05);
    let shafts = shafts(known, bores);
    let engagement = engagement(known);
    let nominal = Some(Nominal { speed_hz: known.speed_hz, torque_n_m: known.torque_n_m });
    let machine = Machine {
        title: known.title.clone(),
        pair,
        shafts,
        engagement: Some(engagement),
        crack: None,
        motor: None,
        load: None,
        casing: None,
        nominal,
        folder: Default::default(),
    };
    let machine = machine.prepared(&known.title, Path::new(""))?;
    let guesses = guesses(known, &machine);
    Ok(Estimated { machine, guesses })
}

fn checked(known: &Known) -> Result<&Known> {
    let positive = [
        ("module", known.module_m),
        ("width", known.face_width_m),
        ("speed", known.speed_hz),
        ("torque", known.torque_n_m),
    ];
    match positive.iter().find(|(_, value)| !(value.is_finite() && *value > 0.0)) {
        Some((name, value)) => Err(Error::invalid(name, format!("{value} is not a positive number"))),
        None => Ok(known),
    }
}

/// Discs, shafts and bearings.
fn shafts(known: &Known, bores: [f64; 2]) -> Shafts {
    let side = |i: usize| {
        let pitch = 0.5 * known.module_m * f64::from(known.teeth[i]);
        let disc = STEEL_KG_M3 * PI * pitch * pitch * known.face_width_m;
        // The shaft fills the bore and is four face widths long.
        let shaft = STEEL_KG_M3 * PI * bores[i] * bores[i] * 4.0 * known.face_width_m;
        let inertia = 0.5 * disc * pitch * pitch;
        let torsion = SHEAR_PA * 0.5 * PI * bores[i].powi(4) / (8.0 * known.face_width_m);
        (disc + 0.5 * shaft, inertia, torsion)
    };
    let sides = [side(0), side(1)];
    let [inertia_pinion, inertia_gear] = sides.map(|s| s.1);
    let [motor, load] = [4.0 * inertia_pinion, 2.0 * inertia_gear];
    let stiffness = sides.map(|s| s.2);
    let masses = sides.map(|s| s.0);
    let (bearing, ratio) = match known.bearings.unwrap_or_default() {
        Bearings::Ball => (1e8, damping::BEARING),
        Bearings::Roller => (3e8, 0.03),
        Bearings::Plain => (2e8, 0.2),
    };
    let coupling_damping = |i: usize| {
        let ends = [[inertia_pinion, motor], [inertia_gear, load]];
        damping::of_coupling(damping::COUPLING, stiffness[i], ends[i])
    };
    Shafts {
        inertia_motor_kg_m2: motor,
        inertia_pinion_kg_m2: inertia_pinion,
        inertia_gear_kg_m2: inertia_gear,
        inertia_load_kg_m2: load,
        coupling_stiffness_n_m_per_rad: stiffness,
        coupling_damping_n_m_s_per_rad: [coupling_damping(0), coupling_damping(1)],
        mass_kg: masses,
        bearing_stiffness_n_per_m: [bearing; 2],
        bearing_damping_n_s_per_m: masses.map(|mass| damping::of_bearing(ratio, bearing, mass)),
    }
}

fn engagement(known: &Known) -> Engagement {
    let base = Engagement {
        kind: EngagementKind::RaisedCosine,
        width_rad: None,
        relief_m: None,
        relief_length_base_pitches: None,
        relief_exponent: None,
        torque_n_m: None,
    };
    match (known.ramp_rad, known.relief_m) {
        (Some(width), _) => Engagement { width_rad: Some(width), ..base },
        (None, Some(relief)) => Engagement {
            kind: EngagementKind::TipRelief,
            relief_m: Some([relief; 2]),
            relief_length_base_pitches: Some(0.25),
            relief_exponent: Some(2),
            ..base
        },
        (None, None) => Engagement { width_rad: Some(RAMP_BASE_PITCHES * TAU / f64::from(known.teeth[0])), ..base },
    }
}

fn guesses(known: &Known, machine: &Machine) -> Vec<Guess> {
    let (shafts, pair) = (&machine.shafts, &machine.pair);
    let mut list = Vec::new();
    let mut push = |key, value: String, reach, rule| list.push(Guess { key, value, reach, rule });
    // Two ramps of one width and another shape have other bandwidths: the shape is a guess wherever the ramp itself
    // is known.
    match (known.ramp_rad, known.relief_m) {
        (None, Some(_)) => push("[engagement] relief_exponent", "2".into(), Reach::Or("1"), "parabolic, not linear"),
        _ => {
            let rule = "smooth: a linear ramp has corners";
            push("[engagement] kind", "raised-cosine".into(), Reach::Or("linear"), rule);
        }
    }
    let mut add = |key, value: String, factor, rule| push(key, value, Reach::Factor(factor), rule);
    if known.bore_radius_m.is_none() {
        add("[pair] bore_radius_m", two(pair.bore_radius_m), 1.3, "root radius over 2.6");
    }
    add("[pair] mesh_damping_ratio", "0.05".into(), 2.0, "usual for steel gears in oil");
    match (known.ramp_rad, known.relief_m) {
        (Some(_), _) => {}
        (None, Some(_)) => {
            add("[engagement] relief_length_base_pitches", "0.25".into(), 2.0, "a quarter of a base pitch")
        }
        (None, None) => {
            let width = machine.engagement.and_then(|e| e.width_rad).unwrap_or(0.0);
            add("[engagement] width_rad", format!("{width:.4e}"), 4.0, "an eighth of a base pitch");
        }
    }
    let [motor, load] = [shafts.inertia_motor_kg_m2, shafts.inertia_load_kg_m2];
    let [pinion, gear] = [shafts.inertia_pinion_kg_m2, shafts.inertia_gear_kg_m2];
    add("[shafts] inertia_motor_kg_m2", one(motor), 4.0, "four pinions");
    add("[shafts] inertia_pinion_kg_m2", one(pinion), 2.0, "solid disc of steel at the pitch circle");
    add("[shafts] inertia_gear_kg_m2", one(gear), 2.0, "solid disc of steel at the pitch circle");
    add("[shafts] inertia_load_kg_m2", one(load), 4.0, "two gears");
    add(
        "[shafts] coupling_stiffness_n_m_per_rad",
        two(shafts.coupling_stiffness_n_m_per_rad),
        5.0,
        "steel shaft in the bore, eight face widths long",
    );
    add("[shafts] coupling_damping_n_m_s_per_rad", two(shafts.coupling_damping_n_m_s_per_rad), 3.0, "5 % of critical");
    add("[shafts] mass_kg", two(shafts.mass_kg), 2.0, "disc and half its shaft");
    add("[shafts] bearing_stiffness_n_per_m", two(shafts.bearing_stiffness_n_per_m), 3.0, "by the kind of bearings");
    add("[shafts] bearing_damping_n_s_per_m", two(shafts.bearing_damping_n_s_per_m), 3.0, "by the kind of bearings");
    list
}

fn one(value: f64) -> String {
    format!("{value:.4e}")
}

fn two(values: [f64; 2]) -> String {
    format!("[{:.4e}, {:.4e}]", values[0], values[1])
}

impl Estimated {
    /// The same machine with the guess `index` as far off as it may be: smaller, larger, or the other choice.
    ///
    /// # Errors
    /// A machine that is none with this value.
    pub fn moved(&self, index: usize) -> Vec<Result<Machine>> {
        let guess = &self.guesses[index];
        let changed = |change: &dyn Fn(&mut Machine)| {
            let mut machine = self.machine.clone();
            change(&mut machine);
            // Worked out again from the ratio.
            machine.pair.mesh_damping_s = 0.0;
            let folder = machine.folder.clone();
            machine.prepared(guess.key, &folder)
        };
        match guess.reach {
            Reach::Factor(factor) => {
                [factor, 1.0 / factor].map(|factor| changed(&|machine| scale(machine, guess.key, factor))).into()
            }
            Reach::Or(_) => vec![changed(&|machine| choose_other(machine, guess.key))],
        }
    }

    /// The machine file, every guess marked with its rule and factor.
    pub fn to_toml(&self) -> String {
        let m = &self.machine;
        let mut out = format!(
            "# Estimated from a few figures; SI units. Every line marked GUESS is worth replacing by a known \
             value.\ntitle = {}\n",
            toml::Value::from(m.title.as_str())
        );
        out += &self.table("pair", &pair_values(&m.pair));
        if let Some(engagement) = &m.engagement {
            out += &self.table("engagement", &engagement_values(engagement));
        }
        out += &self.table("shafts", &shaft_values(&m.shafts));
        if let Some(n) = m.nominal {
            let values = [("speed_hz", format!("{:?}", n.speed_hz)), ("torque_n_m", format!("{:?}", n.torque_n_m))];
            out += &self.table("nominal", &values);
        }
        out
    }

    /// One table, its guesses marked.
    fn table(&self, table: &str, values: &[(&str, String)]) -> String {
        let mut out = format!("\n[{table}]\n");
        for (key, value) in values {
            let full = format!("[{table}] {key}");
            let mark = match self.guesses.iter().find(|guess| guess.key == full) {
                Some(guess) => format!(" # GUESS, {}: {}", guess.reach, guess.rule),
                None => String::new(),
            };
            out += &format!("{key} = {value}{mark}\n");
        }
        out
    }
}

/// Scales the value of a guess.
fn scale(machine: &mut Machine, key: &str, factor: f64) {
    let pair = |values: &mut [f64; 2]| values.iter_mut().for_each(|value| *value *= factor);
    let one = |value: Option<&mut f64>| value.into_iter().for_each(|value| *value *= factor);
    let (shafts, engagement) = (&mut machine.shafts, machine.engagement.as_mut());
    match key {
        "[pair] bore_radius_m" => pair(&mut machine.pair.bore_radius_m),
        "[pair] mesh_damping_ratio" => one(machine.pair.mesh_damping_ratio.as_mut()),
        "[engagement] relief_length_base_pitches" => {
            one(engagement.and_then(|e| e.relief_length_base_pitches.as_mut()));
        }
        "[engagement] width_rad" => one(engagement.and_then(|e| e.width_rad.as_mut())),
        "[shafts] inertia_motor_kg_m2" => shafts.inertia_motor_kg_m2 *= factor,
        "[shafts] inertia_pinion_kg_m2" => shafts.inertia_pinion_kg_m2 *= factor,
        "[shafts] inertia_gear_kg_m2" => shafts.inertia_gear_kg_m2 *= factor,
        "[shafts] inertia_load_kg_m2" => shafts.inertia_load_kg_m2 *= factor,
        "[shafts] coupling_stiffness_n_m_per_rad" => pair(&mut shafts.coupling_stiffness_n_m_per_rad),
        "[shafts] coupling_damping_n_m_s_per_rad" => pair(&mut shafts.coupling_damping_n_m_s_per_rad),
        "[shafts] mass_kg" => pair(&mut shafts.mass_kg),
        "[shafts] bearing_stiffness_n_per_m" => pair(&mut shafts.bearing_stiffness_n_per_m),
        _ => pair(&mut shafts.bearing_damping_n_s_per_m),
    }
}

/// Takes the other choice of a guess that is one.
fn choose_other(machine: &mut Machine, key: &str) {
    let Some(engagement) = &mut machine.engagement else { return };
    match key {
        "[engagement] kind" => engagement.kind = EngagementKind::Linear,
        _ => engagement.relief_exponent = Some(1),
    }
}

fn pair_values(p: &Pair) -> [(&'static str, String); 8] {
    [
        ("teeth", format!("[{}, {}]", p.teeth[0], p.teeth[1])),
        ("module_m", format!("{:?}", p.module_m)),
        ("pressure_angle_deg", format!("{:?}", p.pressure_angle_deg)),
        ("face_width_m", format!("{:?}", p.face_width_m)),
        ("bore_radius_m", two(p.bore_radius_m)),
        ("youngs_modulus_pa", one(p.youngs_modulus_pa)),
        ("poisson", format!("{:?}", p.poisson)),
        ("mesh_damping_ratio", format!("{:?}", p.mesh_damping_ratio.unwrap_or_default())),
    ]
}

fn engagement_values(e: &Engagement) -> Vec<(&'static str, String)> {
    match (e.width_rad, e.relief_m) {
        (Some(width), _) => vec![("kind", "\"raised-cosine\"".into()), ("width_rad", format!("{width:.6e}"))],
        (None, relief) => vec![
            ("kind", "\"tip-relief\"".into()),
            ("relief_m", two(relief.unwrap_or_default())),
            ("relief_length_base_pitches", format!("{:?}", e.relief_length_base_pitches.unwrap_or_default())),
            ("relief_exponent", e.relief_exponent.unwrap_or(1).to_string()),
        ],
    }
}

fn shaft_values(s: &Shafts) -> [(&'static str, String); 9] {
    [
        ("inertia_motor_kg_m2", one(s.inertia_motor_kg_m2)),
        ("inertia_pinion_kg_m2", one(s.inertia_pinion_kg_m2)),
        ("inertia_gear_kg_m2", one(s.inertia_gear_kg_m2)),
        ("inertia_load_kg_m2", one(s.inertia_load_kg_m2)),
        ("coupling_stiffness_n_m_per_rad", two(s.coupling_stiffness_n_m_per_rad)),
        ("coupling_damping_n_m_s_per_rad", two(s.coupling_damping_n_m_s_per_rad)),
        ("mass_kg", two(s.mass_kg)),
        ("bearing_stiffness_n_per_m", two(s.bearing_stiffness_n_per_m)),
        ("bearing_damping_n_s_per_m", two(s.bearing_damping_n_s_per_m)),
    ]
}
