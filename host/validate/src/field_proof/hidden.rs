//! What a record hides, and which answers are right for it.
//!
//! At signal-based inference several effects have the same lines: an answer is right where the effect's name is among
//! those in question, of the right family where only its family is said. Effects that change mesh harmonics alone
//! ("unseen") stand behind an unknown path: nothing is the right answer.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// How the effect comes into the record.
#[derive(Debug, Clone, Copy)]
pub enum Source {
    /// The simulator's effects at this strength; the record takes what they change, in proportion.
    Simulated(f64),
    /// Impacts of a bearing on the housing; modulated by its shaft or not.
    Impacts(bool),
    /// A tone in every channel, of a supply or at any frequency.
    Tone(bool),
    /// Channels that are limited.
    Clipping,
    /// The simulator's effects at this strength, which no line beyond the mesh shows.
    Unseen(f64),
}

/// One thing hidden.
pub struct Hidden {
    /// Its name.
    pub name: &'static str,
    /// Parts of names that are right.
    pub right: &'static [&'static str],
    /// Families that are right.
    pub families: &'static [&'static str],
    /// How it comes into the record.
    pub source: Source,
    /// The simulator's effects at a strength, on body 0 or 1.
    effect: fn(f64, &mut Draw) -> String,
}

/// What is drawn for one effect.
pub struct Draw<'a> {
    /// Numbers of teeth.
    pub teeth: [u32; 2],
    /// Stream.
    pub random: &'a mut ChaCha8Rng,
}

impl Draw<'_> {
    fn phase(&mut self) -> f64 {
        TAU * self.random.random::<f64>()
    }

    fn tooth(&mut self, body: usize) -> u32 {
        self.random.random_range(0..self.teeth[body])
    }

    /// An order of a bearing's outer passage per turn of its shaft.
    pub fn passage(&mut self) -> f64 {
        let (elements, ratio) = (self.random.random_range(7..=14), self.random.random_range(0.15..0.32));
        0.5 * f64::from(elements) * (1.0 - ratio)
    }

    /// Whole order of `body` that is neither the mesh nor beside it, above the low ones.
    fn ghost(&mut self, body: usize) -> u32 {
        let z = self.teeth[body] as i64;
        loop {
            let order = self.random.random_range(10..5 * z / 2);
            let from_mesh = (order - (order as f64 / z as f64).round() as i64 * z).abs();
            if from_mesh > 5 || order < z / 2 && order > 9 {
                return order as u32;
            }
        }
    }
}

const SIDEBAND: &[&str] = &["sideband", "shaft-order", "impulsive"];
const NONE: &[&str] = &[];

const fn simulated(
    name: &'static str,
    right: &'static [&'static str],
    families: &'static [&'static str],
    reference: f64,
    effect: fn(f64, &mut Draw) -> String,
) -> Hidden {
    Hidden { name, right, families, source: Source::Simulated(reference), effect }
}

fn nothing(_: f64, _: &mut Draw) -> String {
    String::new()
}

/// All of them, in the order that a campaign cycles through.
pub const ALL: &[Hidden] = &[
    simulated("pinion-eccentricity", &["pinion-eccentricity"], SIDEBAND, 1e-5, |s, d| {
        format!("eccentricity:amplitude={s},phase={}", d.phase())
    }),
    simulated("gear-eccentricity", &["gear-eccentricity"], SIDEBAND, 1e-5, |s, d| {
        format!("eccentricity:amplitude={s},phase={},gear=1", d.phase())
    }),
    simulated("pinion-tooth-crack", &["pinion-tooth-crack"], SIDEBAND, 0.1, |s, d| {
        format!("tooth-crack:loss={s},tooth={}", d.tooth(0))
    }),
    simulated("gear-tooth-crack", &["gear-tooth-crack"], SIDEBAND, 0.1, |s, d| {
        format!("tooth-crack:loss={s},tooth={},gear=1", d.tooth(1))
    }),
    simulated("pinion-pitch-error", &["pinion-pitch-error"], SIDEBAND, 2e-6, |s, d| {
        format!("pitch-error:random={s},seed={}", d.tooth(0))
    }),
    simulated("gear-pitch-error", &["gear-pitch-error"], SIDEBAND, 2e-6, |s, d| {
        format!("pitch-error:random={s},seed={},gear=1", d.tooth(1))
    }),
    simulated("pinion-ghost-order", &["pinion-ghost-order"], &["shaft-order"], 1e-6, |s, d| {
        format!("ghost-order:amplitude={s},order={},phase={}", d.ghost(0), d.phase())
    }),
    simulated("gear-ghost-order", &["gear-ghost-order"], &["shaft-order"], 1e-6, |s, d| {
        format!("ghost-order:amplitude={s},order={},phase={},gear=1", d.ghost(1), d.phase())
    }),
    simulated("pinion-imbalance", &["pinion-imbalance"], &["shaft-order"], 1e-2, |s, d| {
        format!("imbalance:moment={s},phase={}", d.phase())
    }),
    simulated("gear-imbalance", &["gear-imbalance"], &["shaft-order"], 1e-2, |s, d| {
        format!("imbalance:moment={s},phase={},gear=1", d.phase())
    }),
    simulated("coupling-misalignment", &["coupling-misalignment"], &["shaft-order"], 100.0, |s, d| {
        format!("coupling-misalignment:force={s},phase={},gear={}", d.phase(), d.random.random_range(0..2))
    }),
    simulated(
        "load-swing",
        &["load-fluctuation"],
        &["non-stationary", "sideband", "non-integer-order"],
        0.05,
        |s, d| format!("load-fluctuation:depth={s},frequency={},phase={}", d.random.random_range(0.6..2.5), d.phase()),
    ),
    simulated("torque-ripple", &["torque-ripple"], &["shaft-order", "sideband"], 0.05, |s, d| {
        format!("torque-ripple:depth={s},order={},phase={}", d.random.random_range(1..5), d.phase())
    }),
    simulated(
        "bearing-stiffness-modulation",
        &["bearing-stiffness-modulation", "unexplained order", "bearing of"],
        &["non-integer-order"],
        0.02,
        |s, d| {
            let (order, gear) = (d.passage(), d.random.random_range(0..2));
            format!("bearing-stiffness-modulation:share={s},order={order},phase={},gear={gear}", d.phase())
        },
    ),
    simulated("aliasing", &["aliasing"], &["mesh-order", "path"], 1.0, |s, _| format!("aliasing:share={s}")),
    Hidden {
        name: "outer-ring",
        right: &["bearing-impacts", "bearing of"],
        families: &["non-integer-order", "impulsive"],
        source: Source::Impacts(false),
        effect: nothing,
    },
    Hidden {
        name: "inner-ring",
        right: &["bearing-impacts", "bearing of"],
        families: &["non-integer-order", "impulsive"],
        source: Source::Impacts(true),
        effect: nothing,
    },
    Hidden {
        name: "mains-hum",
        right: &["mains-hum"],
        families: &["fixed-frequency"],
        source: Source::Tone(true),
        effect: nothing,
    },
    Hidden {
        name: "fixed-tone",
        right: &["fixed-tone"],
        families: &["fixed-frequency"],
        source: Source::Tone(false),
        effect: nothing,
    },
    Hidden { name: "clipping", right: &["clipping"], families: &["other"], source: Source::Clipping, effect: nothing },
    Hidden {
        name: "wear",
        right: NONE,
        families: NONE,
        source: Source::Unseen(3e-6),
        effect: |s, _| format!("wear:depth={s}"),
    },
    Hidden {
        name: "friction",
        right: NONE,
        families: NONE,
        source: Source::Unseen(0.06),
        effect: |s, _| format!("friction:coefficient={s}"),
    },
    Hidden {
        name: "transfer-path-resonance",
        right: NONE,
        families: NONE,
        source: Source::Unseen(0.3),
        effect: |s, d| {
            format!(
                "transfer-path-resonance:gain={s},frequency={},damping=0.03,channel=0",
                d.random.random_range(600.0..3000.0)
            )
        },
    },
];

impl Hidden {
    /// The simulator's effect at a strength.
    pub fn effect(&self, strength: f64, draw: &mut Draw) -> String {
        (self.effect)(strength, draw)
    }

    /// Whether nothing of it can be seen at this level.
    pub fn is_unseen(&self) -> bool {
        matches!(self.source, Source::Unseen(_))
    }
}
