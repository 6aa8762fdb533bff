//! The node and its host: what it says of itself, which message is next, and what it does when asked.

use super::planning::{asked_bandwidth, safe_grant};
use super::train_round::TrainRound;
use super::watch::{self, Watch};
use super::{Node, State, value_record};
use crate::bandwidth_watch::BandwidthWatch;
use crate::buffers::Arrays;
use crate::config::{Configuration, ConfigurationError, SCHEMA};
use crate::events::EventKind;
use crate::identity::VERSION;
use crate::levels::{Departures, LocalDepartures};
use crate::mesh_band;
use crate::message::{
    GearSpectrum, Identification, Message, Reply, Request, SNAPSHOT_CHUNK, Snapshot, Spectrum, Status, WIRE_SCHEMA,
};
use crate::rate_plan::RatePlan;
use crate::stream::WIDE_POINTS;
use crate::turn_marks::TurnMarks;
use crate::update::UpdateStatus;
use crate::waveform::{CaptureEnd, Trigger};
use heapless::{String, Vec};

impl<A: Arrays> Node<A> {
    pub(super) fn post_status(&mut self, block: u32) {
        let speed = self.present_speed();
        let at = if self.safe_rate { self.config.law.highest } else { speed.pinion };
        let law = self.config.law.bandwidth(at);
        let asked = asked_bandwidth(&self.config, law.bandwidth, at);
        let (available_hz, bound) = self.config.pass.available(asked, self.active.usable);
        let dropped = self.status.is_some_and(|unsent| unsent.period_ticks != self.active.period_ticks);
        self.count_dropped(dropped);
        self.status = Some(Status {
            state: self.state,
            validity: speed.validity,
            tick: self.next_tick,
            speed_hz: speed.pinion.0,
            speed_uncertainty: speed.uncertainty,
            age_s: speed.age_s,
            bandwidth_hz: asked.0,
            law_clamped: law.clamped,
            law_provisional: law.provisional,
            requested_hz: self.active.requested.0,
            granted_hz: self.active.output.0,
            adc_hz: self.active.adc.0,
            period_ticks: self.active.period_ticks,
            stages: self.active.stages,
            residual_ppm: self.active.residual.0,
            limited: self.active.limited,
            safe_rate: self.safe_rate,
            block,
            available_hz,
            bound,
            alarms: self.alarm_state(),
            capture: self.arrays.capture().phase(),
            alerts: watch::alerts(&self.config),
            sensor: self.watch.sensor_status(),
        });
        self.status_due = self.next_tick + u64::from(self.clock.0);
    }

    /// Next outgoing message; `None` when there is nothing to say. Call with the present tick, at least once per
    /// quarter of the counter's wrap.
    pub fn poll(&mut self, now_tick: u32) -> Option<Message> {
        self.poll_results(now_tick).or_else(|| self.next_snapshot().map(Message::Snapshot))
    }

    /// As [`Node::poll`], without waveforms.
    pub fn poll_results(&mut self, now_tick: u32) -> Option<Message> {
        self.extend(now_tick);
        if let Some(event) = self.events.take_unreported() {
            return Some(Message::Event(event));
        }
        if let Some(status) = self.status.take() {
            return Some(Message::Status(status));
        }
        let outgoing = &mut self.arrays.buffers_mut().outgoing;
        if core::mem::take(&mut outgoing.waits) {
            let spectrum = core::mem::replace(&mut outgoing.spectrum, Spectrum::EMPTY);
            return Some(match outgoing.gear {
                0 => Message::Spectrum(spectrum),
                gear => Message::GearSpectrum(GearSpectrum { gear, spectrum }),
            });
        }
        if let Some(condition) = self.condition.take() {
            return Some(Message::GearCondition(condition));
        }
        if let Some(peaks) = self.peaks.take() {
            return Some(Message::Peaks(peaks));
        }
        if let Some(indicators) = self.indicators.take() {
            return Some(Message::Indicators(indicators));
        }
        if core::mem::take(&mut self.send_statistics) {
            return Some(Message::Statistics(self.statistics()));
        }
        core::mem::take(&mut self.send_self_test).then_some(Message::SelfTest(self.self_test))
    }

    pub(super) fn next_snapshot(&mut self) -> Option<Snapshot> {
        let offset = self.snapshot_sent?;
        let rest = self.arrays.buffers().snapshot.get(offset..)?;
        let samples: Vec<i16, SNAPSHOT_CHUNK> = rest.iter().take(SNAPSHOT_CHUNK).copied().collect();
        let next = offset + samples.len();
        self.snapshot_sent = (next < WIDE_POINTS).then_some(next);
        Some(Snapshot {
            tag: self.snapshot_tag,
            offset: offset as u16,
            total: WIDE_POINTS as u16,
            scale: self.snapshot_scale,
            samples,
        })
    }

    /// Carries out a command.
    pub fn on_request(&mut self, request: Request) -> Reply {
        match request {
            Request::Identify => Reply::Identity(self.identification()),
            Request::GetConfiguration => Reply::Configuration(self.config.clone()),
            Request::SetConfiguration(config) => self.configure(config),
            Request::CommitConfiguration => Reply::Committing,
            Request::GetLaw => Reply::Law(self.config.law),
            Request::PutLaw(law) => match law.validate() {
                Ok(()) => {
                    self.config.law = law;
                    self.volatile = true;
                    self.safe_rate = true;
                    Reply::Done
                }
                Err(error) => self.refuse(ConfigurationError::Law(error)),
            },
            Request::Start => {
                if self.state == State::Stopped {
                    self.state = State::WaitingForTach;
                    self.next_sequence = None;
                    self.restart_stream(self.next_tick);
                }
                Reply::Done
            }
            Request::Stop => {
                self.state = State::Stopped;
                self.break_capture(CaptureEnd::Commanded);
                Reply::Done
            }
            Request::Snapshot => {
                self.snapshot_wanted = true;
                Reply::Done
            }
            Request::SelfTest => Reply::SelfTest(self.self_test),
            Request::Events => {
                self.events.report_all();
                Reply::Done
            }
            Request::Statistics => Reply::Statistics(self.statistics()),
            Request::AcknowledgeAlarms => {
                self.acknowledge();
                Reply::Done
            }
            // A session takes it before it comes here.
            Request::Update(_) => Reply::Update(UpdateStatus::NOT_SUPPORTED),
            Request::TriggerCapture => {
                self.trigger_capture(Trigger::Request);
                Reply::Capture(self.arrays.capture().report())
            }
            Request::GetCapture => Reply::Capture(self.arrays.capture().report()),
            Request::ReadCapture { number, offset } => Reply::CapturePart(self.capture_part(number, offset)),
            Request::GetHealth => Reply::Health(self.health()),
            Request::SetWallTime(told) => {
                self.set_wall_time(told);
                Reply::Health(self.health())
            }
            Request::ReleaseCapture { number } => Reply::Capture(self.release_capture(number)),
        }
    }

    pub(super) fn refuse(&mut self, error: ConfigurationError) -> Reply {
        self.note(EventKind::RequestRefused, 0);
        Reply::Refused(error)
    }

    /// A new configuration starts tach and records anew; counters and events stay.
    pub(super) fn configure(&mut self, config: Configuration) -> Reply {
        if let Err(error) = config.validate(self.plan.timing()) {
            return self.refuse(error);
        }
        // What was taken under the old one is described by it.
        self.break_capture(CaptureEnd::Commanded);
        self.plan = RatePlan::new(self.plan.timing(), config.limits);
        self.tach = self.tach.for_wheel(config.tach);
        self.tach_locked = false;
        self.pending = safe_grant(&config, &mut self.plan);
        self.safe_rate = true;
        (self.volatile, self.latch_changed) = (true, false);
        self.marks = TurnMarks::new(&config.tach);
        (self.gear, self.condition, self.bandwidth) = (None, None, None);
        (self.sideband_energy, self.pinion_sideband_energy) = ([0.0; 2], 0.0);
        (self.departures, self.local_departures) = (Departures::NONE, LocalDepartures::NONE);
        self.bandwidth_watch = BandwidthWatch::default();
        self.config = Configuration { latched: 0, sensor_latched: false, ..config };
        self.watch = Watch::new(&self.config, self.next_tick);
        self.round = TrainRound::new(&self.config);
        self.round_ended = false;
        let followed = self.round.followed(&self.config);
        mesh_band::configure(&mut self.arrays.buffers_mut().chain, &followed, self.clock);
        self.take_over_wide();
        self.values = value_record(&self.config, self.clock);
        self.values.restart(self.next_tick);
        if self.state != State::Stopped {
            self.state = State::WaitingForTach;
        }
        self.restart_stream(self.next_tick);
        self.configure_capture();
        Reply::Done
    }

    pub(super) fn identification(&self) -> Identification {
        Identification {
            wire_schema: WIRE_SCHEMA,
            configuration_schema: SCHEMA,
            version: VERSION,
            build: beginning(self.identity.build),
            board: beginning(self.identity.board),
            unique_id: self.identity.unique_id,
            ticks_per_second: self.clock.0,
            self_test: self.self_test,
            image: self.identity.image,
        }
    }
}

/// As much of a text as there is room for.
fn beginning<const N: usize>(text: &str) -> String<N> {
    let mut kept = String::new();
    for letter in text.chars() {
        if kept.push(letter).is_err() {
            break;
        }
    }
    kept
}
