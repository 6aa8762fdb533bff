//! Places between two steps at which a test kills the process. In the program itself they are nothing.

/// Here a kill may come.
#[cfg(not(test))]
#[inline]
pub fn point() {}

/// Points that are left until the process ends; 0 for ever.
#[cfg(test)]
static LEFT: std::sync::atomic::AtomicU64 = std::sync::atomic::AtomicU64::new(0);

/// Here a kill may come.
#[cfg(test)]
pub fn point() {
    use std::sync::atomic::Ordering;
    if LEFT.load(Ordering::Relaxed) > 0 && LEFT.fetch_sub(1, Ordering::Relaxed) == 1 {
        // As SIGKILL: nothing is put in order.
        std::process::abort();
    }
}

/// Ends the process at the point of this number from here on.
#[cfg(test)]
pub fn at(point: u64) {
    LEFT.store(point, std::sync::atomic::Ordering::Relaxed);
}
