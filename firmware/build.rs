//! Link arguments of the images, and the memory map at the workspace's root.
//!
//! They are set here for the binaries alone: in a configuration file they would reach host builds.

use std::env;
use std::path::PathBuf;

fn main() {
    let package = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo names the package's folder"));
    let root = package.parent().expect("the package lies in the workspace");
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed={}", root.join("memory.x").display());
    println!("cargo:rustc-link-search={}", root.display());
    if env::var_os("CARGO_FEATURE_BOARD_AN386").is_some() {
        // Chooses this board's addresses in memory.x.
        println!("cargo:rustc-link-arg-bins=--defsym=_board_an386=1");
    }
    if env::var_os("CARGO_FEATURE_BOARD_STM32F767").is_some() {
        println!("cargo:rustc-link-arg-bins=--defsym=_board_stm32f767=1");
    }
    println!("cargo:rustc-link-arg-bins=-Tlink.x");
    println!("cargo:rustc-link-arg-bins=-Tdefmt.x");
    // Sections packed without page alignment: a page of zeros per section would not fit a small flash.
    println!("cargo:rustc-link-arg-bins=--nmagic");
}
