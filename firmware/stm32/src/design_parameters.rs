//! Figures of the STM32F405 board's design, in one place: clocks, converter, blocks, link, watchdog.
//!
//! What the node and a host need too (time base, step of the sample period, highest rate) is
//! `meshband::board::Timing::STM32F405`; the image asserts at compile time that the two agree. Sources: RM0090,
//! DS8626; rates: `book/src/reference/node.md`.

/// Crystal, Hz.
pub const CRYSTAL_HZ: u32 = 8_000_000;
/// Core clock, Hz.
pub const CORE_HZ: u32 = 168_000_000;
/// Rate of the timers of APB1, hence of the time base, Hz.
pub const TIMER_HZ: u32 = 84_000_000;
/// Clock of USART1 and of the converter's divider, Hz.
pub const APB2_HZ: u32 = 84_000_000;

/// Divider of the converter's clock: 21 MHz, of at most 36 MHz.
pub const ADC_DIVIDER: u32 = 4;
/// Cycles of the converter's clock for sampling: good for sources of up to about 8 kilohm (DS8626 equation 1).
pub const ADC_SAMPLING_CYCLES: u32 = 15;
/// Cycles for a conversion of 12 bits.
pub const ADC_CONVERSION_CYCLES: u32 = 12;
/// Sampling and conversion, ticks of the time base: 1.29 us.
pub const CONVERSION_TICKS: u32 = (ADC_SAMPLING_CYCLES + ADC_CONVERSION_CYCLES) * PERIOD_STEP;
/// Sample periods are multiples of this many ticks: the converter takes a trigger at the next edge of its own clock,
/// and with any other period its instants would wander by up to 36 ns.
pub const PERIOD_STEP: u32 = ADC_DIVIDER * (TIMER_HZ / APB2_HZ);
/// Shortest sample period that the converter follows, ticks: the next multiple of the step.
pub const SHORTEST_PERIOD: u32 = CONVERSION_TICKS + PERIOD_STEP;
/// Highest rate a configuration may ask for, Hz: what the main loop keeps up with at two cycles per instruction, with
/// margin (`cargo xtask pace`). The converter could follow 750 kHz.
pub const HIGHEST_RATE_HZ: u32 = 420_000;

/// Samples of a block.
pub const BLOCK_SAMPLES: u16 = 512;

/// From the capture of an edge to its place in the queue, ticks, while the main loop runs: synchroniser, entry of the
/// interrupt and the handler, which the main loop cannot overtake; with a margin.
pub const CAPTURE_LATENCY: u32 = 64;

/// Bit rate of the link.
pub const BITS_PER_SECOND: u32 = 921_600;
/// Circle of received bytes: 11 ms of the line's full rate.
pub const RECEIVE_BYTES: usize = 1024;

/// Nominal time-out of the watchdog, ms at 32 kHz; 5.4 s to 15 s over its oscillator's tolerance of 17 kHz to 47 kHz.
pub const WATCHDOG_MS: u32 = 8_000;
/// Period of the wake-up that lets the main loop work while no blocks come: 5 ms at an eighth of the core's clock.
pub const WAKE_TICKS: u32 = CORE_HZ / 8 / 200;
