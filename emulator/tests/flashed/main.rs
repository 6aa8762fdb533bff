//! The released image in the emulated board. Two views of it: [`compared`] holds every frame against the host's node,
//! [`spoken`] talks to it.

mod alarms;
mod capture;
mod compared;
mod crashes;
mod health;
mod image;
mod link;
mod loader;
mod modbus;
mod outputs;
mod pace;
mod power;
mod records;
#[path = "../chip/registers.rs"]
mod registers;
mod second;
mod spoken;
mod starts;
mod tach;
mod update;
