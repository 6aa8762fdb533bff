//! Why the node started: the flags of `RCC_CSR`, which lie alike in all STM32F4. RM0090 section 7.3.21.

/// Why the node started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ResetCause {
    /// Power came, or fell below the brown-out level.
    Power = 0,
    /// Reset pin.
    Pin = 1,
    /// Software: a recorded crash, or a command.
    Software = 2,
    /// Independent watchdog: the main loop hung, or no samples came.
    Watchdog = 3,
    /// Window watchdog or illegal low-power entry; the node uses neither.
    Other = 4,
}

const BROWN_OUT: u32 = 1 << 25;
const POWER_ON: u32 = 1 << 27;
const SOFTWARE: u32 = 1 << 28;
const INDEPENDENT_WATCHDOG: u32 = 1 << 29;
const WINDOW_WATCHDOG: u32 = 1 << 30;
const LOW_POWER: u32 = 1 << 31;

impl ResetCause {
    /// Of the register's value. Several flags may stand: a pin reset accompanies every other one.
    pub const fn of_flags(flags: u32) -> Self {
        if flags & INDEPENDENT_WATCHDOG != 0 {
            ResetCause::Watchdog
        } else if flags & SOFTWARE != 0 {
            ResetCause::Software
        } else if flags & (WINDOW_WATCHDOG | LOW_POWER) != 0 {
            ResetCause::Other
        } else if flags & (POWER_ON | BROWN_OUT) != 0 {
            ResetCause::Power
        } else {
            ResetCause::Pin
        }
    }
}
