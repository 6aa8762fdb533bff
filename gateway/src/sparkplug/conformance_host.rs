//! What a host application and a conformance kit see of the broker's thread: the primary host's state, rebirths and
//! commands. The table in book/src/howto/fleet.md names these tests.

use super::payload::{Metric, Payload, Value};
use super::publisher::{Nodes, Publisher};
use super::test_broker::TestBroker;
use crate::health::Health;
use crate::intake::{News, Report};
use crate::journal::Journal;
use crate::journal::cursor::Cursor;
use crate::journal::entry::{Body, Entry, Note};
use crate::stop::Stop;
use meshband::message::Request;
use prost::Message;
use rumqttc::Packet;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

const STATE: &str = "spBv1.0/STATE/scada 1";
/// Time after which what does not come is a failed test.
const PATIENCE: Duration = Duration::from_secs(20);

/// A broker's thread with two nodes, `a` and `b`, that answer.
struct Running {
    broker: TestBroker,
    journal: Journal,
    data: PathBuf,
    stop: Stop,
    thread: JoinHandle<()>,
    requests: [Receiver<Request>; 2],
    reports: Receiver<Report>,
    written: u64,
}

impl Running {
    fn start(name: &str, primary_host: Option<&str>) -> Self {
        let data = std::env::temp_dir().join(format!("meshband-host-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&data);
        let journal = Journal::open(&data.join("journal"), 0).expect("opens");
        // The first session has the number 255, the next one 0.
        std::fs::write(data.join("bdseq"), "254").expect("writes");
        let (broker, stop) = (TestBroker::start(), Stop::default());
        let (health, (to_a, of_a), (to_b, of_b), (reports, reported)) =
            (Arc::<Health>::default(), channel(), channel(), channel());
        ["a", "b"].iter().for_each(|node| health.node(node, |node| node.online = true));
        let mut config = broker.config();
        config.primary_host = primary_host.map(str::to_owned);
        let publisher = Publisher {
            config,
            edge: "e".into(),
            cursor: Cursor::open(&data, "broker").expect("opens"),
            data: data.clone(),
            passed: Arc::default(),
            nodes: Nodes::from([("a".into(), (0, to_a)), ("b".into(), (1, to_b))]),
            reports,
            health,
            start: Instant::now(),
            stop: stop.clone(),
        };
        let thread = std::thread::spawn(move || publisher.run());
        Self { broker, journal, data, stop, thread, requests: [of_a, of_b], reports: reported, written: 0 }
    }

    /// A note of a node in the journal.
    fn note(&mut self, node: &str) {
        let body = Body::Note { kind: Note::Command, detail: self.written as i64, text: String::new() };
        let (node, machine) = (node.to_owned(), "m".to_owned());
        let entry = Entry { node, machine, unit: [0; 3], boot: 1, received_us: i64::MAX / 2, time_us: 0, body };
        self.journal.append(&[entry]).expect("writes");
        self.written += 1;
    }

    /// Reads up to the subscription to a topic.
    fn subscribed(&self, topic: &str) {
        while !matches!(self.broker.packet(), Packet::Subscribe(s) if s.filters.iter().any(|f| f.path == topic)) {}
    }

    /// The host says what it is.
    fn state(&self, online: bool, timestamp: u64) {
        self.broker.retain(STATE, &format!("{{\"online\":{online},\"timestamp\":{timestamp}}}"));
    }

    fn command(&self, topic: &str, metric: Metric) {
        self.broker.send(topic, &Payload { timestamp: Some(1), metrics: vec![metric], seq: None }.encode_to_vec());
    }

    fn end(self) {
        self.stop.ask();
        self.thread.join().expect("ended");
        let _ = std::fs::remove_dir_all(&self.data);
    }
}

/// The births of both nodes' edge node; gives `bdSeq`.
fn births(running: &Running) -> Option<Value> {
    let (kind, _, _, birth) = running.broker.message();
    assert_eq!((kind.as_str(), birth.seq), ("NBIRTH", Some(0)));
    assert_eq!(running.broker.kinds(2), ["DBIRTH a", "DBIRTH b"]);
    birth.metrics.into_iter().find(|metric| metric.name.as_deref() == Some("bdSeq"))?.value
}

fn truth(name: Option<&str>, alias: Option<u64>) -> Metric {
    Metric { name: name.map(str::to_owned), alias, value: Some(Value::Boolean(true)), ..Metric::default() }
}

#[test]
fn claim_births_wait_for_the_primary_host_and_an_offline_host_ends_the_session_without_loss() {
    let mut running = Running::start("primary", Some("scada 1"));
    running.note("a");
    running.subscribed(STATE);
    // None of these is the host being online; had one been taken for it, the offline one behind it would bring a death.
    running.broker.send("spBv1.0/STATE/other", b"{\"online\":true,\"timestamp\":90}");
    running.broker.send(STATE, b"{\"online\":\"true\",\"timestamp\":91}");
    running.broker.send(STATE, b"ONLINE");
    running.command("spBv1.0/g/NCMD/e", truth(Some("Node Control/Rebirth"), None));
    running.state(false, 50);
    running.state(true, 10);
    running.state(false, 60);
    running.state(true, 100);
    assert_eq!(births(&running), Some(Value::Long(255)));
    assert_eq!(running.broker.kinds(1), ["DDATA a"]);
    // Of a former session of the host, delivered late.
    running.state(false, 99);
    running.note("b");
    assert_eq!(running.broker.kinds(1), ["DDATA b"]);
    running.state(false, 100);
    assert_eq!(running.broker.kinds(1), ["NDEATH"]);
    assert_eq!(running.broker.packet(), Packet::Disconnect);
    // Kept while the host is away.
    running.note("a");
    running.subscribed(STATE);
    running.state(true, 99);
    running.state(false, 101);
    running.state(true, 200);
    assert_eq!(births(&running), Some(Value::Long(0)), "of the new connection's will");
    assert_eq!(running.broker.kinds(1), ["DDATA a"]);
    running.end();
}

#[test]
fn fault_data_that_was_not_acknowledged_when_the_host_went_offline_comes_again() {
    let mut running = Running::start("again", Some("scada 1"));
    running.subscribed(STATE);
    running.state(true, 1);
    births(&running);
    running.broker.acknowledge(false);
    running.note("a");
    assert_eq!(running.broker.kinds(1), ["DDATA a"]);
    running.state(false, 2);
    running.broker.acknowledge(true);
    assert_eq!(running.broker.kinds(1), ["NDEATH"]);
    running.subscribed(STATE);
    running.state(true, 3);
    births(&running);
    assert_eq!(running.broker.kinds(1), ["DDATA a"]);
    running.end();
}

#[test]
fn claim_a_rebirth_request_gives_all_births_again_under_the_same_bd_seq() {
    let mut running = Running::start("rebirth", None);
    let first = births(&running);
    running.note("a");
    assert_eq!(running.broker.kinds(1), ["DDATA a"]);
    running.command("spBv1.0/g/NCMD/e", truth(Some("Node Control/Rebirth"), None));
    assert_eq!((births(&running), first), (Some(Value::Long(255)), Some(Value::Long(255))));
    running.note("a");
    assert_eq!(running.broker.kinds(1), ["DDATA a"]);
    running.end();
}

#[test]
fn claim_commands_of_a_device_are_known_by_name_and_by_its_own_alias_alone() {
    let running = Running::start("alias", None);
    let mut stop = Vec::new();
    while stop.len() < 2 {
        let (kind, _, _, payload) = running.broker.message();
        let named = |metric: &&Metric| metric.name.as_deref() == Some("Command/Stop");
        if kind == "DBIRTH" {
            stop.push(payload.metrics.iter().find(named).and_then(|metric| metric.alias).expect("an alias"));
        }
    }
    running.command("spBv1.0/g/DCMD/e/a", truth(None, Some(stop[1])));
    let refused = running.reports.recv_timeout(PATIENCE).expect("a report");
    assert!(matches!(&refused.news, News::Command(text) if text.contains("refused")), "{refused:?}");
    running.command("spBv1.0/g/DCMD/e/b", truth(None, Some(stop[1])));
    assert_eq!(running.requests[1].recv_timeout(PATIENCE), Ok(Request::Stop));
    running.command("spBv1.0/g/DCMD/e/a", truth(Some("Command/Stop"), None));
    assert_eq!(running.requests[0].recv_timeout(PATIENCE), Ok(Request::Stop));
    assert!(running.requests.iter().all(|requests| requests.try_recv().is_err()), "nothing else");
    running.end();
}
