//! Subcommands: argument structs and the printing around library calls; no computation of their own.

pub mod alias;
pub mod import;
pub mod law;
pub mod node;
pub mod predict;
pub mod simulate;
pub mod stiffness;
