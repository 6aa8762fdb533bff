//! What ends a run.

use std::fmt;

/// Result of anything here.
pub type Result<T> = std::result::Result<T, Error>;

/// Why something could not be done.
#[derive(Clone, Debug, PartialEq)]
pub enum Error {
    /// Unicorn's library is not installed.
    Absent(String),
    /// Unicorn refused.
    Engine(String),
    /// The image is none, or not for this chip.
    Image(String),
    /// The program did what the chip, or this model of it, does not serve.
    Violation(Violation),
    /// A fault within the handler of a fault: the core stands still.
    LockUp {
        /// Program counter of the second fault.
        program_counter: u32,
        /// Seconds since power came.
        time_s: f64,
    },
}

/// An access that the model does not serve.
#[derive(Clone, Debug, PartialEq)]
pub struct Violation {
    /// What was wrong.
    pub what: String,
    /// Address accessed.
    pub address: u32,
    /// Program counter, to the block of instructions.
    pub program_counter: u32,
    /// Seconds since power came.
    pub time_s: f64,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::Absent(what) => write!(f, "emulated board: {what}"),
            Error::Engine(what) => write!(f, "emulated board: Unicorn: {what}"),
            Error::Image(what) => write!(f, "emulated board: image: {what}"),
            Error::Violation(violation) => write!(f, "emulated board: {violation}"),
            Error::LockUp { program_counter, time_s } => {
                write!(f, "emulated board: the core locked up at {program_counter:#010x} after {time_s:.6} s")
            }
        }
    }
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { what, address, program_counter, time_s } = self;
        write!(f, "{what} at {address:#010x}, program counter {program_counter:#010x}, after {time_s:.6} s")
    }
}

impl std::error::Error for Error {}

/// Why a device does not serve an access; [`crate::chip::Chip`] adds address and time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// No such register in the model.
    Register,
    /// These bits are not modelled.
    Bits(u32),
    /// The reference manual forbids it.
    Forbidden(&'static str),
}

/// Result of an access to a device.
pub type Access<T> = std::result::Result<T, Refusal>;

/// A value that sets modelled bits only.
///
/// # Errors
/// [`Refusal::Bits`] with those that are not.
pub fn within(value: u32, modelled: u32) -> Access<u32> {
    if value & !modelled == 0 { Ok(value) } else { Err(Refusal::Bits(value & !modelled)) }
}
