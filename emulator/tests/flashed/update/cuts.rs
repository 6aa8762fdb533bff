//! Power cuts at every moment of an update: afterwards an image runs, the former or the new one, whole, and an update
//! works.

use super::super::image::image;
use super::{Update, activate, confirm, erase, running, send_until, started, step, transfer};
use crate::spoken::Node;
use meshband::message::Request;
use meshband::update::header::HEADER_BYTES;
use meshband::update::{ImageStanding, Slot, UpdateRequest};
use meshband_emulator::time::{NO_INSTANT, Time};

/// Units of time between two looks for a busy flash: a word keeps it busy for 16 us.
const LOOK: Time = 336 * 5;
/// Every n-th word of the image is cut.
const CUT_STEP_WORDS: u64 = 1024;
/// Depths of each of the two erasures.
const DEPTHS: u64 = 12;
/// Cuts at random instructions of the loader with the start of the image.
const RANDOM_CUTS: u32 = 40;
/// Cuts at different depths of a single word.
const WORD_DEPTHS: u32 = 4;

/// What the next starts were.
#[derive(Debug, Default, PartialEq, Eq)]
struct Tally {
    tried: u32,
    former: u32,
    on_trial: u32,
    confirmed: u32,
}

struct Campaign {
    node: Node,
    tally: Tally,
    random: u64,
}

impl Campaign {
    fn new(node: Node) -> Self {
        Self { node, tally: Tally::default(), random: 0x2545_f491_4f6c_dd1d }
    }

    /// A share of one, different each time and the same in every run.
    fn share(&mut self) -> f64 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        (self.random >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn due(&self) -> Time {
        self.node.board.chip().flash.due()
    }

    /// Runs to the next instant at which flash is busy; false where it is not within so many seconds.
    fn run_to_next_work(&mut self, seconds: f64) -> bool {
        while self.due() != NO_INSTANT {
            let until = self.due();
            self.node.board.cpu().run(until).expect("runs");
        }
        let end = self.node.board.seconds() + seconds;
        while self.due() == NO_INSTANT && self.node.board.seconds() < end {
            let until = self.node.board.chip().now + LOOK;
            self.node.board.cpu().run(until).expect("runs");
        }
        self.due() != NO_INSTANT
    }

    /// Goes on for a share of the work that flash is busy with, and cuts.
    fn cut_within_work(&mut self, share: f64) {
        let here = self.node.snapshot();
        let (now, due) = (self.node.board.chip().now, self.due());
        self.node.board.cpu().run(now + ((due - now) as f64 * share) as Time).expect("runs");
        self.cut();
        self.node.restore(&here);
    }

    /// Cuts the power now and sees what runs next; then everything is as before.
    fn cut(&mut self) {
        let here = self.node.snapshot();
        self.node.cycle_power();
        self.node.start();
        let image = running(&mut self.node);
        self.tally.tried += 1;
        match (image.slot, image.standing) {
            (Slot::A, ImageStanding::Confirmed) => self.tally.former += 1,
            (Slot::B, ImageStanding::OnTrial) => self.tally.on_trial += 1,
            (Slot::B, ImageStanding::Confirmed) => self.tally.confirmed += 1,
            other => panic!("cut {}: {other:?} runs", self.tally.tried),
        }
        self.node.restore(&here);
    }

    /// Whatever the last cut left behind, the next update works.
    fn assert_updatable(&mut self, update: &Update) {
        self.node.cycle_power();
        self.node.start();
        transfer(&mut self.node, update);
        activate(&mut self.node);
        confirm(&mut self.node);
        assert_eq!(running(&mut self.node).slot, Slot::B);
    }

    fn conclude(&self, what: &str) {
        let Tally { tried, former, on_trial, confirmed } = self.tally;
        println!(
            "{what}: {tried} cuts, then the former image {former}, the new one on trial {on_trial}, confirmed \
             {confirmed}"
        );
        assert_eq!(former + on_trial + confirmed, tried);
    }
}

#[test]
fn fault_power_cut_in_either_erasure_leaves_the_former_image() {
    let Some(image) = image("cuts in erasures") else { return };
    let update = Update::built(1);
    let mut node = started(&image);
    // A former update lies in the slot that is erased.
    transfer(&mut node, &update);
    activate(&mut node);
    confirm(&mut node);
    transfer(&mut node, &Update::built(0));
    activate(&mut node);
    confirm(&mut node);
    let mut campaign = Campaign::new(node);
    campaign.node.send(&Request::Update(UpdateRequest::Begin { header: update.header[..].try_into().expect("fits") }));
    for _ in 0..2 {
        assert!(campaign.run_to_next_work(0.1), "an erasure begins");
        for depth in 0..DEPTHS {
            campaign.cut_within_work((depth as f64 + 0.5) / DEPTHS as f64);
        }
    }
    campaign.conclude("power cut in the erasures");
    assert_eq!(u64::from(campaign.tally.former), 2 * DEPTHS);
    let (now, due) = (campaign.node.board.chip().now, campaign.due());
    campaign.node.board.cpu().run(now + (due - now) / 2).expect("runs");
    campaign.assert_updatable(&update);
}

#[test]
fn fault_power_cut_in_the_transfer_leaves_the_former_image() {
    let Some(image) = image("cuts in the transfer") else { return };
    let update = Update::built(1);
    let mut node = started(&image);
    erase(&mut node, &update);
    let mut campaign = Campaign::new(node);
    let words = update.bytes.len() as u64 / 4;
    for word in (0..words).step_by(CUT_STEP_WORDS as usize) {
        send_until(&mut campaign.node, &update, (word * 4) as u32);
        let before = campaign.node.snapshot();
        let next = step(&mut campaign.node, UpdateRequest::Status).next;
        let part = &update.bytes[next as usize..(next as usize + 512).min(update.bytes.len())];
        let chunk_words = part.len() / 4;
        let chunk = UpdateRequest::Chunk { offset: next, bytes: part.try_into().expect("fits") };
        campaign.node.send(&Request::Update(chunk));
        // One of the chunk's words; the last chunk has fewer.
        for _ in 0..=campaign.random % (chunk_words as u64).min(100) {
            assert!(campaign.run_to_next_work(0.5), "word {word}");
        }
        let share = campaign.share();
        campaign.cut_within_work(share);
        campaign.node.restore(&before);
    }
    campaign.conclude("power cut in the transfer");
    assert_eq!(campaign.tally.former, campaign.tally.tried);
    campaign.assert_updatable(&update);
}

#[test]
fn fault_power_cut_in_each_word_of_the_seal_leaves_the_former_image_or_the_whole_new_one() {
    let Some(image) = image("cuts in the seal") else { return };
    let update = Update::built(1);
    let mut node = started(&image);
    transfer(&mut node, &update);
    let mut campaign = Campaign::new(node);
    campaign.node.send(&Request::Update(UpdateRequest::Activate));
    // Sequence with its complement, and the header.
    let words = 2 + HEADER_BYTES / 4;
    for word in 1..=words {
        assert!(campaign.run_to_next_work(0.5), "word {word}");
        for depth in 0..WORD_DEPTHS {
            campaign.cut_within_work((f64::from(depth) + 0.5) / f64::from(WORD_DEPTHS));
        }
        let Tally { tried, former, .. } = campaign.tally;
        assert!(former == tried || word == words, "without the last word there is no image");
    }
    // Late in the last word all its bits may have changed already.
    let early = campaign.tally.on_trial;
    assert!(early <= WORD_DEPTHS / 2, "{early} of the last word's cuts came too late");
    // The last word done, and from there to the restart: the new one.
    for _ in 0..20 {
        let until = campaign.node.board.seconds() + 0.01;
        campaign.node.board.run_until(until).expect("runs");
        campaign.cut();
    }
    campaign.conclude("power cut in the seal and behind it");
    assert_eq!(campaign.tally.on_trial, early + 20);
}

#[test]
fn fault_power_cut_in_the_loader_counts_a_start_and_an_image_runs() {
    let Some(image) = image("cuts in the loader") else { return };
    let update = Update::built(1);
    let mut node = started(&image);
    transfer(&mut node, &update);
    assert_eq!(step(&mut node, UpdateRequest::Activate).refusal, None);
    super::wait_for_reset(&mut node);
    // At the reset into the new image: one start is counted by the loader, within one word.
    node.cycle_power();
    let mut campaign = Campaign::new(node);
    let before = campaign.node.snapshot();
    assert!(campaign.run_to_next_work(0.5), "a start is counted");
    for depth in 0..WORD_DEPTHS {
        campaign.cut_within_work((f64::from(depth) + 0.5) / f64::from(WORD_DEPTHS));
    }
    let in_word = campaign.node.board.cpu().instructions();
    campaign.node.restore(&before);
    let first = campaign.node.board.cpu().instructions();
    let span = 2 * (in_word - first);
    for _ in 0..RANDOM_CUTS {
        let place = (campaign.share() * span as f64) as u64;
        let end = campaign.node.board.chip().now + 336_000_000;
        campaign.node.board.cpu().run_instructions(place, end).expect("runs");
        campaign.cut();
        campaign.node.restore(&before);
    }
    campaign.conclude("power cut in the loader");
    assert_eq!(campaign.tally.on_trial, campaign.tally.tried, "starts are left");
}

#[test]
fn fault_power_cut_in_the_confirmation_leaves_the_new_image_on_trial_or_confirmed() {
    let Some(image) = image("cuts in the confirmation") else { return };
    let update = Update::built(1);
    let mut node = started(&image);
    transfer(&mut node, &update);
    activate(&mut node);
    node.run(5.5);
    let mut campaign = Campaign::new(node);
    campaign.node.send(&Request::Update(UpdateRequest::Confirm));
    assert!(campaign.run_to_next_work(0.5), "the word is written");
    for depth in 0..WORD_DEPTHS {
        campaign.cut_within_work((f64::from(depth) + 0.5) / f64::from(WORD_DEPTHS));
    }
    // Late in the word all its bits may have changed already.
    let on_trial = campaign.tally.on_trial;
    assert!(on_trial >= WORD_DEPTHS / 2, "{on_trial}");
    let torn = campaign.node.snapshot();
    while campaign.due() != NO_INSTANT {
        let until = campaign.due();
        campaign.node.board.cpu().run(until).expect("runs");
    }
    campaign.cut();
    campaign.conclude("power cut in the confirmation");
    assert_eq!(campaign.tally.confirmed, WORD_DEPTHS - on_trial + 1);
    // A word that was torn is completed by the next confirmation.
    campaign.node.restore(&torn);
    let (now, due) = (campaign.node.board.chip().now, campaign.due());
    campaign.node.board.cpu().run(now + (due - now) / 2).expect("runs");
    campaign.node.cycle_power();
    campaign.node.start();
    confirm(&mut campaign.node);
    campaign.node.cycle_power();
    campaign.node.start();
    let image = running(&mut campaign.node);
    assert_eq!((image.slot, image.standing), (Slot::B, ImageStanding::Confirmed));
}
