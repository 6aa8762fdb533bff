//! Subcommands of the validation program: argument structs and printing around library calls.

pub mod bearings;
pub mod inject;
pub mod levels;
pub mod measured;
pub mod prove;
