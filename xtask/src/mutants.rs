//! `cargo xtask mutants`: does some test notice when `shared` computes something else? Into `docs/mutation.md`.
//!
//! cargo-mutants makes the mutants and judges them. Each costs a build, so they run in a small workspace of their own under
//! `target/mutants`: `shared`, and the node's tests that need nothing of the host. A mutant that survives here may still
//! be killed by the tests that are left out (QEMU, the emulated chip, the loop); the page names every survivor.
//! `--sample K/N` takes every N-th mutant from the K-th on.

use crate::shell::{Outcome, capture, command, root, say, timed};
use std::fmt::Write;
use std::path::Path;

const PAGE_HEAD: &str = "\
# Mutation testing of `shared`

Written by `cargo xtask mutants` (cargo-mutants, which changes one operator, constant or function body at a time). A mutant is killed where
a test fails or no longer ends; one that does not compile is not counted. The tests are those of `tests/tests/node` that need
nothing of the host; the tests in QEMU, on the emulated chip and of the loop are not asked.

";

/// Files of `tests/tests/node` that need the host's crates, and helpers that do.
const WITHOUT: [&str; 5] = ["node_trials", "spectral", "node_products", "rise_time", "alarm_output"];

const MANIFEST: &str = "\
[workspace]
resolver = \"3\"
members = [\"shared\", \"tests/kit\", \"tests\"]

[workspace.package]
version = \"0.1.0\"
edition = \"2024\"
rust-version = \"1.95\"
license = \"MIT OR Apache-2.0\"
repository = \"local\"

[workspace.lints.rust]

[workspace.dependencies]
meshband = { path = \"shared\" }
meshband-kit = { path = \"tests/kit\" }
serde = { version = \"1\", default-features = false, features = [\"derive\"] }

[profile.dev]
opt-level = 1
debug = 0
";

const TESTS_MANIFEST: &str = "\
[package]
name = \"meshband-tests\"
version.workspace = true
edition.workspace = true
rust-version.workspace = true
license.workspace = true

[dependencies]
meshband = { workspace = true }
meshband-kit = { workspace = true }
embedded-storage = \"0.3\"
postcard = { version = \"1.1\", default-features = false }
rand = { version = \"0.10\", default-features = false, features = [\"std\", \"std_rng\"] }
rand_chacha = \"0.10\"

[dev-dependencies]
rustfft = \"6.4\"
rand_distr = \"0.6\"
serde_json = \"1\"
hound = \"3.5\"
heapless = \"0.9.3\"
cobs = { version = \"0.5\", default-features = false }
proptest = { version = \"1\", default-features = false, features = [\"std\"] }
";

/// Prepares the workspace, runs cargo-mutants, writes the page.
pub fn run_task(args: &[String]) -> Outcome {
    let sample = match args {
        [] => "0/1".to_owned(),
        [name, value] if name == "--sample" => value.clone(),
        _ => return Err("mutants takes --sample K/N".into()),
    };
    let folder = root().join("target/mutants");
    prepare(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let output = folder.join("results");
    let _ = std::fs::remove_dir_all(&output);
    timed("mutants", || {
        let mut mutants = command(&["cargo", "mutants", "--in-place", "--no-shuffle", "--colors", "never"]);
        mutants.current_dir(&folder).args(["--package", "meshband", "--test-package", "meshband-tests"]);
        mutants.args(["--shard", &sample, "--sharding", "round-robin", "--minimum-test-timeout", "120"]);
        // Survivors are results, not failures of this task.
        mutants.arg("--output").arg(&output).status().map_err(|e| format!("cargo mutants: {e}")).map(|_| ())
    })?;
    let lines = |name: &str| -> Vec<String> {
        let text = std::fs::read_to_string(output.join("mutants.out").join(name)).unwrap_or_default();
        text.lines().map(str::to_owned).collect()
    };
    let (caught, missed, timeout) = (lines("caught.txt"), lines("missed.txt"), lines("timeout.txt"));
    let unviable = lines("unviable.txt").len();
    let (killed, viable) = (caught.len() + timeout.len(), caught.len() + timeout.len() + missed.len());
    if viable == 0 {
        return Err("no mutant was judged".into());
    }
    let date = capture(&mut command(&["date", "-u", "+%Y-%m-%d"]))?;
    let [low, high] = interval(killed as f64, viable as f64);
    let mut page = format!(
        "{PAGE_HEAD}{}, sample {sample}: {viable} viable mutants judged, {killed} killed ({} of them by not ending), {} survived, \
         {unviable} did not compile.\n\nKilled: {:.1} %; 95 % interval (Wilson) {:.1} to {:.1} %.\n\n## Survivors\n\n",
        date.trim(),
        timeout.len(),
        missed.len(),
        100.0 * killed as f64 / viable as f64,
        100.0 * low,
        100.0 * high
    );
    for line in &missed {
        let _ = writeln!(page, "* `{line}`");
    }
    print!("{page}");
    let path = root().join("docs/mutation.md");
    std::fs::write(&path, page).map_err(|e| format!("{}: {e}", path.display()))?;
    say(format_args!("written: {}", path.display()));
    Ok(())
}

/// Wilson's interval of a share, 95 %.
fn interval(hits: f64, count: f64) -> [f64; 2] {
    let z = 1.96_f64;
    let (share, square) = (hits / count, z * z);
    let middle = (share + square / (2.0 * count)) / (1.0 + square / count);
    let half = z / (1.0 + square / count) * (share * (1.0 - share) / count + square / (4.0 * count * count)).sqrt();
    [(middle - half).max(0.0), (middle + half).min(1.0)]
}

fn prepare(folder: &Path) -> std::io::Result<()> {
    let _ = std::fs::remove_dir_all(folder);
    copy(&root().join("shared"), &folder.join("shared"), &|_| true)?;
    copy(&root().join("tests/kit"), &folder.join("tests/kit"), &|_| true)?;
    copy(&root().join("tests/vectors/wire"), &folder.join("tests/vectors/wire"), &|_| true)?;
    let plain = |name: &str| !WITHOUT.contains(&name.trim_end_matches(".rs"));
    copy(&root().join("tests/tests/node"), &folder.join("tests/tests/node"), &plain)?;
    let main = folder.join("tests/tests/node/main.rs");
    let modules = std::fs::read_to_string(&main)?;
    let kept = |line: &&str| {
        let module = line.strip_prefix("mod ").and_then(|rest| rest.strip_suffix(';'));
        module.is_none_or(|name| !WITHOUT.contains(&name))
    };
    std::fs::write(&main, modules.lines().filter(kept).collect::<Vec<_>>().join("\n"))?;
    std::fs::create_dir_all(folder.join("tests/src"))?;
    for name in ["gear_signal", "mock_flash", "plant"] {
        std::fs::copy(root().join(format!("tests/src/{name}.rs")), folder.join(format!("tests/src/{name}.rs")))?;
    }
    std::fs::write(folder.join("tests/src/lib.rs"), "pub mod gear_signal;\npub mod mock_flash;\npub mod plant;\n")?;
    std::fs::write(folder.join("tests/Cargo.toml"), TESTS_MANIFEST)?;
    std::fs::copy(root().join("Cargo.lock"), folder.join("Cargo.lock"))?;
    std::fs::write(folder.join("Cargo.toml"), MANIFEST)
}

/// Copies a folder with what lies below it.
fn copy(from: &Path, to: &Path, wanted: &dyn Fn(&str) -> bool) -> std::io::Result<()> {
    std::fs::create_dir_all(to)?;
    for entry in std::fs::read_dir(from)? {
        let entry = entry?;
        let name = entry.file_name();
        if entry.file_type()?.is_dir() {
            copy(&entry.path(), &to.join(&name), wanted)?;
        } else if wanted(&name.to_string_lossy()) {
            std::fs::copy(entry.path(), to.join(&name))?;
        }
    }
    Ok(())
}
