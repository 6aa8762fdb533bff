//! Names of the link's vocabulary as people read them.

use meshband::alarm::Watched;
use meshband::events::{Event, EventKind};
use std::fmt::Debug;

/// A variant's name in words: `TachLocked` becomes "tach locked"; what it carries is left out.
pub fn words(variant: &impl Debug) -> String {
    let name = format!("{variant:?}");
    let name = name.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default();
    let mut out = String::new();
    for c in name.chars() {
        if c.is_uppercase() && !out.is_empty() {
            out.push(' ');
        }
        out.extend(c.to_lowercase());
    }
    out
}

/// What an alarm watches, with its unit.
pub fn watched(watched: Watched) -> &'static str {
    match watched {
        Watched::Rms => "RMS, m/s2",
        Watched::Peak => "peak, m/s2",
        Watched::Crest => "crest factor",
        Watched::Kurtosis => "kurtosis",
        Watched::Fm0 => "FM0",
        Watched::Fm4 => "FM4",
        Watched::SidebandEnergyRatio => "sideband energy ratio",
        Watched::MeshAmplitude => "first mesh harmonic, m/s2",
        Watched::BandwidthRatio => "measured over law bandwidth",
        Watched::VelocityRms => "velocity RMS, m/s",
        Watched::OncePerTurn => "once per turn, m/s2",
        Watched::Departure => "departure from the expected levels, standard uncertainties",
        Watched::SecondRms => "RMS of the second sensor, m/s2",
        Watched::SecondPeak => "peak of the second sensor, m/s2",
        Watched::SecondCrest => "crest factor of the second sensor",
        Watched::SecondKurtosis => "kurtosis of the second sensor",
        Watched::SecondVelocityRms => "velocity RMS of the second sensor, m/s",
    }
}

/// An event with its detail: alarms by their number from 1.
pub fn event(event: &Event) -> String {
    let name = words(&event.kind);
    match event.kind {
        EventKind::AlarmRaised | EventKind::AlarmCleared => format!("{name}: number {}", u64::from(event.detail) + 1),
        _ => format!("{name} {}", event.detail),
    }
}

/// A stretch of time: "0.3 s", "12 s", "3 min".
pub fn seconds(age_s: f64) -> String {
    match age_s {
        age if age < 10.0 => format!("{:.1} s", age.max(0.0)),
        age if age < 120.0 => format!("{age:.0} s"),
        age => format!("{:.0} min", age / 60.0),
    }
}

/// What an alarm watches and its unit; the unit is empty for a plain number.
pub fn name_and_unit(of: Watched) -> (&'static str, &'static str) {
    watched(of).rsplit_once(", ").unwrap_or((watched(of), ""))
}

#[cfg(test)]
mod tests {
    use super::words;
    use meshband::node::State;

    #[test]
    fn ref_variants_are_words() {
        assert_eq!(words(&State::WaitingForTach), "waiting for tach");
        assert_eq!(words(&Some(3)), "some", "what a variant carries is left out");
    }
}
