//! Subcommands: argument structs and the printing around library calls; no computation of their own.

pub mod alias;
#[path = "loop.rs"]
pub mod close;
pub mod configure;
pub mod effects;
pub mod import;
pub mod law;
pub mod measured;
pub mod monitor;
pub mod node;
pub mod predict;
pub mod prove;
pub mod simulate;
pub mod stiffness;
