//! State that belongs to one interrupt handler.

use core::cell::UnsafeCell;

/// A place that is filled once, before its interrupt is unmasked, and then used by that handler alone. No lock and no
/// check at run time, hence nothing that can fail in a handler.
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
    /// The handler's interrupt must be masked.
    pub unsafe fn install(&self, state: T) {
        // SAFETY: nobody else looks while the interrupt is masked.
        unsafe { *self.0.get() = Some(state) }
    }

    /// Lends the state to the handler; nothing happens while there is none.
    ///
    /// # Safety
    /// Only to be called by the one handler, which cannot interrupt itself.
    pub unsafe fn with(&self, handle: impl FnOnce(&mut T)) {
        // SAFETY: after `install` the handler is the only user.
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
