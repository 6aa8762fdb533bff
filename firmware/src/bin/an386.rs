//! The node on QEMU's `mps2-an386`: runs a replayed record to its end and exits with success.
//!
//! The configuration in force is the stored one, else the record's, else the default.
#![no_std]
#![no_main]

use cortex_m_rt::{ExceptionFrame, entry, exception};
use defmt_semihosting as _;
use meshband::buffers::Buffers;
use meshband::config::Configuration;
use meshband::events::EventKind;
use meshband::message::Request;
use meshband::node::State;
use meshband::replay::{CodeDigest, Drill, Replay, START_TICK};
use meshband::self_test::BootTest;
use meshband::session::BoardSession;
use meshband::store::{Origin, Store};
use meshband::units::TicksPerSecond;
use meshband_node::an386::flash::Flash;
use meshband_node::an386::registers::CLOCK_HZ;
use meshband_node::an386::{self, Board, Link, Outgoing, Statistics};
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
    let mut store = Store::new(Flash::take(), 0);
    let mut session = open_session(&record, &mut store, BUFFERS);
    let mut test = BootTest::new(TicksPerSecond(CLOCK_HZ));
    session.node_mut().set_self_test(test.result());
    let mut link = Link::open();
    if record.header().waits_for_start {
        serve_until_start(&mut session, &mut link, &mut store);
    }
    let mut board = Board::start(record, session.node().requested_period_ticks(), link);
    let mut digest = CodeDigest::new();
    loop {
        // Both are read before the queue: what they promise then holds for everything found in it.
        let (border, finished, now) = (board.next_border(), board.is_finished(), board.now());
        let Board { inbox, link: Link { received, outgoing } } = &mut board;
        outgoing.pump();
        let mut send = |frame: &[u8]| outgoing.send(frame);
        while let Some(byte) = received.dequeue() {
            session.on_byte(byte, &mut send);
        }
        if session.take_commit() {
            commit(&mut session, &mut store);
        }
        if let Some(block) = inbox.blocks.dequeue() {
            while let Some(edge) = inbox.edge_before(block.end_tick()) {
                test.on_edge();
                session.on_edge(edge);
            }
            digest.update(&block.codes[..]);
            if let Some(result) = test.on_block(&block.as_block(), now) {
                session.node_mut().set_self_test(result);
            }
            session.on_block(block.as_block(), &mut send);
            if let Some(frames) = outgoing.take_dropped() {
                session.node_mut().note(EventKind::MessagesDropped, frames);
            }
            // The queue of empty buffers has room for all of them.
            let _ = inbox.free.enqueue(block.codes);
            board.request_period(session.node().requested_period_ticks());
        } else if finished {
            break;
        } else {
            while let Some(edge) = inbox.edge_before(border) {
                test.on_edge();
                session.on_edge(edge);
            }
            board.wait();
        }
    }
    session.on_request(Request::Statistics, &mut |frame| board.link.outgoing.send(frame));
    flush(&mut board.link.outgoing);
    close(&board.statistics(), digest.value())
}

/// Stopped, with the link alone, until the host asks to start.
fn serve_until_start(session: &mut BoardSession, link: &mut Link, store: &mut Store<Flash>) {
    let Link { received, outgoing } = link;
    session.node_mut().on_request(Request::Stop);
    loop {
        let mut send = |frame: &[u8]| outgoing.send(frame);
        while let Some(byte) = received.dequeue() {
            session.on_byte(byte, &mut send);
        }
        if session.take_commit() {
            commit(session, store);
        }
        session.send_messages(START_TICK, &mut send);
        outgoing.pump();
        if session.node().state() != State::Stopped {
            return;
        }
        an386::wait(received, outgoing);
    }
}

/// Stores the configuration in force; the outcome goes out as an event.
fn commit(session: &mut BoardSession, store: &mut Store<Flash>) {
    let stored = store.save(session.node().configuration()).is_ok();
    session.on_stored(stored);
}

/// Waits for a slow host, but not for one that no longer reads.
fn flush(outgoing: &mut Outgoing) {
    const PATIENCE: u32 = 10_000_000;
    let mut idle = 0;
    while !outgoing.is_empty() && idle < PATIENCE {
        idle = if outgoing.pump() > 0 { 0 } else { idle + 1 };
    }
}

/// The node with the stored or the record's configuration, with its arrays in memory of their own.
fn open_session(record: &Replay<'static>, store: &mut Store<Flash>, buffers: &'static mut Buffers) -> BoardSession {
    let fail = |what: &str, reason: &dyn core::fmt::Debug| -> ! {
        eprintln!("node: {what}: {reason:?}");
        process::exit(1)
    };
    let (stored, origin) = store.load(CLOCK_HZ);
    let config: Configuration = if matches!(origin, Origin::Stored | Origin::Former) {
        stored
    } else if record.configuration().is_empty() {
        Configuration::default()
    } else {
        postcard::from_bytes(record.configuration()).unwrap_or_else(|e| fail("configuration not understood", &e))
    };
    let clock = TicksPerSecond(record.header().ticks_per_second);
    if clock.0 != CLOCK_HZ {
        fail("the record is for another time base", &clock);
    }
    let mut session = BoardSession::with_buffers(config, clock, buffers).unwrap_or_else(|e| fail("configuration", &e));
    if let Some(complaint) = origin.complaint() {
        session.node_mut().note(EventKind::ConfigurationRefused, complaint);
    }
    session
}

/// Prints the closing statistics and ends with success.
fn close(statistics: &Statistics, codes_crc: u32) -> ! {
    let (sampling, (edges, edges_lost)) = (statistics.sampling, statistics.edges);
    eprintln!(
        "node: blocks={} lost={} missed={} edges={edges} edges_lost={edges_lost} link_lost={} dropped={} \
         codes_crc={codes_crc:08x}",
        sampling.blocks, sampling.lost, sampling.missed, statistics.link_lost, statistics.frames_dropped,
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
