//! Alarms on the vibration velocity by the class of the machine.
//!
//! Zone boundaries of the velocity's RMS at bearing housings: ISO 20816-3:2022, annex A, and for machines below 15 kW
//! ISO 10816-1:1995, table B.1, class I. The boundary of zones B and C becomes an alert, that of C and D a danger.
//! The band ends at 1 kHz and begins at 10 Hz, for shafts below 600 r/min at 2 Hz.
//!
//! Limits: the values judge a whole machine in long operation and know nothing of gears. Levels learnt on the machine
//! itself find a change earlier. ISO 20816-9 (gear units) grades acceptance tests by curves over frequency: not built.

use super::limit::Limit;
use crate::{Error, Result};
use meshband::alarm::{AlarmBand, AlarmMode, Severity, Side, Watched};
use meshband::config::{Configuration, MAX_ALARMS};
use meshband::units::Hertz;

/// Slowest shaft, turns/s, whose band begins at 10 Hz (600 r/min; ISO 20816-3).
const SLOW_SHAFT_HZ: f32 = 10.0;
/// Lower edge of the band for slower shafts, Hz (ISO 20816-3).
const SLOW_FROM_HZ: f32 = 2.0;
/// Level that clears over the one that raises: own choice.
const CLEARING_SHARE: f32 = 0.9;
/// Consecutive values that raise: own choice.
const PERSISTENCE: u8 = 3;
/// Highest pinion rate of the alarms, turns/s: beyond every shaft of a node.
const EVERY_SPEED_HZ: f32 = 1000.0;

/// A class of machines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MachineClass {
    /// Below 15 kW.
    Small,
    /// 15 kW to 300 kW, or a shaft height of 160 mm to 315 mm, on a rigid support.
    MediumRigid,
    /// The same on a flexible support.
    MediumFlexible,
    /// Above 300 kW, or a shaft height from 315 mm, on a rigid support.
    LargeRigid,
    /// The same on a flexible support.
    LargeFlexible,
}

impl MachineClass {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Small, Self::MediumRigid, Self::MediumFlexible, Self::LargeRigid, Self::LargeFlexible];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Small => "small",
            Self::MediumRigid => "medium-rigid",
            Self::MediumFlexible => "medium-flexible",
            Self::LargeRigid => "large-rigid",
            Self::LargeFlexible => "large-flexible",
        }
    }

    /// Of a name.
    ///
    /// # Errors
    /// A name of no class; all are said.
    pub fn from_name(name: &str) -> core::result::Result<Self, String> {
        let known = || Self::ALL.map(Self::name).join(", ");
        Self::ALL.into_iter().find(|class| class.name() == name).ok_or_else(|| format!("one of {}", known()))
    }

    /// Boundaries of zones A and B, B and C, C and D: velocity's RMS, mm/s.
    pub fn boundaries_mm_s(self) -> [f32; 3] {
        match self {
            Self::Small => [0.71, 1.8, 4.5],
            Self::MediumRigid => [1.4, 2.8, 4.5],
            Self::MediumFlexible | Self::LargeRigid => [2.3, 4.5, 7.1],
            Self::LargeFlexible => [3.5, 7.1, 11.0],
        }
    }

    /// Replaces a configuration's upper limits on the velocity by those of the class, for each of its sensors, and
    /// sets the velocity's band by the slowest turn of either shaft in the law's range.
    ///
    /// # Errors
    /// More alarms than a node holds.
    pub fn apply(self, config: &mut Configuration) -> Result<()> {
        let mut kept = Limit::all(config);
        kept.retain(|limit| !is_replaced(limit));
        let [_, alert, danger] = self.boundaries_mm_s();
        let watched = [Some(Watched::VelocityRms), config.second.as_ref().map(|_| Watched::SecondVelocityRms)];
        for watched in watched.into_iter().flatten() {
            kept.push(Limit { band: limit(watched, danger), mode: AlarmMode::default(), gear: 0 });
            let mode = AlarmMode { severity: Severity::Alert, side: Side::Above };
            kept.push(Limit { band: limit(watched, alert), mode, gear: 0 });
        }
        if kept.len() > MAX_ALARMS {
            let what = format!("asks for {} alarms beside the node's own, which holds {MAX_ALARMS}", kept.len());
            return Err(Error::invalid("--machine-class", what));
        }
        config.alarms = kept.iter().map(|limit| limit.band).collect();
        config.modes = kept.iter().map(|limit| limit.mode).collect();
        config.alarm_gears = kept.iter().map(|limit| limit.gear).collect();
        let gears = config.gears;
        let slower = (f32::from(gears.pinion_teeth) / f32::from(gears.gear_teeth.max(1))).min(1.0);
        let slow = config.law.lowest.0 * slower < SLOW_SHAFT_HZ;
        config.velocity_from = Hertz(if slow { SLOW_FROM_HZ } else { 0.0 });
        Ok(())
    }
}

fn is_replaced(limit: &Limit) -> bool {
    let of_velocity = matches!(limit.band.watched, Watched::VelocityRms | Watched::SecondVelocityRms);
    of_velocity && limit.mode.side == Side::Above
}

fn limit(watched: Watched, mm_s: f32) -> AlarmBand {
    // Divided: the nearest single to the figure of the standard, as a person would write it.
    let raise = mm_s / 1000.0;
    let (from, to) = (Hertz(0.0), Hertz(EVERY_SPEED_HZ));
    AlarmBand { watched, from, to, raise, clear: CLEARING_SHARE * raise, persistence: PERSISTENCE }
}

#[cfg(test)]
mod tests {
    use super::*;
    use meshband::config::SecondSensor;

    #[test]
    fn a_class_replaces_the_limits_of_the_velocity_and_leaves_the_others() {
        let mut config = Configuration::default();
        let rms = AlarmBand { watched: Watched::Rms, ..limit(Watched::Rms, 9000.0) };
        let low = AlarmBand { clear: 2e-4, ..limit(Watched::VelocityRms, 0.1) };
        let below = AlarmMode { side: Side::Below, ..AlarmMode::default() };
        config.alarms = [limit(Watched::VelocityRms, 1.0), rms, low].into_iter().collect();
        config.modes = [AlarmMode::default(), AlarmMode::default(), below].into_iter().collect();
        MachineClass::MediumRigid.apply(&mut config).unwrap();
        let alarms = Limit::all(&config);
        assert_eq!(alarms[0].band, rms);
        assert_eq!(alarms[1], Limit { band: low, mode: below, gear: 0 });
        assert_eq!((alarms[2].band.raise, alarms[2].mode.severity), (4.5e-3, Severity::Danger));
        assert_eq!((alarms[3].band.raise, alarms[3].mode.severity), (2.8e-3, Severity::Alert));
        assert_eq!(alarms.len(), 4);
        // Once more changes nothing: the same limits are replaced by themselves.
        let before = config.clone();
        MachineClass::MediumRigid.apply(&mut config).unwrap();
        assert_eq!(config, before);
    }

    #[test]
    fn every_sensor_is_watched_and_too_many_alarms_are_refused() {
        let mut config = Configuration { second: Some(SecondSensor::default()), ..Configuration::default() };
        MachineClass::Small.apply(&mut config).unwrap();
        assert_eq!(config.alarms.iter().filter(|alarm| alarm.watched == Watched::SecondVelocityRms).count(), 2);
        config.alarms = [limit(Watched::Rms, 9000.0); 5].into_iter().collect();
        config.modes.clear();
        let error = MachineClass::Small.apply(&mut config).unwrap_err();
        assert!(error.to_string().contains("9 alarms"), "{error}");
    }

    #[test]
    fn the_band_begins_by_the_slower_shaft() {
        let mut config = Configuration::default();
        config.gears.pinion_teeth = 19;
        config.gears.gear_teeth = 48;
        for (lowest, from) in [(20.0, 2.0), (26.0, 0.0)] {
            config.law.lowest = Hertz(lowest);
            MachineClass::LargeFlexible.apply(&mut config).unwrap();
            assert_eq!(config.velocity_from.0, from, "{lowest} turns/s of the pinion");
        }
    }

    #[test]
    fn boundaries_rise_and_every_name_is_read_back() {
        for class in MachineClass::ALL {
            assert!(class.boundaries_mm_s().is_sorted());
            assert_eq!(MachineClass::from_name(class.name()), Ok(class));
        }
        assert!(MachineClass::from_name("huge").unwrap_err().contains("medium-rigid"));
    }
}
