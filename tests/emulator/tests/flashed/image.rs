//! The released image, where it and Unicorn are there.

use meshband_emulator::elf::Image;
use meshband_emulator::unicorn;
use std::path::{Path, PathBuf};

/// Path of the released image.
pub fn path() -> PathBuf {
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let target =
        std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| workspace.join("target"), |folder| workspace.join(folder));
    target.join("thumbv7em-none-eabihf/firmware/stm32f405")
}

/// The image, or `None` after saying why the test is skipped.
pub fn image(test: &str) -> Option<Image> {
    let path = path();
    if !unicorn::is_installed() || !path.is_file() {
        println!("skipped {test}: Unicorn or the firmware image is absent (cargo xtask setup, cargo xtask node-build)");
        return None;
    }
    Some(Image::read(&path).expect("an image"))
}
