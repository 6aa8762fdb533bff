//! Which rate comes next: speed, law, rate plan, and what a lost or a new tach means.

use super::values::{EVERY_CODE_TO_HZ, HIGHEST_SPEED_HZ};
use super::{Node, REPLAN_AT_RECORD, REPLAN_NOW, State};
use crate::buffers::Arrays;
use crate::config::{Configuration, train_bandwidth_hz};
use crate::events::EventKind;
use crate::mesh_band::REACH;
use crate::rate_plan::{RateGrant, RatePlan, RatePolicy};
use crate::tach::{Speed, Validity};
use crate::units::Hertz;

impl<A: Arrays> Node<A> {
    /// Speed, law and plan; called at block borders.
    pub(super) fn replan(&mut self) {
        let speed = self.present_speed();
        self.follow_tach(&speed);
        if self.hold > 0 {
            self.hold -= 1;
            // Turns that follow each other within the hold must not keep a node with a speed at the rate of one
            // without.
            if !(self.safe_rate && speed.validity == Validity::Locked) {
                return;
            }
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
                let asked = asked_bandwidth(&self.config, law.bandwidth, speed.pinion);
                let wanted = self.config.policy.rate(self.config.pass.carried(asked));
                let departure = (wanted.0 / self.pending.requested.0 - 1.0).abs();
                let limit = if record_complete { REPLAN_AT_RECORD } else { REPLAN_NOW };
                if self.safe_rate || departure > limit {
                    self.safe_rate = false;
                    let fast = speed.pinion.0 > HIGHEST_SPEED_HZ / (1.0 + REPLAN_NOW);
                    let calm = if fast { Hertz(EVERY_CODE_TO_HZ) } else { self.config.limits.highest_adc };
                    self.pending = self.plan.grant_up_to(wanted, calm);
                    if self.pending.limited {
                        self.note(EventKind::RateLimited, self.pending.period_ticks);
                    }
                }
            }
        }
    }

    pub(super) fn follow_tach(&mut self, speed: &Speed) {
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
                // The mesh cascade depends on the speed; what came through that of no speed is no average.
                self.arrays.buffers_mut().chain.average().reset();
                self.restart_stream(self.next_tick);
            }
            (State::Settling | State::Measuring, Validity::None) => {
                self.state = State::WaitingForTach;
                let chain = &mut self.arrays.buffers_mut().chain;
                chain.lose_tach();
                chain.average().reset();
            }
            _ => {}
        }
    }
}

/// Rate without a speed: the law's at its highest speed, which carries the bandwidth of every lower one.
pub(super) fn safe_grant(config: &Configuration, plan: &mut RatePlan) -> RateGrant {
    match config.policy {
        RatePolicy::Forced { rate } => plan.force(rate),
        policy => {
            let highest = config.law.highest;
            let asked = asked_bandwidth(config, config.law.bandwidth(highest).bandwidth, highest);
            plan.grant(policy.rate(config.pass.carried(asked)))
        }
    }
}

/// What the law asks for, or a further stage of a train at the same speed, if that is more.
pub(super) fn asked_bandwidth(config: &Configuration, law: Hertz, pinion: Hertz) -> Hertz {
    let harmonics = f32::from(config.mesh.harmonics) + REACH;
    Hertz(law.0.max(train_bandwidth_hz(&config.train, &config.stage_laws, harmonics, pinion)))
}
