//! A package of the distribution, by the least unusual of three ways that works.

use super::apt::{Apt, Suites, codename, plain_install};
use crate::shell::{Outcome, TemporaryFolder, on_path, timed, with_retries};

/// What is wanted.
pub struct Package {
    /// Its name.
    pub name: &'static str,
    /// What it is for, as in "... is missing".
    pub what: &'static str,
    /// Tells what is installed, where it works.
    pub version: fn() -> Option<String>,
    /// Where apt is not at hand or does not help.
    pub advice: &'static str,
}

impl Package {
    /// Returns the version that is there now.
    pub fn ensure(&self) -> Outcome<String> {
        if let Some(version) = (self.version)() {
            return Ok(version);
        }
        let Self { name, what, advice, .. } = self;
        if on_path("apt-get").is_none() {
            return Err(format!("{what} is missing and this machine has no apt.\n  What to do: {advice}"));
        }
        let mut reasons = Vec::new();
        // Ordered from the least to the most unusual. A half-updated system may refuse the first two: an installed
        // QEMU package from backports conflicts with the release's emulator.
        type Way = fn(&str) -> Outcome;
        let ways: [(&str, Way); 3] = [
            ("", plain_install),
            (" with fresh package lists", with_fresh_lists),
            (" from release and backports", from_backports),
        ];
        for (how, way) in ways {
            let step = format!("installing {name}{how}");
            match timed(&step, || way(name)) {
                Ok(()) => match (self.version)() {
                    Some(version) => return Ok(version),
                    None => reasons.push(format!("{step}: apt was content, but {what} does not work")),
                },
                Err(reason) => reasons.push(format!("{step}: {reason}")),
            }
        }
        let reasons = reasons.join("\n  ");
        Err(format!("{what} is missing and could not be installed.\n  {reasons}\n  What to do: {advice}"))
    }
}

fn with_fresh_lists(package: &str) -> Outcome {
    let temporary = TemporaryFolder::new("apt-fresh")?;
    let apt = Apt::with_own_lists(&temporary.0)?;
    with_retries("package lists", || apt.update())?;
    apt.install(package, None)
}

fn from_backports(package: &str) -> Outcome {
    let temporary = TemporaryFolder::new("apt-backports")?;
    let apt = Apt::with_suites(&temporary.0, Suites::ReleaseAndBackports)?;
    with_retries("package lists", || apt.update())?;
    let suite = format!("{}-backports", codename()?);
    apt.install(package, Some(&suite))
}
