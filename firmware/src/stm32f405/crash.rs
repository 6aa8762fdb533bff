//! What is known of the last crash, kept in memory that start-up does not clear.

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;

const MARK: u32 = 0x6d62_6372;

/// A crash: where, or nothing known about where.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Crash {
    mark: u32,
    /// Source line of a panic, program counter of a fault.
    pub place: u32,
    /// Crashes in a row since power came.
    pub count: u32,
    /// Guards against memory that never held a crash.
    check: u32,
}

#[repr(transparent)]
struct Kept(UnsafeCell<MaybeUninit<Crash>>);

// SAFETY: read by `last`, and written only by `record_and_reset` with interrupts off for good.
unsafe impl Sync for Kept {}

#[unsafe(link_section = ".uninit.CRASH")]
static CRASH: Kept = Kept(UnsafeCell::new(MaybeUninit::uninit()));

impl Crash {
    fn new(place: u32, count: u32) -> Self {
        Self { mark: MARK, place, count, check: !(MARK ^ place ^ count) }
    }

    fn is_sound(&self) -> bool {
        self.mark == MARK && self.check == !(self.mark ^ self.place ^ self.count)
    }
}

/// The crash that led to this start, if one did. It stays on record for the count of the next.
pub fn last() -> Option<Crash> {
    // SAFETY: any bit pattern is a valid `Crash`; the volatile read keeps the compiler from assuming what is there.
    let crash = unsafe { CRASH.0.get().cast::<Crash>().read_volatile() };
    crash.is_sound().then_some(crash)
}

/// Records a crash and starts the processor again.
pub fn record_and_reset(place: u32) -> ! {
    cortex_m::interrupt::disable();
    let count = last().map_or(1, |crash| crash.count.saturating_add(1));
    // SAFETY: interrupts are off and this function does not return, so nobody else looks.
    unsafe { CRASH.0.get().cast::<Crash>().write_volatile(Crash::new(place, count)) };
    cortex_m::peripheral::SCB::sys_reset()
}
