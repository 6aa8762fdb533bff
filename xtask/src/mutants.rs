//! `cargo xtask mutants`: cargo-mutants on a stated sample, into `target/mutation.md`.
//!
//! A mutant of `shared` would have everything rebuilt that stands on it, the host above all. So it runs in a tree of
//! its own under `target/mutants`: `shared`, and the node's tests that need nothing else, which takes seconds per
//! mutant instead of minutes; what only host, QEMU or emulator tests would notice counts as a survivor there. The
//! inference is mutated in the workspace as it is; what only whole records would notice counts as a survivor. The
//! sample is every n-th mutant in the order of the list (`--shard K/N --sharding round-robin`), the same every time.
//! Once its survivors are killed by new tests it says too much of the rest: another one, of another first mutant,
//! says what they are worth.

use crate::shell::{Outcome, capture, cargo, command, on_path, root, run, stamp, timed};
use std::fmt::Write;
use std::path::{Path, PathBuf};

const HEAD: &str = "\
# Mutation

Written by `cargo xtask mutants` (cargo-mutants): each mutant is one change of the sources (an operator, a returned \
value, a removed
statement); tests that fail kill it. A sample, with the Wilson interval of 95 %. Mutants that do not compile are \
left out; one that
runs into the time limit counts as killed. Survivors are listed with what is known of them.

";

/// Tests of the node that need host, drivers or emulator.
const FOREIGN_CRATES: [&str; 5] =
    ["meshband_host", "meshband_emulator", "meshband_stm32", "meshband_drivers", "meshband_tests::script"];
/// Of the tests' helpers, those that need `shared` alone.
const HELPERS: [&str; 3] = ["gear_signal", "mock_flash", "plant"];

const MANIFEST: &str = r#"[package]
name = "meshband-tests"
version = "0.1.0"
edition = "2024"

[dependencies]
meshband = { path = "../shared" }
meshband-kit = { path = "kit" }
embedded-storage = "0.3"
postcard = { version = "1.1", default-features = false }
rand = { version = "0.10", default-features = false, features = ["std", "std_rng"] }
rand_chacha = "0.10"

[dev-dependencies]
rustfft = "6.4"
rand_distr = "0.6"
heapless = "0.9.3"
cobs = { version = "0.5", default-features = false }
serde_json = "1"
serde = { version = "1", features = ["derive"] }
proptest = { version = "1", default-features = false, features = ["std"] }
"#;

/// The first failed test is enough: the others, and the shrinking of a found case, would only take time.
const FIRST_PANIC: &str = r#"
#[used]
#[unsafe(link_section = ".init_array")]
static AT_START: extern "C" fn() = end_at_first_panic;

extern "C" fn end_at_first_panic() {
    std::panic::set_hook(Box::new(|info| {
        eprintln!("{info}");
        std::process::exit(101);
    }));
}
"#;

/// Files of the inference, of `host/signal_based/src`.
const INFERENCE: [&str; 5] = ["accept", "choice", "errors", "evidence", "naming"];
/// Tests that know what these must say: seconds for each mutant.
const INFERENCE_TESTS: [&str; 3] = ["gate::", "names::", "stages::"];

/// `shared` or `inference`, N and K: every N-th mutant is tried (40), beginning with K (0).
pub fn run_task(args: &[String]) -> Outcome {
    let number = |text: &String| text.parse::<u32>().map_err(|_| format!("{text} is no number"));
    let (what, every, first) = match args {
        [what] => (what.as_str(), 40, 0),
        [what, every] => (what.as_str(), number(every)?, 0),
        [what, every, first] => (what.as_str(), number(every)?, number(first)?),
        [] => return Err("mutants takes `shared` or `inference`, then N of every N-th, then the first".into()),
        _ => return Err("mutants takes at most three arguments".into()),
    };
    if first >= every {
        return Err(format!("the first mutant of every {every}th is 0 to {}, not {first}", every.saturating_sub(1)));
    }
    if on_path("cargo-mutants").is_none() {
        return Err("cargo-mutants is not installed (`cargo install --locked cargo-mutants`)".into());
    }
    let folder = root().join("target/mutants").join(what);
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut mutants = cargo(&["mutants", "--no-times", "--colors", "never", "--sharding", "round-robin", "--shard"]);
    mutants.arg(format!("{first}/{every}")).arg("--output").arg(&folder);
    match what {
        "shared" => {
            let tree = folder.join("tree");
            timed("a tree of its own", || reduced(&tree))?;
            mutants.arg("--dir").arg(&tree).args(["--package", "meshband", "--test-package", "meshband-tests"]);
            // Far beyond what the tests take, so that a busy machine kills nothing.
            mutants.args(["--profile", "mutants", "--timeout", "1200"]);
        }
        "inference" => {
            mutants.args(["--package", "meshband-signal-based", "--profile", "mutants", "--in-place"]);
            for file in INFERENCE {
                mutants.arg("--file").arg(format!("host/signal_based/src/{file}.rs"));
            }
            mutants.args(["--", "--test", "signal_based", "--"]).args(INFERENCE_TESTS);
        }
        other => return Err(format!("mutants takes `shared` or `inference`, not {other}")),
    }
    // Exit codes say whether mutants survived; the lists say it, too.
    let _ = timed("mutants", || run(&mut mutants));
    let section = section(what, [every, first], &folder.join("mutants.out"))?;
    let path = root().join("target/mutation.md");
    let before = std::fs::read_to_string(&path).unwrap_or_default();
    // The other part's section stays.
    let mut page = String::from(HEAD);
    for part in ["shared", "inference"] {
        if part == what {
            page.push_str(&section);
        } else if let Some(kept) = before.split("\n## ").find(|text| text.starts_with(&format!("`{part}`"))) {
            let _ = writeln!(page, "## {}\n", kept.trim());
        }
    }
    print!("{page}");
    std::fs::write(&path, page).map_err(|e| format!("{}: {e}", path.display()))
}

fn section(what: &str, [every, first]: [u32; 2], folder: &Path) -> Outcome<String> {
    let list = |name: &str| -> Outcome<Vec<String>> {
        let path = folder.join(name);
        let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        Ok(text.lines().map(str::to_owned).collect())
    };
    let (caught, missed) = (list("caught.txt")?, list("missed.txt")?);
    let (timeout, unviable) = (list("timeout.txt")?, list("unviable.txt")?);
    let (killed, viable) = (caught.len() + timeout.len(), caught.len() + timeout.len() + missed.len());
    if viable == 0 {
        return Err("no mutant was tried".into());
    }
    let [low, high] = wilson(killed as f64, viable as f64).map(|share| 100.0 * share);
    let mut text = format!(
        "## `{what}`\n\n`cargo xtask mutants {what} {every} {first}`, {}: every {every}th mutant; {viable} viable \
         ({} more do not compile), \
         {killed} killed ({} of them by the time limit): {:.1} %, {low:.1} to {high:.1} %.\n\n| survivor | why |\n| \
         --- | --- |\n",
        stamp()?,
        unviable.len(),
        timeout.len(),
        100.0 * killed as f64 / viable as f64,
    );
    let known = std::fs::read_to_string(root().join("tests/snapshots/survivors.txt")).unwrap_or_default();
    for survivor in missed {
        let name = without_place(&survivor);
        let why = known.lines().filter_map(|line| line.split_once('\t')).find(|(known, _)| *known == name);
        let _ = writeln!(text, "| `{}` | {} |", name.replace('|', "\\|"), why.map_or("not looked at", |(_, why)| why));
    }
    Ok(text + "\n")
}

/// `file:line:column: change` without line and column, which move with every edit.
fn without_place(mutant: &str) -> String {
    let mut parts = mutant.splitn(4, ':');
    match (parts.next(), parts.next(), parts.next(), parts.next()) {
        (Some(file), Some(_), Some(_), Some(change)) => format!("{file}:{change}"),
        _ => mutant.to_owned(),
    }
}

/// Wilson's interval of a share, 95 %.
fn wilson(hits: f64, of: f64) -> [f64; 2] {
    const Z: f64 = 1.959_964;
    let (share, z2) = (hits / of, Z * Z);
    let middle = (share + z2 / (2.0 * of)) / (1.0 + z2 / of);
    let half = Z / (1.0 + z2 / of) * (share * (1.0 - share) / of + z2 / (4.0 * of * of)).sqrt();
    [middle - half, middle + half]
}

/// `shared` and the tests that need nothing else, as a workspace.
fn reduced(tree: &Path) -> Outcome {
    let _ = std::fs::remove_dir_all(tree);
    let fail = |path: &Path| {
        let path = path.display().to_string();
        move |e: std::io::Error| format!("{path}: {e}")
    };
    let write = |path: PathBuf, text: &str| std::fs::write(&path, text).map_err(fail(&path));
    let read = |path: PathBuf| std::fs::read_to_string(&path).map_err(fail(&path));
    for part in ["shared", "tests/kit", "tests/vectors", "tests/snapshots"] {
        let to = tree.join(part);
        let parent = to.parent().expect("below the tree");
        std::fs::create_dir_all(parent).map_err(fail(parent))?;
        capture(command(&["cp", "-r"]).arg(root().join(part)).arg(&to))?;
    }
    let manifest = read(root().join("Cargo.toml"))?;
    let lines = manifest.lines().filter(|line| !line.starts_with("exclude") && !line.starts_with("default-members"));
    let lines =
        lines.map(
            |line| if line.starts_with("members") { "members = [\"shared\", \"tests\", \"tests/kit\"]" } else { line },
        );
    write(tree.join("Cargo.toml"), &(lines.collect::<Vec<_>>().join("\n") + "\n"))?;
    write(tree.join("Cargo.lock"), &read(root().join("Cargo.lock"))?)?;
    write(tree.join("tests/Cargo.toml"), MANIFEST)?;
    for place in ["tests/src", "tests/tests/node"] {
        std::fs::create_dir_all(tree.join(place)).map_err(fail(&tree.join(place)))?;
    }
    let mut library = String::new();
    for helper in HELPERS {
        let file = format!("tests/src/{helper}.rs");
        write(tree.join(&file), &read(root().join(&file))?)?;
        let _ = writeln!(library, "pub mod {helper};");
    }
    write(tree.join("tests/src/lib.rs"), &library)?;
    let main = read(root().join("tests/tests/node/main.rs"))?;
    let mut kept = String::new();
    for name in main.lines().filter_map(|line| line.strip_prefix("mod ")?.strip_suffix(';')) {
        let file = format!("tests/tests/node/{name}.rs");
        let text = read(root().join(&file))?;
        if FOREIGN_CRATES.iter().all(|foreign| !text.contains(foreign)) {
            write(tree.join(&file), &text)?;
            let _ = writeln!(kept, "mod {name};");
        }
    }
    write(tree.join("tests/tests/node/main.rs"), &(kept + FIRST_PANIC))
}

#[cfg(test)]
mod tests {
    use super::{wilson, without_place};

    #[test]
    fn ref_wilsons_interval_is_that_of_the_literature() {
        // Newcombe 1998, table I: 81 of 263.
        let [low, high] = wilson(81.0, 263.0);
        assert!((low - 0.2553).abs() < 1e-4 && (high - 0.3662).abs() < 1e-4, "{low} {high}");
        assert_eq!(without_place("shared/src/a.rs:3:14: replace + with -"), "shared/src/a.rs: replace + with -");
    }
}
