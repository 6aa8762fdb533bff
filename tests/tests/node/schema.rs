//! Programs of different age: stored configurations are kept, frames are read as far as they are known, and the rest
//! is said.

use meshband::alarm::Watched;
use meshband::board::Timing;
use meshband::config::{
    CaptureRate, Configuration, ConfigurationError, FrontEnd, Gain, OLDEST_SCHEMA, Personality, SCHEMA, SensorSupply,
    TachEdge,
};
use meshband::events::{Event, EventKind};
use meshband::frame::{CRC32, Decoder, Frame, FrameError, Packet, encode};
use meshband::identity::{Identity, VERSION};
use meshband::message::{Message, OLDEST_READABLE, Reply, Request, SelfTest, WIRE_SCHEMA};
use meshband::rate_plan::RatePolicy;
use meshband::schema;
use meshband::self_test::MATHEMATICS;
use meshband::session::Session;
use meshband::store::{Origin, Store};
use meshband::units::{Hertz, TicksPerSecond};
use meshband_tests::mock_flash::MockFlash;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::cmp::Ordering;

const CLOCK_HZ: u32 = 84_000_000;
/// A store's first record, written by the firmware whose configurations had schema 1.
const STORED_1: &[u8] = include_bytes!("../../vectors/wire/stored-configuration-1.bin");
/// Identity, configuration, counters and a message of counters, as the firmware with protocol 2 sent them.
const FRAMES_2: &[u8] = include_bytes!("../../vectors/wire/frames-2.bin");

fn flash_with(record: &[u8]) -> MockFlash<4096, 4> {
    let mut flash = MockFlash::new(2, ChaCha8Rng::seed_from_u64(1));
    flash.bytes[..record.len()].copy_from_slice(record);
    flash
}

/// A frame's content with any header, sealed and coded.
fn frame(writer: u8, oldest_reader: u8, sequence: u16, body: &[u8]) -> Vec<u8> {
    let mut content = vec![writer, oldest_reader];
    content.extend(sequence.to_le_bytes());
    content.extend(body);
    content.extend(CRC32.checksum(&content).to_le_bytes());
    let mut coded = vec![0; cobs::max_encoding_length(content.len())];
    let length = cobs::encode(&content, &mut coded);
    coded.truncate(length);
    coded.push(0);
    coded
}

fn receive(decoder: &mut Decoder, bytes: &[u8]) -> Vec<Result<Frame, FrameError>> {
    bytes.iter().filter_map(|&byte| decoder.push(byte)).collect()
}

/// Postcard of a streamed event, as [`Packet`] has it.
fn event_body() -> (Event, Vec<u8>) {
    let event = Event { kind: EventKind::Stuck, detail: 7, first_tick: 5, last_tick: 900, count: 300 };
    let mut buffer = [0; 64];
    let body = postcard::to_slice(&event, &mut buffer).expect("small").to_vec();
    // Packet::Message, Message::Event.
    (event, [&[2, 5][..], &body].concat())
}

#[test]
fn regress_a_configuration_stored_with_schema_1_is_kept() {
    let (config, origin) = Store::new(flash_with(STORED_1), 0).load(TicksPerSecond(CLOCK_HZ));
    assert_eq!(origin, Origin::Stored);
    assert_eq!((config.schema, config.front_end), (SCHEMA, FrontEnd::default()));
    assert_eq!((config.gears.pinion_teeth, config.gears.gear_teeth), (19, 48));
    assert_eq!((config.tach.pulses_per_turn, config.tach.missing, config.tach.pinion_per_tach), (60, 2, 2.5));
    assert_eq!((config.tach.highest, config.tach.lowest), (Hertz(60.0), Hertz(0.5)));
    assert_eq!((config.sensor.acceleration_per_code.0, config.sensor.zero_code), (-0.00494, 31_000));
    assert_eq!((config.limits.analogue_stop, config.limits.highest_adc), (Hertz(80_000.0), Hertz(400_000.0)));
    assert_eq!((config.law.machine_hash, config.law.provisional), (0x0123_4567_89ab_cdef, false));
    assert_eq!(config.policy, RatePolicy::Waveform { multiple: 5.0 });
    assert_eq!((config.mesh.harmonics, config.mesh.sidebands), (4, 2));
    let alarms: Vec<_> = config.alarms.iter().map(|a| (a.watched, a.raise, a.persistence)).collect();
    assert_eq!(alarms, [(Watched::Rms, 12.0, 3), (Watched::Fm4, 13.0, 4), (Watched::BandwidthRatio, 14.0, 5)]);
    // What it meant before: rising edge, no amplifier, the supply not switched off.
    let before = FrontEnd { tach_edge: TachEdge::Rising, gain: Gain::X1, sensor_supply: SensorSupply::On };
    assert_eq!(config.front_end, before);
}

#[test]
fn regress_what_was_kept_is_stored_anew_in_the_present_schema() {
    let mut store = Store::new(flash_with(STORED_1), 0);
    let (mut config, _) = store.load(TicksPerSecond(CLOCK_HZ));
    config.front_end.gain = Gain::X8;
    store.save(&config).expect("room");
    assert_eq!(store.load(TicksPerSecond(CLOCK_HZ)), (config, Origin::Stored));
}

/// Earlier versions let an STM32F405 ask for 500 kHz, by default even.
#[test]
fn regress_a_stored_rate_above_what_the_board_keeps_up_with_is_lowered_and_the_rest_kept() {
    let mut store = Store::new(flash_with(&[]), 0);
    let mut config =
        Configuration { policy: RatePolicy::Forced { rate: Hertz(480_000.0) }, ..Configuration::default() };
    config.limits.highest_adc = Hertz(500_000.0);
    config.gears.pinion_teeth = 31;
    store.save(&config).expect("room");
    let (kept, origin) = store.load(Timing::STM32F405);
    let highest = Timing::STM32F405.highest_adc;
    assert_eq!((origin, kept.limits.highest_adc, kept.gears.pinion_teeth), (Origin::Stored, highest, 31));
    assert_eq!(kept.policy, RatePolicy::Forced { rate: highest });
    assert_eq!(store.load(Timing::AN386).0.limits.highest_adc, Hertz(500_000.0), "another board keeps up");
}

#[test]
fn fault_a_configuration_of_an_unknown_schema_is_refused_and_reported() {
    for schema in [OLDEST_SCHEMA - 1, SCHEMA + 1, 99, u16::MAX] {
        let mut store = Store::new(flash_with(&[]), 0);
        store.save(&Configuration { schema, ..Configuration::default() }).expect("room");
        let (config, origin) = store.load(TicksPerSecond(CLOCK_HZ));
        assert_eq!(
            (config, origin, origin.complaint()),
            (Configuration::default(), Origin::Refused, Some(3)),
            "{schema}"
        );
    }
}

#[test]
fn fault_a_shortened_configuration_of_the_present_schema_is_no_older_one() {
    let mut buffer = [0; Configuration::MAX_SERIALISED];
    let whole = postcard::to_slice(&Configuration::default(), &mut buffer).expect("fits");
    assert_eq!(Configuration::from_stored(whole), Some(Configuration::default()));
    for length in 0..whole.len() {
        assert_eq!(Configuration::from_stored(&whole[..length]), None, "{length} bytes");
    }
    assert_eq!(Configuration::from_stored(&[&whole[..], &[0]].concat()), None);
}

/// Bytes at the end of the default configuration that a layout did not have: lists of a train, modes, range, check of
/// the sensor, velocity and Modbus' options, local levels, the second sensor, waveforms, the link, the list of levels.
const APPENDED_BYTES: [(u16, usize); 7] = [
    (9, 3),
    (8, 3 + 33),
    (7, 3 + 33 + 1),
    (6, 3 + 33 + 2),
    (5, 3 + 33 + 2 + 5),
    (4, 3 + 33 + 2 + 5 + 4),
    (3, 3 + 33 + 2 + 5 + 4 + 1),
];

#[test]
fn regress_a_configuration_of_an_older_layout_has_the_first_value_of_what_was_appended() {
    for (schema, appended) in APPENDED_BYTES {
        let mut buffer = [0; Configuration::MAX_SERIALISED];
        let former = Configuration { schema, latched: 5, ..Configuration::default() };
        let whole = postcard::to_slice(&former, &mut buffer).expect("fits");
        let (older, _) = whole.split_at(whole.len() - appended);
        let read = Configuration::from_stored(older).expect("an older one");
        assert_eq!(read, Configuration { latched: 5, ..Configuration::default() }, "schema {schema}");
        assert!(read.levels.is_empty() && read.second.is_none() && read.local_levels.is_empty());
        assert_eq!((read.link.personality, read.capture.keep), (Personality::Meshband, CaptureRate::Off));
    }
}

#[test]
fn theory_readers_of_another_age_take_what_they_know() {
    // What a newer writer would write: one list, one float and one number more than `(u8, u16)`.
    let newer: (u8, u16, Vec<u8>, f32, u64) = (3, 500, vec![1, 2], 1.5, 9);
    let mut buffer = [0; 32];
    let bytes = postcard::to_slice(&(3u8, 500u16, [2u8, 1, 2], 1.5f32, 9u64), &mut buffer).expect("fits");
    assert_eq!(schema::read::<(u8, u16)>(bytes, Ordering::Greater), Some((3, 500)));
    assert_eq!(schema::read::<(u8, u16)>(bytes, Ordering::Equal), None, "of the same schema every byte counts");
    type Newer = (u8, u16, heapless::Vec<u8, 4>, f32, u64);
    let whole: Newer = schema::read(bytes, Ordering::Equal).expect("whole");
    assert_eq!((whole.0, whole.1, whole.2.to_vec(), whole.3, whole.4), newer);
    let older: Newer = schema::read(&bytes[..3], Ordering::Less).expect("zeros stand for what was unknown then");
    assert_eq!(older, (3, 500, heapless::Vec::new(), 0.0, 0));
    assert_eq!(schema::read::<Newer>(&bytes[..3], Ordering::Equal), None);
    assert_eq!(schema::read::<Newer>(&bytes[..3], Ordering::Greater), None, "a newer writer leaves nothing out");
    assert_eq!(schema::read::<Newer>(&bytes[..8], Ordering::Less), None, "no half field");
}

#[test]
fn theory_a_newer_nodes_messages_are_read_as_far_as_they_are_known() {
    let (event, body) = event_body();
    let mut decoder = Decoder::new();
    let known = Frame { sequence: 0, lost: 0, packet: Packet::Message(Message::Event(event)) };
    assert_eq!(receive(&mut decoder, &frame(WIRE_SCHEMA, OLDEST_READABLE, 0, &body)), [Ok(known.clone())]);
    // Two fields appended.
    let longer = [&body[..], &[200, 1, 42]].concat();
    let received = receive(&mut decoder, &frame(WIRE_SCHEMA + 1, OLDEST_READABLE, 1, &longer));
    assert_eq!(received, [Ok(Frame { sequence: 1, ..known.clone() })]);
    let same = receive(&mut decoder, &frame(WIRE_SCHEMA, OLDEST_READABLE, 2, &longer));
    assert_eq!(same, [Err(FrameError::Content)], "of the same schema every byte counts");
    // An unknown message, reply, kind of event: skipped, said, and no loss.
    for (n, unknown) in [&[2, 200, 1, 1][..], &[1, 99], &[2, 5, 250, 0, 0, 0, 1], &[7]].into_iter().enumerate() {
        let received = receive(&mut decoder, &frame(WIRE_SCHEMA + 1, OLDEST_READABLE, 3 + n as u16, unknown));
        assert_eq!(received, [Err(FrameError::Unknown(WIRE_SCHEMA + 1))], "{unknown:?}");
    }
    let received = receive(&mut decoder, &frame(WIRE_SCHEMA, OLDEST_READABLE, 7, &body));
    assert_eq!(received, [Ok(Frame { sequence: 7, ..known })], "nothing counts as lost");
}

#[test]
fn fault_a_node_that_cannot_be_read_is_named_by_its_schema() {
    let (_, body) = event_body();
    let mut decoder = Decoder::<Packet>::new();
    let future = frame(WIRE_SCHEMA + 2, WIRE_SCHEMA + 1, 0, &body);
    assert_eq!(receive(&mut decoder, &future), [Err(FrameError::Version(WIRE_SCHEMA + 2))]);
    // Frames that were really sent before there were schemas.
    let received = receive(&mut decoder, FRAMES_2);
    assert_eq!(received.len(), 4);
    assert!(received.iter().all(|frame| *frame == Err(FrameError::Version(2))));
}

#[test]
fn theory_the_node_says_who_it_is() {
    let identity = Identity {
        board: "a-board-with-a-long-name",
        build: "0123456789abcdef",
        unique_id: [1, 2, 3],
        ..Identity::HOST
    };
    let clock = TicksPerSecond(CLOCK_HZ);
    let mut session = Session::new(Configuration::default(), clock, identity).expect("valid");
    let mut bytes = Vec::new();
    session.on_request(Request::Identify, &mut |frame| bytes.extend_from_slice(frame));
    let [Ok(Frame { packet: Packet::Reply(Reply::Identity(said)), .. })] = &receive(&mut Decoder::new(), &bytes)[..]
    else {
        panic!("no identity")
    };
    assert_eq!((said.wire_schema, said.configuration_schema, said.version), (WIRE_SCHEMA, SCHEMA, VERSION));
    assert_eq!((said.board.as_str(), said.build.as_str()), ("a-board-with-a-l", "0123456789ab"));
    let checked = SelfTest { run: MATHEMATICS, failed: 0 };
    assert_eq!((said.unique_id, said.ticks_per_second, said.self_test), ([1, 2, 3], CLOCK_HZ, checked));
}

#[test]
fn fault_a_configuration_of_another_schema_is_refused_over_the_link() {
    let clock = TicksPerSecond(CLOCK_HZ);
    let mut session = Session::new(Configuration::default(), clock, Identity::HOST).expect("valid");
    let mut buffer = [0; meshband::frame::MAX_FRAME];
    for schema in [1, SCHEMA + 1] {
        let request = Request::SetConfiguration(Configuration { schema, ..Configuration::default() });
        let wire = encode(&request, schema, &mut buffer).expect("fits").to_vec();
        let mut bytes = Vec::new();
        wire.iter().for_each(|&byte| session.on_byte(byte, &mut |frame| bytes.extend_from_slice(frame)));
        let packets: Vec<_> =
            receive(&mut Decoder::new(), &bytes).into_iter().map(|f| f.expect("intact").packet).collect();
        assert_eq!(packets, [Packet::Reply(Reply::Refused(ConfigurationError::Schema))]);
        assert_eq!(session.node().configuration().schema, SCHEMA);
    }
}

#[test]
fn theory_gains_are_those_of_the_amplifier() {
    let table: Vec<(u8, u8)> = Gain::ALL.iter().map(|gain| (gain.code(), gain.factor())).collect();
    assert_eq!(table, [(0, 1), (1, 2), (2, 4), (3, 5), (4, 8), (5, 10), (6, 16), (7, 32)]);
}
