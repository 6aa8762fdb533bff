//! Register blocks of plain memory, for the drivers of the STM32F405.

use meshband::board::Timing;
use meshband::config::Configuration;
use meshband::law::Law;
use meshband::rate_plan::{RateLimits, RatePlan, RatePolicy};
use meshband::units::Hertz;

/// A register block as after power-up with all zeros.
pub fn block<T>() -> Box<T> {
    // SAFETY: register blocks consist of integers; all zeros is a valid value.
    unsafe { Box::new(std::mem::zeroed()) }
}

/// Word at a byte offset, as the manual numbers registers.
pub fn word<T>(block: &T, offset: usize) -> u32 {
    assert!(offset + 4 <= size_of::<T>());
    // SAFETY: inside the block, aligned as the block is; registers are plain memory here.
    unsafe { std::ptr::from_ref(block).cast::<u8>().add(offset).cast::<u32>().read_volatile() }
}

/// Sets a word as hardware would.
pub fn set<T>(block: &T, offset: usize, value: u32) {
    assert!(offset + 4 <= size_of::<T>());
    // SAFETY: as for `word`; registers have interior mutability.
    unsafe { std::ptr::from_ref(block).cast::<u8>().add(offset).cast::<u32>().cast_mut().write_volatile(value) }
}

/// Compares fields of a register: lowest bit, mask, expected value, meaning.
pub fn assert_fields(register: u32, fields: &[(u32, u32, u32, &str)]) {
    for &(lowest, mask, expected, meaning) in fields {
        assert_eq!(register >> lowest & mask, expected, "bits from {lowest} on of {register:#010x}: {meaning}");
    }
}

/// Offset in a timer's register block.
pub const CR1: usize = 0x00;
/// Offset in a timer's register block.
pub const CR2: usize = 0x04;
/// Offset in a timer's register block.
pub const SMCR: usize = 0x08;
/// Offset in a timer's register block.
pub const DIER: usize = 0x0c;
/// Offset in a timer's register block.
pub const SR: usize = 0x10;
/// Offset in a timer's register block.
pub const CCMR1: usize = 0x18;
/// Offset in a timer's register block.
pub const CCER: usize = 0x20;
/// Offset in a timer's register block.
pub const CNT: usize = 0x24;
/// Offset in a timer's register block.
pub const PSC: usize = 0x28;
/// Offset in a timer's register block.
pub const ARR: usize = 0x2c;
/// Offset in a timer's register block.
pub const CCR1: usize = 0x34;
/// Offset in a timer's register block.
pub const CCR2: usize = 0x38;

/// Periods of the plan for shaft rates of 0.5 to 60 Hz, under the policies and filters a node may be given.
pub fn planned_periods() -> Vec<u32> {
    let mut periods = Vec::new();
    let widest = Law { highest: Hertz(60.0), lowest: Hertz(0.5), ..Configuration::default().law };
    for (stop, policy) in [
        (100_000.0, RatePolicy::Spectrum),
        (20_000.0, RatePolicy::Spectrum),
        (10_000.0, RatePolicy::Critical),
        (2_000.0, RatePolicy::Waveform { multiple: 10.0 }),
    ] {
        let limits = RateLimits { analogue_stop: Hertz(stop), highest_adc: Timing::STM32F405.highest_adc };
        let mut plan = RatePlan::new(Timing::STM32F405, limits);
        for tenth in 5..=600u32 {
            let bandwidth = widest.bandwidth(Hertz(tenth as f32 / 10.0)).bandwidth;
            periods.push(plan.grant(policy.rate(bandwidth)).period_ticks);
        }
    }
    periods
}
