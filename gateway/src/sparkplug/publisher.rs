//! The broker's thread: keeps a session going, feeds it from the journal, and carries out commands.
//!
//! The place in the journal moves only over what the broker has acknowledged. After a break everything behind it is
//! published again: in order, nothing lost, and what the broker already had comes a second time with the same
//! `Frame/Journal`. A broker that refuses the credentials is asked again ever more rarely; the journal and the
//! history go on meanwhile. So they do while a configured primary host is offline: nothing is born then.

use super::commands::Command;
use super::metrics::Devices;
use super::primary::PrimaryHost;
use super::session::{REFUSED, Session, Step, commands};
use crate::config::Broker;
use crate::error::{Error, Result};
use crate::health::Health;
use crate::intake::{News, Report};
use crate::journal::cursor::Cursor;
use crate::journal::reader::Reader;
use crate::stop::Stop;
use meshband::message::Request;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

/// Time between writings of the place in the journal.
const KEEPING: Duration = Duration::from_millis(200);

/// To each node, by name, with its index.
pub type Nodes = BTreeMap<String, (usize, Sender<Request>)>;

/// What stays known from one session to the next.
struct Known {
    devices: Devices,
    host: Option<PrimaryHost>,
    /// This session's births were published.
    born: bool,
}

/// Why a session ended on purpose.
enum Over {
    Stopping,
    HostOffline,
}

/// Everything the thread needs.
pub struct Publisher {
    /// Where to.
    pub config: Broker,
    /// The gateway's name.
    pub edge: String,
    /// The gateway's folder.
    pub data: PathBuf,
    /// Place in the journal.
    pub cursor: Cursor,
    /// The same for the journal's writer, who gives back what all have passed.
    pub passed: Arc<AtomicU64>,
    /// For commands.
    pub nodes: Nodes,
    /// To the journal.
    pub reports: Sender<Report>,
    /// Counters.
    pub health: Arc<Health>,
    /// Steady clock's zero.
    pub start: Instant,
    /// Request to stop.
    pub stop: Stop,
}

impl Publisher {
    /// Serves the broker until the gateway stops.
    pub fn run(mut self) {
        // Blocks of aliases in the configuration's order; what only the journal knows of comes behind.
        let mut names: Vec<_> = self.nodes.iter().map(|(name, (index, _))| (index, name)).collect();
        names.sort();
        let devices = Devices::of(names.into_iter().map(|(_, name)| name.as_str()));
        let host = self.config.primary_host.as_deref().map(PrimaryHost::new);
        let mut known = Known { devices, host, born: false };
        let mut pause = Duration::from_millis(500);
        let mut said = String::new();
        while !self.stop.asked() {
            let connected_before = self.health.broker_sessions.load(Ordering::Relaxed);
            let reason = match self.serve(&mut known) {
                Ok(()) => break,
                Err(reason) => reason.to_string(),
            };
            self.health.broker_connected.store(0, Ordering::Relaxed);
            if self.health.broker_sessions.load(Ordering::Relaxed) > connected_before {
                pause = Duration::from_millis(500);
                said.clear();
            }
            if reason.contains(REFUSED) {
                self.health.broker_refusals.fetch_add(1, Ordering::Relaxed);
            }
            if reason != said {
                eprintln!("{reason}; frames wait in the journal");
            }
            said = reason;
            self.stop.sleep(pause);
            pause = (pause * 2).min(Duration::from_secs(self.config.retry_seconds.max(1)));
        }
    }

    /// One session; `Ok` when the gateway stops.
    fn serve(&mut self, known: &mut Known) -> Result {
        let mut session = Session::begin(&self.config, &self.edge, self.next_bd_seq()?)?;
        eprintln!("broker {}: connected, {} entries wait", self.config.host, self.waiting());
        self.health.broker_connected.store(1, Ordering::Relaxed);
        self.health.broker_sessions.fetch_add(1, Ordering::Relaxed);
        known.born = false;
        known.devices.unborn();
        match &known.host {
            Some(host) => session.watch(&host.topic)?,
            None => self.births(&mut session, known)?,
        }
        let over = self.converse(&mut session, known);
        self.health.broker_born.store(0, Ordering::Relaxed);
        let over = over?;
        session.end();
        self.health.broker_connected.store(0, Ordering::Relaxed);
        match over {
            Over::Stopping => Ok(()),
            Over::HostOffline => Err(Error::new("primary host", "went offline")),
        }
    }

    /// Entries out, acknowledgements and messages in.
    fn converse(&mut self, session: &mut Session, known: &mut Known) -> Result<Over> {
        let mut reader = Reader::new(&self.data.join("journal"), self.cursor.next());
        let (mut place, mut missed, mut kept) = (self.cursor.next(), 0, Instant::now());
        let mut over = None;
        while over.is_none() && !self.stop.asked() {
            let entries = reader.take(if known.born { session.room() } else { 0 })?;
            let idle = entries.is_empty();
            for (number, entry) in entries {
                session.entry(number, &entry, &mut known.devices)?;
            }
            if reader.missed() > missed {
                self.health.broker_lost.fetch_add(reader.missed() - missed, Ordering::Relaxed);
                missed = reader.missed();
            }
            let mut patience = Duration::from_millis(if idle { 10 } else { 0 });
            while over.is_none()
                && let Some(step) = session.step(patience)?
            {
                match step {
                    Step::Acknowledged(next) => place = next,
                    Step::Message(topic, bytes) => over = self.hear(&topic, &bytes, session, known)?,
                    Step::Other => {}
                }
                patience = Duration::ZERO;
            }
            if kept.elapsed() > KEEPING {
                kept = Instant::now();
                self.keep(place)?;
            }
        }
        self.keep(place)?;
        Ok(over.unwrap_or(Over::Stopping))
    }

    /// Takes a message: the primary host's state, or a command.
    fn hear(&self, topic: &str, bytes: &[u8], session: &mut Session, known: &mut Known) -> Result<Option<Over>> {
        let Some(host) = known.host.as_mut().filter(|host| host.topic == topic) else {
            return self.obey(topic, bytes, session, known).map(|()| None);
        };
        match host.hear(topic, bytes) {
            Some(true) if !known.born => self.births(session, known).map(|()| None),
            Some(false) if known.born => Ok(Some(Over::HostOffline)),
            _ => Ok(None),
        }
    }

    fn births(&self, session: &mut Session, known: &mut Known) -> Result {
        session.birth()?;
        known.born = true;
        self.health.broker_born.store(1, Ordering::Relaxed);
        let mut names = known.devices.born();
        names.extend(self.nodes.keys().filter(|name| self.health.is_online(name)).cloned());
        names.sort();
        names.dedup();
        names.iter().try_for_each(|name| session.device_birth(name, known.devices.device(name)))
    }

    fn keep(&mut self, place: u64) -> Result {
        self.cursor.keep(place)?;
        self.passed.store(place, Ordering::Relaxed);
        self.health.broker_next.store(place, Ordering::Relaxed);
        Ok(())
    }

    fn waiting(&self) -> u64 {
        self.health.journal_next.load(Ordering::Relaxed).saturating_sub(self.cursor.next())
    }

    /// Births and deaths of sessions are paired by a number that goes on over restarts.
    fn next_bd_seq(&self) -> Result<u8> {
        let path = self.data.join("bdseq");
        let former = std::fs::read_to_string(&path).ok().and_then(|text| text.trim().parse::<u8>().ok());
        let next = former.map_or(0, |former| former.wrapping_add(1));
        crate::journal::cursor::replace(&path, next.to_string().as_bytes())?;
        Ok(next)
    }

    fn obey(&self, topic: &str, bytes: &[u8], session: &mut Session, known: &mut Known) -> Result {
        for command in commands(topic, bytes, &self.config, &known.devices) {
            match command {
                Command::Rebirth if known.born => self.births(session, known)?,
                // The births come with the primary host.
                Command::Rebirth => {}
                Command::Node { device, requests, name } => {
                    let Some((_, node)) = self.nodes.get(&device).filter(|_| self.health.is_online(&device)) else {
                        self.report(&device, News::Command(format!("{name} refused: the node does not answer")));
                        continue;
                    };
                    let sent = requests.into_iter().all(|request| node.send(request).is_ok());
                    self.report(&device, News::Command(if sent { name } else { format!("{name} refused: stopping") }));
                }
                Command::Refused { device, reason } => {
                    eprintln!("command refused: {reason}");
                    self.report(device.as_deref().unwrap_or(""), News::Command(format!("refused: {reason}")));
                }
            }
        }
        Ok(())
    }

    fn report(&self, device: &str, news: News) {
        let Some((node, _)) = self.nodes.get(device) else { return };
        let (wall_us, steady_us) = (crate::clock::wall_us(), crate::clock::steady_us(self.start));
        // Where the journal's thread is gone, the gateway is stopping.
        let _ = self.reports.send(Report { node: *node, wall_us, steady_us, news });
    }
}
