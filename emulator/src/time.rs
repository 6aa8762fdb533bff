//! Time of the emulated chip, and what is due when.
//!
//! One unit is 1/336 MHz: every clock in use is a whole number of units (core 2, converter 16, internal oscillator
//! 21, USART bit 364, watchdog's oscillator 10 500), so nothing is ever rounded and two runs are alike to the last
//! bit.

/// An instant or a length, in units of 1/[`UNITS_PER_SECOND`].
pub type Time = u64;

/// Units in a second of the oscillator that drives the clocks.
pub const UNITS_PER_SECOND: u64 = 336_000_000;

/// An instant that does not come.
pub const NO_INSTANT: Time = u64::MAX;

/// What may be due; those named first come first at one instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Source {
    /// A pin of the tach changes.
    Pin,
    /// The capture filter accepts a level.
    Filter,
    /// The pulse per second rises at its pin, or its filter accepts it.
    SecondPulse,
    /// TIM2 overflows.
    Tim2,
    /// TIM3 overflows.
    Tim3,
    /// TIM3 gets a clock from its master.
    Tim3Trigger,
    /// TIM5 is triggered by its master.
    Tim5Trigger,
    /// TIM5 overflows.
    Tim5,
    /// A conversion ends.
    Converter,
    /// A stream of a DMA moves its item.
    Dma,
    /// A byte has left the UART.
    Sent,
    /// A byte has reached the UART.
    Received,
    /// A byte has passed over SPI2.
    Spi,
    /// Flash has finished.
    Flash,
    /// An oscillator or the PLL becomes ready, or fails.
    Oscillator,
    /// SysTick reaches zero.
    SysTick,
    /// The watchdog reaches zero.
    Watchdog,
}

/// Number of sources.
const SOURCES: usize = Source::Watchdog as usize + 1;

const ALL: [Source; SOURCES] = [
    Source::Pin,
    Source::Filter,
    Source::SecondPulse,
    Source::Tim2,
    Source::Tim3,
    Source::Tim3Trigger,
    Source::Tim5Trigger,
    Source::Tim5,
    Source::Converter,
    Source::Dma,
    Source::Sent,
    Source::Received,
    Source::Spi,
    Source::Flash,
    Source::Oscillator,
    Source::SysTick,
    Source::Watchdog,
];

/// When each source is due next.
#[derive(Clone, Debug)]
pub struct Schedule {
    due: [Time; SOURCES],
    earliest: Time,
}

impl Default for Schedule {
    fn default() -> Self {
        Self { due: [NO_INSTANT; SOURCES], earliest: NO_INSTANT }
    }
}

impl Schedule {
    /// Sets or clears ([`NO_INSTANT`]) an instant.
    pub fn set(&mut self, source: Source, at: Time) {
        let before = std::mem::replace(&mut self.due[source as usize], at);
        if at < self.earliest {
            self.earliest = at;
        } else if before == self.earliest {
            self.earliest = self.due.iter().copied().min().unwrap_or(NO_INSTANT);
        }
    }

    /// When a source is due.
    pub fn at(&self, source: Source) -> Time {
        self.due[source as usize]
    }

    /// When the first source is due.
    pub fn earliest(&self) -> Time {
        self.earliest
    }

    /// Takes the first source that is due at or before `limit`.
    pub fn take(&mut self, limit: Time) -> Option<(Time, Source)> {
        if self.earliest > limit || self.earliest == NO_INSTANT {
            return None;
        }
        let at = self.earliest;
        let source = ALL.into_iter().find(|source| self.due[*source as usize] == at)?;
        self.set(source, NO_INSTANT);
        Some((at, source))
    }
}
