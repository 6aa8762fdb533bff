//! One connection to the broker: births, data in the journal's order, deaths.
//!
//! Data goes with quality of service 1, where Sparkplug asks for 0: without acknowledgement a broker that dies loses
//! what was on its way, and the journal would not know. A host application sees no difference. Sequence numbers,
//! births before data and the will with `bdSeq` are as specified.

use super::commands;
use super::metrics::{Device, Devices};
use super::payload::{Metric, Payload, Quality, Value, datatype, properties};
use crate::config::Broker;
use crate::error::{Error, Result};
use crate::journal::entry::{Body, Entry, Note};
use prost::Message;
use rumqttc::{
    Client, Connection, ConnectionError, Event, Incoming, LastWill, MqttOptions, Outgoing, QoS, TlsConfiguration,
    Transport,
};
use std::collections::{HashMap, VecDeque};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// Data messages on their way at most.
pub const WINDOW: usize = 100;
/// How long the broker may take to accept a session.
const ACCEPTANCE: Duration = Duration::from_secs(10);
/// Time from reception to birth that does not make a value historical, microseconds.
const AT_ONCE_US: i64 = 1_000_000;
/// First part of all topics.
pub const NAMESPACE: &str = "spBv1.0";
/// How a refusal by the broker itself is said, unlike one by the network.
pub const REFUSED: &str = "refused the session";

/// A session with the broker.
pub struct Session {
    client: Client,
    events: Receiver<std::result::Result<Event, String>>,
    group: String,
    edge: String,
    bd_seq: u8,
    seq: u8,
    /// Numbers published, oldest first, that have no packet identifier yet.
    unnamed: VecDeque<u64>,
    /// Numbers by packet identifier.
    named: HashMap<u16, u64>,
    /// Numbers on their way, ascending.
    on_way: VecDeque<OnWay>,
    /// Wall clock at the newest birth: what came before it, comes late.
    born_us: i64,
}

/// An entry that was published.
struct OnWay {
    number: u64,
    acknowledged: bool,
    /// It went with a birth, which no broker acknowledges: a later entry's acknowledgement says that it arrived.
    in_birth: bool,
}

/// What became of a look at the connection.
pub enum Step {
    /// A message: topic and payload.
    Message(String, Vec<u8>),
    /// Acknowledged up to, not including, this number.
    Acknowledged(u64),
    /// Something else.
    Other,
}

impl Session {
    /// Connects, with the death certificate as the will, waits for the broker's word, and subscribes to commands: a
    /// host may ask for a rebirth from the first birth on.
    ///
    /// # Errors
    /// Why there is no session, in one line.
    pub fn begin(config: &Broker, edge: &str, bd_seq: u8) -> Result<Self> {
        let options = options(config, edge, bd_seq)?;
        let (client, connection) = Client::new(options, 4 * WINDOW);
        let events = listen(connection);
        let place = format!("broker {}", config.host);
        let deadline = Instant::now() + ACCEPTANCE;
        loop {
            match events.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
                Ok(Ok(Event::Incoming(Incoming::ConnAck(_)))) => break,
                Ok(Ok(_)) => {}
                Ok(Err(reason)) => return Err(Error::new(place, reason)),
                Err(_) => return Err(Error::new(place, "does not answer")),
            }
        }
        for (kind, below) in [("NCMD", ""), ("DCMD", "/+")] {
            let topic = format!("{NAMESPACE}/{}/{kind}/{edge}{below}", config.group);
            client.subscribe(topic, QoS::AtLeastOnce).map_err(ended)?;
        }
        Ok(Self {
            client,
            events,
            group: config.group.clone(),
            edge: edge.to_owned(),
            bd_seq,
            seq: 0,
            unnamed: VecDeque::new(),
            named: HashMap::new(),
            on_way: VecDeque::new(),
            born_us: crate::clock::wall_us(),
        })
    }

    /// Subscribes to one topic more.
    ///
    /// # Errors
    /// When the connection has ended.
    pub fn watch(&self, topic: &str) -> Result {
        self.client.subscribe(topic, QoS::AtLeastOnce).map_err(ended)
    }

    /// Birth of the edge node.
    ///
    /// # Errors
    /// When the connection has ended.
    pub fn birth(&mut self) -> Result {
        self.seq = 0;
        self.born_us = crate::clock::wall_us();
        let metrics = vec![
            plain("bdSeq", datatype::INT64, Value::Long(self.bd_seq.into())),
            plain("Node Control/Rebirth", datatype::BOOLEAN, Value::Boolean(false)),
            plain("Gateway/Version", datatype::STRING, Value::Text(env!("CARGO_PKG_VERSION").to_owned())),
            plain("Frame/Journal", datatype::UINT64, Value::Long(0)),
            plain("Event/Kind", datatype::STRING, Value::Text(String::new())),
            plain("Event/Detail", datatype::INT64, Value::Long(0)),
        ];
        self.publish("NBIRTH", None, metrics, QoS::AtMostOnce)
    }

    /// Birth of a device.
    ///
    /// # Errors
    /// When the connection has ended.
    pub fn device_birth(&mut self, name: &str, device: &mut Device) -> Result {
        device.born = true;
        self.publish("DBIRTH", Some(name), device.birth(now_ms()), QoS::AtMostOnce)
    }

    /// Publishes an entry; a device's birth before and its death behind where the entry says so.
    ///
    /// # Errors
    /// When the connection has ended.
    pub fn entry(&mut self, number: u64, entry: &Entry, devices: &mut Devices) -> Result {
        if entry.node.is_empty() {
            let Body::Note { kind, detail, .. } = &entry.body else { return Ok(()) };
            let metrics = vec![
                plain("Frame/Journal", datatype::UINT64, Value::Long(number)),
                plain("Event/Kind", datatype::STRING, Value::Text(format!("{kind:?}"))),
                plain("Event/Detail", datatype::INT64, Value::Long(*detail as u64)),
            ];
            return self.data("NDATA", None, number, metrics);
        }
        let device = devices.device(&entry.node);
        let historical = entry.received_us < self.born_us - AT_ONCE_US;
        if !device.born {
            if matches!(entry.body, Body::Note { kind: Note::Connected | Note::Replaced, .. }) {
                // The birth says all that the note says; a second one would look like a defect to a host.
                device.take(number, entry, historical);
                self.on_way.push_back(OnWay { number, acknowledged: false, in_birth: true });
                return self.device_birth(&entry.node, device);
            }
            self.device_birth(&entry.node, device)?;
        }
        let metrics = device.take(number, entry, historical);
        self.data("DDATA", Some(&entry.node), number, metrics)?;
        if matches!(entry.body, Body::Note { kind: Note::Disconnected, .. }) {
            device.born = false;
            self.publish("DDEATH", Some(&entry.node), Vec::new(), QoS::AtMostOnce)?;
        }
        Ok(())
    }

    fn data(&mut self, kind: &str, device: Option<&str>, number: u64, metrics: Vec<Metric>) -> Result {
        self.unnamed.push_back(number);
        self.on_way.push_back(OnWay { number, acknowledged: false, in_birth: false });
        self.publish(kind, device, metrics, QoS::AtLeastOnce)
    }

    /// Room for data messages.
    pub fn room(&self) -> usize {
        WINDOW.saturating_sub(self.on_way.iter().filter(|on_way| !on_way.in_birth).count())
    }

    /// Looks at the connection, waiting at most so long; `None` when nothing came.
    ///
    /// # Errors
    /// When the connection has ended.
    pub fn step(&mut self, patience: Duration) -> Result<Option<Step>> {
        match self.events.recv_timeout(patience) {
            Ok(Ok(event)) => Ok(Some(self.event(event))),
            Ok(Err(reason)) => Err(Error::new("broker", reason)),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(Error::new("broker", "the connection has ended")),
        }
    }

    fn event(&mut self, event: Event) -> Step {
        match event {
            Event::Outgoing(Outgoing::Publish(id)) if id != 0 => {
                if let Some(number) = self.unnamed.pop_front() {
                    self.named.insert(id, number);
                }
            }
            Event::Incoming(Incoming::PubAck(ack)) => {
                let Some(number) = self.named.remove(&ack.pkid) else { return Step::Other };
                for on_way in self.on_way.iter_mut().take_while(|on_way| on_way.number <= number) {
                    on_way.acknowledged |= on_way.in_birth || on_way.number == number;
                }
                let mut passed = None;
                while let Some(on_way) = self.on_way.pop_front_if(|on_way| on_way.acknowledged) {
                    passed = Some(on_way.number + 1);
                }
                return passed.map_or(Step::Other, Step::Acknowledged);
            }
            Event::Incoming(Incoming::Publish(publish)) => {
                return Step::Message(publish.topic, publish.payload.to_vec());
            }
            _ => {}
        }
        Step::Other
    }

    /// Ends the session on purpose: a will is not sent then, so the death certificate is.
    pub fn end(mut self) {
        let death = death(self.bd_seq);
        let topic = format!("{NAMESPACE}/{}/NDEATH/{}", self.group, self.edge);
        // The broker may have gone just now; then its will is due anyway.
        let _ = self.client.publish(topic, QoS::AtMostOnce, false, death);
        let _ = self.client.disconnect();
        let deadline = Instant::now() + Duration::from_secs(2);
        while Instant::now() < deadline && self.step(Duration::from_millis(50)).is_ok() {}
    }

    fn publish(&mut self, kind: &str, device: Option<&str>, metrics: Vec<Metric>, qos: QoS) -> Result {
        let below = device.map(|device| format!("/{device}")).unwrap_or_default();
        let topic = format!("{NAMESPACE}/{}/{kind}/{}{below}", self.group, self.edge);
        let payload = Payload { timestamp: Some(now_ms()), metrics, seq: Some(self.seq.into()) };
        self.seq = self.seq.wrapping_add(1);
        self.client.publish(topic, qos, false, payload.encode_to_vec()).map_err(ended)
    }
}

/// Reads a command message of this session.
pub fn commands(topic: &str, bytes: &[u8], config: &Broker, devices: &Devices) -> Vec<commands::Command> {
    commands::read(topic, bytes, config.allow_configure, devices)
}

fn plain(name: &str, kind: u32, value: Value) -> Metric {
    Metric {
        name: Some(name.to_owned()),
        timestamp: Some(now_ms()),
        datatype: Some(kind),
        properties: Some(properties("", Quality::Good)),
        value: Some(value),
        ..Metric::default()
    }
}

fn now_ms() -> u64 {
    u64::try_from(crate::clock::wall_us() / 1000).unwrap_or(0)
}

fn death(bd_seq: u8) -> Vec<u8> {
    let metrics = vec![plain("bdSeq", datatype::INT64, Value::Long(bd_seq.into()))];
    Payload { timestamp: Some(now_ms()), metrics, seq: None }.encode_to_vec()
}

fn ended(_: rumqttc::ClientError) -> Error {
    Error::new("broker", "the connection has ended")
}

fn options(config: &Broker, edge: &str, bd_seq: u8) -> Result<MqttOptions> {
    let port = config.port.unwrap_or(if config.tls_ca.is_some() { 8883 } else { 1883 });
    let mut options = MqttOptions::new(format!("{}/{edge}", config.group), &config.host, port);
    options.set_keep_alive(Duration::from_secs(20)).set_clean_session(true);
    options.set_max_packet_size(1 << 20, 1 << 20).set_inflight(WINDOW as u16);
    let will = format!("{NAMESPACE}/{}/NDEATH/{edge}", config.group);
    options.set_last_will(LastWill::new(will, death(bd_seq), QoS::AtLeastOnce, false));
    if let Some(user) = &config.user {
        let password = match &config.password_file {
            Some(path) => crate::error::at(path, std::fs::read_to_string(path))?.trim_end().to_owned(),
            None => String::new(),
        };
        options.set_credentials(user, password);
    }
    if let Some(path) = &config.tls_ca {
        let read = |path: &std::path::Path| crate::error::at(path, std::fs::read(path));
        let client_auth = match (&config.tls_cert, &config.tls_key) {
            (Some(certificate), Some(key)) => Some((read(certificate)?, read(key)?)),
            _ => None,
        };
        let tls = TlsConfiguration::Simple { ca: read(path)?, alpn: None, client_auth };
        options.set_transport(Transport::tls_with_config(tls));
    }
    Ok(options)
}

/// A thread of its own for the connection: its loop must not wait for ours.
fn listen(mut connection: Connection) -> Receiver<std::result::Result<Event, String>> {
    let (sender, events) = channel();
    std::thread::spawn(move || {
        for event in connection.iter() {
            let ended = event.is_err();
            let event = event.map_err(|reason| match reason {
                ConnectionError::ConnectionRefused(code) => format!("{REFUSED}: {code:?}"),
                other => other.to_string(),
            });
            if sender.send(event).is_err() || ended {
                return;
            }
        }
    });
    events
}

/// One provider of TLS mathematics for the process.
pub fn prepare_tls() {
    // A second call finds the first one's provider.
    let _ = rustls::crypto::ring::default_provider().install_default();
}
