//! Machines and layouts drawn at random, so that no proof rests on the two that the loop grew up with.
//!
//! Gears as they are built: 17 to 80 teeth, module 1.5 to 6 mm, face of 6 to 12 modules, steel discs on shafts that
//! add to their mass; pair stiffness from this geometry by the stiffness model with an engagement ramp. Bearings and
//! couplings are drawn by the frequencies and damping ratios that they give the bodies, so that a machine is lightly
//! damped and has modes in the band. Three to five speeds, one or two torques: the loop's model-based inference needs
//! three speeds.

use crate::Result;
use crate::generate::Scenario;
use crate::machine::{Engagement, EngagementKind, Geometry, Machine, Pair, Shafts};
use crate::observation::input::Record;
use crate::stiffness::pair_curve::PairCurve;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::{PI, TAU};
use std::path::PathBuf;

/// Density of steel, kg/m3.
const STEEL: f64 = 7850.0;

/// Uniform between two values.
fn between(random: &mut ChaCha8Rng, from: f64, to: f64) -> f64 {
    from + (to - from) * random.random::<f64>()
}

/// A declared machine without runs.
///
/// # Errors
/// Those of the stiffness model.
pub fn machine(random: &mut ChaCha8Rng) -> Result<Record> {
    let teeth = [0, 1].map(|_| 17 + random.random::<u32>() % 64);
    let teeth = [teeth[0].min(teeth[1]), teeth[0].max(teeth[1])];
    let module_m = (between(random, 1.5, 6.0) * 4.0).round() * 0.25e-3;
    let face_m = module_m * between(random, 6.0, 12.0).round();
    let root = teeth.map(|z| 0.5 * module_m * (f64::from(z) - 2.5));
    let bore_radius_m = root.map(|r| r * between(random, 0.3, 0.45));
    let mut pair = Pair::spur(teeth, module_m, face_m, bore_radius_m);
    let shafts = shafts(random, teeth, module_m, face_m);
    // An eighth to a third of a base pitch.
    let width_rad = TAU / f64::from(teeth[0]) * between(random, 0.12, 0.33);
    let engagement = Engagement {
        kind: EngagementKind::RaisedCosine,
        width_rad: Some(width_rad),
        relief_m: None,
        relief_length_base_pitches: None,
        relief_exponent: None,
        torque_n_m: None,
    };
    let title = format!("drawn {}/{}, module {:.2} mm", teeth[0], teeth[1], 1e3 * module_m);
    let mut whole = Machine {
        title,
        pair: pair.clone(),
        shafts,
        engagement: Some(engagement),
        crack: None,
        motor: None,
        load: None,
        casing: None,
        nominal: None,
        folder: PathBuf::new(),
    };
    let curve = PairCurve::sampled(&whole.pair_stiffness()?);
    let mean = curve.transform(0.0).re;
    let mesh_mass_kg = Geometry::new(&pair)?.equivalent_mass_kg(&whole.shafts);
    pair.mesh_damping_s = 2.0 * between(random, 0.02, 0.07) * (mesh_mass_kg / mean).sqrt();
    whole.pair = pair;
    let Machine { title, pair, shafts, .. } = whole;
    Ok(Record {
        title,
        pair,
        shafts,
        curve,
        sample_rate_hz: 51_200.0,
        unit: "m/s2".into(),
        top_hz: None,
        pulses_per_rev: 1,
        jitter_s: 5e-7,
        runs: Vec::new(),
    })
}

/// Bodies, bearings and couplings.
fn shafts(random: &mut ChaCha8Rng, teeth: [u32; 2], module_m: f64, face_m: f64) -> Shafts {
    let radius = teeth.map(|z| 0.5 * module_m * f64::from(z));
    let body = radius.map(|r| PI * r * r * face_m * STEEL);
    let mass_kg = body.map(|m| m * between(random, 1.3, 2.5) + 0.2);
    let inertia = [0, 1].map(|i| 0.5 * body[i] * radius[i] * radius[i] * between(random, 1.0, 1.4));
    let [motor, load] = inertia.map(|j| j * between(random, 2.0, 8.0));
    // A spring's stiffness and damping by the frequency and the damping ratio that it gives this inertia.
    let mut spring = |inertia: f64, hz: [f64; 2], ratio: [f64; 2]| {
        let (omega, zeta) = (TAU * between(random, hz[0], hz[1]), between(random, ratio[0], ratio[1]));
        [inertia * omega * omega, 2.0 * zeta * inertia * omega]
    };
    let bearing = mass_kg.map(|m| spring(m, [600.0, 2200.0], [0.02, 0.08]));
    let coupling = inertia.map(|j| spring(j, [120.0, 500.0], [0.02, 0.06]));
    Shafts {
        inertia_motor_kg_m2: motor,
        inertia_pinion_kg_m2: inertia[0],
        inertia_gear_kg_m2: inertia[1],
        inertia_load_kg_m2: load,
        coupling_stiffness_n_m_per_rad: coupling.map(|c| c[0]),
        coupling_damping_n_m_s_per_rad: coupling.map(|c| c[1]),
        mass_kg,
        bearing_stiffness_n_per_m: bearing.map(|b| b[0]),
        bearing_damping_n_s_per_m: bearing.map(|b| b[1]),
    }
}

/// Speeds and torques of a record of this machine.
pub fn layout(declared: &Record, scenario: &mut Scenario, random: &mut ChaCha8Rng) {
    let count = 3 + random.random::<u32>() as usize % 3;
    let lowest = between(random, 7.0, 12.0);
    let step = between(random, 1.2, 1.5);
    scenario.speeds_hz = (0..count).map(|i| lowest * step.powi(i as i32) * between(random, 0.97, 1.03)).collect();
    // A tooth load of 40 to 120 N per mm of face.
    let radius_m = 0.5 * declared.pair.module_m * f64::from(declared.pair.teeth[0]);
    let torque = between(random, 4e4, 12e4) * declared.pair.face_width_m * radius_m;
    scenario.torques_n_m = if random.random::<bool>() { vec![torque] } else { vec![torque, 0.45 * torque] };
}
