//! The chip model against RM0090, register by register, and its processor on small programs.

mod amplifier_bus;
mod clocks;
mod core;
mod flash;
mod housekeeping;
mod registers;
mod timers;
mod transfers;
