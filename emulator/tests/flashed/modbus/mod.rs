//! The released image as a Modbus station: read by an independent master, against what the same node says over its
//! own link.

mod load;
mod master;

use super::image::image;
use super::outputs::watched;
use super::spoken::Node;
use master::Master;
use meshband::config::{Configuration, LinkConfig, Parity, Personality, SensorSupply};
use meshband::frame::Packet;
use meshband::levels::{ExpectedLevel, LocalPoint};
use meshband::message::{Indicators, Message, Reply, Request, Spectrum, Status};
use meshband::modbus::map::{Kind, REGISTERS, Register};
use meshband::modbus::{CRC16, MAP_VERSION};
use meshband::shaft_lines::ShaftOrders;
use meshband::units::Hertz;
use meshband_emulator::world::PinChange;
use std::f64::consts::TAU;
use std::sync::Arc;

const ADDRESS: u8 = 17;
const RATE: f64 = 19_200.0;
/// Port A's pin of the line's driver.
const DRIVER: (usize, u32) = (0, 8);
/// When the listening is over for sure, s from power.
const LISTENED_S: f64 = 3.4;

fn configuration() -> Configuration {
    let link =
        LinkConfig { personality: Personality::Modbus, address: ADDRESS, bits_per_second: 0, parity: Parity::Even };
    let level = ExpectedLevel { level_db: 30.0, uncertainty_db: 1.5 };
    let local_levels = [10.0, 40.0].map(|hz| LocalPoint { speed: Hertz(hz), sidebands: level, fm0: level });
    Configuration { link, local_levels: local_levels.into_iter().collect(), ..watched(SensorSupply::Off) }
}

/// A node with that stored, at the moment its power comes back: 25 Hz, mesh at 500 Hz, loud from the second second on.
fn stored(test: &str, configuration: &Configuration) -> Option<Node> {
    let image = image(test)?;
    let mut node = Node::new(&image);
    node.start();
    node.configure(configuration);
    node.commit();
    node.cycle_power();
    node.board.seen().resets.clear();
    let begin = node.board.seconds();
    node.board.set_analogue(Arc::new(move |time_s| {
        let (angle, amplitude) = (TAU * 25.0 * time_s, if time_s > begin + 2.0 { 0.3 } else { 0.005 });
        0.5 + amplitude * ((20.0 * angle).sin() + 0.2 * (angle + 0.4).cos() + 0.1 * (21.0 * angle).cos())
    }));
    let edges: Vec<f64> = (1..1200).map(|n| begin + 0.04 * f64::from(n)).collect();
    node.board.add_tach_edges(&edges);
    Some(node)
}

fn register(group: &str, name: &str) -> &'static Register {
    REGISTERS.iter().find(|row| (row.group, row.name) == (group, name)).unwrap_or_else(|| panic!("{group}.{name}"))
}

/// A group as its words, with the address of the first.
fn group(master: &mut Master, node: &mut Node, name: &str) -> (u16, Vec<u32>) {
    let rows: Vec<_> = REGISTERS.iter().filter(|row| row.group == name).collect();
    let first = rows[0].address;
    let last = rows[rows.len() - 1];
    let count = last.address + last.kind.registers() - first;
    (first, master.numbers(&mut node.board, &format!("read 4 {first} {count}")))
}

/// A value of a group that was read.
fn value((first, words): &(u16, Vec<u32>), group: &str, name: &str) -> u32 {
    let row = register(group, name);
    let at = usize::from(row.address - first);
    if row.kind == Kind::Word { words[at] } else { words[at] << 16 | words[at + 1] }
}

/// Whether every row of a group has the value that a message gives; floats bit for bit.
fn check(words: &(u16, Vec<u32>), group: &str, expected: &[(&str, Expected)]) {
    for (name, expected) in expected {
        let found = value(words, group, name);
        match expected {
            Expected::Number(number) => assert_eq!(found, *number, "{group}.{name}"),
            // Both may be no number, with other bits: NA4 without an expected residual.
            Expected::Float(float) if float.is_nan() => assert!(f32::from_bits(found).is_nan(), "{group}.{name}"),
            Expected::Float(float) => assert_eq!(f32::from_bits(found), *float, "{group}.{name}"),
            Expected::None => assert!(f32::from_bits(found).is_nan(), "{group}.{name}: {found:#010x}"),
        }
    }
}

enum Expected {
    Number(u32),
    Float(f32),
    None,
}

/// What the link said in the same life: the node of the snapshot, called by its link while it still listened.
struct Said {
    values: Vec<Indicators>,
    spectra: Vec<Spectrum>,
    statuses: Vec<Status>,
}

fn by_the_link(node: &mut Node, seconds: f64) -> Said {
    node.start();
    let Reply::Identity(identity) = node.ask(&Request::Identify) else { panic!("no identity") };
    println!("called in time: {}", identity.board);
    node.run(seconds);
    let mut said = Said { values: Vec::new(), spectra: Vec::new(), statuses: Vec::new() };
    for packet in &node.heard {
        match packet {
            Packet::Message(Message::Indicators(indicators)) => said.values.push(*indicators),
            Packet::Message(Message::Spectrum(spectrum)) => said.spectra.push(spectrum.clone()),
            Packet::Message(Message::Status(status)) => said.statuses.push(*status),
            _ => {}
        }
    }
    assert_eq!(node.unreadable, 0);
    said
}

#[test]
fn claim_an_independent_modbus_master_reads_what_the_link_reports_bit_for_bit() {
    const TEST: &str = "Modbus against the link";
    let Some(mut node) = stored(TEST, &configuration()) else { return };
    let Some(mut master) = Master::start(TEST, ADDRESS) else { return };
    let power = node.snapshot();
    let said = by_the_link(&mut node, 16.0);
    node.restore(&power);
    node.board.set_line(RATE, 11);
    node.run(9.0);

    let words = group(&mut master, &mut node, "values");
    let number = value(&words, "values", "number");
    let told = &said.values[number as usize - 1];
    println!("record {number}: RMS {} m/s^2, by the link {}", f32::from_bits(value(&words, "values", "rms")), told.rms);
    check(
        &words,
        "values",
        &[
            ("quality", Expected::Number(0)),
            ("turns", Expected::Number(told.quality.turns.into())),
            ("duration", Expected::Float(told.quality.duration_s)),
            ("speed", Expected::Float(told.tag.speed_hz)),
            ("rms", Expected::Float(told.rms)),
            ("peak", Expected::Float(told.peak)),
            ("crest", Expected::Float(told.crest)),
            ("kurtosis", Expected::Float(told.kurtosis)),
            ("velocity_rms", Expected::Float(told.velocity_rms)),
            ("velocity_from", Expected::Float(told.velocity_band_hz[0])),
            ("velocity_to", Expected::Float(told.velocity_band_hz[1])),
        ],
    );
    assert!(told.rms > 100.0, "a signal");
    // As the master itself puts two registers together.
    let rms = register("values", "rms").address;
    let float = master.ask(&mut node.board, &format!("float {rms}"));
    assert!(said.values.iter().any(|told| f64::from(told.rms) == float.parse::<f64>().expect("a number")), "{float}");

    for (group_name, of) in [
        ("orders of the pinion", (|told| told.pinion) as fn(&Indicators) -> Option<ShaftOrders>),
        ("orders of the gear", |told| told.wheel),
    ] {
        let words = group(&mut master, &mut node, group_name);
        let number = value(&words, group_name, "number") as usize;
        let told = said.values.iter().filter_map(of).nth(number - 1).expect("as many by the link");
        check(&words, group_name, &[("turns", Expected::Number(told.turns.into()))]);
        let [once, twice, thrice] = told.lines;
        let lines = [
            ("amplitude_1x", once.amplitude),
            ("phase_1x", once.phase_deg),
            ("amplitude_2x", twice.amplitude),
            ("phase_2x", twice.phase_deg),
            ("amplitude_3x", thrice.amplitude),
            ("phase_3x", thrice.phase_deg),
        ];
        let lines = lines.map(|(name, float)| (name, Expected::Float(float)));
        check(&words, group_name, &lines);
        assert!(value(&words, group_name, "age") <= 2);
    }

    let words = group(&mut master, &mut node, "mesh bands");
    let told = &said.spectra[value(&words, "mesh bands", "number") as usize - 1];
    let first = &told.bands[0];
    let middle = first.sidebands.len() / 2;
    check(
        &words,
        "mesh bands",
        &[
            ("turns", Expected::Number(told.turns.into())),
            ("harmonics", Expected::Number(told.bands.len() as u32)),
            ("speed", Expected::Float(told.tag.speed_hz)),
            ("mesh_1", Expected::Float(first.line.amplitude)),
            ("mesh_1_pinion_below", Expected::Float(first.sidebands[middle - 1].amplitude)),
            ("mesh_1_pinion_above", Expected::Float(first.sidebands[middle].amplitude)),
            ("mesh_2", Expected::Float(told.bands[1].line.amplitude)),
            ("mesh_6", Expected::None),
        ],
    );
    assert!(first.line.amplitude > 100.0);

    let words = group(&mut master, &mut node, "gear condition");
    let gears: Vec<_> = said.values.iter().filter_map(|told| told.gear).collect();
    let number = value(&words, "gear condition", "number") as usize;
    println!("{number} averages");
    if let Some(told) = number.checked_sub(1).map(|at| &gears[at]) {
        let floats = [
            ("rms", told.rms),
            ("fm0", told.fm0),
            ("fm4", told.fm4),
            ("na4", told.na4),
            ("residual_rms", told.residual_rms),
        ];
        check(&words, "gear condition", &floats.map(|(name, float)| (name, Expected::Float(float))));
    }
    let words = group(&mut master, &mut node, "status");
    let told = said.statuses.last().expect("a status a second");
    check(
        &words,
        "status",
        &[
            ("state", Expected::Number(3)),
            ("speed_validity", Expected::Number(2)),
            ("adc_rate", Expected::Float(told.adc_hz)),
            ("output_rate", Expected::Float(told.granted_hz)),
            ("law_bandwidth", Expected::Float(told.bandwidth_hz)),
        ],
    );
    let speed = f32::from_bits(value(&words, "status", "speed"));
    assert!((speed - 25.0).abs() < 0.01, "{speed}");
    assert!(value(&words, "status", "age") <= 1);
    let words = group(&mut master, &mut node, "departures");
    // Of the latest mesh bands: those may come before or after the values, as the line keeps the node busy.
    let told = |of: fn(&Indicators) -> Option<f32>| {
        let found: Vec<f32> = said.values.iter().filter_map(of).collect();
        move |float: u32| found.iter().any(|told| told.to_bits() == float)
    };
    let is_told = told(|told| told.local_departures.sidebands.map(|sidebands| sidebands.departure_db));
    assert!(is_told(value(&words, "departures", "sidebands")), "sidebands");
    let is_told = told(Indicators::largest_departure);
    assert!(is_told(value(&words, "departures", "largest")), "largest");
    // Nothing is expected of the RMS, and nothing was timed at this rate: not numbers, and an age that no limit
    // accepts.
    check(&words, "departures", &[("rms", Expected::None)]);
    let words = group(&mut master, &mut node, "measured bandwidth");
    check(&words, "measured bandwidth", &[("age", Expected::Number(65_535)), ("rise", Expected::None)]);
}

#[test]
fn claim_an_independent_modbus_master_sees_alarms_counters_and_refusals() {
    const TEST: &str = "Modbus alarms and refusals";
    let Some(mut node) = stored(TEST, &configuration()) else { return };
    let Some(mut master) = Master::start(TEST, ADDRESS) else { return };
    node.board.chip_mut().unique = [0x1122_3344, 0x5566_7788, 0x99aa_bbcc];
    node.board.set_line(RATE, 11);
    node.run(8.0);
    let words = group(&mut master, &mut node, "alarms");
    let expected = [("raised", 1), ("standing", 1), ("unseen", 1), ("signal_bad", 0), ("any_standing", 1)];
    check(&words, "alarms", &expected.map(|(name, number)| (name, Expected::Number(number))));
    let bits = master.numbers(&mut node.board, "read 2 0 30");
    let set: Vec<usize> = (0..30).filter(|&at| bits[at] == 1).collect();
    assert_eq!(set, [0, 8, 16, 25, 26, 27, 28], "standing, raised, unseen, any, locked, measuring, good");
    assert_eq!(master.numbers(&mut node.board, "read 2 7 3"), [0, 1, 0]);

    let words = group(&mut master, &mut node, "identity");
    assert_eq!(value(&words, "identity", "unique_id_1"), 0x5566_7788);
    assert_eq!(value(&words, "identity", "map_version"), MAP_VERSION.into());
    let uptime = value(&words, "identity", "uptime");
    assert!((7..=10).contains(&uptime), "{uptime} s");
    assert_eq!(
        master.ask(&mut node.board, &format!("long {}", register("identity", "unique_id_0").address)),
        "287454020"
    );
    // The same registers for masters that know no others.
    let teeth = register("identity", "pinion_teeth").address;
    assert_eq!(master.numbers(&mut node.board, &format!("read 3 {teeth} 2")), [20, 30]);

    let refused = [
        ("read 1 0 1", 1),
        ("write 5 0 1", 1),
        ("write 6 0 1", 1),
        ("write 15 0 1", 1),
        ("write 16 0 1", 1),
        ("identity", 1),
        ("read 4 31 1", 2),
        ("read 4 0 125", 2),
        ("read 4 65535 1", 2),
        ("read 4 60900 125", 2),
        ("read 2 29 2", 2),
        ("read 2 30 1", 2),
    ];
    for (order, exception) in refused {
        assert_eq!(master.ask(&mut node.board, order), format!("exception {exception}"), "{order}");
    }
    let words = group(&mut master, &mut node, "counters");
    let expected =
        [("line_exceptions", refused.len() as u32), ("blocks_lost", 0), ("line_damaged", 0), ("line_late", 0)];
    check(&words, "counters", &expected.map(|(name, number)| (name, Expected::Number(number))));
    assert!(value(&words, "counters", "blocks") > 100);
    assert!(value(&words, "counters", "pulses") > 150);
    assert_eq!(node.board.seen().resets.len(), 0);
}

#[test]
fn theory_an_answer_is_one_run_of_characters_and_the_driver_is_on_for_just_that_long() {
    const TEST: &str = "Modbus characters and driver";
    let Some(mut node) = stored(TEST, &configuration()) else { return };
    let Some(mut master) = Master::start(TEST, ADDRESS) else { return };
    node.board.set_line(RATE, 11);
    node.run(4.0);
    node.board.seen().pins.clear();
    let character = 11.0 / RATE;
    for _ in 0..20 {
        // The longest group: the ring's end would come among these answers.
        group(&mut master, &mut node, "mesh bands");
        let sent: Vec<f64> = master.latest.iter().map(|(at, _)| node.board.chip().seconds_at(*at)).collect();
        assert_eq!(sent.len(), 3 + 2 * 66 + 2);
        let widest = sent.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
        assert!((widest / character - 1.0).abs() < 1e-3, "{widest} s between two characters of {character} s");
        let pins = std::mem::take(&mut node.board.seen().pins);
        let driver: Vec<_> = pins.iter().filter(|change| (change.port, change.pin) == DRIVER).collect();
        let [on, off] = &driver[..] else { panic!("{driver:?}") };
        let at = |change: &PinChange| node.board.chip().seconds_at(change.at);
        assert!(on.level && !off.level);
        let (before, after) = (sent[0] - character - at(on), at(off) - sent[sent.len() - 1]);
        assert!((0.0..1e-4).contains(&before) && (0.0..1e-4).contains(&after), "{before} s before, {after} s after");
    }
}

/// Runs the board; what it said meanwhile, as bytes.
fn listen(node: &mut Node, seconds: f64) -> Vec<u8> {
    let until = node.board.seconds() + seconds;
    node.board.run_until(until).expect("the board runs");
    node.board.take_sent()
}

#[test]
fn theory_a_node_of_modbus_says_nothing_of_itself_and_damage_no_more() {
    let Some(mut node) = stored("Modbus silence", &configuration()) else { return };
    let request = |address: u8| {
        let mut frame = vec![address, 4, 0, 0, 0, 2];
        frame.extend(CRC16.checksum(&frame).to_le_bytes());
        frame
    };
    node.board.set_line(RATE, 11);
    listen(&mut node, 1.0);
    node.board.send(&request(ADDRESS));
    assert_eq!(listen(&mut node, LISTENED_S - 1.0), [], "the node still listened for its link");
    let mut damaged = request(ADDRESS);
    damaged[3] ^= 1;
    for silent in [request(ADDRESS + 1), request(0), damaged, vec![ADDRESS], vec![0x55; 300]] {
        node.board.send(&silent);
        assert_eq!(listen(&mut node, 0.4), []);
    }
    // What another node was asked and answered just before is no hindrance, nor are 300 other bytes.
    for before in [request(ADDRESS + 1), vec![0x55; 300]] {
        node.board.send(&before);
        node.board.send(&request(ADDRESS));
        assert_eq!(listen(&mut node, 0.4)[..5], [ADDRESS, 4, 4, 0, MAP_VERSION as u8]);
    }
    // The link at its own rate is noise by now.
    node.board.set_line(921_600.0, 10);
    node.send(&Request::Identify);
    node.run(0.4);
    assert_eq!((node.heard.len(), node.unreadable, node.board.seen().resets.len()), (0, 0, 0));
}

#[test]
fn theory_the_way_back_is_open_after_every_start_and_other_rates_work() {
    let link = LinkConfig { bits_per_second: 115_200, parity: Parity::NoneTwoStop, ..configuration().link };
    let Some(mut node) = stored("way back from Modbus", &Configuration { link, ..configuration() }) else { return };
    let mut frame = vec![ADDRESS, 4, 0, 0, 0, 1];
    frame.extend(CRC16.checksum(&frame).to_le_bytes());
    node.board.set_line(115_200.0, 11);
    node.run(LISTENED_S);
    node.board.send(&frame);
    assert_eq!(listen(&mut node, 0.1)[..5], [ADDRESS, 4, 2, 0, MAP_VERSION as u8]);
    // A PLC keeps asking while the node is called by its link.
    node.cycle_power();
    node.start();
    for _ in 0..5 {
        node.board.send(&frame);
        node.run(0.05);
    }
    node.board.set_line(921_600.0, 10);
    let mut held = node.configuration();
    assert_eq!(held.link, link);
    held.link = LinkConfig::default();
    node.configure(&held);
    node.commit();
    node.cycle_power();
    node.run(LISTENED_S);
    let statuses = node.heard.iter().filter(|packet| matches!(packet, Packet::Message(Message::Status(_)))).count();
    assert!(statuses >= 2, "the link speaks of itself again");
}
