//! `cargo xtask test`: everything the project claims about itself, with a closing summary.

use crate::node_build::{self, IMAGES};
use crate::setup::{self, TARGET};
use crate::shell::{Outcome, cargo, root, stamp, timed};
use crate::{modbus, supply, wheel};
use std::fmt::Write;
use std::io::{BufRead, BufReader};
use std::process::Stdio;
use std::time::Instant;

/// Runs every step even after a failure, so that one run shows all there is to mend.
pub fn run() -> Outcome {
    setup::run()?;
    let mut report = Report::default();
    report.step("firmware images", || node_build::build().and_then(|()| node_build::size(&[])));
    report.step_or_skip("released image, byte by byte the same in another folder", supply::image_elsewhere);
    report.step("formatting", || run_cargo(&["fmt", "--all", "--check"]));
    report.step("lints of host crates", || {
        run_cargo(&["clippy", "--quiet", "--release", "--all-targets", "--", "--deny", "warnings"])
    });
    for (image, board) in IMAGES {
        report.step(&format!("lints of {image}"), || lint_image(image, board));
    }
    report.step("documentation", || {
        crate::shell::run(cargo(&["doc", "--quiet", "--release", "--no-deps"]).env("RUSTDOCFLAGS", "--deny warnings"))
    });
    report.step_or_skip("an independent Modbus master", modbus::environment);
    let mut tests = TestLog::default();
    report.step("tests", || tests.run(&[]));
    report.step_or_skip("advisories", supply::advisories);
    report.step_or_skip("Python package", || wheel::test(true));
    report.close(&tests)
}

const LONG_HEAD: &str = "\
# Long tests

Written by `cargo xtask test-long`: the tests that `cargo xtask test` leaves out because of their length \
(`#[ignore]` in the sources). Of each, a
shorter one of the same file stays in the test command: fewer cases, or one effect in place of several.

";

/// `cargo xtask test-long`: the tests that the test command leaves out, into `target/long-tests.md`.
pub fn run_long() -> Outcome {
    setup::run()?;
    node_build::build()?;
    let (mut tests, start) = (TestLog::default(), Instant::now());
    let outcome = timed("long tests", || tests.run(&["--ignored"]));
    let mut page = format!(
        "{LONG_HEAD}Of {}, {:.0} s (wall clock, builds included).\n\n| test | outcome |\n| --- | --- |\n",
        stamp()?,
        start.elapsed().as_secs_f64()
    );
    let rows = tests.passed_names.iter().map(|name| (name, "passed"));
    for (name, word) in rows.chain(tests.failed.iter().map(|name| (name, "FAILED"))) {
        let _ = writeln!(page, "| {name} | {word} |");
    }
    print!("{page}");
    let path = root().join("target/long-tests.md");
    std::fs::write(&path, page).map_err(|e| format!("{}: {e}", path.display()))?;
    outcome
}

fn run_cargo(args: &[&str]) -> Outcome {
    crate::shell::run(&mut cargo(args))
}

fn lint_image(image: &str, board: &str) -> Outcome {
    let feature = format!("board-{board}");
    run_cargo(&[
        "clippy",
        "--quiet",
        "--package",
        "meshband-node",
        "--target",
        TARGET,
        "--profile",
        "firmware",
        "--lib",
        "--bin",
        image,
        "--features",
        &feature,
        "--",
        "--deny",
        "warnings",
    ])
}

#[derive(Default)]
struct Report {
    passed: Vec<String>,
    failed: Vec<String>,
    /// With the reason.
    skipped: Vec<String>,
}

impl Report {
    fn step(&mut self, name: &str, step: impl FnOnce() -> Outcome) {
        match timed(name, step) {
            Ok(()) => self.passed.push(name.to_owned()),
            Err(reason) => self.failed.push(format!("{name}: {reason}")),
        }
    }

    /// A step that this machine may not be able to do: the reason is its outcome then, and stands in the summary.
    fn step_or_skip(&mut self, name: &str, step: impl FnOnce() -> Outcome<Option<String>>) {
        match timed(name, step) {
            Ok(None) => self.passed.push(name.to_owned()),
            Ok(Some(reason)) => self.skipped.push(format!("{name}: {reason}")),
            Err(reason) => self.failed.push(format!("{name}: {reason}")),
        }
    }

    fn close(self, tests: &TestLog) -> Outcome {
        println!("\n== summary");
        println!("steps passed: {}", self.passed.join(", "));
        for line in &self.skipped {
            println!("step skipped: {line}");
        }
        println!("tests: {} passed, {} failed, {} skipped", tests.passed, tests.failed.len(), tests.skipped.len());
        for line in &tests.skipped {
            println!("  {line}");
        }
        for line in &tests.failed {
            println!("  FAILED {line}");
        }
        if self.failed.is_empty() {
            println!("everything passed");
            return Ok(());
        }
        Err(format!("{} of the steps failed:\n  {}", self.failed.len(), self.failed.join("\n  ")))
    }
}

/// What the test programs printed. A test that lacks its measured data or QEMU prints a line that begins
/// with "skipped"; such a test counts as skipped here although it returned normally.
#[derive(Default)]
struct TestLog {
    passed: usize,
    passed_names: Vec<String>,
    failed: Vec<String>,
    skipped: Vec<String>,
}

impl TestLog {
    /// Runs the tests that `which` chooses (`--ignored`: the long ones).
    fn run(&mut self, which: &[&str]) -> Outcome {
        let mut child = cargo(&["test", "--release", "--no-fail-fast", "--", "--show-output"])
            .args(which)
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|e| format!("cargo test: {e}"))?;
        let mut output_of_passed = false;
        let mut skipped_here = 0;
        for line in BufReader::new(child.stdout.take().expect("piped")).lines() {
            let line = line.map_err(|e| format!("reading cargo test: {e}"))?;
            match line.as_str() {
                "successes:" => output_of_passed = true,
                "failures:" => output_of_passed = false,
                _ => {}
            }
            if line.len() >= 7 && line.as_bytes()[..7].eq_ignore_ascii_case(b"skipped") {
                self.skipped.push(line.clone());
                skipped_here += 1;
            }
            if let Some((name, outcome)) = line.strip_prefix("test ").and_then(|l| l.split_once(" ... ")) {
                match outcome {
                    "FAILED" => self.failed.push(name.to_owned()),
                    "ok" => self.passed_names.push(name.to_owned()),
                    _ => {}
                }
            }
            if line.starts_with("test result:") {
                output_of_passed = false;
                self.passed += count_before(&line, " passed").saturating_sub(skipped_here);
                skipped_here = 0;
            }
            if !output_of_passed {
                println!("{line}");
            }
        }
        let status = child.wait().map_err(|e| format!("cargo test: {e}"))?;
        if status.success() { Ok(()) } else { Err(format!("{} tests failed", self.failed.len())) }
    }
}

/// The number that stands before `word` in a result line.
fn count_before(line: &str, word: &str) -> usize {
    line.split(word).next().and_then(|l| l.rsplit(' ').next()).and_then(|n| n.parse().ok()).unwrap_or(0)
}
