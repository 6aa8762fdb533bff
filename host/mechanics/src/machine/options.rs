//! Optional tables of a declaration: engagement, crack, motor, load, casing, operating point.
//!
//! Each is absent where the machine has nothing special there; the meaning of absence is stated at the
//! field of [`Machine`](super::Machine).

use serde::{Deserialize, Serialize};

/// One of the two gears.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Side {
    /// The driving gear, index 0.
    Pinion,
    /// The driven gear, index 1.
    Gear,
}

impl Side {
    /// Index into the two-element arrays of a declaration.
    pub fn index(self) -> usize {
        match self {
            Side::Pinion => 0,
            Side::Gear => 1,
        }
    }
}

/// Shape of the tooth between the root circle and its involute.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RootShape {
    /// Straight stub as thick as the tooth at the base circle, down to the root circle.
    #[default]
    RadialStub,
    /// The fillet that a rack cutter with a rounded tip generates (Ma et al. 2014).
    Trochoid,
    /// Cantilever clamped at the base circle: the original, stiffer form of Yang and Lin, and Tian.
    BaseCircle,
}

/// Half angle of the tooth at the root circle used by the gear body's compliance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RootAngle {
    /// The formula in common use, with the tooth's addendum where the cutter's is meant: 6 % small.
    #[default]
    Literature,
    /// Where the generated fillet really meets the root circle.
    Fillet,
}

/// How a pair takes up and gives off its share of the load.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Engagement {
    /// The mechanism.
    pub kind: EngagementKind,
    /// Pinion rotation over which the ramp lies (`paper`, `linear`, `raised-cosine`), rad.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub width_rad: Option<f64>,
    /// Relief at the tips of pinion and gear (`tip-relief`), m along the line of action.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relief_m: Option<[f64; 2]>,
    /// Length of the relief on the path of contact (`tip-relief`), base pitches.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relief_length_base_pitches: Option<f64>,
    /// Exponent of the relief, 1 linear, 2 parabolic (`tip-relief`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relief_exponent: Option<u32>,
    /// Pinion torque at which load-dependent ramps (`tip-relief`, `loaded`) are evaluated, N m; absent: nominal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub torque_n_m: Option<f64>,
}

/// Mechanism of an engagement ramp.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EngagementKind {
    /// Hard switch at the ends of the theoretical path.
    None,
    /// Linear over about 1 mrad of pinion rotation: a table step, calibrated on the paper's one surviving bandwidth.
    Paper,
    /// Linear over `width_rad`.
    Linear,
    /// Raised cosine over `width_rad`.
    RaisedCosine,
    /// Tip relief unloads the ends of the path; depends on torque.
    TipRelief,
    /// Deflected teeth touch outside the theoretical path; depends on torque.
    Loaded,
}

impl EngagementKind {
    /// Its name in a machine file.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Paper => "paper",
            Self::Linear => "linear",
            Self::RaisedCosine => "raised-cosine",
            Self::TipRelief => "tip-relief",
            Self::Loaded => "loaded",
        }
    }
}

/// A crack from the root of one tooth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Crack {
    /// Which gear is cracked.
    pub side: Side,
    /// Which of its teeth, counted from the pair that enters contact at shaft angle zero.
    #[serde(default)]
    pub tooth: u32,
    /// Depth along the crack, m.
    pub depth_m: f64,
    /// Angle between crack and tooth centre line, degrees.
    #[serde(default = "default_crack_angle")]
    pub angle_deg: f64,
    /// How much of the material beside the crack still carries.
    #[serde(default)]
    pub rule: CrackRule,
}

fn default_crack_angle() -> f64 {
    70.0
}

/// Border of the unloaded zone beside a crack.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CrackRule {
    /// A line from the crack's end parallel to the tooth's centre line (Tian 2004, Wu et al. 2008).
    #[default]
    Straight,
    /// A parabola from the crack's end to the tooth's tip (Mohammed, Chen and Shao).
    Parabolic,
}

/// Motor characteristic about its nominal speed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motor {
    /// Line frequency, Hz.
    pub line_frequency_hz: f64,
    /// Pole pairs.
    pub pole_pairs: u32,
    /// Breakdown torque, N m.
    pub breakdown_torque_n_m: f64,
    /// Slip at breakdown.
    pub breakdown_slip: f64,
}

/// Load characteristic.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Load {
    /// Torque grows with this power of speed: 0 constant, 1 generator, 2 fan.
    pub speed_exponent: f64,
}

/// Housing between bearings and ground.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Casing {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Mount stiffness across and along the line of action, N/m.
    pub stiffness_n_per_m: [f64; 2],
    /// Mount damping across and along the line of action, N s/m.
    pub damping_n_s_per_m: [f64; 2],
}

/// Operating point.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Nominal {
    /// Pinion speed, Hz.
    pub speed_hz: f64,
    /// Pinion torque, N m.
    pub torque_n_m: f64,
}
