//! The gateway's threads: one per node, one for the journal, one each for broker, history and metrics.
//!
//! Data flows one way: nodes, journal, then broker and history at their own pace. Only commands go back. One folder
//! belongs to one gateway, by a lock that ends with the process.

use crate::clock;
use crate::config::Config;
use crate::error::{Error, Result, at};
use crate::health::{self, Health};
use crate::history::writer::Writer;
use crate::intake::Report;
use crate::intake::link::Link;
use crate::intake::worker::Intake;
use crate::journal::cursor::Cursor;
use crate::sparkplug::publisher::{Nodes, Publisher};
use crate::stop::Stop;
use std::fs::{File, TryLockError};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Reports written at a time: what a read or two of every node brings.
const BURST: usize = 1000;
/// Stack of a thread, bytes; only what is touched of it is memory.
const STACK: usize = 2 << 20;

/// The journal's readers and where they are; a consumer that is not configured has passed everything.
struct Passed {
    broker: Option<Arc<AtomicU64>>,
    history: Option<Arc<AtomicU64>>,
}

impl Passed {
    fn least(&self) -> u64 {
        let of =
            |place: &Option<Arc<AtomicU64>>| place.as_ref().map_or(u64::MAX, |place| place.load(Ordering::Relaxed));
        of(&self.broker).min(of(&self.history))
    }
}

/// Runs until asked to stop.
///
/// # Errors
/// What keeps it from starting; afterwards everything is tried again instead.
pub fn run(config: &Config, stop: &Stop) -> Result {
    at(&config.data, std::fs::create_dir_all(&config.data))?;
    let _lock = lock(&config.data)?;
    let health = Arc::new(Health::default());
    let start = Instant::now();
    let (reports, incoming) = channel();
    let closed = Arc::new(AtomicBool::new(false));
    let places = Passed {
        broker: config.broker.as_ref().map(|_| Arc::default()),
        history: config.history.as_ref().map(|_| Arc::default()),
    };
    let history = match (&config.history, &places.history) {
        (Some(history), Some(place)) => {
            Some(Writer::open(history, &config.data, Arc::clone(place), Arc::clone(&health))?)
        }
        _ => None,
    };
    let cursor = Cursor::open(&config.data, "broker")?;
    let at_least = history.as_ref().map_or(0, Writer::next).max(cursor.next());
    let intake = Intake::open(&config.data, &config.nodes, at_least, Arc::clone(&health))?;
    if let Some(place) = &places.broker {
        place.store(cursor.next(), Ordering::Relaxed);
    }
    let mut threads = Vec::new();
    if let Some(address) = config.metrics {
        threads.push(health::serve(address, Arc::clone(&health), stop.clone())?);
    }
    let (commands, links) = connect(config, &reports, &health, start, stop)?;
    threads.extend(links);
    if let (Some(broker), Some(passed)) = (&config.broker, &places.broker) {
        let publisher = Publisher {
            config: broker.clone(),
            edge: config.name.clone(),
            data: config.data.clone(),
            cursor,
            passed: Arc::clone(passed),
            nodes: commands,
            reports: reports.clone(),
            health: Arc::clone(&health),
            start,
            stop: stop.clone(),
        };
        threads.push(spawn("broker", move || publisher.run())?);
    }
    if let Some(writer) = history {
        let (stop, closed) = (stop.clone(), Arc::clone(&closed));
        threads.push(spawn("history", move || writer.run(stop, || closed.load(Ordering::Acquire)))?);
    }
    drop(reports);
    keep_journal(intake, &incoming, config, &places);
    closed.store(true, Ordering::Release);
    for thread in threads {
        // A thread that panicked has said so.
        let _ = thread.join();
    }
    Ok(())
}

fn connect(
    config: &Config,
    reports: &Sender<Report>,
    health: &Arc<Health>,
    start: Instant,
    stop: &Stop,
) -> Result<(Nodes, Vec<JoinHandle<()>>)> {
    let (mut commands, mut threads) = (Nodes::new(), Vec::new());
    for (index, node) in config.nodes.iter().enumerate() {
        let (sender, receiver) = channel();
        commands.insert(node.name.clone(), (index, sender));
        health.node(&node.name, |_| {});
        let link = Link {
            index,
            name: node.name.clone(),
            port: node.port.clone(),
            unit: node.unit.clone(),
            commands: receiver,
            reports: reports.clone(),
            health: Arc::clone(health),
            start,
            stop: stop.clone(),
        };
        threads.push(spawn(&node.name, move || link.run())?);
    }
    Ok((commands, threads))
}

/// Reports into the journal until all nodes' threads have ended.
fn keep_journal(mut intake: Intake, incoming: &Receiver<Report>, config: &Config, places: &Passed) {
    let sync = Duration::from_secs_f64(config.journal.sync_seconds);
    let mut synced = Instant::now();
    loop {
        match incoming.recv_timeout(sync.min(Duration::from_millis(200))) {
            Ok(report) => {
                intake.take(report);
                incoming.try_iter().take(BURST).for_each(|report| intake.take(report));
                intake.write(clock::wall_us());
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
        if synced.elapsed() > sync {
            synced = Instant::now();
            if let Err(reason) = intake.sync(places.least(), config.journal.megabytes << 20) {
                eprintln!("journal: {reason}");
            }
        }
    }
    if let Err(reason) = intake.sync(places.least(), config.journal.megabytes << 20) {
        eprintln!("journal: {reason}");
    }
}

fn spawn(name: &str, work: impl FnOnce() + Send + 'static) -> Result<JoinHandle<()>> {
    let place = format!("thread {name}");
    let builder = std::thread::Builder::new().name(name.to_owned()).stack_size(STACK);
    builder.spawn(work).map_err(|reason| Error::new(place, reason))
}

/// The folder's lock; it is given up with the file.
fn lock(data: &Path) -> Result<File> {
    let path = data.join("lock");
    let file = at(&path, File::create(&path))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(Error::new(data.display(), "another gateway works in this folder")),
        Err(TryLockError::Error(reason)) => Err(Error::new(path.display(), reason)),
    }
}
