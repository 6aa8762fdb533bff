//! The round over the gears of a train: which one the order domain follows, and when the next one's turn is.
//!
//! One order chain serves all gears: the pinion first, then each of [`Configuration::train`]. Marks of a further gear
//! come from the tach by its exact ratio, the mesh cascade is made for its speed, and it is followed until a mesh-band
//! record and an average are complete, or until it has had `PATIENCE_RECORDS` times as long as they take. Overall
//! values, waveforms and the law's check stay the pinion's. A pair has no round: nothing here then does anything.
//!
//! Cost: memory of one [`TurnMarks`]; time, because each gear is looked at once per round: the sum of the gears'
//! averages, 16 to 64 turns of each.

use super::{NO_RECORDS_S, Node, State};
use crate::buffers::Arrays;
use crate::config::Configuration;
use crate::events::EventKind;
use crate::levels::{Departures, LocalDepartures};
use crate::mesh_band::{self, Followed};
use crate::tach::turn_marks::{Continuity, Ratio, TurnMarks};
use crate::units::Hertz;

/// Times the turns of an average after which a gear that completes nothing is left for the next one.
const PATIENCE_RECORDS: f32 = 3.0;
/// Half the range of a turn mark's ticks.
const HALF_WRAP_TICKS: f32 = 2_147_483_648.0;

/// Where the round is.
#[derive(Clone, Debug)]
pub struct TrainRound {
    /// Gear followed: 0 the pinion, 1 the first further one.
    gear: u8,
    /// Marks of a further gear.
    marks: TurnMarks,
    /// Since when it is followed by a node that measures, ticks.
    since: Option<u64>,
    has_bands: bool,
    has_average: bool,
    /// Orders of the pinion's shaft have been taken.
    has_orders: bool,
}

impl TrainRound {
    /// At the pinion.
    pub fn new(config: &Configuration) -> Self {
        let marks = TurnMarks::new(&config.tach);
        Self { gear: 0, marks, since: None, has_bands: false, has_average: false, has_orders: false }
    }

    /// Number of the gear followed: 0 the pinion.
    pub fn gear(&self) -> u8 {
        self.gear
    }

    /// The gear followed.
    pub fn followed(&self, config: &Configuration) -> Followed {
        Followed::of(config, self.gear)
    }

    /// A mesh-band record of the gear is complete.
    pub fn note_bands(&mut self) {
        self.has_bands = true;
    }

    /// Its average is complete.
    pub fn note_average(&mut self) {
        self.has_average = true;
    }

    /// Orders of the pinion's shaft have been taken.
    pub fn note_orders(&mut self) {
        self.has_orders = true;
    }

    /// Whether a mesh-band record of this visit is complete.
    pub fn has_bands(&self) -> bool {
        self.has_bands
    }

    /// Whether the visit has given all.
    fn is_complete(&self) -> bool {
        self.has_bands && self.has_average && (self.gear > 0 || self.has_orders)
    }

    /// Goes to a gear.
    fn go_to(&mut self, config: &Configuration, gear: u8) {
        let pinion = Ratio::of(config.tach.pinion_per_tach);
        let further = usize::from(gear).checked_sub(1).and_then(|place| config.train.get(place));
        let ratio = further.and_then(|gear| pinion.times(gear.turns, gear.pinion_turns)).unwrap_or(pinion);
        *self = Self { gear, marks: TurnMarks::with_ratio(&config.tach, ratio), ..Self::new(config) };
    }
}

impl<A: Arrays> Node<A> {
    /// Marks of a further gear, after a pulse.
    pub(super) fn follow_train_marks(&mut self) {
        if self.round.gear == 0 {
            return;
        }
        let chain = &mut self.arrays.buffers_mut().chain;
        if self.round.marks.follow(&self.tach, |instant| chain.push_mark(instant as u32)) == Continuity::Broken {
            chain.lose_tach();
            chain.average().reset();
        }
    }

    /// Goes on to the next gear where this one has given all, or has had its time.
    pub(super) fn go_round(&mut self) {
        if self.config.train.is_empty() {
            return;
        }
        if !matches!(self.state, State::Settling | State::Measuring) {
            // What passes without a speed is not the gear's time.
            self.round.since = None;
            return;
        }
        let since = *self.round.since.get_or_insert(self.next_tick);
        let followed = self.round.followed(&self.config);
        let turns = mesh_band::average_turns(followed.teeth, followed.mate_teeth).0 as f32;
        let rate = followed.rate(self.present_speed().pinion).0.max(f32::MIN_POSITIVE);
        let patience_s = NO_RECORDS_S.max(PATIENCE_RECORDS * turns / rate);
        let elapsed_s = self.clock.seconds(self.next_tick.saturating_sub(since));
        // Turn marks are 32 bits: a turn of half their range or more cannot be told.
        let too_slow = rate * HALF_WRAP_TICKS < self.clock.0 as f32;
        let is_complete = self.round.is_complete();
        if !is_complete && (too_slow || elapsed_s > patience_s) {
            self.note(EventKind::NoRecords, elapsed_s as u32);
        }
        if is_complete || too_slow || elapsed_s > patience_s {
            let gears = self.config.train.len() as u8 + 1;
            let next = self.round.gear + 1;
            self.follow_gear(if next < gears { next } else { 0 });
        }
    }

    /// Follows a gear from the next code on: the chain and the mesh cascade begin anew.
    fn follow_gear(&mut self, gear: u8) {
        self.round_ended |= self.round.gear == 0 && self.round.is_complete();
        self.round.go_to(&self.config, gear);
        // Nothing of another gear's.
        self.sideband_energy = [f32::NAN; 2];
        let followed = self.round.followed(&self.config);
        mesh_band::configure(&mut self.arrays.buffers_mut().chain, &followed, self.clock);
        self.records_since = self.next_tick;
        self.restart_mesh(self.next_tick);
    }

    /// The departures to be said with the values: of a train those of the pinion's mesh, average and sidebands once,
    /// when a visit to it has ended. True where they are all there is.
    pub(super) fn departures_to_say(&mut self) -> (Departures, LocalDepartures, bool) {
        if self.config.train.is_empty() {
            return (self.departures, self.local_departures, true);
        }
        if core::mem::take(&mut self.round_ended) {
            let whole = (self.departures, self.local_departures, true);
            (self.departures.mesh_amplitude, self.departures.residual_rms) = (None, None);
            self.local_departures = LocalDepartures::NONE;
            return whole;
        }
        let part = Departures { mesh_amplitude: None, residual_rms: None, ..self.departures };
        (part, LocalDepartures::NONE, false)
    }

    /// The mesh cascade for the gear followed, from the code at a tick on.
    pub(super) fn restart_mesh(&mut self, first: u64) {
        let rate: Hertz = self.round.followed(&self.config).rate(self.present_speed().pinion);
        let followed = self.round.followed(&self.config);
        self.mesh_plan = mesh_band::MeshPlan::new(&followed, self.config.mesh.harmonics, rate, self.active.adc);
        self.stream.restart_mesh(first, self.active.period_ticks, self.mesh_plan.decimation);
        self.arrays.buffers_mut().chain.set_samples_per_pitch(usize::from(self.mesh_plan.samples_per_pitch));
    }
}
