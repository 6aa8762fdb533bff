//! QEMU's `mps2-an386`: a Cortex-M4F whose converter and tachometer replay a record from PSRAM.
//!
//! Interrupts share one priority, so none interrupts another; what they share with the main loop goes
//! through queues. No device crate exists for this board: all interrupts arrive in one dispatcher.

pub mod block_log;
pub mod flash;
pub mod registers;
pub mod sampler;
pub mod tach;
pub mod time;
pub mod uart;

use self::block_log::BlockLog;
use core::cell::RefCell;
use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::NVIC;
use cortex_m::singleton;
use critical_section::Mutex;
use heapless::spsc::{Consumer, Queue};
use meshband::board::{BlockSource, Housekeeping, Link, SampleClock, Supervision, TachCapture};
use meshband::link::QUEUE;
use meshband::link::send_ring::SendRing;
use meshband::node::Block;
use meshband::pipeline::{Codes, Inbox, Queues, Request};
use meshband::replay::{CodeDigest, IMAGE_ADDRESS, IMAGE_CAPACITY, Replay};
use meshband::units::TicksPerSecond;
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
}

static INTERRUPTS: Mutex<RefCell<Option<Interrupts>>> = Mutex::new(RefCell::new(None));
static RECEIVER: Mutex<RefCell<Option<Receiver>>> = Mutex::new(RefCell::new(None));
/// Block buffers: at 400 kHz they hold 20 ms.
const BUFFERS: usize = 16;

static REQUEST: Request = Request::new();

/// The link as the main loop sees it; it works before the board's sampling does. Whole frames wait for the line; they
/// are dropped where the host does not read.
pub struct Wire {
    received: Consumer<'static, u8>,
    sender: Sender,
    ring: &'static mut SendRing<QUEUE>,
}

impl Wire {
    /// Opens the link.
    ///
    /// # Panics
    /// When called twice: the queues exist once.
    pub fn open() -> Self {
        let once = "the link is opened once";
        let (bytes_in, received) = singleton!(: Queue<u8, RECEIVE_QUEUE> = Queue::new()).expect(once).split();
        let ring = singleton!(: SendRing<QUEUE> = SendRing::new()).expect(once);
        let (sender, receiver) = uart::open(bytes_in);
        critical_section::with(|token| RECEIVER.borrow_ref_mut(token).replace(receiver));
        // SAFETY: the state the handler works on is complete, and nothing relies on this line being masked.
        unsafe { NVIC::unmask(Line::UartReceive) };
        Self { received, sender, ring }
    }

    /// Passes on what the line takes; gives the number of bytes.
    pub fn drain(&mut self) -> usize {
        self.ring.drain(|byte| self.sender.send(byte))
    }

    /// Whether everything was sent.
    pub fn is_empty(&self) -> bool {
        self.ring.is_empty()
    }

    /// Sleeps until an interrupt, unless bytes wait on either side.
    pub fn wait(&self) {
        critical_section::with(|_| {
            if !self.received.ready() && self.ring.is_empty() {
                cortex_m::asm::wfi();
            }
        });
    }
}

impl Link for Wire {
    fn send(&mut self, frame: &[u8]) -> bool {
        self.drain();
        let queued = self.ring.push(frame);
        self.drain();
        queued
    }

    fn receive(&mut self) -> Option<u8> {
        self.received.dequeue()
    }

    fn pump(&mut self) {
        self.drain();
    }

    fn take_dropped(&mut self) -> Option<u32> {
        self.ring.take_unreported()
    }
}

/// The board as the main loop sees it.
pub struct Board {
    inbox: Inbox,
    /// Blocks given up by the main loop.
    given_up: u32,
    digest: CodeDigest,
    log: &'static mut BlockLog,
    /// Bytes from and to the host.
    pub wire: Wire,
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
    /// Frames that found no room on the way out.
    pub frames_dropped: u32,
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
    pub fn start(record: Replay<'static>, period_ticks: u32, wire: Wire) -> Self {
        let once = "the board is started once";
        let buffers = singleton!(: [Codes; BUFFERS] = [[0; _]; BUFFERS]).expect(once);
        let (outlets, inbox) = singleton!(: Queues = Queues::new()).expect(once).split(buffers);
        let log = singleton!(: BlockLog = BlockLog::new()).expect(once);
        REQUEST.publish(period_ticks);
        critical_section::with(|token| {
            let time = TimeBase::start();
            let mut sampler = Sampler::new(registers::timer0(), time, record, outlets.blocks, outlets.free, &REQUEST);
            let mut tach = Tach::new(registers::timer1(), time, record, outlets.edges);
            sampler.start();
            tach.start();
            INTERRUPTS.borrow_ref_mut(token).replace(Interrupts { sampler, tach });
        });
        for line in [Line::SampleClock, Line::Tach] {
            // SAFETY: the state the handler works on is complete, and nothing relies on this line being masked.
            unsafe { NVIC::unmask(line) };
        }
        Self { inbox, given_up: 0, digest: CodeDigest::new(), log, wire }
    }

    /// Whether the record has ended. Blocks may still wait in the queue.
    pub fn is_finished(&self) -> bool {
        with_interrupts(|i| i.sampler.is_finished())
    }

    /// Checksum of all codes handed over, as the host computes it.
    pub fn codes_crc(&self) -> u32 {
        self.digest.value()
    }

    /// The blocks handed over.
    pub fn log(&self) -> &BlockLog {
        self.log
    }

    /// Counters so far.
    pub fn statistics(&self) -> Statistics {
        with_interrupts(|i| Statistics {
            sampling: i.sampler.counters.with_given_up(self.given_up),
            edges: (i.tach.delivered(), i.tach.lost),
            link_lost: critical_section::with(|token| RECEIVER.borrow_ref(token).as_ref().map_or(0, |r| r.lost)),
            frames_dropped: self.wire.ring.dropped(),
        })
    }
}

impl SampleClock for Board {
    fn time_base(&self) -> TicksPerSecond {
        TicksPerSecond(registers::CLOCK_HZ)
    }

    fn now(&self) -> u32 {
        TimeBase::stamp(with_interrupts(|i| i.sampler.now()))
    }

    fn set_period_ticks(&mut self, period: u32) {
        REQUEST.publish(period);
    }
}

impl BlockSource for Board {
    fn horizon(&self) -> u32 {
        TimeBase::stamp(with_interrupts(|i| i.sampler.horizon()))
    }

    fn catch_up(&mut self) {
        self.given_up += self.inbox.catch_up();
    }

    fn most_waiting(&self) -> u32 {
        // QEMU's pace is no processor's: what waits here says nothing, and the host that sends the same frames has no
        // queue.
        0
    }

    fn pending_end(&self) -> Option<u32> {
        self.inbox.pending_end()
    }

    fn with_block(&mut self, consume: &mut dyn FnMut(Block<'_>)) -> bool {
        let (digest, log) = (&mut self.digest, &mut *self.log);
        self.inbox.with_block(|block| {
            digest.update(&block.codes[..]);
            log.append(block);
            consume(block.as_block());
        })
    }
}

impl TachCapture for Board {
    fn next_edge_before(&mut self, tick: u32) -> Option<u32> {
        self.inbox.edge_before(tick)
    }

    fn lost_edges(&self) -> u32 {
        with_interrupts(|i| i.tach.lost)
    }
}

impl Link for Board {
    fn send(&mut self, frame: &[u8]) -> bool {
        self.wire.send(frame)
    }

    fn receive(&mut self) -> Option<u8> {
        self.wire.receive()
    }

    fn pump(&mut self) {
        self.wire.pump();
    }

    fn take_dropped(&mut self) -> Option<u32> {
        self.wire.take_dropped()
    }
}

/// QEMU needs neither watchdog nor light.
/// A virtual board has no supply, no temperature, and no pulse per second.
impl Housekeeping for Board {}

impl Supervision for Board {
    fn feed_watchdog(&mut self) {}

    fn set_light(&mut self, _lit: bool) {}

    fn wait(&mut self) {
        critical_section::with(|_| {
            // With interrupts masked a pending one still ends the sleep, so none can slip through in between.
            if !self.inbox.has_block() && !self.wire.received.ready() {
                cortex_m::asm::wfi();
            }
        });
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
        if number == Line::UartReceive as i16 {
            if let Some(receiver) = RECEIVER.borrow_ref_mut(token).as_mut() {
                receiver.on_interrupt();
            }
        } else if let Some(interrupts) = INTERRUPTS.borrow_ref_mut(token).as_mut() {
            match number {
                8 => interrupts.sampler.on_interrupt(),
                9 => interrupts.tach.on_interrupt(),
                other => defmt::panic!("interrupt {=i16} is not ours", other),
            }
        }
    });
}
