//! What a Modbus master may do beside reading results: acknowledge, take a waveform, read its samples, release it; and
//! in which order its words come.

use super::node_alarms;
use meshband::config::{CaptureConfig, CaptureRate, Configuration, LinkConfig, ModbusOptions, Personality};
use meshband::identity::Identity;
use meshband::message::{Reply, Request};
use meshband::modbus::CRC16;
use meshband::modbus::map::{COMMAND, Kind, REGISTERS, Register, SAMPLE_REGISTERS, SAMPLES};
use meshband::modbus::station::LISTENING_S;
use meshband::node::Block;
use meshband::sample_ring::{BLOCK, BLOCK_BYTES, decode_one};
use meshband::session::Session;
use meshband::units::{Hertz, TicksPerSecond};
use meshband::waveform::{CaptureFacts, PART_BYTES};
use std::f64::consts::TAU;

const CLOCK: u32 = 25_000_000;
const ADDRESS: u8 = 17;
const CODES: usize = 512;
const M_S2_PER_CODE: f64 = 0.002;
const TURN: u64 = (CLOCK / 20) as u64;
/// Most registers of one answer.
const MAX_REGISTERS: u16 = 125;

fn configuration(options: ModbusOptions) -> Configuration {
    Configuration {
        link: LinkConfig { personality: Personality::Modbus, address: ADDRESS, ..LinkConfig::default() },
        capture: CaptureConfig { keep: CaptureRate::Fixed, rate: Hertz(0.0) },
        modbus: options,
        ..node_alarms::configuration()
    }
}

const COMMAND_OPTIONS: ModbusOptions = ModbusOptions { commands: true, low_word_first: false };

/// A station that measures.
struct Bench {
    session: Box<Session>,
    first: u64,
    /// The station's clock, at or behind the samples' own: a request makes no gap in them.
    now: u64,
    edge: u64,
    sequence: u32,
}

impl Bench {
    fn new(options: ModbusOptions) -> Self {
        let session = Session::new(configuration(options), TicksPerSecond(CLOCK), Identity::HOST).expect("sound");
        let mut bench = Self { session: Box::new(session), first: 0, now: 0, edge: 0, sequence: 0 };
        bench.look();
        bench.first = u64::from(CLOCK * LISTENING_S);
        bench.edge = bench.first;
        bench.look();
        bench
    }

    fn look(&mut self) -> Vec<u8> {
        let mut sent = Vec::new();
        self.now = self.now.max(self.first);
        self.session.follow_line(self.now as u32, &mut |answer| sent.extend_from_slice(answer));
        sent
    }

    /// Runs on with a sine of 400 Hz of this amplitude, m/s^2, at 20 turns/s.
    fn run(&mut self, seconds: f64, amplitude: f64) {
        let until = self.first + (seconds * f64::from(CLOCK)) as u64;
        while self.first < until {
            let period = self.session.node().requested_period_ticks();
            let code = |n: u64| {
                let t = (self.first + n * u64::from(period)) as f64 / f64::from(CLOCK);
                (amplitude * (TAU * (400.0 * t).fract()).sin() / M_S2_PER_CODE + 32_768.0) as u16
            };
            let codes: Vec<u16> = (0..CODES as u64).map(code).collect();
            let end = self.first + CODES as u64 * u64::from(period);
            while self.edge < end {
                self.session.on_edge(self.edge as u32);
                self.edge += TURN;
            }
            let (first_tick, sequence) = (self.first as u32, self.sequence);
            let block =
                Block { codes: &codes, second: &[], first_tick, period_ticks: period, sequence, overrun: false };
            self.session.on_block(block, &mut |_| panic!("said without having been asked"));
            (self.first, self.sequence) = (end, self.sequence + 1);
            assert!(self.look().is_empty());
        }
    }

    /// What is answered, without address and checksum.
    fn ask(&mut self, pdu: &[u8]) -> Vec<u8> {
        let mut frame = [&[ADDRESS], pdu].concat();
        frame.extend(CRC16.checksum(&frame).to_le_bytes());
        for &byte in &frame {
            self.session.on_byte(byte, &mut |_| panic!("not by the clock"));
        }
        assert!(self.look().is_empty(), "before the silence");
        self.now += u64::from(CLOCK / 200);
        let sent = self.look();
        let Some((content, checksum)) = sent.split_last_chunk::<2>() else { return Vec::new() };
        assert_eq!((content[0], CRC16.checksum(content).to_le_bytes()), (ADDRESS, *checksum));
        content[1..].to_vec()
    }

    fn read(&mut self, first: u16, count: u16) -> Vec<u8> {
        let ([a, b], [c, d]) = (first.to_be_bytes(), count.to_be_bytes());
        let answer = self.ask(&[4, a, b, c, d]);
        assert_eq!(answer[..2], [4, (2 * count) as u8], "{first}, {count}");
        answer[2..].to_vec()
    }

    fn word(&mut self, group: &str, name: &str) -> u16 {
        let bytes = self.read(row(group, name).address, 1);
        u16::from_be_bytes(bytes.try_into().expect("two bytes"))
    }

    fn float(&mut self, group: &str, name: &str) -> f32 {
        let bytes = self.read(row(group, name).address, 2);
        f32::from_be_bytes(bytes.try_into().expect("four bytes"))
    }

    fn write(&mut self, value: u16) -> Vec<u8> {
        let ([a, b], [c, d]) = (COMMAND.to_be_bytes(), value.to_be_bytes());
        self.ask(&[6, a, b, c, d])
    }

    /// The waveform as the link gives it.
    fn by_link(&mut self) -> (CaptureFacts, Vec<f32>) {
        let node = self.session.node_mut();
        let head = *node.held_waveform().expect("held");
        let mut bytes = Vec::new();
        for offset in (0..head.bytes).step_by(PART_BYTES) {
            let request = Request::ReadCapture { number: head.facts.number, offset };
            let Reply::CapturePart(part) = node.on_request(request) else { panic!("a part") };
            bytes.extend_from_slice(&part.bytes);
        }
        let coded = bytes[4 * usize::from(head.facts.marks)..].chunks_exact(BLOCK_BYTES);
        let samples = coded.flat_map(|block| {
            let block = block.try_into().expect("a block");
            (0..BLOCK).map(move |place| decode_one(block, place) as f32 * head.facts.scale)
        });
        (head.facts, samples.collect())
    }
}

fn row(group: &str, name: &str) -> &'static Register {
    REGISTERS.iter().find(|row| (row.group, row.name) == (group, name)).expect("a row")
}

#[test]
fn fault_nothing_can_be_written_without_permission() {
    let mut bench = Bench::new(ModbusOptions::default());
    let [a, b] = COMMAND.to_be_bytes();
    assert_eq!(bench.write(1), [0x86, 1]);
    assert_eq!(bench.ask(&[16, a, b, 0, 1, 2, 0, 1]), [0x90, 1]);
}

#[test]
fn theory_a_permitted_master_acknowledges_by_either_function() {
    let [a, b] = COMMAND.to_be_bytes();
    let by_six = [6, a, b, 0, 1];
    let by_sixteen = [16, a, b, 0, 1, 2, 0, 1];
    for (request, echo) in [(&by_six[..], &by_six[..]), (&by_sixteen[..], &[16, a, b, 0, 1][..])] {
        let mut bench = Bench::new(COMMAND_OPTIONS);
        bench.run(4.0, 12.0);
        assert_eq!(bench.word("alarms", "unseen"), 1);
        bench.run(4.0, 3.0);
        assert_eq!((bench.word("alarms", "raised"), bench.word("alarms", "standing")), (0, 1), "latched");
        bench.session.take_commit();
        assert_eq!(bench.ask(request), echo);
        assert_eq!((bench.word("alarms", "unseen"), bench.word("alarms", "standing")), (0, 0));
        assert!(bench.session.take_commit(), "the latch is stored");
    }
}

#[test]
fn fault_a_write_of_anything_else_is_refused_as_the_standard_says() {
    let mut bench = Bench::new(COMMAND_OPTIONS);
    let [a, b] = COMMAND.to_be_bytes();
    let nothing: &[u8] = &[];
    for (request, answer) in [
        (&[6, 0, 0, 0, 1][..], &[0x86, 2][..]),
        (&[6, a, b, 0, 0], &[0x86, 3]),
        (&[6, a, b, 0, 4], &[0x86, 3]),
        (&[16, a, b, 0, 2, 4, 0, 1, 0, 1], &[0x90, 2]),
        (&[16, a, b, 0, 0, 0], &[0x90, 3]),
        (&[16, a, b, 0, 1, 4, 0, 1, 0, 1], &[0x90, 3]),
        (&[16, 0, 0, 0, 1, 2, 0, 1], &[0x90, 2]),
        (&[5, a, b, 0xff, 0], &[0x85, 1]),
        // No request at all: other lengths than they say.
        (&[6, a, b, 0, 1, 0], nothing),
        (&[16, a, b, 0, 1, 2, 0], nothing),
        (&[16, a, b, 0, 1, 2, 0, 1, 0], nothing),
    ] {
        assert_eq!(bench.ask(request), answer, "{request:?}");
    }
    let refused = bench.word("counters", "line_exceptions");
    assert_eq!(refused, 8);
}

/// A write is never found by chance at the end of what others said.
#[test]
fn fault_a_write_behind_another_frame_is_damage() {
    let mut bench = Bench::new(COMMAND_OPTIONS);
    bench.run(4.0, 12.0);
    let mut frame = vec![ADDRESS, 6];
    frame.extend([COMMAND.to_be_bytes(), 1_u16.to_be_bytes()].concat());
    frame.extend(CRC16.checksum(&frame).to_le_bytes());
    let merged = [&[3, 4, 0, 0, 0, 1][..], &frame].concat();
    for &byte in &merged {
        bench.session.on_byte(byte, &mut |_| panic!("not by the clock"));
    }
    bench.look();
    bench.now += u64::from(CLOCK / 200);
    assert!(bench.look().is_empty());
    assert_eq!((bench.word("alarms", "unseen"), bench.word("counters", "line_damaged")), (1, 1));
}

#[test]
fn ref_a_waveform_by_registers_is_that_of_the_link() {
    let mut bench = Bench::new(COMMAND_OPTIONS);
    assert!(bench.read(SAMPLES, 4).chunks(4).all(|b| f32::from_be_bytes([b[0], b[1], b[2], b[3]]).is_nan()));
    bench.run(4.0, 3.0);
    assert_eq!((bench.word("waveform", "phase"), bench.write(2).len()), (1, 5));
    bench.run(2.0, 3.0);
    let (facts, samples) = bench.by_link();
    assert_eq!(bench.word("waveform", "phase"), 4);
    assert_eq!(u32::from(SAMPLE_REGISTERS), 2 * facts.samples);
    let mut read = Vec::new();
    let mut next = SAMPLES;
    let end = SAMPLES + SAMPLE_REGISTERS;
    while next < end {
        // Odd counts on purpose: a value may be read by halves.
        let count = MAX_REGISTERS.min(end - next);
        read.extend(bench.read(next, count));
        next += count;
    }
    let read: Vec<f32> = read.chunks(4).map(|b| f32::from_be_bytes([b[0], b[1], b[2], b[3]])).collect();
    assert_eq!(read, samples);
    let [a, b] = (end - 1).to_be_bytes();
    assert_eq!(bench.ask(&[4, a, b, 0, 2]), [0x84, 2], "beyond the end");
    let rate = bench.float("waveform", "rate");
    let before = f64::from(bench.float("waveform", "before"));
    assert_eq!(rate, facts.ticks_per_second as f32 / facts.period_ticks as f32);
    let whole = f64::from(facts.samples) / f64::from(rate);
    assert!((before / whole - 0.75).abs() < 0.01, "a quarter follows: {before} of {whole}");
    assert_eq!(bench.write(3).len(), 5);
    assert_eq!(bench.word("waveform", "phase"), 1);
    assert!(bench.read(SAMPLES, 2).iter().copied().eq(f32::NAN.to_be_bytes()));
}

#[test]
fn ref_the_strongest_line_is_the_sine_that_is_there() {
    let mut bench = Bench::new(ModbusOptions::default());
    bench.run(4.0, 3.0);
    assert!(bench.word("strongest lines", "count") >= 1);
    let frequency = bench.float("strongest lines", "line_1_frequency");
    let amplitude = bench.float("strongest lines", "line_1_amplitude");
    assert!((frequency - 400.0).abs() < 2.0 && (amplitude / 3.0 - 1.0).abs() < 0.02, "{frequency} Hz, {amplitude}");
    assert!((bench.float("strongest lines", "rms") / (3.0 / 2f32.sqrt()) - 1.0).abs() < 0.02);
}

#[test]
fn theory_the_low_word_comes_first_where_it_is_asked_for_and_nothing_else_changes() {
    let mut by_order = [false, true].map(|low_word_first| {
        let mut bench = Bench::new(ModbusOptions { low_word_first, ..COMMAND_OPTIONS });
        bench.run(4.0, 3.0);
        bench.write(2);
        bench.run(2.0, 3.0);
        bench
    });
    let sample = Register { address: SAMPLES, kind: Kind::Float, ..*row("values", "rms") };
    // The counters of requests move with the requests themselves.
    for row in REGISTERS.iter().filter(|row| row.group != "counters").chain([&sample]) {
        let [high, low] = [0, 1].map(|n| by_order[n].read(row.address, row.kind.registers()));
        match row.kind {
            Kind::Word => assert_eq!(high, low, "{row:?}"),
            Kind::Long | Kind::Float => assert_eq!([&high[2..], &high[..2]].concat(), low, "{row:?}"),
        }
    }
}
