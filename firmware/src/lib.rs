//! Boards and glue of the meshband node.
//!
//! Everything that computes lives in the crate `meshband`, and so do the queues between interrupts and main loop
//! (`meshband::pipeline`); here are registers and interrupts. One module per board, chosen by feature.
#![no_std]

/// What the image was built from: a commit's short hash, where the build knows it.
pub const BUILD: &str = match option_env!("MESHBAND_BUILD") {
    Some(build) => build,
    None => "unknown",
};

pub mod crash;
pub mod fault;
pub mod interrupt_cell;
pub mod light;
pub mod runner;
pub mod stack;

#[cfg(feature = "board-an386")]
pub mod an386;

#[cfg(feature = "board-stm32f405")]
pub mod stm32f405;
