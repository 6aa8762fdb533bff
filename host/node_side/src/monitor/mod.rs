//! The live view of a node: what it says, how old that is, and whether it still says anything.
//!
//! [`link`] keeps a connection, loses it, and makes it again with growing pauses; [`capture`] keeps every byte in a
//! file. [`panel`] holds the newest of everything with its age, trends and alarms; [`screen`] draws it with ratatui,
//! from 80x24 upwards; [`terminal`] owns the terminal and the keys. Time is handed in as seconds since the start, so
//! that tests can make a node silent without waiting.
//!
//! State and quality come first because a figure without them is worth nothing: a node that has been silent for
//! seconds must not look like one that measures. Limits: one node per view; trends hold the last [`panel::TREND`]
//! values and are lost at the end, the capture is not.

pub mod capture;
pub mod link;
pub mod panel;
pub mod screen;
pub mod terminal;
