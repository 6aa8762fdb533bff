//! `cargo xtask fuzz`: every target of `meshband_tests::fuzz` under libFuzzer for a time, into `target/fuzzing.md`.
//!
//! The program is `fuzz/`, built for coverage by flags that the stable compiler takes, so neither a nightly nor
//! cargo-fuzz is needed; libFuzzer itself is C++ and is compiled once. No address sanitizer: what is fuzzed has no
//! unsafe code of ours. The corpus stays in `target/fuzz/corpus` and grows from one run to the next.

use crate::shell::{Outcome, capture, cargo, command, root, run, say, stamp, timed};
use std::collections::{BTreeMap, VecDeque};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;

/// Seconds per target unless `MESHBAND_FUZZ_SECONDS` says otherwise.
const SECONDS: &str = "600";
/// Coverage as cargo-fuzz asks for it: counters of edges, and operands of comparisons.
const FLAGS: [&str; 7] = [
    "--cfg",
    "fuzzing",
    "-Cpasses=sancov-module",
    "-Cllvm-args=-sanitizer-coverage-level=4",
    "-Cllvm-args=-sanitizer-coverage-inline-8bit-counters",
    "-Cllvm-args=-sanitizer-coverage-pc-table",
    "-Cllvm-args=-sanitizer-coverage-trace-compares",
];
/// Seconds and MB after which one input counts as a hang or as memory without bound.
const LIMITS: [&str; 3] = ["-timeout=60", "-rss_limit_mb=2048", "-max_len=65536"];

const HEAD: &str = "\
# Fuzzing

Written by `cargo xtask fuzz`: libFuzzer on the targets of `tests/src/fuzz`, guided by coverage of the project and \
of all its
dependencies, from sound inputs (and a corpus, if former runs left one). A panic, an arithmetic overflow, a failed \
check of the target, more
than 60 s (wall clock) or 2 GB for one input count as found. A bounded number of inputs of each target runs with the \
tests, and
found cases are kept in `tests/vectors/fuzz`. Edges are branches of the program that were taken; the machine did \
other work beside, so
that inputs per second say little.

";

/// Names of targets may follow, the others keep their rows; `MESHBAND_FUZZ_JOBS` targets run at a time (1);
/// `MESHBAND_FUZZ_PROGRAM` is built already.
pub fn run_task(args: &[String]) -> Outcome {
    let variable = |name: &str, usual: &str| std::env::var(name).unwrap_or_else(|_| usual.into());
    let seconds = variable("MESHBAND_FUZZ_SECONDS", SECONDS);
    let jobs = variable("MESHBAND_FUZZ_JOBS", "1");
    let jobs: usize = jobs.parse().map_err(|_| format!("MESHBAND_FUZZ_JOBS: {jobs} is no number"))?;
    let program = match std::env::var_os("MESHBAND_FUZZ_PROGRAM") {
        Some(built) => built.into(),
        None => timed("the fuzzing program", build)?,
    };
    let list = capture(Command::new(&program).env("MESHBAND_FUZZ_TARGET", "list"))?;
    let known: Vec<(&str, &str)> = list.lines().filter_map(|line| line.split_once('\t')).collect();
    if let Some(name) = args.iter().find(|name| known.iter().all(|(known, _)| known != name)) {
        return Err(format!("no target is called {name}"));
    }
    let chosen = known.iter().enumerate().filter(|(_, (name, _))| args.is_empty() || args.iter().any(|a| a == name));
    // Of the program that runs, whatever is committed meanwhile.
    let when = stamp()?;
    let queue: Mutex<VecDeque<_>> = Mutex::new(chosen.collect());
    let done = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..jobs.max(1) {
            scope.spawn(|| {
                while let Some((place, (name, reads))) = { queue.lock().expect("no panic").pop_front() } {
                    say(format_args!("{name} for {seconds} s ..."));
                    let found = campaign(&program, name, &seconds);
                    done.lock().expect("no panic").push((place, *name, *reads, found));
                }
            });
        }
    });
    let mut done = done.into_inner().expect("no panic");
    done.sort_by_key(|(place, ..)| *place);
    let (mut failed, mut fresh) = (Vec::new(), BTreeMap::new());
    for (_, name, reads, found) in done {
        let found = found?;
        let [inputs, edges, kept, longest, memory] = found.figures;
        let case = found.case.as_ref().map_or("nothing", |_| "1 case");
        let row = format!(
            "| {name} | {reads} | {inputs} | {edges} | {kept} | {longest} | {memory} | {case} | {when}, {seconds} s, \
             {jobs} at a time |"
        );
        fresh.insert(name, row);
        failed.extend(found.case.map(|case| format!("{name}: {case}")));
    }
    let path = root().join("target/fuzzing.md");
    let before = std::fs::read_to_string(&path).unwrap_or_default();
    let mut page = format!(
        "{HEAD}| target | reads | inputs | edges | inputs kept | longest, s | memory, MB | found | run |\n\
         | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n"
    );
    for (name, _) in &known {
        let kept = || before.lines().find(|line| line.starts_with(&format!("| {name} |"))).map(str::to_owned);
        if let Some(row) = fresh.remove(name).or_else(kept) {
            let _ = writeln!(page, "{row}");
        }
    }
    // Remarks behind the table are people's.
    let remarks = before.rsplit_once("|\n").map_or("", |(_, remarks)| remarks);
    page.push_str(remarks);
    print!("{page}");
    std::fs::write(&path, page).map_err(|e| format!("{}: {e}", path.display()))?;
    if failed.is_empty() { Ok(()) } else { Err(failed.join("\n")) }
}

fn folder() -> PathBuf {
    root().join("target/fuzz")
}

/// For a named target, so that build scripts and procedural macros stay without coverage.
fn build() -> Outcome<PathBuf> {
    let said = capture(&mut command(&["rustc", "-vV"]))?;
    let host = said.lines().find_map(|line| line.strip_prefix("host: ")).ok_or("rustc does not name its host")?;
    let mut build = cargo(&["build", "--quiet", "--release", "--locked", "--target", host, "--target-dir"]);
    build.arg(folder()).current_dir(root().join("fuzz")).env("CARGO_ENCODED_RUSTFLAGS", FLAGS.join("\u{1f}"));
    run(build.env("CARGO_INCREMENTAL", "0"))?;
    Ok(folder().join(host).join("release/meshband-fuzz"))
}

struct Found {
    /// Inputs, edges, inputs kept, seconds of the longest, MB.
    figures: [String; 5],
    /// What was found and where it lies.
    case: Option<String>,
}

fn campaign(program: &Path, name: &str, seconds: &str) -> Outcome<Found> {
    let (corpus, seeds, found) =
        (folder().join("corpus").join(name), folder().join("seeds").join(name), folder().join("found"));
    for place in [&corpus, &seeds, &found] {
        std::fs::create_dir_all(place).map_err(|e| format!("{}: {e}", place.display()))?;
    }
    let mut fuzz = Command::new(program);
    fuzz.env("MESHBAND_FUZZ_TARGET", name).env("MESHBAND_FUZZ_SEEDS", &seeds);
    fuzz.args(LIMITS).arg(format!("-max_total_time={seconds}")).arg("-print_final_stats=1");
    fuzz.arg(format!("-artifact_prefix={}/{name}-", found.display())).args([&corpus, &seeds]);
    let kept = root().join("tests/vectors/fuzz").join(name);
    if kept.is_dir() {
        fuzz.arg(kept);
    }
    let output = fuzz.stdin(Stdio::null()).output().map_err(|e| format!("{name}: {e}"))?;
    let log = String::from_utf8_lossy(&output.stderr).into_owned();
    let file = folder().join(format!("{name}.log"));
    std::fs::write(&file, &log).map_err(|e| format!("{}: {e}", file.display()))?;
    let after = |line: &str, key: &str| Some(line.split_once(key)?.1.split_whitespace().next()?.to_owned());
    let last = |key: &str| log.lines().rev().find_map(|line| after(line, key)).unwrap_or_default();
    let kept = last("corp: ").split('/').next().unwrap_or_default().to_owned();
    let figures = [
        last("stat::number_of_executed_units:"),
        last("cov: "),
        kept,
        last("stat::slowest_unit_time_sec:"),
        last("stat::peak_rss_mb:"),
    ];
    let case = (!output.status.success()).then(|| {
        let said = |words: &str| log.lines().find(|line| line.contains(words)).unwrap_or_default().trim().to_owned();
        format!("{} {} (log: {})", said("panicked at"), said("Test unit written to"), file.display())
    });
    Ok(Found { figures, case })
}
