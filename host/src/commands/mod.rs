//! Subcommands: argument structs and the printing around library calls; no computation of their own.
//!
//! Every command announces its outputs before it works, writes them when it has worked, and shows text last.

pub mod alias;
pub mod analyse;
pub mod capture;
pub mod check;
#[path = "loop.rs"]
pub mod close;
pub mod commission;
pub mod configure;
pub mod effects;
pub mod export;
pub mod health;
pub mod import;
pub mod installation;
pub mod law;
pub mod levels;
pub mod machine;
pub mod modbus;
pub mod monitor;
pub mod node;
mod part;
pub mod predict;

pub mod simulate;
pub mod stiffness;
pub mod update;
