//! What one does about a finding: the part to look at, the next measurement, and whether it can wait.
//!
//! Words of practice, not of the record: how far a fault has gone is not known from one measurement, so nothing here
//! says that a machine may run on. By the library's names; a finding with two names gets the advice of the first that
//! is known.

/// What to look at, and when.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Advice {
    /// Part to look at, and what to compare.
    pub look: &'static str,
    /// When.
    pub when: &'static str,
}

/// Part of a name, and the advice that goes with it; the first that fits counts.
const BY_NAME: [(&str, Advice); 13] = [
    (
        "bearing",
        Advice {
            look: "compare the order with the passage orders of the bearings on this shaft (BPFO, BPFI, ball spin), \
             then inspect that bearing",
            when: "measure again within a week; if its lines have risen by 6 dB, plan the stop",
        },
    ),
    (
        "tooth-crack",
        Advice {
            look: "inspect the teeth of this gear, by eye and with dye penetrant",
            when: "soon: a cracked tooth gives little warning; until then measure daily",
        },
    ),
    (
        "wear",
        Advice {
            look: "inspect the flanks and the oil; compare with a record of the new machine",
            when: "at the next planned stop; measure again in a month",
        },
    ),
    (
        "pitch-error",
        Advice {
            look: "look for runout and pitch errors of this gear, and at its seat on the shaft; one more torque \
             tells them apart",
            when: "it can wait for the next planned stop unless it grows: measure again in a month",
        },
    ),
    (
        "eccentricity",
        Advice {
            look: "check the runout of this gear and its seat on the shaft",
            when: "it can wait for the next planned stop unless it grows: measure again in a month",
        },
    ),
    (
        "profile-error",
        Advice {
            look: "compare with the gear's inspection sheet, and with a record of the new machine",
            when: "it can wait if it was there from the beginning",
        },
    ),
    (
        "imbalance",
        Advice {
            look: "check balance, coupling and foundation of this shaft; a second speed tells imbalance (rising \
             with its square) from the rest",
            when: "at the next planned stop, or sooner if the velocity is beyond the machine's zone",
        },
    ),
    (
        "misalignment",
        Advice { look: "check the alignment of the coupling, warm and cold", when: "at the next planned stop" },
    ),
    (
        "ghost",
        Advice {
            look: "compare with a record of the new machine: a ghost of the gear cutting is there from the beginning",
            when: "it can wait",
        },
    ),
    (
        "mains",
        Advice { look: "check earthing and shielding of the sensor's cable", when: "before the next measurement" },
    ),
    (
        "clipping",
        Advice {
            look: "lower the gain or take a less sensitive sensor, and measure again",
            when: "now: what was clipped hides the rest",
        },
    ),
    (
        "fluctuation",
        Advice {
            look: "hold load and speed steadier, or record the torque beside the vibration",
            when: "with the next measurement",
        },
    ),
    (
        "resonance",
        Advice {
            look: "measure at one more speed, or with the sensor at another place",
            when: "with the next measurement",
        },
    ),
];

/// Where nothing more is known than an order or a frequency.
const OTHERWISE: Advice = Advice {
    look: "find what turns at this order or hums at this frequency: bearings, cages, other stages, fans, the drive",
    when: "measure again at another speed: what keeps its order turns with the shaft, what keeps its frequency does \
     not",
};

/// The advice for a finding by its library name or names.
pub fn for_name(name: &str) -> Advice {
    BY_NAME.iter().find(|(part, _)| name.contains(part)).map_or(OTHERWISE, |(_, advice)| *advice)
}

#[cfg(test)]
mod tests {
    use super::{OTHERWISE, for_name};

    #[test]
    fn ref_every_finding_has_an_advice_and_a_bearing_its_own() {
        assert!(for_name("bearing-impacts").look.contains("BPFO"));
        assert!(for_name("gear-pitch-error or gear-profile-error").look.contains("pitch errors"));
        assert_eq!(for_name("unexplained order 3.5800"), OTHERWISE);
    }
}
