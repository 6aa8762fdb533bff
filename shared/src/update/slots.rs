//! The words behind a slot's header, and which slot starts.
//!
//! Each word is programmed once, from blank towards zeros, and means something only when it is done; there is nothing
//! to be erased but the whole slot, so no state of its own can be lost while the slots are sound:
//!
//! | word | written | by |
//! | --- | --- | --- |
//! | sequence, and its complement | before the header, when an image has arrived whole | node |
//! | header, its checksum last | then: from here on the slot has an image | node |
//! | one of [`TRIALS`] | before each start of an image that is not confirmed | loader |
//! | confirmed, all zeros | when the image has run well and a host has said so | the image itself |
//!
//! A word torn by a power cut is no sequence, no header, a start that counts, or no confirmation: each leaves the
//! image before it.

use crate::update::header::{HEADER_BYTES, Header};
use crate::update::vocabulary::ImageStanding;

/// Starts that an image has to be confirmed in.
pub const TRIALS: usize = 3;
/// Place of the sequence in a slot.
pub const SEQUENCE_AT: u32 = HEADER_BYTES as u32;
/// Place of the first start.
pub const TRIALS_AT: u32 = SEQUENCE_AT + 8;
/// Place of the confirmation.
pub const CONFIRMATION_AT: u32 = TRIALS_AT + 4 * TRIALS as u32;
/// Bytes of a slot's head: header and words.
pub const HEAD_BYTES: usize = CONFIRMATION_AT as usize + 4;
/// A word that means yes.
pub const YES_WORD: u32 = 0;

const BLANK_WORD: u32 = u32::MAX;

/// The head of a slot that holds an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Standing {
    /// What the image says of itself.
    pub header: Header,
    /// The later of two images has the higher one.
    pub sequence: u32,
    /// Starts used.
    pub trials: usize,
    /// It has proved itself.
    pub confirmed: bool,
}

/// What goes behind the header of an image that is written by a probe: the first one, confirmed.
pub fn first_marks() -> [u8; HEAD_BYTES - HEADER_BYTES] {
    let mut marks = [0xff; HEAD_BYTES - HEADER_BYTES];
    let (words, _) = marks.as_chunks_mut::<4>();
    for (word, value) in words.iter_mut().zip(sequence_words(1)) {
        *word = value.to_le_bytes();
    }
    if let Some(confirmed) = words.last_mut() {
        *confirmed = YES_WORD.to_le_bytes();
    }
    marks
}

/// The two words of a sequence.
pub const fn sequence_words(sequence: u32) -> [u32; 2] {
    [sequence, !sequence]
}

impl Standing {
    /// Reads the head of the slot that begins at `base`; `None` where it holds no image for this place.
    pub fn read(head: &[u8; HEAD_BYTES], base: u32) -> Option<Self> {
        let header = Header::read(head.first_chunk()?).filter(|header| header.base == base)?;
        let word = |at: u32| {
            let bytes = head.get(at as usize..).and_then(|rest| rest.first_chunk());
            bytes.map_or(BLANK_WORD, |bytes| u32::from_le_bytes(*bytes))
        };
        let sequence = word(SEQUENCE_AT);
        let used = (0..TRIALS as u32).filter(|n| word(TRIALS_AT + 4 * n) != BLANK_WORD);
        let standing = Self { header, sequence, trials: used.count(), confirmed: word(CONFIRMATION_AT) == YES_WORD };
        (word(SEQUENCE_AT + 4) == !sequence).then_some(standing)
    }

    /// Whether it is confirmed or may still try.
    pub fn may_start(&self) -> bool {
        self.confirmed || self.trials < TRIALS
    }

    /// As a running image tells it.
    pub fn told(&self) -> ImageStanding {
        if self.confirmed { ImageStanding::Confirmed } else { ImageStanding::OnTrial }
    }

    /// Whether this image was given up for `running`: newer, and with no start left.
    pub fn was_given_up_for(&self, running: &Self) -> bool {
        is_newer(self.sequence, running.sequence) && !self.may_start()
    }
}

/// Which slot to start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    /// Its index.
    pub slot: usize,
    /// Place in the slot of the word to program before the start of an image on trial; where that fails, another
    /// choice is to be made without this slot.
    pub mark_at: Option<u32>,
}

/// The newest image that may start and is whole; without any, the newest that is whole: an image that has not proved
/// itself is better than none. `is_whole` compares a slot's image with its checksum.
pub fn choose(standings: &[Option<Standing>; 2], mut is_whole: impl FnMut(usize, &Header) -> bool) -> Option<Choice> {
    let newest_first = match standings {
        [Some(first), Some(second)] if is_newer(second.sequence, first.sequence) => [1, 0],
        [None, Some(_)] => [1, 0],
        _ => [0, 1],
    };
    let known = newest_first.into_iter().filter_map(|slot| Some((slot, standings.get(slot).copied().flatten()?)));
    let mut spent = None;
    for (slot, standing) in known {
        if !standing.may_start() {
            spent = spent.or(Some((slot, standing)));
        } else if is_whole(slot, &standing.header) {
            let mark_at = (!standing.confirmed).then(|| TRIALS_AT + 4 * standing.trials as u32);
            return Some(Choice { slot, mark_at });
        }
    }
    spent.filter(|(slot, standing)| is_whole(*slot, &standing.header)).map(|(slot, _)| Choice { slot, mark_at: None })
}

/// Sequences count on and on.
fn is_newer(one: u32, other: u32) -> bool {
    one.wrapping_sub(other) as i32 > 0
}
