//! The core: Unicorn executes instructions; exceptions, sleep, stalls, faults and time are done here.
//!
//! Unicorn calls before each block of instructions (a few between two branches). There the block's predecessor is
//! charged, whatever is due happens, and the run is stopped where an exception is to be taken. So interrupts come at
//! block borders only, and all registers read in one block are read at one instant, its beginning. Cycles are a
//! constant times the instructions: the manual of the core gives 1 to 2.5 on code like this.

use crate::chip::{CCM_BYTES, CCM_START, Chip, SRAM_BYTES, SRAM_START};
use crate::error::{Error, Refusal, Result, Violation};
use crate::flash::{self, DATA_START};
use crate::frame::{self, Frame};
use crate::nvic::{Masks, exception, fault};
use crate::rcc::cause;
use crate::time::{NO_INSTANT, Time};
use crate::unicorn::{Code, EXECUTE, Engine, Handle, READ, Register, WRITE, WRITE_REFUSED};
use std::ffi::{c_int, c_uint, c_void};

/// Bytes of flash that the engine executes from; a write to them is the hook's business.
const CODE_BYTES: usize = (DATA_START - flash::START) as usize;
/// Fractions of a unit in which instructions are charged.
const FRACTIONS: u64 = 256;
/// Bits of the status register that tell that a block of conditional instructions is under way.
const CONDITION_BITS: u32 = 0x0600_fc00;
/// Unicorn's number of a return from an exception.
const EXCEPTION_RETURN: u32 = 8;
/// Unicorn's number of a supervisor call.
const SUPERVISOR_CALL: u32 = 2;
/// Where registers are mapped: first address and size.
const DEVICES: [(u32, usize); 2] = [(0x4000_0000, 0x8_0000), (0xe000_0000, 0x10_0000)];
/// The chip's own number and the size of its flash.
const IDENTITY: (u32, usize) = (0x1fff_7000, 0x1000);

/// Why a hook has stopped the run.
#[derive(Clone, Debug)]
enum Stop {
    /// Before a block: time is up, or an exception is to be taken.
    Block,
    /// An exception of the core itself.
    Exception(u32),
    /// The model does not serve an access.
    Refused(u32, Refusal),
    /// Nothing is at an address.
    Unmapped(u32),
}

/// What the hooks work on while the engine runs.
struct Core {
    chip: Chip,
    /// Time of the core, at or ahead of the chip's.
    now: Time,
    /// Charged to the block that runs, fractions of a unit.
    owed: u64,
    /// Below one unit, not charged yet.
    rest: u64,
    /// Fractions of a cycle per instruction.
    pace: u64,
    until: Time,
    /// Next time a hook has to look closer.
    attention: Time,
    block: u32,
    /// The instruction at hand, where each is followed.
    instruction: Option<u32>,
    /// The next block runs whatever waits.
    defer: bool,
    stop: Option<Stop>,
    /// A word of the code's flash that the engine is about to store into, and what it holds until the controller has
    /// programmed it.
    stored: Option<(usize, [u8; 4])>,
    /// The code in flash as the engine knows it.
    known: Vec<u8>,
    /// Bytes and instructions of a block by its half-word in flash.
    lengths: Vec<(u16, u16)>,
    instructions: u64,
    /// Where a run by instructions ends.
    limit: u64,
    float: bool,
    stopper: unsafe extern "C" fn(Handle) -> c_int,
}

/// The processor with its chip.
pub struct Cpu {
    engine: Engine,
    core: *mut Core,
    pc: u32,
    sleeping: bool,
    /// Frames on the stack, the newest last.
    frames: Vec<Frame>,
    unmapped_is_fault: bool,
}

// SAFETY: the core belongs to this value alone.
unsafe impl Send for Cpu {}

/// Everything but the memory of the host: for going on from here again.
#[derive(Clone)]
pub struct Snapshot {
    chip: Chip,
    owed: u64,
    rest: u64,
    pc: u32,
    sleeping: bool,
    frames: Vec<Frame>,
    registers: Vec<u32>,
    instructions: u64,
}

impl Cpu {
    /// A processor before reset, around a chip, at so many cycles per instruction.
    ///
    /// # Errors
    /// [`Error::Absent`] without Unicorn.
    pub fn new(chip: Chip, cycles_per_instruction: f64) -> Result<Self> {
        let mut engine = Engine::new()?;
        let lengths = vec![(0, 0); (flash::BYTES / 2) as usize];
        let core = Box::into_raw(Box::new(Core {
            now: chip.now,
            chip,
            owed: 0,
            rest: 0,
            pace: (cycles_per_instruction * FRACTIONS as f64).round() as u64,
            until: 0,
            attention: 0,
            block: 0,
            instruction: None,
            defer: false,
            stop: None,
            stored: None,
            known: Vec::new(),
            lengths,
            instructions: 0,
            limit: u64::MAX,
            float: false,
            stopper: engine.stopper(),
        }));
        // SAFETY: just made, and given back when the processor is dropped, after its engine is of no use any more.
        unsafe { connect(&mut engine, core)? };
        let mut cpu = Self { engine, core, pc: 0, sleeping: false, frames: Vec::new(), unmapped_is_fault: false };
        cpu.chip_mut().restart = true;
        Ok(cpu)
    }

    fn core(&self) -> &Core {
        // SAFETY: hooks use it only inside `Engine::run`, which needs this value mutably.
        unsafe { &*self.core }
    }

    fn core_mut(&mut self) -> &mut Core {
        // SAFETY: as above.
        unsafe { &mut *self.core }
    }

    /// The chip.
    pub fn chip(&self) -> &Chip {
        &self.core().chip
    }

    /// The chip.
    pub fn chip_mut(&mut self) -> &mut Chip {
        &mut self.core_mut().chip
    }

    /// Instructions executed, nearly: whole blocks.
    pub fn instructions(&self) -> u64 {
        self.core().instructions
    }

    /// Another number of cycles per instruction.
    pub fn set_pace(&mut self, cycles_per_instruction: f64) {
        self.core_mut().pace = (cycles_per_instruction * FRACTIONS as f64).round() as u64;
    }

    /// Makes an access to where nothing is a hard fault of the program, instead of an error of the run. From then on
    /// each instruction is followed, so that the frame names the one that failed: slower. To be asked for before the
    /// first instruction: later it takes seconds.
    ///
    /// # Errors
    /// [`Error::Engine`].
    pub fn take_faults(&mut self) -> Result<()> {
        if !std::mem::replace(&mut self.unmapped_is_fault, true) {
            // SAFETY: as for the other hooks.
            unsafe { self.engine.hook_instructions(on_instruction, self.core.cast())? };
            if self.instructions() > 0 {
                self.engine.forget_code()?;
            }
        }
        Ok(())
    }

    /// Where the program is.
    pub fn program_counter(&self) -> u32 {
        self.pc
    }

    /// Goes on from another place: for tests that make the program fail.
    pub fn set_program_counter(&mut self, address: u32) {
        self.pc = address & !1;
        self.sleeping = false;
    }

    /// A register.
    pub fn register(&self, register: Register) -> u32 {
        self.engine.get(register)
    }

    /// Sets a register.
    pub fn set_register(&mut self, register: Register, value: u32) {
        self.engine.set(register, value);
    }

    /// Runs until an instant, or until just behind it.
    ///
    /// # Errors
    /// What ends a run.
    pub fn run(&mut self, until: Time) -> Result<()> {
        self.core_mut().until = until;
        while self.chip().now < until && self.core().instructions < self.core().limit {
            if std::mem::take(&mut self.chip_mut().nvic.reset_request) {
                self.chip_mut().reset(cause::SOFTWARE);
            }
            if std::mem::take(&mut self.chip_mut().restart) {
                self.start()?;
            }
            let flash = self.chip().flash.due();
            if flash != NO_INSTANT {
                // Nothing can be fetched meanwhile.
                self.chip_mut().advance(flash.min(until));
                continue;
            }
            let masks = self.masks();
            if self.sleeping {
                // Masked by PRIMASK alone, an interrupt still ends the sleep.
                self.sleeping = self.chip().nvic.next(Masks { primask: 0, ..masks }).is_none();
                if self.sleeping {
                    self.chip_mut().advance_to_interrupt(until);
                    continue;
                }
            }
            if let Some(number) = self.chip().nvic.next(masks) {
                // Conditional instructions that are under way are ended first, as if one.
                let conditional = self.engine.get(Register::XPSR) & CONDITION_BITS != 0;
                self.core_mut().defer = conditional;
                if !conditional {
                    self.enter(number)?;
                }
            }
            self.execute()?;
        }
        Ok(())
    }

    /// Runs so many instructions, up to the end of a block of them, and at most until an instant.
    ///
    /// # Errors
    /// What ends a run.
    pub fn run_instructions(&mut self, count: u64, until: Time) -> Result<()> {
        self.core_mut().limit = self.instructions() + count;
        let outcome = self.run(until);
        self.core_mut().limit = u64::MAX;
        outcome
    }

    fn masks(&self) -> Masks {
        Masks {
            primask: self.engine.get(Register::PRIMASK) & 1,
            basepri: self.engine.get(Register::BASEPRI),
            faultmask: self.engine.get(Register::FAULTMASK) & 1,
        }
    }

    /// Stack pointer and program counter from the vector table, everything else as after reset.
    fn start(&mut self) -> Result<()> {
        self.follow_code()?;
        frame::reset(&mut self.engine);
        self.frames.clear();
        self.sleeping = false;
        let core = self.core_mut();
        (core.owed, core.rest, core.float) = (0, 0, false);
        let vectors = [0, 4].map(|offset| core.chip.peek(flash::START + offset).unwrap_or(u32::MAX));
        if vectors == [u32::MAX; 2] {
            return Err(Error::Image("flash is empty".into()));
        }
        self.engine.set(Register::SP, vectors[0] & !3);
        self.pc = vectors[1] & !1;
        Ok(())
    }

    /// Forgets what the engine has translated of sectors that hold something else by now. A program is only ever
    /// changed while another runs, so it is enough to look at each start, and where everything is put back.
    fn follow_code(&mut self) -> Result<()> {
        const SECTOR: usize = 0x2_0000;
        // SAFETY: as in `core_mut`; the engine beside it is another value and does not run.
        let core = unsafe { &mut *self.core };
        let code = &core.chip.cells[..CODE_BYTES];
        if core.known.is_empty() {
            core.known = code.to_vec();
        }
        for (n, (known, now)) in core.known.chunks_mut(SECTOR).zip(code.chunks(SECTOR)).enumerate() {
            if known != now {
                known.copy_from_slice(now);
                core.lengths[n * SECTOR / 2..][..now.len() / 2].fill((0, 0));
                let start = flash::START + (n * SECTOR) as u32;
                self.engine.forget_range(start, start + now.len() as u32)?;
            }
        }
        Ok(())
    }

    /// Takes an exception.
    fn enter(&mut self, number: u16) -> Result<()> {
        // SAFETY: as in `core_mut`; the engine beside it is another value and does not run.
        let chip = unsafe { &mut (*self.core).chip };
        let pushed = frame::push(&mut self.engine, chip, self.pc);
        self.frames.push(pushed.frame);
        if !pushed.whole && number != exception::HARD_FAULT {
            chip.nvic.note_fault(fault::STACKING, 0);
            chip.nvic.pend(exception::HARD_FAULT);
        }
        chip.nvic.enter(number);
        let vector = chip.nvic.vectors() + 4 * u32::from(number);
        // The table lies at the beginning of flash, which is mirrored at zero.
        let vector = if vector < flash::BYTES { vector + flash::START } else { vector };
        let handler = chip.peek(vector).filter(|handler| handler & 1 != 0);
        let Some(handler) = handler else { return Err(self.lock_up()) };
        self.engine.set(Register::LR, frame::exc_return(pushed.frame, chip.nvic.depth() > 1));
        self.pc = handler & !1;
        Ok(())
    }

    /// Returns from an exception.
    fn leave(&mut self) -> Result<()> {
        let Some(kept) = self.frames.pop() else { return Err(self.lock_up()) };
        // SAFETY: as in `core_mut`; the engine beside it is another value and does not run.
        let chip = unsafe { &mut (*self.core).chip };
        chip.nvic.leave();
        match frame::pop(&mut self.engine, chip, kept) {
            Some(pc) => self.pc = pc & !1,
            None => return Err(self.lock_up()),
        }
        Ok(())
    }

    /// A fault of the program: a hard fault, or the end where one is handled already.
    fn fault(&mut self, why: u32, address: u32) -> Result<()> {
        if self.chip().nvic.execution_priority(self.masks()) <= -1 {
            return Err(self.lock_up());
        }
        self.chip_mut().nvic.note_fault(why, address);
        self.chip_mut().nvic.pend(exception::HARD_FAULT);
        Ok(())
    }

    fn lock_up(&self) -> Error {
        Error::LockUp { program_counter: self.pc, time_s: self.chip().seconds() }
    }

    fn violation(&self, address: u32, what: String) -> Error {
        let time_s = self.chip().seconds();
        Error::Violation(Violation { what, address, program_counter: self.pc, time_s })
    }

    /// Runs the engine until a hook stops it, and sees why.
    fn execute(&mut self) -> Result<()> {
        let pc = self.pc;
        let core = self.core_mut();
        (core.stop, core.now) = (None, core.chip.now);
        core.attention = core.chip.due().min(core.until);
        let code = self.engine.run(pc);
        let stop = self.core_mut().stop.take();
        self.pc = self.engine.get(Register::PC) & !1;
        let core = self.core_mut();
        core.unstore();
        core.charge();
        core.chip.advance(core.now);
        if let (Some(Stop::Refused(..) | Stop::Unmapped(_)), Some(exact)) = (&stop, core.instruction) {
            self.pc = exact;
        }
        match stop {
            Some(Stop::Block) => self.pc = self.core().block,
            Some(Stop::Exception(EXCEPTION_RETURN)) => self.leave()?,
            Some(Stop::Exception(SUPERVISOR_CALL)) => self.chip_mut().nvic.pend(exception::SV_CALL),
            Some(Stop::Exception(_)) => self.fault(fault::UNDEFINED_INSTRUCTION, self.pc)?,
            Some(Stop::Refused(address, refusal)) => return Err(self.violation(address, describe(&refusal))),
            Some(Stop::Unmapped(address)) => self.unmapped(code, address)?,
            None if code == Code::OK => self.sleeping = true,
            None if code == Code::INVALID_INSTRUCTION => self.fault(fault::UNDEFINED_INSTRUCTION, self.pc)?,
            None => return Err(Error::Engine(format!("stopped with code {} at {:#010x}", code.0, self.pc))),
        }
        Ok(())
    }

    fn unmapped(&mut self, code: Code, address: u32) -> Result<()> {
        let fetched = code == Code::FETCH_UNMAPPED || code == Code::FETCH_PROTECTED;
        // The magic value of a return from an exception is no address.
        if fetched && address >= 0xf000_0000 {
            return self.leave();
        }
        if self.unmapped_is_fault {
            return self.fault(if fetched { fault::FETCH } else { fault::PRECISE_ERROR }, address);
        }
        let what = if fetched { "fetch from where nothing is" } else { "access to where nothing is" };
        Err(self.violation(address, what.into()))
    }

    /// Everything as it is now.
    pub fn snapshot(&self) -> Snapshot {
        let core = self.core();
        Snapshot {
            chip: core.chip.clone(),
            owed: core.owed,
            rest: core.rest,
            pc: self.pc,
            sleeping: self.sleeping,
            frames: self.frames.clone(),
            registers: frame::all_registers().map(|register| self.engine.get(register)).collect(),
            instructions: core.instructions,
        }
    }

    /// Back to how everything was.
    ///
    /// # Errors
    /// [`Error::Engine`].
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<()> {
        let core = self.core_mut();
        core.chip.become_like(&snapshot.chip);
        (core.owed, core.rest, core.instructions) = (snapshot.owed, snapshot.rest, snapshot.instructions);
        core.float = core.chip.nvic.has_float();
        (self.pc, self.sleeping) = (snapshot.pc, snapshot.sleeping);
        self.frames.clone_from(&snapshot.frames);
        for (register, value) in frame::all_registers().zip(&snapshot.registers) {
            self.engine.set(register, *value);
        }
        self.follow_code()
    }
}

impl Drop for Cpu {
    fn drop(&mut self) {
        // SAFETY: made by a box, and no hook runs any more.
        drop(unsafe { Box::from_raw(self.core) });
    }
}

fn describe(refusal: &Refusal) -> String {
    match refusal {
        Refusal::Register => "a register that is not modelled".into(),
        Refusal::Bits(bits) => format!("bits {bits:#x} that are not modelled"),
        Refusal::Forbidden(why) => (*why).into(),
    }
}

/// Maps memories and registers and installs the hooks.
///
/// # Safety
/// `core` must outlive the engine's last run.
unsafe fn connect(engine: &mut Engine, core: *mut Core) -> Result<()> {
    // SAFETY: passed on to the caller.
    let chip = unsafe { &mut (*core).chip };
    let user = core.cast();
    // SAFETY: the pages keep their place as long as the chip lives, and the functions expect a `Core`.
    unsafe {
        engine.map(flash::START, CODE_BYTES, READ | EXECUTE, chip.cells.address())?;
        engine.map(SRAM_START, SRAM_BYTES as usize, READ | WRITE | EXECUTE, chip.sram.address())?;
        engine.map(CCM_START, CCM_BYTES as usize, READ | WRITE, chip.ccm.address())?;
        let data_bytes = flash::BYTES as usize - CODE_BYTES;
        engine.map_device(DATA_START, data_bytes, (read::<DATA_START>, write::<DATA_START>), user)?;
        engine.map_device(IDENTITY.0, IDENTITY.1, (read::<{ IDENTITY.0 }>, write::<{ IDENTITY.0 }>), user)?;
        let [apb, own] = DEVICES;
        engine.map_device(apb.0, apb.1, (read::<{ DEVICES[0].0 }>, write::<{ DEVICES[0].0 }>), user)?;
        engine.map_device(own.0, own.1, (read::<{ DEVICES[1].0 }>, write::<{ DEVICES[1].0 }>), user)?;
        engine.hook(on_block, on_exception, on_unmapped, user)
    }
}

impl Core {
    /// Charges the block that has run.
    fn charge(&mut self) {
        let total = self.rest + std::mem::take(&mut self.owed);
        self.rest = total % FRACTIONS;
        self.now += total / FRACTIONS;
    }

    /// Instructions of a block in flash or memory.
    fn length(&mut self, address: u32, size: u32) -> u64 {
        let place = (address.wrapping_sub(flash::START) / 2) as usize;
        match self.lengths.get(place) {
            Some(&(bytes, count)) if u32::from(bytes) == size => count.into(),
            Some(_) => {
                let count = self.count(address, size);
                self.lengths[place] = (size as u16, count as u16);
                count
            }
            None => self.count(address, size),
        }
    }

    fn count(&self, address: u32, size: u32) -> u64 {
        let (mut at, mut count) = (address, 0);
        while at < address + size {
            let wide = self.chip.peek_half(at).is_some_and(|half| half >> 11 >= 0b11101);
            at += if wide { 4 } else { 2 };
            count += 1;
        }
        count
    }

    /// Whether a block uses the floating-point unit: coprocessors 10 and 11.
    fn uses_float(&self, address: u32, size: u32) -> bool {
        let mut at = address;
        while at < address + size {
            let half = self.chip.peek_half(at).unwrap_or(0);
            let wide = half >> 11 >= 0b11101;
            let coprocessor = self.chip.peek_half(at + 2).unwrap_or(0) >> 8 & 0xe;
            if wide && half & 0xec00 == 0xec00 && coprocessor == 0xa {
                return true;
            }
            at += if wide { 4 } else { 2 };
        }
        false
    }

    /// Whether the run must stop before the block at hand.
    fn must_stop(&mut self) -> bool {
        self.chip.advance(self.now);
        self.attention = self.chip.due().min(self.until);
        if !self.float {
            self.float = self.chip.nvic.has_float();
            self.attention = 0;
        }
        let waits = self.chip.nvic.has_pending() || self.chip.nvic.reset_request || self.chip.restart;
        let enough = self.now >= self.until || self.instructions >= self.limit;
        waits || enough || self.chip.flash.due() != NO_INSTANT
    }
}

/// # Safety
/// Called by the engine with the core that was given for it.
unsafe extern "C" fn on_block(engine: Handle, address: u64, size: u32, user: *mut c_void) {
    // SAFETY: by contract; nobody else uses the core while the engine runs.
    let core = unsafe { &mut *user.cast::<Core>() };
    core.unstore();
    core.charge();
    core.block = address as u32;
    let due = core.now >= core.attention || core.instructions >= core.limit;
    if due && !std::mem::take(&mut core.defer) && core.must_stop() {
        core.stop = Some(Stop::Block);
        // SAFETY: the handle is the engine's.
        unsafe { (core.stopper)(engine) };
        return;
    }
    if !core.float && core.uses_float(address as u32, size) {
        core.stop = Some(Stop::Refused(address as u32, Refusal::Forbidden("the floating-point unit is not open")));
        // SAFETY: as above.
        unsafe { (core.stopper)(engine) };
        return;
    }
    let count = core.length(address as u32, size);
    core.instructions += count;
    core.owed = count * core.pace * core.chip.cycle();
}

/// # Safety
/// As [`on_block`].
unsafe extern "C" fn on_instruction(_: Handle, address: u64, _: u32, user: *mut c_void) {
    // SAFETY: as above.
    let core = unsafe { &mut *user.cast::<Core>() };
    core.instruction = Some(address as u32);
}

/// # Safety
/// As [`on_block`].
unsafe extern "C" fn on_exception(engine: Handle, number: u32, user: *mut c_void) {
    // SAFETY: as above.
    let core = unsafe { &mut *user.cast::<Core>() };
    core.stop = Some(Stop::Exception(number));
    // SAFETY: as above.
    unsafe { (core.stopper)(engine) };
}

/// # Safety
/// As [`on_block`].
unsafe extern "C" fn on_unmapped(
    engine: Handle,
    kind: c_int,
    address: u64,
    size: c_int,
    value: i64,
    user: *mut c_void,
) -> bool {
    // SAFETY: as above.
    let core = unsafe { &mut *user.cast::<Core>() };
    if kind == WRITE_REFUSED && (flash::START..DATA_START).contains(&(address as u32)) {
        // The engine now stores it, where the controller would first have to program it.
        let at = (address as u32 - flash::START) as usize & !3;
        let mut before = [0; 4];
        before.copy_from_slice(&core.chip.cells[at..at + 4]);
        core.write(engine, address as u32, size as u32, value as u32);
        core.stored = Some((at, before));
        return true;
    }
    core.stop = Some(Stop::Unmapped(address as u32));
    false
}

/// # Safety
/// As [`on_block`].
unsafe extern "C" fn read<const START: u32>(engine: Handle, offset: u64, size: c_uint, user: *mut c_void) -> u64 {
    // SAFETY: as above.
    let core = unsafe { &mut *user.cast::<Core>() };
    let address = START + offset as u32;
    core.unstore();
    core.chip.advance(core.now);
    let value = core.chip.read(address, size);
    core.attention = 0;
    value
        .unwrap_or_else(|refusal| {
            core.refuse(engine, address, refusal);
            0
        })
        .into()
}

/// # Safety
/// As [`on_block`].
unsafe extern "C" fn write<const START: u32>(engine: Handle, offset: u64, size: c_uint, value: u64, user: *mut c_void) {
    // SAFETY: as above.
    let core = unsafe { &mut *user.cast::<Core>() };
    core.write(engine, START + offset as u32, size, value as u32);
}

impl Core {
    /// Takes back what the engine has stored into flash.
    fn unstore(&mut self) {
        if let Some((at, before)) = self.stored.take() {
            self.chip.cells[at..at + 4].copy_from_slice(&before);
        }
    }

    fn write(&mut self, engine: Handle, address: u32, size: u32, value: u32) {
        self.unstore();
        self.chip.advance(self.now);
        self.chip.flash.fetching = Some(self.block);
        if let Err(refusal) = self.chip.write(address, size, value) {
            self.refuse(engine, address, refusal);
        }
        self.attention = 0;
    }

    fn refuse(&mut self, engine: Handle, address: u32, refusal: Refusal) {
        if self.stop.is_none() {
            self.stop = Some(Stop::Refused(address, refusal));
        }
        // SAFETY: the handle is the engine's.
        unsafe { (self.stopper)(engine) };
    }
}
