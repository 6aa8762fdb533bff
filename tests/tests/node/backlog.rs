//! A main loop that falls behind: the queues between interrupts and main loop, with time as a number.
//!
//! A model of the node's work drives the real queues: so much per block, and a long turn at the end of each record. A
//! gap restarts the record, as it does in the node.

use meshband::config::Configuration;
use meshband::message::Message;
use meshband::node::{Block, Node};
use meshband::pipeline::{BLOCK_SAMPLES, Channels, Inbox, Outlets, Queues};
use meshband::units::TicksPerSecond;

/// Buffers of the board that is modelled.
const BUFFERS: usize = 16;
/// Buffers that the interrupt holds: the two of the double buffer.
const HELD_BUFFERS: u32 = 2;
/// Blocks in a record, and between the beginnings of two where nothing is lost.
const RECORD: u32 = 8;
const RECORD_PERIOD: u32 = 600;

/// Interrupts on one side, a main loop on the other; time in thousandths of a block.
struct Loaded {
    outlets: Outlets,
    inbox: Inbox,
    /// Blocks sampled, handed over, and lost as their sequence tells.
    sampled: u32,
    taken: u32,
    lost: u32,
    expected: u32,
    given_up: u32,
    now: u64,
    /// Blocks of the running record so far, and until the next one.
    in_record: u32,
    pause: u32,
    records: u32,
}

impl Loaded {
    fn new() -> Self {
        let buffers = Box::leak(Box::new([[0; BLOCK_SAMPLES]; BUFFERS]));
        let (mut outlets, inbox) = Box::leak(Box::new(Queues::new())).split(buffers);
        for _ in 0..HELD_BUFFERS {
            // What the interrupt holds is exchanged, never given back.
            assert!(outlets.free.take().is_some());
        }
        let (sampled, taken, lost, expected, given_up) = (0, 0, 0, 0, 0);
        Self { outlets, inbox, sampled, taken, lost, expected, given_up, now: 0, in_record: 0, pause: 0, records: 0 }
    }

    /// Time passes for the main loop; the interrupts go on meanwhile.
    fn spend(&mut self, thousandths: u64) {
        self.now += thousandths;
        while u64::from(self.sampled) * 1_000 + 1_000 <= self.now {
            let sequence = self.sampled;
            self.sampled += 1;
            if let Some(codes) = self.outlets.free.take() {
                let filled = filled(codes, sequence);
                assert!(self.outlets.blocks.enqueue(filled).is_ok());
            }
        }
    }

    /// One turn of the main loop: `each` per block, `record` more at the end of a record.
    fn turn(&mut self, each: u64, record: u64) {
        self.given_up += self.inbox.catch_up();
        let mut sequence = None;
        self.inbox.with_block(|block| sequence = Some(Block { ..block.as_block() }.sequence));
        let Some(sequence) = sequence else { return self.spend(100) };
        let gap = sequence - self.expected;
        self.expected = sequence + 1;
        self.taken += 1;
        self.lost += gap;
        if gap > 0 {
            (self.in_record, self.pause) = (0, 0);
        }
        self.spend(each);
        if self.pause > 0 {
            self.pause -= 1;
            return;
        }
        self.in_record += 1;
        if self.in_record == RECORD {
            (self.in_record, self.pause) = (0, RECORD_PERIOD - RECORD);
            self.records += 1;
            self.spend(record);
        }
    }

    fn run(&mut self, blocks: u32, each: u64, record: u64) {
        let end = self.now + u64::from(blocks) * 1_000;
        while self.now < end {
            self.turn(each, record);
        }
    }
}

fn filled(codes: &'static mut [u16; BLOCK_SAMPLES], sequence: u32) -> meshband::pipeline::Filled {
    meshband::pipeline::Filled {
        codes,
        channels: Channels::One,
        first_tick: sequence,
        period_ticks: 1,
        sequence,
        overrun: false,
    }
}

#[test]
fn fault_a_loop_that_fell_behind_once_recovers_although_a_gap_costs_a_long_turn() {
    // 75 % of the time per block and a turn of 12 blocks fit well where nothing disturbs.
    let mut loaded = Loaded::new();
    loaded.run(5_000, 750, 12_000);
    assert_eq!(loaded.lost, 0);
    // Something holds the main loop for 25 blocks.
    loaded.spend(25_000);
    loaded.run(200, 750, 12_000);
    let (lost, records) = (loaded.lost, loaded.records);
    assert!((11..=40).contains(&lost), "{lost} blocks lost by the disturbance");
    loaded.run(20_000, 750, 12_000);
    assert_eq!(loaded.lost - lost, 0, "losses sustain themselves: {} records meanwhile", loaded.records - records);
    assert!(loaded.records - records > 30);
    assert!(loaded.sampled - loaded.taken - loaded.lost <= BUFFERS as u32, "every block taken, lost or waiting");
    assert!(loaded.given_up > 0 && loaded.given_up < lost, "what waited was given up, and counted in the gap");
}

#[test]
fn fault_a_loop_too_slow_for_ever_loses_whole_stretches_and_goes_on_between_them() {
    let mut loaded = Loaded::new();
    loaded.run(50_000, 1_500, 3_000);
    // A third is lost, in long gaps: records complete between them.
    let share = f64::from(loaded.lost) / f64::from(loaded.sampled);
    assert!((0.25..0.5).contains(&share), "{share}");
    assert!(loaded.records > 1_000, "{} records", loaded.records);
}

#[test]
fn theory_nothing_is_given_up_while_buffers_last() {
    let mut loaded = Loaded::new();
    for _ in 0..1_000 {
        // As long as the queue can bear, then time to catch up.
        loaded.spend(u64::from(BUFFERS as u32 - HELD_BUFFERS) * 1_000 - 200);
        loaded.run(80, 500, 500);
    }
    assert_eq!((loaded.lost, loaded.given_up), (0, 0));
}

#[test]
fn fault_lost_blocks_do_not_bring_the_costly_wideband_records_closer_together() {
    // Their search is the longest turn there is: begun anew after each loss it would cause the next one.
    const CLOCK: u32 = 25_000_000;
    const SECONDS: u32 = 6;
    let mut node = Box::new(Node::new(Configuration::default(), TicksPerSecond(CLOCK)).expect("a sound configuration"));
    let codes: Vec<u16> =
        (0..BLOCK_SAMPLES as u32).map(|n| 32_768 + (n.wrapping_mul(2_654_435_761) >> 22) as u16).collect();
    let (mut first_tick, mut sequence, mut records) = (0u32, 0u32, 0u32);
    while first_tick < SECONDS * CLOCK {
        let period_ticks = node.requested_period_ticks();
        node.on_block(Block { codes: &codes, second: &[], first_tick, period_ticks, sequence, overrun: false });
        let length = period_ticks * BLOCK_SAMPLES as u32;
        while let Some(message) = node.poll(first_tick + length) {
            records += u32::from(matches!(message, Message::Peaks(_)));
        }
        // Of every twenty blocks one is lost.
        let passed = if sequence % 20 == 18 { 2 } else { 1 };
        (sequence, first_tick) = (sequence + passed, first_tick + passed * length);
    }
    assert!(node.statistics().blocks_lost > 100);
    assert!((2..=SECONDS + 1).contains(&records), "{records} records in {SECONDS} s");
}
