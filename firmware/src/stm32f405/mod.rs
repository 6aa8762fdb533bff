//! STM32F405RG at 168 MHz: the register programs of `meshband-stm32` put to work on the chip.
//!
//! Four interrupts, of one priority: a tach edge, a complete block, an overrun of the converter, the end of an answer
//! on a shared line. Everything else is polled by the main loop behind DMA. Pins and light as in
//! `meshband_stm32::pins`; crystal 8 MHz.

mod line;
pub mod outputs;
mod sampling;
pub mod sector_flash;
mod tach;

use crate::crash::{self, Cause};
use core::ptr;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m::singleton;
use meshband::board::{BlockSource, Housekeeping, Link, SampleClock, Supervision, TachCapture, Timing};
use meshband::config::{LineFormat, TachEdge, TachWheel};
use meshband::health::BoardHealth;
use meshband::link::QUEUE;
use meshband::link::receive_circle::ReceiveCircle;
use meshband::link::send_ring::SendRing;
use meshband::node::Block;
use meshband::pipeline::{Channels, Codes, Inbox, Queues, Request};
use meshband::units::{Hertz, TicksPerSecond};
use meshband_stm32::clock::{self, Oscillator, ResetCause};
use meshband_stm32::design_parameters::{
    HIGHEST_RATE_HZ, PERIOD_STEP, RECEIVE_BYTES, SHORTEST_PERIOD, TIMER_HZ, WAKE_TICKS,
};
use meshband_stm32::filter::Filter;
use meshband_stm32::flash::{self, BrownOut};
use meshband_stm32::housekeeping::{self, Calibration, FACTORY_CODES};
use meshband_stm32::pac::{self, Interrupt};
use meshband_stm32::time_base::{self, Edge};
use meshband_stm32::{pins, uart, unique_id, watchdog};
use outputs::Outputs;

/// What sampling is bound to.
pub const TIMING: Timing = if cfg!(feature = "rate-sweep") {
    Timing { highest_adc: Hertz((TIMER_HZ / SHORTEST_PERIOD) as f32), ..Timing::STM32F405 }
} else {
    Timing::STM32F405
};
const _: () = assert!(TIMING.clock.0 == TIMER_HZ && TIMING.period_step == PERIOD_STEP);
const _: () = assert!(Timing::STM32F405.highest_adc.0 as u32 == HIGHEST_RATE_HZ);

/// Words of interrupts in the core's controller: 82 lines.
const INTERRUPT_WORDS: usize = 3;

/// Block buffers: 25 of them wait for 34 ms at 375 kHz. The wideband transform with its search takes 16 ms at two
/// cycles per instruction, and a mesh-band record may follow before the backlog is worked off. Memory holds no more.
const BUFFERS: usize = 27;

static REQUEST: Request = Request::new();

/// Clocks, reset cause and pins: what must be before anything else.
pub struct Power {
    /// What drives the clocks.
    pub oscillator: Oscillator,
    /// Why the node started.
    pub reset_cause: ResetCause,
    /// What guards the flash against too low a supply.
    pub brown_out: BrownOut,
}

/// The board as the main loop sees it.
pub struct Board {
    inbox: Inbox,
    /// The memory that DMA fills, and where to read next.
    received: &'static [u8; RECEIVE_BYTES],
    circle: ReceiveCircle<RECEIVE_BYTES>,
    ring: &'static mut SendRing<QUEUE>,
    wheel: TachWheel,
    edge: Edge,
    outputs: Outputs,
    housekeeping: housekeeping::Housekeeping,
    /// Others speak on the line, too.
    shared: bool,
}

macro_rules! device {
    ($($name:ident: $block:ident, $type:ident;)*) => {
        $(
            /// The chip's register block.
            pub(crate) fn $name() -> &'static pac::$block::RegisterBlock {
                // SAFETY: the device exists at this address; each register is used by one context only, or is read
                // and written whole by one instruction.
                unsafe { &*pac::$type::PTR }
            }
        )*
    };
}

device! {
    rcc: rcc, RCC;
    flash_control: flash, FLASH;
    tim2: tim2, TIM2;
    tim3: tim3, TIM3;
    tim5: tim5, TIM5;
    adc1: adc1, ADC1;
    adc2: adc1, ADC2;
    adc3: adc1, ADC3;
    adc_common: adc_common, ADC_COMMON;
    dma1: dma2, DMA1;
    dma2: dma2, DMA2;
    usart1: usart1, USART1;
    spi2: spi1, SPI2;
    port_a: gpioa, GPIOA;
    port_b: gpiob, GPIOB;
    port_c: gpioi, GPIOC;
    iwdg: iwdg, IWDG;
}

/// Clocks and pins. Starts the watchdog too: from here on a hang ends in a restart.
pub fn power_up() -> Power {
    quiet_core();
    clock::reset_peripherals(rcc(), &mut || {});
    let reset_cause = clock::reset_cause(rcc());
    let oscillator = match clock::start(rcc(), flash_control(), &mut || {}) {
        Ok(oscillator) => oscillator,
        // At 16 MHz neither link nor rates would be right: try again from reset.
        Err(clock::PllFault) => crash::on_cause(Cause::Pll),
    };
    clock::enable_peripherals(rcc());
    pins::configure(port_a(), port_b(), port_c());
    start_watchdog();
    Power { oscillator, reset_cause, brown_out: flash::brown_out(flash_control()) }
}

/// Starts the watchdog; again where it runs already, as behind the loader.
pub fn start_watchdog() {
    watchdog::start(iwdg());
}

/// First address of the slot that this program is linked for (`memory.x`).
pub fn own_base() -> u32 {
    unsafe extern "C" {
        static _slot_start: u8;
    }
    &raw const _slot_start as u32
}

/// No interrupt and no system timer from whoever ran before, the boot loader in ROM above all; then lets interrupts in.
fn quiet_core() {
    // SAFETY: nothing is installed yet, and nobody else uses these.
    let core = unsafe { cortex_m::Peripherals::steal() };
    let mut system_timer = core.SYST;
    system_timer.disable_counter();
    system_timer.disable_interrupt();
    for word in 0..INTERRUPT_WORDS {
        // SAFETY: ones mask interrupts and clear pending ones.
        unsafe {
            core.NVIC.icer[word].write(u32::MAX);
            core.NVIC.icpr[word].write(u32::MAX);
        }
    }
    // SAFETY: no interrupt is unmasked.
    unsafe { cortex_m::interrupt::enable() };
}

// Runs before anything else: until `power_up` has cleared what the boot loader left, no interrupt may come.
core::arch::global_asm!(
    ".section .text.__pre_init, \"ax\", %progbits",
    ".global __pre_init",
    ".type __pre_init, %function",
    ".thumb_func",
    "__pre_init:",
    "    cpsid i",
    "    bx lr",
    ".size __pre_init, . - __pre_init",
);

/// Switches the light; for code that has no board.
pub fn set_light(lit: bool) {
    let Ok(()) = outputs::light().set(lit);
}

impl Board {
    /// Starts link, time base, tach and sampling at `period_ticks`; `None` when called twice.
    pub fn start(period_ticks: u32, wheel: &TachWheel, edge: TachEdge, channels: Channels) -> Option<Self> {
        let buffers = singleton!(: [Codes; BUFFERS] = [[0; _]; BUFFERS])?;
        let (outlets, inbox) = singleton!(: Queues = Queues::new())?.split(buffers);
        let received = singleton!(: [u8; RECEIVE_BYTES] = [0; RECEIVE_BYTES])?;
        let ring = singleton!(: SendRing<QUEUE> = SendRing::new())?;
        uart::start(usart1());
        // SAFETY: the circle is static memory in SRAM that only this stream writes.
        unsafe {
            uart::start_reception(dma2(), data_address(), received.as_mut_ptr() as u32, RECEIVE_BYTES as u16);
        }
        REQUEST.publish(period_ticks);
        let filter = Filter::for_wheel(wheel.highest.0, wheel.pulses_per_turn, TIMER_HZ);
        let edge = counted(edge);
        time_base::start(tim5(), edge, filter);
        tach::set_filter(filter);
        tach::install(outlets.edges);
        sampling::install(period_ticks, outlets.blocks, outlets.free, &REQUEST, channels)?;
        // All of one priority, as reset leaves them: none interrupts another.
        for line in [Interrupt::TIM5, Interrupt::DMA2_STREAM0, Interrupt::ADC, Interrupt::USART1] {
            // SAFETY: the state the handlers work on is complete, and nothing relies on these lines being masked.
            unsafe { cortex_m::peripheral::NVIC::unmask(line) };
        }
        // SAFETY: nobody else uses the system timer.
        let mut system_timer = unsafe { cortex_m::Peripherals::steal() }.SYST;
        system_timer.set_clock_source(SystClkSource::External);
        system_timer.set_reload(WAKE_TICKS - 1);
        system_timer.clear_current();
        system_timer.enable_interrupt();
        system_timer.enable_counter();
        let outputs = Outputs::start();
        let housekeeping = housekeeping::Housekeeping::start(adc1(), Calibration::of(factory_codes()));
        let (circle, wheel) = (ReceiveCircle::new(), *wheel);
        Some(Self { inbox, received, circle, ring, wheel, edge, outputs, housekeeping, shared: false })
    }

    /// Sets the tach's filter and edge to another wheel and front end, where they are others.
    pub fn follow_tach(&mut self, wheel: &TachWheel, edge: TachEdge) {
        if counted(edge) != self.edge {
            self.edge = counted(edge);
            time_base::set_edge(tim5(), self.edge);
        }
        if *wheel != self.wheel {
            self.wheel = *wheel;
            tach::set_filter(Filter::for_wheel(wheel.highest.0, wheel.pulses_per_turn, TIMER_HZ));
        }
    }

    /// Samples a second sensor or not, as the configuration has it.
    pub fn follow_channels(&mut self, channels: Channels) {
        sampling::follow(channels);
    }

    /// What the board switches.
    pub fn outputs(&mut self) -> &mut Outputs {
        &mut self.outputs
    }

    /// Times sampling had to be started anew because samples had lost step with their triggers.
    pub fn restarts(&self) -> u32 {
        sampling::restarts()
    }
}

/// The configuration's edge as the timer knows it.
fn counted(edge: TachEdge) -> Edge {
    match edge {
        TachEdge::Rising => Edge::Rising,
        TachEdge::Falling => Edge::Falling,
    }
}

/// The chip's own number.
pub fn unique_id() -> [u32; 3] {
    // SAFETY: every STM32F405 has these three words in its system memory.
    [0, 1, 2].map(|word| unsafe { (unique_id::ADDRESS as *const u32).add(word).read_volatile() })
}

/// What the factory measured of the chip's reference and temperature sensor.
fn factory_codes() -> [u16; 3] {
    // SAFETY: every STM32F405 has these three half-words in its system memory.
    [0, 1, 2].map(|place| unsafe { (FACTORY_CODES as *const u16).add(place).read_volatile() })
}

fn data_address() -> u32 {
    ptr::from_ref(usart1().dr()) as u32
}

impl SampleClock for Board {
    fn time_base(&self) -> TicksPerSecond {
        TIMING.clock
    }

    fn now(&self) -> u32 {
        time_base::now(tim5())
    }

    fn set_period_ticks(&mut self, period: u32) {
        REQUEST.publish(period);
    }
}

impl BlockSource for Board {
    fn horizon(&self) -> u32 {
        time_base::horizon(tim5())
    }

    fn catch_up(&mut self) {
        self.inbox.catch_up();
    }

    fn most_waiting(&self) -> u32 {
        self.inbox.most_waiting()
    }

    fn pending_end(&self) -> Option<u32> {
        self.inbox.pending_end()
    }

    fn with_block(&mut self, consume: &mut dyn FnMut(Block<'_>)) -> bool {
        self.inbox.with_block(|block| consume(block.as_block()))
    }
}

impl TachCapture for Board {
    fn next_edge_before(&mut self, tick: u32) -> Option<u32> {
        self.inbox.edge_before(tick)
    }

    fn lost_edges(&self) -> u32 {
        tach::lost()
    }
}

impl Link for Board {
    fn send(&mut self, frame: &[u8]) -> bool {
        let queued = self.ring.push(frame);
        self.pump();
        queued
    }

    fn receive(&mut self) -> Option<u8> {
        let place = self.circle.next(uart::write_position(dma2(), RECEIVE_BYTES as u16).into())?;
        // SAFETY: a valid place; volatile, because DMA writes there behind the compiler's back.
        self.received.get(place).map(|byte| unsafe { ptr::read_volatile(byte) })
    }

    fn pump(&mut self) {
        if uart::is_sending(dma2()) {
            return;
        }
        if let Some(run) = self.ring.next_run() {
            if self.shared {
                line::seize();
            }
            // SAFETY: the ring is static memory in SRAM and leaves a lent run alone until the next one is asked for.
            unsafe { uart::start_sending(dma2(), data_address(), run.as_ptr() as u32, run.len() as u16) };
            if self.shared {
                line::release_at_end();
            }
        }
    }

    fn take_dropped(&mut self) -> Option<u32> {
        self.ring.take_unreported()
    }

    fn set_format(&mut self, format: LineFormat) {
        self.shared = format.shared;
        line::set_format(format);
    }
}

impl Housekeeping for Board {
    fn health(&mut self) -> BoardHealth {
        BoardHealth {
            supply_v: self.housekeeping.supply_v(),
            temperature_c: self.housekeeping.temperature_c(),
            sensor_bias_v: self.housekeeping.sensor_bias_v(),
        }
    }

    fn next_second_pulse(&mut self) -> Option<u32> {
        self.housekeeping.follow(adc1());
        time_base::take_second_pulse(tim5())
    }
}

impl Supervision for Board {
    fn feed_watchdog(&mut self) {
        watchdog::feed(iwdg());
    }

    fn set_light(&mut self, lit: bool) {
        self.outputs.set_light(lit);
    }

    fn wait(&mut self) {
        cortex_m::interrupt::free(|_| {
            // With interrupts masked a pending one still ends the sleep, so none can slip through in between.
            if !self.inbox.has_block() {
                cortex_m::asm::wfi();
            }
        });
    }
}
