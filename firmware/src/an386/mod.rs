//! QEMU's `mps2-an386`: a Cortex-M4F whose converter and tachometer replay a record from PSRAM.
//!
//! Interrupts share one priority, so none interrupts another; what they share with the main loop goes
//! through queues. No device crate exists for this board: all interrupts arrive in one dispatcher.

pub mod registers;
pub mod sampler;
pub mod tach;
pub mod time;
pub mod uart;

use crate::pipeline::{BUFFERS, Codes, EDGE_QUEUE, Filled, Inbox, Request};
use core::cell::RefCell;
use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::NVIC;
use cortex_m::singleton;
use critical_section::Mutex;
use heapless::spsc::{Consumer, Queue};
use meshband::replay::{IMAGE_ADDRESS, IMAGE_CAPACITY, Replay};
use sampler::{Counters, Sampler};
use tach::Tach;
use time::TimeBase;
use uart::{Receiver, Sender};

/// Bytes received that may wait for the main loop.
const RECEIVE_QUEUE: usize = 256;

/// Interrupt numbers of this board.
#[derive(Clone, Copy)]
#[repr(u16)]
enum Line {
    UartReceive = 0,
    SampleClock = 8,
    Tach = 9,
}

// SAFETY: the numbers are those of application note AN386, and a `Line` never changes its number.
unsafe impl InterruptNumber for Line {
    fn number(self) -> u16 {
        self as u16
    }
}

/// What the interrupts own.
struct Interrupts {
    sampler: Sampler,
    tach: Tach,
    receiver: Receiver,
}

static INTERRUPTS: Mutex<RefCell<Option<Interrupts>>> = Mutex::new(RefCell::new(None));
static REQUEST: Request = Request::new();

/// The board as the main loop sees it.
pub struct Board {
    /// Blocks and edges.
    pub inbox: Inbox,
    /// The link's sending side.
    pub sender: Sender,
    /// Bytes from the link.
    pub received: Consumer<'static, u8>,
}

/// Closing statistics of a run.
#[derive(Debug, Clone, Copy)]
pub struct Statistics {
    /// Of the sample clock.
    pub sampling: Counters,
    /// Edges delivered and lost.
    pub edges: (usize, u32),
    /// Bytes of the link lost on reception.
    pub link_lost: u32,
}

/// The replay image as QEMU's loader left it.
pub fn image() -> &'static [u8] {
    // SAFETY: AN386 has 16 MiB of PSRAM there; the linker places nothing in it and nobody writes to it.
    unsafe { core::slice::from_raw_parts(IMAGE_ADDRESS as *const u8, IMAGE_CAPACITY) }
}

impl Board {
    /// Starts the time base, the sample clock at `period_ticks` and the tachometer.
    ///
    /// # Panics
    /// When called twice: the queues exist once.
    pub fn start(record: Replay<'static>, period_ticks: u32) -> Self {
        let once = "the board is started once";
        let (blocks_in, blocks) = singleton!(: Queue<Filled, { BUFFERS + 1 }> = Queue::new()).expect(once).split();
        let (mut free, free_out) =
            singleton!(: Queue<&'static mut Codes, { BUFFERS + 1 }> = Queue::new()).expect(once).split();
        let (edges_in, edges) = singleton!(: Queue<u32, EDGE_QUEUE> = Queue::new()).expect(once).split();
        let (bytes_in, received) = singleton!(: Queue<u8, RECEIVE_QUEUE> = Queue::new()).expect(once).split();
        let buffers = singleton!(: [Codes; BUFFERS] = [[0; _]; BUFFERS]).expect(once);
        for buffer in buffers {
            // The queue holds one more than there are buffers.
            let _ = free.enqueue(buffer);
        }
        REQUEST.publish(period_ticks);
        let (sender, receiver) = uart::open(bytes_in);
        critical_section::with(|token| {
            let time = TimeBase::start();
            let mut sampler = Sampler::new(registers::timer0(), time, record, blocks_in, free_out, &REQUEST);
            let mut tach = Tach::new(registers::timer1(), time, record, edges_in);
            sampler.start();
            tach.start();
            INTERRUPTS.borrow_ref_mut(token).replace(Interrupts { sampler, tach, receiver });
        });
        for line in [Line::UartReceive, Line::SampleClock, Line::Tach] {
            // SAFETY: the state the handler works on is complete, and nothing relies on this line being masked.
            unsafe { NVIC::unmask(line) };
        }
        Self { inbox: Inbox { blocks, free, edges }, sender, received }
    }

    /// Publishes the node's wish for the next border.
    pub fn request_period(&self, period_ticks: u32) {
        REQUEST.publish(period_ticks);
    }

    /// Whether the record has ended. Blocks may still wait in the queue.
    pub fn is_finished(&self) -> bool {
        with_interrupts(|i| i.sampler.is_finished())
    }

    /// The border behind the block that is running now: every edge before it is known to precede that block's end.
    pub fn next_border(&self) -> u32 {
        TimeBase::stamp(with_interrupts(|i| i.sampler.next_border()))
    }

    /// Sleeps until an interrupt, unless there is something to do.
    pub fn wait(&self) {
        critical_section::with(|_| {
            // With interrupts masked a pending one still ends the sleep, so none can slip through in between.
            if !self.inbox.blocks.ready() && !self.received.ready() {
                cortex_m::asm::wfi();
            }
        });
    }

    /// Counters so far.
    pub fn statistics(&self) -> Statistics {
        with_interrupts(|i| Statistics {
            sampling: i.sampler.counters,
            edges: (i.tach.delivered(), i.tach.lost),
            link_lost: i.receiver.lost,
        })
    }
}

/// The interrupts' state from the main loop; [`Board`] exists only after it was put there.
fn with_interrupts<T>(read: impl FnOnce(&Interrupts) -> T) -> T {
    critical_section::with(|token| {
        let interrupts = INTERRUPTS.borrow_ref(token);
        read(interrupts.as_ref().expect("a board exists only after its interrupts"))
    })
}

/// Dispatches a device interrupt by its number.
pub fn on_interrupt(number: i16) {
    critical_section::with(|token| {
        if let Some(interrupts) = INTERRUPTS.borrow_ref_mut(token).as_mut() {
            match number {
                0 => interrupts.receiver.on_interrupt(),
                8 => interrupts.sampler.on_interrupt(),
                9 => interrupts.tach.on_interrupt(),
                other => defmt::panic!("interrupt {=i16} is not ours", other),
            }
        }
    });
}
