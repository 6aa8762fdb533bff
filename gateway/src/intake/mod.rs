//! From the ports to the journal: the one place that decides what a received frame is.
//!
//! [`port`] opens links, [`link`] is one node's thread, [`state`] knows what each node sent last, and [`worker`]
//! writes what is new.

pub mod link;
pub mod port;
pub mod state;
pub mod time_base;
pub mod worker;

use meshband::message::Identification;

/// What the nodes' threads report.
#[derive(Debug)]
pub struct Report {
    /// Index of the node in the configuration.
    pub node: usize,
    /// Wall clock, microseconds since 1970.
    pub wall_us: i64,
    /// Steady clock, microseconds.
    pub steady_us: i64,
    /// What.
    pub news: News,
}

/// Kinds of reports.
#[derive(Debug)]
pub enum News {
    /// A node said who it is; its frames follow.
    Online(Box<Identification>),
    /// Bytes of a frame between its delimiters.
    Frame(Vec<u8>),
    /// The link ended or the node fell silent.
    Offline(String),
    /// A command from the broker, and what became of it.
    Command(String),
}
