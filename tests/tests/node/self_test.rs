//! The self-test judges what the inputs show: nothing on a standing machine, nothing while a sensor settles, and
//! never for good.

use meshband::config::Configuration;
use meshband::events::EventKind;
use meshband::frame::{Decoder, Packet};
use meshband::identity::Identity;
use meshband::message::{Message, Reply, Request, SelfTest};
use meshband::node::Block;
use meshband::self_test::{
    BLOCKS, MATHEMATICS, MATHEMATICS_HASH, MAX_WAITING_BLOCKS, NOISE, RAILS, SAMPLE_COUNT, SETTLING_S, SelfTestRun,
    TACH, mathematics,
};
use meshband::session::Session;
use meshband::stream::WIDE_POINTS;
use meshband::units::TicksPerSecond;

const CLOCK: TicksPerSecond = TicksPerSecond(25_000_000);
const PERIOD: u32 = 250;
const SAMPLES: usize = 512;
/// Blocks of 5.12 ms in a second.
const PER_SECOND: u32 = CLOCK.0 / (PERIOD * SAMPLES as u32);
const CHAIN: u8 = SAMPLE_COUNT | RAILS | NOISE | MATHEMATICS;

/// Feeds a test with blocks of one kind of codes.
struct Bench {
    test: SelfTestRun,
    sequence: u32,
    arrived: u32,
    /// Clock ticks between two arrivals, over those the samples stand for, per cent.
    pace: u32,
}

impl Bench {
    fn new(test: SelfTestRun) -> Self {
        Self { test, sequence: 0, arrived: 1000, pace: 100 }
    }

    fn blocks(&mut self, count: u32, code: impl Fn(usize) -> u16) -> Vec<SelfTest> {
        let codes: Vec<u16> = (0..SAMPLES).map(code).collect();
        let mut results = Vec::new();
        for _ in 0..count {
            let length = PERIOD * SAMPLES as u32;
            let first_tick = self.sequence.wrapping_mul(length);
            let block = Block {
                codes: &codes,
                second: &[],
                first_tick,
                period_ticks: PERIOD,
                sequence: self.sequence,
                overrun: false,
            };
            self.arrived = self.arrived.wrapping_add(length / 100 * self.pace);
            results.extend(self.test.on_block(&block, self.arrived));
            self.sequence += 1;
        }
        results
    }
}

fn moving(n: usize) -> u16 {
    32_000 + (n % 7) as u16
}

#[test]
fn regress_a_standing_machine_is_no_failed_self_test() {
    let mut bench = Bench::new(SelfTestRun::at_start(CLOCK, true));
    let results = bench.blocks(60 * PER_SECOND, moving);
    assert_eq!(results, [SelfTest { run: CHAIN, failed: 0 }], "a minute without an edge");
    bench.test.on_edge();
    assert_eq!(bench.blocks(1, moving), [SelfTest { run: CHAIN | TACH, failed: 0 }], "the first edge completes it");
}

#[test]
fn regress_a_settling_sensor_is_no_failed_self_test() {
    let mut bench = Bench::new(SelfTestRun::at_start(CLOCK, true));
    let settling = SETTLING_S as u32 * PER_SECOND - 2 * BLOCKS;
    let results = bench.blocks(settling, |_| u16::MAX);
    assert_eq!(results, [SelfTest { run: SAMPLE_COUNT | MATHEMATICS, failed: 0 }]);
    let results = bench.blocks(2 * BLOCKS, moving);
    assert_eq!(results.last(), Some(&SelfTest { run: CHAIN, failed: 0 }));
}

#[test]
fn regress_a_failed_item_passes_once_the_fault_is_gone() {
    let mut bench = Bench::new(SelfTestRun::at_start(CLOCK, true));
    let results = bench.blocks(2 * SETTLING_S as u32 * PER_SECOND, |_| 0);
    assert_eq!(results.last(), Some(&SelfTest { run: CHAIN, failed: RAILS | NOISE }), "at its rail for good");
    assert_eq!(bench.blocks(4 * BLOCKS, |_| 7000).last(), Some(&SelfTest { run: CHAIN, failed: NOISE }), "stuck");
    assert_eq!(bench.blocks(4 * BLOCKS, moving).last(), Some(&SelfTest { run: CHAIN, failed: 0 }));
}

#[test]
fn fault_a_converter_that_does_not_follow_its_timer_fails_until_it_does() {
    let mut bench = Bench::new(SelfTestRun::at_start(CLOCK, true));
    bench.pace = 150;
    let failed = SelfTest { run: CHAIN, failed: SAMPLE_COUNT };
    // Every block is late: the stretch waits for one that is not as long as it may.
    let longest = BLOCKS + MAX_WAITING_BLOCKS;
    assert_eq!(bench.blocks(longest, moving), [failed]);
    bench.pace = 100;
    assert_eq!(bench.blocks(2 * longest, moving).last(), Some(&SelfTest { run: CHAIN, failed: 0 }));
}

#[test]
fn regress_blocks_that_waited_for_the_mathematics_fail_no_sample_count() {
    let mut test = SelfTestRun::again(true);
    let (length, codes) = (PERIOD * SAMPLES as u32, (0..SAMPLES).map(moving).collect::<Vec<u16>>());
    // Six blocks wait at first; the processor takes three in the time of one.
    let mut free = 7 * length;
    let mut results = Vec::new();
    for sequence in 0..4 * BLOCKS {
        let first_tick = sequence * length;
        let block = Block { codes: &codes, second: &[], first_tick, period_ticks: PERIOD, sequence, overrun: false };
        let arrived = free.max(block.end_tick());
        free = arrived + length / 3;
        results.extend(test.on_block(&block, arrived));
    }
    assert_eq!(results, [SelfTest { run: CHAIN, failed: 0 }]);
}

#[test]
fn golden_the_signal_chain_gives_the_recorded_hash() {
    let mut work = Box::new([f32::NAN; WIDE_POINTS]);
    assert_eq!(mathematics(&mut work), MATHEMATICS_HASH, "{:#010x}", mathematics(&mut work));
}

/// A session fed with blocks of moving codes.
struct Run {
    session: Session,
    sequence: u32,
    decoder: Decoder,
    packets: Vec<Packet>,
}

impl Run {
    fn new() -> Self {
        let session = Session::new(Configuration::default(), CLOCK, Identity::HOST).expect("valid");
        Self { session, sequence: 0, decoder: Decoder::new(), packets: Vec::new() }
    }

    fn blocks(&mut self, count: u32, code: impl Fn(usize) -> u16) {
        let codes: Vec<u16> = (0..SAMPLES).map(code).collect();
        for _ in 0..count {
            let first_tick = self.sequence.wrapping_mul(PERIOD * SAMPLES as u32);
            let block = Block {
                codes: &codes,
                second: &[],
                first_tick,
                period_ticks: PERIOD,
                sequence: self.sequence,
                overrun: false,
            };
            self.sequence += 1;
            let Self { decoder, packets, .. } = self;
            self.session.on_block(block, &mut |frame| {
                packets.extend(frame.iter().filter_map(|&b| decoder.push(b)).map(|f| f.expect("intact").packet));
            });
        }
    }

    fn request(&mut self, request: Request) -> Reply {
        let mut bytes = Vec::new();
        self.session.on_request(request, &mut |frame| bytes.extend_from_slice(frame));
        let frame = bytes.iter().find_map(|&byte| self.decoder.push(byte)).expect("an answer").expect("intact");
        let Packet::Reply(reply) = frame.packet else { panic!("no reply") };
        reply
    }

    fn take_results(&mut self) -> Vec<SelfTest> {
        let packets = std::mem::take(&mut self.packets);
        packets
            .into_iter()
            .filter_map(|p| if let Packet::Message(Message::SelfTest(r)) = p { Some(r) } else { None })
            .collect()
    }
}

#[test]
fn regress_a_request_runs_the_self_test_and_its_result_is_reported() {
    let mut run = Run::new();
    run.blocks(2 * BLOCKS, moving);
    let passed = SelfTest { run: CHAIN, failed: 0 };
    assert_eq!(run.take_results(), [passed], "the one at the start is reported, too");
    // The converter sticks meanwhile: only a new test can tell.
    let begun = Reply::SelfTest(SelfTest { run: MATHEMATICS, failed: 0 });
    assert_eq!(run.request(Request::SelfTest), begun, "what is known at once");
    run.blocks(2 * BLOCKS, |_| 7000);
    let failed = SelfTest { run: CHAIN, failed: NOISE };
    assert_eq!(run.request(Request::SelfTest), Reply::SelfTest(failed), "within a second it is the same test");
    run.blocks(2 * PER_SECOND, |_| 7000);
    assert_eq!(run.take_results(), [failed]);
    assert_eq!(
        (run.session.node().self_test(), run.session.node().statistics().count(EventKind::SelfTestFailed)),
        (failed, 1)
    );
    assert_eq!(run.request(Request::SelfTest), begun);
    run.blocks(2 * BLOCKS, moving);
    assert_eq!(run.take_results(), [passed]);
}

#[test]
fn regress_a_rail_code_without_noise_is_two_events_and_leaves_the_history() {
    let mut run = Run::new();
    run.blocks(PER_SECOND, moving);
    run.session.node_mut().note(EventKind::AlarmRaised, 3);
    run.blocks(60 * PER_SECOND, |_| u16::MAX);
    let statistics = run.session.node().statistics();
    let blocks = 60 * PER_SECOND;
    assert_eq!((statistics.count(EventKind::Saturated), statistics.count(EventKind::Stuck)), (blocks, blocks));
    let of = |kind| {
        let events =
            run.packets.iter().filter(move |p| matches!(p, Packet::Message(Message::Event(e)) if e.kind == kind));
        events.count()
    };
    assert_eq!((of(EventKind::Saturated), of(EventKind::Stuck), of(EventKind::AlarmRaised)), (1, 1, 1), "in a minute");
    run.packets.clear();
    assert_eq!(run.request(Request::Events), Reply::Done);
    run.blocks(PER_SECOND, moving);
    let Some(alarm) = run.packets.iter().find_map(|p| match p {
        Packet::Message(Message::Event(e)) if e.kind == EventKind::AlarmRaised => Some(e),
        _ => None,
    }) else {
        panic!("the history is gone")
    };
    assert_eq!((alarm.detail, alarm.count), (3, 1));
    let stuck = run.packets.iter().find_map(|p| match p {
        Packet::Message(Message::Event(e)) if e.kind == EventKind::Stuck => Some(e.count),
        _ => None,
    });
    assert_eq!(stuck, Some(blocks), "count and latest time go on in one entry");
}
