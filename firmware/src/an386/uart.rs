//! The link: UART 0.

use super::registers::{Device, UartBlock, uart0};
use heapless::spsc::Producer;

const SEND: u32 = 1;
const RECEIVE: u32 = 1 << 1;
const RECEIVE_INTERRUPT: u32 = 1 << 3;
const SEND_FULL: u32 = 1;
const RECEIVE_FULL: u32 = 1 << 1;
/// Interrupt status bit of reception.
const RECEIVE_STATUS: u32 = 1 << 1;

/// Sends; owned by the main loop.
pub struct Sender(Device<UartBlock>);

/// Receives; owned by its interrupt.
pub struct Receiver {
    uart: Device<UartBlock>,
    bytes: Producer<'static, u8>,
    /// Bytes that found the queue full.
    pub lost: u32,
}

/// Starts the UART at its highest bit rate.
pub fn open(bytes: Producer<'static, u8>) -> (Sender, Receiver) {
    let uart = uart0();
    uart.divider.write(16);
    uart.control.write(SEND | RECEIVE | RECEIVE_INTERRUPT);
    (Sender(uart), Receiver { uart, bytes, lost: 0 })
}

impl Sender {
    /// Sends a byte; false if the line is not ready for it.
    pub fn send(&mut self, byte: u8) -> bool {
        let ready = self.0.state.read() & SEND_FULL == 0;
        if ready {
            self.0.data.write(u32::from(byte));
        }
        ready
    }
}

impl Receiver {
    /// The interrupt of reception.
    pub fn on_interrupt(&mut self) {
        self.uart.interrupt.write(RECEIVE_STATUS);
        while self.uart.state.read() & RECEIVE_FULL != 0 {
            let byte = self.uart.data.read() as u8;
            if self.bytes.enqueue(byte).is_err() {
                self.lost += 1;
            }
        }
    }
}
