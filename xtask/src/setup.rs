//! `cargo xtask setup`: what a clean machine lacks to build and run the node.
//!
//! Three things only: the compiler's target library, QEMU, and Unicorn's shared library. Each has a normal way and a
//! fallback for machines where that way is closed; package sources and configuration of the user are never changed.

mod apt;
mod package;
mod qemu;
mod target;
mod unicorn;

use crate::shell::{Outcome, say};

/// The node's target.
pub const TARGET: &str = "thumbv7em-none-eabihf";

/// Makes sure that all of it is there; says what it did.
pub fn run() -> Outcome {
    let (target, qemu, unicorn) = (target::ensure(), qemu::QEMU.ensure(), unicorn::UNICORN.ensure());
    match (&target, &qemu, &unicorn) {
        (Ok(target), Ok(qemu), Ok(unicorn)) => {
            say(format!("set up: {TARGET} ({target}), {qemu}, {unicorn}"));
            Ok(())
        }
        _ => Err([target.err(), qemu.err(), unicorn.err()].into_iter().flatten().collect::<Vec<_>>().join("\n\n")),
    }
}
