//! Subcommands: argument structs and the printing around library calls; no computation of their own.

pub mod alias;
pub mod predict;
pub mod simulate;
