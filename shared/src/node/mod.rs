//! The node as an executor-free state machine: tach pulses and sample blocks in, messages out.
//!
//! Pulses give the speed, the speed the law's bandwidth, the bandwidth a wanted rate, the rate plan a timer period that
//! the board programs at the next block border. All blocks run through a half-band cascade to the lowest rate that
//! still carries the mesh harmonics and from there, with the turns of the pinion, into the order domain: mesh bands
//! and the synchronous average with its condition indicators. Overall values are taken of all codes, over whole turns
//! ([`values`]). A few times per second a second cascade takes a wideband record at the law's rate (peaks, snapshot);
//! now and then it runs at a higher rate to time engagement edges, the law's check. A change of rate, a lost block or
//! a jump in time restarts the records; nothing is ever spliced, only the synchronous average goes on, because its
//! turns are found by the tach. Every input is accepted; faults are counted and reported.
//!
//! Rates are re-planned when a mesh-band record is complete, or at once when the speed has left the planned one by more
//! than [`REPLAN_NOW`]: the spectrum policy's margin (2.56 against 2) covers that, so no bandwidth is lost in between.
//! A record of 16 turns thus completes while the speed changes by less than a fifth within 20 turns: 5 %/s from 5 Hz
//! on.
//!
//! The arrays lie in [`Arrays`]: inside the node on a host, in a static of their own on a board.

use crate::band_velocity::Edges;
use crate::bandwidth_watch::BandwidthWatch;
use crate::board::Timing;
use crate::buffers::{Arrays, Buffers, OwnArrays};
use crate::config::{Configuration, ConfigurationError, Gain, STANDARD_VELOCITY_FROM_HZ, Sensor};
use crate::events::{EventKind, EventLog};
use crate::identity::Identity;
use crate::levels::{Departures, LocalDepartures};
use crate::mesh_band::MeshPlan;
use crate::message::{
    GearCondition, GearIndicators, Indicators, MeasuredBandwidth, Peaks, SelfTest, Statistics, Status, Tag,
};
use crate::rate_plan::{RateGrant, RatePlan};
use crate::stream::{CHUNK, Stream};
use crate::tach::{Speed, TachTracker};
use crate::time::TickExtender;
use crate::turn_marks::{Continuity, TurnMarks};
use crate::units::{Acceleration, TicksPerSecond};
use crate::waveform::CaptureEnd;
use serde::{Deserialize, Serialize};

pub mod alarm;
mod alarms;
pub mod bandwidth_watch;
pub mod buffers;
pub mod capture;
mod capturing;
pub mod events;
pub mod health;
mod input;
pub mod levels;
mod link;
pub mod mesh_band;
mod planning;
mod products;
pub mod safe_start;
pub mod second_pulse;
pub mod self_test;
pub mod train_round;
pub mod values;
pub mod wall_time;
pub mod watch;

use health::BoardHealth;
use planning::safe_grant;
use second_pulse::PulseClock;
use train_round::TrainRound;
use values::ValueRecord;
use wall_time::WallClock;
use watch::Watch;

/// Relative departure of the wanted rate from the planned one that re-plans at once.
pub const REPLAN_NOW: f32 = 0.2;
/// Relative departure that re-plans when a record is complete.
pub const REPLAN_AT_RECORD: f32 = 0.02;
/// Wideband records begun per second, at most.
const WIDE_PER_SECOND: u32 = 1;
/// Time between measurements of rise times, s.
const RISE_INTERVAL_S: u64 = 2;
/// Upper edge of the velocity's band, Hz: ISO 20816's.
const VELOCITY_TO_HZ: f32 = 1000.0;
/// Time without a mesh-band record that is worth an event, s, and records of turns that it lasts at least.
const NO_RECORDS_S: f32 = 10.0;
const NO_RECORDS_TURNS: f32 = 4.0;
/// Blocks after a record, and after a turn, in which no other rate is asked for: a processor that has fallen behind
/// meanwhile would ask too late by an unknown number of blocks, and the same signal would not give the same samples
/// twice.
const HOLD_AFTER_RECORD: u32 = 16;
/// Part of a second from long work to the next step of the wideband analysis: what the main loop fell behind by is
/// worked off meanwhile.
const SPARED_PER_SECOND: u32 = 64;
const HOLD_AFTER_TURN: u32 = 4;
/// Most bytes of a node without its arrays.
const STATE_BUDGET: usize = 13 * 1024;

const _: () = assert!(core::mem::size_of::<Node<()>>() <= STATE_BUDGET);
const _: () = assert!(STATE_BUDGET + buffers::BUDGET <= 101 * 1024);

/// One block of samples from the board.
#[derive(Clone, Copy, Debug)]
pub struct Block<'a> {
    /// Raw ADC codes, offset binary, left-aligned to 16 bit.
    pub codes: &'a [u16],
    /// Those of the second sensor at the same instants; empty without one.
    pub second: &'a [u16],
    /// Capture time of the first code in the tach's time base (wrapping).
    pub first_tick: u32,
    /// Sample period, ticks of the time base.
    pub period_ticks: u32,
    /// Increments per block; gaps are lost blocks.
    pub sequence: u32,
    /// The ADC lost samples in this block.
    pub overrun: bool,
}

impl Block<'_> {
    /// First tick behind the block: that of the next one's first sample.
    pub fn end_tick(&self) -> u32 {
        self.first_tick.wrapping_add(self.period_ticks.wrapping_mul(self.codes.len() as u32))
    }
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

/// What the node counts itself.
#[derive(Clone, Copy, Debug, Default)]
struct Totals {
    blocks: u32,
    blocks_lost: u32,
    samples: u64,
    messages_dropped: u32,
    most_waiting: u32,
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
    /// The record is full and analysed step by step, blocks apart. Left after the last step.
    Analysis(WideStep),
}

/// The record's analysis, a step per turn of the main loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum WideStep {
    /// Snapshot, root mean square, window.
    Window,
    /// Transform.
    Transform,
    /// Strongest lines, and the message.
    Search,
}

/// The node; `A` is where its arrays are.
#[derive(Clone, Debug)]
pub struct Node<A = OwnArrays> {
    config: Configuration,
    clock: TicksPerSecond,
    identity: Identity,
    /// Gain in use, as the board says.
    gain: Gain,
    self_test: SelfTest,
    state: State,
    time: TickExtender,
    /// First instant the node was told of.
    started: Option<u64>,
    tach: TachTracker,
    tach_locked: bool,
    tach_too_fast: bool,
    plan: RatePlan,
    /// Rate asked of the board; active from the first block that has its period.
    pending: RateGrant,
    active: RateGrant,
    safe_rate: bool,
    law_clamped: bool,
    stream: Stream,
    arrays: A,
    marks: TurnMarks,
    /// Which gear of a train the order domain follows.
    round: TrainRound,
    /// A visit to the pinion has ended, and its departures have not been said.
    round_ended: bool,
    values: ValueRecord,
    /// Blocks still to pass before another rate may be asked for.
    hold: u32,
    /// When the last mesh-band record was complete, or measuring began; and whether none has come for too long.
    records_since: u64,
    no_records: bool,
    /// A mesh-band record was completed since the last plan.
    record_complete: bool,
    mesh_plan: MeshPlan,
    wide_use: WideUse,
    wide_count: usize,
    wide_tick: u64,
    /// Of the record that is analysed.
    wide_tag: Tag,
    /// When its next step may be taken.
    spared_until: u64,
    wide_due: u64,
    rise_due: u64,
    /// When the timing of edges under way began.
    rise_from: u64,
    /// Behind the last block with clipped codes.
    clipped_until: u64,
    signal_rms: f32,
    bandwidth_watch: BandwidthWatch,
    bandwidth: Option<MeasuredBandwidth>,
    gear: Option<GearIndicators>,
    /// Of a further gear of a train.
    condition: Option<GearCondition>,
    departures: Departures,
    local_departures: LocalDepartures,
    /// Of the gear followed and its mate; of the pinion.
    sideband_energy: [f32; 2],
    pinion_sideband_energy: f32,
    next_sequence: Option<u32>,
    next_tick: u64,
    totals: Totals,
    events: EventLog,
    board_health: BoardHealth,
    pulse_clock: PulseClock,
    wall_clock: WallClock,
    /// Mean codes of both sensors in the latest values.
    bias_codes: [Option<f32>; 2],
    watch: Watch,
    /// When limits without values are looked for again.
    blindness_due: u64,
    /// The configuration in force is not the stored one.
    volatile: bool,
    latch_changed: bool,
    status_due: u64,
    status: Option<Status>,
    peaks: Option<Peaks>,
    indicators: Option<Indicators>,
    snapshot_wanted: bool,
    snapshot_sent: Option<usize>,
    snapshot_tag: Tag,
    snapshot_scale: f32,
    send_statistics: bool,
    send_self_test: bool,
}

impl Node {
    /// A node that waits for its tach, with its arrays inside (about 90 KiB). `board` tells the common time
    /// base of samples and pulses and what sampling is bound to.
    pub fn new(config: Configuration, board: impl Into<Timing>) -> Result<Node, ConfigurationError> {
        Node::with_arrays(config, board, OwnArrays::new())
    }
}

/// A copy that is made where it stays: in the caller, each of its lists would be on the stack once more.
#[inline(never)]
fn copied(config: &Configuration) -> Configuration {
    config.clone()
}

impl<A: Arrays> Node<A> {
    /// A node with its arrays elsewhere: boards give [`buffers::LentArrays`].
    pub fn with_arrays(config: Configuration, board: impl Into<Timing>, arrays: A) -> Result<Self, ConfigurationError> {
        let timing = board.into();
        config.validate(timing)?;
        let mut node = Self::of_valid(&config, timing, arrays);
        node.begin();
        Ok(node)
    }

    /// As [`Node::with_arrays`], of a configuration known to be valid and before [`Node::begin`]: whoever holds the
    /// node begins it in its place, so that the deepest call does not stand on top of copies of its 12 KB.
    #[inline(never)]
    pub(crate) fn of_valid(config: &Configuration, timing: Timing, arrays: A) -> Self {
        let clock = timing.clock;
        let mut plan = RatePlan::new(timing, config.limits);
        let grant = safe_grant(config, &mut plan);
        Self {
            tach: TachTracker::new(config.tach, clock),
            clock,
            identity: Identity::HOST,
            gain: Gain::X1,
            self_test: SelfTest::default(),
            state: State::WaitingForTach,
            time: TickExtender::new(0),
            started: None,
            tach_locked: false,
            tach_too_fast: false,
            plan,
            pending: grant,
            active: grant,
            safe_rate: true,
            law_clamped: false,
            stream: Stream::new(),
            arrays,
            marks: TurnMarks::new(&config.tach),
            round: TrainRound::new(config),
            round_ended: false,
            values: value_record(config, clock),
            hold: 0,
            records_since: 0,
            no_records: false,
            record_complete: false,
            mesh_plan: MeshPlan::NONE,
            wide_use: WideUse::Idle,
            wide_count: 0,
            wide_tick: 0,
            wide_tag: Tag::default(),
            spared_until: 0,
            wide_due: 0,
            rise_due: 0,
            rise_from: 0,
            clipped_until: 0,
            signal_rms: 0.0,
            bandwidth_watch: BandwidthWatch::default(),
            bandwidth: None,
            gear: None,
            condition: None,
            departures: Departures::NONE,
            local_departures: LocalDepartures::NONE,
            sideband_energy: [0.0; 2],
            pinion_sideband_energy: 0.0,
            next_sequence: None,
            next_tick: 0,
            totals: Totals::default(),
            events: EventLog::new(clock),
            board_health: BoardHealth::default(),
            pulse_clock: PulseClock::NONE,
            wall_clock: WallClock::UNKNOWN,
            bias_codes: [None; 2],
            watch: Watch::new(config, 0),
            blindness_due: 0,
            volatile: false,
            latch_changed: false,
            status_due: 0,
            status: None,
            peaks: None,
            indicators: None,
            snapshot_wanted: false,
            snapshot_sent: None,
            snapshot_tag: Tag::default(),
            snapshot_scale: 0.0,
            send_statistics: false,
            send_self_test: false,
            config: copied(config),
        }
    }

    /// Ticks per second of samples and pulses.
    pub(crate) fn clock(&self) -> TicksPerSecond {
        self.clock
    }

    /// Sets up what lies in the buffers and waits for the first block.
    pub(crate) fn begin(&mut self) {
        let followed = self.round.followed(&self.config);
        mesh_band::configure(&mut self.arrays.buffers_mut().chain, &followed, self.clock);
        self.restart_stream(0);
        self.configure_capture();
    }

    /// Latest instant known, and that of the start, ticks.
    pub(crate) fn lifetime(&self) -> (u64, u64) {
        let now = self.next_tick.max(self.time.latest());
        (now, self.started.unwrap_or(now))
    }

    /// On which board the node runs.
    pub fn identity(&self) -> Identity {
        self.identity
    }

    /// What the self-test has found so far.
    pub fn set_self_test(&mut self, result: SelfTest) {
        let before = core::mem::replace(&mut self.self_test, result);
        if result.failed & !before.failed != 0 {
            self.note(EventKind::SelfTestFailed, u32::from(result.failed));
        }
    }

    /// As [`Node::set_self_test`], and tells the host.
    pub fn report_self_test(&mut self, result: SelfTest) {
        self.set_self_test(result);
        self.send_self_test = true;
    }

    /// What the self-test has found so far.
    pub fn self_test(&self) -> SelfTest {
        self.self_test
    }

    /// Whether the signal chain gives the recorded result ([`self_test::mathematics`]). The wideband record serves as
    /// work space; one under way begins anew.
    pub fn check_mathematics(&mut self) -> bool {
        self.take_over_wide();
        self_test::mathematics(&mut self.arrays.buffers_mut().wide) == self_test::MATHEMATICS_HASH
    }

    /// Tells the node on which board it runs.
    pub fn set_identity(&mut self, identity: Identity) {
        self.identity = identity;
    }

    /// The board's amplifier has another gain from the next block on: amplitudes are scaled with it, and records
    /// begin anew.
    pub fn set_gain(&mut self, gain: Gain) {
        if self.gain != gain {
            self.break_capture(CaptureEnd::Commanded);
            self.gain = gain;
            self.values.restart(self.next_tick);
            self.restart_stream(self.next_tick);
        }
    }

    /// Gain that amplitudes are scaled with.
    pub fn gain(&self) -> Gain {
        self.gain
    }

    /// The sensor as it stands before the converter: its sensitivity with the gain in use.
    fn sensor(&self) -> Sensor {
        let Sensor { acceleration_per_code, zero_code } = self.config.sensor;
        let acceleration_per_code = Acceleration(acceleration_per_code.0 / f32::from(self.gain.factor()));
        Sensor { acceleration_per_code, zero_code }
    }

    /// Records an event of the board (over-capture, storage, watchdog...).
    pub fn note(&mut self, kind: EventKind, detail: u32) {
        self.events.record(kind, detail, self.time.latest());
    }

    /// A captured tach edge, in order of capture.
    pub fn on_tach_edge(&mut self, tick: u32) {
        let instant = self.extend(tick);
        self.tach.on_pulse(instant);
        let was_too_fast = core::mem::replace(&mut self.tach_too_fast, self.tach.is_too_fast());
        if self.tach_too_fast && !was_too_fast {
            self.note(EventKind::TachTooFast, 0);
        }
        let (Buffers { chain, .. }, capture) = self.arrays.parts();
        let values = &mut self.values;
        let follows_pinion = self.round.gear() == 0;
        let mark = |instant: u64| {
            if follows_pinion {
                chain.push_mark(instant as u32);
            }
            values.push_mark(instant);
            capture.push_mark(instant);
        };
        if self.marks.follow(&self.tach, mark) == Continuity::Broken {
            chain.lose_tach();
            chain.average().reset();
            values.lose_tach();
            capture.lose_marks();
        }
        self.follow_train_marks();
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
        self.speed_at(self.time.peek(tick))
    }

    /// Configuration in force.
    pub fn configuration(&self) -> &Configuration {
        &self.config
    }

    /// Counters since start.
    pub fn statistics(&self) -> Statistics {
        let tach = self.tach.counters();
        Statistics {
            blocks: self.totals.blocks,
            blocks_lost: self.totals.blocks_lost,
            samples: self.totals.samples,
            messages_dropped: self.totals.messages_dropped,
            pulses: tach.accepted,
            pulses_missed: tach.missed,
            pulses_spurious: tach.spurious,
            relocks: tach.relocks,
            events: self.events.counts(),
            most_waiting: self.totals.most_waiting,
        }
    }

    /// Tells the node, for its counters, how many blocks waited for it at most.
    pub fn note_waiting(&mut self, most: u32) {
        self.totals.most_waiting = most;
    }

    /// Takes a block; cannot fail. Empty blocks only advance the sequence.
    pub fn on_block(&mut self, block: Block<'_>) {
        let period = block.period_ticks.max(1);
        let first = self.extend(block.first_tick);
        self.check_continuity(&block, first, period);
        self.go_on_sealing();
        self.watch_blindness();
        if self.state == State::Stopped || block.codes.is_empty() {
            return;
        }
        self.totals.blocks = self.totals.blocks.wrapping_add(1);
        self.totals.samples += block.codes.len() as u64;
        self.follow_period(period, first, block.sequence);
        let railed = self.watch_input(block.codes, 0);
        if railed {
            self.clipped_until = self.next_tick;
        }
        let has_second = self.config.second.is_some() && block.second.len() == block.codes.len();
        let second = if has_second { block.second } else { &[] };
        self.watch_input(second, events::OF_SECOND);
        self.follow_values([block.codes, second], first, period);
        self.follow_capture(block.codes, railed, first, period);
        self.go_on_with_wide();
        if self.wide_use == WideUse::Idle {
            self.start_wide(first);
        }
        for codes in block.codes.chunks(CHUNK) {
            self.take_chunk(codes);
        }
        self.follow_turns();
        if self.state == State::Settling && !self.no_records && self.stream.is_settled() {
            self.state = State::Measuring;
            self.records_since = self.records_since.max(self.next_tick);
        }
        self.watch_records();
        self.go_round();
        self.replan();
        if self.next_tick >= self.status_due {
            self.post_status(block.sequence);
        }
    }

    fn present_speed(&self) -> Speed {
        self.speed_at(self.next_tick.max(self.time.latest()))
    }

    /// Before the first pulse the age counts from the start.
    fn speed_at(&self, instant: u64) -> Speed {
        let speed = self.tach.speed(instant);
        let since_start = instant.saturating_sub(self.started.unwrap_or(instant));
        Speed { age_s: speed.age_s.min(self.clock.seconds(since_start)), ..speed }
    }

    /// The instant of a tick; the first one is the start.
    fn extend(&mut self, tick: u32) -> u64 {
        if self.started.is_none() {
            self.started = Some(self.time.begin(tick));
        }
        self.time.extend(tick)
    }
}

/// The overall values' record for a configuration.
fn value_record(config: &Configuration, clock: TicksPerSecond) -> ValueRecord {
    let edges = Edges { from_hz: velocity_from_hz(config), to_hz: VELOCITY_TO_HZ };
    let second = config.second.unwrap_or_default();
    ValueRecord::new(clock, edges, [config.sensor.zero_code, second.zero_code], config.range.in_force())
}

/// Lower edge of the velocity's band, Hz.
fn velocity_from_hz(config: &Configuration) -> f32 {
    let from = config.velocity_from.0;
    if from > 0.0 { from } else { STANDARD_VELOCITY_FROM_HZ }
}
