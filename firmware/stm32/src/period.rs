//! Sample periods as the timer's reload register wants them.

/// Shortest sample period, ticks: a conversion takes 27 cycles of 21 MHz, 108 ticks, and 110 leaves a margin.
pub const SHORTEST_PERIOD: u32 = 110;

/// Reload value for a period. Periods the converter cannot follow become the shortest one.
pub const fn reload_of(period_ticks: u32) -> u32 {
    if period_ticks < SHORTEST_PERIOD { SHORTEST_PERIOD - 1 } else { period_ticks - 1 }
}
