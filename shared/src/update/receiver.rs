//! Takes an image into the free slot, step by step, and confirms the running one.
//!
//! Bytes are taken in order: a chunk that is not the next one changes nothing, and every answer names the next, so
//! whatever the line loses or repeats the host goes on from there. Nothing of a transfer survives a restart of the
//! node; the host then begins again.
//!
//! The board calls [`Updater::on_request`] for each request, and [`Updater::work`] once per turn of its main loop,
//! which erases one sector: the watchdog is fed in between.

use crate::frame::CRC32;
use crate::update::header::{HEADER_BYTES, Header, IMAGE_OFFSET};
use crate::update::slots::{CONFIRMATION_AT, HEAD_BYTES, SEQUENCE_AT, Standing, YES_WORD, sequence_words};
use crate::update::vocabulary::{
    ImageStanding, RunningImage, Slot, Stage, StartCause, UpdateRefused, UpdateRequest, UpdateStatus,
};
use embedded_storage::nor_flash::NorFlash;

/// A slot: its flash, addressed from 0, and where it lies for the processor.
#[derive(Debug)]
pub struct Place<F> {
    /// The slot's sectors.
    pub flash: F,
    /// First address.
    pub base: u32,
}

impl<F: NorFlash> Place<F> {
    /// Reads the head.
    #[inline(never)]
    pub fn standing(&mut self) -> Option<Standing> {
        let mut head = [0; HEAD_BYTES];
        self.flash.read(0, &mut head).ok()?;
        Standing::read(&head, self.base)
    }

    fn bytes(&self) -> u32 {
        self.flash.capacity() as u32
    }

    /// Writes whole words and reads them back.
    #[inline(never)]
    fn write(&mut self, at: u32, bytes: &[u8]) -> Result<(), UpdateRefused> {
        self.flash.write(at, bytes).map_err(|_| UpdateRefused::Flash)?;
        let mut kept = [0; 64];
        for (n, written) in bytes.chunks(kept.len()).enumerate() {
            let place = at.saturating_add((n * 64) as u32);
            let kept = kept.get_mut(..written.len()).unwrap_or_default();
            self.flash.read(place, kept).map_err(|_| UpdateRefused::Flash)?;
            if kept != written {
                return Err(UpdateRefused::Flash);
            }
        }
        Ok(())
    }

    /// CRC-32 of the first bytes of the image.
    fn checksum(&mut self, length: u32) -> Result<u32, UpdateRefused> {
        let (mut digest, mut part) = (CRC32.digest(), [0; 64]);
        let mut at = 0;
        while at < length {
            let piece = part.get_mut(..(length - at).min(64) as usize).unwrap_or_default();
            self.flash.read(IMAGE_OFFSET.saturating_add(at), piece).map_err(|_| UpdateRefused::Flash)?;
            digest.update(piece);
            at += 64;
        }
        Ok(digest.finalize())
    }
}

/// What has happened, for an event ([`crate::events::EventKind::Update`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Step {
    /// The free slot is about to be erased.
    Begun = 1,
    /// An image is complete and sound; the node restarts into it.
    Activated = 2,
    /// A new image runs, not confirmed yet.
    OnTrial = 3,
    /// The running image has been confirmed.
    Confirmed = 4,
    /// A newer image was given up for the running one.
    GivenUp = 5,
}

impl Step {
    /// Detail of the event: the step in the highest byte, the image's version below.
    pub const fn detail(self, version: [u8; 3]) -> u32 {
        let [major, minor, patch] = version;
        u32::from_be_bytes([self as u8, major, minor, patch])
    }
}

/// Both slots, seen from the image that runs in one of them.
#[derive(Debug)]
pub struct Updater<F> {
    slot: Slot,
    own: Place<F>,
    free: Place<F>,
    description: &'static [u8; HEADER_BYTES],
    /// As read at the start, and since.
    standing: Option<Standing>,
    given_up: Option<[u8; 3]>,
    stage: Stage,
    /// Of the image that is being received, and as it came.
    header: Option<(Header, [u8; HEADER_BYTES])>,
    erased: u32,
    next: u32,
    step: Option<u32>,
}

impl<F: NorFlash> Updater<F> {
    /// For an image in a slot that describes itself so; `free` is the other slot.
    pub fn new(slot: Slot, mut own: Place<F>, mut free: Place<F>, description: &'static [u8; HEADER_BYTES]) -> Self {
        let standing = own.standing();
        let other = free.standing();
        let given_up = standing.zip(other).filter(|(own, other)| other.was_given_up_for(own));
        let given_up = given_up.map(|(_, other)| other.header.version);
        let step = match (standing, given_up) {
            (Some(own), _) if !own.confirmed => Some(Step::OnTrial.detail(own.header.version)),
            (_, Some(version)) => Some(Step::GivenUp.detail(version)),
            _ => None,
        };
        let (stage, header) = (Stage::Idle, None);
        Self { slot, own, free, description, standing, given_up, stage, header, erased: 0, next: 0, step }
    }

    /// Whether the running image has still to be confirmed.
    pub fn is_on_trial(&self) -> bool {
        self.standing.is_some_and(|standing| !standing.confirmed)
    }

    /// How far an update is.
    pub fn stage(&self) -> Stage {
        self.stage
    }

    /// What `Identify` tells.
    pub fn running(&self, started: StartCause) -> RunningImage {
        RunningImage { slot: self.slot, standing: self.told(), started, given_up: self.given_up }
    }

    fn told(&self) -> ImageStanding {
        self.standing.map_or(ImageStanding::Unmanaged, |standing| standing.told())
    }

    /// Detail of the event that is to be noted, once each.
    pub fn take_step(&mut self) -> Option<u32> {
        self.step.take()
    }

    /// Carries out a step, rarely and slowly; `missing` is what a confirmation lacks ([`super::trial`]).
    #[cold]
    #[inline(never)]
    pub fn on_request(&mut self, request: &UpdateRequest, missing: u8) -> UpdateStatus {
        let outcome = match request {
            UpdateRequest::Status => Ok(()),
            UpdateRequest::Begin { header } => self.begin(header),
            UpdateRequest::Chunk { offset, bytes } => self.take(*offset, bytes),
            UpdateRequest::Activate => self.activate(),
            UpdateRequest::Confirm => self.confirm(missing),
        };
        UpdateStatus {
            stage: self.stage,
            next: self.next,
            length: self.header.map_or(0, |(header, _)| header.length),
            free: self.free.base,
            standing: self.told(),
            missing: if self.is_on_trial() { missing } else { 0 },
            refusal: outcome.err(),
        }
    }

    fn begin(&mut self, bytes: &[u8]) -> Result<(), UpdateRefused> {
        let bytes: &[u8; HEADER_BYTES] = bytes.try_into().map_err(|_| UpdateRefused::Header)?;
        if self.stage == Stage::Restarting || self.header.is_some_and(|(_, known)| known == *bytes) {
            return Ok(());
        }
        if self.standing.is_none() {
            return Err(UpdateRefused::NotSupported);
        }
        if self.is_on_trial() {
            return Err(UpdateRefused::OnTrial);
        }
        let header = Header::read(bytes).ok_or(UpdateRefused::Header)?;
        header.check(self.free.base, self.free.bytes(), self.description)?;
        (self.stage, self.header) = (Stage::Erasing, Some((header, *bytes)));
        (self.erased, self.next, self.given_up) = (0, 0, None);
        self.step = Some(Step::Begun.detail(header.version));
        Ok(())
    }

    /// Erases the next sector of the free slot, if one is to be erased; the first one first, whose end is the end of
    /// what was there.
    pub fn work(&mut self) {
        if self.stage != Stage::Erasing {
            return;
        }
        let until = self.erased.saturating_add(F::ERASE_SIZE as u32);
        if self.free.flash.erase(self.erased, until).is_err() {
            return self.abandon();
        }
        self.erased = until;
        if until >= self.free.bytes() {
            self.stage = Stage::Receiving;
        }
    }

    fn abandon(&mut self) {
        (self.stage, self.header, self.next) = (Stage::Idle, None, 0);
    }

    fn take(&mut self, offset: u32, bytes: &[u8]) -> Result<(), UpdateRefused> {
        let Some((header, _)) = self.header.filter(|_| self.stage == Stage::Receiving) else {
            return Err(UpdateRefused::NotReady);
        };
        let end = offset.checked_add(bytes.len() as u32).filter(|&end| end <= header.length);
        let Some(end) = end.filter(|_| bytes.len().is_multiple_of(4)) else { return Err(UpdateRefused::Range) };
        if offset != self.next {
            return Ok(());
        }
        if self.free.write(IMAGE_OFFSET.saturating_add(offset), bytes).is_err() {
            self.abandon();
            return Err(UpdateRefused::Flash);
        }
        self.next = end;
        Ok(())
    }

    fn activate(&mut self) -> Result<(), UpdateRefused> {
        if self.stage == Stage::Restarting {
            return Ok(());
        }
        let Some((header, bytes)) = self.header.filter(|_| self.stage == Stage::Receiving) else {
            return Err(UpdateRefused::NotReady);
        };
        if self.next != header.length {
            return Err(UpdateRefused::Incomplete);
        }
        let outcome = self.seal(&header, &bytes);
        match outcome {
            Ok(()) => {
                self.stage = Stage::Restarting;
                self.step = Some(Step::Activated.detail(header.version));
            }
            Err(_) => self.abandon(),
        }
        outcome
    }

    /// Checks the whole image and makes it one that the loader knows: the header's checksum is the last word written.
    fn seal(&mut self, header: &Header, bytes: &[u8; HEADER_BYTES]) -> Result<(), UpdateRefused> {
        if self.free.checksum(header.length)? != header.checksum {
            return Err(UpdateRefused::Damaged);
        }
        let mut vectors = [0; 8];
        self.free.flash.read(IMAGE_OFFSET, &mut vectors).map_err(|_| UpdateRefused::Flash)?;
        let (words, _) = vectors.as_chunks::<4>();
        if !matches!(words, [stack, entry] if header.fits_vectors(u32::from_le_bytes(*stack),
            u32::from_le_bytes(*entry)))
        {
            return Err(UpdateRefused::Vectors);
        }
        let sequence = self.standing.map_or(0, |standing| standing.sequence).wrapping_add(1);
        for (n, word) in (0..).zip(sequence_words(sequence)) {
            self.free.write(SEQUENCE_AT + 4 * n, &word.to_le_bytes())?;
        }
        let (body, sum) = bytes.split_at(HEADER_BYTES - 4);
        self.free.write(0, body)?;
        self.free.write(HEADER_BYTES as u32 - 4, sum)?;
        if self.free.standing().is_some() { Ok(()) } else { Err(UpdateRefused::Flash) }
    }

    fn confirm(&mut self, missing: u8) -> Result<(), UpdateRefused> {
        match self.standing {
            None => Err(UpdateRefused::NotSupported),
            Some(standing) if standing.confirmed => Ok(()),
            Some(_) if missing != 0 => Err(UpdateRefused::Unwell),
            Some(standing) => {
                self.own.write(CONFIRMATION_AT, &YES_WORD.to_le_bytes())?;
                self.standing = Some(Standing { confirmed: true, ..standing });
                self.step = Some(Step::Confirmed.detail(standing.header.version));
                Ok(())
            }
        }
    }
}
