//! Expected levels of a machine, learned on the sound one.
//!
//! [`observe`] takes the values out of what a node said, [`learn`] makes the node's table of them, [`sources`] has a
//! node say something about a record. Nothing here computes a value of the node a second time.

pub mod learn;
pub mod observe;
pub mod sources;
