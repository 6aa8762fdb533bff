//! Pitch (spacing) error: every tooth of one gear off its place by its own constant amount.
//!
//! `single` displaces one tooth, `random` draws every tooth from a normal distribution. The error acts on
//! its own pair only. Signature: many shaft harmonics around the mesh harmonics, periodic per turn.

use super::{Entry, GEAR, Parameter, check_tooth};
use crate::Result;
use crate::dynamics::excitation::{Effect, Facts, Moment, PairOnPath};
use crate::dynamics::series::Series;
use rand_chacha::ChaCha12Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal};

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
};

struct PitchError {
    error_m: Vec<f64>,
    /// The tooth with an error of its own.
    tooth: u32,
    body: usize,
}

impl Effect for PitchError {
    fn check(&self, facts: &Facts) -> Result<()> {
        check_tooth(ENTRY.name, self.tooth, self.body, facts)
    }

    fn pair_error(&self, _moment: &Moment, pair: &PairOnPath, error: &mut Series) {
        error.add_constant(self.error_m[pair.tooth[self.body] as usize % TEETH]);
    }
}
