//! One target's run: inputs from the corpus, changed; answers; the corpus grows; what panics is kept as a file.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::HashSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Changes an input.
pub type Change = fn(&mut Vec<u8>, &mut ChaCha8Rng);

const SEED: u64 = 1;
/// Longest input that joins the corpus, bytes: long ones only slow it down.
const LONGEST: usize = 1 << 16;
/// Most inputs kept.
const MOST: usize = 4_000;

/// A target's inputs and how many of them are tried.
pub struct Campaign {
    name: &'static str,
    inputs: usize,
    corpus: Vec<Vec<u8>>,
    change: Change,
}

impl Campaign {
    /// A campaign that starts from sound inputs.
    pub fn new(name: &'static str, inputs: usize, seeds: Vec<Vec<u8>>, change: Change) -> Self {
        assert!(!seeds.is_empty(), "{name}: nothing to start from");
        Self { name, inputs, corpus: seeds, change }
    }

    /// Runs `target`, which gives its answer in words and panics where something is wrong.
    ///
    /// # Panics
    /// With the case's file, for the first input under which the target panics.
    pub fn run(mut self, target: impl Fn(&[u8]) -> String) {
        let kept = kept_cases(self.name);
        for (path, bytes) in &kept {
            assert!(answer(&target, bytes).is_ok(), "{}: fails again", path.display());
        }
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let mut answers: HashSet<String> = HashSet::new();
        for seed in &self.corpus {
            answers.insert(outline(&answer(&target, seed).unwrap_or_else(|()| self.fail(seed))));
        }
        let (start, limit) = (Instant::now(), seconds());
        let (mut tried, mut slowest) = (0, Duration::ZERO);
        while limit.map_or(tried < self.inputs, |limit| start.elapsed() < limit) {
            let mut input = self.corpus[random.random_range(0..self.corpus.len())].clone();
            for _ in 0..1 + random.random_range(0..3_u32) {
                (self.change)(&mut input, &mut random);
            }
            let begun = Instant::now();
            let said = answer(&target, &input).unwrap_or_else(|()| self.fail(&input));
            slowest = slowest.max(begun.elapsed());
            tried += 1;
            if answers.insert(outline(&said)) && input.len() <= LONGEST && self.corpus.len() < MOST {
                self.corpus.push(input);
            }
        }
        println!(
            "fuzz {}: {tried} inputs in {:.0} s from seed {SEED}, {} kinds of answer, {} inputs in the corpus, {} kept \
             cases, longest {:.2} s",
            self.name,
            start.elapsed().as_secs_f64(),
            answers.len(),
            self.corpus.len(),
            kept.len(),
            slowest.as_secs_f64()
        );
        assert!(answers.len() > 1, "{}: all inputs get the same answer, so nothing is tried", self.name);
    }

    fn fail(&self, input: &[u8]) -> ! {
        let folder = std::env::temp_dir().join("meshband-fuzz").join(self.name);
        let digest =
            input.iter().fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(*b)).wrapping_mul(0x100_0000_01b3));
        let path = folder.join(format!("{digest:016x}"));
        let written = std::fs::create_dir_all(&folder).and_then(|()| std::fs::write(&path, input));
        panic!("{}: panics under the {} bytes of {} ({written:?})", self.name, input.len(), path.display());
    }
}

fn answer(target: &impl Fn(&[u8]) -> String, input: &[u8]) -> Result<String, ()> {
    catch_unwind(AssertUnwindSafe(|| target(input))).map_err(|_| ())
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

fn seconds() -> Option<Duration> {
    std::env::var("MESHBAND_FUZZ_SECONDS").ok()?.parse().ok().map(Duration::from_secs)
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
