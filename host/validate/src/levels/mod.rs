//! What alarms on the departure from expected levels detect, beside absolute alarms at equal rates of false alarms.
//!
//! [`mod@bench`] is a machine that runs for hours at random speed and load, with and without faults, [`hours`] the
//! node's own code on it,
//! [`judge`] compares the alarms; [`text`] writes the tables.

pub mod bench;
pub mod hours;
pub mod judge;
pub mod text;
