//! Names of the link's vocabulary as people read them.

use meshband::alarm::Watched;
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
