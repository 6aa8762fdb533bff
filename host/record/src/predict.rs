//! What the declared machine gives for each run of a record: declaration, torque and tach only.
//!
//! The angle comes from the tach, so the contact positions do; forces do not. The machine is in steady
//! state at the first sample. Sensors are flat but for the effects given.

use crate::dynamics::assembly::{Damping, Model};
use crate::dynamics::excitation::{Effect, Sampled};
use crate::dynamics::kinematics::Motion;
use crate::dynamics::rig::Rig;
use crate::dynamics::taylor::Statistics;
use crate::machine::Machine;
use crate::record::{Record, Run};
use crate::{Error, Result};
use std::collections::HashMap;

/// Predicts every run of a record.
pub struct Predictor {
    /// The machine as declared.
    pub rig: Rig,
    /// Factor on the declared torques, 1 as declared.
    pub torque_factor: f64,
    pulses_per_turn: u32,
    turns_of_pinion: f64,
    jitter_s: f64,
    rate_hz: f64,
    /// Turns of the pinion by which runs start later than their pulse 0 says, by signal.
    later: HashMap<String, u32>,
}

impl Predictor {
    /// Prepares the declared machine of a record.
    ///
    /// # Errors
    /// A record without machine or tach.
    pub fn new(record: &Record, model: Model, damping: Damping) -> Result<Self> {
        let machine = Machine::read(&record.folder)?;
        let tach = record.require_tach()?;
        let turns_of_pinion = tach.turns_per_pinion_turn(Some(machine.pair.teeth)).map_or(1.0, f64::recip);
        Ok(Self {
            rig: Rig::new(&machine, model, damping)?,
            torque_factor: 1.0,
            pulses_per_turn: tach.pulses_per_rev,
            turns_of_pinion,
            jitter_s: tach.jitter_s.unwrap_or(0.0),
            rate_hz: record.declaration.acquisition.sample_rate_hz,
            later: HashMap::new(),
        })
    }

    /// Starts every run of the record some whole turns of the pinion later; an empty list changes nothing.
    ///
    /// A tachometer on the pinion does not tell where in the hunting period a run starts; effects of the gear depend
    /// on it.
    ///
    /// # Errors
    /// A list of another length than the record's runs, or a tachometer on another shaft, whose angle it does tell.
    pub fn start_later(&mut self, record: &Record, pinion_turns: &[u32]) -> Result<()> {
        if pinion_turns.is_empty() {
            return Ok(());
        }
        if self.turns_of_pinion != 1.0 {
            return Err(Error::invalid(
                "pinion_turns",
                "the record's tachometer is not on the pinion, and tells the angle of its own shaft",
            ));
        }
        if pinion_turns.len() != record.runs.len() {
            let what = format!("{} values for {} runs", pinion_turns.len(), record.runs.len());
            return Err(Error::invalid("pinion_turns", what));
        }
        let signals = record.runs.iter().map(|run| run.declaration.signal.clone());
        self.later = signals.zip(pinion_turns.iter().copied()).collect();
        Ok(())
    }

    /// Angle of the pinion during a run.
    ///
    /// # Errors
    /// Edges that give no speed.
    pub fn motion(&self, run: &Run) -> Result<Motion> {
        let later = self.later.get(&run.declaration.signal).copied().unwrap_or(0);
        let first = u64::from(run.declaration.first_pulse_index) + u64::from(later) * u64::from(self.pulses_per_turn);
        let motion = Motion::from_tach(&run.edges_s, self.pulses_per_turn, first, self.jitter_s)?;
        Ok(motion.geared(self.turns_of_pinion))
    }

    /// Acceleration of both channels over a run, m/s2, after what the effects do to the measuring chain.
    ///
    /// Random phases of effects (hum, tones) are those of seed 0, the same in every run: their levels count, not
    /// their waveforms.
    ///
    /// # Errors
    /// A run without torque, and everything that stops the solver.
    pub fn predict(&self, run: &Run, effects: &[Box<dyn Effect>]) -> Result<([Vec<f64>; 2], Statistics)> {
        let torque = run.declaration.input_torque_n_m.ok_or_else(|| {
            Error::invalid(&run.declaration.signal, "[[run]] input_torque_n_m is needed for a prediction")
        })?;
        let (motion, torque) = (self.motion(run)?, torque * self.torque_factor);
        let (mut channels, statistics) =
            self.rig.accelerations(&motion, torque, effects, self.rate_hz, run.samples())?;
        let facts = self.rig.facts(torque);
        let turns: Vec<f64> =
            (0..run.samples()).map(|i| motion.turns(i as f64 / self.rate_hz, 1e-6).coefficient(0)).collect();
        let rate_hz = self.rate_hz;
        for effect in effects {
            effect.measure(&mut Sampled { channels: &mut channels, rate_hz, seed: 0, turns: &turns, facts: &facts });
        }
        Ok((channels, statistics))
    }
}
