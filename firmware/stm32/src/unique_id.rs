//! The chip's own number: 96 bits, written at the factory. RM0090 section 39.1.

/// Address of its three words.
pub const ADDRESS: u32 = 0x1fff_7a10;
