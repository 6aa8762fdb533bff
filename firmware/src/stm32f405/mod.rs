//! STM32F405RG at 168 MHz: clocks, tachometer capture, link, light, watchdog.
//!
//! Pins (as on an Olimex STM32-H405): tachometer PA0, link PA2 (out) and PA3 (in), light PC12 (low is lit),
//! crystal 8 MHz. Without a crystal that starts, the internal oscillator serves and
//! [`Board::crystal`] is false: its 1 % tolerance is then the tolerance of every frequency reported.

pub mod crash;
pub mod tach;

use crate::pipeline::EDGE_QUEUE;
use core::cell::RefCell;
use cortex_m::peripheral::syst::SystClkSource;
use critical_section::Mutex;
use heapless::spsc::{Consumer, Producer, Queue};
use stm32f4xx_hal::gpio::{Output, PC12};
use stm32f4xx_hal::pac::{self, NVIC, USART2, interrupt};
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::Config;
use stm32f4xx_hal::serial::{self, Rx, Serial, Tx};
use stm32f4xx_hal::watchdog::IndependentWatchdog;
use tach::Tach;

/// Rate of the time base: timers of APB1 run at twice its 42 MHz.
pub const TICKS_PER_SECOND: u32 = 84_000_000;
/// Bit rate of the link.
const LINK_BITS_PER_SECOND: u32 = 921_600;
/// Bytes received that may wait for the main loop.
const RECEIVE_QUEUE: usize = 256;
/// Period of the wake-up that lets a standing machine's main loop feed the watchdog: 0.1 s at an eighth of 168 MHz.
const WAKE_TICKS: u32 = 2_100_000;
/// Polls of the crystal oscillator before it counts as absent: about 50 ms at 16 MHz; crystals need 2 ms.
const CRYSTAL_PATIENCE: u32 = 100_000;

/// What the interrupts own.
struct Interrupts {
    tach: Tach,
    receiver: Rx<USART2>,
    received: Producer<'static, u8>,
}

static INTERRUPTS: Mutex<RefCell<Option<Interrupts>>> = Mutex::new(RefCell::new(None));

/// The board as the main loop sees it.
pub struct Board {
    /// Edge instants, in order.
    pub edges: Consumer<'static, u32>,
    /// Bytes from the link.
    pub received: Consumer<'static, u8>,
    /// Whether the crystal drives the clocks.
    pub crystal: bool,
    sender: Tx<USART2>,
    light: PC12<Output>,
    watchdog: IndependentWatchdog,
}

impl Board {
    /// Sets up clocks and peripherals and starts the tachometer.
    ///
    /// # Panics
    /// When called twice, or for a bit rate the clocks cannot give.
    pub fn start() -> Self {
        let once = "the board is started once";
        let device = pac::Peripherals::take().expect(once);
        let crystal = crystal_starts(&device.RCC);
        let source = if crystal { Config::hse(8.MHz()) } else { Config::hsi() };
        let mut rcc = device.RCC.freeze(source.sysclk(168.MHz()).pclk1(42.MHz()).pclk2(84.MHz()));
        let port_a = device.GPIOA.split(&mut rcc);
        let port_c = device.GPIOC.split(&mut rcc);

        let settings = serial::Config::default().baudrate(LINK_BITS_PER_SECOND.bps());
        let mut link = Serial::new(device.USART2, (port_a.pa2, port_a.pa3), settings, &mut rcc)
            .expect("the clocks give this bit rate");
        link.listen(serial::Event::RxNotEmpty);
        let (sender, receiver) = link.split();

        let (edges_in, edges) = cortex_m::singleton!(: Queue<u32, EDGE_QUEUE> = Queue::new()).expect(once).split();
        let (bytes_in, received) = cortex_m::singleton!(: Queue<u8, RECEIVE_QUEUE> = Queue::new()).expect(once).split();
        // The pin belongs to the timer from here on.
        port_a.pa0.into_alternate::<1>();
        let tach = Tach::start(device.TIM2, &mut rcc, edges_in);
        critical_section::with(|token| {
            INTERRUPTS.borrow_ref_mut(token).replace(Interrupts { tach, receiver, received: bytes_in });
        });
        for line in [pac::Interrupt::TIM2, pac::Interrupt::USART2] {
            // SAFETY: the state the handlers work on is complete, and nothing relies on these lines being masked.
            unsafe { NVIC::unmask(line) };
        }
        let mut core = cortex_m::Peripherals::take().expect(once);
        core.SYST.set_clock_source(SystClkSource::External);
        core.SYST.set_reload(WAKE_TICKS - 1);
        core.SYST.clear_current();
        core.SYST.enable_interrupt();
        core.SYST.enable_counter();
        let mut watchdog = IndependentWatchdog::new(device.IWDG);
        watchdog.start(2.secs());
        Self { edges, received, crystal, sender, light: port_c.pc12.into_push_pull_output(), watchdog }
    }

    /// Present instant of the time base.
    pub fn now(&self) -> u32 {
        critical_section::with(|token| INTERRUPTS.borrow_ref(token).as_ref().map_or(0, |i| i.tach.now()))
    }

    /// Edges lost: overwritten in the capture register or refused by the queue.
    pub fn lost_edges(&self) -> u32 {
        critical_section::with(|token| INTERRUPTS.borrow_ref(token).as_ref().map_or(0, |i| i.tach.lost()))
    }

    /// Sends a frame, waiting for the line.
    pub fn send(&mut self, frame: &[u8]) {
        // This driver's writing cannot fail: there is no flow control.
        let _ = self.sender.bwrite_all(frame);
    }

    /// Switches the light.
    pub fn set_light(&mut self, lit: bool) {
        self.light.set_state((!lit).into());
    }

    /// Tells the watchdog that the main loop lives.
    pub fn feed_watchdog(&mut self) {
        self.watchdog.feed();
    }

    /// Sleeps until an interrupt, unless there is something to do.
    pub fn wait(&self) {
        critical_section::with(|_| {
            // With interrupts masked a pending one still ends the sleep.
            if !self.edges.ready() && !self.received.ready() {
                cortex_m::asm::wfi();
            }
        });
    }
}

/// Starts the crystal oscillator; the vendor driver would wait for it for ever.
fn crystal_starts(rcc: &pac::RCC) -> bool {
    rcc.cr().modify(|_, w| w.hseon().set_bit());
    for _ in 0..CRYSTAL_PATIENCE {
        if rcc.cr().read().hserdy().bit_is_set() {
            return true;
        }
    }
    rcc.cr().modify(|_, w| w.hseon().clear_bit());
    false
}

#[interrupt]
fn TIM2() {
    critical_section::with(|token| {
        if let Some(interrupts) = INTERRUPTS.borrow_ref_mut(token).as_mut() {
            interrupts.tach.on_interrupt();
        }
    });
}

#[interrupt]
fn USART2() {
    critical_section::with(|token| {
        if let Some(interrupts) = INTERRUPTS.borrow_ref_mut(token).as_mut() {
            while let Ok(byte) = interrupts.receiver.read() {
                // A full queue loses the byte; the frame's checksum shows it.
                let _ = interrupts.received.enqueue(byte);
            }
        }
    });
}
