//! Keeps the amplifier at the gain that is wanted: writes it when it changes, and again, with pauses, while the bus
//! fails.

use crate::countdown::Countdown;
use crate::programmable_gain::{Gain, ProgrammableGain};
use embedded_hal::spi::SpiDevice;

/// The amplifier and the pause between failed tries.
#[derive(Clone, Debug)]
pub struct GainKeeper<S> {
    amplifier: ProgrammableGain<S>,
    pause_ticks: u64,
    /// Runs after a try that failed.
    pause: Option<Countdown>,
}

impl<S: SpiDevice> GainKeeper<S> {
    /// Takes over the amplifier; nothing is written yet. `pause_ticks`: between a failed try and the next.
    pub const fn new(amplifier: ProgrammableGain<S>, pause_ticks: u64) -> Self {
        Self { amplifier, pause_ticks, pause: None }
    }

    /// Sees to it that a gain is in use; to be called at least once per wrap of the tick counter.
    ///
    /// # Errors
    /// The bus's own, at the first of a series of failed tries: a broken bus is said once.
    pub fn follow(&mut self, gain: Gain, now: u32) -> Result<(), S::Error> {
        if self.in_use() == Some(gain) || self.pause.as_mut().is_some_and(|pause| !pause.poll(now)) {
            return Ok(());
        }
        let first_try = self.pause.is_none();
        let outcome = self.amplifier.set_gain(gain);
        self.pause = outcome.is_err().then(|| Countdown::start(self.pause_ticks, now));
        if first_try { outcome } else { Ok(()) }
    }

    /// The gain in use, for scaling amplitudes; `None` before the first and while it is in doubt.
    pub const fn in_use(&self) -> Option<Gain> {
        self.amplifier.in_use()
    }
}
