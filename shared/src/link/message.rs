//! The link's vocabulary: requests, replies and streamed messages.
//!
//! Postcard encodes them by position. Variants are only ever appended, fields only at the end of the outermost
//! structure of a message (what lies inside another is fixed), and each time [`WIRE_SCHEMA`] is raised: readers of
//! another schema then take what they know ([`crate::schema`]). Any other change raises [`OLDEST_READER`], too, and
//! they are told to refuse.

use crate::config::{Configuration, ConfigurationError, MAX_HARMONICS, MAX_SIDEBANDS};
use crate::events::{Event, EventKind};
use crate::identity::{BOARD_LENGTH, BUILD_LENGTH};
use crate::law::Law;
use crate::levels::{Departures, LocalDepartures};
use crate::node::State;
use crate::node::health::Health;
use crate::node::wall_time::ToldTime;
use crate::shaft_lines::ShaftOrders;
use crate::tach::Validity;
use crate::update::{RunningImage, UpdateRequest, UpdateStatus};
use crate::waveform::{CapturePart, CapturePhase, CaptureReport};
use heapless::{String, Vec};
use serde::{Deserialize, Serialize};

/// Version of the messages; counted in one row with the protocols 1 and 2, which had no schema.
pub const WIRE_SCHEMA: u8 = 13;

/// Oldest schema whose readers can take what is sent here.
pub const OLDEST_READER: u8 = 3;

/// Oldest schema that is read here.
pub const OLDEST_READABLE: u8 = 3;

/// Most kinds of events in one message of counters.
pub const MAX_EVENT_COUNTS: usize = 64;

/// Samples in one snapshot message.
pub const SNAPSHOT_CHUNK: usize = 128;

/// Peaks listed per spectrum.
pub const MAX_PEAKS: usize = 12;

/// Commands to the node.
// No heap to box the large variants in; few values exist at a time.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Request {
    /// Who are you.
    Identify,
    /// Configuration in force.
    GetConfiguration,
    /// Replace the configuration in force (not stored until committed).
    SetConfiguration(Configuration),
    /// Store the configuration in force.
    CommitConfiguration,
    /// Law in force.
    GetLaw,
    /// Replace the law.
    PutLaw(Law),
    /// Measure.
    Start,
    /// Stop measuring.
    Stop,
    /// Send the next wideband waveform.
    Snapshot,
    /// Run the self-test again, unless the last request for it is less than a second old; its result comes as a
    /// message.
    SelfTest,
    /// Send all kept events again.
    Events,
    /// Counters.
    Statistics,
    /// A person has seen all alarms that stand: latched ones end.
    AcknowledgeAlarms,
    /// A step of an update.
    Update(UpdateRequest),
    /// Begin a waveform now, as an alarm does; answered by what the node does about waveforms.
    TriggerCapture,
    /// What the node does about waveforms, and which one it holds.
    GetCapture,
    /// Part of the bytes of the waveform held.
    ReadCapture {
        /// Which waveform.
        number: u32,
        /// First byte.
        offset: u32,
    },
    /// The waveform of this number has arrived, or is not wanted: the memory may be used again.
    ReleaseCapture {
        /// Which waveform.
        number: u32,
    },
    /// The node as a device.
    GetHealth,
    /// Time of day, as of the arrival of this command; answered by the node as a device.
    SetWallTime(ToldTime),
}

/// Answers.
// No heap to box the large variants in; few values exist at a time.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Reply {
    /// Who.
    Identity(Identification),
    /// Configuration in force.
    Configuration(Configuration),
    /// Law in force.
    Law(Law),
    /// Done, or on its way.
    Done,
    /// The board is to store the configuration; it confirms by itself.
    Committing,
    /// Refused: a field is out of range.
    Refused(ConfigurationError),
    /// Self-test begun; what is known of it already.
    SelfTest(SelfTest),
    /// Counters.
    Statistics(Statistics),
    /// How far an update is.
    Update(UpdateStatus),
    /// What the node does about waveforms.
    Capture(CaptureReport),
    /// Part of a waveform.
    CapturePart(CapturePart),
    /// The node as a device.
    Health(Health),
}

/// Who a node is; the schema numbers come first, so that every program can read them.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identification {
    /// [`WIRE_SCHEMA`] of the node.
    pub wire_schema: u8,
    /// [`crate::config::SCHEMA`] of the node: the layout in which it takes, gives and stores its configuration.
    pub configuration_schema: u16,
    /// Major, minor, patch of the firmware ([`crate::identity::VERSION`]).
    pub version: [u8; 3],
    /// What the image was built from: a commit's short hash, or `unknown`.
    pub build: String<BUILD_LENGTH>,
    /// Name of the board.
    pub board: String<BOARD_LENGTH>,
    /// The chip's own number; zero where it has none.
    pub unique_id: [u32; 3],
    /// Time base, Hz.
    pub ticks_per_second: u32,
    /// Newest result of the self-test.
    pub self_test: SelfTest,
    /// Which image runs and why.
    pub image: RunningImage,
}

/// Self-test ([`crate::self_test`]). A set bit in `failed` is a failed item of `run`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SelfTest {
    /// Items that ran: bit 0 sample count against timer, 1 ADC rails, 2 ADC noise, 3 tach edge seen, 4 mathematics
    /// hash.
    pub run: u8,
    /// Items that failed.
    pub failed: u8,
}

/// What every result carries: when, at which speed, at which rate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tag {
    /// Tick of the first sample of the result (group delay removed), since start.
    pub first_tick: u64,
    /// Pinion rate, Hz: the record's mean for mesh bands and averages, at the end of the result for others.
    pub speed_hz: f32,
    /// Relative standard uncertainty of the speed.
    pub speed_uncertainty: f32,
    /// Quality of the speed.
    pub validity: Validity,
    /// Granted sample period of the ADC, ticks.
    pub period_ticks: u32,
    /// Half-band stages between ADC and the result; in front of those of mesh bands a comb of any ratio, so read
    /// `rate_hz`.
    pub stages: u8,
    /// Sample rate of the result, Hz.
    pub rate_hz: f32,
    /// Line spacing of the spectrum, Hz.
    pub resolution_hz: f32,
    /// The ADC rate is below twice the analogue stop edge.
    pub aliasing: bool,
}

impl Tag {
    /// The default: all zero bytes, for statics.
    pub const ZERO: Self = Self {
        first_tick: 0,
        speed_hz: 0.0,
        speed_uncertainty: 0.0,
        validity: Validity::None,
        period_ticks: 0,
        stages: 0,
        rate_hz: 0.0,
        resolution_hz: 0.0,
        aliasing: false,
    };
}

/// Speed, law and rates.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// State of the node.
    pub state: State,
    /// Quality of the speed.
    pub validity: Validity,
    /// Tick of this status, since start.
    pub tick: u64,
    /// Pinion rate, Hz.
    pub speed_hz: f32,
    /// Relative standard uncertainty of the speed.
    pub speed_uncertainty: f32,
    /// Time since the latest accepted pulse, or since the start where none came, s.
    pub age_s: f32,
    /// Law's bandwidth, Hz.
    pub bandwidth_hz: f32,
    /// The speed lies outside the law's domain.
    pub law_clamped: bool,
    /// The law is provisional.
    pub law_provisional: bool,
    /// Output rate wanted at least, Hz.
    pub requested_hz: f32,
    /// Output rate granted, Hz.
    pub granted_hz: f32,
    /// ADC rate granted, Hz.
    pub adc_hz: f32,
    /// Granted sample period, ticks.
    pub period_ticks: u32,
    /// Half-band stages.
    pub stages: u8,
    /// Granted over wanted, less one, parts per million: 0 to one step of the sample period unless limited.
    pub residual_ppm: f32,
    /// The wanted rate is beyond the board.
    pub limited: bool,
    /// No usable speed: sampling at the safe maximum rate.
    pub safe_rate: bool,
    /// Sequence of the first block sampled at this rate.
    pub block: u32,
    /// Bandwidth that the whole way from the sensor to the products carries, Hz.
    pub available_hz: f32,
    /// What bounds it.
    pub bound: Bound,
    /// Alarms.
    pub alarms: AlarmState,
    /// What the node does about waveforms.
    pub capture: CapturePhase,
    /// Alarms of severity alert, one bit each: they stand in `alarms` as the others do, and do not move the output.
    pub alerts: u8,
    /// State of the sensor.
    pub sensor: SensorStatus,
}

/// State of the sensor: whether what it gives can be the machine's ([`crate::watch`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SensorStatus {
    /// What the latest record has against it, [`crate::watch::reason`].
    pub reasons: u16,
    /// It is not in order, or was not and that is latched.
    pub standing: bool,
    /// Standing and not acknowledged.
    pub unseen: bool,
}

/// What bounds the available bandwidth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Bound {
    /// Nothing below the law's bandwidth.
    #[default]
    Law,
    /// The analogue filter's pass edge (`pass.analogue`).
    AnalogueFilter,
    /// The sensor's band (`pass.sensor`).
    Sensor,
    /// The granted rate.
    Rate,
}

/// Alarms, one bit each, `alarms[0]` of the configuration lowest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct AlarmState {
    /// The value is beyond its limit.
    pub raised: u8,
    /// Raised, or latched.
    pub standing: u8,
    /// Standing and not acknowledged.
    pub unseen: u8,
    /// The state of the sensor stands: it is not in order, or was not and that is latched.
    pub signal_bad: bool,
}

/// One spectral line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SpectralLine {
    /// Frequency, Hz.
    pub frequency_hz: f32,
    /// Peak amplitude, m/s^2.
    pub amplitude: f32,
}

/// One mesh harmonic with its pinion-shaft sidebands.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MeshBand {
    /// Harmonic number, from 1.
    pub harmonic: u8,
    /// The harmonic itself.
    pub line: SpectralLine,
    /// Sidebands -n..-1, +1..+n of the pinion shaft. Zero where the band does not reach.
    pub sidebands: Vec<SpectralLine, { 2 * MAX_SIDEBANDS }>,
    /// Sidebands -n..-1, +1..+n of the gear shaft.
    pub gear_sidebands: Vec<SpectralLine, { 2 * MAX_SIDEBANDS }>,
}

/// Mesh-band spectrum.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spectrum {
    /// Circumstances.
    pub tag: Tag,
    /// Harmonics 1..H as far as the rate carries them.
    pub bands: Vec<MeshBand, MAX_HARMONICS>,
    /// CRC-32 of all spectral values, bit for bit: equal on every target for equal input.
    pub digest: u32,
    /// Turns of the pinion in the record; the resolution is one over this in orders.
    pub turns: u16,
    /// Slowest turn of the record, Hz. A line of fixed frequency passed the orders from its frequency over the
    /// fastest to that over the slowest speed ([`crate::zoom::orders_swept`]).
    pub slowest_hz: f32,
    /// Fastest turn of the record, Hz.
    pub fastest_hz: f32,
    /// Sidebands of pinion and gear that the record cannot tell apart, a bit for each in the order of a band's lists:
    /// what is told of one is told of the other, too.
    pub inseparable: [u8; 2],
}

impl Spectrum {
    /// Without lines: all zero bytes, for statics.
    pub const EMPTY: Self = Self {
        tag: Tag::ZERO,
        bands: Vec::new(),
        digest: 0,
        turns: 0,
        slowest_hz: 0.0,
        fastest_hz: 0.0,
        inseparable: [0; 2],
    };
}

/// Mesh bands of a further gear of a train: speeds, turns and `sidebands` are that gear's, `gear_sidebands` its mate's.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GearSpectrum {
    /// Place in [`Configuration::train`], from 1.
    pub gear: u8,
    /// As of the pinion.
    pub spectrum: Spectrum,
}

/// Indicators of a synchronous average of a further gear of a train, with its own speed; NA4 is not a number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GearCondition {
    /// Place in [`Configuration::train`], from 1.
    pub gear: u8,
    /// As of the pinion.
    pub indicators: GearIndicators,
}

/// Where a line of a wideband spectrum may come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum LineOrigin {
    /// No mesh harmonic lies there, or the speed is not known.
    #[default]
    Unexplained,
    /// A mesh harmonic below half the rate.
    Mesh {
        /// Its number.
        harmonic: u16,
    },
    /// A mesh harmonic above half the rate, folded: the line may not exist on the machine.
    Folded {
        /// Its number.
        harmonic: u16,
    },
}

/// Strongest lines of the whole band at the law's rate.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Peaks {
    /// Circumstances.
    pub tag: Tag,
    /// Strongest first.
    pub lines: Vec<SpectralLine, MAX_PEAKS>,
    /// Root mean square of the block without its mean, m/s^2.
    pub rms: f32,
    /// CRC-32 of all spectral values.
    pub digest: u32,
    /// Origin of each line, in their order; empty without a locked speed.
    pub origins: Vec<LineOrigin, MAX_PEAKS>,
    /// Gear of the train whose mesh each origin names, in their order: 0 the pinion, also without any.
    pub origin_gears: Vec<u8, MAX_PEAKS>,
}

/// Part of a wideband waveform.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// Circumstances.
    pub tag: Tag,
    /// Index of the first sample in the waveform.
    pub offset: u16,
    /// Samples of the whole waveform.
    pub total: u16,
    /// m/s^2 per unit.
    pub scale: f32,
    /// Samples.
    pub samples: Vec<i16, SNAPSHOT_CHUNK>,
}

/// Indicators of one synchronous average of the pinion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GearIndicators {
    /// Tick at which the average was complete.
    pub tick: u64,
    /// Pinion rate at that time, Hz.
    pub speed_hz: f32,
    /// Turns averaged.
    pub turns: u16,
    /// The hunting period is too long: the gear's pattern is not removed exactly.
    pub hunting_broken: bool,
    /// Root mean square of the average, m/s^2.
    pub rms: f32,
    /// Crest factor of the average.
    pub crest: f32,
    /// Kurtosis of the average.
    pub kurtosis: f32,
    /// Root mean square of the regular signal, m/s^2.
    pub regular_rms: f32,
    /// Root mean square of the residual signal, m/s^2.
    pub residual_rms: f32,
    /// Root mean square of the difference signal, m/s^2.
    pub difference_rms: f32,
    /// FM0 of the average; 0 without mesh lines.
    pub fm0: f32,
    /// FM4, kurtosis of the difference signal.
    pub fm4: f32,
    /// M6A of the difference signal.
    pub m6a: f32,
    /// NA4 of the residual signal against what is expected of it at this speed; not a number where nothing is.
    pub na4: f32,
    /// Sideband energy ratio of the gear shaft at the first mesh harmonic, of the latest mesh-band record.
    pub gear_sideband_energy_ratio: f32,
}

/// Bandwidth by the rise time of engagement edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MeasuredBandwidth {
    /// Median 10-90 % rise time, s.
    pub rise_s: f32,
    /// Its median absolute deviation over the teeth, s.
    pub deviation_s: f32,
    /// Teeth timed.
    pub teeth: u16,
    /// Samples within the median rise time; at least five.
    pub samples_per_edge: f32,
    /// 0.35 over the rise time, Hz.
    pub bandwidth_hz: f32,
    /// The law's bandwidth at this speed, Hz.
    pub law_hz: f32,
}

/// What a value rests on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Quality {
    /// Whole turns of the pinion; 0 where the record was cut by the clock, because there was no speed.
    pub turns: u16,
    /// Duration, s.
    pub duration_s: f32,
    /// Codes lay at the converter's rails: clipped.
    pub overload: bool,
    /// Samples are missing.
    pub gap: bool,
    /// Filters had not forgotten a start, or the samples before a gap.
    pub settling: bool,
    /// The signal did not move.
    pub stuck: bool,
}

impl Quality {
    /// Whether nothing is wrong with the record; what a value of another one may do is [`crate::watch::use_of`]'s.
    pub fn is_good(&self) -> bool {
        !(self.overload || self.gap || self.settling || self.stuck)
    }
}

/// Overall values of the second sensor, of the same instants as the first one's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ChannelValues {
    /// Root mean square about the mean, m/s^2.
    pub rms: f32,
    /// Largest distance from the mean, m/s^2.
    pub peak: f32,
    /// Peak over RMS.
    pub crest: f32,
    /// Kurtosis, 3 for Gaussian noise.
    pub kurtosis: f32,
    /// Velocity in the first one's band, root mean square, m/s.
    pub velocity_rms: f32,
    /// What they rest on.
    pub quality: Quality,
    /// Mean of the converter's codes: the sensor's bias.
    pub mean_code: f32,
    /// Upper edge of what filter and sensor pass, Hz; 0 where neither is declared.
    pub passed_hz: f32,
}

/// Overall values and condition indicators, of whole turns of the pinion and of at least a second.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Indicators {
    /// Circumstances. The rate is the ADC's: the band is that of the analogue filter at every speed.
    pub tag: Tag,
    /// Root mean square about the mean, m/s^2.
    pub rms: f32,
    /// Largest distance from the mean, m/s^2.
    pub peak: f32,
    /// Peak over RMS.
    pub crest: f32,
    /// Kurtosis, 3 for Gaussian noise.
    pub kurtosis: f32,
    /// Sideband energy ratio of the pinion shaft at the first mesh harmonic.
    pub sideband_energy_ratio: f32,
    /// Of the synchronous average completed since the last of these messages.
    pub gear: Option<GearIndicators>,
    /// Of the rise times measured since the last of these messages; none where the rate is too low to time edges.
    pub bandwidth: Option<MeasuredBandwidth>,
    /// What the values above and the velocity rest on.
    pub quality: Quality,
    /// Velocity in its band, root mean square, m/s.
    pub velocity_rms: f32,
    /// Lower and upper edge of that band, Hz (-3 dB, Butterworth of fourth order).
    pub velocity_band_hz: [f32; 2],
    /// Once to three times per turn of the pinion, where complete since the last of these messages.
    pub pinion: Option<ShaftOrders>,
    /// The same of the gear.
    pub wheel: Option<ShaftOrders>,
    /// From the expected levels, at a locked speed within their table.
    pub departures: Departures,
    /// Of the second sensor, where there is one.
    pub second: Option<ChannelValues>,
    /// From the expected levels of what a local fault changes, likewise.
    pub local_departures: LocalDepartures,
    /// Phases of the shaft orders are against a mark of the wheel, the same after every start; otherwise against an
    /// arbitrary angle of this lock.
    pub absolute_phase: bool,
}

impl Indicators {
    /// The largest departure of all, in its standard uncertainties: what alarms watch.
    pub fn largest_departure(&self) -> Option<f32> {
        self.departures.largest().into_iter().chain(self.local_departures.largest()).reduce(f32::max)
    }
}

/// Counters since start.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Statistics {
    /// Blocks processed.
    pub blocks: u32,
    /// Blocks lost by sequence gaps.
    pub blocks_lost: u32,
    /// ADC samples processed.
    pub samples: u64,
    /// Tach pulses accepted.
    pub pulses: u32,
    /// Pulses missing.
    pub pulses_missed: u32,
    /// Pulses rejected.
    pub pulses_spurious: u32,
    /// Times the tach locked anew.
    pub relocks: u32,
    /// Messages dropped because they were not fetched in time.
    pub messages_dropped: u32,
    /// Kinds of events that have occurred, with their counts.
    pub events: Vec<EventCount, MAX_EVENT_COUNTS>,
    /// Most blocks that ever waited for the main loop, as the board says; blocks are lost where its memory holds no
    /// more.
    pub most_waiting: u32,
}

impl Statistics {
    /// Occurrences of a kind of event.
    pub fn count(&self, kind: EventKind) -> u32 {
        self.events.iter().find(|entry| entry.kind == kind as u8).map_or(0, |entry| entry.count)
    }
}

/// How often a kind of event has occurred. The kind is a number, so that one that the reader does not know costs
/// nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct EventCount {
    /// [`EventKind`] as a number.
    pub kind: u8,
    /// Occurrences since start.
    pub count: u32,
}

/// Streamed from node to host.
// No heap to box the large variants in; few values exist at a time.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Message {
    /// Speed and rates; sent at every change and once a second.
    Status(Status),
    /// Mesh bands.
    Spectrum(Spectrum),
    /// Strongest lines.
    Peaks(Peaks),
    /// Waveform.
    Snapshot(Snapshot),
    /// Indicators.
    Indicators(Indicators),
    /// Event.
    Event(Event),
    /// Counters.
    Statistics(Statistics),
    /// Result of the self-test; sent whenever one has ended.
    SelfTest(SelfTest),
    /// Mesh bands of a further gear of a train.
    GearSpectrum(GearSpectrum),
    /// Indicators of a further gear of a train.
    GearCondition(GearCondition),
}
