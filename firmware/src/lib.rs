//! Boards and glue of the meshband node.
//!
//! Everything that computes lives in the crate `meshband`; here are registers, interrupts and queues. One
//! module per board, chosen by feature; `pipeline` holds what all boards share.
#![no_std]

pub mod crash;
pub mod fault;
pub mod interrupt_cell;
pub mod light;
pub mod pipeline;
pub mod receive_circle;
pub mod runner;
pub mod send_ring;
pub mod stack;

#[cfg(feature = "board-an386")]
pub mod an386;

#[cfg(feature = "board-stm32f405")]
pub mod stm32f405;
