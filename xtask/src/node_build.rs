//! `cargo xtask node-build` and `size`: the firmware images and what they need of flash and RAM.

use crate::elf::{self, Sizes};
use crate::setup::{self, TARGET};
use crate::shell::{Outcome, cargo, root, timed};
use std::path::PathBuf;

/// One binary per board; the feature of the same name selects it.
pub const BOARDS: [&str; 2] = ["an386", "stm32f405"];

/// Bytes of flash a released image may take (issue 6).
const FLASH_LIMIT: u64 = 160 * 1024;
/// Bytes of static RAM a released image may take (issue 6): CCM and SRAM of the STM32F405 less the stack.
const RAM_LIMIT: u64 = 160 * 1024;

/// Sets up and builds both images, then prints their sizes.
pub fn run() -> Outcome {
    setup::run()?;
    build()?;
    size()
}

/// Builds both images.
pub fn build() -> Outcome {
    BOARDS.iter().try_for_each(|board| timed(&format!("firmware for {board}"), || run_build(board)))
}

fn run_build(board: &str) -> Outcome {
    let feature = format!("board-{board}");
    crate::shell::run(&mut cargo(&[
        "build",
        "--quiet",
        "--package",
        "meshband-node",
        "--target",
        TARGET,
        "--profile",
        "firmware",
        "--bin",
        board,
        "--features",
        &feature,
    ]))
}

/// Prints text, data and bss of each image that was built; an error names every limit passed.
pub fn size() -> Outcome {
    println!("{:10} {:>8} {:>8} {:>8} {:>9} {:>9}", "image", "text", "data", "bss", "flash", "RAM");
    let mut complaints = Vec::new();
    for board in BOARDS {
        let path = image(board);
        if !path.exists() {
            return Err(format!("no image of {board}: run `cargo xtask node-build` first"));
        }
        let sizes: Sizes = elf::sizes(&path)?;
        println!("{board:10} {:8} {:8} {:8} {:9} {:9}", sizes.text, sizes.data, sizes.bss, sizes.flash(), sizes.ram());
        if board == "stm32f405" {
            if sizes.flash() > FLASH_LIMIT {
                complaints.push(format!("{board}: {} bytes of flash, limit {FLASH_LIMIT}", sizes.flash()));
            }
            if sizes.ram() > RAM_LIMIT {
                complaints.push(format!("{board}: {} bytes of RAM, limit {RAM_LIMIT}", sizes.ram()));
            }
        }
    }
    if complaints.is_empty() { Ok(()) } else { Err(complaints.join("\n")) }
}

/// Where cargo puts the ELF image of a board.
pub fn image(board: &str) -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), |t| root().join(t));
    target.join(TARGET).join("firmware").join(board)
}
