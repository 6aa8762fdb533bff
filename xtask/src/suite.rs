//! `cargo xtask test`: everything the project claims about itself, with a closing summary.

use crate::node_build::{self, IMAGES};
use crate::setup::{self, TARGET};
use crate::shell::{Outcome, cargo, timed};
use crate::wheel;
use std::io::{BufRead, BufReader};
use std::process::Stdio;

/// Runs every step even after a failure, so that one run shows all there is to mend.
pub fn run() -> Outcome {
    setup::run()?;
    let mut report = Report::default();
    report.step("firmware images", || node_build::build().and_then(|()| node_build::size(&[])));
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
    let mut tests = TestLog::default();
    report.step("tests", || tests.run());
    report.step_or_skip("Python package", || wheel::test(true));
    report.close(&tests)
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
    failed: Vec<String>,
    skipped: Vec<String>,
}

impl TestLog {
    fn run(&mut self) -> Outcome {
        let mut child = cargo(&["test", "--release", "--no-fail-fast", "--", "--show-output"])
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
            if let Some(name) = line.strip_prefix("test ").and_then(|l| l.strip_suffix(" ... FAILED")) {
                self.failed.push(name.to_owned());
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
