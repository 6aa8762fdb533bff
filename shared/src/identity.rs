//! Which node this is: what a board knows of itself and passes in when its session is built.

use crate::update::RunningImage;

/// Version of this crate, hence of everything the node computes: major, minor, patch.
pub const VERSION: [u8; 3] = [
    number(env!("CARGO_PKG_VERSION_MAJOR")),
    number(env!("CARGO_PKG_VERSION_MINOR")),
    number(env!("CARGO_PKG_VERSION_PATCH")),
];

/// Longest [`Identity::build`] that is reported, bytes.
pub const BUILD_LENGTH: usize = 12;
/// Longest [`Identity::board`] that is reported, bytes.
pub const BOARD_LENGTH: usize = 16;

/// A board's identity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Name of the board, as that of its image; the first [`BOARD_LENGTH`] bytes are reported.
    pub board: &'static str,
    /// What the image was built from: a commit's short hash, or `unknown`; the first [`BUILD_LENGTH`] bytes are
    /// reported.
    pub build: &'static str,
    /// The chip's own number, 96 bits; zero where it has none.
    pub unique_id: [u32; 3],
    /// Which image runs and why; the default on a board without slots.
    pub image: RunningImage,
}

impl Identity {
    /// A node without a board: simulations and tests.
    pub const HOST: Self = Self { board: "host", build: "unknown", unique_id: [0; 3], image: RunningImage::NONE };
}

/// A decimal number from the manifest.
const fn number(text: &str) -> u8 {
    let (bytes, mut at, mut value) = (text.as_bytes(), 0, 0);
    while at < bytes.len() {
        value = value * 10 + (bytes[at] - b'0');
        at += 1;
    }
    value
}
