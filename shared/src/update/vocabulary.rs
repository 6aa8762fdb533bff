//! What is said over the link of images and updates. Variants are only ever appended ([`crate::message`]).

use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Most bytes of an image in one request: a frame of them fits the circle that boards receive into.
pub const MAX_CHUNK: usize = 512;

/// A step of an update. Each may be repeated without harm; each is answered with an [`UpdateStatus`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum UpdateRequest {
    /// How far it is.
    Status,
    /// The header of the image that is to come, 64 bytes ([`crate::update::header`]). Erases the free slot, which
    /// stops the core for 1 s to 2 s twice; the header of an update under way goes on with it.
    Begin {
        /// As in the update file.
        #[serde(with = "part")]
        header: Vec<u8, MAX_CHUNK>,
    },
    /// Part of the image.
    Chunk {
        /// Place of its first byte in the image; only that which the status names is taken.
        offset: u32,
        /// Whole words.
        #[serde(with = "part")]
        bytes: Vec<u8, MAX_CHUNK>,
    },
    /// Check the whole image, and restart into it.
    Activate,
    /// The new image is spoken to and may stay.
    Confirm,
}

/// Parts of an image, taken whole from where they were received: byte by byte, as lists are, costs a board a kilobyte
/// of code.
mod part {
    use super::MAX_CHUNK;
    use core::fmt::{Formatter, Result};
    use heapless::Vec;
    use serde::de::{Deserializer, Error, Visitor};
    use serde::ser::Serializer;

    struct Taken;

    impl Visitor<'_> for Taken {
        type Value = Vec<u8, MAX_CHUNK>;

        fn expecting(&self, formatter: &mut Formatter<'_>) -> Result {
            formatter.write_str("part of an image")
        }

        fn visit_bytes<E: Error>(self, bytes: &[u8]) -> core::result::Result<Self::Value, E> {
            Vec::from_slice(bytes).map_err(|_| E::invalid_length(bytes.len(), &self))
        }
    }

    pub fn serialize<S: Serializer>(part: &[u8], serializer: S) -> core::result::Result<S::Ok, S::Error> {
        serializer.serialize_bytes(part)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(source: D) -> core::result::Result<Vec<u8, MAX_CHUNK>, D::Error> {
        source.deserialize_bytes(Taken)
    }
}

/// How far an update is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Stage {
    /// Nothing was begun.
    #[default]
    Idle,
    /// The free slot is being erased.
    Erasing,
    /// Parts are taken.
    Receiving,
    /// The image is complete and sound; the node is about to restart into it.
    Restarting,
}

/// Place of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Slot {
    /// The board has no slots.
    #[default]
    None,
    /// The lower one.
    A,
    /// The upper one.
    B,
}

/// What is known of the running image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum ImageStanding {
    /// The board has no loader.
    #[default]
    Unmanaged,
    /// It has proved itself.
    Confirmed,
    /// It is new: not confirmed in time, the image before it comes back.
    OnTrial,
}

/// Why the node started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum StartCause {
    /// The board does not tell, or the node is of a link schema before 7.
    #[default]
    Unknown,
    /// Power came, or fell below the brown-out level.
    Power,
    /// Reset pin.
    Pin,
    /// Itself: a recorded crash, or an update.
    Software,
    /// Watchdog.
    Watchdog,
    /// Something else.
    Other,
}

/// Which image runs and why.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunningImage {
    /// Where it lies.
    pub slot: Slot,
    /// Whether it stays.
    pub standing: ImageStanding,
    /// Why the node started.
    pub started: StartCause,
    /// Version of a newer image that was given up for this one, because it was not confirmed in its starts.
    pub given_up: Option<[u8; 3]>,
}

impl RunningImage {
    /// A node without a loader that does not tell why it started.
    pub const NONE: Self =
        Self { slot: Slot::None, standing: ImageStanding::Unmanaged, started: StartCause::Unknown, given_up: None };
}

/// Why a step was refused; the number is the detail of the event ([`crate::events::EventKind::RequestRefused`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u8)]
pub enum UpdateRefused {
    /// The board has no second slot.
    NotSupported = 1,
    /// No header, or a damaged one.
    Header = 2,
    /// An image for another board.
    Board = 3,
    /// An image that is linked for another slot.
    Place = 4,
    /// Too short, too long for the slot, or no whole number of 8 bytes.
    Length = 5,
    /// The image stores configurations of an older schema than the node's: it could not read the stored one.
    OlderSchema = 6,
    /// The running image is not confirmed: the other slot holds the way back.
    OnTrial = 7,
    /// Nothing was begun, or the slot is still being erased.
    NotReady = 8,
    /// No whole words, or bytes behind the image's end.
    Range = 9,
    /// Bytes are missing.
    Incomplete = 10,
    /// The checksum of the whole image differs.
    Damaged = 11,
    /// The image's first two vectors are no stack and no entry.
    Vectors = 12,
    /// Flash could not be erased or written.
    Flash = 13,
    /// The new image is not well yet; the status says what is missing.
    Unwell = 14,
}

/// Answer to each step of an update.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct UpdateStatus {
    /// How far it is.
    pub stage: Stage,
    /// First byte of the image that is missing.
    pub next: u32,
    /// Bytes of the image that is being received.
    pub length: u32,
    /// First address of the slot that takes the next image: it must be linked for it. 0 where there is none.
    pub free: u32,
    /// Whether the running image stays.
    pub standing: ImageStanding,
    /// What a new image still lacks to be confirmed, by bit: 0 the stored configuration, 1 the self-test, 2 five
    /// seconds of sampling.
    pub missing: u8,
    /// Why the step was refused.
    pub refusal: Option<UpdateRefused>,
}

impl UpdateStatus {
    /// The answer of a board without slots.
    pub const NOT_SUPPORTED: Self = Self {
        stage: Stage::Idle,
        next: 0,
        length: 0,
        free: 0,
        standing: ImageStanding::Unmanaged,
        missing: 0,
        refusal: Some(UpdateRefused::NotSupported),
    };
}
