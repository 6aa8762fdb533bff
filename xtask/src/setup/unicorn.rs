//! Unicorn's shared library from the distribution: the processor of the emulated STM32F405.

use super::package::Package;
use crate::shell::{capture, command};
use std::path::Path;

const LIBRARY: &str = "libunicorn.so.2";
/// Names another library than the system's, as for the emulator itself.
const VARIABLE: &str = "MESHBAND_UNICORN";

/// The package.
pub const UNICORN: Package = Package {
    name: "libunicorn2",
    what: "Unicorn's shared library (libunicorn.so.2)",
    version,
    advice: "install Unicorn 2 with your package manager (Debian: libunicorn2, Fedora, Arch, Homebrew: unicorn), or \
             set MESHBAND_UNICORN to the library's file",
};

fn version() -> Option<String> {
    if let Some(path) = std::env::var_os(VARIABLE) {
        return Path::new(&path).is_file().then(|| format!("Unicorn ({})", path.display()));
    }
    // Not on the path of everyone who may run programs.
    let known = ["ldconfig", "/sbin/ldconfig", "/usr/sbin/ldconfig"];
    let list = known.iter().find_map(|program| capture(&mut command(&[program, "-p"])).ok())?;
    let line = list.lines().find(|line| line.trim_start().starts_with(LIBRARY))?;
    let path = line.rsplit("=> ").next().unwrap_or(LIBRARY);
    Path::new(path).is_file().then(|| format!("Unicorn ({path})"))
}
