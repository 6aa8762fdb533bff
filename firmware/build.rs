//! Link arguments of the images, and the memory map at the workspace's root.
//!
//! They are set here for the binaries alone: in a configuration file they would reach host builds.

use std::env;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Level of the logs in images whose logs go to a debug probe; `DEFMT_LOG` at the build overrules it.
const LOG_LEVEL: &str = "info";

fn main() {
    let package = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo names the package's folder"));
    let root = package.parent().expect("the package lies in the workspace");
    name_commit(root);
    println!("cargo:rerun-if-env-changed=DEFMT_LOG");
    if env::var_os("DEFMT_LOG").is_none() && env::var_os("CARGO_FEATURE_BOARD_STM32F405").is_some() {
        println!("cargo:rustc-env=DEFMT_LOG={LOG_LEVEL}");
    }
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed={}", root.join("memory.x").display());
    println!("cargo:rustc-link-search={}", root.display());
    if env::var_os("CARGO_FEATURE_BOARD_AN386").is_some() {
        // Chooses this board's addresses in memory.x.
        println!("cargo:rustc-link-arg-bins=--defsym=_board_an386=1");
    }
    if env::var_os("CARGO_FEATURE_BOARD_STM32F405").is_some() {
        // Their places in memory.x; the lower slot is the default.
        println!("cargo:rustc-link-arg-bin=loader=--defsym=_place_loader=1");
        println!("cargo:rustc-link-arg-bin=stm32f405_b=--defsym=_place_slot_b=1");
    }
    println!("cargo:rustc-link-arg-bins=-Tlink.x");
    println!("cargo:rustc-link-arg-bins=-Tdefmt.x");
    // Sections packed without page alignment: a page of zeros per section would not fit a small flash.
    println!("cargo:rustc-link-arg-bins=--nmagic");
}

/// The commit's short hash into the image: `MESHBAND_COMMIT` where sources are built without their repository, else
/// git's; nothing where there is neither, and the image then says `unknown`.
fn name_commit(root: &Path) {
    let ask = |arguments: &[&str]| {
        let output = Command::new("git").arg("-C").arg(root).args(arguments).output().ok()?;
        let text = String::from_utf8(output.stdout).ok()?;
        output.status.success().then(|| text.trim().to_owned()).filter(|text| !text.is_empty())
    };
    // Built anew when another commit is checked out, and when a commit moves the branch.
    for name in ["HEAD", "logs/HEAD"] {
        if let Some(path) = ask(&["rev-parse", "--git-path", name]) {
            println!("cargo:rerun-if-changed={}", root.join(path).display());
        }
    }
    println!("cargo:rerun-if-env-changed=MESHBAND_COMMIT");
    let given = env::var("MESHBAND_COMMIT").ok().filter(|hash| !hash.is_empty());
    if let Some(hash) = given.or_else(|| ask(&["rev-parse", "--short=10", "HEAD"])) {
        println!("cargo:rustc-env=MESHBAND_BUILD={hash}");
    }
}
