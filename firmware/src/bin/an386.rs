//! The node on QEMU's `mps2-an386`: runs a replayed record to its end and exits with success.
//!
//! The configuration in force is the stored one, else the record's, else the default.
#![no_std]
#![no_main]

use core::mem::MaybeUninit;
use cortex_m_rt::{entry, exception};
use defmt_semihosting as _;
use meshband::board::{Link, Supervision};
use meshband::buffers::{Buffers, LentArrays};
use meshband::config::Configuration;
use meshband::events::EventKind;
use meshband::identity::Identity;
use meshband::message::Request;
use meshband::node::State;
use meshband::replay::{Drill, Replay, START_TICK};
use meshband::sample_ring::SampleRing;
use meshband::session::Session;
use meshband::store::{Origin, Store};
use meshband::units::TicksPerSecond;
use meshband_kit::golden;
use meshband_node::an386::flash::Flash;
use meshband_node::an386::registers::CLOCK_HZ;
use meshband_node::an386::{self, Board, Statistics, Wire};
use meshband_node::runner::{NodeCapture, NodeSession, Runner, open_capture};
use meshband_node::stack::{self, StackUse};
use semihosting::{eprintln, process};

const IDENTITY: Identity = Identity { board: "an386", build: meshband_node::BUILD, ..Identity::HOST };

/// The node's state, beside the stack as on the released board.
#[unsafe(link_section = ".core")]
static mut SESSION: MaybeUninit<NodeSession> = MaybeUninit::uninit();

/// The samples of the waveform it keeps.
#[unsafe(link_section = ".core")]
static mut SAMPLES: MaybeUninit<SampleRing> = MaybeUninit::uninit();

#[entry]
fn main() -> ! {
    // All zero bytes, hence in .bss.
    static mut BUFFERS: Buffers = Buffers::ZERO;
    static mut CAPTURE: MaybeUninit<NodeCapture> = MaybeUninit::uninit();
    let record = Replay::parse(an386::image()).unwrap_or_else(|reason| {
        eprintln!("node: no usable record in PSRAM: {reason:?}");
        process::exit(1)
    });
    rehearse(record.header().drill);
    if let Err(stage) = golden::self_test() {
        eprintln!("node: stage {} gives other bits here: {:#010x}", stage.stage, stage.hash);
        process::exit(1)
    }
    // That took much stack; what comes after it is measured by itself.
    let boot = stack::high_water();
    stack::repaint();
    operate(record, boot, BUFFERS, CAPTURE)
}

/// The node in operation.
#[inline(never)]
fn operate(
    record: Replay<'static>,
    boot: StackUse,
    buffers: &'static mut Buffers,
    capture: &'static mut MaybeUninit<NodeCapture>,
) -> ! {
    let mut store = Store::new(Flash::take(), 0);
    let (place, samples) = (&raw mut SESSION, &raw mut SAMPLES);
    // SAFETY: the only references to them, taken once: this function is entered once and never left.
    let (place, samples) = unsafe { (&mut *place, &mut *samples) };
    let arrays = LentArrays { buffers, capture: open_capture(capture, samples) };
    let session = place.write(open_session(&record, &mut store, arrays));
    let mut runner = Runner::new(session, store, TicksPerSecond(CLOCK_HZ), true);
    let mut wire = Wire::open();
    if record.header().waits_for_start {
        serve_until_start(&mut runner, &mut wire);
    }
    let mut board = Board::start(record, runner.session().node().requested_period_ticks(), wire);
    loop {
        // Read before the queue of blocks: what it promises then holds for everything found in it.
        let finished = board.is_finished();
        if !runner.turn(&mut board) {
            if finished {
                break;
            }
            board.wait();
        }
    }
    runner.on_request(Request::Statistics, &mut board);
    flush(&mut board.wire);
    // Before anything is printed: the node itself never formats text.
    let operation = stack::high_water();
    board.log().print();
    close(&board.statistics(), board.codes_crc(), boot, operation)
}

/// Stopped, with the link alone, until the host asks to start.
fn serve_until_start(runner: &mut Runner<Flash>, wire: &mut Wire) {
    runner.session().node_mut().on_request(Request::Stop);
    loop {
        runner.serve_link(wire);
        // No block tells the time here; the line itself does.
        if wire.is_empty() {
            runner.session().on_line_empty();
        }
        runner.session().send_messages(START_TICK, &mut |frame| {
            wire.send(frame);
        });
        wire.pump();
        // Before the sleep: behind a start request no other byte need come to end it.
        if runner.session().node().state() != State::Stopped {
            return;
        }
        wire.wait();
    }
}

/// Waits for a slow host, but not for one that no longer reads.
fn flush(wire: &mut Wire) {
    const PATIENCE: u32 = 10_000_000;
    let mut idle = 0;
    while !wire.is_empty() && idle < PATIENCE {
        idle = if wire.drain() > 0 { 0 } else { idle + 1 };
    }
}

/// The node with the stored or the record's configuration.
fn open_session(record: &Replay<'static>, store: &mut Store<Flash>, arrays: LentArrays<'static>) -> NodeSession {
    let fail = |what: &str, reason: &dyn core::fmt::Debug| -> ! {
        eprintln!("node: {what}: {reason:?}");
        process::exit(1)
    };
    let (stored, origin) = store.load(TicksPerSecond(CLOCK_HZ));
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
    let mut session =
        Session::with_arrays(config, clock, IDENTITY, arrays).unwrap_or_else(|e| fail("configuration", &e));
    if let Some(complaint) = origin.complaint() {
        session.node_mut().note(EventKind::ConfigurationRefused, complaint);
    }
    session
}

/// Prints the closing statistics and ends with success.
fn close(statistics: &Statistics, codes_crc: u32, boot: StackUse, operation: StackUse) -> ! {
    let (sampling, (edges, edges_lost)) = (statistics.sampling, statistics.edges);
    eprintln!(
        "node: blocks={} lost={} missed={} edges={edges} edges_lost={edges_lost} link_lost={} dropped={} \
         codes_crc={codes_crc:08x}",
        sampling.blocks, sampling.lost, sampling.missed, statistics.link_lost, statistics.frames_dropped,
    );
    eprintln!("node: stack_boot={} stack_operation={} stack_size={}", boot.used, operation.used, boot.size);
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

// SAFETY: no other symbol has this name; the entry of the fault (`meshband_node::fault`) calls it.
#[unsafe(no_mangle)]
extern "C" fn on_fault(program_counter: u32, stack_overflow: bool) -> ! {
    match stack_overflow {
        true => eprintln!("node: stack overflow"),
        false => eprintln!("node: hard fault at {program_counter:#010x}"),
    }
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
