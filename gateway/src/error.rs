//! One error type: a line that says what and where. What is wrong with the input ends the program with exit code 2.

use std::fmt::Display;

/// Outcome of everything that can fail.
pub type Result<T = ()> = std::result::Result<T, Error>;

/// A line for the person who started the program.
#[derive(Debug)]
pub struct Error(String);

impl Error {
    /// What failed, and why.
    pub fn new(place: impl Display, reason: impl Display) -> Self {
        // Parsers answer in several lines; the reader of a log wants one.
        let text = format!("{place}: {reason}");
        Self(text.lines().map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join("; "))
    }
}

impl Display for Error {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Error {}

/// Names the file in a system's complaint.
pub fn at<T>(path: &std::path::Path, result: std::io::Result<T>) -> Result<T> {
    result.map_err(|reason| Error::new(path.display(), reason))
}
