//! The registers and bits of the map: address, kind, name, unit, meaning, and where the value comes from, in one table.
//!
//! A number of two registers has its high word first, as each word has its high byte first, unless the configuration
//! asks for the low one first ([`ModbusOptions`]); floats are IEEE 754 singles. A float that does not exist (no result
//! yet, none at this speed) is not a number; words and bits are 0 then. Ages are words and not floats, and 65535 where
//! there is no result: a comparison "older than" is then true, which with a float that is not a number it would not be.
//!
//! Addresses in a group follow each other without a gap; a group ends below the next one's first address, and what
//! lies between is refused. Rows are only ever added behind the last of their group ([`super::MAP_VERSION`]).
//!
//! Texts are in a table of their own: an image that does not print them does not hold them.

use super::MAP_VERSION;
use super::bank::{Bank, FurtherGear, Harmonic, Mesh, NO_RESULT_AGE_S};
use super::line::Heard;
use crate::buffers::Arrays;
use crate::config::{GearPair, ModbusOptions, SCHEMA, TrainGear};
use crate::identity::VERSION;
use crate::levels::{Departure, Departures, LocalDepartures};
use crate::message::{AlarmState, ChannelValues, Quality, SelfTest, SpectralLine, Statistics, Status, Tag};
use crate::node::health::Health;
use crate::node::{Node, State};
use crate::sample_ring::{BLOCK, BLOCKS};
use crate::shaft_lines::ShaftOrders;
use crate::tach::Validity;
use crate::waveform::{CaptureFacts, CaptureHead, CapturePhase, Trigger};

/// What of a frame's life on the line is told in registers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// The receiver's counters.
    pub heard: Heard,
    /// Requests refused.
    pub exceptions: u16,
}

/// A departure that nothing is known of.
const UNKNOWN_DEPARTURE: Departure = Departure { departure_db: f32::NAN, uncertainty_db: f32::NAN };

/// What registers are read from: kept results, and the node's present state.
#[derive(Clone, Debug)]
pub struct View<'a> {
    bank: &'a Bank,
    traffic: Traffic,
    now: u64,
    ticks_per_second: u32,
    health: Health,
    unique_id: [u32; 3],
    gears: GearPair,
    train: &'a [TrainGear],
    self_test: SelfTest,
    state: State,
    alarms: AlarmState,
    alarm_stands: bool,
    statistics: Statistics,
    capture_phase: CapturePhase,
    held: Option<&'a CaptureHead>,
    missed: u32,
    options: ModbusOptions,
}

impl<'a> View<'a> {
    /// A node with what was kept of its results.
    pub fn of<A: Arrays>(node: &'a Node<A>, bank: &'a Bank, traffic: Traffic) -> Self {
        let ticks_per_second = node.clock().0;
        let health = node.health();
        Self {
            bank,
            traffic,
            now: health.tick,
            ticks_per_second,
            health,
            unique_id: node.identity().unique_id,
            gears: node.configuration().gears,
            train: &node.configuration().train,
            self_test: node.self_test(),
            state: node.state(),
            alarms: node.alarm_state(),
            alarm_stands: node.alarm_stands(),
            statistics: node.statistics(),
            capture_phase: node.capture_phase(),
            held: node.held_waveform(),
            missed: node.missed_waveforms(),
            options: node.configuration().modbus,
        }
    }

    /// How it is answered beyond the standard.
    pub fn options(&self) -> ModbusOptions {
        self.options
    }

    /// Of the waveform held, or of none.
    fn waveform(&self) -> &'a CaptureFacts {
        static NONE: CaptureFacts = CaptureFacts::NONE;
        self.held.map_or(&NONE, |head| &head.facts)
    }

    fn waveform_float(&self, of: fn(&CaptureFacts) -> f32) -> f32 {
        self.held.map_or(f32::NAN, |head| of(&head.facts))
    }

    fn line(&self, index: usize) -> SpectralLine {
        let none = SpectralLine { frequency_hz: f32::NAN, amplitude: f32::NAN };
        self.bank.lines.latest.map_or(none, |lines| lines.line(index))
    }

    fn harmonic(&self, index: usize) -> Harmonic {
        self.bank.mesh.latest.map_or(Harmonic::NONE, |mesh: Mesh| mesh.harmonic(index))
    }

    /// A further gear of a train as configured, from 0; all zero where there is none. Out of line, as the next three:
    /// some fifty rows call them.
    #[inline(never)]
    fn train(&self, index: usize) -> &TrainGear {
        static NONE: TrainGear = TrainGear { stage: 0, teeth: 0, mate_teeth: 0, turns: 0, pinion_turns: 0 };
        self.train.get(index).unwrap_or(&NONE)
    }

    /// What is known of it.
    #[inline(never)]
    fn further(&self, index: usize) -> &FurtherGear {
        static NONE: FurtherGear = FurtherGear::NONE;
        let configured = self.train.get(index);
        let kept = self.bank.train.get(index).and_then(|kept| kept.latest.as_ref());
        kept.filter(|_| configured.is_some()).unwrap_or(&NONE)
    }

    #[inline(never)]
    fn further_age_s(&self, index: usize) -> u16 {
        let kept = self.bank.train.get(index);
        kept.map_or(NO_RESULT_AGE_S, |kept| kept.age_s(self.now, self.ticks_per_second))
    }

    #[inline(never)]
    fn further_number(&self, index: usize) -> u16 {
        self.bank.train.get(index).map_or(0, |kept| kept.number)
    }

    fn second(&self) -> Option<ChannelValues> {
        self.bank.values.latest.and_then(|values| values.second)
    }

    fn second_float(&self, of: fn(&ChannelValues) -> f32) -> f32 {
        self.second().as_ref().map_or(f32::NAN, of)
    }

    fn departure(&self, of: fn(&Departures) -> Option<Departure>) -> Departure {
        self.bank.values.latest.and_then(|values| of(&values.departures)).unwrap_or(UNKNOWN_DEPARTURE)
    }

    fn local_departure(&self, of: fn(&LocalDepartures) -> Option<Departure>) -> Departure {
        self.bank.values.latest.and_then(|values| of(&values.local_departures)).unwrap_or(UNKNOWN_DEPARTURE)
    }
}

/// How many registers a value takes, and how they are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// One register, unsigned.
    Word,
    /// Two registers, unsigned.
    Long,
    /// Two registers, IEEE 754 single.
    Float,
}

impl Kind {
    /// Registers of a value.
    pub const fn registers(self) -> u16 {
        if matches!(self, Self::Word) { 1 } else { 2 }
    }
}

/// A row of the table, as a manual has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Register {
    /// Group that it belongs to.
    pub group: &'static str,
    /// Address of its first register, from 0.
    pub address: u16,
    /// How it is read.
    pub kind: Kind,
    /// Its name.
    pub name: &'static str,
    /// Unit; empty for plain numbers.
    pub unit: &'static str,
    /// What it says.
    pub meaning: &'static str,
}

/// A discrete input, as a manual has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bit {
    /// Its address, from 0.
    pub address: u16,
    /// How many of the kind follow each other.
    pub count: u16,
    /// Its name.
    pub name: &'static str,
    /// What a 1 says.
    pub meaning: &'static str,
}

#[derive(Clone, Copy)]
enum Read {
    Word(fn(&View<'_>) -> u16),
    Long(fn(&View<'_>) -> u32),
    Float(fn(&View<'_>) -> f32),
}

struct Reader {
    address: u16,
    read: Read,
}

macro_rules! registers {
    ($($group:literal {
        $($address:literal $kind:ident $name:literal [$unit:literal] $meaning:literal = $read:expr;)*
    })*) => {
        /// All registers, in the order of their addresses.
        pub const REGISTERS: &[Register] = &[$($(
            Register { group: $group, address: $address, kind: Kind::$kind, name: $name, unit: $unit,
                meaning: $meaning },
        )*)*];
        static READERS: &[Reader] = &[$($(Reader { address: $address, read: Read::$kind($read) },)*)*];
    };
}

registers! {
    "identity" {
        0 Word "map_version" [""] "of this table; a higher one has more rows and all of these" = |_| MAP_VERSION;
        1 Word "firmware_major" [""] "firmware version, major" = |_| VERSION[0].into();
        2 Word "firmware_minor" [""] "firmware version, minor" = |_| VERSION[1].into();
        3 Word "firmware_patch" [""] "firmware version, patch" = |_| VERSION[2].into();
        4 Word "configuration_schema" [""] "layout of the configuration" = |_| SCHEMA;
        5 Long "unique_id_0" [""] "the chip's own number, word 0" = |v| v.unique_id[0];
        7 Long "unique_id_1" [""] "the chip's own number, word 1" = |v| v.unique_id[1];
        9 Long "unique_id_2" [""] "the chip's own number, word 2" = |v| v.unique_id[2];
        11 Word "pinion_teeth" [""] "as configured" = |v| v.gears.pinion_teeth;
        12 Word "gear_teeth" [""] "as configured" = |v| v.gears.gear_teeth;
        13 Long "uptime" ["s"] "since the start" = |v| v.health.uptime_s;
        15 Word "self_test_run" [""] "bits of the items that ran: sample count, rails, noise, tach, mathematics"
            = |v| v.self_test.run.into();
        16 Word "self_test_failed" [""] "bits of the items that failed" = |v| v.self_test.failed.into();
    }
    "status" {
        32 Word "age" ["s"] "since the latest status was complete; 65535: none yet, or older"
            = |v| v.bank.status.age_s(v.now, v.ticks_per_second);
        33 Word "number" [""] "how many there were, 0 again behind 65535: changes with each" = |v| v.bank.status.number;
        34 Word "state" [""] "0 stopped, 1 waiting for the tach, 2 settling, 3 measuring; at present"
            = |v| v.state as u16;
        35 Word "speed_validity" [""] "0 none, 1 doubtful, 2 locked" = |v| v.bank.status.word(|s| s.validity as u16);
        36 Word "flags" [""]
            "bit 0: speed outside the law, 1: provisional law, 2: rate beyond the board, 3: safe rate for want \
             of a speed"
            = |v| v.bank.status.word(status_flags);
        37 Word "bound" [""] "of the available bandwidth: 0 law, 1 analogue filter, 2 sensor, 3 rate"
            = |v| v.bank.status.word(|s| s.bound as u16);
        38 Float "speed" ["Hz"] "rate of the pinion; not a number without a speed"
            = |v| v.bank.status.float(|s| if s.validity == Validity::None { f32::NAN } else { s.speed_hz });
        40 Float "speed_uncertainty" [""] "relative standard uncertainty of the speed" = |v| v.bank.status.float(|s| {
            if s.validity == Validity::None { f32::NAN } else { s.speed_uncertainty }
        });
        42 Float "pulse_age" ["s"] "since the latest accepted tach pulse, at the time of the status"
            = |v| v.bank.status.float(|s| s.age_s);
        44 Float "adc_rate" ["Hz"] "sampling rate granted" = |v| v.bank.status.float(|s| s.adc_hz);
        46 Float "output_rate" ["Hz"] "rate behind decimation granted" = |v| v.bank.status.float(|s| s.granted_hz);
        48 Float "law_bandwidth" ["Hz"] "bandwidth that the law asks for" = |v| v.bank.status.float(|s| s.bandwidth_hz);
        50 Float "available_bandwidth" ["Hz"] "bandwidth that sensor, filter and rate carry of it"
            = |v| v.bank.status.float(|s| s.available_hz);
    }
    "alarms" {
        64 Word "raised" [""] "one bit per alarm, the first lowest: its value is beyond its limit"
            = |v| v.alarms.raised.into();
        65 Word "standing" [""] "one bit per alarm: raised, or latched" = |v| v.alarms.standing.into();
        66 Word "unseen" [""] "one bit per alarm: standing and not acknowledged" = |v| v.alarms.unseen.into();
        67 Word "signal_bad" [""] "1: the sensor is not in order, or was not and that is \
            latched" = |v| v.alarms.signal_bad.into();
        68 Word "any_standing" [""] "1: any alarm stands, that of the signal included where it is watched; as \
            the alarm output" = |v| v.alarm_stands.into();
    }
    "values" {
        96 Word "age" ["s"] "since the record of the values was complete; 65535: none yet, or older"
            = |v| v.bank.values.age_s(v.now, v.ticks_per_second);
        97 Word "number" [""] "how many there were, 0 again behind 65535: changes with each" = |v| v.bank.values.number;
        98 Word "quality" [""]
            "bit 0: clipped, 1: samples missing, 2: filters settling, 3: signal still, 4: no locked speed; \
             0 for good values"
            = |v| v.bank.values.word(|i| quality(&i.quality, &i.tag));
        99 Word "turns" [""] "whole turns of the pinion in the record; 0 where the clock cut it"
            = |v| v.bank.values.word(|i| i.quality.turns);
        100 Float "duration" ["s"] "of the record" = |v| v.bank.values.float(|i| i.quality.duration_s);
        102 Float "speed" ["Hz"] "rate of the pinion at the record" = |v| v.bank.values.float(|i| {
            if i.tag.validity == Validity::None { f32::NAN } else { i.tag.speed_hz }
        });
        104 Float "rms" ["m/s^2"] "root mean square of the acceleration about its mean"
            = |v| v.bank.values.float(|i| i.rms);
        106 Float "peak" ["m/s^2"] "largest distance from the mean" = |v| v.bank.values.float(|i| i.peak);
        108 Float "crest" [""] "peak over RMS" = |v| v.bank.values.float(|i| i.crest);
        110 Float "kurtosis" [""] "3 for Gaussian noise" = |v| v.bank.values.float(|i| i.kurtosis);
        112 Float "velocity_rms" ["m/s"] "root mean square of the velocity in its band"
            = |v| v.bank.values.float(|i| i.velocity_rms);
        114 Float "velocity_from" ["Hz"] "lower edge of that band" = |v| v.bank.values.float(|i| i.velocity_band_hz[0]);
        116 Float "velocity_to" ["Hz"] "upper edge of that band" = |v| v.bank.values.float(|i| i.velocity_band_hz[1]);
    }
    "orders of the pinion" {
        128 Word "age" ["s"] "since the record of the orders was complete; 65535: none yet, or older"
            = |v| v.bank.pinion.age_s(v.now, v.ticks_per_second);
        129 Word "number" [""] "how many there were, 0 again behind 65535: changes with each"
            = |v| v.bank.pinion.number;
        130 Word "turns" [""] "of the pinion" = |v| v.bank.pinion.word(|o| o.turns);
        131 Float "amplitude_1x" ["m/s^2"] "once per turn, peak amplitude"
            = |v| v.bank.pinion.float(|o: &ShaftOrders| o.lines[0].amplitude);
        133 Float "phase_1x" ["degrees"] "lag behind the turn mark"
            = |v| v.bank.pinion.float(|o: &ShaftOrders| o.lines[0].phase_deg);
        135 Float "amplitude_2x" ["m/s^2"] "twice per turn, peak amplitude"
            = |v| v.bank.pinion.float(|o: &ShaftOrders| o.lines[1].amplitude);
        137 Float "phase_2x" ["degrees"] "lag behind the turn mark"
            = |v| v.bank.pinion.float(|o: &ShaftOrders| o.lines[1].phase_deg);
        139 Float "amplitude_3x" ["m/s^2"] "three times per turn, peak amplitude"
            = |v| v.bank.pinion.float(|o: &ShaftOrders| o.lines[2].amplitude);
        141 Float "phase_3x" ["degrees"] "lag behind the turn mark"
            = |v| v.bank.pinion.float(|o: &ShaftOrders| o.lines[2].phase_deg);
    }
    "orders of the gear" {
        148 Word "age" ["s"] "since the record of the orders was complete; 65535: none yet, or older"
            = |v| v.bank.wheel.age_s(v.now, v.ticks_per_second);
        149 Word "number" [""] "how many there were, 0 again behind 65535: changes with each" = |v| v.bank.wheel.number;
        150 Word "turns" [""] "of the gear" = |v| v.bank.wheel.word(|o| o.turns);
        151 Float "amplitude_1x" ["m/s^2"] "once per turn, peak amplitude"
            = |v| v.bank.wheel.float(|o: &ShaftOrders| o.lines[0].amplitude);
        153 Float "phase_1x" ["degrees"] "lag behind the turn mark"
            = |v| v.bank.wheel.float(|o: &ShaftOrders| o.lines[0].phase_deg);
        155 Float "amplitude_2x" ["m/s^2"] "twice per turn, peak amplitude"
            = |v| v.bank.wheel.float(|o: &ShaftOrders| o.lines[1].amplitude);
        157 Float "phase_2x" ["degrees"] "lag behind the turn mark"
            = |v| v.bank.wheel.float(|o: &ShaftOrders| o.lines[1].phase_deg);
        159 Float "amplitude_3x" ["m/s^2"] "three times per turn, peak amplitude"
            = |v| v.bank.wheel.float(|o: &ShaftOrders| o.lines[2].amplitude);
        161 Float "phase_3x" ["degrees"] "lag behind the turn mark"
            = |v| v.bank.wheel.float(|o: &ShaftOrders| o.lines[2].phase_deg);
    }
    "mesh bands" {
        176 Word "age" ["s"] "since the mesh-band record was complete; 65535: none yet, or older"
            = |v| v.bank.mesh.age_s(v.now, v.ticks_per_second);
        177 Word "number" [""] "how many there were, 0 again behind 65535: changes with each" = |v| v.bank.mesh.number;
        178 Word "turns" [""] "of the pinion in the record" = |v| v.bank.mesh.word(|m| m.turns);
        179 Word "harmonics" [""] "harmonics that the rate carries; the values of others are not numbers"
            = |v| v.bank.mesh.word(|m| m.count);
        180 Float "speed" ["Hz"] "mean rate of the pinion over the record" = |v| v.bank.mesh.float(|m| m.speed_hz);
        182 Float "mesh_1" ["m/s^2"] "mesh harmonic 1, peak amplitude" = |v| v.harmonic(0).mesh;
        184 Float "mesh_1_pinion_below" ["m/s^2"] "its first sideband of the pinion, below it"
            = |v| v.harmonic(0).pinion[0];
        186 Float "mesh_1_pinion_above" ["m/s^2"] "its first sideband of the pinion, above it"
            = |v| v.harmonic(0).pinion[1];
        188 Float "mesh_1_gear_below" ["m/s^2"] "its first sideband of the gear, below it" = |v| v.harmonic(0).gear[0];
        190 Float "mesh_1_gear_above" ["m/s^2"] "its first sideband of the gear, above it" = |v| v.harmonic(0).gear[1];
        192 Float "mesh_2" ["m/s^2"] "mesh harmonic 2, peak amplitude" = |v| v.harmonic(1).mesh;
        194 Float "mesh_2_pinion_below" ["m/s^2"] "its first sideband of the pinion, below it"
            = |v| v.harmonic(1).pinion[0];
        196 Float "mesh_2_pinion_above" ["m/s^2"] "its first sideband of the pinion, above it"
            = |v| v.harmonic(1).pinion[1];
        198 Float "mesh_2_gear_below" ["m/s^2"] "its first sideband of the gear, below it" = |v| v.harmonic(1).gear[0];
        200 Float "mesh_2_gear_above" ["m/s^2"] "its first sideband of the gear, above it" = |v| v.harmonic(1).gear[1];
        202 Float "mesh_3" ["m/s^2"] "mesh harmonic 3, peak amplitude" = |v| v.harmonic(2).mesh;
        204 Float "mesh_3_pinion_below" ["m/s^2"] "its first sideband of the pinion, below it"
            = |v| v.harmonic(2).pinion[0];
        206 Float "mesh_3_pinion_above" ["m/s^2"] "its first sideband of the pinion, above it"
            = |v| v.harmonic(2).pinion[1];
        208 Float "mesh_3_gear_below" ["m/s^2"] "its first sideband of the gear, below it" = |v| v.harmonic(2).gear[0];
        210 Float "mesh_3_gear_above" ["m/s^2"] "its first sideband of the gear, above it" = |v| v.harmonic(2).gear[1];
        212 Float "mesh_4" ["m/s^2"] "mesh harmonic 4, peak amplitude" = |v| v.harmonic(3).mesh;
        214 Float "mesh_4_pinion_below" ["m/s^2"] "its first sideband of the pinion, below it"
            = |v| v.harmonic(3).pinion[0];
        216 Float "mesh_4_pinion_above" ["m/s^2"] "its first sideband of the pinion, above it"
            = |v| v.harmonic(3).pinion[1];
        218 Float "mesh_4_gear_below" ["m/s^2"] "its first sideband of the gear, below it" = |v| v.harmonic(3).gear[0];
        220 Float "mesh_4_gear_above" ["m/s^2"] "its first sideband of the gear, above it" = |v| v.harmonic(3).gear[1];
        222 Float "mesh_5" ["m/s^2"] "mesh harmonic 5, peak amplitude" = |v| v.harmonic(4).mesh;
        224 Float "mesh_5_pinion_below" ["m/s^2"] "its first sideband of the pinion, below it"
            = |v| v.harmonic(4).pinion[0];
        226 Float "mesh_5_pinion_above" ["m/s^2"] "its first sideband of the pinion, above it"
            = |v| v.harmonic(4).pinion[1];
        228 Float "mesh_5_gear_below" ["m/s^2"] "its first sideband of the gear, below it" = |v| v.harmonic(4).gear[0];
        230 Float "mesh_5_gear_above" ["m/s^2"] "its first sideband of the gear, above it" = |v| v.harmonic(4).gear[1];
        232 Float "mesh_6" ["m/s^2"] "mesh harmonic 6, peak amplitude" = |v| v.harmonic(5).mesh;
        234 Float "mesh_6_pinion_below" ["m/s^2"] "its first sideband of the pinion, below it"
            = |v| v.harmonic(5).pinion[0];
        236 Float "mesh_6_pinion_above" ["m/s^2"] "its first sideband of the pinion, above it"
            = |v| v.harmonic(5).pinion[1];
        238 Float "mesh_6_gear_below" ["m/s^2"] "its first sideband of the gear, below it" = |v| v.harmonic(5).gear[0];
        240 Float "mesh_6_gear_above" ["m/s^2"] "its first sideband of the gear, above it" = |v| v.harmonic(5).gear[1];
    }
    "gear condition" {
        256 Word "age" ["s"] "since the synchronous average was complete; 65535: none yet, or older"
            = |v| v.bank.gear.age_s(v.now, v.ticks_per_second);
        257 Word "number" [""] "how many there were, 0 again behind 65535: changes with each" = |v| v.bank.gear.number;
        258 Word "turns" [""] "averaged" = |v| v.bank.gear.word(|g| g.turns);
        259 Word "hunting_broken" [""]
            "1: too few turns for the hunting period, the gear's pattern is not removed exactly"
            = |v| v.bank.gear.word(|g| g.hunting_broken.into());
        260 Float "speed" ["Hz"] "rate of the pinion at its end" = |v| v.bank.gear.float(|g| g.speed_hz);
        262 Float "rms" ["m/s^2"] "root mean square of the average" = |v| v.bank.gear.float(|g| g.rms);
        264 Float "crest" [""] "crest factor of the average" = |v| v.bank.gear.float(|g| g.crest);
        266 Float "kurtosis" [""] "kurtosis of the average" = |v| v.bank.gear.float(|g| g.kurtosis);
        268 Float "regular_rms" ["m/s^2"] "root mean square of the regular signal"
            = |v| v.bank.gear.float(|g| g.regular_rms);
        270 Float "residual_rms" ["m/s^2"] "root mean square of the residual signal"
            = |v| v.bank.gear.float(|g| g.residual_rms);
        272 Float "difference_rms" ["m/s^2"] "root mean square of the difference signal"
            = |v| v.bank.gear.float(|g| g.difference_rms);
        274 Float "fm0" [""] "FM0; 0 without mesh lines" = |v| v.bank.gear.float(|g| g.fm0);
        276 Float "fm4" [""] "FM4" = |v| v.bank.gear.float(|g| g.fm4);
        278 Float "m6a" [""] "M6A" = |v| v.bank.gear.float(|g| g.m6a);
        280 Float "na4" [""] "NA4 against what is expected of the residual at this speed; not a number where \
            nothing is" = |v| v.bank.gear.float(|g| g.na4);
        282 Float "gear_sideband_energy_ratio" [""] "sideband energy ratio of the gear at the first mesh \
            harmonic" = |v| v.bank.gear.float(|g| g.gear_sideband_energy_ratio);
        284 Float "pinion_sideband_energy_ratio" [""] "sideband energy ratio of the pinion at the first mesh \
            harmonic, of the latest values" = |v| v.bank.values.float(|i| i.sideband_energy_ratio);
    }
    "measured bandwidth" {
        304 Word "age" ["s"] "since the timing of the edges was complete; 65535: none yet, or older"
            = |v| v.bank.bandwidth.age_s(v.now, v.ticks_per_second);
        305 Word "number" [""] "how many there were, 0 again behind 65535: changes with each"
            = |v| v.bank.bandwidth.number;
        306 Word "teeth" [""] "timed" = |v| v.bank.bandwidth.word(|b| b.teeth);
        307 Float "rise" ["s"] "median rise time of engagement edges, 10 % to 90 %"
            = |v| v.bank.bandwidth.float(|b| b.rise_s);
        309 Float "deviation" ["s"] "its median absolute deviation over the teeth"
            = |v| v.bank.bandwidth.float(|b| b.deviation_s);
        311 Float "bandwidth" ["Hz"] "0.35 over the rise time" = |v| v.bank.bandwidth.float(|b| b.bandwidth_hz);
        313 Float "law_bandwidth" ["Hz"] "the law's bandwidth at this speed" = |v| v.bank.bandwidth.float(|b| b.law_hz);
    }
    "departures" {
        320 Float "rms" ["dB"] "RMS over what is expected at this speed" = |v| v.departure(|d| d.rms).departure_db;
        322 Float "rms_uncertainty" ["dB"] "its standard uncertainty" = |v| v.departure(|d| d.rms).uncertainty_db;
        324 Float "velocity_rms" ["dB"] "velocity RMS over what is expected at this speed"
            = |v| v.departure(|d| d.velocity_rms).departure_db;
        326 Float "velocity_rms_uncertainty" ["dB"] "its standard uncertainty"
            = |v| v.departure(|d| d.velocity_rms).uncertainty_db;
        328 Float "mesh_amplitude" ["dB"] "first mesh harmonic over what is expected at this speed"
            = |v| v.departure(|d| d.mesh_amplitude).departure_db;
        330 Float "mesh_amplitude_uncertainty" ["dB"] "its standard uncertainty"
            = |v| v.departure(|d| d.mesh_amplitude).uncertainty_db;
        332 Float "residual_rms" ["dB"] "residual RMS of the average over what is expected at this speed"
            = |v| v.departure(|d| d.residual_rms).departure_db;
        334 Float "residual_rms_uncertainty" ["dB"] "its standard uncertainty"
            = |v| v.departure(|d| d.residual_rms).uncertainty_db;
        336 Float "largest" [""] "largest departure in its standard uncertainties: what alarms watch"
            = |v| v.bank.values.float(|i| i.largest_departure().unwrap_or(f32::NAN));
        338 Float "sidebands" ["dB"] "sidebands of all mesh harmonics over what is expected at this speed"
            = |v| v.local_departure(|d| d.sidebands).departure_db;
        340 Float "sidebands_uncertainty" ["dB"] "its standard uncertainty"
            = |v| v.local_departure(|d| d.sidebands).uncertainty_db;
        342 Float "fm0" ["dB"] "FM0 over what is expected at this speed"
            = |v| v.local_departure(|d| d.fm0).departure_db;
        344 Float "fm0_uncertainty" ["dB"] "its standard uncertainty" = |v| v.local_departure(|d| d.fm0).uncertainty_db;
    }
    "counters" {
        352 Long "blocks" [""] "blocks of samples processed, since the start" = |v| v.statistics.blocks;
        354 Long "blocks_lost" [""] "blocks lost, since the start" = |v| v.statistics.blocks_lost;
        356 Long "pulses" [""] "tach pulses accepted, since the start" = |v| v.statistics.pulses;
        358 Long "pulses_missed" [""] "tach pulses missing, since the start" = |v| v.statistics.pulses_missed;
        360 Long "pulses_spurious" [""] "tach pulses rejected, since the start" = |v| v.statistics.pulses_spurious;
        362 Long "relocks" [""] "times the tach locked anew, since the start" = |v| v.statistics.relocks;
        364 Long "messages_dropped" [""] "results replaced before they were taken over, since the start"
            = |v| v.statistics.messages_dropped;
        366 Word "line_requests" [""] "requests for this node" = |v| v.traffic.heard.requests;
        367 Word "line_merged" [""] "of these: found at the end of a longer run of bytes" = |v| v.traffic.heard.merged;
        368 Word "line_damaged" [""] "runs of bytes without a valid checksum" = |v| v.traffic.heard.damaged;
        369 Word "line_others" [""] "frames for or from others" = |v| v.traffic.heard.others;
        370 Word "line_broadcasts" [""] "frames for all, never answered" = |v| v.traffic.heard.broadcasts;
        371 Word "line_late" [""] "runs found too late to be answered" = |v| v.traffic.heard.late;
        372 Word "line_exceptions" [""] "requests refused" = |v| v.traffic.exceptions;
    }
    "second sensor" {
        384 Word "present" [""]
            "1: the latest values have some of a second sensor; age, number, turns and speed are those of the values"
            = |v| v.second().is_some().into();
        385 Word "quality" [""] "as of the values"
            = |v| v.bank.values.word(|i| i.second.map_or(0, |second| quality(&second.quality, &i.tag)));
        386 Float "rms" ["m/s^2"] "root mean square of the acceleration about its mean" = |v| v.second_float(|s| s.rms);
        388 Float "peak" ["m/s^2"] "largest distance from the mean" = |v| v.second_float(|s| s.peak);
        390 Float "crest" [""] "peak over RMS" = |v| v.second_float(|s| s.crest);
        392 Float "kurtosis" [""] "3 for Gaussian noise" = |v| v.second_float(|s| s.kurtosis);
        394 Float "velocity_rms" ["m/s"] "root mean square of the velocity in its band"
            = |v| v.second_float(|s| s.velocity_rms);
        396 Float "mean_code" [""] "mean of the converter's codes, 0 to 65535: the bias of the sensor"
            = |v| v.second_float(|s| s.mean_code);
        398 Float "passed" ["Hz"] "upper edge of what filter and sensor pass; 0 where neither is declared"
            = |v| v.second_float(|s| s.passed_hz);
    }
    "device" {
        416 Float "supply" ["V"] "supply and reference of the converters" = |v| v.health.supply_v.unwrap_or(f32::NAN);
        418 Float "temperature" ["degrees Celsius"] "of the chip" = |v| v.health.temperature_c.unwrap_or(f32::NAN);
        420 Float "bias" ["V"] "mean of the first sensor's signal at the converter"
            = |v| v.health.bias_v.unwrap_or(f32::NAN);
        422 Float "second_bias" ["V"] "mean of the second sensor's signal at the converter"
            = |v| v.health.second_bias_v.unwrap_or(f32::NAN);
        424 Float "clock_fast" ["ppm"] "the node's clock against the pulse per second"
            = |v| v.health.second_pulse.map_or(f32::NAN, |p| p.fast_ppm);
        426 Float "clock_uncertainty" ["ppm"] "standard uncertainty of it"
            = |v| v.health.second_pulse.map_or(f32::NAN, |p| p.uncertainty_ppm);
        428 Long "wall_time" ["s"] "since 1970-01-01 00:00:00 UTC; 0 until a host has told it"
            = |v| v.health.wall_time.map_or(0, |time| (time.unix_us / 1_000_000) as u32);
    }
    "waveform" {
        448 Word "phase" [""] "0 not kept, 1 watching, 2 collecting, 3 computing its checksum, 4 held: samples can be \
            read"
            = |v| phase(v.capture_phase);
        449 Word "trigger" [""] "what began it: 0 a master or a host, 1 to 8 the alarm of that number"
            = |v| trigger(v.waveform().trigger);
        450 Long "number" [""] "of the waveform held, from 1 since the start; 0: none. The samples read are of one \
            waveform where it is the same before and behind them"
            = |v| v.waveform().number;
        452 Long "samples" [""] "of the waveform held" = |v| v.waveform().samples;
        454 Float "rate" ["Hz"] "samples per second"
            = |v| v.waveform_float(|f| f.ticks_per_second as f32 / f.period_ticks.max(1) as f32);
        456 Float "before" ["s"] "from its first sample to its trigger"
            = |v| v.waveform_float(|f| {
                f.trigger_tick.saturating_sub(f.first_tick) as f32 / f.ticks_per_second.max(1) as f32
            });
        458 Float "speed" ["Hz"] "rate of the pinion at its end; not a number without a speed"
            = |v| v.waveform_float(|f| if f.validity == Validity::None { f32::NAN } else { f.speed_hz });
        460 Word "overload" [""] "1: the converter was at its rails: clipped" = |v| v.waveform().overload.into();
        461 Word "missed" [""] "triggers that found another waveform begun or held, since the start"
            = |v| v.missed.min(u32::from(u16::MAX)) as u16;
    }
    "strongest lines" {
        480 Word "age" ["s"] "since the spectrum was complete; 65535: none yet, or older"
            = |v| v.bank.lines.age_s(v.now, v.ticks_per_second);
        481 Word "number" [""] "how many there were, 0 again behind 65535: changes with each" = |v| v.bank.lines.number;
        482 Word "count" [""] "lines kept, at most 10" = |v| v.bank.lines.word(|l| l.count);
        483 Word "speed_validity" [""] "0 none, 1 doubtful, 2 locked"
            = |v| v.bank.lines.word(|l| l.validity as u16);
        484 Float "rms" ["m/s^2"] "root mean square of the samples without their mean"
            = |v| v.bank.lines.float(|l| l.rms);
        486 Float "line_1_frequency" ["Hz"] "of the strongest line" = |v| v.line(0).frequency_hz;
        488 Float "line_1_amplitude" ["m/s^2"] "its peak amplitude" = |v| v.line(0).amplitude;
        490 Float "line_2_frequency" ["Hz"] "of the line of rank 2" = |v| v.line(1).frequency_hz;
        492 Float "line_2_amplitude" ["m/s^2"] "its peak amplitude" = |v| v.line(1).amplitude;
        494 Float "line_3_frequency" ["Hz"] "of the line of rank 3" = |v| v.line(2).frequency_hz;
        496 Float "line_3_amplitude" ["m/s^2"] "its peak amplitude" = |v| v.line(2).amplitude;
        498 Float "line_4_frequency" ["Hz"] "of the line of rank 4" = |v| v.line(3).frequency_hz;
        500 Float "line_4_amplitude" ["m/s^2"] "its peak amplitude" = |v| v.line(3).amplitude;
        502 Float "line_5_frequency" ["Hz"] "of the line of rank 5" = |v| v.line(4).frequency_hz;
        504 Float "line_5_amplitude" ["m/s^2"] "its peak amplitude" = |v| v.line(4).amplitude;
        506 Float "line_6_frequency" ["Hz"] "of the line of rank 6" = |v| v.line(5).frequency_hz;
        508 Float "line_6_amplitude" ["m/s^2"] "its peak amplitude" = |v| v.line(5).amplitude;
        510 Float "line_7_frequency" ["Hz"] "of the line of rank 7" = |v| v.line(6).frequency_hz;
        512 Float "line_7_amplitude" ["m/s^2"] "its peak amplitude" = |v| v.line(6).amplitude;
        514 Float "line_8_frequency" ["Hz"] "of the line of rank 8" = |v| v.line(7).frequency_hz;
        516 Float "line_8_amplitude" ["m/s^2"] "its peak amplitude" = |v| v.line(7).amplitude;
        518 Float "line_9_frequency" ["Hz"] "of the line of rank 9" = |v| v.line(8).frequency_hz;
        520 Float "line_9_amplitude" ["m/s^2"] "its peak amplitude" = |v| v.line(8).amplitude;
        522 Float "line_10_frequency" ["Hz"] "of the line of rank 10" = |v| v.line(9).frequency_hz;
        524 Float "line_10_amplitude" ["m/s^2"] "its peak amplitude" = |v| v.line(9).amplitude;
    }
    "train" {
        544 Word "gear_1_stage" [""] "stage of further gear 1 as configured; 0: there is none"
            = |v| v.train(0).stage.into();
        545 Word "gear_1_teeth" [""] "its teeth as configured" = |v| v.train(0).teeth;
        546 Word "gear_1_age" ["s"] "since its latest result; 65535: none yet, or older"
            = |v| v.further_age_s(0);
        547 Word "gear_1_number" [""] "how many results there were, 0 again behind 65535" = |v| v.further_number(0);
        548 Float "gear_1_speed" ["Hz"] "its rate" = |v| v.further(0).speed_hz;
        550 Float "gear_1_mesh_1" ["m/s^2"] "first harmonic of its mesh, peak amplitude"
            = |v| v.further(0).mesh;
        552 Float "gear_1_below" ["m/s^2"] "first sideband of that by its rate, below"
            = |v| v.further(0).sidebands[0];
        554 Float "gear_1_above" ["m/s^2"] "first sideband of that by its rate, above"
            = |v| v.further(0).sidebands[1];
        556 Float "gear_1_residual_rms" ["m/s^2"] "root mean square of its average's residual signal"
            = |v| v.further(0).residual_rms;
        558 Float "gear_1_fm0" [""] "FM0 of its average" = |v| v.further(0).fm0;
        560 Float "gear_1_fm4" [""] "FM4 of its average" = |v| v.further(0).fm4;
        562 Word "gear_2_stage" [""] "stage of further gear 2 as configured; 0: there is none"
            = |v| v.train(1).stage.into();
        563 Word "gear_2_teeth" [""] "its teeth as configured" = |v| v.train(1).teeth;
        564 Word "gear_2_age" ["s"] "since its latest result; 65535: none yet, or older"
            = |v| v.further_age_s(1);
        565 Word "gear_2_number" [""] "how many results there were, 0 again behind 65535" = |v| v.further_number(1);
        566 Float "gear_2_speed" ["Hz"] "its rate" = |v| v.further(1).speed_hz;
        568 Float "gear_2_mesh_1" ["m/s^2"] "first harmonic of its mesh, peak amplitude"
            = |v| v.further(1).mesh;
        570 Float "gear_2_below" ["m/s^2"] "first sideband of that by its rate, below"
            = |v| v.further(1).sidebands[0];
        572 Float "gear_2_above" ["m/s^2"] "first sideband of that by its rate, above"
            = |v| v.further(1).sidebands[1];
        574 Float "gear_2_residual_rms" ["m/s^2"] "root mean square of its average's residual signal"
            = |v| v.further(1).residual_rms;
        576 Float "gear_2_fm0" [""] "FM0 of its average" = |v| v.further(1).fm0;
        578 Float "gear_2_fm4" [""] "FM4 of its average" = |v| v.further(1).fm4;
        580 Word "gear_3_stage" [""] "stage of further gear 3 as configured; 0: there is none"
            = |v| v.train(2).stage.into();
        581 Word "gear_3_teeth" [""] "its teeth as configured" = |v| v.train(2).teeth;
        582 Word "gear_3_age" ["s"] "since its latest result; 65535: none yet, or older"
            = |v| v.further_age_s(2);
        583 Word "gear_3_number" [""] "how many results there were, 0 again behind 65535" = |v| v.further_number(2);
        584 Float "gear_3_speed" ["Hz"] "its rate" = |v| v.further(2).speed_hz;
        586 Float "gear_3_mesh_1" ["m/s^2"] "first harmonic of its mesh, peak amplitude"
            = |v| v.further(2).mesh;
        588 Float "gear_3_below" ["m/s^2"] "first sideband of that by its rate, below"
            = |v| v.further(2).sidebands[0];
        590 Float "gear_3_above" ["m/s^2"] "first sideband of that by its rate, above"
            = |v| v.further(2).sidebands[1];
        592 Float "gear_3_residual_rms" ["m/s^2"] "root mean square of its average's residual signal"
            = |v| v.further(2).residual_rms;
        594 Float "gear_3_fm0" [""] "FM0 of its average" = |v| v.further(2).fm0;
        596 Float "gear_3_fm4" [""] "FM4 of its average" = |v| v.further(2).fm4;
        598 Word "gear_4_stage" [""] "stage of further gear 4 as configured; 0: there is none"
            = |v| v.train(3).stage.into();
        599 Word "gear_4_teeth" [""] "its teeth as configured" = |v| v.train(3).teeth;
        600 Word "gear_4_age" ["s"] "since its latest result; 65535: none yet, or older"
            = |v| v.further_age_s(3);
        601 Word "gear_4_number" [""] "how many results there were, 0 again behind 65535" = |v| v.further_number(3);
        602 Float "gear_4_speed" ["Hz"] "its rate" = |v| v.further(3).speed_hz;
        604 Float "gear_4_mesh_1" ["m/s^2"] "first harmonic of its mesh, peak amplitude"
            = |v| v.further(3).mesh;
        606 Float "gear_4_below" ["m/s^2"] "first sideband of that by its rate, below"
            = |v| v.further(3).sidebands[0];
        608 Float "gear_4_above" ["m/s^2"] "first sideband of that by its rate, above"
            = |v| v.further(3).sidebands[1];
        610 Float "gear_4_residual_rms" ["m/s^2"] "root mean square of its average's residual signal"
            = |v| v.further(3).residual_rms;
        612 Float "gear_4_fm0" [""] "FM0 of its average" = |v| v.further(3).fm0;
        614 Float "gear_4_fm4" [""] "FM4 of its average" = |v| v.further(3).fm4;
        616 Word "gear_5_stage" [""] "stage of further gear 5 as configured; 0: there is none"
            = |v| v.train(4).stage.into();
        617 Word "gear_5_teeth" [""] "its teeth as configured" = |v| v.train(4).teeth;
        618 Word "gear_5_age" ["s"] "since its latest result; 65535: none yet, or older"
            = |v| v.further_age_s(4);
        619 Word "gear_5_number" [""] "how many results there were, 0 again behind 65535" = |v| v.further_number(4);
        620 Float "gear_5_speed" ["Hz"] "its rate" = |v| v.further(4).speed_hz;
        622 Float "gear_5_mesh_1" ["m/s^2"] "first harmonic of its mesh, peak amplitude"
            = |v| v.further(4).mesh;
        624 Float "gear_5_below" ["m/s^2"] "first sideband of that by its rate, below"
            = |v| v.further(4).sidebands[0];
        626 Float "gear_5_above" ["m/s^2"] "first sideband of that by its rate, above"
            = |v| v.further(4).sidebands[1];
        628 Float "gear_5_residual_rms" ["m/s^2"] "root mean square of its average's residual signal"
            = |v| v.further(4).residual_rms;
        630 Float "gear_5_fm0" [""] "FM0 of its average" = |v| v.further(4).fm0;
        632 Float "gear_5_fm4" [""] "FM4 of its average" = |v| v.further(4).fm4;
    }
    "command" {
        1000 Word "command" [""] "written by function 6 or 16 where the configuration permits it: 1 acknowledges all \
            alarms, 2 takes a waveform, 3 releases the one held; reads as 0" = |_| 0;
    }
}

/// The register that takes commands.
pub const COMMAND: u16 = 1000;
/// First register of the samples of the waveform held: one float each, m/s^2, the oldest first.
pub const SAMPLES: u16 = 20_000;
/// Registers of the samples; those behind the last sample are not a number.
pub const SAMPLE_REGISTERS: u16 = (2 * BLOCK * BLOCKS) as u16;

fn phase(phase: CapturePhase) -> u16 {
    match phase {
        CapturePhase::Off => 0,
        CapturePhase::Watching => 1,
        CapturePhase::Collecting => 2,
        CapturePhase::Sealing => 3,
        CapturePhase::Held => 4,
    }
}

fn trigger(trigger: Trigger) -> u16 {
    match trigger {
        Trigger::Request => 0,
        Trigger::Alarm { index } => 1 + u16::from(index),
    }
}

/// Discrete inputs.
pub const INPUTS: &[Bit] = &[
    Bit { address: 0, count: 8, name: "standing", meaning: "alarm 1 to 8 is raised, or latched" },
    Bit { address: 8, count: 8, name: "raised", meaning: "the value of alarm 1 to 8 is beyond its limit" },
    Bit { address: 16, count: 8, name: "unseen", meaning: "alarm 1 to 8 stands and is not acknowledged" },
    Bit {
        address: 24,
        count: 1,
        name: "signal_bad",
        meaning: "the sensor is not in order, or was not and that is latched",
    },
    Bit { address: 25, count: 1, name: "any_standing", meaning: "any alarm stands; as the alarm output" },
    Bit { address: 26, count: 1, name: "speed_locked", meaning: "the latest status has a locked speed" },
    Bit {
        address: 27,
        count: 1,
        name: "measuring",
        meaning: "the node measures with a locked speed and settled filters",
    },
    Bit { address: 28, count: 1, name: "values_good", meaning: "the latest values are good: see the register quality" },
    Bit { address: 29, count: 1, name: "self_test_failed", meaning: "an item of the self-test has failed" },
];
/// How many there are.
pub const BITS: u32 = 30;

/// All of them, the first one lowest.
pub fn bits(view: &View<'_>) -> u64 {
    let AlarmState { raised, standing, unseen, signal_bad } = view.alarms;
    let locked = view.bank.status.latest.is_some_and(|status| status.validity == Validity::Locked);
    let good = view.bank.values.latest.is_some_and(|values| quality(&values.quality, &values.tag) & !NO_SPEED == 0);
    let single =
        [signal_bad, view.alarm_stands, locked, view.state == State::Measuring, good, view.self_test.failed != 0];
    let single = single.iter().enumerate().fold(0, |bits, (place, &is)| bits | u64::from(is) << place);
    u64::from(standing) | u64::from(raised) << 8 | u64::from(unseen) << 16 | single << 24
}

/// Bit of [`quality`] for a record without a locked speed: its values are good all the same.
const NO_SPEED: u16 = 1 << 4;

fn quality(quality: &Quality, tag: &Tag) -> u16 {
    let Quality { overload, gap, settling, stuck, .. } = *quality;
    let no_speed = tag.validity != Validity::Locked;
    [overload, gap, settling, stuck, no_speed].iter().rev().fold(0, |bits, &is| bits << 1 | u16::from(is))
}

fn status_flags(status: &Status) -> u16 {
    let Status { law_clamped, law_provisional, limited, safe_rate, .. } = *status;
    [law_clamped, law_provisional, limited, safe_rate].iter().rev().fold(0, |bits, &is| bits << 1 | u16::from(is))
}

/// Reads a range of registers into `put`; `None` where it holds an address without a meaning.
pub fn read(first: u16, count: u16, view: &View<'_>, put: &mut impl FnMut(u16)) -> Option<()> {
    let (mut next, end) = (u32::from(first), u32::from(first) + u32::from(count));
    for reader in READERS {
        let address = u32::from(reader.address);
        if reader.end() <= next || address >= end {
            continue;
        }
        let words = reader.words(view);
        // A value of two registers can be read by halves.
        for (at, word) in (address..).zip(words.iter().flatten()) {
            if at == next && next < end {
                put(*word);
                next += 1;
            }
        }
    }
    (next == end).then_some(())
}

/// Reads a range of the samples' registers into `put`; `None` where it reaches beyond them.
pub fn read_samples(
    first: u16,
    count: u16,
    options: ModbusOptions,
    sample: &impl Fn(u32) -> f32,
    put: &mut impl FnMut(u16),
) -> Option<()> {
    let from = u32::from(first.checked_sub(SAMPLES)?);
    let range = from..from + u32::from(count);
    if range.end > u32::from(SAMPLE_REGISTERS) {
        return None;
    }
    for register in range {
        let [high, low] = halves(sample(register / 2).to_bits(), options);
        put(if register % 2 == 0 { high } else { low });
    }
    Some(())
}

/// The words of a value of two registers, in their order on the line.
fn halves(bits: u32, options: ModbusOptions) -> [u16; 2] {
    let (high, low) = ((bits >> 16) as u16, bits as u16);
    if options.low_word_first { [low, high] } else { [high, low] }
}

impl Reader {
    /// The value, in the order of its words on the line.
    fn words(&self, view: &View<'_>) -> [Option<u16>; 2] {
        let halves = |bits: u32| halves(bits, view.options).map(Some);
        match self.read {
            Read::Word(read) => [Some(read(view)), None],
            Read::Long(read) => halves(read(view)),
            Read::Float(read) => halves(read(view).to_bits()),
        }
    }

    fn end(&self) -> u32 {
        u32::from(self.address) + if matches!(self.read, Read::Word(_)) { 1 } else { 2 }
    }
}
