//! Listening to the node in the node's own time.
//!
//! Everything that waits, waits in seconds of the node: by the ticks of its statuses. A node that runs slower than
//! the wall clock, as an emulated one does, is given as much of its time as any other. The wall clock only tells that
//! nobody speaks any more. A peer that floods the line is no faster than its statuses say.

use crate::link::Client;
use crate::{Error, Result};
use meshband::message::{Message, Request, SelfTest, Snapshot, Statistics, Status};
use std::time::{Duration, Instant};

/// How long a node may be silent: an erasure of its flash lies in between at worst, or an emulator at a crawl.
const SILENCE: Duration = Duration::from_secs(30);
/// How long one reading waits.
const READING: Duration = Duration::from_millis(100);
/// After a change of the configuration this much is still of the former one, s of the node.
const STALE_S: f64 = 2.0;
/// Within this a waveform that was asked for has come, s of the node.
const WAVEFORM_S: f64 = 20.0;

/// Who stands at the machine.
pub trait Operator {
    /// Says something.
    ///
    /// # Errors
    /// Standard output that takes no more.
    fn tell(&mut self, line: &str) -> Result<()>;

    /// Asks for a yes; no where nobody can be asked.
    ///
    /// # Errors
    /// As [`Operator::tell`].
    fn ask(&mut self, question: &str) -> Result<bool>;

    /// Whether the end was asked for.
    fn wants_to_end(&self) -> bool {
        false
    }
}

/// A waveform at the law's rate.
#[derive(Debug, Clone)]
pub struct Waveform {
    /// Samples, m/s2, with their mean.
    pub samples: Vec<f64>,
    /// Their rate, Hz.
    pub rate_hz: f64,
    /// Pinion rate as the node has it, Hz.
    pub speed_hz: f64,
}

/// The node, listened to.
pub struct Ear<'a> {
    /// For commands.
    pub client: &'a mut Client,
    ticks_per_second: f64,
    status: Option<Status>,
}

impl<'a> Ear<'a> {
    /// Listens to a node with this time base.
    pub fn new(client: &'a mut Client, ticks_per_second: u32) -> Self {
        Self { client, ticks_per_second: f64::from(ticks_per_second), status: None }
    }

    /// The newest status.
    pub fn status(&self) -> Option<&Status> {
        self.status.as_ref()
    }

    /// Time of the newest status since the node's start, s.
    pub fn now_s(&self) -> Option<f64> {
        self.status.map(|status| self.seconds(status.tick))
    }

    /// Ticks in seconds.
    pub fn seconds(&self, ticks: u64) -> f64 {
        ticks as f64 / self.ticks_per_second
    }

    /// The next message.
    ///
    /// # Errors
    /// [`Error::Tool`] where the node falls silent, restarts, or the end is asked for.
    pub fn next(&mut self, operator: &dyn Operator) -> Result<Message> {
        let deadline = Instant::now() + SILENCE;
        let restarts = self.client.losses().restarts;
        loop {
            if operator.wants_to_end() {
                return Err(Error::tool("commission", "interrupted"));
            }
            if let Some(message) = self.client.next_message(READING)? {
                if self.client.losses().restarts != restarts {
                    return Err(Error::tool("node", "has restarted: `meshband monitor` shows why; begin again"));
                }
                if let Message::Status(status) = &message {
                    self.status = Some(*status);
                }
                return Ok(message);
            }
            if self.client.has_ended() {
                return Err(Error::tool("node", "the link has ended"));
            }
            if Instant::now() > deadline {
                let seconds = SILENCE.as_secs();
                return Err(Error::tool("node", format!("has been silent for {seconds} s: power, or its line")));
            }
        }
    }

    /// Hands messages to `take` for so many seconds of the node, or until it has enough.
    ///
    /// # Errors
    /// As [`Ear::next`], and those of `take`.
    pub fn listen(
        &mut self,
        seconds: f64,
        operator: &mut dyn Operator,
        mut take: impl FnMut(&Message, &Ear<'_>, &mut dyn Operator) -> Result<bool>,
    ) -> Result<()> {
        let mut end_s = None;
        loop {
            let message = self.next(operator)?;
            let now_s = self.now_s();
            end_s = end_s.or(now_s.map(|now_s| now_s + seconds));
            if take(&message, self, operator)? || now_s.zip(end_s).is_some_and(|(now_s, end_s)| now_s >= end_s) {
                return Ok(());
            }
        }
    }

    /// Lets go by what is still of the configuration before.
    ///
    /// # Errors
    /// As [`Ear::next`].
    pub fn settle(&mut self, operator: &mut dyn Operator) -> Result<()> {
        self.status = None;
        self.listen(STALE_S, operator, |_, _, _| Ok(false))
    }

    /// Runs the self-test and waits for what it gives on live samples.
    ///
    /// # Errors
    /// As [`Ear::next`].
    pub fn self_test(&mut self, seconds: f64, operator: &mut dyn Operator) -> Result<SelfTest> {
        let mut newest = self.client.self_test()?;
        self.listen(seconds, operator, |message, _, _| {
            if let Message::SelfTest(result) = message {
                newest = *result;
            }
            Ok(false)
        })?;
        Ok(newest)
    }

    /// Counters of now.
    ///
    /// # Errors
    /// Of the link.
    pub fn statistics(&mut self) -> Result<Statistics> {
        self.client.statistics()
    }

    /// A waveform, whole; `None` where it does not come so.
    ///
    /// # Errors
    /// As [`Ear::next`].
    pub fn waveform(&mut self, operator: &mut dyn Operator) -> Result<Option<Waveform>> {
        self.client.send(&Request::Snapshot)?;
        let (mut samples, mut found) = (Vec::new(), None);
        self.listen(WAVEFORM_S, operator, |message, _, _| {
            let Message::Snapshot(part) = message else { return Ok(false) };
            if part.offset == 0 {
                samples.clear();
            }
            if usize::from(part.offset) == samples.len() {
                samples.extend(part.samples.iter().map(|&sample| f64::from(sample) * f64::from(part.scale)));
            }
            found = whole(part, &samples);
            Ok(found.is_some())
        })?;
        Ok(found)
    }
}

fn whole(part: &Snapshot, samples: &[f64]) -> Option<Waveform> {
    let tag = &part.tag;
    (samples.len() == usize::from(part.total)).then(|| Waveform {
        samples: samples.to_vec(),
        rate_hz: f64::from(tag.rate_hz),
        speed_hz: f64::from(tag.speed_hz),
    })
}
