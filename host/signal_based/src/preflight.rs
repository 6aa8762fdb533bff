//! At which level the loop can run on a record, and what it lacks for the next: everything at once.
//!
//! *Model-based inference* needs what the declared machine's forward model takes
//! ([`meshband_analysis::observation::input`]): the machine with its pair stiffness, two channels on the bodies in
//! acceleration, a tach on the pinion whose angle 0 is the machine's, torques, three speeds. *Signal-based inference*
//! needs tooth counts, some tach and enough turns. A record that lacks a machine's table names it here; one that
//! declares it wrongly is refused by who reads it.

use crate::record::Record;
use crate::{Error, Result};
use serde::Serialize;

/// How the sentence on missing speeds begins.
const FEW_SPEEDS: &str = "runs at";
/// Speeds that model-based inference needs.
const SPEEDS: usize = 3;
/// Relative distance of mean speeds that are two.
const MIN_SPEED_GAP_SHARE: f64 = 0.02;
/// Units of acceleration.
const ACCELERATION: [&str; 4] = ["m/s2", "m/s^2", "m/s\u{b2}", "g"];

/// A level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Level {
    /// Lines at known orders behind an unknown path.
    SignalBased,
    /// The declared machine's equations.
    ModelBased,
}

/// What is missing for each level.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Preflight {
    /// For signal-based inference.
    pub for_signal_based: Vec<String>,
    /// For model-based inference, beyond those.
    pub for_model_based: Vec<String>,
}

impl Preflight {
    /// Looks at a record.
    pub fn of(record: &Record) -> Self {
        let mut preflight = Self::default();
        preflight.signal_based(record);
        preflight.tach(record);
        preflight.machine(record);
        preflight.runs(record);
        preflight
    }

    /// The level to run at: the one asked for, or the highest that the record allows.
    ///
    /// # Errors
    /// One line with everything that is missing.
    pub fn level(&self, wanted: Option<Level>, place: &str) -> Result<Level> {
        let list = |missing: &[String]| missing.join("; ");
        if wanted != Some(Level::ModelBased) && !self.for_signal_based.is_empty() {
            let what = format!("neither inference is possible, missing: {}", list(&self.for_signal_based));
            return Err(Error::invalid(place, what));
        }
        match wanted {
            Some(Level::ModelBased) if !self.for_model_based.is_empty() || !self.for_signal_based.is_empty() => {
                let all = [self.for_signal_based.clone(), self.for_model_based.clone()].concat();
                Err(Error::invalid(place, format!("model-based inference is not possible, missing: {}", list(&all))))
            }
            Some(level) => Ok(level),
            None if self.for_model_based.is_empty() => Ok(Level::ModelBased),
            None => Ok(Level::SignalBased),
        }
    }

    /// Whether speeds are all that model-based inference lacks: the rest is declared, and has to be right.
    pub fn lacks_only_speeds(&self) -> bool {
        self.for_model_based.iter().all(|missing| missing.starts_with(FEW_SPEEDS))
    }

    fn signal_based(&mut self, record: &Record) {
        let missing = &mut self.for_signal_based;
        let declaration = &record.declaration;
        if declaration.teeth().is_none() && !declaration.has_no_gears() && !declaration.has_train() {
            missing.push("tooth counts ([pair] teeth, `import --teeth`)".into());
        }
        let with_edges = record.runs.iter().filter(|run| run.edges_s.len() >= 3).count();
        if record.declaration.tach.is_none() || with_edges == 0 {
            missing.push("a speed reference ([tach]; `import --tach`, or `import --teeth` for a virtual one)".into());
        }
        if record.runs.is_empty() {
            missing.push("runs ([[run]])".into());
        }
    }

    fn tach(&mut self, record: &Record) {
        let missing = &mut self.for_model_based;
        let Some(tach) = &record.declaration.tach else { return };
        match tach.source.as_deref() {
            Some("virtual") => missing.push("a real tachometer (this one is virtual, its angle 0 unknown)".into()),
            Some("nominal") => missing.push("a tachometer (there is a nominal speed only)".into()),
            Some("measured") => {
                missing
                    .push("where the tachometer's angle 0 lies against the teeth (tach.source is \"measured\")".into());
            }
            _ => {}
        }
        if tach.shaft != "pinion" {
            missing
                .push(format!("the tachometer on the pinion's shaft (it is on '{}')", crate::text::name(&tach.shaft)));
        }
    }

    fn machine(&mut self, record: &Record) {
        let missing = &mut self.for_model_based;
        if !record.declaration.has_machine() {
            missing.push("the machine: geometry of the [pair], masses and stiffnesses of the [shafts]".into());
        }
        // Without a table the pair's stiffness is derived from its geometry; how a pair takes up its load is not.
        if record.declaration.stiffness_tables().is_empty() && !record.declaration.has_engagement() {
            missing.push(
                "stiffness of a tooth pair ([pair] pair_stiffness, or [engagement] for the stiffness by geometry)"
                    .into(),
            );
        }
        let acquisition = &record.declaration.acquisition;
        if acquisition.channels.len() != 2 {
            let count = acquisition.channels.len();
            missing.push(format!(
                "exactly two channels, on pinion and gear body along the line of action (there are {count})"
            ));
        }
        if let Some(unit) = acquisition.unit.as_deref().filter(|unit| !ACCELERATION.contains(unit)) {
            missing.push(format!("acceleration in m/s2 or g (the unit is '{}')", crate::text::name(unit)));
        }
    }

    fn runs(&mut self, record: &Record) {
        let missing = &mut self.for_model_based;
        let unknown: Vec<String> = (0..record.runs.len())
            .filter(|&i| record.declaration.runs.get(i).is_none_or(|run| run.input_torque_n_m.is_none()))
            .map(|i| i.to_string())
            .collect();
        if !unknown.is_empty() {
            missing.push(format!(
                "the torque of run{} {}",
                if unknown.len() > 1 { "s" } else { "" },
                unknown.join(", ")
            ));
        }
        let pulses = record.declaration.tach.as_ref().map_or(1, |tach| tach.pulses_per_rev);
        let mut speeds: Vec<f64> = record.runs.iter().filter_map(|run| run.mean_speed_hz(pulses)).collect();
        speeds.sort_by(f64::total_cmp);
        let apart = |w: &&[f64]| w[1] > w[0] * (1.0 + MIN_SPEED_GAP_SHARE);
        let count = speeds.len().min(1) + speeds.windows(2).filter(apart).count();
        if count < SPEEDS {
            missing.push(format!(
                "{FEW_SPEEDS} {SPEEDS} speeds (there {} {count})",
                if count == 1 { "is" } else { "are" }
            ));
        }
    }
}
