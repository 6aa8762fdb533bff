//! One error type for everything a user can get wrong or a file can lack.
//!
//! Every message is one line that says *where* (file, table, option) and *what*; the command turns it
//! into exit code 2. Programming errors are not represented here: they are assertions.

use std::path::{Path, PathBuf};

/// What went wrong and where, in one line.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file could not be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file in question.
        path: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// A file, option or value was read but makes no sense.
    #[error("{place}: {what}")]
    Invalid {
        /// File, table and key, or option name.
        place: String,
        /// What is wrong and what would be right.
        what: String,
    },
    /// The input is sound but the computation is impossible for it (no convergence, no steady state).
    #[error("{place}: {what}")]
    Impossible {
        /// The computation.
        place: String,
        /// Why it cannot be done.
        what: String,
    },
    /// A tool the command needs (QEMU, the firmware image) is absent or failed.
    #[error("{tool}: {what}")]
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

    /// Wraps an input/output error with the file it concerns.
    pub fn file(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |source| Error::File { path: path.to_owned(), source }
    }
}

/// Result with the workbench's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;
