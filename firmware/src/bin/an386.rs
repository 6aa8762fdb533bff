//! The node on QEMU's `mps2-an386`: runs a replayed record to its end and exits with success.
#![no_std]
#![no_main]

use cortex_m_rt::{ExceptionFrame, entry, exception};
use defmt_semihosting as _;
use meshband::buffers::Buffers;
use meshband::config::Configuration;
use meshband::message::Request;
use meshband::replay::{CodeDigest, Drill, Replay};
use meshband::session::Session;
use meshband::units::TicksPerSecond;
use meshband_node::an386::registers::CLOCK_HZ;
use meshband_node::an386::{self, Board, Statistics};
use semihosting::{eprintln, process};

#[entry]
fn main() -> ! {
    // All zero bytes, hence in .bss; the rest of the node is small enough for the stack.
    static mut BUFFERS: Buffers = Buffers::ZERO;
    let record = Replay::parse(an386::image()).unwrap_or_else(|reason| {
        eprintln!("node: no usable record in PSRAM: {reason:?}");
        process::exit(1)
    });
    rehearse(record.header().drill);
    let mut session = open_session(&record, BUFFERS);
    let mut board = Board::start(record, session.node().requested_period_ticks());
    let mut digest = CodeDigest::new();
    loop {
        // Both are read before the queue: what they promise then holds for everything found in it.
        let (border, finished) = (board.next_border(), board.is_finished());
        let Board { inbox, sender, received } = &mut board;
        let mut send = |frame: &[u8]| sender.send(frame);
        while let Some(byte) = received.dequeue() {
            session.on_byte(byte, &mut send);
        }
        if let Some(block) = inbox.blocks.dequeue() {
            while let Some(edge) = inbox.edge_before(block.end_tick()) {
                session.on_edge(edge);
            }
            digest.update(&block.codes[..]);
            session.on_block(block.as_block(), &mut send);
            // The queue of empty buffers has room for all of them.
            let _ = inbox.free.enqueue(block.codes);
            board.request_period(session.node().requested_period_ticks());
        } else if finished {
            break;
        } else {
            while let Some(edge) = inbox.edge_before(border) {
                session.on_edge(edge);
            }
            board.wait();
        }
    }
    session.on_request(Request::Statistics, &mut |frame| board.sender.send(frame));
    close(&board.statistics(), digest.value())
}

/// The node with the record's configuration.
fn open_session(record: &Replay<'static>, buffers: &'static mut Buffers) -> Session<&'static mut Buffers> {
    let fail = |what: &str, reason: &dyn core::fmt::Debug| -> ! {
        eprintln!("node: {what}: {reason:?}");
        process::exit(1)
    };
    let config: Configuration = if record.configuration().is_empty() {
        Configuration::default()
    } else {
        postcard::from_bytes(record.configuration()).unwrap_or_else(|e| fail("configuration not understood", &e))
    };
    let clock = TicksPerSecond(record.header().ticks_per_second);
    if clock.0 != CLOCK_HZ {
        fail("the record is for another time base", &clock);
    }
    Session::with_buffers(config, clock, buffers).unwrap_or_else(|e| fail("configuration", &e))
}

/// Prints the closing statistics and ends with success.
fn close(statistics: &Statistics, codes_crc: u32) -> ! {
    let (sampling, (edges, edges_lost)) = (statistics.sampling, statistics.edges);
    eprintln!(
        "node: blocks={} lost={} missed={} edges={edges} edges_lost={edges_lost} link_lost={} codes_crc={codes_crc:08x}",
        sampling.blocks, sampling.lost, sampling.missed, statistics.link_lost,
    );
    eprintln!("node: finished");
    process::exit(0)
}

/// Stages the failure the record asks for.
fn rehearse(drill: Drill) {
    match drill {
        Drill::None => {}
        Drill::Panic => panic!("staged by the record"),
        Drill::Hang => loop {
            cortex_m::asm::wfi();
        },
        // An exception inside the fault handler cannot be taken: the core locks up.
        Drill::LockUp => cortex_m::interrupt::free(|_| cortex_m::asm::udf()),
        Drill::StackOverflow => {
            let depth = overflow(1);
            eprintln!("node: the stack survived {depth} levels");
        }
    }
}

/// Recurses without end, with a frame the compiler cannot remove.
#[inline(never)]
fn overflow(depth: u32) -> u32 {
    let frame = core::hint::black_box([depth; 256]);
    if core::hint::black_box(true) { overflow(depth + 1) + frame[depth as usize % 256] } else { depth }
}

#[exception]
unsafe fn DefaultHandler(number: i16) {
    an386::on_interrupt(number);
}

#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    eprintln!("node: hard fault at {:#010x}", frame.pc());
    process::exit(3)
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo) -> ! {
    cortex_m::interrupt::disable();
    match info.location() {
        Some(place) => eprintln!("node: panic at {}:{}: {}", place.file(), place.line(), info.message()),
        None => eprintln!("node: panic: {}", info.message()),
    }
    process::exit(2)
}
