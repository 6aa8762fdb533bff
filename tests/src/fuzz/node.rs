//! Targets of the node: its link, its store, its tach, and a whole session.

use crate::damage::byte_damage::damage;
use crate::mock_flash::MockFlash;
use crate::plant::configuration;
use meshband::board::Timing;
use meshband::config::{Configuration, TachWheel};
use meshband::frame::{CRC32, Decoder, FrameError, Incoming, MAX_FRAME, Packet, encode};
use meshband::identity::Identity;
use meshband::message::{MAX_PEAKS, Message, Peaks, Reply, Request, SpectralLine};
use meshband::node::Block;
use meshband::session::Session;
use meshband::store::{Origin, Store};
use meshband::tach::TachTracker;
use meshband::units::Hertz;
use meshband::update::UpdateRequest;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const BOARD: Timing = Timing::STM32F405;
type Flash = MockFlash<4096, 4>;

/// Any damage.
pub fn change_bytes(bytes: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    damage(bytes, random);
}

fn frame(packet: &Packet, sequence: u16) -> Vec<u8> {
    let mut buffer = [0; MAX_FRAME];
    encode(packet, sequence, &mut buffer).expect("fits").to_vec()
}

/// One frame of each kind that carries much.
pub fn frame_seeds() -> Vec<Vec<u8>> {
    let line = |i: usize| SpectralLine { frequency_hz: i as f32, amplitude: 1.0 };
    let lines = (0..MAX_PEAKS).map(line).collect();
    let packets = [
        Packet::Request(Request::Identify),
        Packet::Request(Request::SetConfiguration(configuration())),
        Packet::Request(Request::PutLaw(configuration().law)),
        Packet::Request(Request::Update(UpdateRequest::Chunk {
            offset: 512,
            bytes: [7; 64][..].try_into().expect("fits"),
        })),
        Packet::Reply(Reply::Configuration(Configuration::default())),
        Packet::Message(Message::Peaks(Peaks { lines, ..Peaks::default() })),
    ];
    packets.iter().zip(7..).map(|(packet, sequence)| frame(packet, sequence)).collect()
}

/// On the wire, or inside a frame whose checksum is right again.
pub fn change_frame(bytes: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    let inner = bytes.split(|&byte| byte == 0).find(|part| !part.is_empty()).map(<[u8]>::to_vec);
    let content = inner.and_then(|mut part| {
        let length = cobs::decode_in_place(&mut part).ok()?;
        part.truncate(length.checked_sub(4)?);
        Some(part)
    });
    let Some(mut content) = content.filter(|_| random.random_range(0..4) > 0) else {
        return drop(damage(bytes, random));
    };
    damage(&mut content, random);
    content.truncate(MAX_FRAME - 16);
    content.extend(CRC32.checksum(&content).to_le_bytes());
    *bytes = [&[0][..], &cobs_encoded(&content), &[0]].concat();
}

fn cobs_encoded(content: &[u8]) -> Vec<u8> {
    let mut coded = vec![0; cobs::max_encoding_length(content.len())];
    let length = cobs::encode(content, &mut coded);
    coded.truncate(length);
    coded
}

/// Results come only at delimiters, are the same for a node's receiver, and what was understood is sent and read again.
pub fn frames(bytes: &[u8]) -> String {
    let (mut host, mut node) = (Decoder::<Packet>::new(), Decoder::<Incoming>::new());
    let mut said = Vec::new();
    for &byte in bytes {
        let (result, incoming) = (host.push(byte), node.push(byte));
        assert_eq!(result.is_some(), incoming.is_some());
        assert!(byte == 0 || result.is_none(), "a result without a delimiter");
        match result {
            Some(Ok(received)) => {
                if let Some(Ok(incoming)) = &incoming {
                    let request = match &received.packet {
                        Packet::Request(request) => Some(Incoming::Request(request.clone())),
                        _ => Some(Incoming::Foreign),
                    };
                    // In words: numbers that are none are equal to nothing.
                    assert_eq!(format!("{:?}", Some(&incoming.packet)), format!("{:?}", request.as_ref()));
                }
                let again = frame(&received.packet, received.sequence);
                let mut reader = Decoder::<Packet>::new();
                let read: Vec<_> = again.iter().filter_map(|&byte| reader.push(byte)).collect();
                assert_eq!(read.len(), 1);
                // Numbers that are none are equal to nothing: compare what is sent.
                let read = read[0].as_ref().expect("what was sent is read");
                assert_eq!(frame(&read.packet, read.sequence), again);
                said.push(format!("{:?}", received.packet).chars().take(32).collect::<String>());
            }
            Some(Err(error)) => said.push(match error {
                FrameError::Version(_) => "version".into(),
                FrameError::Unknown(_) => "unknown".into(),
                other => format!("{other:?}"),
            }),
            None => {}
        }
    }
    said.truncate(3);
    said.join(" ")
}

/// Flash with none to three configurations stored.
pub fn flash_seeds() -> Vec<Vec<u8>> {
    let stored = |count: u16| {
        let mut store = Store::new(Flash::new(2, ChaCha8Rng::seed_from_u64(1)), 0);
        for number in 0..count {
            let mut config = configuration();
            config.gears.pinion_teeth = 12 + number;
            store.save(&config).expect("there is room");
        }
        store.flash_mut().bytes.clone()
    };
    // Behind the flash's image: a configuration alone, as it lies in a record.
    let mut space = [0; Configuration::MAX_SERIALISED];
    let alone = postcard::to_slice(&configuration(), &mut space).expect("fits").to_vec();
    (0..4).map(|count| [stored(count), alone.clone()].concat()).collect()
}

/// Whatever lies in the flash, what is loaded is valid on the board, and the next save is found again.
pub fn store(bytes: &[u8]) -> String {
    let mut flash = Flash::new(2, ChaCha8Rng::seed_from_u64(2));
    let length = flash.bytes.len();
    flash.bytes.iter_mut().zip(bytes).for_each(|(place, byte)| *place = *byte);
    let mut store = Store::new(flash, 0);
    let (config, origin) = store.load(BOARD);
    assert_eq!(config.validate(BOARD), Ok(()));
    let mut next = configuration();
    next.gears.pinion_teeth = 77;
    let saved = store.save(&next);
    let (found, after) = store.load(BOARD);
    match saved {
        Ok(()) => {
            assert_eq!(found, next);
            // What lay behind it before may be damaged.
            assert!(matches!(after, Origin::Stored | Origin::Former), "{after:?}");
        }
        Err(_) => assert_eq!(found.validate(BOARD), Ok(())),
    }
    let lowered = |mut config: Configuration| {
        config.lower_to(BOARD);
        config.validate(BOARD)
    };
    let alone = bytes.get(length..).and_then(Configuration::from_stored).map(lowered);
    format!("{origin:?} {} {alone:?}", saved.is_ok())
}

/// A quiet session, and one with requests.
pub fn session_seeds() -> Vec<Vec<u8>> {
    // Edges every 12 500 ticks between blocks, requests in between.
    let mut quiet = Vec::new();
    for _ in 0..24 {
        quiet.extend([0, 0x40, 0xd8, 1, 0, 0, 200, 7]);
    }
    let mut spoken = quiet.clone();
    for sound in frame_seeds().into_iter().take(3) {
        for part in sound.chunks(200) {
            spoken.extend([2, part.len() as u8]);
            spoken.extend(part);
        }
        spoken.extend(&quiet[..80]);
    }
    vec![quiet, spoken]
}

/// Operations from bytes: an edge, a block, bytes of the line, a jump of the clock. What the node sends is understood.
pub fn session(bytes: &[u8]) -> String {
    let mut session = Session::new(configuration(), BOARD, Identity::HOST).expect("a valid configuration");
    let mut decoder = Decoder::<Packet>::new();
    let mut frames = 0_u32;
    let (mut tick, mut sequence) = (u32::MAX - 1_000_000, 0_u32);
    let mut codes = [0_u16; 512];
    let mut bytes = bytes.iter().copied();
    let mut operations = 0;
    while let (Some(operation), true) = (bytes.next(), operations < 400) {
        operations += 1;
        let mut next = || bytes.next().unwrap_or(0);
        let mut hear = |sent: &[u8]| {
            for &byte in sent {
                if let Some(result) = decoder.push(byte) {
                    result.expect("the node's own frames are understood");
                    frames += 1;
                }
            }
        };
        match operation % 4 {
            0 => {
                tick = tick.wrapping_add(u32::from(u16::from_le_bytes([next(), next()])));
                session.on_edge(tick);
            }
            1 => {
                let (gap, overrun, size, step) = (next(), next(), next(), next());
                codes.iter_mut().enumerate().for_each(|(n, code)| {
                    *code = 32_768_u16.wrapping_add((n as u16).wrapping_mul(u16::from(step)));
                });
                let requested = session.node().requested_period_ticks();
                let period_ticks = if gap & 0x40 == 0 { requested } else { 1 + u32::from(size) };
                let count = if overrun & 0x40 == 0 { codes.len() } else { usize::from(size) };
                sequence = sequence.wrapping_add(u32::from(gap & 3) + 1);
                // A second sensor's codes: none, as many, or too few.
                let of_second = [0, 0, count, count / 2][usize::from(gap >> 4 & 3)];
                let (second, overrun) = (&codes[..of_second], overrun & 1 == 1);
                let codes = &codes[..count];
                let block = Block { codes, second, first_tick: tick, period_ticks, sequence, overrun };
                tick = block.end_tick();
                session.on_block(block, &mut hear);
            }
            2 => {
                for _ in 0..next() {
                    session.on_byte(next(), &mut hear);
                }
            }
            _ => tick = tick.wrapping_add(u32::from_le_bytes([next(), next(), next(), next()])),
        }
        session.on_line_empty();
    }
    assert_eq!(session.unsent(), 0, "a frame that does not fit");
    let statistics = session.node().statistics();
    assert!(statistics.samples <= 512 * u64::from(statistics.blocks));
    format!("{:?} {} {}", session.node().state(), frames.min(12), statistics.events.len())
}

/// Wheels with one tooth, many, and missing ones.
pub fn tach_seeds() -> Vec<Vec<u8>> {
    let wheel = |teeth: u8, missing: u8, gap: u16| {
        let mut bytes = vec![teeth, missing];
        (0..200).for_each(|_| bytes.extend(gap.to_le_bytes()));
        bytes
    };
    vec![wheel(1, 0, 60_000), wheel(60, 2, 4_000), wheel(16, 0, 9_000)]
}

/// Wheel and intervals from bytes: speed and angle stay what they say they are.
pub fn tach(bytes: &[u8]) -> String {
    let (&teeth, &missing) = (bytes.first().unwrap_or(&1), bytes.get(1).unwrap_or(&0));
    let wheel = TachWheel {
        pulses_per_turn: u16::from(teeth).max(1) * 4,
        missing: u16::from(missing) % 3 * u16::from(teeth > 12),
        ..Configuration::default().tach
    };
    let config = Configuration { tach: wheel, ..Configuration::default() };
    if config.validate(BOARD).is_err() {
        return "not a wheel".into();
    }
    let mut tracker = TachTracker::new(wheel, BOARD.clock);
    let mut now = 0_u64;
    let mut highest = Hertz(0.0);
    for pair in bytes[2.min(bytes.len())..].chunks_exact(2) {
        now += 16 * u64::from(u16::from_le_bytes([pair[0], pair[1]]));
        // Now and then a pulse from the past.
        tracker.on_pulse(if pair[0] == 0xff { now / 2 } else { now });
        let speed = tracker.speed(now);
        assert!(speed.pinion.0.is_finite() && speed.pinion.0 >= 0.0, "{speed:?}");
        assert!(speed.uncertainty.is_finite() && speed.age_s >= 0.0, "{speed:?}");
        highest = if speed.pinion.0 > highest.0 { speed.pinion } else { highest };
        let _ = tracker.tach_angle(now);
    }
    let later = tracker.speed(now + 100 * u64::from(BOARD.clock.0));
    assert_eq!(later.validity, meshband::tach::Validity::None, "a shaft is believed in without a pulse for 100 s");
    format!("{:?} {} {}", tracker.speed(now).validity, tracker.is_indexed(), highest.0 > 0.0)
}
