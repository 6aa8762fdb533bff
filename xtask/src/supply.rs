//! `cargo xtask supply-chain` and `cargo xtask reproducible`: what goes into a build, and whether it comes out the
//! same.

use crate::elf::Image;
use crate::node_build::{IMAGES, RELEASE_BOARD};
use crate::setup::{self, TARGET};
use crate::shell::{
    Outcome, TemporaryFolder, capture, cargo, command, on_path, programs, root, run, say, stamp, timed,
};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Writes the bill of materials to `target/bom.json`, then runs cargo-deny where it is installed.
pub fn chain(args: &[String]) -> Outcome {
    if !args.is_empty() {
        return Err("supply-chain takes no arguments".into());
    }
    let [program] = programs(["bom"])?;
    let bill = timed("bill of materials", || capture(&mut Command::new(program)))?;
    let path = root().join("target/bom.json");
    std::fs::write(&path, bill).map_err(|e| format!("{}: {e}", path.display()))?;
    say(format_args!("written: {}", path.display()));
    match deny(&["check"])? {
        None => Ok(()),
        Some(reason) => {
            say(format_args!(
                "NOT checked: {reason}; licences and sources are, by `cargo test --release --test supply_chain`"
            ));
            Ok(())
        }
    }
}

/// Known weaknesses of what is locked; gives the reason where this machine cannot know them.
pub fn advisories() -> Outcome<Option<String>> {
    deny(&["check", "advisories"])
}

/// Runs cargo-deny; an absent program or an unreachable database is a reason, a finding an error.
fn deny(check: &[&str]) -> Outcome<Option<String>> {
    if on_path("cargo-deny").is_none() {
        return Ok(Some("cargo-deny is not installed (`cargo install --locked cargo-deny`)".into()));
    }
    let output = cargo(&["deny", "--locked", "--color", "never"])
        .args(check)
        .output()
        .map_err(|e| format!("cargo-deny: {e}"))?;
    let said = String::from_utf8_lossy(&output.stderr);
    if output.status.success() {
        return Ok(None);
    }
    if let Some(line) = said.lines().find(|line| is_unreachable(line)) {
        return Ok(Some(format!("no database of advisories: {}", line.trim())));
    }
    Err(format!("cargo-deny finds:\n{}", said.trim()))
}

/// Whether a line of cargo-deny says that its database cannot be had, as against a finding in it.
fn is_unreachable(line: &str) -> bool {
    let fetch = ["failed to fetch advisory database", "failed to load advisory database", "unable to fetch"];
    fetch.iter().any(|words| line.contains(words))
}

/// Builds every image from the present commit in two clean folders of different names and compares what is loaded.
/// The result goes to `target/reproducible.md`.
pub fn reproducible(args: &[String]) -> Outcome {
    if !args.is_empty() {
        return Err("reproducible takes no arguments".into());
    }
    setup::run()?;
    let folder = TemporaryFolder::new("reproducible")?;
    let places = [folder.0.join("a"), folder.0.join("another-and-much-longer-path/b")];
    for place in &places {
        timed(&format!("images in {}", place.display()), || build_in(place, "HEAD", &IMAGES))?;
    }
    let mut page = String::from(PAGE_HEAD);
    let _ = writeln!(page, "Of {}.\n\n| image | bytes loaded | same in both |\n| --- | --- | --- |", stamp()?);
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
    let path = root().join("target/reproducible.md");
    std::fs::write(&path, page).map_err(|e| format!("{}: {e}", path.display()))?;
    if different.is_empty() { Ok(()) } else { Err(format!("not reproducible: {}", different.join(", "))) }
}

const PAGE_HEAD: &str = "\
# Reproducible images

Written by `cargo xtask reproducible`: the committed sources, unpacked into two folders of different paths, built \
there from nothing with
the locked versions, and compared byte by byte (what is loaded into the node, addresses included; debug information \
stays out
of it). Both builds share compiler and package folder: messages of panics in dependencies name files there, so a \
machine with another
home folder may differ in these texts.

";

/// Builds the released image of the sources as they are now a second time, in a folder of another path, and compares
/// it with the one in `target`: the short form of [`reproducible`], for the test command. Gives the reason where the
/// sources are in no repository.
pub fn image_elsewhere() -> Outcome<Option<String>> {
    if capture(command(&["git", "-C"]).arg(root()).args(["rev-parse", "HEAD"])).is_err() {
        return Ok(Some("the sources are in no git repository".into()));
    }
    let folder = TemporaryFolder::new("elsewhere")?;
    let place = folder.0.join("another-and-much-longer-path");
    // A commit object of what is changed and tracked; nothing where nothing is.
    let changed = capture(command(&["git", "-C"]).arg(root()).args(["stash", "create"]))?;
    let sources = if changed.trim().is_empty() { "HEAD" } else { changed.trim() };
    build_in(&place, sources, &[(RELEASE_BOARD, RELEASE_BOARD)])?;
    let [here, there] = [loaded(&root(), RELEASE_BOARD)?, loaded(&place, RELEASE_BOARD)?];
    if here == there {
        return Ok(None);
    }
    let first = here.iter().zip(&there).position(|(a, b)| a != b).unwrap_or(here.len().min(there.len()));
    Err(format!("{RELEASE_BOARD}: {} and {} bytes loaded, first different at byte {first}", here.len(), there.len()))
}

fn build_in(place: &Path, sources: &str, images: &[(&str, &str)]) -> Outcome {
    std::fs::create_dir_all(place).map_err(|e| format!("{}: {e}", place.display()))?;
    let archive = place.join("sources.tar");
    capture(command(&["git", "-C"]).arg(root()).args(["archive", "--format=tar", sources, "-o"]).arg(&archive))?;
    capture(command(&["tar", "-xf"]).arg(&archive).arg("-C").arg(place))?;
    let commit = capture(command(&["git", "-C"]).arg(root()).args(["rev-parse", "--short=10", "HEAD"]))?;
    for (image, board) in images {
        let feature = format!("board-{board}");
        let mut build = cargo(&["build", "--quiet", "--locked", "--package", "meshband-node", "--target", TARGET]);
        build.args(["--profile", "firmware", "--bin", image, "--features", &feature]).current_dir(place);
        build.arg("--target-dir").arg(place.join("target")).env("MESHBAND_COMMIT", commit.trim());
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

#[cfg(test)]
mod tests {
    use super::is_unreachable;

    #[test]
    fn theory_a_missing_database_is_told_from_a_finding() {
        assert!(is_unreachable("2026-01-01 00:00:00 [ERROR] failed to fetch advisory database PLACE"));
        assert!(!is_unreachable("error[vulnerability]: Uncontrolled recursion in a parser"));
        assert!(!is_unreachable("error[unmaintained]: the crate is unmaintained"));
    }
}
