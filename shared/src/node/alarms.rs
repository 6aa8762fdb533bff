//! The node's alarms: which value is put to which limit, the signal's own alarm, the latch, and what a person
//! acknowledges.
//!
//! Values that cannot be judged ([`crate::message::Quality`]) never come here; a signal that is clipped or dead has
//! an alarm of its own instead. What latches is kept in the configuration's record, the one place that a power cut
//! leaves alone, unless the configuration in force is one that nobody stored.

use super::Node;
use crate::alarm::{Alarm, AlarmChange, Watched};
use crate::buffers::Arrays;
use crate::config::{Configuration, MAX_ALARMS};
use crate::events::EventKind;
use crate::message::{AlarmState, Quality};
use crate::units::Hertz;
use crate::waveform::Trigger;

impl<A: Arrays> Node<A> {
    /// Puts a value to the limits of its quantity; `speed` where there is one to believe.
    pub(super) fn watch(&mut self, watched: Watched, speed: Option<Hertz>, value: f32) {
        let holding = self.config.holding;
        let persistence = (holding.persistence_s * self.clock.0 as f32) as u64;
        for index in 0..self.config.alarms.len() {
            let (Some(&band), Some(alarm)) = (self.config.alarms.get(index), self.alarms.get_mut(index)) else {
                return;
            };
            if band.watched != watched || !band.applies(speed, &self.config.alarms) || !alarm.can_judge(speed) {
                continue;
            }
            let was_raised = alarm.is_raised();
            let change = alarm.update(&band, &holding, persistence, self.next_tick, value);
            if alarm.is_raised() && !was_raised {
                alarm.raised_by(speed);
            }
            match change {
                Some(AlarmChange::Raised) => {
                    self.note(EventKind::AlarmRaised, index as u32);
                    self.trigger_capture(Trigger::Alarm { index: index as u8 });
                }
                Some(AlarmChange::Cleared) => self.note(EventKind::AlarmCleared, index as u32),
                None => {}
            }
        }
        self.follow_latch();
    }

    /// What the latest record says of the signals themselves.
    pub(super) fn watch_signal(&mut self, first: &Quality, second: Option<&Quality>) {
        let bits = |quality: &Quality| u32::from(quality.overload) | u32::from(quality.stuck) << 1;
        let detail = bits(first) | second.map_or(0, bits) << 2;
        let bad = detail != 0;
        if bad != self.signal_bad {
            self.signal_bad = bad;
            self.note(if bad { EventKind::SignalBad } else { EventKind::SignalGood }, detail);
        }
    }

    /// A person has seen all alarms that stand.
    pub(super) fn acknowledge(&mut self) {
        for index in 0..self.alarms.len() {
            let Some(alarm) = self.alarms.get_mut(index) else { return };
            if alarm.acknowledge() == Some(AlarmChange::Cleared) {
                self.note(EventKind::AlarmCleared, index as u32);
            }
        }
        self.note(EventKind::AlarmsAcknowledged, 0);
        self.follow_latch();
    }

    /// Keeps unseen alarms in the configuration, and asks for it to be stored where they have changed.
    fn follow_latch(&mut self) {
        let unseen = if self.config.holding.latching { mask(&self.alarms, Alarm::is_unseen) } else { 0 };
        if unseen != self.config.latched {
            self.config.latched = unseen;
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

    /// Whether any alarm stands.
    pub fn alarm_stands(&self) -> bool {
        self.alarms.iter().any(Alarm::stands) || (self.config.holding.watch_signal && self.signal_bad)
    }

    /// The alarms as a status shows them.
    pub(crate) fn alarm_state(&self) -> AlarmState {
        AlarmState {
            raised: mask(&self.alarms, Alarm::is_raised),
            standing: mask(&self.alarms, Alarm::stands),
            unseen: mask(&self.alarms, Alarm::is_unseen),
            signal_bad: self.signal_bad,
        }
    }
}

/// Alarms as a configuration left them: those that nobody had acknowledged stand.
pub(super) fn alarms_of(config: &Configuration) -> [Alarm; MAX_ALARMS] {
    core::array::from_fn(|index| {
        let kept = config.holding.latching && index < config.alarms.len() && config.latched >> index & 1 != 0;
        if kept { Alarm::LATCHED } else { Alarm::default() }
    })
}

/// One bit per alarm, the first one lowest.
fn mask(alarms: &[Alarm; MAX_ALARMS], is: fn(&Alarm) -> bool) -> u8 {
    alarms.iter().enumerate().fold(0, |bits, (index, alarm)| bits | u8::from(is(alarm)) << index)
}

const _: () = assert!(MAX_ALARMS <= 8);
