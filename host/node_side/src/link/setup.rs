//! A node's configuration from a declared machine or gear train, a law file, a settings file and what only the
//! installation knows.

use super::limit::Limit;
use super::machine_class::MachineClass;
use super::settings::Settings;
use super::train::FollowedGears;
use crate::law::file::LawFile;
use crate::machine::Machine;
use crate::{Error, Result};
use meshband::config::{Configuration, GearPair};
use meshband::units::{Acceleration, Hertz};
use meshband_train::Train;
use std::path::Path;

/// Facts of the installation, from the command line; what is not given stays as it is.
#[derive(Clone, Debug, Default)]
pub struct Installation {
    /// Teeth of pinion and gear; the machine's declaration otherwise.
    pub teeth: Option<[u16; 2]>,
    /// Tach pulse positions per turn of its shaft.
    pub pulses_per_turn: Option<u16>,
    /// Adjacent missing teeth of the tach wheel.
    pub missing: Option<u16>,
    /// Turns of the pinion per turn of the tach shaft.
    pub pinion_per_tach: Option<f32>,
    /// Acceleration per 16-bit ADC code, m/s^2.
    pub acceleration_per_code: Option<f32>,
    /// Stop edge of the analogue filter, Hz.
    pub analogue_stop_hz: Option<f32>,
    /// Highest ADC rate, Hz.
    pub highest_adc_hz: Option<f32>,
    /// Mesh harmonics to report.
    pub harmonics: Option<u8>,
    /// Sideband pairs to report per harmonic.
    pub sidebands: Option<u8>,
    /// Class of the machine, for limits on its velocity.
    pub machine_class: Option<MachineClass>,
}

/// Files read and checked, before any node is asked.
#[derive(Clone, Debug, Default)]
pub struct Sources {
    machine: Option<Machine>,
    train: Option<(Train, FollowedGears)>,
    /// With the path, for what only shows when the law meets a machine.
    law: Option<(String, LawFile)>,
    settings: Option<Settings>,
}

impl Sources {
    /// Reads what is given.
    ///
    /// # Errors
    /// Unreadable files, tooth counts beyond a node's range, a law of another machine.
    pub fn read(machine: Option<&Path>, law: Option<&Path>, settings: Option<&Path>) -> Result<Self> {
        let machine = machine.map(Machine::read).transpose()?;
        let law = law.map(|path| Ok((path.display().to_string(), LawFile::read(path)?))).transpose()?;
        let settings = settings.map(Settings::read).transpose()?;
        let sources = Self { machine, train: None, law, settings };
        // Any configuration shows whether the three go together.
        sources.apply(&mut Configuration::default(), &Installation::default())?;
        Ok(sources)
    }

    /// With a gear train in place of the machine.
    ///
    /// # Errors
    /// An unreadable file, or a train that no node can follow.
    pub fn with_train(mut self, path: &Path) -> Result<Self> {
        let train = Train::read(path)?;
        let at_file = |error: Error| Error::invalid(path.display(), error);
        let followed = FollowedGears::of(&train).map_err(at_file)?;
        followed.apply(&train, &mut Configuration::default()).map_err(at_file)?;
        self.train = Some((train, followed));
        Ok(self)
    }

    /// The gears that the node follows, where a train was given.
    pub fn followed(&self) -> Option<&FollowedGears> {
        self.train.as_ref().map(|(_, followed)| followed)
    }

    /// Changes a configuration to suit the machine, the law, the settings, and above them the installation.
    ///
    /// # Errors
    /// As [`Sources::read`].
    pub fn apply(&self, config: &mut Configuration, installation: &Installation) -> Result<()> {
        if let Some(machine) = &self.machine {
            let [pinion_teeth, gear_teeth] = machine.pair.teeth.map(|teeth| {
                u16::try_from(teeth).map_err(|_| Error::invalid("[pair] teeth", "beyond the range of a node, 65535"))
            });
            config.gears = GearPair { pinion_teeth: pinion_teeth?, gear_teeth: gear_teeth? };
            forget_train(config);
        }
        if let Some((train, followed)) = &self.train {
            forget_train(config);
            followed.apply(train, config)?;
        }
        if let Some(settings) = &self.settings {
            settings.apply(config)?;
        }
        if let Some((place, file)) = &self.law {
            let law = file.for_node()?;
            if self.machine.as_ref().is_some_and(|machine| law.machine_hash != machine.hash()) {
                let what = format!("is the law of another machine ({}), or this one has changed since", file.machine);
                return Err(Error::invalid(place, what));
            }
            config.law = law;
        }
        if let Some([pinion_teeth, gear_teeth]) = installation.teeth {
            config.gears = GearPair { pinion_teeth, gear_teeth };
            forget_train(config);
        }
        set(&mut config.tach.pulses_per_turn, installation.pulses_per_turn);
        set(&mut config.tach.missing, installation.missing);
        set(&mut config.tach.pinion_per_tach, installation.pinion_per_tach);
        set(&mut config.sensor.acceleration_per_code, installation.acceleration_per_code.map(Acceleration));
        set(&mut config.limits.analogue_stop, installation.analogue_stop_hz.map(Hertz));
        set(&mut config.limits.highest_adc, installation.highest_adc_hz.map(Hertz));
        set(&mut config.mesh.harmonics, installation.harmonics);
        set(&mut config.mesh.sidebands, installation.sidebands);
        installation.machine_class.map_or(Ok(()), |class| class.apply(config))
    }
}

/// Another machine: its gears and its stages' laws are unknown, and limits of gears that are gone would judge the
/// pinion.
fn forget_train(config: &mut Configuration) {
    config.train.clear();
    config.stage_laws.clear();
    let kept: Vec<Limit> = Limit::all(config).into_iter().filter(|limit| limit.gear == 0).collect();
    config.alarms = kept.iter().map(|limit| limit.band).collect();
    config.modes = kept.iter().map(|limit| limit.mode).collect();
    config.alarm_gears.clear();
}

fn set<T>(place: &mut T, value: Option<T>) {
    if let Some(value) = value {
        *place = value;
    }
}
