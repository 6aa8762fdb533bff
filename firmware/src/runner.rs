//! The main loop of every board: edges, blocks and bytes to the session, frames to the link, commits to the flash.
//!
//! A board's `main` builds its board and a runner and calls [`Runner::work`] for ever. Edges before a block's end go
//! first, and the block waits until they can all have been captured ([`Due`]): the node sees both in the order of
//! time whatever filters and interrupts held back.

use crate::crash::{self, Cause};
use crate::light::Code;
use crate::stack::{self, StackUse};
use core::mem::MaybeUninit;
use embedded_storage::nor_flash::NorFlash;
use meshband::board::{Board, Due, Link, Timing};
use meshband::buffers::LentArrays;
use meshband::capture::Capture;
use meshband::config::{Configuration, LineFormat};
use meshband::events::EventKind;
use meshband::health::{HealthChange, HealthWatch};
use meshband::identity::Identity;
use meshband::message::Request;
use meshband::safe_start::{GoodRun, is_safe_start};
use meshband::sample_ring::SampleRing;
use meshband::session::Session;
use meshband::store::{Origin, Store};
use meshband::units::TicksPerSecond;
use meshband::update::trial::Trial;
use meshband::update::{RunningImage, Stage, StartCause, UpdateRequest, UpdateStatus, Updater};
use meshband_drivers::status_light::FlashCode;

/// What a board's own event ([`EventKind::Board`]) tells: kind in the detail's highest byte, number below.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum BoardEvent {
    /// Restarted after a crash; number: source line of a panic, low bits of a fault's program counter, or a
    /// [`crash::Cause`].
    Crash = 1,
    /// No crystal started: frequencies are within 1 % only.
    InternalOscillator = 2,
    /// Tach edges lost to over-capture; number: since start.
    EdgesLost = 3,
    /// Sampling was started anew because samples had lost step, or a second sensor came or went; number: since start.
    SamplingRestarted = 4,
    /// The stack reached a new depth; number: bytes.
    StackDepth = 5,
    /// The supply may fall below what programming the flash takes without a reset; number: the chip's brown-out level.
    BrownOut = 6,
    /// Started with the default configuration because of failures in a row; number: how many. The stored one is kept.
    SafeStart = 7,
    /// The front end's gain could not be written and is in doubt; number: gain wanted.
    GainFault = 8,
    /// The supply has left its tolerance ([`meshband::health::SUPPLY_TOLERANCE`]): accelerations are wrong by as
    /// much; number: millivolts.
    Supply = 9,
    /// The chip's temperature has left its range; number: kelvins.
    Temperature = 10,
}

impl BoardEvent {
    /// The detail of the event.
    pub const fn detail(self, number: u32) -> u32 {
        (self as u32) << 24 | if number > 0x00ff_ffff { 0x00ff_ffff } else { number }
    }
}

/// Seconds without a block after which the main loop no longer counts as alive: twice the longest block of any board.
const BLOCK_PATIENCE_S: u32 = 1;
/// Seconds between looks at the stack's paint.
const STACK_PERIOD_S: u32 = 10;
/// Share of a second in which the answer to an update's last step leaves: the whole queue takes a tenth.
const FAREWELL_PER_SECOND: u32 = 5;
/// Growth of the stack that is worth an event, bytes.
const STACK_STEP: u32 = 1024;
/// Tolerance of the clock where no crystal drives it, parts per million.
const INTERNAL_OSCILLATOR_PPM: f32 = 10_000.0;
/// Zero degrees Celsius, K.
const ZERO_CELSIUS_K: f32 = 273.15;

/// A session whose node keeps its arrays in statics.
pub type NodeSession = Session<LentArrays<'static>>;

/// Waveforms of a node whose samples lie in a static.
pub type NodeCapture = Capture<&'static mut SampleRing>;

/// The memory of waveforms in its places: the samples are written there and never lie on the stack. A function of its
/// own, because what its caller calls next is the deepest there is.
#[inline(never)]
pub fn open_capture(
    place: &'static mut MaybeUninit<NodeCapture>,
    ring: &'static mut MaybeUninit<SampleRing>,
) -> &'static mut NodeCapture {
    place.write(Capture::new(ring.write(SampleRing::EMPTY)))
}

/// State of the main loop.
pub struct Runner<F: NorFlash + 'static> {
    session: &'static mut NodeSession,
    store: Store<F>,
    clock: TicksPerSecond,
    /// Whether a crystal drives the clocks, for the light.
    crystal: bool,
    /// Why the stored configuration was not taken, until it has been said.
    complaint: Option<u32>,
    flash_code: FlashCode,
    lost_edges: u32,
    good_run: GoodRun,
    /// When the last block came.
    block_seen: Option<u32>,
    stack_seen: u32,
    stack_due: u32,
    /// As the board's line is set.
    format: LineFormat,
    /// The slots of images, where the board has some.
    updater: Option<&'static mut Updater<F>>,
    trial: Trial,
    /// The stored configuration is the one in force, or there is none.
    configuration_taken: bool,
    /// Since when a complete update waits for its answer to leave.
    restart_since: Option<u32>,
    health_watch: HealthWatch,
    health_due: Option<u32>,
}

/// The configuration to start with.
pub struct Beginning {
    configuration: Configuration,
    origin: Origin,
    /// Too many starts in a row have failed.
    safe: bool,
}

impl Beginning {
    /// The stored configuration, or the default where none is to be had or too many `failures` came in a row. A
    /// function of its own: what reading takes of the stack is given back before the node is built.
    #[inline(never)]
    pub fn load<F: NorFlash>(store: &mut Store<F>, timing: Timing, failures: u32) -> Self {
        let safe = is_safe_start(failures);
        let (configuration, origin) = if safe { (Configuration::default(), Origin::Blank) } else { store.load(timing) };
        Self { configuration, origin, safe }
    }
}

impl<F: NorFlash + 'static> Runner<F> {
    /// The node with the configuration to start with, and what it has to say about a stored one that was not taken; for
    /// [`Runner::begin`].
    ///
    /// Built in a place of the caller's that is no part of the stack, and in one expression: each wrapping of these
    /// 12 KB, and each change before they lie where they stay, is a copy on the stack. A clock on which not even the
    /// default can run is a crash.
    #[inline(never)]
    pub fn open(
        place: &'static mut MaybeUninit<NodeSession>,
        store: Store<F>,
        Beginning { configuration, origin, safe }: &Beginning,
        timing: Timing,
        crystal: bool,
        arrays: LentArrays<'static>,
        updater: Option<&'static mut Updater<F>>,
    ) -> Self {
        defmt::info!("configuration: {}", origin);
        if configuration.validate(timing).is_err() {
            crash::on_cause(Cause::Start)
        }
        Self {
            store,
            clock: timing.clock,
            crystal,
            complaint: origin.complaint(),
            flash_code: FlashCode::new(timing.clock.0),
            lost_edges: 0,
            good_run: GoodRun::new(timing.clock),
            block_seen: None,
            stack_seen: 0,
            stack_due: 0,
            format: LineFormat::MESHBAND,
            updater,
            trial: Trial::new(timing.clock),
            configuration_taken: !safe && !matches!(origin, Origin::Refused | Origin::Unreadable),
            restart_since: None,
            health_watch: HealthWatch::default(),
            health_due: None,
            session: place.write(Session::of_valid(configuration, timing, arrays)),
        }
    }

    /// Which image runs, and why it started.
    pub fn running_image(&self, started: StartCause) -> RunningImage {
        self.updater.as_ref().map_or(RunningImage::NONE, |updater| updater.running(started))
    }

    /// Begins the session and notes what is to be said of the start after `failures` in a row.
    pub fn begin(&mut self, identity: Identity, failures: u32) {
        self.session.begin(identity);
        if let Some(complaint) = self.complaint.take() {
            self.session.node_mut().note(EventKind::ConfigurationRefused, complaint);
        }
        if is_safe_start(failures) {
            self.note(BoardEvent::SafeStart, failures);
        }
        if !self.crystal {
            self.session.node_mut().set_clock_tolerance(INTERNAL_OSCILLATOR_PPM);
            self.note(BoardEvent::InternalOscillator, 0);
        }
    }

    /// Takes over a session.
    pub fn new(session: &'static mut NodeSession, store: Store<F>, clock: TicksPerSecond, crystal: bool) -> Self {
        let (lost_edges, block_seen, stack_seen, stack_due) = (0, None, 0, 0);
        let (flash_code, good_run) = (FlashCode::new(clock.0), GoodRun::new(clock));
        let complaint = None;
        Self {
            session,
            store,
            clock,
            crystal,
            complaint,
            flash_code,
            lost_edges,
            good_run,
            block_seen,
            stack_seen,
            stack_due,
            format: LineFormat::MESHBAND,
            updater: None,
            trial: Trial::new(clock),
            configuration_taken: true,
            restart_since: None,
            health_watch: HealthWatch::default(),
            health_due: None,
        }
    }

    /// The session.
    pub fn session(&mut self) -> &mut NodeSession {
        self.session
    }

    /// Records an event of the board.
    pub fn note(&mut self, event: BoardEvent, number: u32) {
        self.session.node_mut().note(EventKind::Board, event.detail(number));
    }

    /// Reports why the board started, by its own number, and the crash if it was one (`after_crash`: the processor
    /// reset itself).
    pub fn report_start(&mut self, reset_cause: u32, after_crash: bool) {
        defmt::info!("started, cause {=u32}", reset_cause);
        self.session.node_mut().note(EventKind::Started, reset_cause);
        if let Some(crash) = crash::last().filter(|_| after_crash) {
            defmt::error!("restarted after crash {=u32} at {=str}:{=u32:x}", crash.count, crash.file(), crash.place);
            // All of a program counter but which memory it lies in: code lies in one.
            self.note(BoardEvent::Crash, crash.place & 0x00ff_ffff);
        }
    }

    /// What a board does for ever: one turn, the stack, and sleep where there was nothing to do.
    pub fn work(&mut self, board: &mut impl Board) {
        let worked = self.turn(board);
        self.watch_stack(board.now());
        if !worked {
            board.wait();
        }
    }

    /// One turn: bytes, then at most one block; false if there was no block.
    pub fn turn(&mut self, board: &mut impl Board) -> bool {
        // Read before the queue of blocks: what they promise then holds for everything found in it.
        let (horizon, now) = (board.horizon(), board.now());
        // A converter that has stopped is as bad as a loop that hangs: the watchdog restarts both.
        let sampling =
            now.wrapping_sub(*self.block_seen.get_or_insert(now)) < self.clock.0.saturating_mul(BLOCK_PATIENCE_S);
        if sampling {
            board.feed_watchdog();
        }
        self.follow_update(now, sampling);
        if self.good_run.is_reached(now) {
            crash::forgive();
        }
        board.pump();
        self.serve_link(board);
        self.follow_line(board);
        board.catch_up();
        let due = Due::of(horizon, board.pending_end());
        while let Some(edge) = board.next_edge_before(due.edges_before) {
            self.session.on_edge(edge);
        }
        if due.block {
            self.block_seen = Some(now);
            self.take_block(board, now);
        }
        self.report(board, now);
        self.follow_health(board, now);
        due.block
    }

    /// Commands from the host, and what they ask of the flash.
    pub fn serve_link(&mut self, link: &mut impl Link) {
        // Where there is no room for a reply the bytes wait in the board's circle.
        while self.session.takes_commands()
            && let Some(byte) = link.receive()
        {
            let (trial, taken, test) = (&self.trial, self.configuration_taken, self.session.node().self_test());
            let updater = &mut self.updater;
            let mut update = |step: &UpdateRequest| match updater {
                Some(updater) => updater.on_request(step, trial.missing(taken, test)),
                None => UpdateStatus::NOT_SUPPORTED,
            };
            self.session.on_byte_with(byte, &mut update, &mut |frame| {
                link.send(frame);
            });
        }
        if self.session.take_commit() {
            let stored = self.store.save(self.session.node().configuration()).is_ok();
            defmt::info!("configuration stored: {=bool}", stored);
            if stored {
                crash::forgive();
            }
            self.session.on_stored(stored);
        }
    }

    /// The part of an update that goes by turns and by the clock: erasing, events, the restart into a new image, and
    /// the end of a trial that nobody has confirmed.
    fn follow_update(&mut self, now: u32, sampling: bool) {
        let Some(updater) = &mut self.updater else { return };
        self.trial.follow(now, sampling);
        if let Some(detail) = updater.take_step() {
            let node = self.session.node_mut();
            node.note(EventKind::Update, detail);
            let identity = node.identity();
            node.set_identity(Identity { image: updater.running(identity.image.started), ..identity });
        }
        if updater.is_on_trial() && self.trial.is_over() {
            crash::restart()
        }
        if updater.stage() == Stage::Restarting
            && now.wrapping_sub(*self.restart_since.get_or_insert(now)) > self.clock.0 / FAREWELL_PER_SECOND
        {
            crash::restart()
        }
        updater.work();
    }

    /// Answers a Modbus master, and sets the board's line to what is spoken on it.
    fn follow_line(&mut self, board: &mut impl Board) {
        // Read behind the bytes: what was not there by now has not ended.
        let now = board.now();
        self.session.follow_line(now, &mut |answer| {
            board.send(answer);
        });
        let format = self.session.line_format();
        if format != self.format {
            self.format = format;
            board.set_format(format);
        }
    }

    fn take_block(&mut self, board: &mut impl Board, now: u32) {
        // The frames of a block leave after the block is given back: its buffer is free again the sooner.
        let session = &mut *self.session;
        let mut end = now;
        board.with_block(&mut |block| end = session.take_block(block, now));
        session.send_messages(end, &mut |frame| {
            board.send(frame);
        });
        if let Some(frames) = board.take_dropped() {
            session.node_mut().note(EventKind::MessagesDropped, frames);
        }
        board.set_period_ticks(session.node().requested_period_ticks());
    }

    /// Light and lost edges.
    fn report(&mut self, board: &mut impl Board, now: u32) {
        let node = self.session.node();
        let code = Code::of(node.state(), self.crystal, node.self_test().failed != 0, node.alarm_stands());
        board.set_light(self.flash_code.is_lit(code.flashes(), now));
        let lost = board.lost_edges();
        if lost != self.lost_edges {
            self.lost_edges = lost;
            self.note(BoardEvent::EdgesLost, lost);
        }
        self.session.node_mut().note_waiting(board.most_waiting());
    }

    /// Pulses per second as they come, and once a second what the board measures of itself.
    fn follow_health(&mut self, board: &mut impl Board, now: u32) {
        if let Some(tick) = board.next_second_pulse() {
            self.session.node_mut().on_second_pulse(tick);
        }
        if now.wrapping_sub(*self.health_due.get_or_insert(now)) < self.clock.0 {
            return;
        }
        self.health_due = Some(now);
        let health = board.health();
        self.session.node_mut().set_board_health(health);
        for change in self.health_watch.follow(health).into_iter().flatten() {
            match change {
                HealthChange::Supply(volts) => self.note(BoardEvent::Supply, (volts * 1e3) as u32),
                HealthChange::Temperature(celsius) => {
                    self.note(BoardEvent::Temperature, (celsius + ZERO_CELSIUS_K) as u32);
                }
            }
        }
    }

    /// Looks at the stack's paint every few seconds and reports a new depth; not called where frames are compared with
    /// those of a host that has no such stack.
    pub fn watch_stack(&mut self, now: u32) {
        // Due at start and then every few seconds; wrapping order of ticks.
        if (now.wrapping_sub(self.stack_due) as i32) >= 0 || self.stack_due == 0 {
            self.stack_due = now.wrapping_add(self.clock.0.saturating_mul(STACK_PERIOD_S));
            let StackUse { used, .. } = stack::high_water();
            if used >= self.stack_seen.saturating_add(STACK_STEP) {
                self.stack_seen = used;
                self.note(BoardEvent::StackDepth, used);
            }
        }
    }

    /// Answers a request as if the host had sent it.
    pub fn on_request(&mut self, request: Request, link: &mut impl Link) {
        self.session.on_request(request, &mut |frame| {
            link.send(frame);
        });
    }
}
