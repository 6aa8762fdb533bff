//! `cargo xtask supply-chain` and `cargo xtask reproducible`: what goes into a build, and whether it comes out the same.

use crate::elf::Image;
use crate::node_build::IMAGES;
use crate::setup::{self, TARGET};
use crate::shell::{Outcome, TemporaryFolder, capture, cargo, command, on_path, root, run, say, timed};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Writes the bill of materials to `target/bom.json`, then runs cargo-deny where it is installed.
pub fn chain(args: &[String]) -> Outcome {
    if !args.is_empty() {
        return Err("supply-chain takes no arguments".into());
    }
    let bill = timed("bill of materials", || {
        capture(&mut cargo(&["run", "--quiet", "--locked", "--release", "--package", "meshband-tests", "--bin", "bom"]))
    })?;
    let path = root().join("target/bom.json");
    std::fs::write(&path, bill).map_err(|e| format!("{}: {e}", path.display()))?;
    say(format_args!("written: {}", path.display()));
    if on_path("cargo-deny").is_none() {
        say(
            "cargo-deny is not installed (`cargo install --locked cargo-deny`): advisories are NOT checked; licences and \
             sources are, by `cargo test --release --test supply_chain`",
        );
        return Ok(());
    }
    timed("cargo-deny", || run(&mut cargo(&["deny", "--locked", "check"])))
}

/// Builds every image from the present commit in two clean folders of different names and compares what is loaded.
/// The result goes to `docs/reproducible.md`.
pub fn reproducible(args: &[String]) -> Outcome {
    if !args.is_empty() {
        return Err("reproducible takes no arguments".into());
    }
    setup::run()?;
    let folder = TemporaryFolder::new("reproducible")?;
    let places = [folder.0.join("a"), folder.0.join("another-and-much-longer-path/b")];
    for place in &places {
        timed(&format!("images in {}", place.display()), || build_in(place))?;
    }
    let mut page = String::from(PAGE_HEAD);
    let commit = capture(command(&["git", "-C"]).arg(root()).args(["rev-parse", "--short", "HEAD"]))?;
    let date = capture(&mut command(&["date", "-u", "+%Y-%m-%d"]))?;
    let _ = writeln!(
        page,
        "Commit {}, {}.\n\n| image | bytes loaded | same in both |\n| --- | --- | --- |",
        commit.trim(),
        date.trim()
    );
    let mut different = Vec::new();
    for (image, _) in IMAGES {
        let [first, second] = [loaded(&places[0], image)?, loaded(&places[1], image)?];
        let same = first == second;
        let _ = writeln!(page, "| {image} | {} | {} |", first.len(), if same { "yes" } else { "NO" });
        if !same {
            different.push(image);
        }
    }
    print!("{page}");
    let path = root().join("docs/reproducible.md");
    std::fs::write(&path, page).map_err(|e| format!("{}: {e}", path.display()))?;
    if different.is_empty() { Ok(()) } else { Err(format!("not reproducible: {}", different.join(", "))) }
}

const PAGE_HEAD: &str = "\
# Reproducible images

Written by `cargo xtask reproducible`: the committed sources, unpacked into two folders of different paths, built there from nothing with
the locked versions, and compared byte by byte (what is loaded into the node, addresses included; debug information stays out
of it). Both builds share compiler and package folder: messages of panics in dependencies name files there, so a machine with another
home folder may differ in these texts.

";

fn build_in(place: &Path) -> Outcome {
    std::fs::create_dir_all(place).map_err(|e| format!("{}: {e}", place.display()))?;
    let archive = place.join("sources.tar");
    capture(command(&["git", "-C"]).arg(root()).args(["archive", "--format=tar", "HEAD", "-o"]).arg(&archive))?;
    capture(command(&["tar", "-xf"]).arg(&archive).arg("-C").arg(place))?;
    for (image, board) in IMAGES {
        let feature = format!("board-{board}");
        let mut build = cargo(&["build", "--quiet", "--locked", "--package", "meshband-node", "--target", TARGET]);
        build.args(["--profile", "firmware", "--bin", image, "--features", &feature]).current_dir(place);
        build.arg("--target-dir").arg(place.join("target"));
        run(&mut build)?;
    }
    Ok(())
}

/// Addresses and contents of an image.
fn loaded(place: &Path, image: &str) -> Outcome<Vec<u8>> {
    let path: PathBuf = place.join("target").join(TARGET).join("firmware").join(image);
    let bytes = std::fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let image = Image::parse(&bytes).ok_or_else(|| format!("{}: not an ELF32 image", path.display()))?;
    Ok(image.loaded.iter().flat_map(|(at, data)| at.to_le_bytes().into_iter().chain(data.iter().copied())).collect())
}
