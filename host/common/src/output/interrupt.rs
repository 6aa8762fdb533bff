//! Ctrl-C, a closed terminal and `kill`: what is half written goes, what is whole stays.
//!
//! A thread waits for the signals. It waits, too, for a replacement that is under way (`undisturbed`), removes every
//! temporary that is registered (`Temporary`) and ends the program with 130. Signals that the program was started to
//! ignore (`nohup`, a shell's background job) stay ignored. A limit on file sizes (SIGXFSZ) becomes an error of the
//! write instead of the program's end. Elsewhere than on Unix the program simply ends; its temporaries carry names
//! that nothing takes for results, and the next writer of the same target removes them.

use crate::{Error, Result};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Exit code of a program that was interrupted.
pub const EXIT_CODE: u8 = 130;

/// Files and folders to remove on an interrupt.
static TEMPORARIES: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());
/// Held while results are put into their places.
static GATE: Mutex<()> = Mutex::new(());
/// Somebody asked for the end.
static END_REQUEST: AtomicBool = AtomicBool::new(false);
/// The waiting thread is about to end the program.
static PROGRAM_END: AtomicBool = AtomicBool::new(false);
/// The next signal only asks.
static GENTLE_SIGNAL: AtomicBool = AtomicBool::new(false);

fn held<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Installs the handlers; once, at the start of the program.
///
/// # Errors
/// Where the operating system refuses.
#[cfg(unix)]
pub fn install() -> Result<()> {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
    let failed = |error: std::io::Error| Error::tool("signals", error);
    let ignored = ignored_signals();
    let wanted = [SIGINT, SIGTERM, SIGHUP].into_iter().filter(|&s| ignored & (1 << (s - 1)) == 0);
    let mut signals = signal_hook::iterator::Signals::new(wanted).map_err(failed)?;
    signal_hook::flag::register(SIGXFSZ, std::sync::Arc::default()).map_err(failed)?;
    std::thread::spawn(move || signals.forever().for_each(|_| asked()));
    Ok(())
}

/// Installs nothing: interrupts end the program at once.
///
/// # Errors
/// None.
#[cfg(not(unix))]
pub fn install() -> Result<()> {
    Ok(())
}

/// Bit `n - 1` for signal `n` where the program was started to ignore it; known on Linux only.
#[cfg(unix)]
fn ignored_signals() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|digits| u64::from_str_radix(digits.trim(), 16).ok()).unwrap_or(0)
}

/// One signal has come.
#[cfg(unix)]
fn asked() {
    END_REQUEST.store(true, Ordering::SeqCst);
    if GENTLE_SIGNAL.swap(false, Ordering::SeqCst) {
        return;
    }
    PROGRAM_END.store(true, Ordering::SeqCst);
    // Neither is given back: from here on nothing is begun and nothing is put into place.
    let _gate = held(&GATE);
    let list = held(&TEMPORARIES);
    list.iter().for_each(|path| remove(path));
    std::process::exit(i32::from(EXIT_CODE));
}

/// Whether an interrupt has come since the start.
pub fn requested() -> bool {
    END_REQUEST.load(Ordering::SeqCst)
}

/// Waits for the end where an interrupt is ending the program: errors that its removals cause are nobody's business.
pub fn wait_if_ending() {
    while PROGRAM_END.load(Ordering::SeqCst) {
        std::thread::park();
    }
}

/// From here on the first interrupt only makes [`requested`] true; the second one ends the program.
///
/// For commands that run until they are told to stop and have results to write then.
pub fn only_ask() {
    GENTLE_SIGNAL.store(true, Ordering::SeqCst);
}

/// Does `work`, a few renames, without an interrupt in between.
pub(super) fn undisturbed<T>(work: impl FnOnce() -> T) -> T {
    let _gate = held(&GATE);
    work()
}

/// A path that goes with its owner or with an interrupt, whichever comes first; file or folder, present or not.
#[derive(Debug)]
pub(crate) struct Temporary(PathBuf);

impl Temporary {
    /// Registers `path`.
    pub(crate) fn register(path: PathBuf) -> Self {
        held(&TEMPORARIES).push(path.clone());
        Self(path)
    }

    /// The path.
    pub(crate) fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        remove(&self.0);
        let mut list = held(&TEMPORARIES);
        if let Some(at) = list.iter().position(|path| *path == self.0) {
            list.swap_remove(at);
        }
    }
}

/// Removes a file, or a folder: that a few times, because another thread may still put files there.
pub(super) fn remove(path: &Path) {
    for _ in 0..100 {
        match path.symlink_metadata() {
            Ok(found) if found.is_dir() => {
                if std::fs::remove_dir_all(path).is_ok() {
                    return;
                }
            }
            Ok(_) => {
                // Once only: the next writer's lock file has the same name.
                let _ = std::fs::remove_file(path);
                return;
            }
            Err(_) => return,
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}
