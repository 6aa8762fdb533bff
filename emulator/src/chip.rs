//! The chip without its core: memories, devices, and how they are wired; what happens when.
//!
//! Everything is an event at an exact instant ([`crate::time::Schedule`]). [`Chip::advance`] lets time pass; reads
//! and writes of the core are in [`crate::bus`]. Wired is what the node uses:
//!
//! ```text
//! TIM2 update --> ADC3 --> DMA2 stream 0        TIM2 update --> TIM3 (ITR1) --> TIM5 channel 2 (ITR1)
//!             --> ADC2 --> DMA2 stream 3
//! TIM3 update --> DMA1 stream 2                 PA0 --filter--> TIM5 channel 1, PA3 --filter--> TIM5 channel 4
//! USART1 <--> DMA2 streams 5 and 7              reference, temperature sensor --> ADC1
//! ```

use crate::adc::Converters;
use crate::dma::{Direction, Dma};
use crate::flash::{self, Flash};
use crate::gpio::{Mode, Port};
use crate::memory::Pages;
use crate::nvic::{Nvic, exception};
use crate::rcc::{Clocks, Rcc, Resets, cause};
use crate::spi::Spi;
use crate::time::{NO_INSTANT, Schedule, Source, Time, UNITS_PER_SECOND};
use crate::timer::{Timer, Update};
use crate::usart::Usart;
use crate::watchdog::Watchdog;
use crate::world::{Border, Captured, Clocked, Inputs, PinChange, Sampled, Seen, TrueTime};

/// First address of the memory that DMA reaches.
pub const SRAM_START: u32 = 0x2000_0000;
/// Its size: SRAM1 and SRAM2.
pub const SRAM_BYTES: u32 = 128 * 1024;
/// First address of the core-coupled memory.
pub const CCM_START: u32 = 0x1000_0000;
/// Its size.
pub const CCM_BYTES: u32 = 64 * 1024;
/// Ports A to I.
pub const PORTS: usize = 9;

/// Timer clocks that a trigger takes from one timer to the next. RM0090 gives no figure; it is constant.
const TRIGGER_CLOCKS: Time = 1;
/// Core cycles from a request to the transfer; a quiet bus needs about this many.
const TRANSFER_CYCLES: Time = 8;
/// Codes of the converter; a code begins half a step below its own level.
const CODES: f64 = 4096.0;

/// Voltage of the internal reference, V (DS8626, typical).
const REFERENCE_V: f64 = 1.21;
/// Voltage of the temperature sensor at 25 degrees Celsius, V, and its slope, V/K (DS8626, typical).
const SENSOR_V: f64 = 0.76;
const SENSOR_SLOPE: f64 = 2.5e-3;
/// Shortest sampling time of either, units: 10 us.
const INTERNAL_SAMPLING: Time = UNITS_PER_SECOND / 100_000;
/// Supply and temperatures at which the factory measures.
const FACTORY_SUPPLY_V: f64 = 3.3;
const FACTORY_TEMPERATURES_C: [f64; 2] = [30.0, 110.0];
/// Pin of the pulse per second, at port A.
const SECOND_PULSE: u32 = 3;

/// Select pin of the amplifier, at port B.
const SELECT: u32 = 12;

/// Interrupts by number.
pub mod interrupt {
    /// First streams of DMA1.
    pub const DMA1: [usize; 8] = [11, 12, 13, 14, 15, 16, 17, 47];
    /// All converters.
    pub const ADC: usize = 18;
    /// TIM2.
    pub const TIM2: usize = 28;
    /// TIM3.
    pub const TIM3: usize = 29;
    /// USART1.
    pub const USART1: usize = 37;
    /// TIM5.
    pub const TIM5: usize = 50;
    /// Streams of DMA2.
    pub const DMA2: [usize; 8] = [56, 57, 58, 59, 60, 68, 69, 70];
}

/// The level at the tach's pin and behind its filter.
#[derive(Clone, Copy, Debug)]
struct TachPin {
    level: bool,
    accepted: bool,
    /// When the level will have lasted.
    accept_at: Time,
    /// When the filter notices that it has not.
    reject_at: Time,
}

/// The chip.
#[derive(Clone)]
pub struct Chip {
    /// Now.
    pub now: Time,
    /// All of flash.
    pub cells: Pages,
    /// Memory that DMA reaches.
    pub sram: Pages,
    /// Memory of the core alone.
    pub ccm: Pages,
    /// Clocks and resets.
    pub rcc: Rcc,
    /// Flash controller.
    pub flash: Flash,
    /// Interrupts and system control.
    pub nvic: Nvic,
    /// Watchdog.
    pub watchdog: Watchdog,
    /// What the world does.
    pub inputs: Inputs,
    /// What was seen.
    pub seen: Seen,
    /// Share by which the internal oscillator runs fast.
    pub internal_fast: f64,
    /// The chip's own number, 96 bits.
    pub unique: [u32; 3],
    /// What the factory measured of the reference, and of the temperature sensor at 30 and 110 degrees Celsius: codes
    /// at 3.3 V.
    pub factory: [u16; 3],
    /// A reset has happened that the core has not followed yet.
    pub restart: bool,
    pub(crate) time: TrueTime,
    pub(crate) clocks: Clocks,
    pub(crate) schedule: Schedule,
    pub(crate) tim2: Timer,
    pub(crate) tim3: Timer,
    pub(crate) tim5: Timer,
    pub(crate) adc: Converters,
    pub(crate) dma: [Dma; 2],
    pub(crate) usart: Usart,
    /// Bus to the amplifier.
    pub spi2: Spi,
    pub(crate) ports: [Port; PORTS],
    tach: TachPin,
    /// When the filter accepts the pulse per second that has risen.
    pulse_accepted: Time,
    noise: u64,
}

impl Chip {
    /// A chip with erased flash, to which power has just come.
    pub fn new() -> Self {
        let rcc = Rcc::new();
        let clocks = rcc.clocks().unwrap_or(Clocks { core: 21, apb1: 21, timers: 21, apb2: 21 });
        let mut cells = Pages::new(flash::BYTES as usize);
        cells.fill(0xff);
        let timer = |bits| Timer::new(bits, clocks.timers);
        let tach = TachPin { level: false, accepted: false, accept_at: NO_INSTANT, reject_at: NO_INSTANT };
        let mut chip = Self {
            now: 0,
            cells,
            sram: Pages::new(SRAM_BYTES as usize),
            ccm: Pages::new(CCM_BYTES as usize),
            rcc,
            flash: Flash::default(),
            nvic: Nvic::default(),
            watchdog: Watchdog::default(),
            inputs: Inputs::default(),
            seen: Seen::default(),
            internal_fast: 0.0,
            unique: [0x0032_0041, 0x3034_510b, 0x3135_3238],
            factory: factory_codes(),
            restart: true,
            time: TrueTime::new(0.0),
            clocks,
            schedule: Schedule::default(),
            tim2: timer(32),
            tim3: timer(16),
            tim5: timer(32),
            adc: Converters::default(),
            dma: [Dma::default(), Dma::default()],
            usart: Usart::default(),
            spi2: Spi::default(),
            ports: std::array::from_fn(Port::new),
            tach,
            pulse_accepted: NO_INSTANT,
            noise: 0x9e37_79b9_7f4a_7c15,
        };
        chip.forget_memory();
        chip
    }

    /// Takes over another chip's state; the memories stay where they are.
    pub fn become_like(&mut self, other: &Self) {
        let mut new = other.clone();
        for (own, copy) in
            [(&mut self.cells, &mut new.cells), (&mut self.sram, &mut new.sram), (&mut self.ccm, &mut new.ccm)]
        {
            own.copy_from_slice(copy);
            std::mem::swap(own, copy);
        }
        *self = new;
    }

    /// Length of a cycle of the core, units.
    pub fn cycle(&self) -> Time {
        self.clocks.core
    }

    /// A word of memory or flash, past all caches.
    pub fn peek(&self, address: u32) -> Option<u32> {
        let bytes = self.memory(address)?.get(..4)?;
        Some(u32::from_le_bytes(bytes.try_into().ok()?))
    }

    /// A half-word likewise.
    pub fn peek_half(&self, address: u32) -> Option<u16> {
        let bytes = self.memory(address)?.get(..2)?;
        Some(u16::from_le_bytes(bytes.try_into().ok()?))
    }

    fn memory(&self, address: u32) -> Option<&[u8]> {
        let (pages, start) = match address {
            SRAM_START.. => (&self.sram, SRAM_START),
            CCM_START.. => (&self.ccm, CCM_START),
            flash::START.. => (&self.cells, flash::START),
            _ => return None,
        };
        pages.get((address - start) as usize..)
    }

    /// Sets a word of memory; nothing where there is none.
    pub fn poke(&mut self, address: u32, value: u32) -> Option<()> {
        let (pages, start) = match address {
            SRAM_START.. => (&mut self.sram, SRAM_START),
            CCM_START.. => (&mut self.ccm, CCM_START),
            _ => return None,
        };
        let place = pages.get_mut((address - start) as usize..)?.get_mut(..4)?;
        place.copy_from_slice(&value.to_le_bytes());
        Some(())
    }

    /// Seconds since power first came.
    pub fn seconds(&self) -> f64 {
        self.time.seconds(self.now)
    }

    /// Seconds at an instant that is not before the last change of clocks.
    pub fn seconds_at(&self, at: Time) -> f64 {
        self.time.seconds(at)
    }

    /// First instant at or behind so many seconds.
    pub fn time_at(&self, seconds: f64) -> Time {
        self.time.at(seconds)
    }

    /// Bits without a pattern, the same in every run.
    pub fn noise(&mut self) -> u32 {
        // Marsaglia's xorshift of 64 bits.
        self.noise ^= self.noise << 13;
        self.noise ^= self.noise >> 7;
        self.noise ^= self.noise << 17;
        (self.noise >> 32) as u32
    }

    /// Memory after power came: anything.
    fn forget_memory(&mut self) {
        for n in (0..SRAM_BYTES as usize).step_by(4) {
            let word = self.noise().to_le_bytes();
            self.sram[n..n + 4].copy_from_slice(&word);
        }
        for n in (0..CCM_BYTES as usize).step_by(4) {
            let word = self.noise().to_le_bytes();
            self.ccm[n..n + 4].copy_from_slice(&word);
        }
    }

    /// Power fails: flash keeps what it holds, torn where it was busy; memory is lost. The devices start anew.
    pub fn lose_power(&mut self) {
        let mut seed = self.noise;
        let noise = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 33) as u32
        };
        self.flash.tear(self.now, &mut self.cells, noise);
        self.forget_memory();
        let oscillators = self.rcc.oscillators;
        self.rcc = Rcc::new();
        self.rcc.oscillators = oscillators;
        self.reset_devices();
        self.seen.resets.push((self.now, cause::POWER | cause::BROWN_OUT));
    }

    /// A reset with power on; memory stays.
    pub fn reset(&mut self, cause: u32) {
        self.rcc.reset(cause);
        self.reset_devices();
        self.seen.resets.push((self.now, cause));
    }

    fn reset_devices(&mut self) {
        let before = self.outputs();
        self.restart = true;
        self.flash.reset();
        self.watchdog.reset();
        self.nvic = Nvic::default();
        self.schedule = Schedule::default();
        self.reset_peripherals(Resets::ALL);
        (self.tach.accept_at, self.tach.reject_at) = (NO_INSTANT, NO_INSTANT);
        self.pulse_accepted = NO_INSTANT;
        self.follow_clocks();
        self.follow_inputs();
        self.see_outputs(before);
    }

    /// Devices as after a reset, by their bits in the reset registers.
    pub(crate) fn reset_peripherals(&mut self, resets: Resets) {
        let timer = |bits| Timer::new(bits, self.clocks.timers);
        let Resets { ahb1, apb1, apb2 } = resets;
        for (n, port) in self.ports.iter_mut().enumerate().filter(|(n, _)| ahb1 & 1 << n != 0) {
            *port = Port::new(n);
        }
        for (_, dma) in self.dma.iter_mut().enumerate().filter(|(n, _)| ahb1 & 1 << (21 + n) != 0) {
            *dma = Dma::default();
        }
        for (bit, own, bits) in [(0, &mut self.tim2, 32), (1, &mut self.tim3, 16), (3, &mut self.tim5, 32)] {
            if apb1 & 1 << bit != 0 {
                *own = timer(bits);
            }
        }
        if apb1 & 1 << 14 != 0 {
            self.spi2.reset();
            self.schedule.set(Source::Spi, NO_INSTANT);
        }
        if apb2 & 1 << 4 != 0 {
            self.usart = Usart::default();
            self.schedule.set(Source::Sent, NO_INSTANT);
        }
        if apb2 & 1 << 8 != 0 {
            self.adc = Converters::default();
            self.schedule.set(Source::Converter, NO_INSTANT);
        }
        self.schedule.set(Source::Dma, self.dma[0].due().min(self.dma[1].due()));
        self.follow_timers();
        self.follow_lines();
    }

    /// What the devices ask the interrupt controller for.
    fn follow_lines(&mut self) {
        self.nvic.set_line(interrupt::TIM2, self.tim2.interrupt());
        self.nvic.set_line(interrupt::TIM3, self.tim3.interrupt());
        self.nvic.set_line(interrupt::TIM5, self.tim5.interrupt());
        self.nvic.set_line(interrupt::ADC, self.adc.interrupt());
        self.nvic.set_line(interrupt::USART1, self.usart.interrupt());
        for (dma, lines) in self.dma.iter().zip([interrupt::DMA1, interrupt::DMA2]) {
            for (stream, line) in lines.into_iter().enumerate() {
                self.nvic.set_line(line, dma.interrupt(stream));
            }
        }
    }

    /// The crystal stops swinging.
    pub fn lose_crystal(&mut self) {
        if self.rcc.lose_crystal() {
            self.nvic.pend(exception::NMI);
        }
        self.follow_clocks();
    }

    /// Takes up the clocks that are in force now.
    pub(crate) fn follow_clocks(&mut self) {
        let Some(clocks) = self.rcc.clocks() else { return };
        let now = self.now;
        let fast = if self.rcc.is_on_crystal() { 0.0 } else { self.internal_fast };
        self.time.change(now, fast);
        if clocks != self.clocks {
            self.nvic.settle_tick(now, self.clocks.core);
            self.clocks = clocks;
            for timer in [&mut self.tim2, &mut self.tim3, &mut self.tim5] {
                timer.set_clock(clocks.timers, now);
            }
        }
        self.follow_timers();
        self.schedule.set(Source::Oscillator, self.rcc.due());
        self.schedule.set(Source::SysTick, self.nvic.tick_due(clocks.core));
        self.follow_inputs();
    }

    /// Takes up the world's next deeds, after they were changed from outside.
    pub fn follow_inputs(&mut self) {
        let pin = self.inputs.tach.front().map_or(NO_INSTANT, |edge| self.time.at(edge.0));
        self.schedule.set(Source::Pin, pin);
        let pulse = self.inputs.second_pulses.front().map_or(NO_INSTANT, |&edge| self.time.at(edge));
        self.schedule
            .set(Source::SecondPulse, if self.pulse_accepted == NO_INSTANT { pulse } else { self.pulse_accepted });
        let byte = self.inputs.bytes.front().map_or(NO_INSTANT, |byte| self.time.at(byte.0));
        self.schedule.set(Source::Received, byte);
    }

    pub(crate) fn follow_timers(&mut self) {
        self.schedule.set(Source::Tim2, self.tim2.due());
        self.schedule.set(Source::Tim3, self.tim3.due());
        self.schedule.set(Source::Tim5, self.tim5.due());
    }

    /// Lets time pass until `to`, with everything that happens on the way.
    pub fn advance(&mut self, to: Time) {
        while let Some((at, source)) = self.schedule.take(to) {
            self.now = self.now.max(at);
            self.happen(source, at);
        }
        self.now = self.now.max(to);
    }

    /// Lets time pass until an interrupt waits or a reset has come, at most until `limit`.
    pub fn advance_to_interrupt(&mut self, limit: Time) {
        loop {
            let due = self.schedule.earliest();
            self.advance(due.min(limit));
            if due >= limit || self.restart || self.nvic.has_pending() {
                return;
            }
        }
    }

    /// When something happens next.
    pub fn due(&self) -> Time {
        self.schedule.earliest()
    }

    fn happen(&mut self, source: Source, at: Time) {
        match source {
            Source::Pin => self.on_pin(at),
            Source::Filter => self.on_filter(at),
            Source::SecondPulse => self.on_second_pulse(at),
            Source::Tim2 => {
                let update = self.tim2.overflow(at);
                self.schedule.set(Source::Tim2, self.tim2.due());
                self.on_update(2, update, at);
            }
            Source::Tim3 => {
                let update = self.tim3.overflow(at);
                self.schedule.set(Source::Tim3, self.tim3.due());
                self.on_update(3, update, at);
            }
            Source::Tim3Trigger => {
                if let Some(update) = self.tim3.step_by_master() {
                    self.on_update(3, update, at);
                }
            }
            Source::Tim5 => {
                let update = self.tim5.overflow(at);
                self.schedule.set(Source::Tim5, self.tim5.due());
                self.on_update(5, update, at);
            }
            Source::Tim5Trigger => {
                if let Some(tick) = self.tim5.capture_trigger(at) {
                    self.seen.borders.push(Border { at, tick });
                }
                self.nvic.set_line(interrupt::TIM5, self.tim5.interrupt());
            }
            Source::Converter => self.on_conversion(),
            Source::Dma => self.on_transfers(),
            Source::Sent => self.on_sent(at),
            Source::Received => self.on_received(),
            Source::Spi => self.on_clocked(at),
            Source::Flash => self.flash.finish(&mut self.cells),
            Source::Oscillator => {
                self.rcc.happen(at);
                self.schedule.set(Source::Oscillator, self.rcc.due());
            }
            Source::SysTick => {
                self.nvic.tick(at);
                self.schedule.set(Source::SysTick, self.nvic.tick_due(self.clocks.core));
            }
            Source::Watchdog => self.reset(cause::WATCHDOG),
        }
    }

    /// An update event of a timer: interrupt, DMA, and what its trigger output reaches.
    pub(crate) fn on_update(&mut self, timer: u32, update: Update, at: Time) {
        let behind = at + TRIGGER_CLOCKS * self.clocks.timers;
        match timer {
            2 => self.nvic.set_line(interrupt::TIM2, self.tim2.interrupt()),
            3 => self.nvic.set_line(interrupt::TIM3, self.tim3.interrupt()),
            _ => self.nvic.set_line(interrupt::TIM5, self.tim5.interrupt()),
        }
        self.ask_dma();
        if !update.trigger {
            return;
        }
        if timer == 2 {
            self.adc.trigger(at, self.clocks.apb2);
            self.schedule.set(Source::Converter, self.adc.due());
            if self.tim3.trigger_input().is_some() {
                self.schedule.set(Source::Tim3Trigger, behind);
            }
        } else if timer == 3 && self.tim5.trigger_input().is_some() {
            self.schedule.set(Source::Tim5Trigger, behind);
        }
    }

    fn on_conversion(&mut self) {
        for number in 0..self.adc.each.len() {
            if self.adc.each[number].due() <= self.now {
                self.finish_conversion(number);
            }
        }
        self.schedule.set(Source::Converter, self.adc.due());
        self.nvic.set_line(interrupt::ADC, self.adc.interrupt());
        self.ask_dma();
    }

    fn finish_conversion(&mut self, number: usize) {
        let Some(conversion) = self.adc.each[number].finish() else { return };
        let at = self.time.seconds(conversion.held);
        // An input that is not connected floats; half is as good as anything.
        let level = match conversion.channel {
            channel @ 1..=2 if self.ports[0].mode(channel) != Mode::Analogue => 0.5,
            1 => (self.inputs.analogue)(at),
            2 => (self.inputs.second)(at),
            16..=17 if number == 0 && self.adc.has_reference() => {
                let level = internal_level(conversion.channel, self.inputs.supply_v, self.inputs.temperature_c);
                // Taken in for too short a time the sampling capacitor is half full.
                if conversion.sampling < INTERNAL_SAMPLING { 0.5 * level } else { level }
            }
            _ => 0.5,
        };
        let code = code_of(level);
        let adc = &mut self.adc.each[number];
        adc.deliver(code);
        if self.seen.keep_conversions {
            let sampled = Sampled { trigger: conversion.trigger, code: adc.result() };
            match conversion.channel {
                1 => self.seen.conversions.push(sampled),
                2 => self.seen.second.push(sampled),
                _ => {}
            }
        }
    }

    /// Wired requests: controller, stream, channel, and whether the device asks.
    fn requests(&self) -> [(usize, usize, u32, bool); 6] {
        [
            (1, 0, 0, self.adc.each[0].request),
            (1, 0, 2, self.adc.each[2].request),
            (1, 3, 1, self.adc.each[1].request),
            (0, 2, 5, self.tim3.request),
            (1, 5, 4, self.usart.offers_byte()),
            (1, 7, 4, self.usart.asks_for_byte()),
        ]
    }

    /// Whether a stream's channel leads to a device of the model.
    pub(crate) fn is_wired(&self, controller: usize, stream: usize) -> bool {
        let channel = self.dma[controller].streams[stream].channel();
        self.requests().iter().any(|&(c, s, wanted, _)| (c, s, wanted) == (controller, stream, channel))
    }

    /// Passes requests on to the streams that serve them.
    pub(crate) fn ask_dma(&mut self) {
        let at = self.now + TRANSFER_CYCLES * self.clocks.core;
        for (controller, stream, channel, asks) in self.requests() {
            let stream = &mut self.dma[controller].streams[stream];
            if asks
                && stream.is_enabled()
                && stream.left() > 0
                && stream.channel() == channel
                && stream.due == NO_INSTANT
            {
                stream.due = at;
                let due = self.schedule.at(Source::Dma).min(at);
                self.schedule.set(Source::Dma, due);
            }
        }
    }

    fn on_transfers(&mut self) {
        for controller in [0, 1] {
            for number in 0..8 {
                if self.dma[controller].streams[number].due <= self.now {
                    self.dma[controller].streams[number].due = NO_INSTANT;
                    self.transfer(controller, number);
                    let line = [interrupt::DMA1, interrupt::DMA2][controller][number];
                    self.nvic.set_line(line, self.dma[controller].interrupt(number));
                }
            }
        }
        self.ask_dma();
        let due = self.dma[0].due().min(self.dma[1].due());
        self.schedule.set(Source::Dma, due);
    }

    fn transfer(&mut self, controller: usize, number: usize) {
        let stream = &self.dma[controller].streams[number];
        let (size, memory, device) = (stream.item_bytes(), stream.memory(), stream.device());
        let moved = match stream.direction() {
            Direction::ToMemory => self
                .device_for_dma(controller, device)
                .and_then(|()| self.read(device, size).ok())
                .and_then(|item| self.write_sram(memory, size, item)),
            Direction::ToDevice => {
                let item = stream.ahead;
                self.device_for_dma(controller, device).and(item).and_then(|item| self.write(device, size, item).ok())
            }
        };
        if device == TIM2_RELOAD {
            self.tim3.request = false;
        }
        let stream = &mut self.dma[controller].streams[number];
        if moved.is_none() {
            stream.fail();
            return;
        }
        stream.advance();
        if stream.is_enabled() && stream.direction() == Direction::ToDevice {
            self.read_ahead(controller, number);
        }
    }

    /// The word that waits in a stream's FIFO while it goes to a device.
    pub(crate) fn read_ahead(&mut self, controller: usize, number: usize) {
        let stream = &self.dma[controller].streams[number];
        let item = self.read_memory(stream.memory(), stream.item_bytes());
        let stream = &mut self.dma[controller].streams[number];
        stream.ahead = item;
        if item.is_none() {
            stream.fail();
        }
    }

    /// Memory as a DMA reads it: not the core's own.
    fn read_memory(&self, address: u32, size: u32) -> Option<u32> {
        let bytes = match address {
            SRAM_START.. => self.sram.get((address - SRAM_START) as usize..)?,
            flash::START..CCM_START => self.cells.get((address - flash::START) as usize..)?,
            _ => return None,
        };
        let bytes = bytes.get(..size as usize)?;
        Some(bytes.iter().rev().fold(0, |word, byte| word << 8 | u32::from(*byte)))
    }

    fn write_sram(&mut self, address: u32, size: u32, value: u32) -> Option<()> {
        let at = address.checked_sub(SRAM_START)? as usize;
        let bytes = self.sram.get_mut(at..at + size as usize)?;
        bytes.copy_from_slice(&value.to_le_bytes()[..size as usize]);
        Some(())
    }

    /// Registers that DMA serves; DMA1 reaches APB1 only.
    fn device_for_dma(&self, controller: usize, address: u32) -> Option<()> {
        let served = match controller {
            0 => address == TIM2_RELOAD,
            _ => matches!(address, ADC1_DATA | ADC2_DATA | ADC3_DATA | USART_DATA),
        };
        served.then_some(())
    }

    fn on_sent(&mut self, at: Time) {
        if let Some(byte) = self.usart.finish(at, self.clocks.apb2) {
            let routed = self.ports[0].mode(9) == Mode::Alternate(7);
            if routed {
                self.seen.sent.push((at, byte));
            }
        }
        self.schedule.set(Source::Sent, self.usart.due());
        self.ask_dma();
        self.nvic.set_line(interrupt::USART1, self.usart.interrupt());
    }

    fn on_clocked(&mut self, at: Time) {
        // Nothing answers: the amplifier has no output.
        if let Some(byte) = self.spi2.finish(at, self.clocks.apb1, 0) {
            let port = &self.ports[1];
            let routed = [13, 15].into_iter().all(|pin| port.mode(pin) == Mode::Alternate(5));
            let selected = port.mode(SELECT) == Mode::Output && port.outputs() & 1 << SELECT == 0;
            self.seen.clocked.push(Clocked { at, byte: routed.then_some(byte), selected });
        }
        self.schedule.set(Source::Spi, self.spi2.due());
    }

    fn on_received(&mut self) {
        if let Some((_, byte)) = self.inputs.bytes.pop_front() {
            if self.ports[0].mode(10) == Mode::Alternate(7) {
                let (bits, rate) = (self.inputs.bits, self.inputs.bits_per_second);
                let units = UNITS_PER_SECOND as f64 * bits as f64 / rate;
                let understood = self.usart.understands(units, bits, self.clocks.apb2);
                // Sampled at other places: some other byte.
                self.usart.receive(if understood { byte } else { byte.rotate_left(3) ^ 0x5a });
            }
            self.ask_dma();
        }
        self.follow_inputs();
    }

    fn on_pin(&mut self, at: Time) {
        let Some((_, level)) = self.inputs.tach.pop_front() else { return };
        self.ports[0].drive(0, level);
        let (samples, step) = self.tim5.filter();
        // The first sample of the input that sees the new level.
        let seen = at.div_ceil(step) * step;
        let tach = &mut self.tach;
        tach.level = level;
        if level == tach.accepted {
            // A relapse between two samples is not noticed.
            tach.reject_at = if tach.accept_at == NO_INSTANT { NO_INSTANT } else { seen };
        } else if tach.reject_at <= seen
            && tach.reject_at != NO_INSTANT
            && tach.accept_at != NO_INSTANT
            && tach.reject_at >= at
        {
            tach.reject_at = NO_INSTANT;
        } else {
            tach.reject_at = NO_INSTANT;
            tach.accept_at = seen + Time::from(samples.saturating_sub(1)) * step;
        }
        self.schedule.set(Source::Filter, tach.accept_at.min(tach.reject_at));
        self.follow_inputs();
    }

    fn on_filter(&mut self, at: Time) {
        let tach = &mut self.tach;
        if tach.reject_at <= at {
            (tach.reject_at, tach.accept_at) = (NO_INSTANT, NO_INSTANT);
            return;
        }
        tach.accept_at = NO_INSTANT;
        tach.accepted = tach.level;
        let level = tach.level;
        if self.ports[0].mode(0) == Mode::Alternate(2) && self.tim5.capture_pin(level, at) {
            let (samples, step) = self.tim5.filter();
            let filter_ticks = (Time::from(samples) * step / self.clocks.timers) as u32;
            self.seen.captured.push(Captured { at, tick: self.tim5.captured(), filter_ticks });
            self.nvic.set_line(interrupt::TIM5, self.tim5.interrupt());
        }
    }

    /// The pulse per second rises, or its filter has accepted it.
    fn on_second_pulse(&mut self, at: Time) {
        if self.pulse_accepted == NO_INSTANT {
            self.inputs.second_pulses.pop_front();
            let (samples, step) = self.tim5.fourth_filter();
            self.pulse_accepted = at.div_ceil(step) * step + Time::from(samples.saturating_sub(1)) * step;
        } else {
            self.pulse_accepted = NO_INSTANT;
            if self.ports[0].mode(SECOND_PULSE) == Mode::Alternate(2) {
                self.tim5.capture_fourth(at);
            }
        }
        self.follow_inputs();
    }

    /// Levels of all outputs.
    pub(crate) fn outputs(&self) -> [u32; PORTS] {
        self.ports.each_ref().map(Port::outputs)
    }

    /// Notes what has changed at the outputs.
    pub(crate) fn see_outputs(&mut self, before: [u32; PORTS]) {
        for (port, (was, is)) in before.into_iter().zip(self.outputs()).enumerate() {
            for pin in (0..16).filter(|pin| (was ^ is) & 1 << pin != 0) {
                self.seen.pins.push(PinChange { at: self.now, port, pin, level: is & 1 << pin != 0 });
            }
        }
    }
}

/// Level of the temperature sensor (channel 16) or of the internal reference (17), as a share of the supply.
fn internal_level(channel: u32, supply_v: f64, temperature_c: f64) -> f64 {
    let volts = if channel == 17 { REFERENCE_V } else { SENSOR_V + SENSOR_SLOPE * (temperature_c - 25.0) };
    volts / supply_v
}

/// The code of 12 bits of a share of the reference.
fn code_of(level: f64) -> u16 {
    (level * CODES).round().clamp(0.0, CODES - 1.0) as u16
}

fn factory_codes() -> [u16; 3] {
    let [cold, hot] = FACTORY_TEMPERATURES_C;
    [(17, cold), (16, cold), (16, hot)]
        .map(|(channel, celsius)| code_of(internal_level(channel, FACTORY_SUPPLY_V, celsius)))
}

impl Default for Chip {
    fn default() -> Self {
        Self::new()
    }
}

const TIM2_RELOAD: u32 = 0x4000_002c;
const ADC1_DATA: u32 = 0x4001_204c;
const ADC2_DATA: u32 = 0x4001_214c;
const ADC3_DATA: u32 = 0x4001_224c;
const USART_DATA: u32 = 0x4001_1004;
