//! Every byte that came, in a file that `meshband monitor --replay` reads.
//!
//! Appended as it comes and flushed at once: what a power cut leaves is a capture, too. A failing disk must not end
//! the view; the capture stops and says why.

use crate::link::stream::REOPEN_MARK;
use crate::link::transport::Transport;
use crate::output::Lock;
use crate::{Error, Result};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// A growing capture, shared with the transports that feed it.
#[derive(Clone)]
pub struct Capture {
    inner: Arc<Mutex<Inner>>,
    path: PathBuf,
}

struct Inner {
    file: File,
    bytes: u64,
    failed: Option<String>,
    _lock: Lock,
}

impl Capture {
    /// Appends to `path`, whose lock shows that nobody else does.
    ///
    /// # Errors
    /// A file that cannot be opened.
    pub fn append(path: &Path, lock: Lock) -> Result<Self> {
        let file = File::options().create(true).append(true).open(path).map_err(Error::file(path))?;
        let begun = file.metadata().map_err(Error::file(path))?.len() > 0;
        let inner = Inner { file, bytes: 0, failed: None, _lock: lock };
        let capture = Self { inner: Arc::new(Mutex::new(inner)), path: path.to_owned() };
        if begun {
            capture.keep(REOPEN_MARK);
        }
        Ok(capture)
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes kept so far, or why no more are.
    pub fn state(&self) -> std::result::Result<u64, String> {
        let inner = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        inner.failed.clone().map_or(Ok(inner.bytes), Err)
    }

    /// Keeps bytes that came.
    pub fn keep(&self, bytes: &[u8]) {
        let mut inner = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        if inner.failed.is_some() {
            return;
        }
        match inner.file.write_all(bytes) {
            Ok(()) => inner.bytes += bytes.len() as u64,
            Err(error) => inner.failed = Some(error.to_string()),
        }
    }
}

/// A transport whose received bytes are kept.
pub struct Kept {
    transport: Box<dyn Transport>,
    capture: Capture,
}

impl Kept {
    /// Keeps what `transport` receives.
    pub fn new(transport: Box<dyn Transport>, capture: Capture) -> Self {
        Self { transport, capture }
    }
}

impl Transport for Kept {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<Option<usize>> {
        let count = self.transport.read(buffer)?;
        if let Some(count) = count {
            self.capture.keep(&buffer[..count]);
        }
        Ok(count)
    }

    fn write(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        self.transport.write(bytes)
    }
}
