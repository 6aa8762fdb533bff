//! The node on an STM32F405.
#![no_std]
#![no_main]

use cortex_m::singleton;
use cortex_m_rt::{ExceptionFrame, entry, exception};
use defmt_rtt as _;
use meshband::board::SampleClock;
use meshband::buffers::Buffers;
use meshband::events::EventKind;
use meshband::session::Session;
use meshband::store::Store;
use meshband_node::crash;
use meshband_node::runner::{BoardEvent, Runner};
use meshband_node::stm32f405::config_flash::ConfigFlash;
use meshband_node::stm32f405::{Board, TIME_BASE, power_up, set_light};
use meshband_stm32::clock::Oscillator;

#[entry]
fn main() -> ! {
    let power = power_up();
    // Lit until the main loop runs.
    set_light(true);
    match start(power.oscillator == Oscillator::Crystal) {
        Some((mut runner, mut board)) => {
            runner.session().node_mut().note(EventKind::Started, power.reset_cause as u32);
            if let Some(crash) = crash::last() {
                defmt::error!(
                    "restarted after crash {=u32} at {=str}:{=u32:x}",
                    crash.count,
                    crash.file(),
                    crash.place
                );
                runner.note(BoardEvent::Crash, crash.place);
            }
            let mut restarts = 0;
            loop {
                let worked = runner.turn(&mut board);
                runner.watch_stack(board.now());
                if board.restarts() != restarts {
                    restarts = board.restarts();
                    runner.note(BoardEvent::SamplingRestarted, restarts);
                }
                if !worked {
                    meshband::board::Supervision::wait(&mut board);
                }
            }
        }
        None => crash::record_and_reset(0, "start"),
    }
}

/// Configuration, node and board; `None` only if this ran before.
fn start(crystal: bool) -> Option<(Runner<ConfigFlash>, Board)> {
    let mut store = Store::new(ConfigFlash::take()?, 0);
    let (configuration, origin) = store.load(TIME_BASE.0);
    let wheel = configuration.tach;
    let buffers = singleton!(: Buffers = Buffers::ZERO)?;
    let mut session = Session::with_buffers(configuration, TIME_BASE, buffers).ok()?;
    if let Some(complaint) = origin.complaint() {
        session.node_mut().note(EventKind::ConfigurationRefused, complaint);
    }
    let period = session.node().requested_period_ticks();
    let mut runner = Runner::new(session, store, TIME_BASE, crystal);
    if !crystal {
        runner.note(BoardEvent::InternalOscillator, 0);
    }
    Some((runner, Board::start(period, &wheel)?))
}

/// Only ends the main loop's sleep.
#[exception]
fn SysTick() {}

/// The crystal has failed: start again, on the internal oscillator.
#[exception]
unsafe fn NonMaskableInt() -> ! {
    crash::record_and_reset(0, "crystal")
}

#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    crash::record_and_reset(frame.pc(), "")
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo) -> ! {
    crash::on_panic(info)
}
