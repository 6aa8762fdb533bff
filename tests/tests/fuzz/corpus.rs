//! One target's run: inputs from the corpus, changed; answers; the corpus grows; what panics is kept as a file.

use meshband_tests::fuzz::Target;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::HashSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

const SEED: u64 = 1;
/// Longest input that joins the corpus, bytes: long ones only slow it down.
const MAX_INPUT_BYTES: usize = 1 << 16;
/// Most inputs kept.
const MAX_INPUTS: usize = 4_000;

/// A target and the inputs that are changed.
pub struct Campaign {
    target: &'static Target,
    corpus: Vec<Vec<u8>>,
}

impl Campaign {
    /// A campaign that starts from the target's sound inputs.
    pub fn new(target: &'static Target) -> Self {
        let corpus = (target.seeds)();
        assert!(!corpus.is_empty(), "{}: nothing to start from", target.name);
        Self { target, corpus }
    }

    /// Tries the target's number of inputs.
    ///
    /// # Panics
    /// With the case's file, for the first input under which the target panics.
    pub fn run(mut self) {
        let (name, run) = (self.target.name, self.target.run);
        let kept = kept_cases(name);
        for (path, bytes) in &kept {
            assert!(answer(run, bytes).is_ok(), "{}: fails again", path.display());
        }
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let mut answers: HashSet<String> = HashSet::new();
        for seed in &self.corpus {
            answers.insert(outline(&answer(run, seed).unwrap_or_else(|()| self.fail(seed))));
        }
        for _ in 0..self.target.inputs {
            let mut input = self.corpus[random.random_range(0..self.corpus.len())].clone();
            for _ in 0..1 + random.random_range(0..3_u32) {
                (self.target.change)(&mut input, &mut random);
            }
            let said = answer(run, &input).unwrap_or_else(|()| self.fail(&input));
            if answers.insert(outline(&said)) && input.len() <= MAX_INPUT_BYTES && self.corpus.len() < MAX_INPUTS {
                self.corpus.push(input);
            }
        }
        println!(
            "fuzz {name}: {} inputs from seed {SEED}, {} kinds of answer, {} inputs in the corpus, {} kept cases",
            self.target.inputs,
            answers.len(),
            self.corpus.len(),
            kept.len(),
        );
        assert!(answers.len() > 1, "{name}: all inputs get the same answer, so nothing is tried");
    }

    fn fail(&self, input: &[u8]) -> ! {
        let folder = std::env::temp_dir().join("meshband-fuzz").join(self.target.name);
        let digest =
            input.iter().fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(*b)).wrapping_mul(0x100_0000_01b3));
        let path = folder.join(format!("{digest:016x}"));
        let written = std::fs::create_dir_all(&folder).and_then(|()| std::fs::write(&path, input));
        panic!("{}: panics under the {} bytes of {} ({written:?})", self.target.name, input.len(), path.display());
    }
}

fn answer(run: fn(&[u8]) -> String, input: &[u8]) -> Result<String, ()> {
    catch_unwind(AssertUnwindSafe(|| run(input))).map_err(|_| ())
}

/// An answer without its numbers and quotations: what kind of answer it is.
fn outline(answer: &str) -> String {
    let mut quoted = false;
    let mut text = String::new();
    for c in answer.chars().take(160) {
        quoted ^= matches!(c, '`' | '"');
        if !quoted && !c.is_ascii_digit() && !matches!(c, '.' | '-' | '+') {
            text.push(c);
        }
    }
    text
}

fn kept_cases(name: &str) -> Vec<(PathBuf, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("vectors/fuzz").join(name);
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut cases: Vec<_> = entries
        .filter_map(|entry| entry.ok().map(|entry| entry.path()))
        .map(|path| {
            let bytes = std::fs::read(&path).expect("a kept case");
            (path, bytes)
        })
        .collect();
    cases.sort();
    cases
}
