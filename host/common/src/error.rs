//! One error type for everything a user can get wrong or a file can lack.
//!
//! Every message is one line that says *where* (file, table, option) and *what*; the command turns it
//! into exit code 2. Foreign text in it (cells, names, paths) is made fit for one line when it is shown.
//! Programming errors are not represented here: they are assertions.

use crate::text::{one_line, one_line_place};
use std::path::{Path, PathBuf};

/// What went wrong and where, in one line.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file could not be read or written.
    #[error("{}: {source}", one_line_place(&path.display().to_string()))]
    File {
        /// The file in question.
        path: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// A file, option or value was read but makes no sense.
    #[error("{}: {}", one_line_place(place), one_line(what))]
    Invalid {
        /// File, table and key, or option name.
        place: String,
        /// What is wrong and what would be right.
        what: String,
    },
    /// The input is sound but the computation is impossible for it (no convergence, no steady state).
    #[error("{}: {}", one_line_place(place), one_line(what))]
    Impossible {
        /// The computation.
        place: String,
        /// Why it cannot be done.
        what: String,
    },
    /// Standard output takes no more: closed by its reader, or full.
    #[error("standard output: {0}")]
    Output(std::io::Error),
    /// A tool the command needs (QEMU, the firmware image) is absent or failed.
    #[error("{}: {}", one_line_place(tool), one_line(what))]
    Tool {
        /// Name of the tool.
        tool: String,
        /// What happened and what to do.
        what: String,
    },
}

impl Error {
    /// An [`Error::Invalid`] from displayable parts.
    pub fn invalid(place: impl std::fmt::Display, what: impl std::fmt::Display) -> Self {
        Error::Invalid { place: place.to_string(), what: what.to_string() }
    }

    /// An [`Error::Impossible`] from displayable parts.
    pub fn impossible(place: impl std::fmt::Display, what: impl std::fmt::Display) -> Self {
        Error::Impossible { place: place.to_string(), what: what.to_string() }
    }

    /// An [`Error::Tool`] from displayable parts.
    pub fn tool(tool: impl std::fmt::Display, what: impl std::fmt::Display) -> Self {
        Error::Tool { tool: tool.to_string(), what: what.to_string() }
    }

    /// Whether the reader of standard output has gone, as `head` does: no error of anybody's.
    pub fn is_closed_output(&self) -> bool {
        matches!(self, Error::Output(source) if source.kind() == std::io::ErrorKind::BrokenPipe)
    }

    /// Wraps an input/output error with the file it concerns.
    pub fn file(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |source| Error::File { path: path.to_owned(), source }
    }
}

/// Result with the workbench's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;
