//! The node on an STM32F405.
#![no_std]
#![no_main]

use cortex_m::singleton;
use cortex_m_rt::{entry, exception};
use defmt_rtt as _;
use meshband::buffers::Buffers;
use meshband::self_test::BootTest;
use meshband::store::Store;
use meshband_node::crash::{self, Cause};
use meshband_node::runner::{BoardEvent, Runner};
use meshband_node::stm32f405::config_flash::ConfigFlash;
use meshband_node::stm32f405::{Board, Power, TIME_BASE, power_up, set_light};
use meshband_stm32::clock::Oscillator;
use meshband_stm32::reset::ResetCause;

meshband_node::restart_on_failure!();

#[entry]
fn main() -> ! {
    let power = power_up();
    // Lit until the main loop runs.
    set_light(true);
    operate(&power, BootTest::new(TIME_BASE))
}

/// The node in operation. Not part of `main`, so that the self-test above does not lie on top of the node on the stack.
#[inline(never)]
fn operate(power: &Power, test: BootTest) -> ! {
    let (Some(flash), Some(buffers)) = (ConfigFlash::take(), singleton!(: Buffers = Buffers::ZERO)) else {
        crash::on_cause(Cause::Start)
    };
    let crystal = power.oscillator == Oscillator::Crystal;
    let mut runner = Runner::open(Store::new(flash, 0), test, TIME_BASE, crystal, buffers);
    runner.report_start(power.reset_cause as u32, power.reset_cause == ResetCause::Software);
    let node = runner.session().node();
    let (wheel, period) = (node.configuration().tach, node.requested_period_ticks());
    let Some(mut board) = Board::start(period, &wheel) else { crash::on_cause(Cause::Start) };
    let mut restarts = 0;
    loop {
        runner.work(&mut board);
        board.follow_wheel(&runner.session().node().configuration().tach);
        if board.restarts() != restarts {
            restarts = board.restarts();
            runner.note(BoardEvent::SamplingRestarted, restarts);
        }
    }
}

/// Only ends the main loop's sleep.
#[exception]
fn SysTick() {}

/// The crystal has failed: start again, on the internal oscillator.
#[exception]
unsafe fn NonMaskableInt() -> ! {
    crash::on_cause(Cause::Crystal)
}
