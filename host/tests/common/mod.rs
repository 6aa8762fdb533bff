//! Runs the built command on hostile input: with a bound on its memory, and killed where it hangs.

// Every test file uses its own part of this.
#![allow(dead_code)]

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// A command that takes longer hangs: far beyond what any case here needs, so that a loaded machine does not matter.
const HANG: Duration = Duration::from_secs(90);
/// Address space of the command, KiB: what blows up ends here and not in the machine's memory.
const MEMORY_KIB: u32 = 4 << 20;

/// Runs `meshband` and waits for its end.
///
/// # Panics
/// Where it hangs.
pub fn meshband(arguments: &[&str]) -> Output {
    meshband_within(MEMORY_KIB, arguments)
}

/// [`meshband`] with an address space of `memory_kib`.
pub fn meshband_within(memory_kib: u32, arguments: &[&str]) -> Output {
    let mut command = if cfg!(unix) {
        let mut shell = Command::new("sh");
        shell.args(["-c", &format!("ulimit -v {memory_kib}; exec \"$0\" \"$@\""), env!("CARGO_BIN_EXE_meshband")]);
        shell
    } else {
        Command::new(env!("CARGO_BIN_EXE_meshband"))
    };
    let command = command.args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("the command starts");
    let (mut out, mut err) = (child.stdout.take().expect("piped"), child.stderr.take().expect("piped"));
    let out = std::thread::spawn(move || read(&mut out));
    let err = std::thread::spawn(move || read(&mut err));
    let started = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().expect("a child to wait for") {
            break status;
        }
        if started.elapsed() > HANG {
            child.kill().expect("a child to end");
            child.wait().expect("ended");
            panic!("hangs: {}", shown(arguments));
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    Output { status, stdout: out.join().expect("read"), stderr: err.join().expect("read") }
}

fn read(source: &mut impl std::io::Read) -> Vec<u8> {
    let mut bytes = Vec::new();
    source.read_to_end(&mut bytes).expect("readable");
    bytes
}

fn shown(arguments: &[&str]) -> String {
    arguments.join(" ").chars().take(300).collect()
}

/// Expects exit code 2 and exactly one line, of bearable length, on standard error that holds all of `expected`.
pub fn refused(arguments: &[&str], expected: &[&str]) {
    let output = meshband(arguments);
    let stderr = String::from_utf8_lossy(&output.stderr);
    let shown = shown(arguments);
    let head: String = stderr.chars().take(600).collect();
    assert_eq!(output.status.code(), Some(2), "{shown}: {head}");
    assert_eq!(stderr.lines().count(), 1, "one line for {shown}: {head}");
    assert!(stderr.chars().count() < 1500, "a bearable line for {shown}: {head}");
    assert!(stderr.starts_with("meshband: "), "{shown}: {head}");
    for part in expected {
        assert!(stderr.contains(part), "'{part}' expected for {shown}: {head}");
    }
    assert!(output.stdout.is_empty(), "nothing on standard output for {shown}");
}

/// Expects success; gives standard output.
pub fn accepted(arguments: &[&str]) -> String {
    let output = meshband(arguments);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{}: {stderr}", shown(arguments));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// An empty folder of that name for one test.
pub fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder for the test");
    folder
}

/// A path as an argument.
pub fn text(path: &Path) -> String {
    path.display().to_string()
}

/// A file of the repository's machines.
pub fn machine(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines").join(name)
}

/// A copy of a file with one text replaced.
///
/// # Panics
/// Where the text to be replaced is not there.
pub fn altered(source: &Path, target: &Path, from: &str, to: &str) {
    let content = std::fs::read_to_string(source).expect("readable");
    assert!(content.contains(from), "{} holds no {from}", source.display());
    std::fs::write(target, content.replacen(from, to, 1)).expect("written");
}

/// A page without the explanations of its terms.
pub fn without_tooltips(page: &str) -> String {
    let mut parts = page.split("<abbr");
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |text, part| text + part.split_once('>').map_or("", |(_, rest)| rest)).replace("</abbr>", "")
}
