//! What a host application and a conformance kit see of a session: the table in book/src/howto/fleet.md names these
//! tests.

use super::metrics::Devices;
use super::payload::{Payload, Value, datatype};
use super::session::{Session, Step};
use super::test_broker::TestBroker;
use crate::journal::entry::{Body, Entry, Note};
use prost::Message;
use rumqttc::{Packet, QoS};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

/// An entry of just now, however long a test takes.
fn entry(node: &str, body: Body) -> Entry {
    let (node, machine) = (node.to_owned(), "m".to_owned());
    Entry { node, machine, unit: [1; 3], boot: 1, received_us: i64::MAX / 2, time_us: 1_000_000, body }
}

fn note(node: &str, kind: Note) -> Entry {
    entry(node, Body::Note { kind, detail: 7, text: "1.2.3".to_owned() })
}

fn status(node: &str) -> Entry {
    let message = meshband::message::Message::Status(crate::synthesise::status(1, 10.0));
    let mut buffer = [0; meshband::frame::MAX_FRAME];
    let frame = meshband::frame::encode(&message, 1, &mut buffer).expect("fits");
    entry(node, Body::Frame(frame[1..frame.len() - 1].to_vec()))
}

fn begun(broker: &TestBroker, bd_seq: u8) -> Session {
    Session::begin(&broker.config(), "e", bd_seq).expect("a session")
}

/// Value and type of a metric.
fn of(payload: &Payload, name: &str) -> Option<(Option<u32>, Option<Value>)> {
    let metric = payload.metrics.iter().find(|metric| metric.name.as_deref() == Some(name))?;
    Some((metric.datatype, metric.value.clone()))
}

#[test]
fn claim_bd_seq_is_one_int64_in_will_birth_and_death() {
    let broker = TestBroker::start();
    let mut session = begun(&broker, 255);
    session.birth().expect("born");
    session.end();
    let Packet::Connect(connect) = broker.packet() else { panic!("no CONNECT first") };
    let will = connect.last_will.expect("a will");
    let (_, _, _, birth) = broker.message();
    let (kind, _, _, death) = broker.message();
    assert_eq!((will.topic.as_str(), kind.as_str()), ("spBv1.0/g/NDEATH/e", "NDEATH"));
    for payload in [Payload::decode(&will.message[..]).expect("a payload"), birth, death] {
        assert_eq!(of(&payload, "bdSeq"), Some((Some(datatype::INT64), Some(Value::Long(255)))));
    }
    assert_eq!(broker.packet(), Packet::Disconnect, "behind the death");
}

#[test]
fn claim_will_and_deaths_are_as_short_and_sent_as_they_must_be() {
    let broker = TestBroker::start();
    begun(&broker, 0).end();
    let Packet::Connect(connect) = broker.packet() else { panic!("no CONNECT first") };
    assert!(connect.clean_session);
    let will = connect.last_will.expect("a will");
    assert_eq!((will.qos, will.retain), (QoS::AtLeastOnce, false));
    let (_, _, publish, death) = broker.message();
    for payload in [Payload::decode(&will.message[..]).expect("a payload"), death] {
        assert_eq!((payload.seq, payload.metrics.len()), (None, 1));
    }
    assert!(!publish.retain);
}

#[test]
fn claim_commands_are_subscribed_to_before_the_birth() {
    let broker = TestBroker::start();
    let mut session = begun(&broker, 0);
    session.birth().expect("born");
    let mut wanted = Vec::new();
    loop {
        match broker.packet() {
            Packet::Subscribe(subscribe) => wanted.extend(subscribe.filters),
            Packet::Publish(_) => break,
            _ => {}
        }
    }
    let wanted: Vec<_> = wanted.into_iter().map(|filter| (filter.path, filter.qos)).collect();
    let topics = ["spBv1.0/g/NCMD/e", "spBv1.0/g/DCMD/e/+"];
    assert_eq!(wanted, topics.map(|topic| (topic.to_owned(), QoS::AtLeastOnce)));
}

#[test]
fn claim_births_name_type_and_value_every_metric_that_will_come() {
    let broker = TestBroker::start();
    let (mut session, mut devices) = (begun(&broker, 0), Devices::default());
    session.birth().expect("born");
    session.entry(0, &note("", Note::ClockJump), &mut devices).expect("sent");
    session.entry(1, &status("n"), &mut devices).expect("sent");
    let (mut named, mut aliases) = (BTreeSet::new(), BTreeSet::new());
    for kind in ["NBIRTH", "NDATA", "DBIRTH", "DDATA"] {
        let (came, _, publish, payload) = broker.message();
        assert_eq!((came.as_str(), publish.retain), (kind, false));
        assert!(payload.timestamp.is_some() && payload.metrics.iter().all(|metric| metric.timestamp.is_some()));
        for metric in payload.metrics {
            if kind.ends_with("BIRTH") {
                assert_eq!(publish.qos, QoS::AtMostOnce);
                assert!(metric.datatype.is_some() && metric.value.is_some() != metric.is_null.unwrap_or(false));
                named.insert(metric.name.expect("a name"));
                aliases.extend(metric.alias);
            } else if let Some(alias) = metric.alias {
                assert!(metric.name.is_none() && aliases.contains(&alias));
            } else {
                assert!(named.contains(&metric.name.expect("a name")));
            }
        }
    }
}

#[test]
fn claim_rebirth_is_offered_as_a_false_boolean_without_an_alias() {
    let broker = TestBroker::start();
    let mut session = begun(&broker, 0);
    session.birth().expect("born");
    let (_, _, _, birth) = broker.message();
    assert_eq!(of(&birth, "Node Control/Rebirth"), Some((Some(datatype::BOOLEAN), Some(Value::Boolean(false)))));
    assert!(birth.metrics.iter().all(|metric| metric.alias.is_none()));
}

#[test]
fn claim_sequence_numbers_go_on_by_one_over_all_kinds_and_go_round() {
    let broker = TestBroker::start();
    let (mut session, mut devices) = (begun(&broker, 0), Devices::default());
    session.birth().expect("born");
    let kinds = [Note::Connected, Note::Command, Note::Disconnected];
    for number in 0..240u64 {
        let node = if number % 5 == 0 { "" } else { "n" };
        session.entry(number, &note(node, kinds[number as usize % 3]), &mut devices).expect("sent");
        while session.room() == 0 {
            session.step(Duration::from_secs(20)).expect("goes on");
        }
    }
    session.birth().expect("born again");
    let (kind, _, _, first) = broker.message();
    assert_eq!((kind.as_str(), first.seq), ("NBIRTH", Some(0)));
    let (mut expected, mut seen) = (1, BTreeSet::new());
    loop {
        let (kind, _, _, payload) = broker.message();
        if kind == "NBIRTH" {
            assert_eq!(payload.seq, Some(0));
            break;
        }
        assert_eq!(payload.seq, Some(expected % 256), "{kind}");
        seen.insert(kind);
        expected += 1;
    }
    assert!(expected > 256, "round once");
    assert_eq!(seen.iter().map(String::as_str).collect::<Vec<_>>(), ["DBIRTH", "DDATA", "DDEATH", "NDATA"]);
}

#[test]
fn claim_aliases_are_unique_over_the_edge_node_and_stay_over_rebirths() {
    let broker = TestBroker::start();
    let (mut session, mut devices) = (begun(&broker, 0), Devices::default());
    let mut owners: BTreeMap<u64, (String, String)> = BTreeMap::new();
    // The other way round at the second time, and one more.
    for nodes in [["a", "b", "c"], ["d", "b", "a"]] {
        session.birth().expect("born");
        devices.unborn();
        for node in nodes {
            session.entry(0, &status(node), &mut devices).expect("sent");
            let (_, device, _, birth) =
                std::iter::repeat_with(|| broker.message()).find(|(kind, ..)| kind == "DBIRTH").expect("a birth");
            for metric in birth.metrics {
                let owner = (device.clone().expect("a device"), metric.name.expect("a name"));
                let former = owners.insert(metric.alias.expect("an alias"), owner.clone());
                assert!(former.as_ref().is_none_or(|former| *former == owner), "{former:?}, then {owner:?}");
            }
            let (kind, _, _, data) = broker.message();
            let known = |alias| owners.get(&alias).is_some_and(|(owner, _)| owner == node);
            assert!(kind == "DDATA" && data.metrics.iter().all(|metric| metric.alias.is_some_and(known)));
        }
    }
}

#[test]
fn claim_a_connecting_node_is_born_once_and_its_birth_says_what_is_known() {
    let broker = TestBroker::start();
    let (mut session, mut devices) = (begun(&broker, 0), Devices::default());
    session.birth().expect("born");
    let entries = [note("n", Note::Connected), status("n"), note("n", Note::Disconnected), note("n", Note::Replaced)];
    for (number, entry) in (5..).zip(entries.iter().chain([&note("n", Note::Connected), &status("n")])) {
        session.entry(number, entry, &mut devices).expect("sent");
    }
    assert_eq!(broker.kinds(1), ["NBIRTH"]);
    let (kind, _, _, birth) = broker.message();
    assert_eq!(kind, "DBIRTH");
    assert_eq!(of(&birth, "Node/Firmware").and_then(|(_, value)| value), Some(Value::Text("1.2.3".to_owned())));
    assert_eq!(of(&birth, "Frame/Journal").and_then(|(_, value)| value), Some(Value::Long(5)));
    let rest = ["DDATA n", "DDATA n", "DDEATH n", "DBIRTH n", "DDATA n", "DDATA n"];
    assert_eq!(broker.kinds(6), rest);
}

#[test]
fn fault_an_entry_that_went_with_a_birth_alone_counts_as_taken_only_with_the_next_acknowledged_one() {
    let broker = TestBroker::start();
    let (mut session, mut devices) = (begun(&broker, 0), Devices::default());
    session.birth().expect("born");
    let passed = |session: &mut Session, patience| loop {
        match session.step(Duration::from_millis(patience)).expect("goes on") {
            Some(Step::Acknowledged(next)) => return Some(next),
            Some(_) => {}
            None => return None,
        }
    };
    let room = session.room();
    session.entry(3, &note("n", Note::Connected), &mut devices).expect("sent");
    assert_eq!((passed(&mut session, 100), session.room()), (None, room), "nothing acknowledged, no room taken");
    session.entry(4, &status("n"), &mut devices).expect("sent");
    assert_eq!(passed(&mut session, 20_000), Some(5));
}

#[test]
fn claim_what_came_before_the_birth_is_historical_also_where_the_birth_waited_in_the_session() {
    let broker = TestBroker::start();
    let (mut session, mut devices) = (begun(&broker, 0), Devices::default());
    let before = Entry { received_us: crate::clock::wall_us(), ..status("n") };
    // Longer than what counts as at once.
    std::thread::sleep(Duration::from_millis(1200));
    session.birth().expect("born");
    session.entry(0, &before, &mut devices).expect("sent");
    session.entry(1, &status("n"), &mut devices).expect("sent");
    let historical = || loop {
        let (kind, _, _, payload) = broker.message();
        if kind == "DDATA" {
            return payload.metrics.iter().all(|metric| metric.is_historical == Some(true));
        }
    };
    assert_eq!([historical(), historical()], [true, false]);
}

#[test]
fn claim_topics_timestamps_and_properties_have_the_form_that_is_asked_for() {
    let broker = TestBroker::start();
    let (mut session, mut devices) = (begun(&broker, 0), Devices::default());
    let begin_ms = crate::clock::wall_us() / 1000;
    session.birth().expect("born");
    let entries = [note("", Note::ClockJump), note("n", Note::Connected), status("n"), note("n", Note::Disconnected)];
    for (number, entry) in (0..).zip(&entries) {
        session.entry(number, entry, &mut devices).expect("sent");
    }
    for topic in ["NBIRTH/e", "NDATA/e", "DBIRTH/e/n", "DDATA/e/n", "DDATA/e/n", "DDEATH/e/n"] {
        let (kind, _, publish, payload) = broker.message();
        assert_eq!(publish.topic, format!("spBv1.0/g/{topic}"));
        assert!(!publish.retain && (publish.qos == QoS::AtLeastOnce) == kind.ends_with("DATA"), "{topic}");
        // Milliseconds, UTC: of just now.
        let sent_ms = payload.timestamp.expect("when it was sent") as i64;
        assert!((begin_ms..=crate::clock::wall_us() / 1000).contains(&sent_ms), "{topic}");
        for metric in payload.metrics {
            let stamp_ms = metric.timestamp.expect("of every metric");
            // The entries are of a second behind 1970; births and the edge node's own metrics are of now.
            assert!(stamp_ms == 1000 || stamp_ms as i64 >= begin_ms, "{topic}: {stamp_ms}");
            let kinds = [3, 4, 7, 8, 9, 11, 12, 17];
            assert!(metric.datatype.is_some_and(|kind| kinds.contains(&kind)), "{:?}", metric.datatype);
            let Some(properties) = metric.properties else { continue };
            assert_eq!(properties.keys.len(), properties.values.len());
            for (key, value) in properties.keys.iter().zip(&properties.values) {
                match key.as_str() {
                    "Quality" => {
                        assert_eq!((value.kind, &value.text), (Some(datatype::INT32), &None));
                        assert!(value.int.is_some_and(|code| [0, 192, 500].contains(&code)), "{value:?}");
                    }
                    "engUnit" => {
                        assert_eq!((value.kind, value.int), (Some(datatype::STRING), None));
                        assert!(value.text.as_ref().is_some_and(|unit| !unit.is_empty()));
                    }
                    other => panic!("an unknown property {other}"),
                }
            }
        }
    }
}

/// The table, and the sources that its tests are in.
const TABLE: &str = include_str!("../../../book/src/reference/sparkplug.md");
const SOURCES: [&str; 5] = [
    include_str!("conformance.rs"),
    include_str!("conformance_host.rs"),
    include_str!("metrics.rs"),
    include_str!("primary.rs"),
    include_str!("../config.rs"),
];

#[test]
fn claim_every_statement_of_the_specification_stands_once_in_the_table_and_its_test_is_there() {
    let rows: Vec<(&str, &str)> = TABLE.lines().filter_map(|line| line.strip_prefix("| ")?.split_once(" | ")).collect();
    let named = || rows.iter().flat_map(|(ids, _)| ids.split(", "));
    let holds = |row: &str, id: &str| match row.strip_suffix("\\*") {
        Some(begin) => id.starts_with(begin),
        None => id == row,
    };
    for id in include_str!("statements.txt").lines() {
        assert_eq!(named().filter(|row| holds(row, id)).count(), 1, "{id}");
    }
    for (ids, proof) in &rows {
        for test in proof.split('`').skip(1).step_by(2).filter(|word| word.starts_with("claim_")) {
            let begin = test.trim_end_matches("...");
            let found = SOURCES.iter().any(|source| source.contains(&format!("fn {begin}")));
            assert!(found, "{ids}: no test {test}");
        }
    }
}
