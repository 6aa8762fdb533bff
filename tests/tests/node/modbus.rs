//! Modbus on the node's code alone: every function and limit, silences, damage, echoes, any bytes at any time. The
//! released image against an independent master is in `emulator/tests/flashed/modbus`.

use meshband::config::{ADDRESSES, Configuration, ConfigurationError, LineFormat, LinkConfig, Parity, Personality};
use meshband::frame::{MAX_FRAME, encode};
use meshband::identity::Identity;
use meshband::message::Request;
use meshband::modbus::map::{BITS, COMMAND, INPUTS, REGISTERS, Register, SAMPLE_REGISTERS, SAMPLES};
use meshband::modbus::station::LISTENING_S;
use meshband::modbus::{CRC16, MAP_VERSION};
use meshband::session::Session;
use meshband::units::TicksPerSecond;
use proptest::prelude::*;

const CLOCK: u32 = 84_000_000;
const ADDRESS: u8 = 17;
const NOTHING: [u8; 0] = [];
/// A look every millisecond, as a busy main loop has it.
const LOOK: u32 = CLOCK / 1000;

fn link() -> LinkConfig {
    LinkConfig { personality: Personality::Modbus, address: ADDRESS, ..LinkConfig::default() }
}

/// A station and its clock.
struct Bench {
    session: Session,
    now: u32,
    sent: Vec<u8>,
}

impl Bench {
    /// Just started, near the end of the clock's range.
    fn fresh(link: LinkConfig) -> Self {
        let config = Configuration { link, ..Configuration::default() };
        let session = Session::new(config, TicksPerSecond(CLOCK), Identity::HOST).expect("sound");
        Self { session, now: u32::MAX - CLOCK, sent: Vec::new() }
    }

    /// That speaks Modbus.
    fn new(link: LinkConfig) -> Self {
        let mut bench = Self::fresh(link);
        bench.pass(1000 * LISTENING_S + 1);
        assert_eq!(bench.session.line_format(), LineFormat::of_modbus(&link));
        bench
    }

    /// So many milliseconds.
    fn pass(&mut self, milliseconds: u32) {
        for _ in 0..milliseconds {
            self.look(LOOK);
        }
    }

    fn look(&mut self, ticks: u32) {
        self.now = self.now.wrapping_add(ticks);
        let Self { session, now, sent } = self;
        session.follow_line(*now, &mut |answer| sent.extend_from_slice(answer));
    }

    /// Bytes that have come since the last look.
    fn hear(&mut self, bytes: &[u8]) {
        let Self { session, sent, .. } = self;
        for &byte in bytes {
            session.on_byte(byte, &mut |answer| sent.extend_from_slice(answer));
        }
    }

    /// What is answered to a frame with silence round it, without address and checksum.
    fn ask(&mut self, pdu: &[u8]) -> Vec<u8> {
        self.hear(&sealed(ADDRESS, pdu));
        self.pass(10);
        let sent = std::mem::take(&mut self.sent);
        let Some((content, checksum)) = sent.split_last_chunk::<2>() else { return Vec::new() };
        assert_eq!((content[0], CRC16.checksum(content).to_le_bytes()), (ADDRESS, *checksum));
        content[1..].to_vec()
    }

    fn read(&mut self, function: u8, first: u16, count: u16) -> Vec<u8> {
        let ([a, b], [c, d]) = (first.to_be_bytes(), count.to_be_bytes());
        self.ask(&[function, a, b, c, d])
    }
}

fn sealed(address: u8, pdu: &[u8]) -> Vec<u8> {
    let mut frame = vec![address];
    frame.extend(pdu);
    frame.extend(CRC16.checksum(&frame).to_le_bytes());
    frame
}

/// The standard's own example of a checksum (serial line V1.02, 6.2.2): 02 07 gives 41 12 on the line.
#[test]
fn golden_checksum_is_the_standards() {
    assert_eq!(CRC16.checksum(&[2, 7]).to_le_bytes(), [0x41, 0x12]);
}

#[test]
fn theory_the_maps_groups_are_dense_and_in_order() {
    for pair in REGISTERS.windows(2) {
        let end = pair[0].address + pair[0].kind.registers();
        let same = pair[0].group == pair[1].group;
        assert!(if same { pair[1].address == end } else { pair[1].address >= end }, "{pair:?}");
        assert!(same || pair[1].address % 4 == 0, "{pair:?}");
    }
    let mut names: Vec<_> = REGISTERS.iter().map(|row| (row.group, row.name)).collect();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), REGISTERS.len(), "two rows of a group have one name");
    let mut next = 0;
    for input in INPUTS {
        assert_eq!(u32::from(input.address), next);
        next += u32::from(input.count);
    }
    assert_eq!(next, BITS);
}

#[test]
fn theory_every_register_is_read_alone_and_no_other_is() {
    let mut bench = Bench::new(link());
    let samples = SAMPLES..SAMPLES + SAMPLE_REGISTERS;
    let known = |address: u16| {
        let within = |row: &Register| (row.address..row.address + row.kind.registers()).contains(&address);
        samples.contains(&address) || REGISTERS.iter().any(within)
    };
    let edges = [COMMAND - 1, COMMAND, COMMAND + 1, SAMPLES - 1, SAMPLES, samples.end - 1, samples.end, 0xffff];
    for address in (0..700).chain(edges) {
        let (answer, by_holding) = (bench.read(4, address, 1), bench.read(3, address, 1));
        assert_eq!((by_holding[0], by_holding.len()), (answer[0] - 1, answer.len()));
        // Counters of the requests themselves move.
        assert!((352..373).contains(&address) || by_holding[1..] == answer[1..], "{address}");
        match answer[..] {
            [4, 2, _, _] => assert!(known(address), "{address}"),
            [0x84, 2] => assert!(!known(address), "{address}"),
            _ => panic!("{address}: {answer:?}"),
        }
    }
    assert_eq!(bench.read(4, 0, 1), [4, 2, 0, MAP_VERSION as u8]);
}

#[test]
fn theory_every_function_code_is_answered_as_the_standard_says() {
    let mut bench = Bench::new(link());
    for function in 0..=255u8 {
        let answer = bench.read(function, 0, 1);
        match function {
            2 => assert_eq!(answer, [2, 1, 0]),
            3 | 4 => assert_eq!(answer, [function, 2, 0, MAP_VERSION as u8]),
            0 | 128.. => assert_eq!(answer, NOTHING, "no request"),
            _ => assert_eq!(answer, [function | 0x80, 1]),
        }
    }
    // Of any length: the checksum says where it ends.
    for length in 0..=250 {
        let mut pdu = vec![16];
        pdu.resize(1 + length, 0x5a);
        assert_eq!(bench.ask(&pdu), [0x90, 1], "{length}");
    }
}

#[test]
fn theory_quantities_at_their_limits() {
    let mut bench = Bench::new(link());
    for (function, count, answer) in [
        (4, 0, vec![0x84, 3]),
        (4, 126, vec![0x84, 3]),
        (4, u16::MAX, vec![0x84, 3]),
        (4, 125, vec![0x84, 2]),
        (3, 0, vec![0x83, 3]),
        (2, 0, vec![0x82, 3]),
        (2, 2001, vec![0x82, 3]),
        (2, 2000, vec![0x82, 2]),
        (2, 30, vec![2, 4, 0, 0, 0, 0]),
        (2, 31, vec![0x82, 2]),
    ] {
        assert_eq!(bench.read(function, 0, count), answer, "function {function}, {count}");
    }
    // A read of another length is not answered.
    assert_eq!(bench.ask(&[4, 0, 0, 0]), NOTHING);
    assert_eq!(bench.ask(&[4, 0, 0, 0, 1, 0]), NOTHING);
}

#[test]
fn theory_what_does_not_exist_yet_is_not_a_number_and_very_old() {
    let mut bench = Bench::new(link());
    for row in REGISTERS.iter().filter(|row| row.name == "age") {
        assert_eq!(bench.read(4, row.address, 1)[2..], [0xff, 0xff], "{row:?}");
    }
    let rms = REGISTERS.iter().find(|row| (row.group, row.name) == ("values", "rms")).expect("a row");
    let answer = bench.read(4, rms.address, 2);
    assert!(f32::from_be_bytes(answer[2..].try_into().expect("four bytes")).is_nan());
}

#[test]
fn fault_other_addresses_broadcasts_and_damage_are_silent_and_counted() {
    let mut bench = Bench::new(link());
    let read = [4, 0, 0, 0, 1];
    let mut damaged = sealed(ADDRESS, &read);
    damaged[2] ^= 0x10;
    for silent in [sealed(0, &read), sealed(ADDRESS + 1, &read), damaged, vec![ADDRESS], vec![0xff; 700]] {
        bench.hear(&silent);
        bench.pass(10);
        assert_eq!(bench.sent, NOTHING);
    }
    let counted = |name: &str| {
        let row = REGISTERS.iter().find(|row| (row.group, row.name) == ("counters", name)).expect("a row");
        bench.read(4, row.address, 1)[3]
    };
    assert_eq!(["line_broadcasts", "line_others", "line_damaged", "line_late"].map(counted), [1, 1, 3, 0]);
}

#[test]
fn theory_a_frame_ends_with_its_silence_and_no_sooner() {
    for (bits_per_second, parity, silence_us) in [
        (0, Parity::Even, 3.5 * 11.0 / 0.0192),
        (9600, Parity::NoneOneStop, 3.5 * 10.0 / 0.0096),
        (115_200, Parity::NoneTwoStop, 1750.0),
    ] {
        let link = LinkConfig { bits_per_second, parity, ..link() };
        let mut bench = Bench::new(link);
        let ticks = |us: f64| (us * f64::from(CLOCK) / 1e6) as u32;
        let request = sealed(ADDRESS, &[4, 0, 0, 0, 1]);
        let character = f64::from(parity.bits()) * 1e6 / f64::from(link.rate());
        // In two parts with just less than a silence in between: one frame still.
        bench.hear(&request[..3]);
        bench.look(10);
        bench.look(ticks(silence_us - 1.0));
        bench.hear(&request[3..]);
        bench.look(10);
        bench.look(ticks(silence_us - 1.0));
        assert_eq!(bench.sent, NOTHING);
        bench.look(ticks(character + 2.0));
        assert_eq!(bench.sent.len(), 7, "{bits_per_second}");
        // With a silence in between: two pieces of rubbish.
        bench.sent.clear();
        bench.hear(&request[..3]);
        bench.pass(10);
        bench.hear(&request[3..]);
        bench.pass(10);
        assert_eq!(bench.sent, NOTHING);
    }
}

#[test]
fn theory_a_request_behind_what_others_said_is_found_and_one_found_late_is_not_answered() {
    let mut bench = Bench::new(link());
    let request = sealed(ADDRESS, &[4, 0, 0, 0, 1]);
    for before in [sealed(3, &[4, 0, 0, 0, 9]), vec![0; 249], vec![0; 255], vec![1; 300], request.clone()] {
        bench.hear(&before);
        bench.hear(&request);
        bench.pass(10);
        assert_eq!(std::mem::take(&mut bench.sent).len(), 7, "{} bytes before", before.len());
    }
    // The main loop stood for an erasure of the flash.
    bench.hear(&request);
    bench.look(CLOCK / 9);
    bench.pass(10);
    assert_eq!(bench.sent, NOTHING);
    assert_eq!(bench.read(4, 0, 1).len(), 4, "the next one is answered");
}

#[test]
fn fault_a_line_that_gives_back_what_is_sent_is_no_conversation() {
    let mut bench = Bench::new(link());
    // 24 bits: an answer as long as a request.
    for pdu in [[2, 0, 0, 0, 24], [4, 0, 0, 0, 2], [1, 0, 0, 0, 1], [4, 255, 255, 0, 1]] {
        bench.hear(&sealed(ADDRESS, &pdu));
        bench.pass(10);
        let echo = std::mem::take(&mut bench.sent);
        assert!(!echo.is_empty());
        bench.hear(&echo);
        bench.pass(10);
        assert_eq!(bench.sent, NOTHING, "{pdu:?}");
        // With the master's next request at once behind it.
        bench.hear(&sealed(ADDRESS, &pdu));
        bench.pass(10);
        let mut again = std::mem::take(&mut bench.sent);
        again.extend(sealed(ADDRESS, &[4, 0, 0, 0, 1]));
        bench.hear(&again);
        bench.pass(10);
        assert_eq!(std::mem::take(&mut bench.sent).len(), 7);
    }
}

#[test]
fn theory_the_link_is_found_within_the_listening_time_only_and_kept() {
    let mut buffer = [0; MAX_FRAME];
    let identify = encode(&Request::Identify, 0, &mut buffer).expect("a frame").to_vec();
    let mut bench = Bench::fresh(link());
    bench.look(0);
    assert_eq!(bench.session.line_format(), LineFormat::MESHBAND);
    // A PLC that does not know, and the link.
    bench.hear(&sealed(ADDRESS, &[4, 0, 0, 0, 1]));
    bench.pass(1000 * LISTENING_S - 10);
    assert_eq!(bench.sent, NOTHING);
    bench.hear(&identify);
    assert!(!bench.sent.is_empty(), "answered in its own language");
    bench.pass(10_000);
    assert_eq!(bench.session.line_format(), LineFormat::MESHBAND);
    // Too late.
    let mut bench = Bench::new(link());
    bench.hear(&identify);
    bench.pass(100);
    assert_eq!((bench.sent.len(), bench.session.line_format()), (0, LineFormat::of_modbus(&link())));
    // Not configured at all.
    let mut bench = Bench::fresh(LinkConfig::default());
    bench.pass(1000 * LISTENING_S + 100);
    bench.hear(&identify);
    assert!(!bench.sent.is_empty());
}

#[test]
fn fault_a_configuration_that_no_master_could_reach_is_refused() {
    let verdict = |link: LinkConfig| Configuration { link, ..Configuration::default() }.validate(TicksPerSecond(CLOCK));
    for address in 0..=255 {
        let sane = ADDRESSES.contains(&address);
        let expected = if sane { Ok(()) } else { Err(ConfigurationError::Link) };
        assert_eq!(verdict(LinkConfig { address, ..link() }), expected, "{address}");
    }
    for (bits_per_second, sane) in [(0, true), (2399, false), (2400, true), (115_200, true), (115_201, false)] {
        assert_eq!(verdict(LinkConfig { bits_per_second, ..link() }).is_ok(), sane);
    }
    assert_eq!(verdict(LinkConfig::default()), Ok(()));
}

proptest! {
    /// Whatever comes in whatever pieces: answers are whole, and there are not more of them than sound requests.
    #[test]
    fn fault_any_bytes_at_any_time(
        pieces in proptest::collection::vec((proptest::collection::vec(any::<u8>(), 0..40), 0u32..30, any::<bool>()),
            0..40)
    ) {
        let mut bench = Bench::new(link());
        let mut asked = 0;
        for (bytes, milliseconds, sound) in pieces {
            bench.hear(&bytes);
            if sound {
                asked += 1;
                bench.hear(&sealed(ADDRESS, &[4, 0, 0, 0, 1]));
            }
            bench.pass(milliseconds);
            prop_assert!(bench.sent.len() <= 7 * asked, "{} bytes for {asked} requests", bench.sent.len());
        }
        bench.pass(20);
        bench.sent.clear();
        prop_assert_eq!(bench.read(4, 0, 1), [4, 2, 0, MAP_VERSION as u8]);
    }
}
