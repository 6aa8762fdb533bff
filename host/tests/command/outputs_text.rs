//! What people read holds no programmer's text: no `Some(`, no `inf`, no names of variants, in any command's
//! text, JSON or report; and the reports have one look and give a browser no reason to complain.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// Texts that only a programmer would read on purpose.
const FORBIDDEN_TEXTS: [&str; 10] =
    ["Some(", "None,", "/None", " NaN", "inf B", " inf ", "-inf", "Ok(", "Err(", "panicked"];

fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("outputs-text");
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder");
    folder
}

/// Runs a command and gives everything that it says and writes.
fn said(folder: &Path, name: &str, words: &[&str], files: bool) -> String {
    let [json, report, page] = ["json", "html", "md"].map(|end| folder.join(format!("{name}.{end}")));
    let mut command = Command::new(env!("CARGO_BIN_EXE_meshband"));
    command.args(words).current_dir(folder);
    if files {
        command.arg("--json").arg(&json).arg("--report").arg(&report);
    }
    let output = command.output().expect("the command starts");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(output.status.success(), "{words:?}: {}", text(&output.stderr));
    let read = |path: &Path| std::fs::read_to_string(path).unwrap_or_default();
    [text(&output.stdout), text(&output.stderr), read(&json), read(&report), read(&page)].join("\n")
}

/// What one command said, and where its report is, if it made one.
struct Output {
    name: &'static str,
    said: String,
    report: PathBuf,
}

/// The commands on one simulated and one imported record; they run once for all tests.
fn outputs() -> &'static [Output] {
    static OUTPUTS: OnceLock<Vec<Output>> = OnceLock::new();
    OUTPUTS.get_or_init(|| {
        let folder = folder();
        let machine = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/17-38.toml").display().to_string();
        std::fs::create_dir(folder.join("cases")).expect("a folder");
        std::fs::write(folder.join("cases/own.toml"), CASE).expect("a case");
        let mut all = commands(&machine);
        if board_is_there() {
            all.push(("node", vec!["node", &machine, "--duration", "3"], true));
        }
        let run = |(name, words, files): &(&'static str, Vec<&str>, bool)| {
            let report = folder.join(format!("{name}.html"));
            Output { name, said: said(&folder, name, words, *files), report }
        };
        all.iter().map(run).collect()
    })
}

/// A case of `measured` on the simulated record.
const CASE: &str = r#"
title = "a run of the record before"
source = "simulated"
caution = "none"
files = ["run00"]
path = "record/{}.npy"
rate_hz = 20000
unit = "m/s2"
teeth = [17, 38]
mesh_hz = 680
"#;

/// Whether the firmware is built and QEMU is there.
fn board_is_there() -> bool {
    let there = meshband_host::virtual_node::qemu::built_firmware("an386").is_file()
        && Command::new("qemu-system-arm").arg("--version").output().is_ok_and(|output| output.status.success());
    if !there {
        println!("skipped: no firmware image or no qemu-system-arm, what `node` says is not read");
    }
    there
}

/// Name, words, and whether the command takes --json and --report.
fn commands(m: &str) -> Vec<(&'static str, Vec<&str>, bool)> {
    vec![
        ("alias", vec!["alias", "--mesh", "680", "--rate", "2000"], false),
        ("effects", vec!["effects"], false),
        ("keys", vec!["machine", "keys"], false),
        ("machine-check", vec!["machine", "check", m], true),
        ("stiffness", vec!["stiffness", m], true),
        ("law-fit", vec!["law", "fit", m, "-o", "law.toml"], true),
        ("simulate", vec!["simulate", m, "--duration", "2", "--rate", "20000", "-o", "record"], true),
        ("predict", vec!["predict", "record", "-o", "predicted"], true),
        ("check", vec!["check", "record"], true),
        ("analyse", vec!["analyse", "record"], true),
        (
            "import",
            vec!["import", "record/run00.npy", "--rate", "20000", "--teeth", "17,38", "--mesh", "680", "-o", "own"],
            true,
        ),
        ("loop", vec!["loop", "own"], true),
        (
            "speeds",
            vec![
                "simulate",
                m,
                "--speed",
                "14,17,20",
                "--duration",
                "2",
                "--rate",
                "20000",
                "--pulses",
                "8",
                "--effect",
                "eccentricity:amplitude=20e-6",
                "-o",
                "three",
            ],
            true,
        ),
        ("loop-dynamic", vec!["loop", "three"], true),
        ("alone", vec!["analyse", "own", "--channel", "0"], true),
        (
            "machine-new",
            vec![
                "machine", "new", "-o", "new.toml", "--teeth", "21,64", "--module", "3", "--width", "25", "--power",
                "5", "--speed", "24", "--quick",
            ],
            false,
        ),
    ]
}

#[test]
fn claim_no_command_shows_programmers_text() {
    for Output { name, said, .. } in outputs() {
        for forbidden in FORBIDDEN_TEXTS {
            let line = said.lines().find(|line| line.contains(forbidden));
            assert!(line.is_none(), "{name}: {forbidden:?} in '{}'", line.unwrap_or_default());
        }
    }
}

/// What a page writes to a browser's console; none where there is no browser.
fn console(page: &Path) -> Option<Vec<String>> {
    let names = ["chromium-headless-shell", "chromium", "chromium-browser", "google-chrome"];
    let options = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--dump-dom"];
    let url = format!("file://{}", page.display());
    let output = names.iter().find_map(|name| Command::new(name).args(options).arg(&url).output().ok())?;
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && !output.stdout.is_empty(), "{}: {text}", page.display());
    Some(text.lines().filter(|line| line.contains(":CONSOLE")).map(Into::into).collect())
}

#[test]
fn claim_no_report_makes_a_browser_complain() {
    let wrong = Path::new(env!("CARGO_TARGET_TMPDIR")).join("outputs-wrong.html");
    std::fs::write(&wrong, "<!doctype html><title>x</title><script>nothing.at()</script>").expect("written");
    let Some(complaints) = console(&wrong) else {
        println!("skipped: no headless chromium, the console of reports is not read");
        return;
    };
    assert_eq!(complaints.len(), 1, "an error is seen: {complaints:?}");
    let reports: Vec<&Output> = outputs().iter().filter(|output| output.report.is_file()).collect();
    assert!(reports.len() >= 9, "{} reports", reports.len());
    for Output { name, report, .. } in reports {
        assert_eq!(console(report), Some(Vec::new()), "{name}");
        let page = std::fs::read_to_string(report).expect("a report");
        for part in ["<p class=\"mark\">meshband</p>", "prefers-color-scheme:dark", "@media print", "<footer>"] {
            assert!(page.contains(part), "{name} has the look of all: {part}");
        }
        let outside = ["src=\"http", "href=\"http", "url(http", "@import"].iter().find(|part| page.contains(**part));
        assert_eq!(outside, None, "{name} needs nothing from outside");
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
