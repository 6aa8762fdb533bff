//! What lies beside the core: interrupt controller, system control block, SysTick. Armv7-M manual, sections B1.5,
//! B3.2 to B3.4.
//!
//! Priorities of four bits without groups of sub-priorities, tail-chaining by the processor ([`crate::cpu`]).

use crate::error::{Access, Refusal, within};
use crate::time::{NO_INSTANT, Time};

/// Numbers of exceptions.
pub mod exception {
    /// Non-maskable interrupt.
    pub const NMI: u16 = 2;
    /// Hard fault.
    pub const HARD_FAULT: u16 = 3;
    /// Supervisor call.
    pub const SV_CALL: u16 = 11;
    /// Pendable request.
    pub const PEND_SV: u16 = 14;
    /// System timer.
    pub const SYS_TICK: u16 = 15;
    /// First interrupt of a device.
    pub const FIRST_INTERRUPT: u16 = 16;
}

use exception::{FIRST_INTERRUPT, HARD_FAULT, NMI, PEND_SV, SYS_TICK};

/// Priority of a core that handles nothing.
const IDLE_PRIORITY: i16 = 256;
/// Interrupts of an STM32F405, in words.
const WORDS: usize = 3;
const VECTOR_KEY: u32 = 0x05fa;
const SYSRESETREQ: u32 = 1 << 2;
/// Both fields that open the floating-point unit, in `CPACR`.
const FLOAT: u32 = 0xf << 20;
const TICK_ENABLE: u32 = 1 << 0;
const TICK_INTERRUPT: u32 = 1 << 1;
const TICK_CORE: u32 = 1 << 2;
const TICK_PASSED: u32 = 1 << 16;

/// Why a fault was taken, for `CFSR`.
pub mod fault {
    /// Fetch from where nothing is.
    pub const FETCH: u32 = 1 << 8;
    /// Access to where nothing is, with its address in `BFAR`.
    pub const PRECISE_ERROR: u32 = 1 << 9 | 1 << 15;
    /// The exception's frame could not be pushed.
    pub const STACKING: u32 = 1 << 12;
    /// No such instruction.
    pub const UNDEFINED_INSTRUCTION: u32 = 1 << 16;
    /// The floating-point unit is not open.
    pub const NO_COPROCESSOR: u32 = 1 << 19;
}

/// Masks of the core.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Masks {
    /// Bit 0 masks everything that has a priority of its own.
    pub primask: u32,
    /// Masks this priority and those behind it, unless zero.
    pub basepri: u32,
    /// Bit 0 masks hard faults, too.
    pub faultmask: u32,
}

/// The state.
#[derive(Clone, Debug)]
pub struct Nvic {
    enabled: [u32; WORDS],
    pending: [u32; WORDS],
    lines: [u32; WORDS],
    priority: [u8; 32 * WORDS],
    pending_system: u16,
    system_priority: [u8; 16],
    /// Exceptions being handled, the newest last.
    active: Vec<u16>,
    vtor: u32,
    cpacr: u32,
    ccr: u32,
    cfsr: u32,
    hfsr: u32,
    bfar: u32,
    fpccr: u32,
    demcr: u32,
    /// The program asks for a reset.
    pub reset_request: bool,
    tick: SysTick,
}

#[derive(Clone, Debug, Default)]
struct SysTick {
    control: u32,
    reload: u32,
    /// Count at `since`.
    count: u32,
    since: Time,
    passed: bool,
}

impl Default for Nvic {
    fn default() -> Self {
        Self {
            enabled: [0; WORDS],
            pending: [0; WORDS],
            lines: [0; WORDS],
            priority: [0; 32 * WORDS],
            pending_system: 0,
            system_priority: [0; 16],
            active: Vec::new(),
            vtor: 0,
            cpacr: 0,
            ccr: 0x200,
            cfsr: 0,
            hfsr: 0,
            bfar: 0,
            fpccr: 0xc000_0000,
            demcr: 0,
            reset_request: false,
            tick: SysTick::default(),
        }
    }
}

impl Nvic {
    /// A device asks for its interrupt, or does so no longer.
    pub fn set_line(&mut self, interrupt: usize, level: bool) {
        let (word, bit) = (interrupt / 32, 1 << (interrupt % 32));
        if level {
            self.pending[word] |= bit & !self.lines[word];
            self.lines[word] |= bit;
        } else {
            self.lines[word] &= !bit;
        }
    }

    /// Makes one of the system's exceptions pending.
    pub fn pend(&mut self, number: u16) {
        self.pending_system |= 1 << number;
    }

    /// Whether anything waits that masks or priorities do not rule out at once.
    pub fn has_pending(&self) -> bool {
        self.pending_system != 0
            || self.pending.iter().zip(&self.enabled).any(|(pending, enabled)| pending & enabled != 0)
    }

    fn priority_of(&self, number: u16) -> i16 {
        match number {
            NMI => -2,
            HARD_FAULT => -1,
            system if system < FIRST_INTERRUPT => self.system_priority[usize::from(system)].into(),
            interrupt => self.priority[usize::from(interrupt - FIRST_INTERRUPT)].into(),
        }
    }

    /// Priority at which the core works, masks included.
    pub fn execution_priority(&self, masks: Masks) -> i16 {
        let handled = self.active.iter().map(|&number| self.priority_of(number)).min().unwrap_or(IDLE_PRIORITY);
        let masked = match masks {
            Masks { faultmask: 1, .. } => -1,
            Masks { primask: 1, .. } => 0,
            Masks { basepri: 0, .. } => IDLE_PRIORITY,
            Masks { basepri, .. } => basepri as i16,
        };
        handled.min(masked)
    }

    /// The exception that would be taken next, by priority and then by number.
    pub fn next(&self, masks: Masks) -> Option<u16> {
        if !self.has_pending() {
            return None;
        }
        let mut best = (self.execution_priority(masks), u16::MAX);
        let mut consider = |mut bits: u32, first: u16| {
            while bits != 0 {
                let number = first + bits.trailing_zeros() as u16;
                let priority = self.priority_of(number);
                // Of equal priority the lowest number comes first, and what is handled goes on.
                if priority < best.0 {
                    best = (priority, number);
                }
                bits &= bits - 1;
            }
        };
        consider(self.pending_system.into(), 0);
        for (word, (pending, enabled)) in self.pending.iter().zip(&self.enabled).enumerate() {
            consider(pending & enabled, FIRST_INTERRUPT + 32 * word as u16);
        }
        (best.1 != u16::MAX).then_some(best.1)
    }

    /// An exception is taken.
    pub fn enter(&mut self, number: u16) {
        if number < FIRST_INTERRUPT {
            self.pending_system &= !(1 << number);
        } else {
            let interrupt = usize::from(number - FIRST_INTERRUPT);
            self.pending[interrupt / 32] &= !(1 << (interrupt % 32));
        }
        self.active.push(number);
    }

    /// The newest exception returns; a line that is still up asks again. Gives its number.
    pub fn leave(&mut self) -> Option<u16> {
        let number = self.active.pop()?;
        if let Some(interrupt) = number.checked_sub(FIRST_INTERRUPT).map(usize::from) {
            let (word, bit) = (interrupt / 32, 1 << (interrupt % 32));
            self.pending[word] |= self.lines[word] & bit;
        }
        Some(number)
    }

    /// The exception being handled, zero for none.
    pub fn current(&self) -> u16 {
        self.active.last().copied().unwrap_or(0)
    }

    /// Exceptions being handled.
    pub fn depth(&self) -> usize {
        self.active.len()
    }

    /// Address of the vector table.
    pub fn vectors(&self) -> u32 {
        self.vtor
    }

    /// Whether frames are aligned to eight bytes.
    pub fn aligns_frames(&self) -> bool {
        self.ccr & 0x200 != 0
    }

    /// Whether the floating-point unit may be used.
    pub fn has_float(&self) -> bool {
        self.cpacr & FLOAT == FLOAT
    }

    /// Whether exceptions keep the floating-point registers.
    pub fn keeps_float(&self) -> bool {
        self.fpccr & 0x8000_0000 != 0
    }

    /// Notes why a fault is taken; every one becomes a hard fault, because the program enables no other.
    pub fn note_fault(&mut self, why: u32, address: u32) {
        self.cfsr |= why;
        self.hfsr |= 1 << 30;
        if why == fault::PRECISE_ERROR {
            self.bfar = address;
        }
    }

    /// When SysTick reaches zero next; `core` is the length of a cycle.
    pub fn tick_due(&self, core: Time) -> Time {
        let tick = &self.tick;
        if tick.control & TICK_ENABLE == 0 || tick.reload == 0 {
            return NO_INSTANT;
        }
        // From zero it takes one clock to be loaded.
        let left = if tick.count == 0 { Time::from(tick.reload) + 1 } else { tick.count.into() };
        tick.since + left * self.tick_step(core)
    }

    fn tick_step(&self, core: Time) -> Time {
        if self.tick.control & TICK_CORE != 0 { core } else { 8 * core }
    }

    /// SysTick has reached zero.
    pub fn tick(&mut self, at: Time) {
        (self.tick.count, self.tick.since, self.tick.passed) = (0, at, true);
        if self.tick.control & TICK_INTERRUPT != 0 {
            self.pend(SYS_TICK);
        }
    }

    fn tick_count(&self, now: Time, core: Time) -> u32 {
        let tick = &self.tick;
        if tick.control & TICK_ENABLE == 0 {
            return tick.count;
        }
        let passed = (now.saturating_sub(tick.since) / self.tick_step(core)) as u32;
        if tick.count == 0 && passed > 0 {
            tick.reload.saturating_sub(passed - 1)
        } else {
            tick.count.saturating_sub(passed)
        }
    }

    /// Brings SysTick's count up to date, before the clock changes.
    pub fn settle_tick(&mut self, now: Time, core: Time) {
        (self.tick.count, self.tick.since) = (self.tick_count(now, core), now);
    }

    /// Reads a register by its offset from 0xe000e000.
    ///
    /// # Errors
    /// [`Refusal::Register`].
    pub fn read(&mut self, offset: u32, now: Time, core: Time) -> Access<u32> {
        let word = |base: u32| (offset - base) as usize / 4;
        Ok(match offset {
            0x010 => self.tick.control | if std::mem::take(&mut self.tick.passed) { TICK_PASSED } else { 0 },
            0x014 => self.tick.reload,
            0x018 => self.tick_count(now, core),
            0x100..0x10c => self.enabled[word(0x100)],
            0x180..0x18c => self.enabled[word(0x180)],
            0x200..0x20c => self.pending[word(0x200)],
            0x280..0x28c => self.pending[word(0x280)],
            0x300..0x30c => self.active_bits(word(0x300)),
            0x400..0x460 => four(&self.priority, offset - 0x400),
            // Cortex-M4 r0p1.
            0xd00 => 0x410f_c241,
            0xd04 => self.state(),
            0xd08 => self.vtor,
            0xd0c => 0xfa05_0000,
            0xd10 => 0,
            0xd14 => self.ccr,
            0xd18..0xd24 => four(&self.system_priority, offset - 0xd14),
            0xd24 => 0,
            0xd28 => self.cfsr,
            0xd2c => self.hfsr,
            0xd34 | 0xd38 => self.bfar,
            0xd88 => self.cpacr,
            0xdf0 => 0,
            0xdfc => self.demcr,
            0xf34 => self.fpccr,
            _ => return Err(Refusal::Register),
        })
    }

    fn state(&self) -> u32 {
        let first = self.next(Masks::default()).unwrap_or(0);
        u32::from(self.current()) | u32::from(first) << 12 | u32::from(first != 0) << 22
    }

    fn active_bits(&self, word: usize) -> u32 {
        let numbers = self.active.iter().filter_map(|number| number.checked_sub(FIRST_INTERRUPT));
        numbers.filter(|n| usize::from(n / 32) == word).fold(0, |bits, n| bits | 1 << (n % 32))
    }

    /// Writes a register.
    ///
    /// # Errors
    /// A register or bit that is not modelled.
    pub fn write(&mut self, offset: u32, value: u32, now: Time, core: Time) -> Access<()> {
        let word = |base: u32| (offset - base) as usize / 4;
        match offset {
            0x010 => {
                self.settle_tick(now, core);
                self.tick.control = within(value & !TICK_PASSED, TICK_ENABLE | TICK_INTERRUPT | TICK_CORE)?;
            }
            0x014 => self.tick.reload = within(value, 0x00ff_ffff)?,
            0x018 => (self.tick.count, self.tick.since, self.tick.passed) = (0, now, false),
            0x100..0x10c => self.enabled[word(0x100)] |= value,
            0x180..0x18c => self.enabled[word(0x180)] &= !value,
            0x200..0x20c => self.pending[word(0x200)] |= value,
            0x280..0x28c => {
                self.pending[word(0x280)] = self.pending[word(0x280)] & !value | self.lines[word(0x280)] & value
            }
            0x400..0x460 => set_four(&mut self.priority, offset - 0x400, value),
            0xd04 => self.set_state(within(value, 0x9e00_0000)?),
            0xd08 => self.vtor = within(value, 0x3fff_ff80)?,
            0xd0c => self.request_reset(value)?,
            0xd10 => drop(within(value, 0)?),
            0xd14 => self.ccr = within(value, 0x31b)?,
            0xd18..0xd24 => set_four(&mut self.system_priority, offset - 0xd14, value),
            0xd28 => self.cfsr &= !value,
            0xd2c => self.hfsr &= !value,
            0xd88 => self.cpacr = within(value, FLOAT)?,
            0xdfc => self.demcr = value,
            0xf34 => self.fpccr = value,
            _ => return Err(Refusal::Register),
        }
        Ok(())
    }

    /// Writes one priority of an interrupt, as programs do by bytes.
    ///
    /// # Errors
    /// [`Refusal::Register`] for anything else.
    pub fn write_byte(&mut self, offset: u32, value: u8) -> Access<()> {
        match offset {
            0x400..0x460 => self.priority[offset as usize - 0x400] = value & 0xf0,
            0xd18..0xd24 => self.system_priority[offset as usize - 0xd14] = value & 0xf0,
            _ => return Err(Refusal::Register),
        }
        Ok(())
    }

    fn set_state(&mut self, value: u32) {
        for (bit, number, pend) in
            [(31, NMI, true), (28, PEND_SV, true), (27, PEND_SV, false), (26, SYS_TICK, true), (25, SYS_TICK, false)]
        {
            if value & 1 << bit != 0 {
                let mask = 1 << number;
                self.pending_system = if pend { self.pending_system | mask } else { self.pending_system & !mask };
            }
        }
    }

    fn request_reset(&mut self, value: u32) -> Access<()> {
        if value >> 16 != VECTOR_KEY {
            return Err(Refusal::Forbidden("AIRCR is written without its key"));
        }
        within(value & 0xffff, SYSRESETREQ)?;
        self.reset_request |= value & SYSRESETREQ != 0;
        Ok(())
    }
}

fn four(bytes: &[u8], offset: u32) -> u32 {
    (0..4).fold(0, |word, n| word | u32::from(bytes[offset as usize + n]) << (8 * n))
}

fn set_four(bytes: &mut [u8], offset: u32, value: u32) {
    for n in 0..4 {
        // The lower four bits of a priority are not there.
        bytes[offset as usize + n] = (value >> (8 * n)) as u8 & 0xf0;
    }
}
