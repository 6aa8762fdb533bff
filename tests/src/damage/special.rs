//! What can stand where a file is expected and is none: folders, fifos, sockets, devices, links, endless files.

use rustix::fs::{CWD, Mode, mkfifoat};
use std::fs::{File, create_dir, remove_file};
use std::os::unix::fs::symlink;
use std::os::unix::net::UnixListener;
use std::path::Path;

/// Every special thing by name.
pub const SPECIAL_NAMES: &[&str] = &[
    "a folder",
    "a fifo",
    "a socket",
    "/dev/zero",
    "/dev/urandom",
    "/dev/null",
    "/dev/full",
    "/dev/tty",
    "a link to nothing",
    "a link to itself",
    "a link to a folder",
    "a terabyte of nothing",
    "nothing",
    "/proc/self/mem",
    "/proc/self/environ",
];

/// Puts it in place of a file.
///
/// # Panics
/// Where the campaign's folder cannot be written.
pub fn put(path: &Path, name: &str) {
    // Nothing may stand there yet.
    let _ = remove_file(path);
    let made = match name {
        "a folder" => create_dir(path),
        "a fifo" => fifo(path),
        // Names of sockets are short: where the folder is deep, a fifo stands in.
        "a socket" => UnixListener::bind(path).map(drop).or_else(|_| fifo(path)),
        "a link to nothing" => symlink("absent", path),
        "a link to itself" => symlink(path.file_name().unwrap_or_default(), path),
        "a link to a folder" => symlink(".", path),
        "a terabyte of nothing" => File::create(path).and_then(|file| file.set_len(1 << 40)),
        "nothing" => Ok(()),
        device => symlink(device, path),
    };
    made.unwrap_or_else(|error| panic!("{}: {name}: {error}", path.display()));
}

fn fifo(path: &Path) -> std::io::Result<()> {
    mkfifoat(CWD, path, Mode::RUSR | Mode::WUSR).map_err(Into::into)
}
