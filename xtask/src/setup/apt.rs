//! apt with a private source list and private package lists: the user's own are read, never written.

use crate::shell::{Outcome, capture, command};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Adds packages and nothing else: `-y` alone would also agree to take a conflicting package of the user away.
const INSTALL: [&str; 4] = ["install", "-y", "--no-install-recommends", "--no-remove"];

/// Which suites the private source list names.
pub enum Suites {
    /// Every suite that may hold some version of the compiler's source.
    AnyWithRust,
    /// The running release with its backports.
    ReleaseAndBackports,
}

/// apt over a private state folder.
pub struct Apt {
    lists: PathBuf,
    /// `None`: the user's own sources.
    sources: Option<PathBuf>,
}

impl Apt {
    /// apt with the user's sources but fresh lists of our own.
    pub fn with_own_lists(folder: &Path) -> Outcome<Self> {
        Ok(Self { lists: make_lists(folder)?, sources: None })
    }

    /// apt with a temporary source list of the given suites at the user's own mirror.
    pub fn with_suites(folder: &Path, suites: Suites) -> Outcome<Self> {
        let mirror = mirror()?;
        let codename = codename()?;
        let backports = format!("{codename}-backports");
        let names: Vec<&str> = match suites {
            Suites::AnyWithRust => vec![&codename, &backports, "trixie", "trixie-backports", "forky", "sid"],
            Suites::ReleaseAndBackports => vec![&codename, &backports],
        };
        let keyring = Path::new("/usr/share/keyrings/debian-archive-keyring.gpg");
        let signed = if keyring.exists() { format!("[signed-by={}] ", keyring.display()) } else { String::new() };
        let mut text = String::new();
        for (i, suite) in names.iter().enumerate() {
            if !names[..i].contains(suite) {
                text += &format!("deb {signed}{mirror} {suite} main\n");
            }
        }
        let sources = folder.join("sources.list");
        std::fs::write(&sources, text).map_err(|e| format!("{}: {e}", sources.display()))?;
        Ok(Self { lists: make_lists(folder)?, sources: Some(sources) })
    }

    /// Fetches the package lists. Suites the mirror does not carry are no error as long as one is there.
    pub fn update(&self) -> Outcome {
        let outcome = capture(self.apt_get().arg("update"));
        let some_list = std::fs::read_dir(&self.lists)
            .into_iter()
            .flatten()
            .flatten()
            .any(|entry| entry.file_name().to_string_lossy().contains("_Packages"));
        if some_list { Ok(()) } else { outcome.map(drop).and(Err("apt fetched no package list".into())) }
    }

    /// Downloads one package file into `folder`.
    pub fn download(&self, package: &str, folder: &Path) -> Outcome {
        capture(self.apt_get().arg("download").arg(package).current_dir(folder)).map(drop)
    }

    /// Installs a package, from the given suite if one is named.
    pub fn install(&self, package: &str, suite: Option<&str>) -> Outcome {
        let mut apt = as_administrator(&self.apt_get())?;
        apt.env("DEBIAN_FRONTEND", "noninteractive").args(INSTALL);
        if let Some(suite) = suite {
            apt.args(["-t", suite]);
        }
        capture(apt.arg(package)).map(drop)
    }

    fn apt_get(&self) -> Command {
        let mut apt = command(&["apt-get", "-q"]);
        // Private folders are closed to apt's unprivileged download user.
        apt.arg("-o").arg("APT::Sandbox::User=root").arg("-o").arg("Acquire::Retries=3");
        apt.arg("-o").arg(format!("Dir::State::lists={}", self.lists.display()));
        if let Some(sources) = &self.sources {
            apt.arg("-o").arg(format!("Dir::Etc::sourcelist={}", sources.display()));
            apt.arg("-o").arg("Dir::Etc::sourceparts=-");
        }
        apt
    }
}

/// The user's plain apt, as an administrator.
pub fn plain_install(package: &str) -> Outcome {
    let mut apt = as_administrator(&command(&["apt-get", "-q"]))?;
    capture(apt.args(INSTALL).arg(package).env("DEBIAN_FRONTEND", "noninteractive")).map(drop)
}

/// Codename of the running release, for instance `bookworm`.
pub fn codename() -> Outcome<String> {
    let text = std::fs::read_to_string("/etc/os-release").map_err(|e| format!("/etc/os-release: {e}"))?;
    text.lines()
        .find_map(|line| line.strip_prefix("VERSION_CODENAME="))
        .map(|name| name.trim_matches('"').to_owned())
        .ok_or_else(|| "/etc/os-release names no release".into())
}

/// The user's Debian mirror.
fn mirror() -> Outcome<String> {
    let list = capture(&mut command(&["apt-get", "indextargets", "--format", "$(SITE)", "Created-By: Packages"]))?;
    list.lines()
        .map(str::trim)
        .find(|site| site.trim_end_matches('/').ends_with("/debian"))
        .map(str::to_owned)
        .ok_or_else(|| "apt names no Debian mirror on this machine".into())
}

fn make_lists(folder: &Path) -> Outcome<PathBuf> {
    let lists = folder.join("lists");
    std::fs::create_dir_all(lists.join("partial")).map_err(|e| format!("{}: {e}", lists.display()))?;
    Ok(lists)
}

/// The same command through sudo where we are not root; never asks for a password.
fn as_administrator(plain: &Command) -> Outcome<Command> {
    let is_root = capture(&mut command(&["id", "-u"]))?.trim() == "0";
    let mut elevated = if is_root {
        Command::new(plain.get_program())
    } else if crate::shell::on_path("sudo").is_some() {
        let mut sudo = command(&["sudo", "-n", "--preserve-env=DEBIAN_FRONTEND"]);
        sudo.arg(plain.get_program());
        sudo
    } else {
        return Err("not root and no sudo here".into());
    };
    elevated.args(plain.get_args());
    Ok(elevated)
}
