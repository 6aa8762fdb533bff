//! The compiled core library of the node's target.
//!
//! Normally `rustup target add`. Where the toolchain's host is out of reach, Debian's `rust-src` of the very
//! same compiler version holds the library's source: it is built once and its results are put where rustup
//! would have put them, so that plain stable `cargo build --target` works from then on.

use super::TARGET;
use super::apt::{Apt, Suites};
use crate::shell::{Outcome, TemporaryFolder, capture, cargo, command, on_path, run, say, timed, with_retries};
use std::path::{Path, PathBuf};

/// Libraries a `no_std` program with `alloc` links.
const LIBRARIES: [&str; 3] = ["core", "alloc", "compiler_builtins"];

/// Returns how the target got there.
pub fn ensure() -> Outcome<String> {
    let sysroot = sysroot()?;
    let library = sysroot.join("lib/rustlib").join(TARGET).join("lib");
    if is_complete(&library) {
        return Ok("present".into());
    }
    let by_rustup = if on_path("rustup").is_some() {
        timed("rustup target add", || {
            with_retries("rustup", || {
                capture(command(&["rustup", "target", "add", TARGET]).current_dir(crate::shell::root()))
            })
        })
        .map(drop)
    } else {
        Err("rustup is not installed".to_owned())
    };
    if by_rustup.is_ok() && is_complete(&library) {
        return Ok("added by rustup".into());
    }
    say("rustup could not add the target; building it from the distribution's rust-src of the same version");
    let by_source = from_source(&sysroot, &library);
    match by_source {
        Ok(()) if is_complete(&library) => Ok("built from rust-src".into()),
        outcome => Err(format!(
            "the compiler target {TARGET} is missing and could not be added.\n  \
             by rustup: {}\n  from rust-src: {}\n  \
             What to do: run `rustup target add {TARGET}` on a machine with access to the Rust release server,\n  \
             and copy its `lib/rustlib/{TARGET}` folder into {}",
            by_rustup.err().unwrap_or_else(|| "reported success but added nothing".into()),
            outcome.err().unwrap_or_else(|| "the build gave no libraries".into()),
            sysroot.join("lib/rustlib").display()
        )),
    }
}

fn sysroot() -> Outcome<PathBuf> {
    let text = capture(command(&["rustc", "--print", "sysroot"]).current_dir(crate::shell::root()))?;
    Ok(PathBuf::from(text.trim()))
}

fn is_complete(library: &Path) -> bool {
    LIBRARIES.iter().all(|name| find_rlib(library, name).is_some())
}

fn find_rlib(folder: &Path, crate_name: &str) -> Option<PathBuf> {
    let prefix = format!("lib{crate_name}-");
    std::fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path()).find(|path| {
        path.extension().is_some_and(|e| e == "rlib")
            && path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(&prefix))
    })
}

fn from_source(sysroot: &Path, library: &Path) -> Outcome {
    let version = compiler_version()?;
    let temporary = TemporaryFolder::new("rust-src")?;
    let apt = Apt::with_suites(&temporary.0, Suites::AnyWithRust)?;
    timed("fetching rust-src", || {
        with_retries("package lists", || apt.update())?;
        with_retries("download", || apt.download(&format!("rust-src={version}*"), &temporary.0))
    })?;
    let package = std::fs::read_dir(&temporary.0)
        .map_err(|e| e.to_string())?
        .flatten()
        .map(|entry| entry.path())
        .find(|path| path.extension().is_some_and(|e| e == "deb"))
        .ok_or("apt downloaded no package")?;
    let unpacked = temporary.0.join("unpacked");
    run(command(&["dpkg", "-x"]).arg(&package).arg(&unpacked))?;
    let source = std::fs::read_dir(unpacked.join("usr/src"))
        .map_err(|e| format!("unexpected layout of rust-src: {e}"))?
        .flatten()
        .map(|entry| entry.path().join("library"))
        .find(|path| path.is_dir())
        .ok_or("rust-src holds no library/ folder")?;
    // The compiler looks for the library's source at this one place; it is taken away again afterwards.
    let source_place = sysroot.join("lib/rustlib/src/rust");
    let had_source = source_place.join("library").exists();
    if !had_source {
        std::fs::create_dir_all(&source_place).map_err(|e| format!("{}: {e}", source_place.display()))?;
        run(command(&["cp", "-r"]).arg(&source).arg(source_place.join("library")))?;
    }
    let built = timed("building core and alloc", || build_libraries(&temporary.0));
    if !had_source {
        // Left behind it would only cost space.
        let _ = std::fs::remove_dir_all(sysroot.join("lib/rustlib/src"));
    }
    let built = built?;
    std::fs::create_dir_all(library).map_err(|e| format!("{}: {e}", library.display()))?;
    for path in built {
        let name = path.file_name().expect("a file found by name");
        std::fs::copy(&path, library.join(name)).map_err(|e| format!("{}: {e}", library.display()))?;
    }
    Ok(())
}

/// Version number of the workspace's compiler, for instance `1.95.0`.
fn compiler_version() -> Outcome<String> {
    let text = capture(command(&["rustc", "--version"]).current_dir(crate::shell::root()))?;
    text.split_whitespace().nth(1).map(str::to_owned).ok_or_else(|| format!("cannot read `{}`", text.trim()))
}

/// Builds core and alloc behind an empty library; bitcode is embedded because the image is linked with fat LTO.
fn build_libraries(folder: &Path) -> Outcome<Vec<PathBuf>> {
    let package = folder.join("empty");
    std::fs::create_dir_all(package.join("src")).map_err(|e| e.to_string())?;
    let manifest = "[package]\nname = \"empty\"\nedition = \"2024\"\n[workspace]\n";
    std::fs::write(package.join("Cargo.toml"), manifest).map_err(|e| e.to_string())?;
    std::fs::write(package.join("src/lib.rs"), "#![no_std]\n").map_err(|e| e.to_string())?;
    let output = folder.join("target");
    with_retries("build", || {
        capture(
            cargo(&["build", "--release", "-Zbuild-std=core,alloc", "--target", TARGET])
                .current_dir(&package)
                .env("RUSTC_BOOTSTRAP", "1")
                .env("RUSTFLAGS", "-Cembed-bitcode=yes")
                .env("CARGO_TARGET_DIR", &output),
        )
    })?;
    let deps = output.join(TARGET).join("release/deps");
    LIBRARIES.iter().map(|name| find_rlib(&deps, name).ok_or_else(|| format!("the build left no lib{name}"))).collect()
}
