//! What the built command writes: nothing over an input, nothing replaced unasked, the old state or the new one
//! whatever ends it.
//!
//! `MESHBAND_UNDER_TEST` names another build of the command: that is how each of these was seen to fail.

mod ends;
mod kept;

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::LazyLock;
use std::time::{Duration, Instant};

fn program() -> OsString {
    std::env::var_os("MESHBAND_UNDER_TEST").unwrap_or_else(|| env!("CARGO_BIN_EXE_meshband").into())
}

fn command(words: &[&str]) -> Command {
    let mut command = Command::new(program());
    command.args(words).stdin(Stdio::null());
    command
}

fn meshband(words: &[&str]) -> Output {
    command(words).output().expect("the command starts")
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn accepted(words: &[&str]) -> Output {
    let output = meshband(words);
    assert!(output.status.success(), "{words:?}: {}", stderr(&output));
    output
}

fn is_refusal(output: &Output, expected: &str) {
    let said = stderr(output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert_eq!(said.lines().count(), 1, "one line: {said}");
    assert!(said.starts_with("meshband: ") && said.contains(expected), "`{expected}` in {said}");
}

fn refused(words: &[&str], expected: &str) {
    is_refusal(&meshband(words), expected);
}

/// An empty folder of this test's own.
fn fresh(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("outputs-{name}"));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder for the test");
    folder
}

fn text(path: &Path) -> String {
    path.display().to_string()
}

fn machine(name: &str) -> String {
    text(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines").join(name))
}

/// Arguments of a quick simulation of two runs.
fn simulation<'a>(machine: &'a str, output: &'a str, seed: &'a str) -> Vec<&'a str> {
    let fixed = ["--speed", "20", "--torque", "10,15", "--duration", "0.12", "--noise", "0.1", "--seed"];
    [&["simulate", machine][..], &fixed, &[seed, "-o", output]].concat()
}

/// A simulation that takes long enough to be disturbed.
fn long_simulation<'a>(machine: &'a str, output: &'a str) -> Vec<&'a str> {
    vec!["simulate", machine, "--speed", "20", "--torque", "10", "--duration", "60", "-o", output]
}

/// A record made once and copied.
fn record_at(target: &Path) {
    static RECORD_FILES: LazyLock<BTreeMap<PathBuf, Vec<u8>>> = LazyLock::new(|| {
        let place = fresh("pattern").join("record");
        accepted(&simulation(&machine("check-19-48.toml"), &text(&place), "1"));
        content(&place)
    });
    std::fs::create_dir_all(target).expect("a folder");
    RECORD_FILES.iter().for_each(|(name, bytes)| std::fs::write(target.join(name), bytes).expect("written"));
}

/// Names and bytes of a folder's files.
fn content(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let entries = std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    entries.map(|path| (path.file_name().unwrap().into(), std::fs::read(&path).expect("a file"))).collect()
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").file_name());
    let mut names: Vec<String> = entries.map(|name| name.to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

fn edit(path: &Path, from: &str, to: &str) {
    let old = std::fs::read_to_string(path).expect("text");
    assert!(old.contains(from), "{from} in {old}");
    std::fs::write(path, old.replace(from, to)).expect("written");
}

fn signal(child: &Child, name: &str) {
    // Gone already: then the signal came too late, which is one of the cases.
    let _ = Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).stderr(Stdio::null()).status();
}

/// Waits until `ready`, at most a minute.
fn wait_for(what: &str, ready: impl Fn() -> bool) {
    let start = Instant::now();
    while !ready() {
        assert!(start.elapsed() < Duration::from_secs(60), "{what} does not come");
        std::thread::sleep(Duration::from_millis(5));
    }
}
