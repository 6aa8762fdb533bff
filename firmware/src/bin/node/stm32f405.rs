//! The program of the node on an STM32F405, whichever slot it is linked for.

use core::mem::MaybeUninit;
use cortex_m::singleton;
use cortex_m_rt::{entry, exception};
use defmt_rtt as _;
use meshband::board::SampleClock;
use meshband::buffers::{Buffers, LentArrays};
use meshband::config::{FrontEnd, SensorSupply};
use meshband::identity::Identity;
use meshband::pipeline::Channels;
use meshband::safe_start::Start;
use meshband::sample_ring::SampleRing;
use meshband::store::Store;
use meshband::update::header::{HEADER_BYTES, describe};
use meshband::update::receiver::Place;
use meshband::update::{Slot, StartCause, Updater};
use meshband_drivers::programmable_gain::Gain;
use meshband_node::crash::{self, Cause};
use meshband_node::runner::{Beginning, BoardEvent, NodeCapture, NodeSession, Runner, open_capture};
use meshband_node::stm32f405::outputs::Wanted;
use meshband_node::stm32f405::sector_flash::{Parts, SectorFlash};
use meshband_node::stm32f405::{Board, Power, TIMING, own_base, power_up, set_light, unique_id};
use meshband_stm32::clock::Oscillator;
use meshband_stm32::flash::BrownOut;
use meshband_stm32::reset::ResetCause;

meshband_node::restart_on_failure!();

const BOARD: &str = "stm32f405";

/// What this image says of itself; `cargo xtask node-build` finds it by its name and makes the image's header of it.
#[unsafe(no_mangle)]
static IMAGE_DESCRIPTION: [u8; HEADER_BYTES] = describe(BOARD, meshband_node::BUILD);

/// The node's state: in core-coupled memory beside the stack, so that the stack holds only what comes and goes.
#[unsafe(link_section = ".core")]
static mut SESSION: MaybeUninit<NodeSession> = MaybeUninit::uninit();

/// The samples of the waveform it keeps, for which the memory that DMA reaches has no room.
#[unsafe(link_section = ".core")]
static mut SAMPLES: MaybeUninit<SampleRing> = MaybeUninit::uninit();

#[entry]
fn main() -> ! {
    let power = power_up();
    // Lit until the main loop runs.
    set_light(true);
    let (runner, failures) = open(&power);
    operate(&power, runner, failures)
}

/// Builds the node in its place, and how many starts in a row have failed. Its deep calls end before those of the
/// operation begin: the stack holds the one or the other.
#[inline(never)]
fn open(power: &Power) -> (Runner<SectorFlash>, u32) {
    let (Some(flash), Some(buffers), Some(capture)) = (
        Parts::take(),
        singleton!(: Buffers = Buffers::ZERO),
        singleton!(: MaybeUninit<NodeCapture> = MaybeUninit::uninit()),
    ) else {
        crash::on_cause(Cause::Start)
    };
    let Some(updater) = updater(flash.slots) else { crash::on_cause(Cause::Start) };
    // A new image that fails goes back to the one before it, not to the default configuration.
    if updater.is_on_trial() {
        crash::forgive();
    }
    let crystal = power.oscillator == Oscillator::Crystal;
    let failures = crash::count_start(start_of(power.reset_cause));
    let session = &raw mut SESSION;
    let samples = &raw mut SAMPLES;
    // SAFETY: the only references to them, taken once: this function is entered once.
    let (place, samples) = unsafe { (&mut *session, &mut *samples) };
    let arrays = LentArrays { buffers, capture: open_capture(capture, samples) };
    let mut store = Store::new(flash.configuration, 0);
    let beginning = Beginning::load(&mut store, TIMING, failures);
    (Runner::open(place, store, &beginning, TIMING, crystal, arrays, Some(updater)), failures)
}

/// The node in operation.
#[inline(never)]
fn operate(power: &Power, mut runner: Runner<SectorFlash>, failures: u32) -> ! {
    let image = runner.running_image(cause_of(power.reset_cause));
    let identity = Identity { board: BOARD, build: meshband_node::BUILD, unique_id: unique_id(), image };
    runner.begin(identity, failures);
    runner.report_start(power.reset_cause as u32, power.reset_cause == ResetCause::Software);
    if power.brown_out != BrownOut::Level3 {
        runner.note(BoardEvent::BrownOut, power.brown_out as u32);
    }
    let node = runner.session().node();
    let configuration = node.configuration();
    let (wheel, edge) = (configuration.tach, configuration.front_end.tach_edge);
    let channels = Channels::of(configuration);
    let Some(mut board) = Board::start(node.requested_period_ticks(), &wheel, edge, channels) else {
        crash::on_cause(Cause::Start)
    };
    let mut restarts = 0;
    loop {
        runner.work(&mut board);
        let configuration = runner.session().node().configuration();
        board.follow_tach(&configuration.tach, configuration.front_end.tach_edge);
        board.follow_channels(Channels::of(configuration));
        follow_outputs(&mut runner, &mut board);
        if board.restarts() != restarts {
            restarts = board.restarts();
            runner.note(BoardEvent::SamplingRestarted, restarts);
        }
    }
}

/// What the board switches follows the node, and the node's scale the gain in use.
#[inline(never)]
fn follow_outputs(runner: &mut Runner<SectorFlash>, board: &mut Board) {
    let node = runner.session().node_mut();
    let FrontEnd { gain: configured, sensor_supply, .. } = node.configuration().front_end;
    let gain = Gain::of_factor(configured.factor()).unwrap_or(Gain::X1);
    let (alarm, sensor_ok) = (node.alarm_stands(), node.sensor_is_ok());
    let wanted = Wanted { alarm, sensor_ok, sensor: sensor_supply == SensorSupply::On, gain };
    let now = board.now();
    let outcome = board.outputs().follow(wanted, now);
    if board.outputs().has_gain(gain) {
        node.set_gain(configured);
    }
    if outcome.is_err() {
        runner.note(BoardEvent::GainFault, gain.factor().into());
    }
}

/// The slots, seen from the one that this image is linked for; in a static, because the stack is deepest while the
/// node is put together.
#[inline(never)]
fn updater(slots: [SectorFlash; 2]) -> Option<&'static mut Updater<SectorFlash>> {
    let [lower, upper] = slots.map(|flash| Place { base: flash.start(), flash });
    let (slot, own, free) = if own_base() == lower.base { (Slot::A, lower, upper) } else { (Slot::B, upper, lower) };
    singleton!(: Updater<SectorFlash> = Updater::new(slot, own, free, &IMAGE_DESCRIPTION))
}

/// What the reset flags say to a host.
fn cause_of(cause: ResetCause) -> StartCause {
    match cause {
        ResetCause::Power => StartCause::Power,
        ResetCause::Pin => StartCause::Pin,
        ResetCause::Software => StartCause::Software,
        ResetCause::Watchdog => StartCause::Watchdog,
        ResetCause::Other => StartCause::Other,
    }
}

/// What the reset flags say of the run before.
fn start_of(cause: ResetCause) -> Start {
    match cause {
        ResetCause::Power | ResetCause::Pin => Start::Fresh,
        ResetCause::Software => Start::Recorded,
        ResetCause::Watchdog | ResetCause::Other => Start::Unrecorded,
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
