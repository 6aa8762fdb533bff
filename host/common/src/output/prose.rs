//! Text for people: on standard output, or on standard error where standard output carries a result.
//!
//! Commands write their files first. A closed pipe then ends the program quietly ([`Error::Output`], exit code 141 as a
//! shell shows it for SIGPIPE), a full device with one line; nothing panics. Text on standard error is worth no error.

use crate::{Error, Result};
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};

/// Exit code of a program whose reader has gone: 128 + SIGPIPE.
pub const CLOSED_EXIT_CODE: u8 = 141;

static RESULT_ON_STDOUT: AtomicBool = AtomicBool::new(false);

/// Standard output carries a result from here on.
pub(super) fn leave_stdout_to_results() {
    RESULT_ON_STDOUT.store(true, Ordering::Relaxed);
}

/// Shows text as it is.
///
/// # Errors
/// Standard output is closed or full.
pub fn show(text: &str) -> Result<()> {
    if RESULT_ON_STDOUT.load(Ordering::Relaxed) {
        let _ = std::io::stderr().write_all(text.as_bytes());
        return Ok(());
    }
    to_stdout(text.as_bytes())
}

/// Writes all to standard output, now.
pub(super) fn to_stdout(bytes: &[u8]) -> Result<()> {
    let mut out = std::io::stdout().lock();
    out.write_all(bytes).and_then(|()| out.flush()).map_err(Error::Output)
}

/// Shows a line; takes the arguments of `println!` and gives a `Result`.
#[macro_export]
macro_rules! say {
    ($($text:tt)*) => { $crate::output::show(&(format!($($text)*) + "\n")) };
}

/// A line on standard error for who is watching; takes the arguments of `eprintln!` and never fails.
#[macro_export]
macro_rules! remark {
    ($($text:tt)*) => {{
        let _ = std::io::Write::write_all(&mut std::io::stderr(), (format!($($text)*) + "\n").as_bytes());
    }};
}
