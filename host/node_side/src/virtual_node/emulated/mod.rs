//! The released board in emulation: the very image that is flashed, on a chip of which only the instructions are
//! someone else's ([`meshband_emulator`]).
//!
//! [`run`] feeds it with a signal and tach edges and listens to its line; [`reference`](mod@reference) gives the same
//! codes and edges to the node's own code on the host; [`store`] is the configuration in its flash. The converter has
//! twelve bits and its codes are what the chip's timers, filters and DMA made of the signal: nothing is taken from
//! the firmware but frames.

mod flashed;
pub mod play;
pub mod reference;
pub mod run;
pub mod store;
