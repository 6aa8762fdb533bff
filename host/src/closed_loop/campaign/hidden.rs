//! What a campaign hides in a record: one entry per effect, with the names and families that count as right.

use crate::closed_loop::generate::Effect;
use crate::machine::Pair;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// One effect a campaign can hide.
pub struct Kind {
    /// Its own name.
    pub name: &'static str,
    /// Library names that are right for it; empty where only a generic verdict is.
    pub right_names: &'static [&'static str],
    /// Families that are right for it.
    pub families: &'static [&'static str],
    /// Strength at which its lines are measured to find the detection floor, or the strength itself.
    pub reference: f64,
    /// Whether the strength is proportional to what it leaves in the record, so that a detection floor exists.
    pub has_floor: bool,
    /// Start of the outcome's parameter that states the strength; empty where none compares.
    pub parameter: &'static str,
    /// Builds it at a strength.
    pub build: fn(f64, &Pair, &mut ChaCha8Rng) -> Effect,
}

fn phase(rng: &mut ChaCha8Rng) -> f64 {
    TAU * rng.random::<f64>()
}

fn tooth(pair: &Pair, shaft: usize, rng: &mut ChaCha8Rng) -> usize {
    (rng.random::<u32>() % pair.teeth[shaft]) as usize
}

fn pitch(size: f64, pair: &Pair, shaft: usize, rng: &mut ChaCha8Rng) -> Effect {
    let mut offsets_m = vec![0.0; pair.teeth[shaft] as usize];
    offsets_m[tooth(pair, shaft, rng)] = size;
    Effect::PitchError { shaft, offsets_m }
}

/// Order away from whole orders of either shaft.
fn odd_order(pair: &Pair, rng: &mut ChaCha8Rng) -> f64 {
    let ratio = f64::from(pair.teeth[0]) / f64::from(pair.teeth[1]);
    let off = |x: f64| (x - x.round()).abs();
    loop {
        let order = 2.0 + 6.0 * rng.random::<f64>();
        if off(order) > 0.1 && off(order / ratio) > 0.1 {
            return order;
        }
    }
}

fn side(rng: &mut ChaCha8Rng) -> usize {
    usize::from(rng.random::<bool>())
}

const SHAFT: &[&str] = &["shaft-order", "sideband"];

/// Every effect a campaign hides, in the order it cycles through them.
pub const KINDS: &[Kind] = &[
    Kind {
        name: "pinion-eccentricity",
        right_names: &["pinion-eccentricity"],
        families: SHAFT,
        reference: 5e-6,
        has_floor: true,
        parameter: "amplitude",
        build: |size, _, rng| Effect::Eccentricity { shaft: 0, amplitude_m: size, phase_rad: phase(rng) },
    },
    Kind {
        name: "gear-eccentricity",
        right_names: &["gear-eccentricity"],
        families: SHAFT,
        reference: 5e-6,
        has_floor: true,
        parameter: "amplitude",
        build: |size, _, rng| Effect::Eccentricity { shaft: 1, amplitude_m: size, phase_rad: phase(rng) },
    },
    Kind {
        name: "pinion-imbalance",
        right_names: &["pinion-imbalance"],
        families: SHAFT,
        reference: 1e-3,
        has_floor: true,
        parameter: "unbalance",
        build: |size, _, rng| Effect::Imbalance { shaft: 0, kg_m: size, phase_rad: phase(rng) },
    },
    Kind {
        name: "gear-imbalance",
        right_names: &["gear-imbalance"],
        families: SHAFT,
        reference: 1e-3,
        has_floor: true,
        parameter: "unbalance",
        build: |size, _, rng| Effect::Imbalance { shaft: 1, kg_m: size, phase_rad: phase(rng) },
    },
    Kind {
        name: "pinion-pitch-error",
        right_names: &["pinion-pitch-error"],
        families: SHAFT,
        reference: 5e-6,
        has_floor: true,
        parameter: "single_tooth_offset",
        build: |size, pair, rng| pitch(size, pair, 0, rng),
    },
    Kind {
        name: "gear-pitch-error",
        right_names: &["gear-pitch-error"],
        families: SHAFT,
        reference: 5e-6,
        has_floor: true,
        parameter: "single_tooth_offset",
        build: |size, pair, rng| pitch(size, pair, 1, rng),
    },
    Kind {
        name: "pinion-tooth-crack",
        right_names: &["pinion-tooth-crack"],
        families: SHAFT,
        reference: 0.05,
        has_floor: true,
        parameter: "stiffness_loss",
        build: |size, pair, rng| Effect::Crack { shaft: 0, tooth: tooth(pair, 0, rng), share: size },
    },
    Kind {
        name: "gear-tooth-crack",
        right_names: &["gear-tooth-crack"],
        families: SHAFT,
        reference: 0.05,
        has_floor: true,
        parameter: "stiffness_loss",
        build: |size, pair, rng| Effect::Crack { shaft: 1, tooth: tooth(pair, 1, rng), share: size },
    },
    Kind {
        name: "ghost-order",
        right_names: &["ghost-order"],
        families: SHAFT,
        reference: 1e-6,
        has_floor: true,
        parameter: "amplitude",
        build: |size, pair, rng| {
            let z = pair.teeth[0];
            let order = f64::from(5 + rng.random::<u32>() % (z - 6));
            Effect::Ghost { order, amplitude_m: size, phase_rad: phase(rng) }
        },
    },
    Kind {
        name: "torque-ripple",
        right_names: &["torque-ripple"],
        families: &["shaft-order", "sideband", "non-integer-order"],
        reference: 0.05,
        has_floor: true,
        parameter: "share_of_torque",
        build: |size, _, rng| {
            let order = f64::from(3 + rng.random::<u32>() % 6);
            Effect::TorqueRipple { at: 0, order, share: size, phase_rad: phase(rng) }
        },
    },
    Kind {
        name: "load-fluctuation",
        right_names: &["load-fluctuation"],
        families: &["shaft-order", "sideband", "non-integer-order"],
        reference: 0.05,
        has_floor: true,
        parameter: "share_of_torque",
        build: |size, pair, rng| Effect::TorqueRipple {
            at: 3,
            order: odd_order(pair, rng),
            share: size,
            phase_rad: phase(rng),
        },
    },
    Kind {
        name: "coupling-misalignment",
        right_names: &["coupling-misalignment"],
        families: SHAFT,
        reference: 20.0,
        has_floor: true,
        parameter: "radial_force",
        build: |size, _, rng| Effect::Misalignment { shaft: side(rng), force_n: size, phase_rad: phase(rng) },
    },
    Kind {
        name: "bearing-stiffness-modulation",
        right_names: &["bearing-stiffness-modulation"],
        families: &["non-integer-order", "sideband"],
        reference: 0.02,
        has_floor: true,
        parameter: "share_of_stiffness",
        build: |size, pair, rng| Effect::BearingModulation {
            shaft: side(rng),
            order: odd_order(pair, rng),
            share: size,
            phase_rad: phase(rng),
        },
    },
    Kind {
        name: "mesh-stiffness-modulation",
        right_names: &["mesh-stiffness-modulation"],
        families: &["non-integer-order", "shaft-order", "sideband"],
        reference: 0.02,
        has_floor: true,
        parameter: "share_of_stiffness",
        build: |size, pair, rng| Effect::StiffnessModulation {
            order: odd_order(pair, rng),
            share: size,
            phase_rad: phase(rng),
        },
    },
    Kind {
        name: "wear",
        right_names: &["wear"],
        families: &["mesh-order"],
        reference: 5e-6,
        has_floor: true,
        parameter: "depth",
        build: |size, _, _| Effect::Wear { depth_m: size },
    },
    Kind {
        name: "tip-relief",
        right_names: &["tip-relief"],
        families: &["mesh-order"],
        reference: 5e-6,
        has_floor: true,
        parameter: "amount",
        build: |size, _, rng| Effect::TipRelief { amount_m: size, share: 0.15 + 0.25 * rng.random::<f64>() },
    },
    Kind {
        name: "profile-error",
        right_names: &["profile-error"],
        families: &["mesh-order"],
        reference: 5e-6,
        has_floor: true,
        parameter: "",
        build: |size, pair, rng| Effect::Ghost {
            order: f64::from(pair.teeth[0] * (1 + rng.random::<u32>() % 2)),
            amplitude_m: size,
            phase_rad: phase(rng),
        },
    },
    Kind {
        name: "mains-hum",
        right_names: &["mains-hum"],
        families: &["fixed-frequency"],
        reference: 0.1,
        has_floor: true,
        parameter: "acceleration",
        build: |size, _, rng| {
            let hz = [50.0, 100.0, 150.0][(rng.random::<u32>() % 3) as usize];
            Effect::Tone { hz, amplitude: [size, 0.6 * size] }
        },
    },
    Kind {
        name: "fixed-frequency-tone",
        right_names: &[],
        families: &["fixed-frequency"],
        reference: 0.1,
        has_floor: true,
        parameter: "",
        build: |size, _, rng| Effect::Tone { hz: 510.0 + 900.0 * rng.random::<f64>(), amplitude: [size, -0.5 * size] },
    },
    Kind {
        name: "transfer-path-resonance",
        right_names: &["transfer-path-resonance"],
        families: &["path"],
        reference: 0.1,
        has_floor: true,
        parameter: "",
        build: |size, _, rng| Effect::PathMode {
            channel: side(rng),
            hz: 1500.0 + 3000.0 * rng.random::<f64>(),
            damping: 0.03,
            gain: size,
        },
    },
    Kind {
        name: "thermal-drift",
        right_names: &["thermal-drift"],
        families: &["non-stationary", "path"],
        reference: 0.05,
        has_floor: true,
        parameter: "",
        build: |size, _, rng| Effect::Drift { channel: side(rng), share: size },
    },
    Kind {
        name: "sensor-nonlinearity",
        right_names: &["sensor-nonlinearity"],
        families: &["path"],
        reference: 1e-3,
        has_floor: true,
        parameter: "",
        build: |size, _, rng| Effect::Nonlinearity { channel: side(rng), per_m_s2: size, per_m2_s4: 0.0 },
    },
    Kind {
        name: "cubic-nonlinearity",
        right_names: &["sensor-nonlinearity"],
        families: &["path"],
        reference: 1e-5,
        has_floor: true,
        parameter: "cubic",
        build: |size, _, rng| Effect::Nonlinearity { channel: side(rng), per_m_s2: 0.0, per_m2_s4: size },
    },
    Kind {
        name: "clipping",
        right_names: &["clipping"],
        families: &["path"],
        reference: 0.8,
        has_floor: false,
        parameter: "",
        build: |size, _, rng| Effect::Clipping { channel: side(rng), share_of_peak: size },
    },
    Kind {
        name: "channel-delay",
        right_names: &["channel-delay"],
        families: &["path"],
        reference: 1e-6,
        has_floor: true,
        parameter: "",
        build: |size, _, rng| Effect::Delay { channel: side(rng), seconds: size },
    },
    Kind {
        name: "aliasing",
        right_names: &["aliasing"],
        families: &["path"],
        reference: 1.0,
        has_floor: true,
        parameter: "share_folded",
        build: |size, _, _| Effect::Folding { share: size },
    },
    Kind {
        name: "speed-fluctuation",
        right_names: &["speed-fluctuation"],
        families: &["non-stationary", "fixed-frequency", "sideband"],
        reference: 1e-3,
        has_floor: true,
        parameter: "",
        build: |size, _, rng| Effect::SpeedFluctuation { hz: 2.5 + 6.0 * rng.random::<f64>(), angle_rad: size },
    },
    Kind {
        name: "bearing-impacts",
        right_names: &["bearing-impacts"],
        families: &["impulsive", "non-integer-order"],
        reference: 5.0,
        has_floor: true,
        parameter: "",
        build: |size, pair, rng| Effect::Impacts {
            channel: side(rng),
            order: odd_order(pair, rng),
            jitter: 0.01,
            hz: 4000.0,
            damping: 0.05,
            peak: size,
        },
    },
];
