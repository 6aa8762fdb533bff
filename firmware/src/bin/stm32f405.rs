//! The node on an STM32F405, for the lower slot; `stm32f405_b` is the same for the upper one.
#![no_std]
#![no_main]

#[path = "node/stm32f405.rs"]
mod node;
