//! A broker for tests: one client at a time on 127.0.0.1. It acknowledges, keeps retained messages, and tells what
//! came, in order.

use super::payload::Payload;
use crate::config::Broker;
use prost::Message;
use rumqttc::{ConnAck, ConnectReturnCode, Packet, PubAck, Publish, QoS, SubAck, SubscribeReasonCode};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Time after which a packet that does not come is a failed test.
const PATIENCE: Duration = Duration::from_secs(20);
/// Longest packet, bytes.
const LONGEST: usize = 1 << 20;

#[derive(Default)]
struct Shared {
    client: Mutex<Option<TcpStream>>,
    retained: Mutex<Vec<(String, String)>>,
    silent: AtomicBool,
}

/// The broker and what it received.
pub struct TestBroker {
    /// Its port.
    pub port: u16,
    packets: Receiver<Packet>,
    shared: Arc<Shared>,
}

impl TestBroker {
    /// Listens on a free port.
    pub fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let port = listener.local_addr().expect("an address").port();
        let (sender, packets) = channel();
        let shared = Arc::<Shared>::default();
        let held = Arc::clone(&shared);
        std::thread::spawn(move || {
            for stream in listener.incoming().map_while(Result::ok) {
                // A client that goes away in between is the test's own; the other end of its stream is ended with it.
                let _ = stream.try_clone().and_then(|end| {
                    serve(stream, &sender, &held).and_then(|()| end.shutdown(std::net::Shutdown::Both))
                });
            }
        });
        Self { port, packets, shared }
    }

    /// A configuration that leads here.
    pub fn config(&self) -> Broker {
        let text = format!("host = \"127.0.0.1\"\nport = {}\ngroup = \"g\"", self.port);
        toml::from_str(&text).expect("a configuration")
    }

    /// The next packet of a client.
    pub fn packet(&self) -> Packet {
        self.packets.recv_timeout(PATIENCE).expect("a packet")
    }

    /// The next message: its kind, its device where it has one, how it was sent, and what it says.
    pub fn message(&self) -> (String, Option<String>, Publish, Payload) {
        loop {
            if let Packet::Publish(publish) = self.packet() {
                let parts: Vec<&str> = publish.topic.split('/').collect();
                let (kind, device) = (parts[2].to_owned(), parts.get(4).map(|&part| part.to_owned()));
                let payload = Payload::decode(&publish.payload[..]).expect("a payload");
                return (kind, device, publish, payload);
            }
        }
    }

    /// Kinds of so many messages, with their devices.
    pub fn kinds(&self, count: usize) -> Vec<String> {
        let said = |(kind, device, ..): (String, Option<String>, _, _)| match device {
            Some(device) => format!("{kind} {device}"),
            None => kind,
        };
        (0..count).map(|_| said(self.message())).collect()
    }

    /// Sends a message to the client, and to all that subscribe to its topic later.
    pub fn retain(&self, topic: &str, text: &str) {
        self.shared.retained.lock().expect("whole").push((topic.to_owned(), text.to_owned()));
        self.send(topic, text.as_bytes());
    }

    /// Sends a message to the client, where there is one.
    pub fn send(&self, topic: &str, bytes: &[u8]) {
        let mut client = self.shared.client.lock().expect("whole");
        if let Some(stream) = client.as_mut() {
            write(stream, &Packet::Publish(Publish::new(topic, QoS::AtMostOnce, bytes))).expect("sent");
        }
    }

    /// Whether data is acknowledged.
    pub fn acknowledge(&self, whether: bool) {
        self.shared.silent.store(!whether, Ordering::SeqCst);
    }
}

fn serve(mut stream: TcpStream, sender: &Sender<Packet>, shared: &Shared) -> std::io::Result<()> {
    loop {
        let packet = read(&mut stream)?;
        let answer = match &packet {
            Packet::Connect(_) => Some(Packet::ConnAck(ConnAck::new(ConnectReturnCode::Success, false))),
            Packet::Subscribe(subscribe) => {
                let granted = SubscribeReasonCode::Success(QoS::AtLeastOnce);
                Some(Packet::SubAck(SubAck::new(subscribe.pkid, vec![granted; subscribe.filters.len()])))
            }
            Packet::Publish(publish) if publish.qos == QoS::AtLeastOnce && !shared.silent.load(Ordering::SeqCst) => {
                Some(Packet::PubAck(PubAck::new(publish.pkid)))
            }
            Packet::PingReq => Some(Packet::PingResp),
            _ => None,
        };
        let mut client = shared.client.lock().expect("whole");
        if let Some(answer) = answer {
            write(&mut stream, &answer)?;
        }
        match &packet {
            Packet::Connect(_) => *client = Some(stream.try_clone()?),
            Packet::Subscribe(subscribe) => {
                let newest =
                    |path: &str| shared.retained.lock().expect("whole").iter().rfind(|(to, _)| to == path).cloned();
                for (topic, text) in subscribe.filters.iter().filter_map(|filter| newest(&filter.path)) {
                    write(&mut stream, &Packet::Publish(Publish::new(topic, QoS::AtMostOnce, text)))?;
                }
            }
            _ => {}
        }
        drop(client);
        let over = packet == Packet::Disconnect;
        if sender.send(packet).is_err() || over {
            return Ok(());
        }
    }
}

fn write(stream: &mut TcpStream, packet: &Packet) -> std::io::Result<()> {
    let mut bytes = Default::default();
    packet.write(&mut bytes, LONGEST).map_err(std::io::Error::other)?;
    stream.write_all(&bytes)
}

/// One packet: its first byte, its length in up to four bytes of seven bits, and the rest.
fn read(stream: &mut TcpStream) -> std::io::Result<Packet> {
    let mut bytes = vec![0; 2];
    stream.read_exact(&mut bytes)?;
    while bytes[bytes.len() - 1] & 0x80 != 0 {
        let mut more = [0];
        stream.read_exact(&mut more)?;
        bytes.push(more[0]);
    }
    let length = bytes[1..].iter().rev().fold(0, |length, byte| length << 7 | usize::from(byte & 0x7f));
    let head = bytes.len();
    bytes.resize(head + length, 0);
    stream.read_exact(&mut bytes[head..])?;
    Packet::read(&mut bytes.into_iter().collect(), LONGEST).map_err(std::io::Error::other)
}
