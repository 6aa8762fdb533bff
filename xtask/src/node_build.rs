//! `cargo xtask node-build` and `size`: the firmware images, what they need of flash and RAM, and from where they can
//! panic.

use crate::elf::{self, PanicSite, Sizes};
use crate::release;
use crate::setup::{self, TARGET};
use crate::shell::{Outcome, cargo, root, timed, watched};
use crate::stack_use::{self, StackUse};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::Command;

/// Images whose sizes are watched, with what their board needs.
const SIZED_IMAGES: [&str; 3] = ["an386", "loader", "stm32f405"];

/// Everything that is built: binary and board. The drill restarts itself in QEMU, for
/// `tests/tests/qemu/qemu_runner.rs`; the released node is linked for each of its two slots.
pub const IMAGES: [(&str, &str); 5] = [
    ("an386", "an386"),
    ("restart", "an386"),
    ("loader", "stm32f405"),
    ("stm32f405", "stm32f405"),
    ("stm32f405_b", "stm32f405"),
];

/// The board the limits are meant for.
pub const RELEASE_BOARD: &str = "stm32f405";
/// Bytes of flash a released image may take: four fifths of its slot, the rest is for what updates bring.
const FLASH_LIMIT: u64 = 200 * 1024;
/// Bytes of flash that the loader may take: the first sector.
const LOADER_LIMIT: u64 = 16 * 1024;
/// Bytes of static RAM a released image may take: CCM and SRAM of the STM32F405 less the stack.
const RAM_LIMIT: u64 = 163 * 1024;
/// Bytes of the released image's stack that must stay free beside what the bound over all paths says.
const STACK_MARGIN: u32 = 4 * 1024;
/// Bytes that its stack may need.
const STACK_LIMIT: u32 = 25 * 1024 + 256;
/// Growth over the snapshot that asks for a decision, percent. Paths of the build machine lie in the image too, so that
/// exact sizes differ from one machine to the next.
const GROWTH_PERCENT: u64 = 2;

/// Sets up and builds all images, then prints their sizes.
pub fn run() -> Outcome {
    setup::run()?;
    build()?;
    size(&[])
}

/// Builds all images, and the update file of them.
pub fn build() -> Outcome {
    IMAGES.iter().try_for_each(|(image, board)| timed(&format!("firmware {image}"), || run_build(image, board)))?;
    release::write()
}

/// Builds one image, with signs of life.
pub fn build_one(image: &str) -> Outcome {
    let (image, board) = IMAGES.iter().find(|(name, _)| *name == image).ok_or(format!("no image {image}"))?;
    timed(&format!("firmware {image}"), || watched(&format!("firmware {image}"), &mut of_image(image, board)))
}

fn run_build(image: &str, board: &str) -> Outcome {
    crate::shell::run(of_image(image, board).arg("--quiet"))
}

fn of_image(image: &str, board: &str) -> Command {
    let feature = format!("board-{board}");
    cargo(&[
        "build",
        "--package",
        "meshband-node",
        "--target",
        TARGET,
        "--profile",
        "firmware",
        "--bin",
        image,
        "--features",
        &feature,
    ])
}

/// Prints text, data, bss and deepest stack of each image, and the released image's panics; an error names every
/// limit passed, every growth over the snapshots in `tests/snapshots` and every panic of our own. `--bless` writes
/// the snapshots anew.
pub fn size(args: &[String]) -> Outcome {
    let bless = match args {
        [] => false,
        [only] if only == "--bless" => true,
        _ => return Err("size takes nothing but --bless".into()),
    };
    let mut table =
        format!("{:10} {:>8} {:>8} {:>8} {:>9} {:>9} {:>9}\n", "image", "text", "data", "bss", "flash", "RAM", "stack");
    let (mut complaints, mut stacks) = (Vec::new(), Vec::new());
    let before = std::fs::read_to_string(snapshot("size.txt")).unwrap_or_default();
    for board in SIZED_IMAGES {
        let path = image(board);
        if !path.exists() {
            return Err(format!("no image of {board}: run `cargo xtask node-build` first"));
        }
        let sizes: Sizes = elf::sizes(&path)?;
        let (flash, ram) = (sizes.flash(), sizes.ram());
        let stack = stack_use::of(&path)?;
        let _ = writeln!(
            table,
            "{board:10} {:8} {:8} {:8} {flash:9} {ram:9} {:9}",
            sizes.text,
            sizes.data,
            sizes.bss,
            stack.sum()
        );
        stacks.push((board, stack));
        if board == "loader" {
            complain_above(&mut complaints, board, "flash", flash, LOADER_LIMIT);
        }
        if board == RELEASE_BOARD {
            complain_above(&mut complaints, board, "flash", flash, FLASH_LIMIT);
            complain_above(&mut complaints, board, "RAM", ram, RAM_LIMIT);
            let limit = STACK_LIMIT.min(stack.size.saturating_sub(STACK_MARGIN));
            if stack.recursive {
                complaints.push(format!("{board}: a function may call itself, so its stack has no bound"));
            }
            complain_above(&mut complaints, board, "stack", stack.sum().into(), limit.into());
        }
        if let Some((old_flash, old_ram)) = recorded(&before, board).filter(|_| !bless) {
            let grown = |old: u64| old + old * GROWTH_PERCENT / 100;
            complain_above(&mut complaints, board, "flash (grown over the snapshot)", flash, grown(old_flash));
            complain_above(&mut complaints, board, "RAM (grown over the snapshot)", ram, grown(old_ram));
        }
    }
    print!("{table}");
    for (board, stack) in &stacks {
        let StackUse { main, interrupt, fault, size, .. } = stack;
        let sum = stack.sum();
        println!(
            "{board}: at most {main} bytes of stack in main + {interrupt} in an interrupt + {fault} in a fault = \
             {sum} of {size}"
        );
    }
    let panics = check_panics(&mut complaints, bless)?;
    check_start_and_logs(&mut complaints)?;
    if bless {
        write_snapshot("size.txt", &table)?;
        write_snapshot("panics.txt", &panics)?;
    }
    if complaints.is_empty() { Ok(()) } else { Err(complaints.join("\n")) }
}

fn complain_above(complaints: &mut Vec<String>, board: &str, what: &str, value: u64, limit: u64) {
    if value > limit {
        complaints.push(format!("{board}: {value} bytes of {what}, limit {limit}; `cargo xtask size --bless` accepts"));
    }
}

/// Flash and RAM of a board in a table as `size` prints it.
fn recorded(table: &str, board: &str) -> Option<(u64, u64)> {
    let line = table.lines().find(|line| line.split_whitespace().next() == Some(board))?;
    let numbers: Vec<u64> = line.split_whitespace().skip(1).filter_map(|word| word.parse().ok()).collect();
    Some((*numbers.get(3)?, *numbers.get(4)?))
}

/// The released image must set its vector table's address, because a boot loader that jumps to it leaves its own in
/// force, and must hold the log that `book/src/howto/flash.md` shows by a probe: the strings themselves lie outside
/// the flash.
fn check_start_and_logs(complaints: &mut Vec<String>) -> Outcome {
    const VECTOR_TABLE_OFFSET: u32 = 0xe000_ed08;
    let path = image(RELEASE_BOARD);
    let bytes = std::fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let image = elf::Image::parse(&bytes).ok_or_else(|| format!("{}: no ELF32 with symbols", path.display()))?;
    let words = image.loaded.iter().flat_map(|(_, data)| data.chunks_exact(4));
    if !words.into_iter().any(|word| word == VECTOR_TABLE_OFFSET.to_le_bytes()) {
        complaints.push(format!("{RELEASE_BOARD}: never sets the vector table's address"));
    }
    let is_log =
        |name: &&&str| name.contains("\"package\":\"meshband-node\"") && name.contains("\"tag\":\"defmt_info\"");
    let logs = image.names.keys().filter(is_log).count();
    println!("{RELEASE_BOARD}: {logs} log messages");
    if logs == 0 {
        complaints.push(format!("{RELEASE_BOARD}: its logs are compiled out; DEFMT_LOG is set in firmware/build.rs"));
    }
    Ok(())
}

/// The released image's panics per file; complains about our own and about files that are new.
fn check_panics(complaints: &mut Vec<String>, bless: bool) -> Outcome<String> {
    let sites = elf::panic_sites(&image(RELEASE_BOARD))?;
    for PanicSite { file, line, column } in sites.iter().filter(|site| site.is_own()) {
        complaints.push(format!("{RELEASE_BOARD}: can panic at {file}:{line}:{column}"));
    }
    let mut files: BTreeMap<&str, usize> = BTreeMap::new();
    for site in &sites {
        *files.entry(&site.file).or_default() += 1;
    }
    println!(
        "{RELEASE_BOARD}: {} places can panic, {} of them ours",
        sites.len(),
        sites.iter().filter(|s| s.is_own()).count()
    );
    let mut list = String::new();
    let before = std::fs::read_to_string(snapshot("panics.txt")).unwrap_or_default();
    for (file, places) in files {
        let line = format!("{places:4} {file}");
        println!("{line}");
        if !bless && !before.lines().any(|known| known.split_whitespace().nth(1) == Some(file)) {
            complaints.push(format!("{RELEASE_BOARD}: {file} can panic and is not in the snapshot"));
        }
        let _ = writeln!(list, "{line}");
    }
    Ok(list)
}

fn snapshot(name: &str) -> PathBuf {
    root().join("tests/snapshots").join(name)
}

fn write_snapshot(name: &str, text: &str) -> Outcome {
    let path = snapshot(name);
    std::fs::create_dir_all(root().join("tests/snapshots")).map_err(|e| format!("tests/snapshots: {e}"))?;
    std::fs::write(&path, text).map_err(|e| format!("{}: {e}", path.display()))
}

/// Where cargo puts the ELF image of a board.
pub fn image(board: &str) -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), |t| root().join(t));
    target.join(TARGET).join("firmware").join(board)
}
