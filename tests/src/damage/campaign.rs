//! Runs a campaign: which attacks, on how many cores, and what came of each.

use super::attack::{Attack, Scene};
use super::families::{self, CAMPAIGN_ATTACKS, FAMILIES, Family};
use super::oracle::{Finding, judge};
use super::originals::Originals;
use super::process::{self, Ended};
use super::snapshot::Snapshot;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// What to do.
#[derive(Debug, Clone)]
pub struct Campaign {
    /// The command under attack.
    pub program: PathBuf,
    /// Seed of everything.
    pub seed: u64,
    /// Number of attacks, shared out over the families; none is left out.
    pub cases: usize,
    /// Only this family, or one attack of it.
    pub only: Option<(String, Option<usize>)>,
    /// Keeps the folders of attacks here.
    pub keep: Option<PathBuf>,
    /// Attacks at the same time.
    pub workers: usize,
}

/// One attack that was made.
#[derive(Debug, Clone)]
pub struct Made {
    /// Family.
    pub family: &'static str,
    /// Number in the family.
    pub index: usize,
    /// The damage.
    pub what: String,
    /// Commands as one would type them.
    pub lines: Vec<String>,
    /// How the first one ended.
    pub end: End,
    /// What was wrong.
    pub findings: Vec<Finding>,
}

/// How a command ended, for counting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// Exit code 0.
    Accepted,
    /// Exit code 2.
    Refused,
    /// By our signal or a closed pipe, or a failure.
    Ended,
}

/// Everything of a campaign.
#[derive(Debug, Clone, Default)]
pub struct Outcome {
    /// Attacks in the order of the plan.
    pub made: Vec<Made>,
    /// Attacks that this machine cannot make.
    pub impossible: usize,
}

impl Campaign {
    /// Families and numbers, in order.
    ///
    /// # Errors
    /// A family that does not exist.
    pub fn plan(&self) -> Result<Vec<(&'static Family, usize)>, String> {
        let count = |family: &Family| (family.share * self.cases).div_ceil(CAMPAIGN_ATTACKS);
        let Some((name, number)) = &self.only else {
            return Ok(FAMILIES.iter().flat_map(|family| (0..count(family)).map(move |i| (family, i))).collect());
        };
        let family = families::named(name).ok_or_else(|| format!("there is no family `{name}`"))?;
        Ok(match number {
            Some(number) => vec![(family, *number)],
            None => (0..count(family)).map(|i| (family, i)).collect(),
        })
    }
}

/// Makes every attack; `progress` is told how many are done, of how many.
///
/// # Errors
/// A command that fails on sound input, a family that does not exist, a temporary folder that cannot be made.
pub fn run(campaign: &Campaign, progress: impl Fn(usize, usize) + Sync) -> Result<Outcome, String> {
    let plan = campaign.plan()?;
    let folder = tempfile::Builder::new().prefix("damage").tempdir().map_err(|error| error.to_string())?;
    let originals = Originals::make(&campaign.program, &folder.path().join("sound"))?;
    let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let results: Mutex<Vec<Option<Made>>> = Mutex::new(vec![None; plan.len()]);
    std::thread::scope(|scope| {
        for _ in 0..campaign.workers.max(1) {
            scope.spawn(|| {
                while let Some(&(family, index)) = plan.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let made = one(campaign, &originals, folder.path(), family, index);
                    let place = plan.iter().position(|(f, i)| f.name == family.name && *i == index);
                    let mut results = results.lock().expect("no worker panics while it holds this");
                    results[place.unwrap_or(0)] = made;
                    drop(results);
                    progress(done.fetch_add(1, Ordering::Relaxed) + 1, plan.len());
                }
            });
        }
    });
    let results = results.into_inner().expect("no worker panics while it holds this");
    let impossible = results.iter().filter(|made| made.is_none()).count();
    Ok(Outcome { made: results.into_iter().flatten().collect(), impossible })
}

/// The random stream of one attack: of nothing but the campaign's seed, the family and the number.
fn stream(seed: u64, family: &str, index: usize) -> ChaCha8Rng {
    let letters = family.bytes().fold(0_u64, |sum, byte| sum.wrapping_mul(257).wrapping_add(byte.into()));
    let mut random = ChaCha8Rng::seed_from_u64(seed ^ letters.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    random.set_stream(index as u64);
    random
}

fn one(campaign: &Campaign, originals: &Originals, root: &Path, family: &Family, index: usize) -> Option<Made> {
    let place = root.join(format!("{}-{index}", family.name));
    let (folder, said) = (place.join("work"), place.join("said"));
    for inner in [folder.join("in"), folder.join("out"), said.clone()] {
        std::fs::create_dir_all(inner).expect("the campaign's folder is writable");
    }
    let random = stream(campaign.seed, family.name, index);
    let mut scene = Scene { folder: folder.clone(), originals, random, seed: campaign.seed, index };
    let attack = (family.prepare)(&mut scene);
    let made = attack.map(|attack| {
        let before = Snapshot::of(&folder);
        let ended = process::run(&campaign.program, &folder, &said, &attack.commands);
        let findings = judge(&attack, &ended, &folder, &before);
        described(family, index, attack, &ended, findings)
    });
    if let Some(keep) = &campaign.keep {
        let kept = keep.join(place.file_name().unwrap_or_default());
        // Special files cannot be copied: moved within a file system, or left to the next attempt.
        if let Err(error) = std::fs::create_dir_all(keep).and_then(|()| std::fs::rename(&place, &kept)) {
            eprintln!("{}: {error}", kept.display());
        }
    }
    // What stays is removed with the campaign's folder.
    let _ = std::fs::remove_dir_all(&place);
    made
}

fn described(family: &Family, index: usize, attack: Attack, ended: &[Ended], findings: Vec<Finding>) -> Made {
    let end = match ended.first().and_then(|end| end.code) {
        Some(0) => End::Accepted,
        Some(2) => End::Refused,
        _ => End::Ended,
    };
    let lines = attack.commands.iter().map(process::Invocation::line).collect();
    Made { family: family.name, index, what: attack.what, lines, end, findings }
}

/// A digest of what an attack is, to see that a seed gives the same attacks again.
pub fn fingerprint(outcome: &Outcome) -> u64 {
    let mut hasher = DefaultHasher::new();
    for made in &outcome.made {
        (made.family, made.index, &made.what, &made.lines).hash(&mut hasher);
    }
    hasher.finish()
}
