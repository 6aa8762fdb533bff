//! Sample periods as the timer's reload register wants them.

use crate::design_parameters::SHORTEST_PERIOD;

/// The period that is served when this one is asked for: the converter cannot follow shorter ones.
pub const fn served(period_ticks: u32) -> u32 {
    if period_ticks < SHORTEST_PERIOD { SHORTEST_PERIOD } else { period_ticks }
}

/// Reload value for a period.
pub const fn reload_of(period_ticks: u32) -> u32 {
    served(period_ticks) - 1
}
