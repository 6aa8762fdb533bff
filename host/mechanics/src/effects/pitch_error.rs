//! Pitch (spacing) error: every tooth of one gear off its place by its own constant amount.
//!
//! `single` displaces one tooth, `random` draws every tooth from a normal distribution. The error acts on
//! its own pair only. Signature: many shaft harmonics around the mesh harmonics, periodic per turn.

use super::hypothesis::{Carried, Draw, Fitted, Hidden, Hypothesis, Seat, Tooth, one};
use super::{Entry, GEAR, Parameter, check_tooth};
use crate::Result;
use crate::dynamics::excitation::{Effect, Facts, Moment, PairOnPath, Recurrence};
use crate::dynamics::series::Series;
use rand_chacha::ChaCha12Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal};
use std::f64::consts::TAU;

/// Largest number of teeth that errors are drawn for.
const TEETH: usize = 1000;

/// Registry entry.
pub const ENTRY: Entry = Entry {
    name: "pitch-error",
    meaning: "teeth of one gear off their place",
    signature: "many uneven shaft harmonics around the mesh harmonics, the same every turn; independent of torque",
    example: "random=3e-6",
    span_hz: 500.0,
    parameters: &[
        Parameter { name: "single", unit: "m", default: 0.0, range: [-1e-3, 1e-3], meaning: "error of one tooth" },
        Parameter { name: "tooth", unit: "", default: 0.0, range: [0.0, 999.0], meaning: "which tooth that is" },
        Parameter {
            name: "random",
            unit: "m",
            default: 0.0,
            range: [0.0, 1e-3],
            meaning: "standard deviation per tooth",
        },
        Parameter { name: "seed", unit: "", default: 1.0, range: [0.0, 1e15], meaning: "of the random errors" },
        GEAR,
    ],
    build: |v| {
        let mut random = ChaCha12Rng::seed_from_u64(v.get("seed") as u64);
        let normal = Normal::new(0.0, v.get("random")).expect("a standard deviation in range");
        let mut error_m: Vec<f64> = (0..TEETH).map(|_| normal.sample(&mut random)).collect();
        let tooth = v.get("tooth") as u32;
        error_m[tooth as usize] += v.get("single");
        Box::new(PitchError { error_m, tooth, body: v.body() })
    },
    hypotheses: &[
        SINGLE_ERROR,
        Hypothesis { name: "gear-pitch-error", seats: &[Seat::OneTooth(1, Tooth::Displaced)], ..SINGLE_ERROR },
        TABLE,
        Hypothesis {
            name: "gear-pitch-error",
            plain: "displacement error repeating with every gear turn",
            seats: &[Seat::EveryTooth(1)],
            ..TABLE
        },
    ],
    hidden: &[
        Hidden {
            name: "pinion-pitch-error",
            right_names: &["pinion-pitch-error"],
            reference: 5e-6,
            parameter: "single_tooth_offset",
            draw: |size, draw| drawn(size, 0, draw),
            ..Hidden::DEFAULTS
        },
        Hidden {
            name: "gear-pitch-error",
            right_names: &["gear-pitch-error"],
            reference: 5e-6,
            parameter: "single_tooth_offset",
            draw: |size, draw| drawn(size, 1, draw),
            ..Hidden::DEFAULTS
        },
    ],
};

const SINGLE_ERROR: Hypothesis = Hypothesis {
    name: "pinion-pitch-error",
    seats: &[Seat::OneTooth(0, Tooth::Displaced)],
    quantity: "single_tooth_offset",
    unit: "m",
    carry: |f| Some(one("pitch-error", [("single", f.size), f.of_tooth()?, f.gear()])),
    ..Hypothesis::DEFAULTS
};

const TABLE: Hypothesis = Hypothesis {
    plain: "displacement error repeating with every pinion turn",
    seats: &[Seat::EveryTooth(0)],
    quantity: "tooth_table",
    carry: every_tooth,
    ..SINGLE_ERROR
};

/// Every tooth of a table given by its harmonics over the gear's turn.
fn every_tooth(f: &Fitted<'_>) -> Option<Carried> {
    let teeth = f.teeth[f.body];
    let z = f64::from(teeth);
    let offset = |tooth: f64| -> f64 {
        let part = |(m, [a, b]): (f64, &[f64; 2])| {
            let (sin, cos) = (TAU * m * tooth / z).sin_cos();
            // Both signs of a harmonic count, but for the one at half the teeth.
            if 2.0 * m == z { a * cos } else { 2.0 * (a * cos - b * sin) }
        };
        (1..).map(f64::from).zip(f.parts).map(part).sum::<f64>() / z
    };
    let table = |t: f64| ("pitch-error", vec![("single", offset(t)), ("tooth", t), f.gear()]);
    (!f.parts.is_empty()).then(|| Carried { tables: (0..teeth).map(f64::from).map(table).collect(), remark: None })
}

fn drawn(size: f64, body: usize, draw: &mut Draw<'_>) -> Vec<String> {
    vec![format!("pitch-error:single={size},tooth={},gear={body}", draw.below(draw.teeth[body]))]
}

struct PitchError {
    error_m: Vec<f64>,
    /// The tooth with an error of its own.
    tooth: u32,
    body: usize,
}

impl Effect for PitchError {
    fn recurrence(&self) -> Recurrence {
        Recurrence::Turn(self.body)
    }

    fn check(&self, facts: &Facts) -> Result<()> {
        check_tooth(ENTRY.name, self.tooth, self.body, facts)
    }

    fn pair_error(&self, _moment: &Moment, pair: &PairOnPath, error: &mut Series) {
        error.add_constant(self.error_m[pair.tooth[self.body] as usize % TEETH]);
    }
}
