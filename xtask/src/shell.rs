//! Running other programs: progress lines, retries of network steps, captured output in error messages.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A task's outcome; the error is the one message the user sees.
pub type Outcome<T = ()> = Result<T, String>;

/// One progress line on stderr.
pub fn say(line: impl std::fmt::Display) {
    eprintln!("[xtask] {line}");
}

/// The workspace's root folder.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("xtask lies in the workspace").to_owned()
}

/// Cargo as it called us, in the workspace's root.
pub fn cargo(args: &[&str]) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.current_dir(root()).args(args);
    command
}

/// A command from words.
pub fn command(words: &[&str]) -> Command {
    let mut command = Command::new(words[0]);
    command.args(&words[1..]);
    command
}

/// Runs a command with its output shown; an error names the command.
pub fn run(command: &mut Command) -> Outcome {
    let status = command.status().map_err(|e| format!("{}: {e}", describe(command)))?;
    if status.success() { Ok(()) } else { Err(format!("`{}` failed ({status})", describe(command))) }
}

/// Between two lines that say that a step is still under way.
const PULSE: Duration = Duration::from_secs(15);

/// Runs a command with its output shown and says every 15 s that it still runs: builds name crates, but one crate may
/// take minutes.
pub fn watched(what: &str, command: &mut Command) -> Outcome {
    let mut child = command.spawn().map_err(|e| format!("{}: {e}", describe(command)))?;
    let start = Instant::now();
    let mut told = start;
    loop {
        if let Some(status) = child.try_wait().map_err(|e| format!("{}: {e}", describe(command)))? {
            return if status.success() { Ok(()) } else { Err(format!("`{}` failed ({status})", describe(command))) };
        }
        if told.elapsed() >= PULSE {
            told = Instant::now();
            say(format!("{what}: {:.0} s so far", start.elapsed().as_secs_f64()));
        }
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// Runs a command quietly; gives its standard output, or the last lines of its complaints.
pub fn capture(command: &mut Command) -> Outcome<String> {
    let output = command.stdin(Stdio::null()).output().map_err(|e| format!("{}: {e}", describe(command)))?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    let text = String::from_utf8_lossy(&output.stderr);
    let last: Vec<&str> = text.lines().filter(|l| !l.trim().is_empty()).rev().take(4).collect();
    let reason = last.into_iter().rev().collect::<Vec<_>>().join("\n    ");
    Err(format!("`{}` failed ({}):\n    {reason}", describe(command), output.status))
}

/// What a generated page is of: the commit of the sources and the day.
pub fn stamp() -> Outcome<String> {
    let commit = capture(command(&["git", "rev-parse", "--short", "HEAD"]).current_dir(root()))?;
    let date = capture(&mut command(&["date", "-u", "+%Y-%m-%d"]))?;
    Ok(format!("commit {}, {}", commit.trim(), date.trim()))
}

/// Builds programs of the workspace and gives their places. A test is built along: the packages then get the features
/// that they have in the tests, so that nothing is built a second time.
pub fn programs<const N: usize>(names: [&str; N]) -> Outcome<[PathBuf; N]> {
    timed(&names.join(", "), || {
        let mut build = cargo(&["build", "--quiet", "--release", "--test", "supply_chain"]);
        run(build.args(names.iter().flat_map(|name| ["--bin", name])))
    })?;
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), PathBuf::from);
    Ok(names.map(|name| target.join("release").join(format!("{name}{}", std::env::consts::EXE_SUFFIX))))
}

/// Repeats a step that needs the network: three attempts, a growing pause between them.
pub fn with_retries<T>(what: &str, mut step: impl FnMut() -> Outcome<T>) -> Outcome<T> {
    const ATTEMPTS: u64 = 3;
    let mut attempt = 1;
    loop {
        match step() {
            Ok(value) => return Ok(value),
            Err(reason) if attempt == ATTEMPTS => return Err(reason),
            Err(reason) => {
                let pause = 2 * attempt;
                say(format!(
                    "{what}: attempt {attempt} of {ATTEMPTS} failed, again in {pause} s ({})",
                    last_line(&reason)
                ));
                std::thread::sleep(Duration::from_secs(pause));
                attempt += 1;
            }
        }
    }
}

/// Runs a step and reports how long it took.
pub fn timed<T>(what: &str, step: impl FnOnce() -> Outcome<T>) -> Outcome<T> {
    say(format!("{what} ..."));
    let start = Instant::now();
    let outcome = step();
    let word = if outcome.is_ok() { "done" } else { "FAILED" };
    say(format!("{what}: {word} in {:.1} s", start.elapsed().as_secs_f64()));
    outcome
}

/// Whether a program of this name is on the search path.
pub fn on_path(program: &str) -> Option<PathBuf> {
    std::env::split_paths(&std::env::var_os("PATH")?).map(|folder| folder.join(program)).find(|path| path.is_file())
}

/// A private folder that disappears with its owner.
pub struct TemporaryFolder(pub PathBuf);

impl TemporaryFolder {
    /// Creates it under the system's temporary folder.
    pub fn new(label: &str) -> Outcome<Self> {
        let path = std::env::temp_dir().join(format!("meshband-{label}-{}", std::process::id()));
        std::fs::create_dir_all(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        Ok(Self(path))
    }
}

impl Drop for TemporaryFolder {
    fn drop(&mut self) {
        // Nothing depends on it any more; a remainder in the temporary folder is harmless.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// The last line of a message of several.
pub fn last_line(text: &str) -> &str {
    text.lines().last().unwrap_or_default().trim()
}

fn describe(command: &Command) -> String {
    let mut text = command.get_program().to_string_lossy().into_owned();
    for word in command.get_args() {
        text.push(' ');
        text.push_str(&word.to_string_lossy());
    }
    text
}
