//! The one TOML file: nodes, broker, journal, history, metrics.
//!
//! Everything is checked before a port is opened. Unknown keys are refused: a misspelt `password_file` must not end
//! as an anonymous connection.

use crate::error::{Error, Result};
use serde::Deserialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Everything the gateway is told.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Name of this gateway: the Sparkplug edge node.
    pub name: String,
    /// Folder of journal and state; one gateway each.
    pub data: PathBuf,
    /// MQTT broker; without it only the history is written.
    pub broker: Option<Broker>,
    /// Parquet files; without it only the broker is served.
    pub history: Option<History>,
    /// The journal's limits.
    #[serde(default)]
    pub journal: Journal,
    /// Local address of the Prometheus page, as `127.0.0.1:9464`.
    pub metrics: Option<std::net::SocketAddr>,
    /// Nodes.
    #[serde(rename = "node")]
    pub nodes: Vec<Node>,
}

/// One node.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Node {
    /// Its name: the Sparkplug device.
    pub name: String,
    /// The machine it listens to: the history's partition.
    pub machine: String,
    /// `tcp:HOST:PORT`, or the path of a serial port.
    pub port: String,
    /// The chip's number that must answer (24 hexadecimal digits); another node under this name is then refused.
    pub unit: Option<String>,
}

/// Broker and Sparkplug identity.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Broker {
    /// Host name or address.
    pub host: String,
    /// Port; 1883, or 8883 with TLS, where none is given.
    pub port: Option<u16>,
    /// Sparkplug group.
    pub group: String,
    /// User name.
    pub user: Option<String>,
    /// File that holds the password, one line; kept out of this file so that this file can be shown.
    pub password_file: Option<PathBuf>,
    /// TLS: file with the certificates (PEM) that vouch for the broker.
    pub tls_ca: Option<PathBuf>,
    /// TLS: file with the gateway's own certificate and those between it and the authority (PEM), where the broker asks
    /// for one.
    pub tls_cert: Option<PathBuf>,
    /// TLS: file with the key of that certificate (PEM).
    pub tls_key: Option<PathBuf>,
    /// Sparkplug host without which nothing is published: births wait until its STATE says that it is online.
    pub primary_host: Option<String>,
    /// Takes `Command/Configure` from the broker.
    #[serde(default)]
    pub allow_configure: bool,
    /// Longest pause between attempts to connect, s.
    #[serde(default = "thirty")]
    pub retry_seconds: u64,
}

/// Parquet files.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct History {
    /// Root folder, `machine=NAME/day=YYYY-MM-DD/` below it.
    pub folder: PathBuf,
    /// Time between files, s. What is not in a file yet is in the journal.
    #[serde(default = "sixty")]
    pub flush_seconds: u64,
    /// Files of a partition from which on they are merged.
    #[serde(default = "sixteen")]
    pub compact_files: usize,
    /// Rollups and what goes then; without it all raw rows stay and nothing is rolled up.
    pub rollup: Option<Rollup>,
}

/// Rollups of a minute, an hour and a day, and how long what they were made of stays.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rollup {
    /// Their folder; the history's with `-rollup` behind its name where none is given.
    pub folder: Option<PathBuf>,
    /// Days that raw rows stay behind their own; without it, for ever.
    pub raw_days: Option<u32>,
    /// Days that buckets of a minute stay; without it, for ever. Hours and days stay.
    pub minute_days: Option<u32>,
    /// Raw rows of a machine so near an alarm of it stay for ever, s.
    #[serde(default = "ten_minutes")]
    pub alarm_seconds: u32,
}

impl History {
    /// Folder of the rollups.
    pub fn rollup_folder(&self) -> PathBuf {
        let beside = || {
            let mut name = self.folder.file_name().unwrap_or_default().to_owned();
            name.push("-rollup");
            self.folder.with_file_name(name)
        };
        self.rollup.as_ref().and_then(|rollup| rollup.folder.clone()).unwrap_or_else(beside)
    }

    fn check(&self) -> std::result::Result<(), String> {
        if self.flush_seconds == 0 || self.compact_files < 2 {
            return Err("history: flush_seconds must be 1 or more, compact_files 2 or more".into());
        }
        let Some(rollup) = &self.rollup else { return Ok(()) };
        if [rollup.raw_days, rollup.minute_days].contains(&Some(0)) {
            return Err("history.rollup: raw_days and minute_days must be 1 or more; leave them out to keep all".into());
        }
        if rollup.alarm_seconds > LONGEST_ALARM_S {
            return Err(format!("history.rollup: alarm_seconds must be at most {LONGEST_ALARM_S}, a day"));
        }
        let folder = self.rollup_folder();
        if folder.starts_with(&self.folder) || self.folder.starts_with(&folder) {
            return Err(format!(
                "history.rollup: folder {} and the history's {} must lie beside each other, or readers of one count \
                 the other",
                folder.display(),
                self.folder.display()
            ));
        }
        Ok(())
    }
}

/// The journal's limits.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Journal {
    /// Most megabytes on disk; beyond, the oldest entries go and are counted.
    pub megabytes: u64,
    /// A power cut loses at most this many seconds; a killed process loses nothing that it had received.
    pub sync_seconds: f64,
}

impl Default for Journal {
    fn default() -> Self {
        Self { megabytes: 2048, sync_seconds: 1.0 }
    }
}

fn thirty() -> u64 {
    30
}
fn sixty() -> u64 {
    60
}
fn sixteen() -> usize {
    16
}
fn ten_minutes() -> u32 {
    600
}

/// Most seconds around an alarm: thinning looks at the neighbouring days, and no further.
const LONGEST_ALARM_S: u32 = 86_400;

impl Config {
    /// Reads and checks a file.
    ///
    /// # Errors
    /// One line with the file, and the key where there is one.
    pub fn read(path: &Path) -> Result<Self> {
        let text = crate::error::at(path, std::fs::read_to_string(path))?;
        let config: Self = toml::from_str(&text).map_err(|reason| Error::new(path.display(), reason))?;
        config.check().map_err(|reason| Error::new(path.display(), reason))?;
        Ok(config)
    }

    fn check(&self) -> std::result::Result<(), String> {
        named("name", &self.name)?;
        if let Some(broker) = &self.broker {
            named("broker.group", &broker.group)?;
            broker.primary_host.as_ref().map_or(Ok(()), |host| named("broker.primary_host", host))?;
            if broker.user.is_none() && broker.password_file.is_some() {
                return Err("broker.password_file without broker.user".into());
            }
            if broker.tls_cert.is_some() != broker.tls_key.is_some() {
                return Err("broker.tls_cert and broker.tls_key belong together: name both or none".into());
            }
            if broker.tls_cert.is_some() && broker.tls_ca.is_none() {
                return Err("broker.tls_cert without broker.tls_ca: name what vouches for the broker as well".into());
            }
        }
        if self.broker.is_none() && self.history.is_none() {
            return Err("neither [broker] nor [history]: nothing to do with what the nodes say".into());
        }
        if self.nodes.is_empty() {
            return Err("no [[node]]".into());
        }
        if !(0.05..=60.0).contains(&self.journal.sync_seconds) || self.journal.megabytes < 8 {
            return Err("journal: sync_seconds must be 0.05 to 60, megabytes 8 or more".into());
        }
        self.history.as_ref().map_or(Ok(()), History::check)?;
        let (mut names, mut ports) = (BTreeSet::new(), BTreeSet::new());
        for node in &self.nodes {
            named("node.name", &node.name)?;
            machine_named("node.machine", &node.machine)?;
            // Host applications may not tell cases apart.
            if !names.insert(node.name.to_lowercase()) {
                return Err(format!("two nodes are named {}, in whatever case; give one another name", node.name));
            }
            if !ports.insert(&node.port) {
                return Err(format!("two nodes have the port {}", node.port));
            }
            if let Some(unit) = &node.unit
                && (unit.len() != 24 || !unit.bytes().all(|b| b.is_ascii_hexdigit()))
            {
                return Err(format!("node {}: unit must have 24 hexadecimal digits", node.name));
            }
        }
        Ok(())
    }
}

/// Names go into topics, folders and queries: no separators, no wildcards, nothing invisible.
///
/// # Errors
/// What a name may be.
pub fn named(key: &str, name: &str) -> std::result::Result<(), String> {
    let allowed = |c: char| c.is_alphanumeric() || matches!(c, '-' | '_' | '.' | ' ');
    let sound =
        !name.is_empty() && name.len() <= 100 && name.chars().all(allowed) && !name.starts_with(['.', '_', ' ']);
    if sound { Ok(()) } else { Err(format!("{key} {name:?} must be 1 to 100 letters, digits, - _ . or spaces")) }
}

/// Words that some reader of the history's folders takes for a number, a date, a truth value or nothing.
const GUESSED: [&str; 7] = ["inf", "infinity", "nan", "null", "true", "false", "epoch"];

/// A machine is a folder `machine=NAME` of the history, and most readers guess at NAME: one that begins with a letter
/// and is no such word is text to all of them.
///
/// # Errors
/// What a name may be, and the remedy.
pub fn machine_named(key: &str, name: &str) -> std::result::Result<(), String> {
    named(key, name)?;
    if name.starts_with(char::is_alphabetic) && !GUESSED.contains(&name.trim().to_lowercase().as_str()) {
        return Ok(());
    }
    let better = name.trim_start_matches('-');
    Err(format!(
        "{key} {name:?}: other programs may take machine={name} for a number, a date or null; call it \
         \"mill-{better}\" or the like, with a letter first"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(change: impl Fn(String) -> String) -> std::result::Result<(), String> {
        let text = "name = \"g\"\ndata = \"d\"\n[history]\nfolder = \"h\"\n[[node]]\nname = \"a\"\nmachine \
            = \"m\"\nport = \"tcp:127.0.0.1:1\"\n";
        let config: Config = toml::from_str(&change(text.to_owned())).map_err(|e| e.to_string())?;
        config.check()
    }

    #[test]
    fn claim_every_mistake_is_named() {
        assert_eq!(parse(|t| t), Ok(()));
        for (from, to, says) in [
            ("folder", "folders", "unknown field"),
            ("\"m\"", "\"m/..\"", "node.machine"),
            ("[history]\nfolder = \"h\"", "", "nothing to do"),
            ("machine = \"m\"", "machine = \"m\"\nunit = \"12\"", "24 hexadecimal"),
            ("[history]", "[journal]\nsync_seconds = nan\n[history]", "sync_seconds"),
            ("[[node]]", "[history.rollup]\nraw_days = 0\n[[node]]", "leave them out"),
            ("[[node]]", "[history.rollup]\nalarm_seconds = 86401\n[[node]]", "alarm_seconds"),
            ("[[node]]", "[history.rollup]\nfolder = \"h/rollup\"\n[[node]]", "beside each other"),
            ("[[node]]", "[history.rollup]\nhour_days = 3\n[[node]]", "unknown field"),
        ] {
            let error = parse(|t| t.replace(from, to)).expect_err(says);
            assert!(error.contains(says), "{error}");
        }
        let twice = parse(|t| t.clone() + &t[t.find("[[node").expect("there")..]).expect_err("two of one name");
        assert!(twice.contains("two nodes are named a"), "{twice}");
        let other_case = |t: String| t.clone() + &t[t.find("[[node").expect("there")..].replace("\"a\"", "\"A\"");
        let twice = parse(other_case).expect_err("two of one name but for the case");
        assert!(twice.contains("two nodes are named A"), "{twice}");
    }

    #[test]
    fn fault_machine_names_that_a_reader_of_the_folders_would_guess_at_are_refused_with_a_remedy() {
        let guessed = "7 007 -1 0x10 1e3 3D 1_000 2026-02-03 12.5 \u{663} inf -inf Infinity nan NaN null NULL true \
            False epoch";
        for name in guessed.split_whitespace() {
            let error = parse(|t| t.replace("\"m\"", &format!("{name:?}"))).expect_err(name);
            assert!(error.contains("node.machine") && error.contains(name) && error.contains("mill-"), "{error}");
        }
        for name in ["mill-1", "m", "Mühle 3D", "info", "nancy", "none", "today"] {
            assert_eq!(parse(|t| t.replace("\"m\"", &format!("{name:?}"))), Ok(()));
        }
    }

    #[test]
    fn claim_a_certificate_needs_its_key_and_what_vouches_for_the_broker() {
        let broker = |keys: &str| format!("[broker]\nhost = \"h\"\ngroup = \"g\"\n{keys}\n[history]");
        let of = |keys: &str| parse(|t| t.replace("[history]", &broker(keys)));
        let (authority, certificate, key) = ("tls_ca = \"a\"\n", "tls_cert = \"c\"\n", "tls_key = \"k\"\n");
        assert_eq!(of(&[authority, certificate, key].concat()), Ok(()));
        for (keys, says) in [
            ([authority, certificate], "belong together"),
            ([authority, key], "belong together"),
            ([certificate, key], "without broker.tls_ca"),
        ] {
            let error = of(&keys.concat()).expect_err(says);
            assert!(error.contains(says), "{error}");
        }
    }

    #[test]
    fn claim_a_primary_host_is_a_name_like_the_others() {
        let broker = |id: &str| format!("[broker]\nhost = \"h\"\ngroup = \"g\"\nprimary_host = {id:?}\n[history]");
        assert_eq!(parse(|t| t.replace("[history]", &broker("scada 1"))), Ok(()));
        let error = parse(|t| t.replace("[history]", &broker("a/+"))).expect_err("a wildcard");
        assert!(error.contains("broker.primary_host"), "{error}");
    }
}
