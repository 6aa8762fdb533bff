//! `cargo xtask fuzz`: every target of `tests/tests/fuzz` for a time, one after the other, into `docs/fuzzing.md`.

use crate::shell::{Outcome, capture, cargo, command, root, run, say, timed};
use std::fmt::Write;

/// Seconds per target unless `MESHBAND_FUZZ_SECONDS` says otherwise.
const SECONDS: &str = "600";

const HEAD: &str = "\
# Fuzzing

Written by `cargo xtask fuzz`. What is tried and how inputs grow is in the head of `tests/tests/fuzz/main.rs`; a bounded number of
inputs runs with the tests. An answer is the words of a refusal without its numbers, or what was understood. The last column is the
longest time that one input took, on a machine that did other work beside.

";

/// Names of tests, or parts of them, choose targets; without any all run.
pub fn run_task(args: &[String]) -> Outcome {
    let seconds = std::env::var("MESHBAND_FUZZ_SECONDS").unwrap_or_else(|_| SECONDS.into());
    timed("fuzz targets", || run(&mut cargo(&["test", "--quiet", "--release", "--test", "fuzz", "--no-run"])))?;
    let list = capture(&mut cargo(&["test", "--quiet", "--release", "--test", "fuzz", "--", "--list"]))?;
    let chosen = |name: &&str| args.is_empty() || args.iter().any(|part| name.contains(part.as_str()));
    let targets: Vec<&str> = list.lines().filter_map(|line| line.strip_suffix(": test")).filter(chosen).collect();
    if targets.is_empty() {
        return Err(format!("no target is called {}", args.join(", ")));
    }
    let date = capture(&mut command(&["date", "-u", "+%Y-%m-%d"]))?;
    let mut page = format!(
        "{HEAD}{}, {seconds} s per target asked for.\n\n\
         | target | inputs | s | kinds of answer | inputs kept | longest, s | panics |\n| --- | --- | --- | --- | --- | --- | --- |\n",
        date.trim()
    );
    let mut failed = Vec::new();
    for target in targets {
        say(format_args!("{target} ..."));
        let mut test =
            cargo(&["test", "--quiet", "--release", "--test", "fuzz", "--", "--exact", target, "--nocapture"]);
        let output = test.env("MESHBAND_FUZZ_SECONDS", &seconds).output().map_err(|e| e.to_string())?;
        let text = String::from_utf8_lossy(&output.stdout);
        if let Some(line) = text.lines().find_map(|line| line.split_once("fuzz ").map(|(_, rest)| rest)) {
            let _ = writeln!(page, "{}", row(line, output.status.success()));
        } else {
            let _ = writeln!(page, "| {target} | | | | | | 1 |");
        }
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr);
            let case = said.lines().find(|line| line.contains("panics under")).unwrap_or("no case was written");
            failed.push(format!("{target}: {case}"));
        }
    }
    print!("{page}");
    let path = root().join("docs/fuzzing.md");
    std::fs::write(&path, page).map_err(|e| format!("{}: {e}", path.display()))?;
    if failed.is_empty() { Ok(()) } else { Err(failed.join("\n")) }
}

/// `NAME: N inputs in S s from seed 1, K kinds of answer, C inputs in the corpus, ..., longest L s` as a row.
fn row(line: &str, passed: bool) -> String {
    let (name, rest) = line.split_once(':').unwrap_or((line, ""));
    let before = |what: &str| {
        let text = rest.split(what).next().unwrap_or_default().trim_end();
        text.rsplit([' ', ',']).next().unwrap_or_default().to_owned()
    };
    let longest = rest.rsplit("longest ").next().unwrap_or_default().trim_end_matches(" s").to_owned();
    let panics = u8::from(!passed);
    let kept = before(" inputs in the corpus");
    let (inputs, seconds, answers) = (before(" inputs in"), before(" s from"), before(" kinds"));
    format!("| {name} | {inputs} | {seconds} | {answers} | {kept} | {longest} | {panics} |")
}
