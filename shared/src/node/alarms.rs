//! The node's side of the watch ([`super::watch`]): values come in from its products, decisions become events,
//! waveforms and a latch.
//!
//! What latches is kept in the configuration's record, the one place that a power cut leaves alone, unless the
//! configuration in force is one that nobody stored.

use super::Node;
use super::watch::{Decision, Evidence};
use crate::alarm::{AlarmChange, Put, Use, Watched};
use crate::buffers::Arrays;
use crate::config::MAX_ALARMS;
use crate::events::EventKind;
use crate::message::AlarmState;
use crate::units::Hertz;
use crate::waveform::Trigger;
use heapless::Vec;

/// At most one decision of each alarm and one of the sensor.
type Decisions = Vec<Decision, { MAX_ALARMS + 1 }>;

impl<A: Arrays> Node<A> {
    /// Puts a value to the limits of its quantity; `speed` where there is one to believe.
    pub(super) fn watch(&mut self, watched: Watched, speed: Option<Hertz>, value: f32, may: Use) {
        self.watch_of(0, watched, speed, value, may);
    }

    /// As [`Node::watch`], of a gear of the train: 0 is the pinion, and whatever is of no gear.
    pub(super) fn watch_of(&mut self, gear: u8, watched: Watched, speed: Option<Hertz>, value: f32, may: Use) {
        let put = Put { tick: self.next_tick, value, may };
        let mut decisions = Decisions::new();
        self.watch.put(&self.config, self.clock, (watched, gear), speed, put, |decision| {
            let _ = decisions.push(decision);
        });
        self.act_on(&decisions);
    }

    /// What the latest record says of the sensors themselves.
    pub(super) fn watch_sensor(&mut self, evidence: &Evidence) {
        let decision = self.watch.look_at(&self.config, self.clock, self.next_tick, evidence);
        self.act_on(decision.as_slice());
    }

    /// Limits that nothing is put to must not pass for kept, also where no record comes: once a second.
    pub(super) fn watch_blindness(&mut self) {
        if self.next_tick < self.blindness_due {
            return;
        }
        self.blindness_due = self.next_tick + u64::from(self.clock.0);
        let decision = self.watch.look_for_blindness(&self.config, self.clock, self.next_tick);
        self.act_on(decision.as_slice());
    }

    fn act_on(&mut self, decisions: &[Decision]) {
        for decision in decisions {
            match *decision {
                Decision::Alarm(index, AlarmChange::Raised) => {
                    self.note(EventKind::AlarmRaised, u32::from(index));
                    self.trigger_capture(Trigger::Alarm { index });
                }
                Decision::Alarm(index, AlarmChange::Cleared) => self.note(EventKind::AlarmCleared, u32::from(index)),
                Decision::SensorBad(reasons) => self.note(EventKind::SignalBad, u32::from(reasons)),
                Decision::SensorGood => self.note(EventKind::SignalGood, 0),
            }
        }
        self.follow_latch();
    }

    /// A person has seen all alarms that stand.
    pub(super) fn acknowledge(&mut self) {
        let mut decisions = Decisions::new();
        self.watch.acknowledge(|decision| {
            let _ = decisions.push(decision);
        });
        self.act_on(&decisions);
        self.note(EventKind::AlarmsAcknowledged, 0);
    }

    /// Keeps what nobody has seen in the configuration, and asks for it to be stored where it has changed.
    fn follow_latch(&mut self) {
        let unseen = if self.config.holding.latching { self.watch.unseen() } else { (0, false) };
        if unseen != (self.config.latched, self.config.sensor_latched) {
            (self.config.latched, self.config.sensor_latched) = unseen;
            self.latch_changed |= !self.volatile;
        }
    }

    /// Whether the latch is to be stored, once per change.
    pub fn take_latch_change(&mut self) -> bool {
        core::mem::take(&mut self.latch_changed)
    }

    /// The configuration in force is the stored one.
    pub fn on_stored(&mut self) {
        self.volatile = false;
    }

    /// Whether the alarm output is to say that an alarm stands.
    pub fn alarm_stands(&self) -> bool {
        self.watch.alarm_stands(&self.config)
    }

    /// Whether the sensor is in order.
    pub fn sensor_is_ok(&self) -> bool {
        self.watch.sensor_is_ok()
    }

    /// The alarms as a status shows them.
    pub(crate) fn alarm_state(&self) -> AlarmState {
        self.watch.alarm_state()
    }
}
