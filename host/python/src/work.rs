//! Long work beside the interpreter: its lock is released, and Ctrl-C is answered within a tenth of a second.
//!
//! The work runs on a thread of its own; the calling thread waits without the lock and asks for signals in between.
//! On Ctrl-C the call ends with `KeyboardInterrupt` at once. The thread cannot be stopped: it ends by itself, its
//! result is dropped, and until then it takes processor time.

use crate::errors::raised;
use meshband_host::Result;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

/// Time between two looks for signals.
const LOOK: Duration = Duration::from_millis(50);

/// Runs `job` without the interpreter's lock.
///
/// # Errors
/// The job's own as exceptions, what a signal's handler raises, and `RuntimeError` for a fault of the library.
pub fn run<T: Send + 'static>(py: Python<'_>, job: impl FnOnce() -> Result<T> + Send + 'static) -> PyResult<T> {
    let (sender, receiver) = channel();
    let thread = std::thread::Builder::new().name("meshband".into()).spawn(move || drop(sender.send(job())));
    thread.map_err(|error| PyRuntimeError::new_err(format!("no thread for the work: {error}")))?;
    // A receiver belongs to one thread at a time; the lock is released around each wait only.
    let receiver = std::sync::Mutex::new(receiver);
    loop {
        let waited = py.detach(|| match receiver.lock() {
            Ok(receiver) => receiver.recv_timeout(LOOK),
            Err(_) => Err(RecvTimeoutError::Disconnected),
        });
        match waited {
            Ok(result) => return raised(py, result),
            Err(RecvTimeoutError::Timeout) => py.check_signals()?,
            Err(RecvTimeoutError::Disconnected) => {
                return Err(PyRuntimeError::new_err("a fault of the library; the line above says where"));
            }
        }
    }
}
