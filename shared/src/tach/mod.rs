//! From tach edges to speed, angle and turn marks.
//!
//! Edges in (64-bit instants of the node's time base), a [`Speed`] with its trust and marks of whole turns out. The
//! tracker is the node's; nobody else feeds it.

pub mod angle_filter;
mod tracker;
pub mod turn_marks;
pub mod wheel_pitch;

pub use tracker::*;
