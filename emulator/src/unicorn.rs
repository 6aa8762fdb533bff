//! Unicorn's shared library, opened at run time: the processor's instructions and nothing else.
//!
//! Unicorn is an external tool as QEMU is (`cargo xtask setup` installs Debian's `libunicorn2`): it is not linked and
//! no part of it is in the lock file. Declared here is the little that is used of its interface, version 2.0.

use crate::error::{Error, Result};
use libloading::Library;
use std::ffi::{CStr, c_char, c_int, c_uint, c_void};
use std::ptr;
use std::sync::OnceLock;

/// An engine's handle.
pub type Handle = *mut c_void;
/// Called before each block of instructions: handle, address, bytes, user data.
pub type BlockHook = unsafe extern "C" fn(Handle, u64, u32, *mut c_void);
/// Called on an exception of the processor: handle, number, user data.
pub type InterruptHook = unsafe extern "C" fn(Handle, u32, *mut c_void);
/// Called on an access to memory that is not there: handle, kind, address, bytes, value, user data.
pub type UnmappedHook = unsafe extern "C" fn(Handle, c_int, u64, c_int, i64, *mut c_void) -> bool;
/// A device is read: handle, offset, bytes, user data.
pub type DeviceRead = unsafe extern "C" fn(Handle, u64, c_uint, *mut c_void) -> u64;
/// A device is written: handle, offset, bytes, value, user data.
pub type DeviceWrite = unsafe extern "C" fn(Handle, u64, c_uint, u64, *mut c_void);

/// Names under which the library is looked for.
const NAMES: [&str; 3] = ["libunicorn.so.2", "libunicorn.so", "libunicorn.2.dylib"];
/// Place of another library than the system's.
const VARIABLE: &str = "MESHBAND_UNICORN";

const ARCH_ARM: c_int = 1;
const MODE_THUMB_M_CLASS: c_int = 1 << 4 | 1 << 5;
/// `uc_ctl`: set the processor's model, one argument, write.
const CONTROL_MODEL: c_uint = 7 | 1 << 26 | 1 << 30;
/// `uc_ctl`: forget the code translated from a range, two arguments, write.
const CONTROL_FORGET: c_uint = 9 | 2 << 26 | 1 << 30;
/// `uc_ctl`: forget all translated code, no argument, write.
const CONTROL_FLUSH: c_uint = 10 | 1 << 30;
const CORTEX_M4: c_int = 9;
const HOOK_INTERRUPT: c_int = 1 << 0;
const HOOK_INSTRUCTION: c_int = 1 << 2;
const HOOK_BLOCK: c_int = 1 << 3;
const HOOK_UNMAPPED_AND_PROTECTED: c_int = 0b11_1111 << 4;

/// Kind of an access that is told to [`UnmappedHook`]: a write to memory that cannot be written.
pub const WRITE_REFUSED: c_int = 22;

/// Memory that may be read, written, executed.
pub const READ: u32 = 1;
/// As above.
pub const WRITE: u32 = 2;
/// As above.
pub const EXECUTE: u32 = 4;

/// A register's number in Unicorn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Register(c_int);

impl Register {
    /// Link register.
    pub const LR: Self = Self(10);
    /// Program counter.
    pub const PC: Self = Self(11);
    /// Stack pointer.
    pub const SP: Self = Self(12);
    /// Floating-point status and control.
    pub const FPSCR: Self = Self(6);
    /// Control register.
    pub const CONTROL: Self = Self(117);
    /// Program status.
    pub const XPSR: Self = Self(120);
    /// Mask of all interrupts.
    pub const PRIMASK: Self = Self(123);
    /// Mask by priority.
    pub const BASEPRI: Self = Self(124);
    /// Mask of faults, too.
    pub const FAULTMASK: Self = Self(126);

    /// r0 to r12.
    pub const fn r(number: u8) -> Self {
        Self(66 + number as c_int)
    }

    /// s0 to s31.
    pub const fn s(number: u8) -> Self {
        Self(79 + number as c_int)
    }
}

/// How a run ended, by Unicorn's own number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Code(pub c_int);

impl Code {
    /// Nothing went wrong.
    pub const OK: Self = Self(0);
    /// Read of memory that is not there.
    pub const READ_UNMAPPED: Self = Self(6);
    /// Write to memory that is not there.
    pub const WRITE_UNMAPPED: Self = Self(7);
    /// Execution of memory that is not there.
    pub const FETCH_UNMAPPED: Self = Self(8);
    /// No such instruction.
    pub const INVALID_INSTRUCTION: Self = Self(10);
    /// Write to memory that cannot be written.
    pub const WRITE_PROTECTED: Self = Self(12);
    /// Execution of memory that holds no code.
    pub const FETCH_PROTECTED: Self = Self(14);
}

struct Functions {
    _library: Library,
    open: unsafe extern "C" fn(c_int, c_int, *mut Handle) -> c_int,
    close: unsafe extern "C" fn(Handle) -> c_int,
    control: unsafe extern "C" fn(Handle, c_uint, ...) -> c_int,
    map: unsafe extern "C" fn(Handle, u64, usize, u32, *mut c_void) -> c_int,
    map_device: unsafe extern "C" fn(Handle, u64, usize, DeviceRead, *mut c_void, DeviceWrite, *mut c_void) -> c_int,
    hook: unsafe extern "C" fn(Handle, *mut usize, c_int, *mut c_void, *mut c_void, u64, u64, ...) -> c_int,
    start: unsafe extern "C" fn(Handle, u64, u64, u64, usize) -> c_int,
    stop: unsafe extern "C" fn(Handle) -> c_int,
    read_register: unsafe extern "C" fn(Handle, c_int, *mut c_void) -> c_int,
    write_register: unsafe extern "C" fn(Handle, c_int, *const c_void) -> c_int,
    text: unsafe extern "C" fn(c_int) -> *const c_char,
}

/// The library's functions, or why there are none; looked for once.
fn functions() -> Result<&'static Functions> {
    static FUNCTIONS: OnceLock<std::result::Result<Functions, String>> = OnceLock::new();
    FUNCTIONS.get_or_init(load).as_ref().map_err(|reason| Error::Absent(reason.clone()))
}

/// Whether Unicorn can be used here.
pub fn is_installed() -> bool {
    functions().is_ok()
}

fn load() -> std::result::Result<Functions, String> {
    let other = std::env::var(VARIABLE).ok();
    let names: Vec<&str> = other.as_deref().map_or_else(|| NAMES.to_vec(), |name| vec![name]);
    // SAFETY: loading runs the library's initialisers, as starting any program that is linked to it does.
    let found = names.iter().find_map(|name| unsafe { Library::new(name) }.ok());
    let library = found.ok_or_else(|| format!("{} is not installed: run `cargo xtask setup`", names[0]))?;
    macro_rules! symbol {
        ($name:literal) => {
            // SAFETY: the types are those of Unicorn's header, version 2.0.
            *unsafe { library.get($name) }.map_err(|e| format!("{}: {e}", names[0]))?
        };
    }
    Ok(Functions {
        open: symbol!(b"uc_open"),
        close: symbol!(b"uc_close"),
        control: symbol!(b"uc_ctl"),
        map: symbol!(b"uc_mem_map_ptr"),
        map_device: symbol!(b"uc_mmio_map"),
        hook: symbol!(b"uc_hook_add"),
        start: symbol!(b"uc_emu_start"),
        stop: symbol!(b"uc_emu_stop"),
        read_register: symbol!(b"uc_reg_read"),
        write_register: symbol!(b"uc_reg_write"),
        text: symbol!(b"uc_strerror"),
        _library: library,
    })
}

/// A Cortex-M4F without anything around it.
pub struct Engine {
    functions: &'static Functions,
    handle: Handle,
}

// SAFETY: an engine keeps no state that belongs to a thread; it is used by one at a time.
unsafe impl Send for Engine {}

impl Engine {
    /// A processor with nothing mapped.
    ///
    /// # Errors
    /// [`Error::Absent`] without the library.
    pub fn new() -> Result<Self> {
        let functions = functions()?;
        let mut handle = ptr::null_mut();
        // SAFETY: the place for the handle is valid.
        check(functions, unsafe { (functions.open)(ARCH_ARM, MODE_THUMB_M_CLASS, &raw mut handle) })?;
        let engine = Self { functions, handle };
        // SAFETY: the handle is open, and the model is set before anything else is asked for.
        engine.check(unsafe { (functions.control)(handle, CONTROL_MODEL, CORTEX_M4) })?;
        Ok(engine)
    }

    fn check(&self, code: c_int) -> Result<()> {
        check(self.functions, code)
    }

    /// Maps memory of the caller's.
    ///
    /// # Safety
    /// `memory` must be `size` bytes that outlive the engine; address and size are multiples of 4096.
    ///
    /// # Errors
    /// [`Error::Engine`] where something is mapped already.
    pub unsafe fn map(&mut self, address: u32, size: usize, rights: u32, memory: *mut u8) -> Result<()> {
        // SAFETY: passed on to the caller.
        self.check(unsafe { (self.functions.map)(self.handle, address.into(), size, rights, memory.cast()) })
    }

    /// Maps registers.
    ///
    /// # Safety
    /// `user` must be what the functions take it for, as long as the engine lives.
    ///
    /// # Errors
    /// As [`Engine::map`].
    pub unsafe fn map_device(
        &mut self,
        address: u32,
        size: usize,
        (read, write): (DeviceRead, DeviceWrite),
        user: *mut c_void,
    ) -> Result<()> {
        // SAFETY: passed on to the caller.
        self.check(unsafe { (self.functions.map_device)(self.handle, address.into(), size, read, user, write, user) })
    }

    /// Installs the three hooks.
    ///
    /// # Safety
    /// As [`Engine::map_device`].
    ///
    /// # Errors
    /// [`Error::Engine`].
    pub unsafe fn hook(
        &mut self,
        block: BlockHook,
        interrupt: InterruptHook,
        unmapped: UnmappedHook,
        user: *mut c_void,
    ) -> Result<()> {
        let hooks = [
            (HOOK_BLOCK, block as *mut c_void),
            (HOOK_INTERRUPT, interrupt as *mut c_void),
            (HOOK_UNMAPPED_AND_PROTECTED, unmapped as *mut c_void),
        ];
        for (kind, function) in hooks {
            let mut hook = 0;
            // SAFETY: the functions have the types that these kinds of hooks are called with; from 1 to 0 is
            // everywhere.
            self.check(unsafe { (self.functions.hook)(self.handle, &raw mut hook, kind, function, user, 1, 0) })?;
        }
        Ok(())
    }

    /// Calls `hook` before each instruction, too, of code that has not run yet.
    ///
    /// # Safety
    /// As [`Engine::map_device`].
    ///
    /// # Errors
    /// [`Error::Engine`].
    pub unsafe fn hook_instructions(&mut self, hook: BlockHook, user: *mut c_void) -> Result<()> {
        let mut number = 0;
        let function = hook as *mut c_void;
        // SAFETY: the function has the type that this kind of hook is called with.
        self.check(unsafe {
            (self.functions.hook)(self.handle, &raw mut number, HOOK_INSTRUCTION, function, user, 1, 0)
        })
    }

    /// Runs from an address (Thumb) until a hook stops it.
    pub fn run(&mut self, address: u32) -> Code {
        // No end: this odd address is never reached.
        // SAFETY: the handle is open.
        Code(unsafe { (self.functions.start)(self.handle, u64::from(address | 1), u64::MAX, 0, 0) })
    }

    /// For a hook: a function that stops the run, with the handle.
    pub fn stopper(&self) -> unsafe extern "C" fn(Handle) -> c_int {
        self.functions.stop
    }

    /// A register's value.
    pub fn get(&self, register: Register) -> u32 {
        let mut value = [0_u32; 4];
        // SAFETY: the handle is open and there is room for every register. It fails only for numbers that are none.
        unsafe { (self.functions.read_register)(self.handle, register.0, value.as_mut_ptr().cast()) };
        value[0]
    }

    /// Sets a register.
    pub fn set(&mut self, register: Register, value: u32) {
        let value = [value, 0, 0, 0];
        // SAFETY: as for reading.
        unsafe { (self.functions.write_register)(self.handle, register.0, value.as_ptr().cast()) };
    }

    /// Forgets the code translated from these addresses: others' bytes lie there now.
    ///
    /// # Errors
    /// [`Error::Engine`].
    pub fn forget_range(&mut self, start: u32, end: u32) -> Result<()> {
        // SAFETY: the handle is open, and the two arguments are of 64 bits.
        self.check(unsafe { (self.functions.control)(self.handle, CONTROL_FORGET, u64::from(start), u64::from(end)) })
    }

    /// Forgets translated code. Takes seconds.
    ///
    /// # Errors
    /// [`Error::Engine`].
    pub fn forget_code(&mut self) -> Result<()> {
        // SAFETY: the handle is open.
        self.check(unsafe { (self.functions.control)(self.handle, CONTROL_FLUSH) })
    }
}

impl Drop for Engine {
    fn drop(&mut self) {
        // SAFETY: the handle is open and not used again.
        unsafe { (self.functions.close)(self.handle) };
    }
}

fn check(functions: &Functions, code: c_int) -> Result<()> {
    if code == Code::OK.0 {
        return Ok(());
    }
    // SAFETY: the library gives a constant text for any number.
    let text = unsafe { CStr::from_ptr((functions.text)(code)) };
    Err(Error::Engine(text.to_string_lossy().into_owned()))
}
