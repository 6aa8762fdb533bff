//! Exception frames: what the core pushes and pops by itself. Armv7-M manual, sections B1.5.6 to B1.5.8.
//!
//! Eight words, or twenty-six where the floating-point registers are in use; these are pushed at once, never lazily.

use crate::chip::Chip;
use crate::unicorn::{Engine, Register};

/// Bit of the status register that tells that a word was skipped to align the frame.
const ALIGNMENT: u32 = 1 << 9;
/// Bit of the status register: Thumb.
const THUMB: u32 = 1 << 24;
/// Floating-point context active, in the control register.
const FPCA: u32 = 1 << 2;
const BASIC_WORDS: u32 = 8;
const EXTENDED_WORDS: u32 = 26;

/// A frame on the stack.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// With floating-point registers.
    pub extended: bool,
}

/// A frame pushed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pushed {
    /// Its form.
    pub frame: Frame,
    /// Whether there was memory for all of it.
    pub whole: bool,
}

const BASIC_REGISTERS: [Register; 6] =
    [Register::r(0), Register::r(1), Register::r(2), Register::r(3), Register::r(12), Register::LR];

/// Pushes a frame for a return to `pc`.
pub fn push(engine: &mut Engine, chip: &mut Chip, pc: u32) -> Pushed {
    let control = engine.get(Register::CONTROL);
    let frame = Frame { extended: control & FPCA != 0 && chip.nvic.keeps_float() };
    let words = if frame.extended { EXTENDED_WORDS } else { BASIC_WORDS };
    let before = engine.get(Register::SP);
    let skipped = chip.nvic.aligns_frames() && before & 4 != 0;
    let sp = before.wrapping_sub(4 * words) & if skipped { !7 } else { !3 };
    let status = engine.get(Register::XPSR) & !ALIGNMENT | THUMB | if skipped { ALIGNMENT } else { 0 };
    let mut values: Vec<u32> = BASIC_REGISTERS.iter().map(|register| engine.get(*register)).collect();
    values.extend([pc, status]);
    if frame.extended {
        values.extend((0..16).map(|n| engine.get(Register::s(n))));
        values.extend([engine.get(Register::FPSCR), 0]);
    }
    let mut whole = true;
    for (n, value) in (0..).zip(values) {
        whole &= chip.poke(sp.wrapping_add(4 * n), value).is_some();
    }
    engine.set(Register::SP, sp);
    engine.set(Register::CONTROL, control & !FPCA);
    // No block of conditional instructions is open in the handler.
    engine.set(Register::XPSR, THUMB);
    Pushed { frame, whole }
}

/// Pops a frame; gives the address to go on at, `None` where the stack is not in memory.
pub fn pop(engine: &mut Engine, chip: &Chip, frame: Frame) -> Option<u32> {
    let sp = engine.get(Register::SP);
    let word = |n: u32| chip.peek(sp.wrapping_add(4 * n));
    for (n, register) in (0..).zip(BASIC_REGISTERS) {
        engine.set(register, word(n)?);
    }
    let (pc, status) = (word(6)?, word(7)?);
    if frame.extended {
        for n in 0..16 {
            engine.set(Register::s(n), word(8 + u32::from(n))?);
        }
        engine.set(Register::FPSCR, word(24)?);
    }
    let words = if frame.extended { EXTENDED_WORDS } else { BASIC_WORDS };
    let skipped = if status & ALIGNMENT != 0 { 4 } else { 0 };
    engine.set(Register::SP, sp.wrapping_add(4 * words) | skipped);
    let control = engine.get(Register::CONTROL) & !FPCA;
    engine.set(Register::CONTROL, control | if frame.extended { FPCA } else { 0 });
    engine.set(Register::XPSR, status & !ALIGNMENT);
    Some(pc)
}

/// What the link register holds in a handler: how to return.
pub fn exc_return(frame: Frame, nested: bool) -> u32 {
    let basic = if nested { 0xffff_fff1 } else { 0xffff_fff9 };
    if frame.extended { basic & !0x10 } else { basic }
}

/// Registers after reset.
pub fn reset(engine: &mut Engine) {
    for register in all_registers() {
        engine.set(register, 0);
    }
    engine.set(Register::LR, u32::MAX);
    engine.set(Register::XPSR, THUMB);
}

/// All registers but the program counter, in an order in which they can be set.
pub fn all_registers() -> impl Iterator<Item = Register> {
    let general = (0..13).map(Register::r);
    let float = (0..32).map(Register::s);
    let own = [
        Register::CONTROL,
        Register::SP,
        Register::LR,
        Register::FPSCR,
        Register::XPSR,
        Register::PRIMASK,
        Register::BASEPRI,
        Register::FAULTMASK,
    ];
    general.chain(float).chain(own)
}
