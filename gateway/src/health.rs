//! What the gateway tells of itself: counters, and the page that Prometheus reads.
//!
//! One connection at a time, local by default, no request read beyond its first kilobyte: a page of text needs no
//! server.

use crate::error::Result;
use crate::stop::Stop;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{Read, Write as _};
use std::net::{SocketAddr, TcpListener};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Counters of one node.
#[derive(Clone, Debug, Default)]
pub struct NodeHealth {
    /// Answers at present.
    pub online: bool,
    /// New frames.
    pub frames: u64,
    /// Frames missing by sequence number.
    pub lost: u64,
    /// Frames received again.
    pub repeated: u64,
    /// Pieces that were no intact frame.
    pub refused: u64,
    /// Starts of the node.
    pub restarts: u64,
    /// Answers of a chip that is not the configured one.
    pub refused_units: u64,
    /// Alarms raised and not acknowledged.
    pub alarms: u64,
}

macro_rules! counters {
    ($($(#[doc = $doc:literal])+ $name:ident: $kind:literal,)*) => {
        /// Counters of the gateway, and of each node.
        #[derive(Debug, Default)]
        pub struct Health {
            nodes: Mutex<BTreeMap<String, NodeHealth>>,
            $($(#[doc = $doc])+ pub $name: AtomicU64,)*
        }

        impl Health {
            fn totals(&self) -> Vec<(&'static str, &'static str, &'static str, u64)> {
                vec![$((stringify!($name), concat!($($doc),+), $kind, self.$name.load(Ordering::Relaxed)),)*]
            }
        }
    };
}

counters! {
    /// Number that the journal's next entry will have.
    journal_next: "gauge",
    /// Entries that could not be written to the journal.
    journal_lost: "counter",
    /// Number of the next entry for the broker.
    broker_next: "gauge",
    /// Entries given up for the journal's limit before the broker had them.
    broker_lost: "counter",
    /// 1 while the broker holds a session.
    broker_connected: "gauge",
    /// 1 while births are published; 0 beside a session means that the primary host is offline.
    broker_born: "gauge",
    /// Sessions begun.
    broker_sessions: "counter",
    /// Times the broker refused user name, password or client.
    broker_refusals: "counter",
    /// Number of the next entry for the history.
    history_next: "gauge",
    /// Entries given up for the journal's limit before the history had them.
    history_lost: "counter",
    /// Failed attempts to write the history.
    history_failures: "counter",
    /// Jumps of the wall clock.
    clock_jumps: "counter",
}

impl Health {
    /// Changes a node's counters.
    pub fn node(&self, name: &str, change: impl FnOnce(&mut NodeHealth)) {
        let mut nodes = self.nodes.lock().unwrap_or_else(PoisonError::into_inner);
        change(nodes.entry(name.to_owned()).or_default());
    }

    /// Whether a node answers at present.
    pub fn is_online(&self, name: &str) -> bool {
        let nodes = self.nodes.lock().unwrap_or_else(PoisonError::into_inner);
        nodes.get(name).is_some_and(|node| node.online)
    }

    /// All counters in Prometheus' text form.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for (name, help, kind, value) in self.totals() {
            let suffix = if kind == "counter" { "_total" } else { "" };
            let _ = writeln!(text, "# HELP meshband_{name}{suffix}{help}\n# TYPE meshband_{name}{suffix} {kind}");
            let _ = writeln!(text, "meshband_{name}{suffix} {value}");
        }
        let nodes = self.nodes.lock().unwrap_or_else(PoisonError::into_inner);
        type Field = (&'static str, &'static str, fn(&NodeHealth) -> u64);
        let fields: [Field; 8] = [
            ("online", "gauge", |n| n.online.into()),
            ("frames_total", "counter", |n| n.frames),
            ("frames_lost_total", "counter", |n| n.lost),
            ("frames_repeated_total", "counter", |n| n.repeated),
            ("frames_refused_total", "counter", |n| n.refused),
            ("restarts_total", "counter", |n| n.restarts),
            ("units_refused_total", "counter", |n| n.refused_units),
            ("alarms", "gauge", |n| n.alarms),
        ];
        for (field, kind, of) in fields {
            let _ = writeln!(text, "# TYPE meshband_node_{field} {kind}");
            for (name, node) in nodes.iter() {
                let _ = writeln!(text, "meshband_node_{field}{{node=\"{name}\"}} {}", of(node));
            }
        }
        text
    }
}

/// Serves the page until the gateway stops.
///
/// # Errors
/// Where the address is not to be had.
pub fn serve(address: SocketAddr, health: Arc<Health>, stop: Stop) -> Result<std::thread::JoinHandle<()>> {
    let refuse = |reason| crate::error::Error::new(format!("metrics on {address}"), reason);
    let listener = TcpListener::bind(address).map_err(refuse)?;
    listener.set_nonblocking(true).map_err(refuse)?;
    Ok(std::thread::spawn(move || {
        while !stop.asked() {
            let Ok((mut stream, _)) = listener.accept() else {
                std::thread::sleep(Duration::from_millis(50));
                continue;
            };
            let page = health.text();
            // A reader that goes away in between has only itself to blame.
            let _ = (|| {
                stream.set_nonblocking(false)?;
                stream.set_read_timeout(Some(Duration::from_secs(1)))?;
                stream.set_write_timeout(Some(Duration::from_secs(1)))?;
                let mut request = [0; 1024];
                stream.read(&mut request).map(drop)?;
                let length = page.len();
                let head = format!(
                    "HTTP/1.1 200 OK\r\nContent-Type: text/plain; version=0.0.4\r\nContent-Length: {length}\r\n"
                );
                stream.write_all(format!("{head}Connection: close\r\n\r\n{page}").as_bytes())
            })();
        }
    }))
}
