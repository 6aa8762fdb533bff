//! The campaign of trains (`meshband prove --train`): trains, operation and faults drawn at random, their signals by
//! an own kinematic generator, what signal-based inference says of them.
//!
//! `bench` draws; `signal` makes mesh forces and sends them through modes of a housing; `campaign` runs and scores.
//! The generator shares the train's kinematics with what is tested, and nothing else: faults are put in over time,
//! tooth by tooth and planet by planet, never as lines.

pub mod bench;
pub mod campaign;
pub mod signal;
