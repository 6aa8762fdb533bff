//! The few peripherals of the AN386 FPGA image that the node uses, as register blocks.
//!
//! Source: Arm Cortex-M System Design Kit, technical reference manual (APB timer, dual timer, UART), and
//! the memory map of application note AN386. All run at 25 MHz.

use core::cell::UnsafeCell;

/// Rate of every timer of this board, Hz.
pub const CLOCK_HZ: u32 = 25_000_000;

/// One 32-bit register.
#[repr(transparent)]
pub struct Register(UnsafeCell<u32>);

// SAFETY: a register is read and written whole by one instruction, and the core is alone.
unsafe impl Sync for Register {}

impl Register {
    /// Reads it.
    pub fn read(&self) -> u32 {
        // SAFETY: registers exist only inside the blocks below, at aligned addresses of the device.
        unsafe { self.0.get().read_volatile() }
    }

    /// Writes it.
    pub fn write(&self, value: u32) {
        // SAFETY: as for `read`; none of these devices touches memory of its own accord.
        unsafe { self.0.get().write_volatile(value) }
    }
}

/// APB timer: counts down to zero, interrupts, starts again from its reload value.
#[repr(C)]
pub struct TimerBlock {
    /// Bit 0 runs it, bit 3 lets it interrupt.
    pub control: Register,
    /// The count.
    pub value: Register,
    /// Period less one; taken up when the count ends.
    pub reload: Register,
    /// Interrupt status; writing 1 clears it.
    pub interrupt: Register,
}

/// First half of the dual timer: a 32-bit counter.
#[repr(C)]
pub struct DualTimerBlock {
    /// Start value.
    pub load: Register,
    /// The count, downwards.
    pub value: Register,
    /// Bit 7 runs it, bit 1 makes it 32 bits wide.
    pub control: Register,
}

/// UART.
#[repr(C)]
pub struct UartBlock {
    /// Byte to send or received.
    pub data: Register,
    /// Bit 0: send buffer full; bit 1: a byte was received.
    pub state: Register,
    /// Bit 0 and 1 enable sending and receiving, bit 3 lets a received byte interrupt.
    pub control: Register,
    /// Interrupt status; writing 1 clears it.
    pub interrupt: Register,
    /// Divider of the bit rate, at least 16.
    pub divider: Register,
}

/// A device at a fixed address.
pub type Device<Block> = &'static Block;

macro_rules! device {
    ($(#[$doc:meta])* $name:ident: $block:ty, $address:literal) => {
        $(#[$doc])*
        pub fn $name() -> Device<$block> {
            // SAFETY: AN386 has this device at this address for as long as it runs, and its registers are
            // laid out as in the block.
            unsafe { &*($address as *const $block) }
        }
    };
}

device!(
    /// Timer 0, interrupt 8: the sample clock.
    timer0: TimerBlock, 0x4000_0000
);
device!(
    /// Timer 1, interrupt 9: the tachometer.
    timer1: TimerBlock, 0x4000_1000
);
device!(
    /// Dual timer: the time base.
    dual_timer: DualTimerBlock, 0x4000_2000
);
device!(
    /// UART 0, interrupt 0 on reception: the link.
    uart0: UartBlock, 0x4000_4000
);
