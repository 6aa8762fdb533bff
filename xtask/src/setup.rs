//! `cargo xtask setup`: what a clean machine lacks to build and run the node.
//!
//! Two things only: the compiler's target library and QEMU. Each has a normal way and a fallback for
//! machines where that way is closed; package sources and configuration of the user are never changed.

mod apt;
mod qemu;
mod target;

use crate::shell::{Outcome, say};

/// The node's target.
pub const TARGET: &str = "thumbv7em-none-eabihf";

/// Makes sure that target and QEMU are there; says what it did.
pub fn run() -> Outcome {
    let target = target::ensure();
    let qemu = qemu::ensure();
    match (&target, &qemu) {
        (Ok(target), Ok(qemu)) => {
            say(format!("set up: {TARGET} ({target}), {qemu}"));
            Ok(())
        }
        _ => Err([target.err(), qemu.err()].into_iter().flatten().collect::<Vec<_>>().join("\n\n")),
    }
}
