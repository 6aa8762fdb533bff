//! What a page rests on, for its foot: the file, its day, speed, load, sampling, sensors, command and version.
//!
//! The command line is the one that this program was started with; a library's page has none.

use std::path::Path;
use std::sync::OnceLock;

static COMMAND: OnceLock<String> = OnceLock::new();

/// Keeps the words of the command line for the feet of all pages.
pub fn set_command(words: impl IntoIterator<Item = String>) {
    let mut words = words.into_iter();
    let program = words.next().map_or_else(String::new, |path| {
        Path::new(&path).file_name().map_or(path.clone(), |name| name.to_string_lossy().into_owned())
    });
    let quoted = words.map(|word| if word.contains(' ') { format!("'{word}'") } else { word });
    // Only the first one counts: a program has one command line.
    let _ = COMMAND.set(std::iter::once(program).chain(quoted).collect::<Vec<_>>().join(" "));
}

/// The command line, where there is one.
pub fn command() -> Option<&'static str> {
    COMMAND.get().map(String::as_str)
}

/// Facts of a measurement, name and value, in the order of the page's foot.
pub type Facts = Vec<(String, String)>;
