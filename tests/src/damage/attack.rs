//! What an attack is: a prepared folder, one or more commands, and the places that they may write to.

use super::originals::Originals;
use super::process::Invocation;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// The folder of one attack while it is prepared, with its random stream.
pub struct Scene<'a> {
    /// Working folder of the commands; every path of an attack is relative to it.
    pub folder: PathBuf,
    /// Sound inputs to damage.
    pub originals: &'a Originals,
    /// Random stream of this attack alone.
    pub random: ChaCha8Rng,
    /// Seed of the campaign, for orders that all attacks of a family share.
    pub seed: u64,
    /// Number in the family, from 0.
    pub index: usize,
}

/// What a target holds when it is whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A record folder.
    Record,
    /// A folder of predictions.
    Predictions,
    /// A JSON document.
    Json,
    /// A report page.
    Page,
    /// Any text.
    Text,
}

/// A place that the commands of an attack may write to.
pub struct Target {
    /// Path in the scene's folder.
    pub path: PathBuf,
    /// What it must hold afterwards, if anything.
    pub kind: Kind,
    /// Digests of the states that one undisturbed command leaves; empty where they are not known beforehand.
    pub whole: Vec<u64>,
}

impl Target {
    /// A target whose exact content is not known beforehand.
    pub fn new(path: impl Into<PathBuf>, kind: Kind) -> Self {
        Self { path: path.into(), kind, whole: Vec::new() }
    }
}

/// A prepared attack.
pub struct Attack {
    /// The damage in a few words, for the list of failures.
    pub what: String,
    /// Commands that run at the same time.
    pub commands: Vec<Invocation>,
    /// Where they may write.
    pub targets: Vec<Target>,
    /// Whether they were told to replace targets that exist.
    pub forced: bool,
    /// Whether all targets must be there afterwards, however standard output and error fared.
    pub must_write: bool,
}

impl Attack {
    /// One command, nothing written unless targets are added.
    pub fn new(what: impl Into<String>, command: Invocation) -> Self {
        Self { what: what.into(), commands: vec![command], targets: Vec::new(), forced: false, must_write: false }
    }

    /// With a target.
    #[must_use]
    pub fn writing(mut self, path: impl Into<PathBuf>, kind: Kind) -> Self {
        self.targets.push(Target::new(path, kind));
        self
    }
}

impl Scene<'_> {
    /// Copies an original file or folder to a path of the scene.
    ///
    /// # Panics
    /// Where the campaign's own temporary folder cannot be written, as all helpers here.
    pub fn copy(&self, original: &str, to: &str) -> PathBuf {
        let target = self.folder.join(to);
        copy_tree(&self.originals.path(original), &target);
        target
    }

    /// Writes a file of the scene.
    pub fn write(&self, path: &str, bytes: impl AsRef<[u8]>) {
        let target = self.folder.join(path);
        std::fs::create_dir_all(target.parent().expect("inside the scene")).expect("the campaign's folder is writable");
        std::fs::write(target, bytes).expect("the campaign's folder is writable");
    }

    /// Reads a file of the scene.
    pub fn read(&self, path: &str) -> Vec<u8> {
        std::fs::read(self.folder.join(path)).expect("an original")
    }

    /// One of a list.
    pub fn pick<'t, T>(&mut self, list: &'t [T]) -> &'t T {
        &list[self.random.random_range(0..list.len())]
    }

    /// True with a probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.random.random::<f64>() < probability
    }
}

/// Copies a file, a symbolic link's target or a folder with all it holds.
///
/// # Panics
/// Where reading or writing fails.
pub fn copy_tree(from: &Path, to: &Path) {
    if let Some(parent) = to.parent() {
        std::fs::create_dir_all(parent).expect("the campaign's folder is writable");
    }
    if from.is_dir() {
        std::fs::create_dir_all(to).expect("the campaign's folder is writable");
        for entry in std::fs::read_dir(from).expect("an original").flatten() {
            copy_tree(&entry.path(), &to.join(entry.file_name()));
        }
    } else {
        std::fs::copy(from, to).expect("an original");
    }
}

/// Words of a command line.
pub fn words(line: &str) -> Vec<OsString> {
    line.split_whitespace().map(OsString::from).collect()
}
