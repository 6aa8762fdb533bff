//! QEMU's Arm system emulator from the distribution.
//!
//! QEMU 7.2.22 (Debian 12) loses every second interrupt of the AN386's timer under `-icount`; 10.0.2 loses none. What
//! is older than 8 is therefore taken for absent, and the release's backports are asked.

use super::package::Package;
use crate::shell::{capture, command};

const PROGRAM: &str = "qemu-system-arm";

/// Major version below which timers lose interrupts.
const MIN_QEMU_VERSION: u32 = 8;

/// The package.
pub const QEMU: Package = Package {
    name: PROGRAM,
    what: PROGRAM,
    version,
    advice: "install QEMU's Arm system emulator with your package manager (Debian, Arch: qemu-system-arm, \
             Fedora: qemu-system-arm-core, Homebrew: qemu); QEMU 8.0 or newer",
};

fn version() -> Option<String> {
    let text = capture(&mut command(&[PROGRAM, "--version"])).ok()?;
    let first = text.lines().next()?;
    let major: u32 = first.split("version ").nth(1)?.split('.').next()?.parse().ok()?;
    (major >= MIN_QEMU_VERSION).then(|| first.to_owned())
}
