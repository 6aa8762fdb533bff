//! What is known of the last crash, kept in a page of RAM of its own (`memory.x`) that start-up does not touch.
//!
//! The page outlives resets and new images, not a loss of power. Debuggers find it at the symbol `CRASH`.

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use meshband::safe_start::{Start, failures_at};

const MARK: u32 = 0x6d62_6372;
/// Bytes of a source file's name that are kept, from its end.
const NAME: usize = 48;

/// Reasons to start again that are no panic and have no address; they take the place of a source line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Cause {
    /// The PLL did not lock.
    Pll = 1,
    /// The crystal stopped while running.
    Crystal = 2,
    /// A part of the board was started twice.
    Start = 3,
    /// The stack grew beyond its memory.
    StackOverflow = 4,
    /// An interrupt came that nobody unmasked.
    Interrupt = 5,
}

/// A crash: where, or nothing known about where.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Crash {
    mark: u32,
    /// Source line of a panic, program counter of a fault, or a [`Cause`].
    pub place: u32,
    /// Failures in a row, restarts by the watchdog among them ([`meshband::safe_start`]).
    pub count: u32,
    /// End of the source file's name, zeros behind; empty for a fault.
    file: [u8; NAME],
    /// Guards against memory that never held a crash.
    check: u32,
}

#[repr(transparent)]
struct Kept(UnsafeCell<MaybeUninit<Crash>>);

// SAFETY: read by `last`; written by the main loop, and by `record_and_reset` with interrupts off for good.
unsafe impl Sync for Kept {}

#[unsafe(link_section = ".crash")]
#[unsafe(no_mangle)]
static CRASH: Kept = Kept(UnsafeCell::new(MaybeUninit::uninit()));

impl Crash {
    fn sum(&self) -> u32 {
        let name = self.file.iter().fold(0u32, |sum, &byte| sum.rotate_left(5) ^ u32::from(byte));
        !(self.mark ^ self.place ^ self.count.rotate_left(16) ^ name)
    }

    fn is_sound(&self) -> bool {
        self.mark == MARK && self.check == self.sum()
    }

    /// End of the source file's name; empty for a fault.
    pub fn file(&self) -> &str {
        self.file.split(|&byte| byte == 0).next().and_then(|name| core::str::from_utf8(name).ok()).unwrap_or_default()
    }
}

/// The crash that led to this start, if one did. It stays on record for the count of the next.
pub fn last() -> Option<Crash> {
    // SAFETY: any bit pattern is a valid `Crash`; the volatile read keeps the compiler from assuming what is there.
    let crash = unsafe { CRASH.0.get().cast::<Crash>().read_volatile() };
    crash.is_sound().then_some(crash)
}

/// Counts a start after a failure, or ends the count; gives the failures in a row.
pub fn count_start(start: Start) -> u32 {
    let kept = last();
    let failures = failures_at(start, kept.map(|crash| crash.count));
    if failures != kept.map_or(0, |crash| crash.count) {
        set_count(failures);
    }
    failures
}

/// Ends the count of failures in a row: the node has run well, or was given another configuration.
pub fn forgive() {
    if last().is_some_and(|crash| crash.count != 0) {
        set_count(0);
    }
}

/// Writes the count alone; the record of the last crash stays.
fn set_count(count: u32) {
    let none = Crash { mark: MARK, place: 0, count: 0, file: [0; NAME], check: 0 };
    let mut crash = Crash { count, ..last().unwrap_or(none) };
    crash.check = crash.sum();
    write(crash);
}

fn write(crash: Crash) {
    // SAFETY: called from the main loop and, with interrupts off for good, by what does not return: nobody else looks.
    unsafe { CRASH.0.get().cast::<Crash>().write_volatile(crash) };
}

/// Records a crash and starts the processor again.
fn record_and_reset(place: u32, file: &str) -> ! {
    cortex_m::interrupt::disable();
    let count = last().map_or(1, |crash| crash.count.saturating_add(1));
    let mut crash = Crash { mark: MARK, place, count, file: [0; NAME], check: 0 };
    let skipped = file.len().saturating_sub(NAME);
    for (kept, byte) in crash.file.iter_mut().zip(file.bytes().skip(skipped)) {
        *kept = byte;
    }
    crash.check = crash.sum();
    write(crash);
    cortex_m::peripheral::SCB::sys_reset()
}

/// Starts the processor again without a failure: nothing is on record afterwards, and nothing counts.
pub fn restart() -> ! {
    cortex_m::interrupt::disable();
    write(Crash { mark: 0, place: 0, count: 0, file: [0; NAME], check: 0 });
    cortex_m::peripheral::SCB::sys_reset()
}

/// Records one of the known causes and starts the processor again.
pub fn on_cause(cause: Cause) -> ! {
    record_and_reset(cause as u32, "")
}

/// What a board does on a fault, see [`crate::fault`].
pub fn on_fault(program_counter: u32, stack_overflow: bool) -> ! {
    if stack_overflow { on_cause(Cause::StackOverflow) } else { record_and_reset(program_counter, "") }
}

/// What the panic handler of an image does.
pub fn on_panic(info: &PanicInfo) -> ! {
    let (place, file) = info.location().map_or((0, ""), |place| (place.line(), place.file()));
    record_and_reset(place, file)
}

/// Defines what every image does that restarts after a failure: the hooks of a panic, of a fault
/// ([`mod@crate::fault`]) and of an interrupt that nobody unmasked.
#[macro_export]
macro_rules! restart_on_failure {
    () => {
        // SAFETY: no other symbol has this name; the entry of the fault calls it.
        #[unsafe(no_mangle)]
        extern "C" fn on_fault(program_counter: u32, stack_overflow: bool) -> ! {
            $crate::crash::on_fault(program_counter, stack_overflow)
        }

        #[cortex_m_rt::exception]
        unsafe fn DefaultHandler(_number: i16) -> ! {
            $crate::crash::on_cause($crate::crash::Cause::Interrupt)
        }

        #[panic_handler]
        fn panic(info: &core::panic::PanicInfo) -> ! {
            $crate::crash::on_panic(info)
        }
    };
}
