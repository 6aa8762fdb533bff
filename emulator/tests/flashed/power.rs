//! The stored configuration of the released image: it survives restarts, new images and older firmware, and a power
//! cut at every word and instruction leaves the old one or the new one.

use super::image::image;
use super::records::{SLOTS, put};
use super::spoken::Node;
use meshband::alarm::AlarmHolding;
use meshband::config::{Configuration, FrontEnd, GearPair, SCHEMA};
use meshband::events::EventKind;
use meshband::frame::Packet;
use meshband::message::{Message, Reply, Request};
use meshband::rate_plan::RatePolicy;
use meshband::units::Hertz;
use meshband_emulator::cpu::Snapshot;
use meshband_emulator::elf::Image;
use meshband_emulator::flash::{DATA_START, START};
use meshband_emulator::time::{NO_INSTANT, Time};

/// Units of time between two looks for a busy flash: a word keeps it busy for 16 us.
const LOOK: Time = 336 * 5;
/// Cuts at random instructions, of a commit into a blank slot and of one that erases a sector first.
const RANDOM_CUTS: u32 = 500;
/// Depths of an erasure cut short.
const ERASE_CUTS: u32 = 40;

/// A configuration that is told by its gear; at a low rate, so that a run is cheap.
fn with_gear(gear_teeth: u16) -> Configuration {
    Configuration {
        gears: GearPair { pinion_teeth: 19, gear_teeth },
        policy: RatePolicy::Forced { rate: Hertz(20_000.0) },
        ..Configuration::default()
    }
}

const OLDER_TEETH: u16 = 31;
const OLD_TEETH: u16 = 48;
const NEW_TEETH: u16 = 61;

fn stored(config: &Configuration) -> Vec<u8> {
    let mut bytes = [0; Configuration::MAX_SERIALISED];
    postcard::to_slice(config, &mut bytes).expect("fits").to_vec()
}

/// Both sectors full, the newest record in the last slot of the first: the next commit erases the second.
fn fill(node: &mut Node) {
    let (older, old) = (stored(&with_gear(OLDER_TEETH)), stored(&with_gear(OLD_TEETH)));
    for slot in 0..SLOTS {
        put(node.board.chip_mut(), SLOTS + slot, slot as u32, &older);
        put(node.board.chip_mut(), slot, (SLOTS + slot) as u32, if slot + 1 == SLOTS { &old } else { &older });
    }
}

/// What a campaign of cuts has found.
#[derive(Debug, Default, PartialEq, Eq)]
struct Tally {
    tried: u32,
    old: u32,
    new: u32,
    damaged: u32,
    /// Starts that reported a record cut short.
    reported: u32,
}

/// A commit from the command on.
struct Course {
    /// Words programmed.
    words: u64,
    /// Behind the reading back of the last word.
    end: Time,
    /// Instructions until flash is first changed.
    reading: u64,
    /// Instructions until `end`.
    instructions: u64,
}

/// A node that is about to store [`NEW_TEETH`] in the place of [`OLD_TEETH`].
struct Campaign {
    node: Node,
    /// The command is on its way.
    before: (Snapshot, f64),
    tally: Tally,
    random: u64,
}

impl Campaign {
    fn new(image: &Image, prepare: impl Fn(&mut Node)) -> Self {
        let mut node = Node::new(image);
        prepare(&mut node);
        node.start();
        assert_eq!(node.configuration(), with_gear(OLD_TEETH));
        node.configure(&with_gear(NEW_TEETH));
        node.send(&Request::CommitConfiguration);
        let before = node.snapshot();
        Self { node, before, tally: Tally::default(), random: 0x2545_f491_4f6c_dd1d }
    }

    /// A share of one, different each time and the same in every run.
    fn share(&mut self) -> f64 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        (self.random >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn is_busy(&self) -> bool {
        self.node.board.chip().flash.due() != NO_INSTANT
    }

    /// Runs to the next instant at which flash is busy, or `false` at `end`.
    fn run_to_next_work(&mut self, end: Time) -> bool {
        while self.is_busy() {
            let until = self.node.board.chip().flash.due();
            self.node.board.cpu().run(until).expect("runs");
        }
        while !self.is_busy() && self.node.board.chip().now < end {
            let until = self.node.board.chip().now + LOOK;
            self.node.board.cpu().run(until).expect("runs");
        }
        self.is_busy()
    }

    /// Runs the whole commit and goes back to before it.
    fn whole(&mut self) -> Course {
        let flash = self.node.board.chip().flash.programmed;
        let first = self.node.board.cpu().instructions();
        self.node.wait_for_event(EventKind::ConfigurationStored);
        let words = self.node.board.chip().flash.programmed - flash;
        self.node.restore(&self.before);
        assert!(self.run_to_next_work(Time::MAX), "flash is written");
        let reading = self.node.board.cpu().instructions() - first;
        while self.node.board.chip().flash.programmed - flash < words {
            let until = self.node.board.chip().now + LOOK;
            self.node.board.cpu().run(until).expect("runs");
        }
        // Reading back comes behind the last word.
        let end = self.node.board.chip().now + 100 * LOOK;
        self.node.board.cpu().run(end).expect("runs");
        let instructions = self.node.board.cpu().instructions() - first;
        self.node.restore(&self.before);
        Course { words, end, reading, instructions }
    }

    /// Cuts the power now and sees what the next start finds; then everything is as before.
    fn cut(&mut self) {
        let here = self.node.snapshot();
        self.node.cycle_power();
        self.node.start();
        let found = self.node.configuration();
        let refused = |e: meshband::events::Event| e.kind == EventKind::ConfigurationRefused && e.detail == 1;
        self.tally.reported += u32::from(self.node.events().any(refused));
        self.tally.tried += 1;
        *(if found == with_gear(OLD_TEETH) {
            &mut self.tally.old
        } else if found == with_gear(NEW_TEETH) {
            &mut self.tally.new
        } else {
            &mut self.tally.damaged
        }) += 1;
        // Whatever was left behind, the next commit finds its place.
        if self.tally.tried.is_multiple_of(25) {
            self.node.configure(&with_gear(NEW_TEETH));
            self.node.commit();
            self.node.cycle_power();
            self.node.start();
            assert_eq!(self.node.configuration(), with_gear(NEW_TEETH), "after cut {}", self.tally.tried);
        }
        self.node.restore(&here);
    }

    /// Cuts at random instructions, half of them from the first change of the flash on; where flash is busy behind one,
    /// somewhere in that time.
    fn cut_at_instructions(&mut self, cuts: u32, course: &Course) {
        let &Course { end, reading, instructions, .. } = course;
        let first = self.node.board.cpu().instructions();
        let from = |n: u32| if n.is_multiple_of(2) { 0 } else { reading };
        let mut places: Vec<u64> =
            (0..cuts).map(|n| from(n) + (self.share() * (instructions - from(n)) as f64) as u64).collect();
        places.sort_unstable();
        for place in places {
            let done = self.node.board.cpu().instructions() - first;
            self.node.board.cpu().run_instructions(place.saturating_sub(done), end).expect("runs");
            let here = self.node.snapshot();
            if self.is_busy() {
                let (now, due) = (self.node.board.chip().now, self.node.board.chip().flash.due());
                let share = self.share();
                self.node.board.cpu().run(now + ((due - now) as f64 * share) as Time).expect("runs");
            }
            self.cut();
            self.node.restore(&here);
        }
    }

    /// Prints the counts and asserts that nothing was damaged and that both outcomes occurred.
    fn conclude(&self, what: &str) {
        let Tally { tried, old, new, damaged, reported } = self.tally;
        println!("{what}: {tried} tried, {old} old, {new} new, {damaged} damaged; {reported} reported a cut");
        assert_eq!((damaged, old + new), (0, tried));
    }
}

fn store_old(node: &mut Node) {
    put(node.board.chip_mut(), 0, 7, &stored(&with_gear(OLD_TEETH)));
}

#[test]
fn fault_power_cut_at_every_word_of_a_commit_leaves_the_old_or_the_new_configuration() {
    let Some(image) = image("power cut at every word") else { return };
    let mut campaign = Campaign::new(&image, store_old);
    let Course { words, end, .. } = campaign.whole();
    for word in 0..words {
        assert!(campaign.run_to_next_work(end), "word {word}");
        let here = campaign.node.snapshot();
        let (now, due) = (campaign.node.board.chip().now, campaign.node.board.chip().flash.due());
        let share = campaign.share();
        campaign.node.board.cpu().run(now + ((due - now) as f64 * share) as Time).expect("runs");
        campaign.cut();
        campaign.node.restore(&here);
    }
    campaign.conclude("power cut in each word");
    assert_eq!(u64::from(campaign.tally.tried), words);
    assert!(campaign.tally.reported >= campaign.tally.tried / 2, "a record cut short is said");
}

#[test]
fn fault_power_cut_in_an_erasure_leaves_the_old_configuration_and_the_next_commit_works() {
    let Some(image) = image("power cut in an erasure") else { return };
    let mut campaign = Campaign::new(&image, fill);
    let end = campaign.node.board.chip().now + 336_000_000;
    assert!(campaign.run_to_next_work(end), "the erasure begins");
    let (start, due) = (campaign.node.board.chip().now, campaign.node.board.chip().flash.due());
    for depth in 0..ERASE_CUTS {
        let until = start + (due - start) * u64::from(2 * depth + 1) / u64::from(2 * ERASE_CUTS);
        campaign.node.board.cpu().run(until).expect("runs");
        campaign.cut();
    }
    campaign.conclude("power cut in the erasure");
    assert_eq!(campaign.tally.old, ERASE_CUTS);
}

#[test]
fn fault_power_cut_at_500_random_instructions_of_a_commit_leaves_the_old_or_the_new_configuration() {
    let Some(image) = image("power cut at random instructions") else { return };
    let mut campaign = Campaign::new(&image, store_old);
    let course = campaign.whole();
    campaign.cut_at_instructions(RANDOM_CUTS, &course);
    let instructions = course.instructions;
    campaign.conclude(&format!("power cut at random of {instructions} instructions of a commit"));
    assert!(campaign.tally.old > 0 && campaign.tally.new > 0, "the cuts lie on both sides of the change");
}

#[test]
fn fault_power_cut_at_500_random_instructions_of_a_sector_rollover_leaves_the_old_or_the_new_configuration() {
    let Some(image) = image("power cut at random instructions of a rollover") else { return };
    let mut campaign = Campaign::new(&image, fill);
    let course = campaign.whole();
    campaign.cut_at_instructions(RANDOM_CUTS, &course);
    let instructions = course.instructions;
    campaign.conclude(&format!("power cut at random of {instructions} instructions of a commit with rollover"));
    assert!(campaign.tally.old > 0 && campaign.tally.new > 0, "the cuts lie on both sides of the change");
}

#[test]
fn loop_committed_configuration_survives_a_power_cycle_and_a_new_image() {
    let Some(image) = image("commit") else { return };
    let mut node = Node::new(&image);
    node.start();
    assert_eq!(node.configuration(), Configuration::default());
    let config = Configuration { front_end: FrontEnd::default(), ..with_gear(NEW_TEETH) };
    node.configure(&config);
    node.commit();
    node.cycle_power();
    node.start();
    assert_eq!(node.configuration(), config);
    // A new image is flashed: the program's sectors are erased and written, those of the configuration are not touched.
    let data = (DATA_START - START) as usize;
    let kept = node.board.chip().cells[data..].to_vec();
    let mut flashed = Node::new(&image);
    flashed.board.chip_mut().cells[data..].copy_from_slice(&kept);
    flashed.start();
    assert_eq!(flashed.configuration(), config);
}

#[test]
fn loop_commit_into_a_full_sector_erases_the_other_and_measuring_goes_on() {
    let Some(image) = image("rollover") else { return };
    let mut node = Node::new(&image);
    fill(&mut node);
    node.start();
    node.configure(&with_gear(NEW_TEETH));
    let (before, erased) = (node.board.seconds(), node.board.chip().flash.erased);
    node.commit();
    let stall = node.board.seconds() - before;
    assert_eq!(node.board.chip().flash.erased, erased + 1);
    assert!(stall > 1.0, "the erasure takes its second: {stall} s");
    assert_eq!(node.board.seen().resets.len(), 0, "the watchdog waits");
    // What was sampled meanwhile is lost, and said; afterwards blocks come again.
    node.run(0.3);
    assert!(node.events().any(|event| event.kind == EventKind::BlocksLost));
    let Reply::Statistics(then) = node.ask(&Request::Statistics) else { panic!("no statistics") };
    node.run(0.3);
    let Reply::Statistics(now) = node.ask(&Request::Statistics) else { panic!("no statistics") };
    assert!(now.blocks > then.blocks + 5, "{} and {} blocks", then.blocks, now.blocks);
    assert_eq!(now.blocks_lost, then.blocks_lost);
    node.cycle_power();
    node.start();
    assert_eq!(node.configuration(), with_gear(NEW_TEETH));
    assert!(!node.heard.iter().any(
        |packet| matches!(packet, Packet::Message(Message::Event(e)) if e.kind == EventKind::ConfigurationRefused)
    ));
}

#[test]
fn loop_configuration_stored_by_the_firmware_before_is_kept() {
    let Some(image) = image("former schema") else { return };
    let holding = AlarmHolding { watch_signal: false, ..AlarmHolding::default() };
    let config = Configuration { front_end: FrontEnd::default(), holding, ..with_gear(OLD_TEETH) };
    // Schema 1 is the same without the front end and what came after it: three bytes, six of the alarms' holding,
    // eight of the pass band, one of what is latched, one of the empty list of levels, four of the link, five of the
    // waveforms, one of the second sensor, one of the local levels, 33 of what the ninth layout added, three of the
    // tenth's empty lists, all zero.
    const LATER_BYTES: usize = 3 + 6 + 8 + 1 + 1 + 4 + 5 + 1 + 1 + 33 + 3;
    let mut bytes = stored(&config);
    assert_eq!((bytes[0], &bytes[bytes.len() - LATER_BYTES..]), (SCHEMA as u8, &[0; LATER_BYTES][..]));
    bytes[0] = 1;
    bytes.truncate(bytes.len() - LATER_BYTES);
    let mut node = Node::new(&image);
    put(node.board.chip_mut(), 0, 0, &bytes);
    node.start();
    assert_eq!(node.configuration(), config);
    assert_eq!(node.events().filter(|event| event.kind == EventKind::ConfigurationRefused).count(), 0);
}
