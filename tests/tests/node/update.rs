//! Updates on a flash that can fail at any byte: headers, the choice of the loader, the whole course cut everywhere,
//! and the rule of a trial.

use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use meshband::frame::CRC32;
use meshband::message::SelfTest;
use meshband::units::TicksPerSecond;
use meshband::update::checksum;
use meshband::update::header::{HEADER_BYTES, Header, IMAGE_OFFSET, describe, seal};
use meshband::update::receiver::Place;
use meshband::update::slots::{HEAD_BYTES, Standing, TRIALS, YES_WORD, choose, first_marks};
use meshband::update::trial::{SAMPLING_S, TRIAL_S, Trial};
use meshband::update::vocabulary::MAX_CHUNK;
use meshband::update::{ImageStanding, Slot, Stage, StartCause, UpdateRefused, UpdateRequest, UpdateStatus, Updater};
use meshband_tests::mock_flash::{MockError, MockFlash, TornErase};
use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::cell::RefCell;
use std::rc::Rc;

/// Two small sectors per slot: a course has few bytes, so that it can be cut at each.
type Flash = MockFlash<1024, 4>;
const BASES: [u32; 2] = [0x0802_0000, 0x0806_0000];
const CLOCK: TicksPerSecond = TicksPerSecond(84_000_000);
static DESCRIPTION: [u8; HEADER_BYTES] = describe("board", "running");

fn blank(seed: u64) -> Flash {
    Flash::new(2, ChaCha8Rng::seed_from_u64(seed))
}

/// An image with a plausible vector table, and its header.
fn image(slot: usize, length: usize, build: &str) -> ([u8; HEADER_BYTES], Vec<u8>) {
    let mut bytes: Vec<u8> = (0..length).map(|n| (n * 7 + build.len()) as u8).collect();
    bytes[..4].copy_from_slice(&0x1000_a000u32.to_le_bytes());
    bytes[4..8].copy_from_slice(&(BASES[slot] + IMAGE_OFFSET + 0x101).to_le_bytes());
    (seal(&describe("board", build), BASES[slot], &bytes), bytes)
}

#[test]
fn fault_vectors_that_are_not_of_this_image_are_told() {
    let (header, _) = image(0, 2048, "x");
    let header = Header::read(&header).expect("a header");
    let (first, stack) = (BASES[0] + IMAGE_OFFSET, 0x1000_a000);
    assert!(header.fits_vectors(stack, first + 1) && header.fits_vectors(stack, first + 2047));
    assert!(header.fits_vectors(0x1001_0000, first + 1) && header.fits_vectors(0x2002_0000, first + 1));
    for (stack, entry) in [
        (stack, first),
        (stack, first - 1),
        (stack, first + 2049),
        (stack + 4, first + 1),
        (0x1000_0000, first + 1),
        (0x1001_0008, first + 1),
        (0x2002_0008, first + 1),
        (0x1fff_fff8, first + 1),
    ] {
        assert!(!header.fits_vectors(stack, entry), "stack {stack:#x}, entry {entry:#x}");
    }
}

/// A flash that can be looked at while a node holds it.
#[derive(Clone)]
struct Seen(Rc<RefCell<Flash>>);

impl Seen {
    fn taken(self) -> Flash {
        self.0.borrow().clone()
    }
}

impl ErrorType for Seen {
    type Error = MockError;
}

impl ReadNorFlash for Seen {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), MockError> {
        self.0.borrow_mut().read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.0.borrow().capacity()
    }
}

impl NorFlash for Seen {
    const WRITE_SIZE: usize = Flash::WRITE_SIZE;
    const ERASE_SIZE: usize = Flash::ERASE_SIZE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), MockError> {
        self.0.borrow_mut().erase(from, to)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), MockError> {
        self.0.borrow_mut().write(offset, bytes)
    }
}

/// Both slots as a probe leaves them: an image in the lower one.
fn flashed(seed: u64) -> [Flash; 2] {
    let (header, bytes) = image(0, 512, "running");
    let mut lower = blank(seed);
    lower.bytes[..HEADER_BYTES].copy_from_slice(&header);
    lower.bytes[HEADER_BYTES..HEAD_BYTES].copy_from_slice(&first_marks());
    lower.bytes[512..512 + bytes.len()].copy_from_slice(&bytes);
    [lower, blank(seed + 1)]
}

/// As after a power cut: what is in the cells, and nothing else.
fn powered_up(flash: &Flash, seed: u64) -> Flash {
    let mut fresh = blank(seed);
    fresh.bytes.clone_from(&flash.bytes);
    fresh
}

fn standings(slots: &[Flash; 2]) -> [Option<Standing>; 2] {
    [0, 1].map(|n| Standing::read(slots[n].bytes.first_chunk().expect("a head"), BASES[n]))
}

/// What the loader does: chooses, and counts a start. Gives the slot.
fn load(slots: &mut [Flash; 2]) -> Option<usize> {
    let standings = standings(slots);
    let whole = |slot: usize, header: &Header| {
        let bytes = slots[slot].bytes.get(512..512 + header.length as usize);
        bytes.is_some_and(|bytes| checksum::of_image(bytes) == header.checksum)
    };
    let choice = choose(&standings, whole)?;
    if let Some(at) = choice.mark_at {
        slots[choice.slot].bytes[at as usize..at as usize + 4].copy_from_slice(&YES_WORD.to_le_bytes());
    }
    Some(choice.slot)
}

/// A node, and the slots it writes to.
struct Node {
    updater: Updater<Seen>,
    slots: [Seen; 2],
}

impl Node {
    /// In the lower slot (0) or in the upper one.
    fn new(slots: [Flash; 2], running: usize) -> Self {
        let slots = slots.map(|flash| Seen(Rc::new(RefCell::new(flash))));
        let place = |slot: usize| Place { flash: slots[slot].clone(), base: BASES[slot] };
        let slot = if running == 0 { Slot::A } else { Slot::B };
        Self { updater: Updater::new(slot, place(running), place(1 - running), &DESCRIPTION), slots }
    }

    fn ask(&mut self, request: &UpdateRequest, missing: u8) -> UpdateStatus {
        self.updater.on_request(request, missing)
    }

    /// The slots, the lower one first.
    fn into_slots(self) -> [Flash; 2] {
        self.slots.map(Seen::taken)
    }
}

/// A whole course from the first request to the seal; gives the last answer, or none where the power failed on the way.
fn send(node: &mut Node, header: &[u8; HEADER_BYTES], bytes: &[u8]) -> Option<UpdateStatus> {
    let begin = UpdateRequest::Begin { header: header[..].try_into().expect("fits") };
    let mut status = node.ask(&begin, 0);
    while status.refusal.is_none() && status.stage == Stage::Erasing {
        node.updater.work();
        status = node.ask(&UpdateRequest::Status, 0);
    }
    while status.refusal.is_none() && status.stage == Stage::Receiving && (status.next as usize) < bytes.len() {
        let rest = &bytes[status.next as usize..];
        let part = rest[..rest.len().min(MAX_CHUNK)].try_into().expect("fits");
        status = node.ask(&UpdateRequest::Chunk { offset: status.next, bytes: part }, 0);
    }
    if status.stage != Stage::Receiving {
        return None;
    }
    let status = node.ask(&UpdateRequest::Activate, 0);
    (status.stage == Stage::Restarting).then_some(status)
}

#[test]
fn ref_checksum_by_slices_is_that_of_the_frames() {
    assert_eq!(checksum::of_image(b"123456789"), 0xcbf4_3926, "check value of CRC-32/ISO-HDLC");
    let bytes: Vec<u8> = (0..1027u32).map(|n| ((n * n) >> 3) as u8).collect();
    for length in 0..bytes.len() {
        assert_eq!(checksum::of_image(&bytes[..length]), CRC32.checksum(&bytes[..length]), "{length}");
    }
}

#[test]
fn fault_a_header_with_any_bit_changed_is_none() {
    let (good, _) = image(1, 512, "abc");
    assert!(Header::read(&good).is_some());
    for bit in 0..8 * HEADER_BYTES {
        let mut bytes = good;
        bytes[bit / 8] ^= 1 << (bit % 8);
        assert_eq!(Header::read(&bytes), None, "bit {bit}");
    }
}

/// With power cut after each byte that is written or erased: the image before runs until the last one, then the new
/// one.
#[test]
fn fault_power_cut_at_every_byte_of_an_update_leaves_an_image_that_runs_and_takes_the_next_update() {
    let (header, bytes) = image(1, 1024, "new");
    for torn_erase in [TornErase::FromFront, TornErase::Everywhere] {
        let (mut formers, mut news) = (0, 0);
        for cut in 0.. {
            let mut slots = flashed(cut);
            // Something was there before.
            let (old, old_bytes) = image(1, 768, "former");
            slots[1].bytes[..HEADER_BYTES].copy_from_slice(&old);
            slots[1].bytes[512..512 + old_bytes.len()].copy_from_slice(&old_bytes);
            (slots[1].torn_erase, slots[1].bytes_until_shutoff) = (torn_erase, Some(cut));
            let mut node = Node::new(slots, 0);
            let done = send(&mut node, &header, &bytes).is_some();
            let mut slots = node.into_slots().map(|flash| powered_up(&flash, cut));
            match load(&mut slots) {
                Some(0) => formers += 1,
                Some(1) => news += 1,
                other => panic!("{other:?} after {cut} bytes"),
            }
            assert!(!done || news == 1, "complete means that it starts");
            if cut % 97 == 0 && news == 0 {
                let mut node = Node::new(slots, 0);
                assert!(send(&mut node, &header, &bytes).is_some(), "after {cut} bytes");
            }
            if done {
                break;
            }
        }
        println!("{torn_erase:?}: {formers} cuts with the former image, {news} with the new one");
        assert!(formers > 3000, "{formers}: every byte of two sectors and of the image");
    }
}

#[test]
fn theory_an_image_has_three_starts_and_then_the_one_before_it_runs() {
    let (header, bytes) = image(1, 512, "new");
    let mut node = Node::new(flashed(1), 0);
    assert!(send(&mut node, &header, &bytes).is_some());
    let mut slots = node.into_slots();
    for start in 0..TRIALS {
        assert_eq!(load(&mut slots), Some(1), "start {start}");
    }
    for _ in 0..5 {
        assert_eq!(load(&mut slots), Some(0));
    }
    let node = Node::new(slots, 0);
    let image = node.updater.running(StartCause::Watchdog);
    assert_eq!((image.slot, image.standing), (Slot::A, ImageStanding::Confirmed));
    assert_eq!(image.given_up, Some(meshband::identity::VERSION));
}

#[test]
fn theory_a_confirmed_image_stays_and_updates_go_from_slot_to_slot() {
    let mut slots = flashed(1);
    for round in 0..6 {
        let running = load(&mut slots).expect("runs");
        assert_eq!(running, round % 2, "round {round}");
        let mut node = Node::new(slots, running);
        if node.updater.is_on_trial() {
            let refused = node.ask(&UpdateRequest::Confirm, 4);
            assert_eq!((refused.refusal, refused.missing), (Some(UpdateRefused::Unwell), 4));
            assert_eq!(node.ask(&UpdateRequest::Confirm, 0).refusal, None);
            assert_eq!(node.ask(&UpdateRequest::Status, 4).missing, 0, "nothing is lacking any more");
        }
        let (header, bytes) = image(1 - running, 512 + 8 * round, "next");
        assert!(send(&mut node, &header, &bytes).is_some(), "round {round}");
        slots = node.into_slots();
    }
}

#[test]
fn theory_without_an_image_that_may_start_the_newest_whole_one_does() {
    let mut slots = flashed(1);
    let confirmed = HEAD_BYTES - 4;
    slots[0].bytes[confirmed..HEAD_BYTES].fill(0xff);
    for _ in 0..TRIALS + 3 {
        assert_eq!(load(&mut slots), Some(0), "alone, it starts for ever");
    }
    slots[0].bytes[600] ^= 1;
    assert_eq!(load(&mut slots), None);
    assert_eq!(load(&mut [blank(1), blank(2)]), None);
}

#[test]
fn theory_a_trial_needs_configuration_self_test_and_samples() {
    let passed = SelfTest { run: 0b11111, failed: 0b01110 };
    let mut trial = Trial::new(CLOCK);
    let second = CLOCK.0;
    for n in 0..=SAMPLING_S {
        assert_eq!(trial.missing(true, passed), 4, "{n} s");
        trial.follow(n * second, true);
    }
    assert_eq!(trial.missing(true, passed), 0, "sensor and tach are not the image's");
    assert_eq!(trial.missing(false, passed), 1);
    for test in
        [SelfTest { run: 0b11111, failed: 1 }, SelfTest { run: 0b11111, failed: 16 }, SelfTest { run: 1, failed: 0 }]
    {
        assert_eq!(trial.missing(true, test), 2, "{test:?}");
    }
    trial.follow((SAMPLING_S + 1) * second, false);
    assert_eq!(trial.missing(true, passed), 4, "a pause begins anew");
    let mut now = (SAMPLING_S + 1) * second;
    for n in SAMPLING_S + 1..TRIAL_S {
        assert!(!trial.is_over(), "{n} s");
        now = now.wrapping_add(second);
        trial.follow(now, true);
    }
    assert!(trial.is_over());
}

proptest! {
    /// Requests in any order with any contents: nothing panics, and the running image's slot keeps every byte.
    #[test]
    fn fault_any_requests_leave_the_running_image_alone(
        steps in prop::collection::vec((0u8..6, any::<u32>(), prop::collection::vec(any::<u8>(), 0..64)), 0..40)
    ) {
        let slots = flashed(3);
        let before = slots[0].bytes.clone();
        let (header, image) = image(1, 600, "x");
        let mut node = Node::new(slots, 0);
        for (kind, offset, bytes) in steps {
            let part = bytes[..].try_into().expect("fits");
            let step = match kind {
                0 => UpdateRequest::Begin { header: header[..].try_into().expect("fits") },
                1 => UpdateRequest::Begin { header: part },
                2 => UpdateRequest::Chunk { offset: offset % 700, bytes: part },
                3 => UpdateRequest::Chunk { offset: 0, bytes: image[..512].try_into().expect("fits") },
                4 => UpdateRequest::Activate,
                _ => UpdateRequest::Confirm,
            };
            node.ask(&step, (offset % 8) as u8);
            node.updater.work();
        }
        let [own, _] = node.into_slots();
        prop_assert_eq!(own.bytes, before);
    }
}
