//! The node on an STM32F405, for the upper slot: the program of `stm32f405`, linked elsewhere.
#![no_std]
#![no_main]

#[path = "node/stm32f405.rs"]
mod node;
