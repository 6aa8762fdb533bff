//! QEMU's Arm system emulator from the distribution.

use super::apt::{Apt, Suites, codename, plain_install};
use crate::shell::{Outcome, TemporaryFolder, capture, command, on_path, timed, with_retries};

const PROGRAM: &str = "qemu-system-arm";

/// Returns the version that is there now.
pub fn ensure() -> Outcome<String> {
    if let Some(version) = version() {
        return Ok(version);
    }
    if on_path("apt-get").is_none() {
        return Err(format!(
            "{PROGRAM} is missing and this machine has no apt.\n  \
             What to do: install QEMU's Arm system emulator with your package manager \
             (Fedora: qemu-system-arm-core, Arch: qemu-system-arm, Homebrew: qemu)"
        ));
    }
    let mut reasons = Vec::new();
    // Ordered from the least to the most unusual. A half-updated system may refuse the first two: an installed
    // QEMU package from backports conflicts with the release's emulator.
    type Way = fn() -> Outcome;
    let ways: [(&str, Way); 3] = [
        ("installing qemu-system-arm", || plain_install(PROGRAM)),
        ("installing qemu-system-arm with fresh package lists", || {
            let temporary = TemporaryFolder::new("apt-fresh")?;
            let apt = Apt::with_own_lists(&temporary.0)?;
            with_retries("package lists", || apt.update())?;
            apt.install(PROGRAM, None)
        }),
        ("installing qemu-system-arm from release and backports", || {
            let temporary = TemporaryFolder::new("apt-backports")?;
            let apt = Apt::with_suites(&temporary.0, Suites::ReleaseAndBackports)?;
            with_retries("package lists", || apt.update())?;
            let suite = format!("{}-backports", codename()?);
            apt.install(PROGRAM, Some(&suite))
        }),
    ];
    for (what, way) in ways {
        match timed(what, way) {
            Ok(()) => {
                if let Some(version) = version() {
                    return Ok(version);
                }
                reasons.push(format!("{what}: apt was content, but {PROGRAM} does not run"));
            }
            Err(reason) => reasons.push(format!("{what}: {reason}")),
        }
    }
    Err(format!(
        "{PROGRAM} is missing and could not be installed.\n  {}\n  \
         What to do: install the package {PROGRAM} by hand; any QEMU from 6.0 will do",
        reasons.join("\n  ")
    ))
}

fn version() -> Option<String> {
    let text = capture(&mut command(&[PROGRAM, "--version"])).ok()?;
    text.lines().next().map(str::to_owned)
}
