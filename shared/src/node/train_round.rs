//! The round over the gears of a train: which one the order domain follows, and when the next one's turn is.
//!
//! One order chain serves all gears: the pinion first, then each of [`Configuration::train`]. Marks of a further gear
//! come from the tach by its exact ratio, the mesh cascade is made for its speed, and it is followed until a mesh-band
//! record and an average are complete, or until it has had [`PATIENCE_RECORDS`] times as long as they take. Overall
//! values, waveforms and the law's check stay the pinion's. A pair has no round: nothing here then does anything.
//!
//! Cost: memory of one [`TurnMarks`]; time, because each gear is looked at once per round: the sum of the gears'
//! averages, 16 to 64 turns of each.

use super::{Node, State};
use crate::buffers::Arrays;
use crate::config::Configuration;
use crate::mesh_band::{self, Followed};
use crate::tach::turn_marks::{Continuity, Ratio, TurnMarks};
use crate::units::Hertz;

/// Times the turns of an average after which a gear that completes nothing is left for the next one.
const PATIENCE_RECORDS: f32 = 3.0;

/// Where the round is.
#[derive(Clone, Debug)]
pub struct TrainRound {
    /// Gear followed: 0 the pinion, 1 the first further one.
    gear: u8,
    /// Marks of a further gear.
    marks: TurnMarks,
    /// Since when it is followed, ticks.
    since: u64,
    has_bands: bool,
    has_average: bool,
}

impl TrainRound {
    /// At the pinion.
    pub fn new(config: &Configuration) -> Self {
        Self { gear: 0, marks: TurnMarks::new(&config.tach), since: 0, has_bands: false, has_average: false }
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

    /// Goes to a gear at a tick.
    fn go_to(&mut self, config: &Configuration, gear: u8, tick: u64) {
        let pinion = Ratio::of(config.tach.pinion_per_tach);
        let further = usize::from(gear).checked_sub(1).and_then(|place| config.train.get(place));
        let ratio = further.and_then(|gear| pinion.times(gear.turns, gear.pinion_turns)).unwrap_or(pinion);
        *self = Self { gear, marks: TurnMarks::with_ratio(&config.tach, ratio), ..Self::new(config) };
        self.since = tick;
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
        if self.config.train.is_empty() || self.state != State::Measuring {
            return;
        }
        let TrainRound { gear, since, has_bands, has_average, .. } = self.round;
        let followed = self.round.followed(&self.config);
        let turns = mesh_band::average_turns(followed.teeth, followed.mate_teeth).0 as f32;
        let rate_hz = followed.rate(self.present_speed().pinion).0.max(f32::MIN_POSITIVE);
        let elapsed_s = self.clock.seconds(self.next_tick.saturating_sub(since));
        if (has_bands && has_average) || elapsed_s * rate_hz > PATIENCE_RECORDS * turns {
            let count = self.config.train.len() as u8 + 1;
            self.follow_gear(if gear + 1 < count { gear + 1 } else { 0 });
        }
    }

    /// Follows a gear from the next code on: the chain and the mesh cascade begin anew.
    fn follow_gear(&mut self, gear: u8) {
        self.round.go_to(&self.config, gear, self.next_tick);
        let followed = self.round.followed(&self.config);
        mesh_band::configure(&mut self.arrays.buffers_mut().chain, &followed, self.clock);
        self.records_since = self.next_tick;
        self.restart_mesh(self.next_tick);
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
