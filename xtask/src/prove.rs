//! `cargo xtask prove`, `prove-field` and `blind`: the loop's proof campaigns and its answers on the blind records.

use crate::shell::{Outcome, programs, root, run, say, timed};
use std::path::PathBuf;

/// The campaign of the proof; further arguments go to `meshband prove` in place of the counts.
pub fn campaign(args: &[String]) -> Outcome {
    let [program] = programs(["meshband-validate"])?;
    let docs = root().join("target/proof");
    std::fs::create_dir_all(&docs).map_err(|e| format!("{}: {e}", docs.display()))?;
    let counts = "--null 200 --power 252 --levels 2,20,2,2,2,2,2,2,2 --leave-one-out 27 --two 13 --seconds 1 --seed 1";
    let mut command = std::process::Command::new(program);
    command.current_dir(root()).arg("prove");
    for machine in ["check-19-48", "check-55-75"] {
        command.arg("--machine").arg(format!("tests/vectors/{machine}"));
    }
    if args.is_empty() {
        command.args(counts.split(' '));
    } else {
        command.args(args);
    }
    command.arg("--log").arg(docs.join("records.jsonl"));
    command.arg("--json").arg(docs.join("summary.json")).arg("--markdown").arg(docs.join("tables.md"));
    command.arg("--report").arg(docs.join("report.html")).arg("--force");
    run(&mut command)
}

/// The campaign of signal-based inference; further arguments go to `meshband prove --field` in place of the counts.
pub fn field(args: &[String]) -> Outcome {
    let [program] = programs(["meshband-validate"])?;
    let docs = root().join("target/proof/field");
    std::fs::create_dir_all(&docs).map_err(|e| format!("{}: {e}", docs.display()))?;
    let counts = "--null 100 --power 138 --levels 4,2,4,8,4,20 --seed 20261122";
    let mut command = std::process::Command::new(program);
    command.current_dir(root()).args(["prove", "--field"]);
    if args.is_empty() {
        command.args(counts.split(' '));
    } else {
        command.args(args);
    }
    command.arg("--log").arg(docs.join("records.jsonl"));
    command.arg("--json").arg(docs.join("summary.json")).arg("--markdown").arg(docs.join("tables.md")).arg("--force");
    run(&mut command)
}

/// The loop on every blind record that has no answer yet; an answer that exists is never overwritten.
pub fn blind() -> Outcome {
    let records = root().join("../shared/blind");
    let entries = std::fs::read_dir(&records).map_err(|e| format!("{}: {e}", records.display()))?;
    let mut cases: Vec<PathBuf> = entries
        .filter_map(|entry| entry.ok().map(|e| e.path()))
        .filter(|path| path.join("record.toml").is_file())
        .collect();
    cases.sort();
    let [program] = programs(["meshband"])?;
    let docs = root().join("docs/evidence/blind");
    for case in cases {
        let name = case.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let json = docs.join(format!("{name}.json"));
        if json.exists() {
            say(format!("{name}: answered already, kept"));
            continue;
        }
        let mut command = std::process::Command::new(&program);
        let report = root().join(format!("target/{name}.html"));
        command.arg("loop").arg(&case).arg("--json").arg(&json).arg("--report").arg(report);
        timed(&name, || run(&mut command))?;
    }
    Ok(())
}
