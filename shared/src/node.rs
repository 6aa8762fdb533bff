//! The node as an executor-free state machine: tach pulses and sample blocks in, messages out.
//!
//! Pulses give the speed, the speed the law's bandwidth, the bandwidth a wanted rate, the rate plan a timer period that
//! the board programs at the next block border. All blocks run through a half-band cascade to the lowest rate that still
//! carries the mesh harmonics and from there, with the turns of the pinion, into the order domain: mesh bands and the
//! synchronous average with its condition indicators. A few times per second a second cascade takes a wideband record at
//! the law's rate (peaks, RMS, snapshot); now and then it runs at a higher rate to time engagement edges, the law's check.
//! A change of rate, a lost block or a jump in time restarts the records; nothing is ever spliced, only the synchronous
//! average goes on, because its turns are found by the tach. Every input is accepted; faults are counted and reported.
//!
//! Rates are re-planned when a mesh-band record is complete, or at once when the speed has left the planned one by more
//! than [`REPLAN_NOW`]: the spectrum policy's margin (2.56 against 2) covers that, so no bandwidth is lost in between.
//! A record of 16 turns thus completes while the speed changes by less than a fifth within 20 turns: 5 %/s from 5 Hz on.
//!
//! The arrays lie in [`Buffers`]: inside the node on a host, in a static of their own on a board.

use crate::alarm::{Alarm, AlarmChange, Watched};
use crate::bandwidth_watch::{BandwidthWatch, Verdict};
use crate::buffers::{self, Buffers};
use crate::config::{Configuration, ConfigurationError, MAX_ALARMS, SCHEMA};
use crate::events::{EVENT_KINDS, EventKind, EventLog};
use crate::gear_condition;
use crate::indicators::{Moments, RunEnsemble};
use crate::mesh_band::{self, MeshPlan};
use crate::message::{
    GearIndicators, Identity, Indicators, MeasuredBandwidth, Message, PROTOCOL, Peaks, Reply, Request, SNAPSHOT_CHUNK,
    SelfTest, Snapshot, Spectrum, Statistics, Status, Tag,
};
use crate::peaks;
use crate::rate_plan::{RateGrant, RatePlan, RatePolicy};
use crate::stream::{CHUNK, Stream, WIDE_POINTS};
use crate::tach::{Speed, TachTracker, Validity};
use crate::time::TickExtender;
use crate::turn_marks::{Continuity, TurnMarks};
use crate::units::{Hertz, TicksPerSecond};
use core::borrow::BorrowMut;
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Relative departure of the wanted rate from the planned one that re-plans at once.
pub const REPLAN_NOW: f32 = 0.2;
/// Relative departure that re-plans when a record is complete.
pub const REPLAN_AT_RECORD: f32 = 0.02;
/// Wideband records begun per second, at most.
const WIDE_PER_SECOND: u32 = 1;
/// Time between measurements of rise times, s.
const RISE_INTERVAL_S: u64 = 2;
/// Blocks after a record, and after a turn, in which no other rate is asked for: a processor that has fallen behind meanwhile
/// would ask too late by an unknown number of blocks, and the same signal would not give the same samples twice.
const HOLD_AFTER_RECORD: u32 = 16;
const HOLD_AFTER_TURN: u32 = 4;
/// Most bytes of a node without its buffers.
const STATE_BUDGET: usize = 14 * 1024;

const _: () = assert!(core::mem::size_of::<Node<()>>() <= STATE_BUDGET);
const _: () = assert!(STATE_BUDGET + buffers::BUDGET <= 100 * 1024);

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

/// What the wideband path does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum WideUse {
    /// Nothing. Left at the next block border that is due.
    Idle,
    /// Fills the record. Left when it is full.
    Record,
    /// Times edges. Left when enough teeth have passed.
    Edges,
}

/// The node; `B` is where its arrays are.
#[derive(Clone, Debug)]
pub struct Node<B = Buffers> {
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
    buffers: B,
    marks: TurnMarks,
    /// Blocks still to pass before another rate may be asked for.
    hold: u32,
    /// A mesh-band record was completed since the last plan.
    record_complete: bool,
    mesh_plan: MeshPlan,
    wide_use: WideUse,
    wide_count: usize,
    wide_tick: u64,
    wide_due: u64,
    rise_due: u64,
    signal_rms: f32,
    bandwidth_watch: BandwidthWatch,
    bandwidth: Option<MeasuredBandwidth>,
    ensemble: RunEnsemble,
    gear: Option<GearIndicators>,
    sideband_energy: [f32; 2],
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
    /// A node that waits for its tach, with its arrays inside (about 90 KiB). `clock` is the common time base of samples
    /// and pulses.
    pub fn new(config: Configuration, clock: TicksPerSecond) -> Result<Node, ConfigurationError> {
        Node::with_buffers(config, clock, Buffers::ZERO)
    }
}

impl<B: BorrowMut<Buffers>> Node<B> {
    /// A node with its arrays elsewhere: boards give a `&'static mut Buffers`.
    pub fn with_buffers(config: Configuration, clock: TicksPerSecond, buffers: B) -> Result<Self, ConfigurationError> {
        config.validate(clock.0)?;
        let mut plan = RatePlan::new(clock, config.limits);
        let grant = safe_grant(&config, &mut plan);
        let mut node = Self {
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
            buffers,
            marks: TurnMarks::new(&config.tach),
            hold: 0,
            record_complete: false,
            mesh_plan: MeshPlan::NONE,
            wide_use: WideUse::Idle,
            wide_count: 0,
            wide_tick: 0,
            wide_due: 0,
            rise_due: 0,
            signal_rms: 0.0,
            bandwidth_watch: BandwidthWatch::default(),
            bandwidth: None,
            ensemble: RunEnsemble::default(),
            gear: None,
            sideband_energy: [0.0; 2],
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
        mesh_band::configure(&mut node.buffers.borrow_mut().chain, &node.config);
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
        let chain = &mut self.buffers.borrow_mut().chain;
        if self.marks.follow(&self.tach, |instant| chain.push_mark(instant as u32)) == Continuity::Broken {
            chain.lose_tach();
            chain.average().reset();
        }
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
        if !self.stream.wide_runs() {
            self.start_wide(first);
        }
        for codes in block.codes.chunks(CHUNK) {
            self.take_chunk(codes);
        }
        self.follow_turns();
        if self.state == State::Settling && self.stream.is_settled() {
            self.state = State::Measuring;
        }
        self.replan();
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
        self.mesh_plan = MeshPlan::new(&self.config, self.present_speed().pinion, self.active.adc);
        self.stream.restart(first, self.active.period_ticks, self.mesh_plan.decimation);
        self.buffers.borrow_mut().chain.set_samples_per_pitch(usize::from(self.mesh_plan.samples_per_pitch));
        self.wide_use = WideUse::Idle;
        self.wide_due = first;
        if matches!(self.state, State::Settling | State::Measuring) {
            self.state = State::Settling;
        }
    }

    fn present_speed(&self) -> Speed {
        self.tach.speed(self.next_tick.max(self.time.latest()))
    }

    /// Speed, law and plan; called at block borders.
    fn replan(&mut self) {
        let speed = self.present_speed();
        self.follow_tach(&speed);
        if self.hold > 0 {
            self.hold -= 1;
            return;
        }
        let record_complete = core::mem::take(&mut self.record_complete);
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
            (State::Settling | State::Measuring, Validity::None) => {
                self.state = State::WaitingForTach;
                let chain = &mut self.buffers.borrow_mut().chain;
                chain.lose_tach();
                chain.average().reset();
            }
            _ => {}
        }
    }

    fn watch_input(&mut self, codes: &[u16]) {
        // One pass without branches; railed are 0 and the upper 16 codes.
        let first = codes[0];
        let (mut railed, mut moved) = (0usize, 0u16);
        for &code in codes {
            railed += usize::from(code.wrapping_sub(1) >= 0xffef);
            moved |= code ^ first;
        }
        if railed * 1000 > codes.len() {
            self.note(EventKind::Saturated, (railed * 1000 / codes.len()) as u32 / 100 * 100);
        }
        if codes.len() >= 64 && moved == 0 {
            self.note(EventKind::Stuck, u32::from(first));
        }
    }

    /// Begins what the wideband path is due for.
    fn start_wide(&mut self, first: u64) {
        if self.state == State::Measuring && first >= self.rise_due && self.signal_rms > 0.0 {
            self.rise_due = first + RISE_INTERVAL_S * u64::from(self.clock.0);
            let speed = self.present_speed();
            let law_hz = self.config.law.bandwidth(speed.pinion).bandwidth.0;
            let stages = BandwidthWatch::stages(self.active.adc.0, law_hz);
            if let (Some(stages), Validity::Locked, false) = (stages, speed.validity, self.active.aliasing) {
                let rate = self.active.adc.0 / (1u32 << stages) as f32;
                let mesh_hz = f32::from(self.config.gears.pinion_teeth) * speed.pinion.0;
                self.bandwidth_watch.begin(rate, law_hz, mesh_hz, self.signal_rms);
                self.stream.start_wide(first, stages);
                self.wide_use = WideUse::Edges;
                return;
            }
        }
        if first >= self.wide_due || (self.snapshot_wanted && self.snapshot_sent.is_none()) {
            self.wide_due = first + u64::from(self.clock.0 / WIDE_PER_SECOND);
            self.stream.start_wide(first, self.active.stages);
            self.wide_use = WideUse::Record;
            self.wide_count = 0;
        }
    }

    /// Filters at most [`CHUNK`] codes and takes what comes out.
    fn take_chunk(&mut self, codes: &[u16]) {
        let Buffers { chain, wide: record, .. } = self.buffers.borrow_mut();
        let (wide_use, watch) = (self.wide_use, &mut self.bandwidth_watch);
        let (count, from) = (&mut self.wide_count, &mut self.wide_tick);
        let mut complete = false;
        let take_wide = |samples: &[f32], tick: u64| match wide_use {
            WideUse::Idle => {}
            WideUse::Edges => complete = watch.push(samples),
            WideUse::Record => {
                if *count == 0 {
                    *from = tick;
                }
                let taken = samples.len().min(WIDE_POINTS.saturating_sub(*count));
                for (place, sample) in record.iter_mut().skip(*count).zip(samples) {
                    *place = *sample;
                }
                *count += taken;
                complete = *count == WIDE_POINTS;
            }
        };
        let take_mesh = |samples: &[f32], tick: u64, period: u32| chain.push_samples(samples, tick as u32, period);
        self.stream.push(codes, &self.config.sensor, take_wide, take_mesh);
        if complete {
            self.stream.stop_wide();
            match core::mem::replace(&mut self.wide_use, WideUse::Idle) {
                WideUse::Record => self.finish_wide(),
                _ => self.finish_edges(),
            }
        }
    }

    /// Resamples complete turns and takes what they complete.
    fn follow_turns(&mut self) {
        let chain = &mut self.buffers.borrow_mut().chain;
        let progress = chain.process();
        if progress.turns > 0 {
            self.hold = self.hold.max(HOLD_AFTER_TURN);
        }
        if progress.records > 0 {
            self.finish_mesh();
        }
        let chain = &mut self.buffers.borrow_mut().chain;
        let wanted = mesh_band::average_turns(self.config.gears.pinion_teeth, self.config.gears.gear_teeth).0;
        if chain.average().turns() >= wanted {
            self.finish_average();
        }
    }

    fn tag(&self, first_tick: u64, rate: Hertz, stages: u8, resolution_hz: f32) -> Tag {
        let speed = self.present_speed();
        Tag {
            first_tick,
            speed_hz: speed.pinion.0,
            speed_uncertainty: speed.uncertainty,
            validity: speed.validity,
            period_ticks: self.active.period_ticks,
            stages,
            rate_hz: rate.0,
            resolution_hz,
            aliasing: self.active.aliasing,
        }
    }

    fn finish_wide(&mut self) {
        self.hold = HOLD_AFTER_RECORD;
        let (rate, stages) = (self.active.output, self.active.stages);
        let tag = self.tag(self.wide_tick, rate, stages, rate.0 / WIDE_POINTS as f32);
        let Buffers { wide, snapshot, .. } = self.buffers.borrow_mut();
        if self.snapshot_wanted && self.snapshot_sent.is_none() {
            self.snapshot_wanted = false;
            self.snapshot_scale = keep_snapshot(wide, snapshot);
            self.snapshot_tag = tag;
            self.snapshot_sent = Some(0);
        }
        let moments = Moments::of(wide);
        let (lines, digest) = peaks::strongest(wide, tag.resolution_hz);
        let mesh_hz = f32::from(self.config.gears.pinion_teeth) * tag.speed_hz;
        let reach = peaks::reach_hz(rate.0, stages, self.config.limits.analogue_stop.0);
        let origins = if tag.validity == Validity::Locked {
            peaks::label(&lines, mesh_hz, rate.0, tag.resolution_hz, reach)
        } else {
            Vec::new()
        };
        let rms = moments.rms();
        self.signal_rms = rms;
        let dropped = self.peaks.replace(Peaks { tag, lines, rms, digest, origins }).is_some();
        self.count_dropped(dropped);
        let (peak, kurtosis, crest) = (moments.peak(), moments.kurtosis, moments.crest());
        let sideband_energy_ratio = self.sideband_energy[0];
        let (gear, bandwidth) = (self.gear.take(), self.bandwidth.take());
        let indicators = Indicators { tag, rms, peak, crest, kurtosis, sideband_energy_ratio, gear, bandwidth };
        let dropped = self.indicators.replace(indicators).is_some();
        self.count_dropped(dropped);
        for (watched, value) in
            [(Watched::Rms, rms), (Watched::Peak, peak), (Watched::Crest, crest), (Watched::Kurtosis, kurtosis)]
        {
            self.watch(watched, tag, value);
        }
    }

    fn finish_edges(&mut self) {
        let Some(measured) = self.bandwidth_watch.result() else { return };
        self.bandwidth = Some(measured);
        let ratio = measured.bandwidth_hz / measured.law_hz;
        let tag = self.tag(self.next_tick, self.active.adc, 0, 0.0);
        self.watch(Watched::BandwidthRatio, tag, ratio);
        let per_cent = (100.0 * ratio) as u32;
        match self.bandwidth_watch.judge(&measured, &self.config) {
            Some(Verdict::Departs) => self.note(EventKind::BandwidthDeparts, per_cent),
            Some(Verdict::Agrees) => self.note(EventKind::BandwidthAgrees, per_cent),
            None => {}
        }
    }

    fn finish_mesh(&mut self) {
        let (stages, rate) = self.stream.mesh_format(self.clock);
        let chain = &self.buffers.borrow().chain;
        let (record, zoom) = (*chain.record(), chain.mesh_bands());
        let speed_hz = record.mean_hz(self.clock.0);
        let first_tick = self.time.peek(record.first_tick);
        let tag = Tag { speed_hz, ..self.tag(first_tick, rate, stages, speed_hz * zoom.order_per_bin()) };
        if tag.validity == Validity::Locked && self.state == State::Measuring {
            let (bands, digest) = mesh_band::bands(zoom, &self.config, self.mesh_plan.harmonics, speed_hz);
            let gear_order = f32::from(self.config.gears.pinion_teeth) / f32::from(self.config.gears.gear_teeth);
            let energy = |shaft: f32| zoom.sideband_energy_ratio(1, shaft).unwrap_or(0.0);
            let sideband_energy = [energy(1.0), energy(gear_order)];
            let of_turn = |ticks: u32| self.clock.rate(ticks).0;
            let (slowest_hz, fastest_hz) = (of_turn(record.longest), of_turn(record.shortest));
            let turns = zoom.config().turns;
            if let Some(first) = bands.first() {
                self.sideband_energy = sideband_energy;
                self.watch(Watched::MeshAmplitude, tag, first.line.amplitude);
                self.watch(Watched::SidebandEnergyRatio, tag, sideband_energy[0]);
            }
            let spectrum = Spectrum { tag, bands, digest, turns, slowest_hz, fastest_hz };
            let dropped = self.spectrum.replace(spectrum).is_some();
            self.count_dropped(dropped);
        }
        self.record_complete = true;
        self.hold = HOLD_AFTER_RECORD;
    }

    /// Indicators of a complete average. The wideband record serves as work space; one under way begins anew.
    fn finish_average(&mut self) {
        self.hold = HOLD_AFTER_RECORD;
        let tag = self.tag(self.next_tick, self.active.output, self.active.stages, 0.0);
        let teeth = self.config.gears.pinion_teeth;
        let (turns, hunting_broken) = mesh_band::average_turns(teeth, self.config.gears.gear_teeth);
        if self.wide_use == WideUse::Record {
            self.wide_count = 0;
        }
        let Buffers { chain, wide, .. } = self.buffers.borrow_mut();
        let average = chain.average();
        let points = average.points();
        let (work, split) = wide.split_at_mut(WIDE_POINTS / 2);
        let result = average.finish().map(|average| {
            gear_condition::of_average(average, teeth, &mut self.ensemble, &mut work[..points], &mut split[..points])
        });
        average.reset();
        let Some(Ok(indicators)) = result else { return };
        self.gear = Some(GearIndicators {
            tick: self.next_tick,
            speed_hz: tag.speed_hz,
            turns: turns as u16,
            hunting_broken,
            gear_sideband_energy_ratio: self.sideband_energy[1],
            ..indicators
        });
        self.watch(Watched::Fm0, tag, indicators.fm0);
        self.watch(Watched::Fm4, tag, indicators.fm4);
    }

    fn watch(&mut self, watched: Watched, tag: Tag, value: f32) {
        if tag.validity != Validity::Locked {
            return;
        }
        for index in 0..self.config.alarms.len() {
            let (Some(&band), Some(alarm)) = (self.config.alarms.get(index), self.alarms.get_mut(index)) else {
                return;
            };
            if band.watched != watched {
                continue;
            }
            match alarm.update(&band, Hertz(tag.speed_hz), value) {
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
        let rest = self.buffers.borrow().snapshot.get(offset..)?;
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
        self.marks = TurnMarks::new(&config.tach);
        self.ensemble = RunEnsemble::default();
        (self.gear, self.bandwidth, self.sideband_energy) = (None, None, [0.0; 2]);
        self.bandwidth_watch = BandwidthWatch::default();
        self.config = config;
        mesh_band::configure(&mut self.buffers.borrow_mut().chain, &self.config);
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

/// Keeps a wideband record in 16 bit; returns the scale, m/s^2 per unit.
fn keep_snapshot(record: &[f32; WIDE_POINTS], kept: &mut [i16; WIDE_POINTS]) -> f32 {
    let largest = record.iter().fold(0.0f32, |largest, sample| largest.max(sample.abs()));
    let scale = if largest > 0.0 { largest / 32_767.0 } else { 1.0 };
    for (kept, sample) in kept.iter_mut().zip(record) {
        *kept = (sample / scale) as i16;
    }
    scale
}
