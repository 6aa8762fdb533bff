//! The line to the host: its vocabulary and frames, what may be on its way, and the queues on both sides of it.
//!
//! The same on every board, in QEMU and on the host. The session decides by its own clock when the next message leaves
//! ([`pace`]): what is sent when depends on the node's inputs only, and the frames stay equal byte for byte wherever
//! the node runs. The queue behind it ([`send_ring`]) then always has room: the pace lets at most [`WINDOW`] bytes be
//! under way, and the line, a little faster than the pace, may in addition stand still for what fills the rest of
//! [`QUEUE`], 45 ms: longer than the longest turn of any main loop. Only a line that really stops (a host that does
//! not read) loses frames, whole and counted.

pub mod compact;
pub mod frame;
pub mod message;
pub mod pace;
pub mod receive_circle;
pub mod send_ring;
pub mod session;
pub mod waveform;

use crate::frame::MAX_FRAME;

/// Bit rate of the line; 8N1, so ten bits per byte.
pub const BITS_PER_SECOND: u32 = 921_600;
/// Bytes per second that are sent: 2.3 % below what the line takes, more than its divider is off by.
pub const PACE: u32 = 90_000;
/// Most bytes on their way: sent by the node and, at the pace, not yet taken by the line.
pub const WINDOW: usize = 4096;
/// Bytes of the queue between the node and the line.
pub const QUEUE: usize = 2 * WINDOW;

const _: () = assert!(PACE < BITS_PER_SECOND / 10);
// A message, a reply and the next message's room: see `pace`.
const _: () = assert!(WINDOW >= 3 * MAX_FRAME);
