//! State that belongs to one interrupt handler, or to some that never interrupt each other.

use core::cell::UnsafeCell;

/// A place that is filled once, before its interrupts are unmasked, and then used by their handlers alone, which
/// share one priority. No lock and no check at run time, hence nothing that can fail in a handler.
pub struct InterruptCell<T>(UnsafeCell<Option<T>>);

// SAFETY: the contracts of the two functions leave one user at a time.
unsafe impl<T: Send> Sync for InterruptCell<T> {}

impl<T> InterruptCell<T> {
    /// An empty place.
    pub const fn new() -> Self {
        Self(UnsafeCell::new(None))
    }

    /// Fills the place.
    ///
    /// # Safety
    /// The handlers' interrupts must be masked.
    pub unsafe fn install(&self, state: T) {
        // SAFETY: nobody else looks while the interrupts are masked.
        unsafe { *self.0.get() = Some(state) }
    }

    /// Lends the state to the handler; nothing happens while there is none.
    ///
    /// # Safety
    /// Only to be called by handlers of one priority: none can interrupt another, or itself.
    pub unsafe fn with(&self, handle: impl FnOnce(&mut T)) {
        // SAFETY: after `install` the handler that runs is the only user.
        if let Some(state) = unsafe { (*self.0.get()).as_mut() } {
            handle(state);
        }
    }
}

impl<T> Default for InterruptCell<T> {
    fn default() -> Self {
        Self::new()
    }
}
