//! What people read holds no programmer's text: no `Some(`, no `inf`, no names of variants, in any command's text, JSON or report.

use std::path::{Path, PathBuf};
use std::process::Command;

/// Texts that only a programmer would read on purpose.
const FORBIDDEN: [&str; 9] = ["Some(", "None,", " NaN", "inf B", " inf ", "-inf", "Ok(", "Err(", "panicked"];

fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("outputs-text");
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder");
    folder
}

/// Runs a command and gives everything that it says and writes.
fn said(folder: &Path, name: &str, words: &[&str], files: bool) -> String {
    let (json, report) = (folder.join(format!("{name}.json")), folder.join(format!("{name}.html")));
    let mut command = Command::new(env!("CARGO_BIN_EXE_meshband"));
    command.args(words).current_dir(folder);
    if files {
        command.arg("--json").arg(&json).arg("--report").arg(&report);
    }
    let output = command.output().expect("the command starts");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(output.status.success(), "{words:?}: {}", text(&output.stderr));
    let read = |path: &Path| std::fs::read_to_string(path).unwrap_or_default();
    [text(&output.stdout), text(&output.stderr), read(&json), read(&report)].join("\n")
}

#[test]
fn claim_no_command_shows_programmers_text() {
    let folder = folder();
    let machine = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/17-38.toml").display().to_string();
    let m = machine.as_str();
    let commands: [(&str, Vec<&str>, bool); 13] = [
        ("alias", vec!["alias", "--mesh", "680", "--rate", "2000"], false),
        ("effects", vec!["effects"], false),
        ("keys", vec!["machine", "keys"], false),
        ("machine-check", vec!["machine", "check", m], true),
        ("stiffness", vec!["stiffness", m], true),
        ("law-fit", vec!["law", "fit", m, "-o", "law.toml"], true),
        ("simulate", vec!["simulate", m, "--duration", "2", "--rate", "20000", "-o", "record"], true),
        ("predict", vec!["predict", "record", "-o", "predicted"], true),
        ("analyse", vec!["analyse", "record"], true),
        (
            "import",
            vec!["import", "record/run00.npy", "--rate", "20000", "--teeth", "17,38", "--mesh", "680", "-o", "own"],
            true,
        ),
        ("loop", vec!["loop", "own"], true),
        ("alone", vec!["analyse", "own", "--channel", "0"], true),
        (
            "machine-new",
            vec![
                "machine", "new", "-o", "new.toml", "--teeth", "21,64", "--module", "3", "--width", "25", "--power",
                "5", "--speed", "24", "--quick",
            ],
            false,
        ),
    ];
    for (name, words, files) in commands {
        let said = said(&folder, name, &words, files);
        for forbidden in FORBIDDEN {
            let line = said.lines().find(|line| line.contains(forbidden));
            assert!(line.is_none(), "{name}: {forbidden:?} in '{}'", line.unwrap_or_default());
        }
    }
}

#[test]
fn claim_a_dash_writes_json_to_standard_output_and_nothing_else() {
    let machine = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/17-38.toml");
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("outputs-dash");
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder");
    let output = Command::new(env!("CARGO_BIN_EXE_meshband"))
        .args(["machine", "check", "--json", "-"])
        .arg(machine)
        .current_dir(&folder)
        .output()
        .expect("the command starts");
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).expect("stdout is JSON");
    assert!(json["contact_ratio"].as_f64().is_some_and(|ratio| ratio > 1.0));
    assert!(String::from_utf8_lossy(&output.stderr).contains("contact ratio"), "text goes to standard error");
    assert_eq!(std::fs::read_dir(&folder).expect("a folder").count(), 0, "no file named -");
}
