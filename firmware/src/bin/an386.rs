//! The node on QEMU's `mps2-an386`: runs a replayed record to its end and exits with success.
#![no_std]
#![no_main]

use cortex_m_rt::{ExceptionFrame, entry, exception};
use defmt_semihosting as _;
use meshband::replay::{CodeDigest, Drill, Replay};
use meshband_node::an386::{self, Board};
use semihosting::{eprintln, process};

#[entry]
fn main() -> ! {
    let record = match Replay::parse(an386::image()) {
        Ok(record) => record,
        Err(reason) => {
            eprintln!("node: no usable record in PSRAM: {reason:?}");
            process::exit(1)
        }
    };
    rehearse(record.header().drill);
    defmt::info!("record of {=u32} ticks, {=usize} edges", record.end_tick(), record.edge_count());
    let mut board = Board::start(record, 250);
    let mut digest = CodeDigest::new();
    let mut last = 0;
    loop {
        // Both are read before the queue: what they promise then holds for everything found in it.
        let (border, finished) = (board.next_border(), board.is_finished());
        match board.inbox.blocks.dequeue() {
            Some(block) => {
                while board.inbox.edge_before(block.end_tick()).is_some() {}
                digest.update(&block.codes[..]);
                last = block.sequence;
                let _ = board.inbox.free.enqueue(block.codes);
            }
            None if finished => break,
            None => {
                while board.inbox.edge_before(border).is_some() {}
                board.wait();
            }
        }
    }
    let statistics = board.statistics();
    eprintln!(
        "node: blocks={} lost={} missed={} edges={} edges_lost={} link_lost={} last_sequence={} codes_crc={:08x}",
        statistics.sampling.blocks,
        statistics.sampling.lost,
        statistics.sampling.missed,
        statistics.edges.0,
        statistics.edges.1,
        statistics.link_lost,
        last,
        digest.value(),
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
