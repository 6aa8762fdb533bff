//! The node as an executor-free state machine: tach pulses and sample blocks in, messages out.
//!
//! Pulses give the speed, the speed the law's bandwidth, the bandwidth a wanted rate, the rate plan a timer period that
//! the board programs at the next block border. Blocks run through the half-band cascade to the law's rate (wideband
//! record: peaks, RMS, snapshot) and through a second cascade to the lowest rate that still carries the mesh
//! harmonics (mesh-band record). A change of rate, a lost block or a jump in time restarts the records; nothing is ever
//! spliced. Every input is accepted; faults are counted and reported as events.
//!
//! Rates are re-planned when a mesh-band record is complete, or at once when the speed has left the planned one by more
//! than [`REPLAN_NOW`]: the spectrum policy's margin (2.56 against 2) covers that, so no bandwidth is lost in between.

use crate::alarm::{Alarm, AlarmChange, Watched};
use crate::config::{Configuration, ConfigurationError, MAX_ALARMS, SCHEMA};
use crate::events::{EVENT_KINDS, EventKind, EventLog};
use crate::indicators::Moments;
use crate::mesh_band::{self, MeshPlan};
use crate::message::{
    Identity, Indicators, Message, PROTOCOL, Peaks, Reply, Request, SNAPSHOT_CHUNK, SelfTest, Snapshot, Spectrum,
    Statistics, Status, Tag,
};
use crate::rate_plan::{RateGrant, RatePlan, RatePolicy};
use crate::stream::{Stream, WIDE_POINTS};
use crate::tach::{Speed, TachTracker, Validity};
use crate::time::TickExtender;
use crate::units::{Hertz, TicksPerSecond};
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Relative departure of the wanted rate from the planned one that re-plans at once.
pub const REPLAN_NOW: f32 = 0.2;
/// Relative departure that re-plans when a record is complete.
pub const REPLAN_AT_RECORD: f32 = 0.02;

/// One block of samples from the board.
#[derive(Clone, Copy, Debug)]
pub struct Block<'a> {
    /// Raw ADC codes, offset binary, left-aligned to 16 bit.
    pub codes: &'a [u16],
    /// Capture time of the first code in the tach's time base (wrapping).
    pub first_tick: u32,
    /// Sample period, ticks of the time base.
    pub period_ticks: u32,
    /// Increments per block; gaps are lost blocks.
    pub sequence: u32,
    /// The ADC lost samples in this block.
    pub overrun: bool,
}

/// State of a node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum State {
    /// Stopped by request; blocks are dropped. Left by `Start`.
    Stopped,
    /// No usable speed: samples at the safe maximum rate, reports peaks only. Left by the first lock.
    #[default]
    WaitingForTach,
    /// Samples at a new rate, filters not yet settled. Left when the filters have forgotten the old samples.
    Settling,
    /// Complete products. Left by loss of speed, a change of rate or lost samples.
    Measuring,
}

/// The node.
#[derive(Clone, Debug)]
pub struct Node {
    config: Configuration,
    clock: TicksPerSecond,
    self_test: SelfTest,
    state: State,
    time: TickExtender,
    tach: TachTracker,
    tach_locked: bool,
    plan: RatePlan,
    /// Rate asked of the board; active from the first block that has its period.
    pending: RateGrant,
    active: RateGrant,
    safe_rate: bool,
    law_clamped: bool,
    stream: Stream,
    next_sequence: Option<u32>,
    next_tick: u64,
    statistics: Statistics,
    events: EventLog,
    alarms: [Alarm; MAX_ALARMS],
    status_due: u64,
    status: Option<Status>,
    spectrum: Option<Spectrum>,
    peaks: Option<Peaks>,
    indicators: Option<Indicators>,
    snapshot_wanted: bool,
    snapshot_sent: Option<usize>,
    snapshot_tag: Tag,
    snapshot_scale: f32,
    send_statistics: bool,
}

impl Node {
    /// A node that waits for its tach. `clock` is the common time base of samples and pulses.
    pub fn new(config: Configuration, clock: TicksPerSecond) -> Result<Node, ConfigurationError> {
        config.validate(clock.0)?;
        let mut plan = RatePlan::new(clock, config.limits);
        let grant = safe_grant(&config, &mut plan);
        let mut node = Node {
            tach: TachTracker::new(config.tach, clock),
            clock,
            self_test: SelfTest::default(),
            state: State::WaitingForTach,
            time: TickExtender::new(0),
            tach_locked: false,
            plan,
            pending: grant,
            active: grant,
            safe_rate: true,
            law_clamped: false,
            stream: Stream::new(),
            next_sequence: None,
            next_tick: 0,
            statistics: Statistics::default(),
            events: EventLog::default(),
            alarms: [Alarm::default(); MAX_ALARMS],
            status_due: 0,
            status: None,
            spectrum: None,
            peaks: None,
            indicators: None,
            snapshot_wanted: false,
            snapshot_sent: None,
            snapshot_tag: Tag::default(),
            snapshot_scale: 0.0,
            send_statistics: false,
            config,
        };
        node.restart_stream(0);
        Ok(node)
    }

    /// Tells the node what the board's boot self-test found.
    pub fn set_self_test(&mut self, result: SelfTest) {
        self.self_test = result;
        if result.failed != 0 {
            self.note(EventKind::SelfTestFailed, u32::from(result.failed));
        }
    }

    /// Records an event of the board (over-capture, storage, watchdog...).
    pub fn note(&mut self, kind: EventKind, detail: u32) {
        self.events.record(kind, detail, self.time.latest());
    }

    /// A captured tach edge, in order of capture.
    pub fn on_tach_edge(&mut self, tick: u32) {
        let instant = self.time.extend(tick);
        self.tach.on_pulse(instant);
    }

    /// Sample period to program for the next block.
    pub fn requested_period_ticks(&self) -> u32 {
        self.pending.period_ticks
    }

    /// Rate granted for the blocks now arriving.
    pub fn active_rate(&self) -> RateGrant {
        self.active
    }

    /// State of the node.
    pub fn state(&self) -> State {
        self.state
    }

    /// Speed of the pinion as known at a tick.
    pub fn speed(&self, tick: u32) -> Speed {
        self.tach.speed(self.time.peek(tick))
    }

    /// Configuration in force.
    pub fn configuration(&self) -> &Configuration {
        &self.config
    }

    /// Counters since start.
    pub fn statistics(&self) -> Statistics {
        let tach = self.tach.counters();
        let mut events = [0; EVENT_KINDS];
        events.copy_from_slice(self.events.counters());
        Statistics {
            pulses: tach.accepted,
            pulses_missed: tach.missed,
            pulses_spurious: tach.spurious,
            relocks: tach.relocks,
            events,
            ..self.statistics
        }
    }

    /// Takes a block; cannot fail. Empty blocks only advance the sequence.
    pub fn on_block(&mut self, block: Block<'_>) {
        let period = block.period_ticks.max(1);
        let first = self.time.extend(block.first_tick);
        self.check_continuity(&block, first, period);
        if self.state == State::Stopped || block.codes.is_empty() {
            return;
        }
        self.statistics.blocks = self.statistics.blocks.wrapping_add(1);
        self.statistics.samples += block.codes.len() as u64;
        self.follow_period(period, first, block.sequence);
        self.watch_input(block.codes);
        for codes in block.codes.chunks(crate::stream::CHUNK) {
            let progress = self.stream.push(codes, &self.config.sensor);
            if progress.wide_complete {
                self.finish_wide();
            }
            if progress.mesh_complete {
                self.finish_mesh();
            }
        }
        if self.state == State::Settling && self.stream.is_settled() {
            self.state = State::Measuring;
        }
        self.replan(false);
        if self.next_tick >= self.status_due {
            self.post_status(block.sequence);
        }
    }

    /// Sequence, time and overrun: anything that breaks the sample grid restarts the records.
    fn check_continuity(&mut self, block: &Block<'_>, first: u64, period: u32) {
        let mut broken = block.overrun;
        if block.overrun {
            self.note(EventKind::Overrun, block.sequence);
        }
        let lost = self.next_sequence.map_or(0, |expected| block.sequence.wrapping_sub(expected));
        if lost != 0 {
            self.statistics.blocks_lost = self.statistics.blocks_lost.saturating_add(lost);
            self.note(EventKind::BlocksLost, lost);
            broken = true;
        } else if self.next_sequence.is_some() && first.abs_diff(self.next_tick) > u64::from(period) {
            self.note(EventKind::TimeJump, first.wrapping_sub(self.next_tick) as u32);
            broken = true;
        }
        self.next_sequence = Some(block.sequence.wrapping_add(1));
        self.next_tick = first + u64::from(period) * block.codes.len() as u64;
        if broken {
            self.restart_stream(first);
        } else if !self.stream.is_started() {
            self.stream.set_origin(first);
        }
    }

    /// Blocks carry the period they were sampled with; the plan that belongs to it becomes active.
    fn follow_period(&mut self, period: u32, first: u64, sequence: u32) {
        let wanted = if period == self.pending.period_ticks {
            self.pending
        } else if period == self.active.period_ticks {
            return;
        } else {
            self.note(EventKind::UnexpectedPeriod, period);
            self.plan.describe(self.pending.requested, period, self.pending.stages, true)
        };
        if wanted == self.active {
            return;
        }
        let same_chain = wanted.period_ticks == self.active.period_ticks && wanted.stages == self.active.stages;
        self.active = wanted;
        if !same_chain {
            self.note(EventKind::RateChanged, period);
            self.restart_stream(first);
            self.post_status(sequence);
        }
    }

    fn restart_stream(&mut self, first: u64) {
        let mesh = MeshPlan::new(&self.config, self.present_speed().pinion, self.active.output);
        self.stream.restart(first, self.active.period_ticks, self.active.stages, mesh.stages);
        if matches!(self.state, State::Settling | State::Measuring) {
            self.state = State::Settling;
        }
    }

    fn present_speed(&self) -> Speed {
        self.tach.speed(self.next_tick.max(self.time.latest()))
    }

    /// Speed, law and plan; called at block borders.
    fn replan(&mut self, record_complete: bool) {
        let speed = self.present_speed();
        self.follow_tach(&speed);
        if let RatePolicy::Forced { rate } = self.config.policy {
            self.pending = self.plan.force(rate);
            return;
        }
        match speed.validity {
            Validity::Doubtful => {}
            Validity::None => {
                if !self.safe_rate {
                    self.safe_rate = true;
                    self.pending = safe_grant(&self.config, &mut self.plan);
                }
            }
            Validity::Locked => {
                let law = self.config.law.bandwidth(speed.pinion);
                if law.clamped && !self.law_clamped {
                    self.note(EventKind::LawClamped, 0);
                }
                self.law_clamped = law.clamped;
                let wanted = self.config.policy.rate(law.bandwidth);
                let departure = (wanted.0 / self.pending.requested.0 - 1.0).abs();
                let limit = if record_complete { REPLAN_AT_RECORD } else { REPLAN_NOW };
                if self.safe_rate || departure > limit {
                    self.safe_rate = false;
                    self.pending = self.plan.grant(wanted);
                    if self.pending.limited {
                        self.note(EventKind::RateLimited, self.pending.period_ticks);
                    }
                }
            }
        }
    }

    fn follow_tach(&mut self, speed: &Speed) {
        let locked = speed.validity == Validity::Locked;
        if locked && !self.tach_locked {
            self.note(EventKind::TachLocked, 0);
        } else if !locked && self.tach_locked {
            let kind = if speed.validity == Validity::None { EventKind::TachStalled } else { EventKind::TachDoubtful };
            self.note(kind, 0);
        }
        self.tach_locked = locked;
        match (self.state, speed.validity) {
            (State::WaitingForTach, Validity::Locked) => {
                self.state = State::Settling;
                // The mesh cascade depends on the speed.
                self.restart_stream(self.next_tick);
            }
            (State::Settling | State::Measuring, Validity::None) => self.state = State::WaitingForTach,
            _ => {}
        }
    }

    fn watch_input(&mut self, codes: &[u16]) {
        let railed = codes.iter().filter(|&&code| code == 0 || code >= 0xfff0).count();
        if railed * 1000 > codes.len() {
            self.note(EventKind::Saturated, (railed * 1000 / codes.len()) as u32 / 100 * 100);
        }
        if codes.len() >= 64 && codes.iter().all(|&code| code == codes[0]) {
            self.note(EventKind::Stuck, u32::from(codes[0]));
        }
    }

    fn tag(&self, first_tick: u64, rate: Hertz, stages: u8, points: usize) -> Tag {
        let speed = self.present_speed();
        Tag {
            first_tick,
            speed_hz: speed.pinion.0,
            speed_uncertainty: speed.uncertainty,
            validity: speed.validity,
            period_ticks: self.active.period_ticks,
            stages,
            rate_hz: rate.0,
            resolution_hz: rate.0 / points as f32,
            aliasing: self.active.aliasing,
        }
    }

    fn finish_wide(&mut self) {
        let tag = self.tag(self.stream.wide_first_tick(), self.active.output, self.active.stages, WIDE_POINTS);
        if self.snapshot_wanted && self.snapshot_sent.is_none() {
            self.snapshot_wanted = false;
            self.snapshot_scale = self.stream.keep_snapshot();
            self.snapshot_tag = tag;
            self.snapshot_sent = Some(0);
        }
        let moments = Moments::of(self.stream.wide());
        let (lines, digest) = mesh_band::peaks(self.stream.wide_mut(), tag.resolution_hz);
        self.stream.clear_wide();
        let rms = moments.rms();
        let dropped = self.peaks.replace(Peaks { tag, lines, rms, digest }).is_some();
        let (peak, kurtosis, crest) = (moments.peak(), moments.kurtosis, moments.crest());
        let sideband_energy_ratio = self.indicators.map_or(0.0, |indicators| indicators.sideband_energy_ratio);
        self.indicators = Some(Indicators { tag, rms, peak, crest, kurtosis, sideband_energy_ratio });
        for (watched, value) in
            [(Watched::Rms, rms), (Watched::Peak, peak), (Watched::Crest, crest), (Watched::Kurtosis, kurtosis)]
        {
            self.watch(watched, tag, value);
        }
        self.count_dropped(dropped);
    }

    fn finish_mesh(&mut self) {
        let (rate, stages, first_tick) = self.stream.mesh_format(self.clock);
        let tag = self.tag(first_tick, rate, stages, mesh_band::POINTS);
        if tag.validity == Validity::Locked && self.state == State::Measuring {
            let (bands, digest) =
                mesh_band::bands(self.stream.mesh_mut(), tag.resolution_hz, &self.config, tag.speed_hz);
            if let Some(first) = bands.first() {
                let sidebands: f32 = first.sidebands.iter().map(|line| line.amplitude).sum();
                let ratio = if first.line.amplitude > 0.0 { sidebands / first.line.amplitude } else { 0.0 };
                self.watch(Watched::MeshAmplitude, tag, first.line.amplitude);
                self.watch(Watched::SidebandEnergyRatio, tag, ratio);
                if let Some(indicators) = &mut self.indicators {
                    indicators.sideband_energy_ratio = ratio;
                }
            }
            let dropped = self.spectrum.replace(Spectrum { tag, bands, digest }).is_some();
            self.count_dropped(dropped);
        }
        self.stream.clear_mesh();
        self.replan(true);
    }

    fn watch(&mut self, watched: Watched, tag: Tag, value: f32) {
        if tag.validity != Validity::Locked {
            return;
        }
        for index in 0..self.config.alarms.len() {
            let band = self.config.alarms[index];
            if band.watched != watched {
                continue;
            }
            match self.alarms[index].update(&band, Hertz(tag.speed_hz), value) {
                Some(AlarmChange::Raised) => self.note(EventKind::AlarmRaised, index as u32),
                Some(AlarmChange::Cleared) => self.note(EventKind::AlarmCleared, index as u32),
                None => {}
            }
        }
    }

    fn count_dropped(&mut self, dropped: bool) {
        if dropped {
            self.statistics.messages_dropped = self.statistics.messages_dropped.saturating_add(1);
        }
    }

    fn post_status(&mut self, block: u32) {
        let speed = self.present_speed();
        let law = self.config.law.bandwidth(if self.safe_rate { self.config.law.highest } else { speed.pinion });
        let dropped = self.status.is_some_and(|unsent| unsent.period_ticks != self.active.period_ticks);
        self.count_dropped(dropped);
        self.status = Some(Status {
            state: self.state,
            validity: speed.validity,
            tick: self.next_tick,
            speed_hz: speed.pinion.0,
            speed_uncertainty: speed.uncertainty,
            age_s: speed.age_s,
            bandwidth_hz: law.bandwidth.0,
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
        });
        self.status_due = self.next_tick + u64::from(self.clock.0);
    }

    /// Next outgoing message; `None` when there is nothing to say. Call with the present tick, at least once per
    /// quarter of the counter's wrap.
    pub fn poll(&mut self, now_tick: u32) -> Option<Message> {
        self.time.extend(now_tick);
        if let Some(event) = self.events.take_unreported() {
            return Some(Message::Event(event));
        }
        if let Some(status) = self.status.take() {
            return Some(Message::Status(status));
        }
        if let Some(spectrum) = self.spectrum.take() {
            return Some(Message::Spectrum(spectrum));
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
        self.next_snapshot().map(Message::Snapshot)
    }

    fn next_snapshot(&mut self) -> Option<Snapshot> {
        let offset = self.snapshot_sent?;
        let rest = self.stream.snapshot().get(offset..)?;
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
            Request::Identify => Reply::Identity(self.identity()),
            Request::GetConfiguration => Reply::Configuration(self.config.clone()),
            Request::SetConfiguration(config) => self.configure(config),
            Request::CommitConfiguration => Reply::Committing,
            Request::GetLaw => Reply::Law(self.config.law),
            Request::PutLaw(law) => match law.validate() {
                Ok(()) => {
                    self.config.law = law;
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
        }
    }

    fn refuse(&mut self, error: ConfigurationError) -> Reply {
        self.note(EventKind::RequestRefused, 0);
        Reply::Refused(error)
    }

    /// A new configuration starts tach and records anew; counters and events stay.
    fn configure(&mut self, config: Configuration) -> Reply {
        if let Err(error) = config.validate(self.clock.0) {
            return self.refuse(error);
        }
        self.plan = RatePlan::new(self.clock, config.limits);
        self.tach = TachTracker::new(config.tach, self.clock);
        self.tach_locked = false;
        self.pending = safe_grant(&config, &mut self.plan);
        self.safe_rate = true;
        self.alarms = [Alarm::default(); MAX_ALARMS];
        self.config = config;
        if self.state != State::Stopped {
            self.state = State::WaitingForTach;
        }
        self.restart_stream(self.next_tick);
        Reply::Done
    }

    fn identity(&self) -> Identity {
        Identity {
            protocol: PROTOCOL,
            schema: SCHEMA,
            version: [0, 1, 0],
            ticks_per_second: self.clock.0,
            self_test: self.self_test,
        }
    }
}

/// Rate without a speed: the law's at its highest speed, which carries the bandwidth of every lower one.
fn safe_grant(config: &Configuration, plan: &mut RatePlan) -> RateGrant {
    match config.policy {
        RatePolicy::Forced { rate } => plan.force(rate),
        policy => plan.grant(policy.rate(config.law.bandwidth(config.law.highest).bandwidth)),
    }
}
