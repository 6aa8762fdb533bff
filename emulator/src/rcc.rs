//! Reset and clock control: oscillators, PLL, bus dividers, clock gates, reset flags. RM0090 section 7.
//!
//! Oscillators take their time, a crystal may be absent or fail, the PLL may never lock. What runs without its clock
//! is found by [`Rcc::is_clocked`].

use crate::error::{Access, Refusal, within};
use crate::time::{NO_INSTANT, Time, UNITS_PER_SECOND};

/// Units of a cycle of the internal oscillator, 16 MHz.
const INTERNAL_CYCLE: Time = 21;
/// Units of a cycle of the crystal, 8 MHz.
const CRYSTAL: Time = 42;
/// The crystal's start, data sheet: 2 ms.
const CRYSTAL_START: Time = UNITS_PER_SECOND / 500;
/// The PLL's lock, data sheet: 75 us to 200 us.
const PLL_LOCK: Time = UNITS_PER_SECOND / 10_000;

const HSION: u32 = 1 << 0;
const HSIRDY: u32 = 1 << 1;
const HSEON: u32 = 1 << 16;
const HSERDY: u32 = 1 << 17;
const CSSON: u32 = 1 << 19;
const PLLON: u32 = 1 << 24;
const PLLRDY: u32 = 1 << 25;
/// Source of the PLL in `PLLCFGR`: the crystal.
const PLL_FROM_CRYSTAL: u32 = 1 << 22;
/// Clock security flag and its clearing bit in `CIR`.
const CSSF: u32 = 1 << 7;
const CSSC: u32 = 1 << 23;

/// Flags of `CSR`.
pub mod cause {
    /// Brown-out: comes with every power-on.
    pub const BROWN_OUT: u32 = 1 << 25;
    /// The reset pin, which every reset pulls.
    pub const PIN: u32 = 1 << 26;
    /// Power came.
    pub const POWER: u32 = 1 << 27;
    /// The program asked.
    pub const SOFTWARE: u32 = 1 << 28;
    /// Independent watchdog.
    pub const WATCHDOG: u32 = 1 << 29;
}
const CLEAR_FLAGS: u32 = 1 << 24;
const FLAGS: u32 = 0xfe00_0000;

/// What the oscillators do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Oscillators {
    /// A crystal of 8 MHz is there and swings.
    pub crystal: bool,
    /// The PLL locks.
    pub pll: bool,
}

/// Lengths of a cycle, in units of time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clocks {
    /// Core and AHB.
    pub core: Time,
    /// APB1.
    pub apb1: Time,
    /// Timers of APB1.
    pub timers: Time,
    /// APB2: converter and USART1.
    pub apb2: Time,
}

/// A clock gate: register and bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gate {
    /// `AHB1ENR`.
    Ahb1(u8),
    /// `APB1ENR`.
    Apb1(u8),
    /// `APB2ENR`.
    Apb2(u8),
}

/// Devices held in reset: bits of the registers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Resets {
    /// `AHB1RSTR`.
    pub ahb1: u32,
    /// `APB1RSTR`.
    pub apb1: u32,
    /// `APB2RSTR`.
    pub apb2: u32,
}

impl Resets {
    /// Everything.
    pub const ALL: Self = Self { ahb1: u32::MAX, apb1: u32::MAX, apb2: u32::MAX };
}

/// The block.
#[derive(Clone, Debug)]
pub struct Rcc {
    /// What the oscillators do from now on.
    pub oscillators: Oscillators,
    cr: u32,
    pllcfgr: u32,
    cfgr: u32,
    cir: u32,
    ahb1enr: u32,
    apb1enr: u32,
    apb2enr: u32,
    resets: Resets,
    csr: u32,
    crystal_ready: Time,
    pll_ready: Time,
}

impl Rcc {
    /// After power came.
    pub fn new() -> Self {
        Self {
            oscillators: Oscillators { crystal: true, pll: true },
            cr: 0x83,
            pllcfgr: 0x2400_3010,
            cfgr: 0,
            cir: 0,
            ahb1enr: 0x0010_0000,
            apb1enr: 0,
            apb2enr: 0,
            resets: Resets::default(),
            csr: cause::BROWN_OUT | cause::PIN | cause::POWER,
            crystal_ready: NO_INSTANT,
            pll_ready: NO_INSTANT,
        }
    }

    /// Everything but the reset flags, which gain `cause`, and the oscillators' health.
    pub fn reset(&mut self, cause: u32) {
        *self = Self { oscillators: self.oscillators, csr: self.csr | cause | cause::PIN, ..Self::new() };
    }

    /// Whether a gate is open.
    pub fn is_clocked(&self, gate: Gate) -> bool {
        let (register, bit) = match gate {
            Gate::Ahb1(bit) => (self.ahb1enr, bit),
            Gate::Apb1(bit) => (self.apb1enr, bit),
            Gate::Apb2(bit) => (self.apb2enr, bit),
        };
        register & 1 << bit != 0
    }

    /// Devices held in reset.
    pub fn held(&self) -> Resets {
        self.resets
    }

    /// Whether the crystal drives the core, directly or by the PLL.
    pub fn is_on_crystal(&self) -> bool {
        match self.cfgr >> 2 & 3 {
            0 => false,
            1 => true,
            _ => self.pllcfgr & PLL_FROM_CRYSTAL != 0,
        }
    }

    /// The clocks in force; `None` where they are no whole number of units.
    pub fn clocks(&self) -> Option<Clocks> {
        let core = match self.cfgr >> 2 & 3 {
            0 => INTERNAL_CYCLE,
            1 => CRYSTAL,
            _ => self.pll_cycle()?,
        };
        let divider = |field: u32| if field & 4 == 0 { 1 } else { 2 << (field & 3) };
        let (first, second) = (divider(self.cfgr >> 10 & 7), divider(self.cfgr >> 13 & 7));
        // Timers run at twice their bus where it is divided.
        Some(Clocks { core, apb1: core * first, timers: core * first.div_ceil(2), apb2: core * second })
    }

    fn pll_cycle(&self) -> Option<Time> {
        let source = if self.pllcfgr & PLL_FROM_CRYSTAL != 0 { CRYSTAL } else { INTERNAL_CYCLE };
        let (m, n) = (Time::from(self.pllcfgr & 0x3f), Time::from(self.pllcfgr >> 6 & 0x1ff));
        let p = 2 * (1 + Time::from(self.pllcfgr >> 16 & 3));
        let product = source * m * p;
        (n != 0 && product % n == 0 && product >= n).then_some(product / n)
    }

    /// When an oscillator or the PLL becomes ready.
    pub fn due(&self) -> Time {
        self.crystal_ready.min(self.pll_ready)
    }

    /// Something is ready.
    pub fn happen(&mut self, now: Time) {
        if self.crystal_ready <= now {
            self.crystal_ready = NO_INSTANT;
            self.cr |= HSERDY;
        }
        if self.pll_ready <= now {
            self.pll_ready = NO_INSTANT;
            self.cr |= PLLRDY;
        }
    }

    /// The crystal stops swinging; true where the clock security system raises the non-maskable interrupt.
    pub fn lose_crystal(&mut self) -> bool {
        self.oscillators.crystal = false;
        let (guarded, on_crystal) = (self.cr & CSSON != 0 && self.cr & HSERDY != 0, self.is_on_crystal());
        self.crystal_ready = NO_INSTANT;
        self.cr &= !HSERDY;
        if !guarded {
            return false;
        }
        self.cr &= !(HSEON | CSSON);
        self.cir |= CSSF;
        if on_crystal {
            // The core goes on with the internal oscillator; a PLL that the crystal fed stops.
            self.cfgr &= !0xf;
            self.cr &= !(PLLON | PLLRDY);
            self.cr |= HSION | HSIRDY;
        }
        true
    }

    /// Whether the non-maskable interrupt of the clock security system is still asked for.
    pub fn is_failing(&self) -> bool {
        self.cir & CSSF != 0
    }

    /// Reads a register.
    ///
    /// # Errors
    /// [`Refusal::Register`].
    pub fn read(&self, offset: u32) -> Access<u32> {
        Ok(match offset {
            0x00 => self.cr,
            0x04 => self.pllcfgr,
            0x08 => self.cfgr,
            0x0c => self.cir,
            0x10 => self.resets.ahb1,
            0x14 => 0,
            0x20 => self.resets.apb1,
            0x24 => self.resets.apb2,
            0x30 => self.ahb1enr,
            0x40 => self.apb1enr,
            0x44 => self.apb2enr,
            0x74 => self.csr,
            _ => return Err(Refusal::Register),
        })
    }

    /// Writes a register. `wait_states` is the flash's.
    ///
    /// # Errors
    /// A register or bit that is not modelled, or what the manual forbids.
    pub fn write(&mut self, offset: u32, value: u32, now: Time, wait_states: u32) -> Access<()> {
        match offset {
            0x00 => self.control(within(value, 0x0fff_ffff)?, now)?,
            0x04 if self.cr & PLLON != 0 => return Err(Refusal::Forbidden("PLLCFGR is fixed while the PLL runs")),
            0x04 => self.pllcfgr = within(value, 0x2f43_7fff)?,
            0x08 => self.configure(within(value, 0x0000_fcff)?, wait_states)?,
            0x0c if value & CSSC != 0 => self.cir &= !CSSF,
            0x0c => drop(within(value, CSSF)?),
            0x10 => self.resets.ahb1 = within(value, 0x2260_11ff)?,
            // Nothing on AHB2 is modelled that could be reset.
            0x14 => drop(within(value, 0xf1)?),
            0x20 => self.resets.apb1 = within(value, 0xf6fe_c9ff)?,
            0x24 => self.resets.apb2 = within(value, 0x0007_5933)?,
            0x30 => self.ahb1enr = within(value, 0x0070_01ff)?,
            0x40 => self.apb1enr = within(value, 0x36fe_c9ff)?,
            0x44 => self.apb2enr = within(value, 0x0007_5f33)?,
            0x74 if value & CLEAR_FLAGS != 0 => self.csr &= !FLAGS,
            0x74 => self.csr = self.csr & FLAGS | within(value & !FLAGS, 1)?,
            _ => return Err(Refusal::Register),
        }
        Ok(())
    }

    fn control(&mut self, value: u32, now: Time) -> Access<()> {
        let writable = HSION | HSEON | CSSON | PLLON | 0xf8;
        let before = self.cr;
        self.cr = before & !writable | value & writable;
        let (risen, fallen) = (self.cr & !before, before & !self.cr);
        if fallen & PLLON != 0 && self.cfgr >> 2 & 3 == 2 {
            return Err(Refusal::Forbidden("the PLL drives the core"));
        }
        if risen & HSEON != 0 && self.oscillators.crystal {
            self.crystal_ready = now + CRYSTAL_START;
        }
        if fallen & HSEON != 0 {
            self.crystal_ready = NO_INSTANT;
            self.cr &= !HSERDY;
        }
        if risen & PLLON != 0 {
            let fed = self.pllcfgr & PLL_FROM_CRYSTAL == 0 || self.cr & HSERDY != 0;
            self.pll_ready = if self.oscillators.pll && fed { now + PLL_LOCK } else { NO_INSTANT };
        }
        if fallen & PLLON != 0 {
            self.pll_ready = NO_INSTANT;
            self.cr &= !PLLRDY;
        }
        if self.cr & HSION != 0 {
            self.cr |= HSIRDY;
        } else {
            self.cr &= !HSIRDY;
        }
        Ok(())
    }

    fn configure(&mut self, value: u32, wait_states: u32) -> Access<()> {
        let ready = match value & 3 {
            0 => self.cr & HSIRDY != 0,
            1 => self.cr & HSERDY != 0,
            2 => self.cr & PLLRDY != 0,
            _ => false,
        };
        if !ready {
            return Err(Refusal::Forbidden("the clock chosen is not ready"));
        }
        if value & 0xf0 != 0 {
            return Err(Refusal::Bits(value & 0xf0));
        }
        self.cfgr = value & !0xc | (value & 3) << 2;
        let Some(clocks) = self.clocks() else { return Err(Refusal::Forbidden("a clock of no whole number of units")) };
        // One wait state more every 30 MHz, at 2.7 V to 3.6 V (RM0090 table 10).
        let megahertz = UNITS_PER_SECOND / 1_000_000 / clocks.core;
        if u64::from(wait_states) < megahertz.saturating_sub(1) / 30 {
            return Err(Refusal::Forbidden("too few wait states of the flash for this clock"));
        }
        if clocks.apb1 < UNITS_PER_SECOND / 42_000_000 || clocks.apb2 < UNITS_PER_SECOND / 84_000_000 {
            return Err(Refusal::Forbidden("APB1 above 42 MHz or APB2 above 84 MHz"));
        }
        Ok(())
    }
}

impl Default for Rcc {
    fn default() -> Self {
        Self::new()
    }
}
