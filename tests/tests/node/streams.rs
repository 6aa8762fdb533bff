//! Everything that a node says, to the last bit, on courses that lead through most of what it can do: committed
//! checksums of its frames and of its registers, stretch by stretch.
//!
//! The other tests hold single figures within tolerances. This one tells that something has changed at all, and in
//! which stretch it shows first; whether the change is right is for the others to say. After one that is meant, the
//! printed lines replace the committed ones.
//!
//! The machine is made of sums and products alone, so that its codes do not depend on a mathematics library.

use meshband::alarm::{AlarmBand, AlarmHolding, Watched};
use meshband::config::{CaptureConfig, CaptureRate, Configuration, GearPair, MeshBandConfig, PassBand, TachWheel};
use meshband::events::EventKind;
use meshband::frame::{CRC32, Decoder, MAX_FRAME, Packet, encode};
use meshband::identity::Identity;
use meshband::law::{Law, LawForm, LawKnot, LawTable};
use meshband::levels::{ExpectedLevel, LevelPoint, LocalPoint};
use meshband::message::{Reply, Request};
use meshband::modbus::bank::Bank;
use meshband::modbus::map::{REGISTERS, Traffic, View, bits, read};
use meshband::node::Block;
use meshband::rate_plan::RatePolicy;
use meshband::session::Session;
use meshband::units::{Acceleration, Hertz, TicksPerSecond};
use meshband::update::UpdateRequest;
use meshband::waveform::{CapturePart, CaptureReport, PART_BYTES};

const CODES: usize = 512;

/// Frames, their bytes' checksum, and that of the registers after a stretch.
type Said = (&'static str, u32, u32, u32);

/// What is wrong in a stretch.
#[derive(Clone, Copy, PartialEq)]
enum Wrong {
    Nothing,
    /// The first of these strikes per turn, and the signal so many times as strong.
    Struck(f64),
    NoPulses,
    Overruns,
    LostBlocks,
    /// The same code always.
    Constant(u16),
    /// Pulses beside their places.
    StrayPulses,
}

/// Node, machine and line.
struct Course {
    session: Session,
    clock_hz: u32,
    decoder: Decoder,
    bank: Bank,
    /// Places of the wheel for a turn of the pinion, and how many of them make its turn, the last of which is empty;
    /// 0 where none is.
    pulses: f64,
    places: u64,
    time: u64,
    turns: f64,
    sequence: u32,
    period: u32,
    random: u64,
    asked: u16,
    replies: Vec<Reply>,
    said: Vec<Said>,
}

/// A wave of one turn's period between -1 and 1: two parabolas.
fn wave(turns: f64) -> f64 {
    let at = turns - turns.floor();
    if at < 0.5 { 16.0 * at * (0.5 - at) } else { 16.0 * (at - 0.5) * (at - 1.0) }
}

impl Course {
    fn new(config: Configuration, clock_hz: u32, pulses: f64, places: u64) -> Self {
        let session = Session::new(config, TicksPerSecond(clock_hz), Identity::HOST).expect("a valid configuration");
        Self {
            period: session.node().requested_period_ticks(),
            session,
            clock_hz,
            decoder: Decoder::new(),
            bank: Bank::default(),
            pulses,
            places,
            // The board's counter comes round within the first second.
            time: u64::from(u32::MAX) - u64::from(clock_hz) / 2,
            turns: 0.0,
            sequence: 0,
            random: 0x9e37_79b9_7f4a_7c15,
            asked: 0,
            replies: Vec::new(),
            said: Vec::new(),
        }
    }

    /// Between 0 and 1.
    fn chance(&mut self) -> f64 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        (self.random >> 40) as f64 / f64::from(1u32 << 24)
    }

    /// Code at an angle.
    fn code(&mut self, turns: f64, teeth: f64, wrong: Wrong) -> u16 {
        if let Wrong::Constant(code) = wrong {
            return code;
        }
        let modulation = 1.0 + 0.2 * wave(turns);
        let mesh = wave(teeth * turns) + 0.5 * wave(2.0 * teeth * turns + 0.1) + 0.2 * wave(5.0 * teeth * turns);
        let (strength, strike) = match wrong {
            Wrong::Struck(strength) if turns - turns.floor() < 0.004 => (strength, 6000.0),
            Wrong::Struck(strength) => (strength, 0.0),
            _ => (1.0, 0.0),
        };
        let noise = 40.0 * (self.chance() - 0.5);
        let value = strength * (2000.0 * modulation * mesh + 300.0 * wave(turns)) + strike * wave(40.0 * turns) + noise;
        (value + 32_768.5).clamp(0.0, 65_535.0) as u16
    }

    /// A stretch with the speed going evenly from one value to another, and what is asked at its middle.
    fn stretch(&mut self, name: &'static str, seconds: f64, speeds_hz: [f64; 2], wrong: Wrong, asked: &[Request]) {
        let teeth = f64::from(self.session.node().configuration().gears.pinion_teeth);
        let mut heard: Vec<u8> = Vec::new();
        let (start, clock) = (self.time, f64::from(self.clock_hz));
        let middle = start + (0.5 * seconds * clock) as u64;
        let mut is_asked = false;
        let mut codes = [0; CODES];
        while self.time < start + (seconds * clock) as u64 {
            let first = self.time;
            if first >= middle && !is_asked {
                is_asked = true;
                asked.iter().for_each(|request| self.ask(request, &mut heard));
            }
            let mut edges = Vec::new();
            for (n, code) in codes.iter_mut().enumerate() {
                let tick = first + n as u64 * u64::from(self.period);
                let speed = speeds_hz[0] + (speeds_hz[1] - speeds_hz[0]) * ((tick - start) as f64 / clock / seconds);
                let before = self.turns;
                self.turns += speed * f64::from(self.period) / clock;
                *code = self.code(before, teeth, wrong);
                let border = (self.turns * self.pulses).floor();
                let is_empty = self.places > 0 && border as u64 % self.places == self.places - 1;
                if border > (before * self.pulses).floor() && !is_empty {
                    let share = (border / self.pulses - before) / (self.turns - before);
                    edges.push(tick + (share * f64::from(self.period)) as u64);
                }
            }
            self.time += CODES as u64 * u64::from(self.period);
            if wrong == Wrong::StrayPulses && self.chance() < 0.2 {
                edges.push(first + (self.chance() * (self.time - first) as f64) as u64);
                edges.sort_unstable();
            }
            if wrong != Wrong::NoPulses {
                edges.iter().for_each(|&edge| self.session.on_edge(edge as u32));
            }
            let tenth = self.sequence % 10 == 9;
            if !(tenth && wrong == Wrong::LostBlocks) {
                let block = Block {
                    codes: &codes,
                    second: &[],
                    first_tick: first as u32,
                    period_ticks: self.period,
                    sequence: self.sequence,
                    overrun: tenth && wrong == Wrong::Overruns,
                };
                self.session.on_block(block, &mut |frame| heard.extend_from_slice(frame));
            }
            self.sequence = self.sequence.wrapping_add(1);
            self.period = self.session.node().requested_period_ticks();
        }
        self.conclude(name, &heard);
    }

    fn ask(&mut self, request: &Request, heard: &mut Vec<u8>) {
        let mut room = [0; MAX_FRAME];
        let frame = encode(request, self.asked, &mut room).expect("fits").to_vec();
        self.asked = self.asked.wrapping_add(1);
        for byte in frame {
            self.session.on_byte(byte, &mut |frame| heard.extend_from_slice(frame));
        }
    }

    /// Notes what was said in a stretch, and what a Modbus master would read behind it.
    fn conclude(&mut self, name: &'static str, heard: &[u8]) {
        let mut frames = 0;
        for packet in heard.iter().filter_map(|&byte| self.decoder.push(byte)).map(|frame| frame.expect("whole").packet)
        {
            frames += 1;
            match packet {
                Packet::Message(message) => self.bank.take(&message, self.time),
                Packet::Reply(reply) => self.replies.push(reply),
                Packet::Request(_) => {}
            }
        }
        let view = View::of(self.session.node(), &self.bank, Traffic::default());
        let mut registers = bits(&view).to_le_bytes().to_vec();
        for register in REGISTERS {
            let mut put = |word: u16| registers.extend(word.to_le_bytes());
            // A pair is read whole.
            let whole = (1..=4).any(|count| read(register.address, count, &view, &mut put).is_some());
            assert!(whole, "{} can be read", register.name);
        }
        self.said.push((name, frames, CRC32.checksum(heard), CRC32.checksum(&registers)));
    }

    /// Reads the waveform held, and lets the node use the memory again.
    fn fetch(&mut self, name: &'static str) {
        let mut heard = Vec::new();
        self.ask(&Request::GetCapture, &mut heard);
        self.conclude("", &heard);
        self.said.pop();
        let held = self.replies.iter().rev().find_map(|reply| match reply {
            Reply::Capture(CaptureReport { head: Some(head), .. }) => Some(*head),
            _ => None,
        });
        let head = held.expect("a waveform is held");
        for offset in (0..head.bytes).step_by(PART_BYTES) {
            self.ask(&Request::ReadCapture { number: head.facts.number, offset }, &mut heard);
        }
        self.ask(&Request::ReleaseCapture { number: head.facts.number }, &mut heard);
        self.conclude(name, &heard);
        let of_head = |part: &CapturePart| part.number == head.facts.number;
        let bytes: Vec<u8> = self
            .replies
            .drain(..)
            .filter_map(|reply| match reply {
                Reply::CapturePart(part) if of_head(&part) => Some(part.bytes),
                _ => None,
            })
            .flatten()
            .collect();
        assert_eq!(CRC32.checksum(&bytes), head.checksum, "as the node sealed it");
    }

    /// The committed lines are what was said; the course was one in which these events occur.
    fn held_against(&self, committed: &[Said], occurred: &[EventKind]) {
        for (name, frames, said, registers) in &self.said {
            println!("    (\"{name}\", {frames}, {said:#010x}, {registers:#010x}),");
        }
        for kind in occurred {
            assert!(self.session.node().statistics().count(*kind) > 0, "{kind:?} occurred");
        }
        for (found, expected) in self.said.iter().zip(committed) {
            assert_eq!(found, expected, "first difference in the stretch `{}`", found.0);
        }
        assert_eq!(self.said.len(), committed.len());
    }
}

fn alarm(watched: Watched, [from, to]: [f32; 2], [raise, clear]: [f32; 2], persistence: u8) -> AlarmBand {
    AlarmBand { watched, from: Hertz(from), to: Hertz(to), raise, clear, persistence }
}

fn level(speed: f32, levels_db: [f32; 4]) -> LevelPoint {
    let [rms, velocity_rms, mesh_amplitude, residual_rms] =
        levels_db.map(|level_db| ExpectedLevel { level_db, uncertainty_db: 1.5 });
    LevelPoint { speed: Hertz(speed), rms, velocity_rms, mesh_amplitude, residual_rms }
}

fn local_level(speed: f32, levels_db: [f32; 2]) -> LocalPoint {
    let [sidebands, fm0] = levels_db.map(|level_db| ExpectedLevel { level_db, uncertainty_db: 1.5 });
    LocalPoint { speed: Hertz(speed), sidebands, fm0 }
}

/// A slow machine with one pulse a turn, watched in every way.
fn watched() -> Configuration {
    let form = LawForm::Quadratic { a_per_hz: 4.0, b: 300.0, c_hz: 200.0 };
    let alarms = [
        alarm(Watched::Rms, [2.0, 15.0], [6.0, 5.0], 1),
        alarm(Watched::Rms, [15.0, 30.0], [8.0, 7.0], 2),
        alarm(Watched::Kurtosis, [2.0, 30.0], [3.0, 2.5], 1),
        alarm(Watched::Departure, [5.0, 25.0], [3.0, 2.0], 2),
        alarm(Watched::VelocityRms, [5.0, 25.0], [0.004, 0.003], 1),
        alarm(Watched::SidebandEnergyRatio, [5.0, 25.0], [0.2, 0.1], 1),
        alarm(Watched::Fm4, [5.0, 25.0], [4.0, 3.0], 1),
        alarm(Watched::BandwidthRatio, [5.0, 25.0], [1.5, 1.2], 1),
    ];
    let mut config = Configuration {
        gears: GearPair { pinion_teeth: 19, gear_teeth: 48 },
        law: Law { form, lowest: Hertz(1.0), highest: Hertz(25.0), provisional: false, ..Law::PROVISIONAL },
        alarms: alarms.into_iter().collect(),
        holding: AlarmHolding { latching: true, persistence_s: 1.0, watch_signal: true },
        levels: [
            level(5.0, [9.0, -50.0, 9.0, -3.0]),
            level(12.0, [10.0, -52.0, 9.0, -2.0]),
            level(25.0, [9.5, -58.0, 9.0, -1.0]),
        ]
        .into_iter()
        .collect(),
        local_levels: [local_level(5.0, [-20.0, 12.0]), local_level(25.0, [-15.0, 14.0])].into_iter().collect(),
        capture: CaptureConfig { keep: CaptureRate::Fixed, rate: Hertz(0.0) },
        ..Configuration::default()
    };
    config.tach.lowest = Hertz(1.0);
    config.limits.analogue_stop = Hertz(12_000.0);
    config.limits.highest_adc = Hertz(40_000.0);
    config.sensor.acceleration_per_code = Acceleration(0.002);
    config
}

/// A faster one with a wheel of fifteen pulses at sixteen places on the gear's shaft, a law of knots, and a sensor
/// that ends early.
fn geared() -> Configuration {
    let knots = [(3.0, 900.0), (10.0, 2500.0), (20.0, 4200.0), (40.0, 6000.0)];
    let knots: Vec<LawKnot> = knots
        .into_iter()
        .map(|(speed, bandwidth)| LawKnot { speed: Hertz(speed), bandwidth: Hertz(bandwidth) })
        .collect();
    let form = LawForm::Tabulated(LawTable::new(&knots).expect("ascending"));
    let mut config = Configuration {
        gears: GearPair { pinion_teeth: 24, gear_teeth: 36 },
        tach: TachWheel {
            pulses_per_turn: 16,
            missing: 1,
            pinion_per_tach: 1.5,
            highest: Hertz(40.0),
            lowest: Hertz(0.5),
        },
        law: Law { form, lowest: Hertz(3.0), highest: Hertz(40.0), provisional: false, ..Law::PROVISIONAL },
        policy: RatePolicy::Waveform { multiple: 4.0 },
        mesh: MeshBandConfig { harmonics: 3, sidebands: 2 },
        alarms: [
            alarm(Watched::Peak, [5.0, 40.0], [14.0, 12.0], 1),
            alarm(Watched::OncePerTurn, [5.0, 40.0], [2.0, 1.0], 2),
        ]
        .into_iter()
        .collect(),
        pass: PassBand { analogue: Hertz(9_000.0), sensor: Hertz(5_000.0) },
        capture: CaptureConfig { keep: CaptureRate::Law, rate: Hertz(0.0) },
        ..Configuration::default()
    };
    config.limits.analogue_stop = Hertz(15_000.0);
    config.limits.highest_adc = Hertz(60_000.0);
    config.sensor.acceleration_per_code = Acceleration(0.002);
    config
}

/// A fast one that nobody has told its sensor, with a law of one mode and the fewest samples for it.
fn fast() -> Configuration {
    let form = LawForm::Physical { ramp_turns: 0.004, mode_rise_s: 2.0e-6 };
    let mut config = Configuration {
        gears: GearPair { pinion_teeth: 33, gear_teeth: 21 },
        law: Law { form, lowest: Hertz(5.0), highest: Hertz(80.0), ..Law::PROVISIONAL },
        policy: RatePolicy::Critical,
        mesh: MeshBandConfig { harmonics: 6, sidebands: 4 },
        alarms: [
            alarm(Watched::Crest, [5.0, 70.0], [4.0, 3.5], 1),
            alarm(Watched::Fm0, [5.0, 70.0], [3.0, 2.9], 1),
            alarm(Watched::MeshAmplitude, [5.0, 70.0], [40.0, 30.0], 1),
        ]
        .into_iter()
        .collect(),
        holding: AlarmHolding { latching: false, persistence_s: 0.0, watch_signal: true },
        capture: CaptureConfig { keep: CaptureRate::Fixed, rate: Hertz(25_000.0) },
        ..Configuration::default()
    };
    config.tach.lowest = Hertz(2.0);
    config.limits.highest_adc = Hertz(210_000.0);
    config
}

#[test]
fn golden_a_watched_machine_from_standstill_to_alarm_and_faults() {
    use Wrong::{Constant, LostBlocks, NoPulses, Nothing, Overruns, StrayPulses, Struck};
    let mut course = Course::new(watched(), 25_000_000, 1.0, 0);
    course.stretch("standstill", 1.5, [0.0, 0.0], Nothing, &[Request::Statistics, Request::GetLaw]);
    course.stretch("run-up", 4.0, [4.0, 14.0], Nothing, &[Request::Snapshot]);
    let asked = [Request::GetConfiguration, Request::Events, Request::Snapshot, Request::TriggerCapture];
    course.stretch("steady", 5.0, [14.0, 14.0], Nothing, &asked);
    course.fetch("waveform asked for");
    course.stretch("struck", 6.0, [14.0, 14.0], Struck(1.0), &[Request::Statistics]);
    course.stretch("stronger", 4.0, [14.0, 20.0], Struck(3.0), &[Request::AcknowledgeAlarms]);
    course.fetch("waveform of an alarm");
    course.stretch("calm again", 4.0, [20.0, 20.0], Nothing, &[Request::AcknowledgeAlarms]);
    course.stretch("no pulses", 2.5, [20.0, 20.0], NoPulses, &[]);
    course.stretch("pulses back", 2.0, [20.0, 20.0], StrayPulses, &[Request::Events]);
    course.stretch("overruns", 1.0, [20.0, 20.0], Overruns, &[]);
    course.stretch("lost blocks", 1.0, [20.0, 20.0], LostBlocks, &[]);
    course.stretch("dead sensor", 4.0, [20.0, 20.0], Constant(32_768), &[Request::SelfTest]);
    course.stretch("at the rail", 4.0, [20.0, 20.0], Constant(65_535), &[Request::Statistics]);
    course.stretch("run-down", 6.0, [20.0, 2.0], Nothing, &[Request::Stop]);
    let asked = [Request::Start, Request::GetConfiguration, Request::AcknowledgeAlarms];
    course.stretch("started", 12.0, [6.0, 6.0], Nothing, &asked);
    let occurred = [
        EventKind::TachLocked,
        EventKind::TachDoubtful,
        EventKind::RateChanged,
        EventKind::BlocksLost,
        EventKind::Overrun,
        EventKind::Saturated,
        EventKind::Stuck,
        EventKind::AlarmRaised,
        EventKind::AlarmCleared,
        EventKind::AlarmsAcknowledged,
        EventKind::SignalBad,
        EventKind::SignalGood,
        EventKind::CaptureHeld,
        EventKind::CaptureMissed,
    ];
    course.held_against(&WATCHED_EVENTS, &occurred);
}

#[test]
fn golden_a_wheel_with_a_missing_tooth_a_law_of_knots_and_a_change_of_both() {
    use Wrong::{Nothing, StrayPulses, Struck};
    let mut course = Course::new(geared(), 84_000_000, 16.0 / 1.5, 16);
    course.stretch("standstill", 0.5, [0.0, 0.0], Nothing, &[Request::SelfTest]);
    course.stretch("run-up", 3.0, [3.0, 30.0], Nothing, &[Request::Snapshot]);
    course.stretch("steady", 3.0, [30.0, 30.0], Nothing, &[Request::TriggerCapture, Request::Statistics]);
    course.stretch("struck", 3.0, [30.0, 31.0], Struck(1.5), &[Request::Events]);
    course.fetch("waveform asked for");
    course.stretch("stray pulses", 1.5, [31.0, 31.0], StrayPulses, &[]);
    let law = watched().law;
    course.stretch("another law", 2.0, [31.0, 24.0], Nothing, &[Request::PutLaw(law), Request::GetLaw]);
    let without_gap = Configuration { tach: TachWheel { missing: 0, ..geared().tach }, ..geared() };
    course.stretch("another wheel", 2.0, [24.0, 24.0], Nothing, &[Request::SetConfiguration(without_gap)]);
    let refused = Configuration { gears: GearPair { pinion_teeth: 0, gear_teeth: 36 }, ..geared() };
    course.stretch("refused", 1.0, [24.0, 24.0], Nothing, &[Request::SetConfiguration(refused), Request::Statistics]);
    let occurred = [
        EventKind::TachLocked,
        EventKind::TachDoubtful,
        EventKind::RateChanged,
        EventKind::LawClamped,
        EventKind::AlarmRaised,
        EventKind::CaptureHeld,
    ];
    course.held_against(&GEARED_EVENTS, &occurred);
}

#[test]
fn golden_a_fast_machine_with_a_provisional_law() {
    use Wrong::{LostBlocks, NoPulses, Nothing, Overruns, Struck};
    let mut course = Course::new(fast(), 100_000_000, 1.0, 0);
    course.stretch("standstill", 0.5, [0.0, 0.0], Nothing, &[Request::Events]);
    course.stretch("run-up", 3.0, [2.0, 60.0], Nothing, &[Request::Snapshot, Request::TriggerCapture]);
    course.stretch("steady", 3.0, [60.0, 60.0], Nothing, &[Request::SelfTest, Request::Snapshot]);
    course.fetch("waveform asked for");
    course.stretch("struck", 2.0, [60.0, 60.0], Struck(4.0), &[Request::GetLaw]);
    course.stretch("calm again", 2.0, [60.0, 60.0], Nothing, &[Request::TriggerCapture, Request::TriggerCapture]);
    course.stretch("lost blocks", 1.0, [60.0, 60.0], LostBlocks, &[Request::Statistics]);
    course.stretch("overruns", 1.0, [60.0, 60.0], Overruns, &[Request::Statistics]);
    course.fetch("waveform in spite of gaps");
    course.stretch("no pulses", 3.0, [60.0, 60.0], NoPulses, &[Request::Snapshot]);
    let forced = Configuration { policy: RatePolicy::Forced { rate: Hertz(50_000.0) }, ..fast() };
    course.stretch("forced rate", 2.0, [60.0, 50.0], Nothing, &[Request::SetConfiguration(forced)]);
    course.stretch(
        "rest",
        2.0,
        [50.0, 0.0],
        Nothing,
        &[Request::CommitConfiguration, Request::Update(UpdateRequest::Status)],
    );
    course.held_against(&FAST_EVENTS, &[EventKind::AlarmRaised, EventKind::RateLimited, EventKind::CaptureHeld]);
}

/// Of [`fast`].
const FAST_EVENTS: [Said; 12] = [
    ("standstill", 4, 0x0c69f949, 0x9b65b100),
    ("run-up", 59, 0x0897e1b8, 0x5b4adf14),
    ("steady", 55, 0x1f399d85, 0xd2b7632e),
    ("waveform asked for", 39, 0x9b425b15, 0xffa8eaa2),
    ("struck", 12, 0xe3adda5b, 0x894711e8),
    ("calm again", 15, 0xf8addb6f, 0xd9fbb580),
    ("lost blocks", 4, 0xb3bd4a63, 0x27f00542),
    ("overruns", 11, 0x4743b83e, 0xa4698567),
    ("waveform in spite of gaps", 44, 0x10874626, 0xad0d5815),
    ("no pulses", 45, 0x98717274, 0x530774b0),
    ("forced rate", 15, 0xfee39f8c, 0x860dff27),
    ("rest", 14, 0x91fde39a, 0x03350c24),
];

/// Of [`watched`].
const WATCHED_EVENTS: [Said; 16] = [
    ("standstill", 8, 0xd5599333, 0xbb2f87a6),
    ("run-up", 53, 0xeaad32c8, 0xc85bbeb1),
    ("steady", 75, 0x2197ec49, 0xe989006c),
    ("waveform asked for", 22, 0x2393ea8a, 0x94192bbc),
    ("struck", 25, 0xb2ad1a81, 0xd5257e08),
    ("stronger", 21, 0x180b9f13, 0xb8db333a),
    ("waveform of an alarm", 44, 0xdc99922d, 0x5aa50d16),
    ("calm again", 21, 0x45d65eb1, 0x164bd147),
    ("no pulses", 11, 0x35e8f066, 0xece98a28),
    ("pulses back", 42, 0x5bd09a6c, 0x37444f8b),
    ("overruns", 9, 0xe4588db8, 0x9d846200),
    ("lost blocks", 3, 0xeca89314, 0xd30f89c3),
    ("dead sensor", 24, 0x54ffaa38, 0x7e4984ab),
    ("at the rail", 24, 0xdd9c3b4b, 0x8f0be66c),
    ("run-down", 16, 0x479cc605, 0x6a3eac75),
    ("started", 27, 0xa2100b06, 0xde564506),
];

/// Of [`geared`].
const GEARED_EVENTS: [Said; 9] = [
    ("standstill", 2, 0x381eb11b, 0x2b709ebc),
    ("run-up", 57, 0x2a8cec7f, 0xcbca31f3),
    ("steady", 18, 0x077ea139, 0x2037133c),
    ("struck", 28, 0x015e66d4, 0x7efeaae2),
    ("waveform asked for", 44, 0x9ae09034, 0x24c05fa5),
    ("stray pulses", 12, 0x20794385, 0x02140894),
    ("another law", 13, 0x1e5c43f6, 0x524261c7),
    ("another wheel", 13, 0x7a2fa5e7, 0x74019483),
    ("refused", 7, 0x1674b4db, 0xbb499831),
];
