//! QEMU's Arm system emulator from the distribution.

use super::package::Package;
use crate::shell::{capture, command};

const PROGRAM: &str = "qemu-system-arm";

/// The package.
pub const QEMU: Package = Package {
    name: PROGRAM,
    what: PROGRAM,
    version,
    advice: "install QEMU's Arm system emulator with your package manager (Debian, Arch: qemu-system-arm, \
             Fedora: qemu-system-arm-core, Homebrew: qemu); any QEMU from 6.0 will do",
};

fn version() -> Option<String> {
    let text = capture(&mut command(&[PROGRAM, "--version"])).ok()?;
    text.lines().next().map(str::to_owned)
}
