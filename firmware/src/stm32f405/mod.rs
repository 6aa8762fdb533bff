//! STM32F405RG at 168 MHz: the register programs of `meshband-stm32` put to work on the chip.
//!
//! Three interrupts, of one priority: a tach edge, a complete block, an overrun of the converter. Everything else is polled by the main loop behind
//! DMA. Pins and light as in `meshband_stm32::pins`; crystal 8 MHz.

pub mod config_flash;
mod sampling;
mod tach;

use crate::crash::{self, Cause};
use crate::pipeline::{BUFFERS, Codes, Inbox, Queues, Request};
use crate::receive_circle::ReceiveCircle;
use crate::send_ring::SendRing;
use core::ptr;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m::singleton;
use meshband::board::{BlockSource, Link, SampleClock, Supervision, TachCapture};
use meshband::config::TachWheel;
use meshband::node::Block;
use meshband::units::TicksPerSecond;
use meshband_stm32::clock::{self, Oscillator, ResetCause};
use meshband_stm32::filter::Filter;
use meshband_stm32::pac::{self, Interrupt};
use meshband_stm32::time_base::{self, Edge};
use meshband_stm32::{pins, uart, watchdog};

/// Rate of the time base.
pub const TIME_BASE: TicksPerSecond = TicksPerSecond(clock::TIMER_HZ);
/// Circle of received bytes: 11 ms of the line's full rate.
const RECEIVE_BYTES: usize = 1024;
/// Bytes that may wait for the line: most of a snapshot.
const SEND_BYTES: usize = 8 * 1024;
/// Period of the wake-up that lets the main loop work while no blocks come: 5 ms at an eighth of 168 MHz.
const WAKE_TICKS: u32 = 105_000;

static REQUEST: Request = Request::new();

/// Clocks, reset cause and pins: what must be before anything else.
pub struct Power {
    /// What drives the clocks.
    pub oscillator: Oscillator,
    /// Why the node started.
    pub reset_cause: ResetCause,
}

/// The board as the main loop sees it.
pub struct Board {
    inbox: Inbox,
    received: ReceiveCircle<RECEIVE_BYTES>,
    ring: SendRing,
    wheel: TachWheel,
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
    flash: flash, FLASH;
    tim2: tim2, TIM2;
    tim3: tim3, TIM3;
    tim5: tim5, TIM5;
    adc1: adc1, ADC1;
    adc_common: adc_common, ADC_COMMON;
    dma1: dma2, DMA1;
    dma2: dma2, DMA2;
    usart1: usart1, USART1;
    port_a: gpioa, GPIOA;
    port_c: gpioi, GPIOC;
    iwdg: iwdg, IWDG;
}

/// Clocks and pins. Starts the watchdog too: from here on a hang ends in a restart.
pub fn power_up() -> Power {
    let reset_cause = clock::reset_cause(rcc());
    let oscillator = match clock::start(rcc(), flash()) {
        Ok(oscillator) => oscillator,
        // At 16 MHz neither link nor rates would be right: try again from reset.
        Err(clock::PllFault) => crash::on_cause(Cause::Pll),
    };
    clock::enable_peripherals(rcc());
    pins::configure(port_a(), port_c());
    watchdog::start(iwdg());
    Power { oscillator, reset_cause }
}

/// Switches the light; for code that has no board.
pub fn set_light(lit: bool) {
    pins::set_light(port_c(), lit);
}

impl Board {
    /// Starts link, time base, tach and sampling at `period_ticks`; `None` when called twice.
    pub fn start(period_ticks: u32, wheel: &TachWheel) -> Option<Self> {
        let buffers = singleton!(: [Codes; BUFFERS] = [[0; _]; BUFFERS])?;
        let (outlets, inbox) = singleton!(: Queues = Queues::new())?.split(buffers);
        let received = singleton!(: [u8; RECEIVE_BYTES] = [0; RECEIVE_BYTES])?;
        let ring = SendRing::new(singleton!(: [u8; SEND_BYTES] = [0; SEND_BYTES])?);
        uart::start(usart1());
        // SAFETY: the circle is static memory in SRAM that only this stream writes.
        unsafe {
            uart::start_reception(dma2(), data_address(), received.as_mut_ptr() as u32, RECEIVE_BYTES as u16);
        }
        REQUEST.publish(period_ticks);
        let filter = Filter::for_wheel(wheel.highest.0, wheel.pulses_per_turn, clock::TIMER_HZ);
        time_base::start(tim5(), Edge::Rising, filter);
        tach::set_filter(filter);
        tach::install(outlets.edges);
        sampling::install(period_ticks, outlets.blocks, outlets.free, &REQUEST)?;
        // All of one priority, as reset leaves them: none interrupts another.
        for line in [Interrupt::TIM5, Interrupt::DMA2_STREAM0, Interrupt::ADC] {
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
        Some(Self { inbox, received: ReceiveCircle::new(received), ring, wheel: *wheel })
    }

    /// Sets the tach's filter to another wheel, where it is another.
    pub fn follow_wheel(&mut self, wheel: &TachWheel) {
        if *wheel != self.wheel {
            self.wheel = *wheel;
            tach::set_filter(Filter::for_wheel(wheel.highest.0, wheel.pulses_per_turn, clock::TIMER_HZ));
        }
    }

    /// Times sampling had to be started anew because samples had lost step with their triggers.
    pub fn restarts(&self) -> u32 {
        sampling::restarts()
    }
}

fn data_address() -> u32 {
    ptr::from_ref(usart1().dr()) as u32
}

impl SampleClock for Board {
    fn time_base(&self) -> TicksPerSecond {
        TIME_BASE
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
        self.now()
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
        self.received.next(uart::write_position(dma2(), RECEIVE_BYTES as u16).into())
    }

    fn pump(&mut self) {
        if uart::is_sending(dma2()) {
            return;
        }
        if let Some(run) = self.ring.next_run() {
            // SAFETY: the ring is static memory in SRAM and leaves a lent run alone until the next one is asked for.
            unsafe { uart::start_sending(dma2(), data_address(), run.as_ptr() as u32, run.len() as u16) };
        }
    }

    fn take_dropped(&mut self) -> Option<u32> {
        self.ring.take_dropped()
    }
}

impl Supervision for Board {
    fn feed_watchdog(&mut self) {
        watchdog::feed(iwdg());
    }

    fn set_light(&mut self, lit: bool) {
        set_light(lit);
    }

    fn wait(&mut self) {
        self.inbox.wait();
    }
}
