//! Judges an attack: what must hold whatever was attacked, from the folder before and after and from how commands
//! ended.

use super::attack::{Attack, Kind, Target};
use super::process::{Ended, FILE_STEP, Invocation, Sink};
use super::snapshot::Snapshot;
use meshband_host::record::{Record, npy};
use std::collections::BTreeSet;
use std::panic::catch_unwind;
use std::path::{Path, PathBuf};

/// Kinds of failure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Failure {
    /// Exit code 101.
    Panic,
    /// Ended by a signal that we did not send: out of memory, stack overflow.
    Abort,
    /// Ran over its time.
    Hang,
    /// Another exit code than those agreed.
    Code,
    /// A file that was there is changed or gone.
    Lost,
    /// A target is neither the old state nor what one command leaves.
    Mixture,
    /// A temporary that reads as a record.
    Temporary,
    /// Written outside the targets, or left over.
    Stray,
    /// Exit code 0 without the target, or a lost result beside a closed output.
    Missing,
    /// A result that is not finite.
    NotFinite,
    /// Not one clear line.
    Message,
}

impl Failure {
    /// Every kind, in the order of the tables.
    pub const ALL: [Self; 11] = [
        Self::Panic,
        Self::Abort,
        Self::Hang,
        Self::Lost,
        Self::Mixture,
        Self::Temporary,
        Self::Stray,
        Self::Missing,
        Self::NotFinite,
        Self::Code,
        Self::Message,
    ];

    /// Name in tables and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Panic => "panic",
            Self::Abort => "abort",
            Self::Hang => "hang",
            Self::Code => "exit code",
            Self::Lost => "lost",
            Self::Mixture => "mixture",
            Self::Temporary => "temporary",
            Self::Stray => "stray",
            Self::Missing => "missing",
            Self::NotFinite => "not finite",
            Self::Message => "message",
        }
    }
}

/// A failure with its reason.
pub type Finding = (Failure, String);

/// Longest refusal, characters.
const MAX_REFUSAL_CHARACTERS: usize = 400;
const SIGKILL: i32 = 9;
const SIGPIPE: i32 = 13;

/// Everything that is wrong after an attack.
pub fn judge(attack: &Attack, ended: &[Ended], folder: &Path, before: &Snapshot) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (invocation, end) in attack.commands.iter().zip(ended) {
        findings.extend(ending(invocation, end));
        // What is said goes into a file, too: with a limit below the first step nothing can be.
        let can_speak = invocation.stderr == Sink::Kept && invocation.file_limit.is_none_or(|limit| limit >= FILE_STEP);
        if end.code == Some(2) && can_speak {
            findings.extend(refusal(&end.stderr).map(|what| (Failure::Message, what)));
        }
        if end.code == Some(0) && invocation.stdout == Sink::Kept {
            findings.extend(not_finite(&end.stdout).map(|what| (Failure::NotFinite, what)));
        }
    }
    let after = Snapshot::of(folder);
    findings.extend(lost(attack, before, &after));
    let killed = ended.iter().any(|end| end.hung || end.signalled == Some(SIGKILL));
    findings.extend(strays(attack, folder, before, &after, killed));
    for target in &attack.targets {
        findings.extend(state(attack, target, ended, folder, before, &after));
    }
    findings
}

fn ending(invocation: &Invocation, end: &Ended) -> Option<Finding> {
    let text = || String::from_utf8_lossy(&end.stderr).lines().take(3).collect::<Vec<_>>().join(" | ");
    let piped = [invocation.stdout, invocation.stderr].iter().any(|sink| matches!(sink, Sink::Pipe(_)));
    if end.hung {
        return Some((Failure::Hang, "had to be ended".into()));
    }
    match (end.code, end.signal) {
        (Some(0 | 2), _) => None,
        (Some(101), _) => Some((Failure::Panic, text())),
        (Some(130 | 143), _) if end.signalled.is_some() => None,
        (Some(141), _) | (None, Some(SIGPIPE)) if piped => None,
        (None, Some(signal)) if end.signalled == Some(signal) => None,
        (Some(code), _) => Some((Failure::Code, format!("exit code {code}: {}", text()))),
        (None, signal) => Some((Failure::Abort, format!("ended by signal {}: {}", signal.unwrap_or(0), text()))),
    }
}

/// What is wrong with a refusal: it is one printable line; warnings and the loop's progress may come before it.
fn refusal(stderr: &[u8]) -> Option<String> {
    let Ok(text) = std::str::from_utf8(stderr) else { return Some("is no UTF-8".into()) };
    let shown = |line: &str| line.chars().take(160).collect::<String>();
    let is_progress = |line: &str| {
        line.starts_with("warning: ")
            || line.trim_start().split_once(" s  ").is_some_and(|(s, _)| s.parse::<f64>().is_ok())
    };
    let lines: Vec<&str> = text.lines().filter(|line| !is_progress(line)).collect();
    let [line] = lines[..] else {
        return Some(format!("{} lines: {}", lines.len(), shown(&lines.join(" | "))));
    };
    let odd =
        |c: char| c.is_control() || ('\u{202a}'..='\u{202e}').contains(&c) || ('\u{2066}'..='\u{2069}').contains(&c);
    if !line.starts_with("meshband: ") {
        Some(format!("does not begin with `meshband: `: {}", shown(line)))
    } else if line.chars().count() > MAX_REFUSAL_CHARACTERS {
        Some(format!("{} characters: {}", line.chars().count(), shown(line)))
    } else if line.chars().any(odd) {
        Some(format!("not printable: {}", shown(line)))
    } else if line.contains("Some(") || line.contains("None)") {
        Some(format!("shows a program's value: {}", shown(line)))
    } else {
        None
    }
}

/// A figure of a result that is none.
fn not_finite(stdout: &[u8]) -> Option<String> {
    let text = String::from_utf8_lossy(stdout);
    let word =
        |line: &str| line.split(|c: char| !c.is_alphanumeric()).any(|word| ["NaN", "nan", "inf"].contains(&word));
    text.lines().find(|line| word(line)).map(|line| line.chars().take(160).collect())
}

/// Without `--force` nothing that exists may change; with it, only targets.
fn lost(attack: &Attack, before: &Snapshot, after: &Snapshot) -> Vec<Finding> {
    let is_target = |path: &Path| attack.targets.iter().any(|target| path.starts_with(&target.path));
    before
        .0
        .iter()
        .filter(|(path, entry)| after.0.get(*path) != Some(entry))
        .filter(|(path, _)| !(attack.forced && is_target(path)))
        .map(|(path, _)| {
            let how = if after.0.contains_key(path) { "changed" } else { "gone" };
            (Failure::Lost, format!("{} is {how}", path.display()))
        })
        .collect()
}

/// New entries that are no part of a target. A lock beside a target may stay, and after a kill a temporary beside it;
/// neither may read as a record.
fn strays(attack: &Attack, folder: &Path, before: &Snapshot, after: &Snapshot, killed: bool) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut reported: BTreeSet<PathBuf> = BTreeSet::new();
    for path in after.0.keys().filter(|path| !before.0.contains_key(*path)) {
        if attack.targets.iter().any(|target| path.starts_with(&target.path) || target.path.starts_with(path)) {
            continue;
        }
        let beside = |target: &Target| {
            let parent = target.path.parent().unwrap_or(Path::new(""));
            let inner = path.strip_prefix(parent).ok()?.components().next()?;
            let name = inner.as_os_str().to_string_lossy().into_owned();
            name.starts_with('.').then(|| (parent.join(&name), name))
        };
        let hidden = attack.targets.iter().find_map(beside);
        if path.file_name().is_some_and(|name| name == "record.toml") {
            let parent = folder.join(path.parent().unwrap_or(Path::new("")));
            if catch_unwind(|| Record::read(&parent)).is_ok_and(|read| read.is_ok()) {
                findings.push((Failure::Temporary, format!("{} reads as a record", path.display())));
            }
        }
        let root = hidden.as_ref().map_or(path.clone(), |(root, _)| root.clone());
        let excused = hidden.is_some_and(|(_, name)| killed || name.contains("lock"));
        if !excused && !reported.iter().any(|known| root.starts_with(known)) {
            findings.push((Failure::Stray, root.display().to_string()));
            reported.insert(root);
        }
    }
    findings
}

fn state(
    attack: &Attack,
    target: &Target,
    ended: &[Ended],
    folder: &Path,
    before: &Snapshot,
    after: &Snapshot,
) -> Option<Finding> {
    let (old, new) = (before.below(&target.path), after.below(&target.path));
    let path = folder.join(&target.path);
    let succeeded = ended.iter().any(|end| end.code == Some(0));
    let expected = target.whole.is_empty() || target.whole.contains(&new.digest());
    if new == old && !(attack.must_write && new.is_empty()) && (!succeeded || (!old.is_empty() && expected)) {
        return None;
    }
    if new.is_empty() {
        let what = format!("{} is not there", target.path.display());
        return (succeeded || attack.must_write).then_some((Failure::Missing, what));
    }
    if let Err(what) = whole(target.kind, &path) {
        let kind = if what.contains("not finite") { Failure::NotFinite } else { Failure::Mixture };
        let what = what.replace(&format!("{}/", folder.display()), "");
        return Some((kind, format!("{}: {what}", target.path.display())));
    }
    if !expected {
        let what = format!("{} is accepted and is of no single command", target.path.display());
        return Some((Failure::Mixture, what));
    }
    let only_refused = !ended.is_empty() && ended.iter().all(|end| end.code == Some(2) && end.signalled.is_none());
    let undisturbed =
        attack.commands.iter().all(|c| c.stdout == Sink::Kept && c.disk_kb.is_none() && c.file_limit.is_none());
    (only_refused && undisturbed && attack.targets.len() == 1 && !explains(target.kind, &path))
        .then(|| (Failure::Stray, format!("{} is written although refused", target.path.display())))
}

/// Whether a result says why there is none: what the check found in a record, where its text would be lost in a script.
fn explains(kind: Kind, path: &Path) -> bool {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let list = serde_json::from_str::<serde_json::Value>(&text).ok().map(|json| json["findings"]["list"].clone());
    kind == Kind::Json && list.and_then(|list| list.as_array().map(|list| !list.is_empty())).unwrap_or(false)
}

/// Whether a target is complete.
fn whole(kind: Kind, path: &Path) -> Result<(), String> {
    let text = || std::fs::read_to_string(path).map_err(|error| error.to_string());
    match kind {
        Kind::Record => {
            let record = catch_unwind(|| Record::read(path)).map_err(|_| "panics when read".to_owned())?;
            record.map(drop).map_err(|error| error.to_string())
        }
        Kind::Predictions => {
            let mut count = 0;
            for entry in std::fs::read_dir(path).map_err(|error| error.to_string())?.flatten() {
                if entry.path().extension().is_some_and(|e| e == "npy") {
                    let (values, _) = npy::read_f64(&entry.path()).map_err(|error| error.to_string())?;
                    if let Some(value) = values.iter().find(|v| !v.is_finite()) {
                        return Err(format!("{} holds {value}: not finite", entry.path().display()));
                    }
                    count += 1;
                }
            }
            if count > 0 { Ok(()) } else { Err("holds no prediction".into()) }
        }
        Kind::Json => serde_json::from_str::<serde_json::Value>(&text()?).map(drop).map_err(|error| error.to_string()),
        Kind::Page => {
            let text = text()?;
            // The last tag may be left out.
            let end = text.trim_end();
            if end.ends_with("</html>") || end.ends_with("</body>") { Ok(()) } else { Err("is no whole page".into()) }
        }
        Kind::Text => {
            let text = text()?;
            if text.ends_with('\n') { Ok(()) } else { Err("ends within a line".into()) }
        }
    }
}
