//! Expected levels of a machine: learned on the sound one, and what alarms on the departure from them are worth.
//!
//! [`observe`] takes the values out of what a node said, [`learn`] makes the node's table of them, [`sources`] has a node say something
//! about a record. [`mod@bench`] is a machine that runs for hours at random speed and load, with and without faults, [`hours`] the node's own
//! code on it, and [`judge`] puts absolute and departure alarms to the same hours at equal rates of false alarms; [`text`] says it in
//! tables. Nothing here computes a value of the node a second time.

pub mod bench;
pub mod hours;
pub mod judge;
pub mod learn;
pub mod observe;
pub mod sources;
pub mod text;
