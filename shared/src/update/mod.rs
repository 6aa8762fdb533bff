//! Another image over the link, with a way back.
//!
//! Flash holds two slots. The node runs in one; the other takes the next image, which is linked for that place.
//! Nothing is ever copied or swapped, and the slot that runs is not written but for one word: whatever happens to an
//! update, the image before it is still there as it was. A loader in the first sector looks at both slots at every
//! start ([`slots`]) and jumps into the newest image that is whole and either confirmed or has starts left to prove
//! itself.
//!
//! [`header`] is what an image says of itself, [`slots`] the words behind it and the choice, [`receiver`] takes an
//! image over the link,
//! [`trial`] says when a new image may be confirmed. All of it knows flash by `embedded_storage` alone and runs on a
//! host as well.
//!
//! Why not a loader that swaps (embassy-boot): `book/src/adr/0007-two-slots.md`. Price of two slots: every image is
//! linked twice, and an update has both. Limits: flash without error correction (a word may be programmed again
//! towards zeros); no signature, whoever has the line has the node; the loader itself is only written by a probe or
//! the chip's own boot loader.

pub mod checksum;
pub mod header;
pub mod receiver;
pub mod slots;
pub mod trial;
pub mod vocabulary;

pub use receiver::Updater;
pub use vocabulary::{
    ImageStanding, RunningImage, Slot, Stage, StartCause, UpdateRefused, UpdateRequest, UpdateStatus,
};
