//! Digital filter of a timer's capture input, the same in all STM32 families. RM0090 section 18.4.7, field IC1F.

/// Digital filter of the tach input: this many equal samples in a row make a level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Filter {
    /// Divider of the filter's clock: CKD field, 0 (by 1) or 2 (by 4).
    pub clock_division: u8,
    /// IC1F field.
    pub code: u8,
    /// Time a level must last, and the delay of an edge, ticks.
    pub ticks: u32,
}

/// The filters that decide on eight samples, shortest first: 95 ns to 12 us.
pub const FILTERS: [Filter; 8] = [
    Filter { clock_division: 0, code: 3, ticks: 8 },
    Filter { clock_division: 0, code: 5, ticks: 16 },
    Filter { clock_division: 0, code: 7, ticks: 32 },
    Filter { clock_division: 0, code: 9, ticks: 64 },
    Filter { clock_division: 0, code: 12, ticks: 128 },
    Filter { clock_division: 0, code: 15, ticks: 256 },
    Filter { clock_division: 2, code: 12, ticks: 512 },
    Filter { clock_division: 2, code: 15, ticks: 1024 },
];

impl Filter {
    /// For a tach wheel that turns at `highest_hz` at most, on a time base of `clock_hz`.
    pub fn for_wheel(highest_hz: f32, pulses_per_turn: u16, clock_hz: u32) -> Filter {
        Filter::for_interval((clock_hz as f32 / (highest_hz * f32::from(pulses_per_turn))) as u32)
    }

    /// The longest filter that lasts at most 1/32 of the shortest pulse interval: both levels of a pulse of 3 % duty
    /// still pass.
    pub fn for_interval(shortest_ticks: u32) -> Filter {
        let mut best = FILTERS[0];
        for filter in FILTERS {
            if filter.ticks <= shortest_ticks / 32 {
                best = filter;
            }
        }
        best
    }
}
