//! The node on an STM32F767ZI at 168 MHz: a whole port in one file, the worked example of `docs/porting.md`.
//!
//! Timers, DMA requests and converter are wired as on the STM32F405 (crate `meshband-stm32` explains how); what
//! differs is the register crate, the converter's trigger number, the UART, the flash and the memory map. This image
//! is compiled with every test run and has no register tests of its own; no board was at hand. Registers are
//! written as numbers with the manual's field names beside them. Source: reference manual RM0410.
//!
//! Pins: tach PA0, signal PA1, link PA9 and PA10, light PB0 (high is lit), crystal or ST-LINK clock 8 MHz.
#![no_std]
#![no_main]

use core::ptr;
use core::sync::atomic::{AtomicU32, Ordering, fence};
use cortex_m::singleton;
use cortex_m_rt::{entry, exception};
use defmt_rtt as _;
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};
use heapless::spsc::{Consumer, Producer};
use meshband::board::{BlockSource, Link, SampleClock, Supervision, TachCapture};
use meshband::buffers::Buffers;
use meshband::node::Block;
use meshband::self_test::BootTest;
use meshband::store::Store;
use meshband::units::TicksPerSecond;
use meshband_node::crash::{self, Cause};
use meshband_node::interrupt_cell::InterruptCell;
use meshband_node::pipeline::{BLOCK_SAMPLES, BUFFERS, Codes, Filled, Inbox, Queues, Request};
use meshband_node::receive_circle::ReceiveCircle;
use meshband_node::runner::{BoardEvent, Runner};
use meshband_node::send_ring::SendRing;
use meshband_stm32::block_stamp::{Borders, is_aligned};
use meshband_stm32::filter::Filter;
use meshband_stm32::period::reload_of;
use meshband_stm32::reset::ResetCause;
use stm32f7::stm32f767::{self as pac, Interrupt, interrupt};

meshband_node::restart_on_failure!();

const TIME_BASE: TicksPerSecond = TicksPerSecond(84_000_000);
const RECEIVE_BYTES: usize = 1024;
const SEND_BYTES: usize = 8 * 1024;

macro_rules! device {
    ($($name:ident: $block:ident, $type:ident;)*) => {
        $(fn $name() -> &'static pac::$block::RegisterBlock {
            // SAFETY: the device exists at this address; each register is used by one context only, or is read and
            // written whole by one instruction.
            unsafe { &*pac::$type::PTR }
        })*
    };
}

device! {
    rcc: rcc, RCC; flash: flash, FLASH; iwdg: iwdg, IWDG;
    tim2: tim2, TIM2; tim3: tim3, TIM3; tim5: tim5, TIM5;
    adc1: adc1, ADC1; adc_common: adc_common, ADC_COMMON;
    dma1: dma2, DMA1; dma2: dma2, DMA2; usart1: usart1, USART1;
    port_a: gpioa, GPIOA; port_b: gpiob, GPIOB;
}

/// Writes a register as a number.
macro_rules! put {
    ($register:expr, $value:expr) => {
        // SAFETY: the value is one the manual defines for this register; addresses among them are of static memory.
        unsafe { $register.write(|w| w.bits($value)) }
    };
}

/// Sets bits of a register.
macro_rules! raise {
    ($register:expr, $bits:expr) => {
        // SAFETY: as for `put`.
        unsafe { $register.modify(|r, w| w.bits(r.bits() | $bits)) }
    };
}

fn waits(mut ready: impl FnMut() -> bool) -> bool {
    (0..100_000).any(|_| ready())
}

/// Clocks, pins and watchdog; gives whether a crystal runs, and why the node started.
fn power_up() -> (bool, ResetCause) {
    let cause = ResetCause::of_flags(rcc().csr().read().bits());
    raise!(rcc().csr(), 1 << 24); // RMVF
    raise!(rcc().cr(), 1 << 16); // HSEON
    let crystal = waits(|| rcc().cr().read().bits() & 1 << 17 != 0);
    put!(flash().acr(), 5 | 1 << 8 | 1 << 9); // LATENCY 5, PRFTEN, ARTEN
    // PLLM 4 or 8, PLLN 168, PLLP 2, PLLQ 7, PLLR 2 (not used): 2 MHz x 168 / 2.
    put!(rcc().pllcfgr(), if crystal { 4 | 1 << 22 } else { 8 } | 168 << 6 | 7 << 24 | 2 << 28);
    raise!(rcc().cr(), 1 << 24); // PLLON
    let locked = waits(|| rcc().cr().read().bits() & 1 << 25 != 0);
    raise!(rcc().cfgr(), 0b101 << 10 | 0b100 << 13); // APB1 by 4, APB2 by 2
    raise!(rcc().cfgr(), 0b10); // SW: PLL
    if !locked || !waits(|| rcc().cfgr().read().bits() >> 2 & 3 == 0b10) {
        crash::on_cause(Cause::Pll);
    }
    raise!(rcc().ahb1enr(), 1 | 1 << 1 | 1 << 21 | 1 << 22); // GPIOA, GPIOB, DMA1, DMA2
    raise!(rcc().apb1enr(), 1 | 1 << 1 | 1 << 3); // TIM2, TIM3, TIM5
    raise!(rcc().apb2enr(), 1 << 4 | 1 << 8); // USART1, ADC1
    let _ = rcc().apb2enr().read();
    put!(port_a().afrl(), 2); // PA0: TIM5
    put!(port_a().afrh(), 7 << 4 | 7 << 8); // PA9, PA10: USART1
    raise!(port_a().pupdr(), 1 | 1 << 20);
    raise!(port_a().moder(), 0b10 | 0b11 << 2 | 0b10 << 18 | 0b10 << 20);
    // SAFETY: PB0 as output; the other pins stay as reset leaves them.
    unsafe { port_b().moder().modify(|r, w| w.bits(r.bits() & !3 | 1)) };
    put!(iwdg().kr(), 0xcccc);
    put!(iwdg().kr(), 0x5555);
    put!(iwdg().pr(), 6);
    put!(iwdg().rlr(), 999); // 8 s at 32 kHz
    if crystal {
        raise!(rcc().cr(), 1 << 19); // CSSON
    }
    (crystal, cause)
}

static REQUEST: Request = Request::new();
/// The word DMA copies to the sample timer's reload at each border.
static RELOAD: AtomicU32 = AtomicU32::new(0);
static LOST_EDGES: AtomicU32 = AtomicU32::new(0);
static RESTARTS: AtomicU32 = AtomicU32::new(0);
static TACH: InterruptCell<Tach> = InterruptCell::new();
static SAMPLING: InterruptCell<Sampling> = InterruptCell::new();

struct Tach {
    edges: Producer<'static, u32>,
    filter: Filter,
}

struct Sampling {
    borders: Borders,
    filling: [&'static mut Codes; 2],
    blocks: Producer<'static, Filled>,
    free: Consumer<'static, &'static mut Codes>,
}

/// Stops a DMA stream, clears its flags and sets its addresses, length and control word.
fn start_stream(dma: &pac::dma2::RegisterBlock, number: usize, register: u32, memory: u32, length: u16, control: u32) {
    let stream = dma.st(number);
    put!(stream.cr(), 0);
    let _ = waits(|| stream.cr().read().bits() & 1 == 0);
    let clear = 0x3d << [0, 6, 16, 22][number & 3];
    if number < 4 {
        put!(dma.lifcr(), clear);
    } else {
        put!(dma.hifcr(), clear);
    }
    put!(stream.par(), register);
    put!(stream.m0ar(), memory);
    put!(stream.ndtr(), u32::from(length));
    put!(stream.cr(), control);
    put!(stream.cr(), control | 1);
}

impl Sampling {
    fn start(&mut self) {
        let period = self.borders.published();
        RELOAD.store(reload_of(period), Ordering::Relaxed);
        put!(tim2().cr1(), 1 << 7 | 1 << 2); // ARPE, URS
        put!(tim2().cr2(), 0b010 << 4); // TRGO: update
        put!(tim2().arr(), reload_of(period));
        put!(tim2().egr(), 1);
        put!(tim3().smcr(), 0);
        put!(tim3().cr1(), 1 << 2);
        put!(tim3().cr2(), 0b010 << 4);
        put!(tim3().arr(), BLOCK_SAMPLES as u32 - 1);
        put!(tim3().egr(), 1);
        put!(tim3().smcr(), 0b001 << 4 | 0b111); // counts ITR1: TIM2
        put!(tim3().dier(), 1 << 8); // UDE
        let word = 0b10 << 13 | 0b10 << 11;
        // Channel 5 (TIM3_UP), words, circular, memory to register.
        let reload = 5 << 25 | 3 << 16 | word | 1 << 8 | 1 << 6;
        start_stream(dma1(), 2, ptr::from_ref(tim2().arr()) as u32, RELOAD.as_ptr() as u32, 1, reload);
        let [first, second] = self.filling.each_mut().map(|codes| codes.as_mut_ptr() as u32);
        put!(dma2().st(0).m1ar(), second);
        // Channel 0 (ADC1), double buffer, half-words, increment, circular, complete and error interrupts.
        let blocks = 3 << 16 | 1 << 18 | 0b01 << 13 | 0b01 << 11 | 1 << 10 | 1 << 8 | 1 << 4 | 1 << 2;
        start_stream(dma2(), 0, ptr::from_ref(adc1().dr()) as u32, first, BLOCK_SAMPLES as u16, blocks);
        put!(adc_common().ccr(), 0b01 << 16); // 84 MHz / 4
        put!(adc1().cr1(), 1 << 26); // OVRIE: after an overrun no block would ever be complete
        put!(adc1().smpr2(), 1 << 3); // channel 1: 15 cycles
        put!(adc1().sqr3(), 1);
        // EXTEN rising, EXTSEL TIM2 TRGO (1011 in this family), left-aligned, DDS, DMA, ADON.
        put!(adc1().cr2(), 0b01 << 28 | 0b1011 << 24 | 1 << 11 | 1 << 9 | 1 << 8 | 1);
        let _ = tim5().ccr2().read();
        raise!(tim3().cr1(), 1);
        raise!(tim2().cr1(), 1);
    }

    fn restart(&mut self) {
        put!(tim2().cr1(), 0);
        put!(tim3().cr1(), 0);
        put!(tim3().dier(), 0);
        put!(adc1().cr2(), 0);
        put!(adc1().sr(), 0);
        RESTARTS.store(RESTARTS.load(Ordering::Relaxed).saturating_add(1), Ordering::Relaxed);
        self.borders.restart();
        self.start();
    }

    fn on_overrun(&mut self) {
        if adc1().sr().read().bits() & 1 << 5 != 0 {
            self.restart();
        }
    }

    fn on_interrupt(&mut self) {
        let flags = dma2().lisr().read().bits();
        put!(dma2().lifcr(), 0x3d);
        let stream = dma2().st(0);
        let (counted, left) = (tim3().cnt().read().bits() as u16, stream.ndtr().read().bits() as u16);
        let overrun = adc1().sr().read().bits() & 1 << 5 != 0;
        if flags & 0b1100 != 0 || overrun || !is_aligned(counted, left) {
            self.restart();
            return;
        }
        if flags & 1 << 5 == 0 {
            return;
        }
        fence(Ordering::Acquire);
        let missed = tim5().sr().read().bits() & 1 << 10 != 0;
        let last_tick = tim5().ccr2().read().bits();
        if missed {
            put!(tim5().sr(), !(1 << 10));
        }
        let next = tim2().arr().read().bits().wrapping_add(1);
        let next = (tim5().sr().read().bits() & 1 << 2 == 0).then_some(next);
        let stamp = self.borders.on_border(last_tick, missed, next);
        RELOAD.store(self.borders.publish(REQUEST.latest()), Ordering::Relaxed);
        let Some(stamp) = stamp else { return };
        let second_filling = stream.cr().read().bits() & 1 << 19 != 0;
        let [first, second] = &mut self.filling;
        let place = if second_filling { first } else { second };
        let Some(fresh) = self.free.dequeue() else {
            self.borders.mark_loss();
            return;
        };
        let address = fresh.as_mut_ptr() as u32;
        if second_filling {
            put!(stream.m0ar(), address);
        } else {
            put!(stream.m1ar(), address);
        }
        let codes = core::mem::replace(place, fresh);
        let _ = self.blocks.enqueue(Filled {
            codes,
            first_tick: stamp.first_tick,
            period_ticks: stamp.period_ticks,
            sequence: stamp.sequence,
            overrun: stamp.overrun,
        });
    }
}

#[interrupt]
fn DMA2_STREAM0() {
    // SAFETY: this handler and the next share a priority.
    unsafe { SAMPLING.with(Sampling::on_interrupt) };
}

#[interrupt]
fn ADC() {
    // SAFETY: as above.
    unsafe { SAMPLING.with(Sampling::on_overrun) };
}

#[interrupt]
fn TIM5() {
    let status = tim5().sr().read().bits();
    let mut lost = status >> 9 & 1;
    if lost != 0 {
        put!(tim5().sr(), !(1 << 9));
    }
    // SAFETY: this is the one handler.
    unsafe {
        TACH.with(|tach| {
            if status & 1 << 1 != 0 {
                let tick = tim5().ccr1().read().bits().wrapping_sub(tach.filter.ticks);
                lost += u32::from(tach.edges.enqueue(tick).is_err());
            }
        });
    }
    LOST_EDGES.store(LOST_EDGES.load(Ordering::Relaxed).saturating_add(lost), Ordering::Relaxed);
}

/// The board as the main loop sees it.
struct Board {
    inbox: Inbox,
    received: ReceiveCircle<RECEIVE_BYTES>,
    ring: SendRing,
}

impl Board {
    fn start(period_ticks: u32, filter: Filter) -> Option<Self> {
        let buffers = singleton!(: [Codes; BUFFERS] = [[0; _]; BUFFERS])?;
        let (mut outlets, inbox) = singleton!(: Queues = Queues::new())?.split(buffers);
        let received = singleton!(: [u8; RECEIVE_BYTES] = [0; RECEIVE_BYTES])?;
        let ring = SendRing::new(singleton!(: [u8; SEND_BYTES] = [0; SEND_BYTES])?);
        put!(usart1().brr(), 91); // 84 MHz / 91 = 923 kbit/s
        put!(usart1().cr3(), 1 << 12 | 1 << 7 | 1 << 6); // OVRDIS, DMAT, DMAR
        put!(usart1().cr1(), 1 | 1 << 2 | 1 << 3); // UE, RE, TE
        let circle = 4 << 25 | 1 << 16 | 1 << 10 | 1 << 8;
        let register = ptr::from_ref(usart1().rdr()) as u32;
        start_stream(dma2(), 5, register, received.as_mut_ptr() as u32, RECEIVE_BYTES as u16, circle);
        REQUEST.publish(period_ticks);
        put!(tim5().cr1(), u32::from(filter.clock_division) << 8);
        put!(tim5().arr(), u32::MAX);
        put!(tim5().smcr(), 0b001 << 4); // TRC: ITR1, TIM3
        put!(tim5().ccmr1_input(), 0b11 << 8 | u32::from(filter.code) << 4 | 0b01);
        put!(tim5().ccer(), 1 << 4 | 1);
        put!(tim5().egr(), 1);
        put!(tim5().dier(), 1 << 1);
        raise!(tim5().cr1(), 1);
        let filling = [outlets.free.dequeue()?, outlets.free.dequeue()?];
        let borders = Borders::starting(period_ticks);
        let mut sampling = Sampling { borders, filling, blocks: outlets.blocks, free: outlets.free };
        sampling.start();
        // SAFETY: the interrupts are still masked; the timer of the core has no other user.
        let mut system_timer = unsafe {
            SAMPLING.install(sampling);
            TACH.install(Tach { edges: outlets.edges, filter });
            cortex_m::peripheral::NVIC::unmask(Interrupt::TIM5);
            cortex_m::peripheral::NVIC::unmask(Interrupt::DMA2_STREAM0);
            cortex_m::peripheral::NVIC::unmask(Interrupt::ADC);
            cortex_m::Peripherals::steal().SYST
        };
        system_timer.set_reload(839_999); // 5 ms of the core's clock
        system_timer.set_clock_source(cortex_m::peripheral::syst::SystClkSource::Core);
        system_timer.enable_interrupt();
        system_timer.enable_counter();
        Some(Self { inbox, received: ReceiveCircle::new(received), ring })
    }
}

impl SampleClock for Board {
    fn time_base(&self) -> TicksPerSecond {
        TIME_BASE
    }

    fn now(&self) -> u32 {
        tim5().cnt().read().bits()
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
        LOST_EDGES.load(Ordering::Relaxed)
    }
}

impl Link for Board {
    fn send(&mut self, frame: &[u8]) -> bool {
        let queued = self.ring.push(frame);
        self.pump();
        queued
    }

    fn receive(&mut self) -> Option<u8> {
        let left = dma2().st(5).ndtr().read().bits() as usize;
        self.received.next(RECEIVE_BYTES.saturating_sub(left) % RECEIVE_BYTES)
    }

    fn pump(&mut self) {
        if dma2().st(7).cr().read().bits() & 1 == 0
            && let Some(run) = self.ring.next_run()
        {
            let (memory, length) = (run.as_ptr() as u32, run.len() as u16);
            let register = ptr::from_ref(usart1().tdr()) as u32;
            start_stream(dma2(), 7, register, memory, length, 4 << 25 | 1 << 10 | 1 << 6);
        }
    }

    fn take_dropped(&mut self) -> Option<u32> {
        self.ring.take_dropped()
    }
}

impl Supervision for Board {
    fn feed_watchdog(&mut self) {
        put!(iwdg().kr(), 0xaaaa);
    }

    fn set_light(&mut self, lit: bool) {
        put!(port_b().bsrr(), if lit { 1 } else { 1 << 16 });
    }

    fn wait(&mut self) {
        self.inbox.wait();
    }
}

/// The last two sectors, 256 KiB each: 10 and 11.
struct ConfigFlash;

const SECTOR: u32 = 256 * 1024;
const CONFIG_START: u32 = 0x0818_0000;

fn settle() -> Result<(), NorFlashErrorKind> {
    let idle = (0..50_000_000u32).any(|_| flash().sr().read().bits() & 1 << 16 == 0);
    let flags = flash().sr().read().bits() & 0xf3;
    put!(flash().sr(), flags);
    if idle && flags & 0xf2 == 0 { Ok(()) } else { Err(NorFlashErrorKind::Other) }
}

fn unlock() {
    let _ = settle();
    if flash().cr().read().bits() & 1 << 31 != 0 {
        put!(flash().keyr(), 0x4567_0123);
        put!(flash().keyr(), 0xcdef_89ab);
    }
}

impl ErrorType for ConfigFlash {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for ConfigFlash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
        check_read(self, offset, bytes.len())?;
        for (at, byte) in (CONFIG_START + offset..).zip(bytes) {
            // SAFETY: checked to lie inside the two sectors.
            *byte = unsafe { ptr::read_volatile(at as *const u8) };
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        2 * SECTOR as usize
    }
}

impl NorFlash for ConfigFlash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR as usize;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Self::Error> {
        check_erase(self, from, to)?;
        for sector in from / SECTOR..to / SECTOR {
            unlock();
            let erase = 0b10 << 8 | 1 << 1 | (10 + sector) << 3; // PSIZE words, SER, SNB
            put!(flash().cr(), erase);
            put!(flash().cr(), erase | 1 << 16);
            let outcome = settle();
            put!(flash().cr(), 1 << 31);
            outcome?;
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        check_write(self, offset, bytes.len())?;
        unlock();
        put!(flash().cr(), 0b10 << 8 | 1);
        let (words, _) = bytes.as_chunks::<4>();
        let mut outcome = Ok(());
        for (at, word) in (CONFIG_START + offset..).step_by(4).zip(words) {
            // SAFETY: checked to lie inside the two sectors, aligned, and the controller expects the write.
            unsafe { ptr::write_volatile(at as *mut u32, u32::from_ne_bytes(*word)) };
            outcome = outcome.and(settle());
        }
        put!(flash().cr(), 1 << 31);
        outcome
    }
}

#[entry]
fn main() -> ! {
    let (crystal, cause) = power_up();
    operate(crystal, cause, BootTest::new(TIME_BASE))
}

/// The node in operation. Not part of `main`, so that the self-test above does not lie on top of the node on the stack.
#[inline(never)]
fn operate(crystal: bool, cause: ResetCause, test: BootTest) -> ! {
    let Some(buffers) = singleton!(: Buffers = Buffers::ZERO) else { crash::on_cause(Cause::Start) };
    let mut runner = Runner::open(Store::new(ConfigFlash, 0), test, TIME_BASE, crystal, buffers);
    runner.report_start(cause as u32, cause == ResetCause::Software);
    let node = runner.session().node();
    let (wheel, period) = (node.configuration().tach, node.requested_period_ticks());
    let filter = Filter::for_wheel(wheel.highest.0, wheel.pulses_per_turn, TIME_BASE.0);
    let Some(mut board) = Board::start(period, filter) else { crash::on_cause(Cause::Start) };
    let mut restarts = 0;
    loop {
        runner.work(&mut board);
        let now = RESTARTS.load(Ordering::Relaxed);
        if now != restarts {
            restarts = now;
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
