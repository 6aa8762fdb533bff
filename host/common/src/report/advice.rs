//! What one does about a finding: the part to look at, the next measurement, and whether it can wait.
//!
//! Words of practice, not of the record: how far a fault has gone is not known from one measurement, so nothing here
//! says that a machine may run on. By the library's names; a finding with several names gets the advice of the one that
//! comes first in it.

/// What to look at, and when.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Advice {
    /// Part to look at, and what to compare.
    pub look: &'static str,
    /// When.
    pub when: &'static str,
    /// How soon, against other findings: the larger, the sooner.
    pub urgency: u8,
}

/// Part of a name, and the advice that goes with it; the first that fits counts.
const NAME_ADVICE: [(&str, Advice); 15] = [
    (
        "bearing",
        Advice {
            look: "compare the order with the passage orders of the bearings on this shaft (BPFO, BPFI, ball spin), \
             then inspect that bearing",
            when: "measure again within a week; if its lines have risen by 6 dB, plan the stop",
            urgency: 4,
        },
    ),
    (
        "tooth-crack",
        Advice {
            look: "inspect the teeth of this gear, by eye and with dye penetrant",
            when: "soon: a cracked tooth gives little warning; until then measure daily",
            urgency: 5,
        },
    ),
    (
        "local tooth fault",
        Advice {
            look: "inspect the teeth of this gear for a crack, a spall or a chip",
            when: "soon: a cracked tooth gives little warning; until then measure daily",
            urgency: 5,
        },
    ),
    (
        "wear",
        Advice {
            look: "inspect the flanks and the oil; compare with a record of the new machine",
            when: "at the next planned stop; measure again in a month",
            urgency: 2,
        },
    ),
    (
        "pitch-error",
        Advice {
            look: "look for runout, pitch and profile errors of this gear, and at its seat on the shaft; a record at \
             another torque helps to tell them apart",
            when: "it can wait for the next planned stop unless it grows: measure again in a month",
            urgency: 2,
        },
    ),
    (
        "eccentricity",
        Advice {
            look: "check the runout of this gear and its seat on the shaft",
            when: "it can wait for the next planned stop unless it grows: measure again in a month",
            urgency: 2,
        },
    ),
    (
        "pitch error",
        Advice {
            look: "check runout and pitch of this gear, and its seat on the shaft",
            when: "it can wait for the next planned stop unless it grows: measure again in a month",
            urgency: 2,
        },
    ),
    (
        "profile-error",
        Advice {
            look: "compare with the gear's inspection sheet, and with a record of the new machine",
            when: "it can wait if it was there from the beginning",
            urgency: 1,
        },
    ),
    (
        "imbalance",
        Advice {
            look: "check balance, coupling and foundation of this shaft; a second speed tells imbalance (rising \
             with its square) from the rest",
            when: "at the next planned stop, or sooner if the velocity is beyond the machine's zone",
            urgency: 3,
        },
    ),
    (
        "misalignment",
        Advice {
            look: "check the alignment of the coupling, warm and cold",
            when: "at the next planned stop",
            urgency: 3,
        },
    ),
    (
        "ghost",
        Advice {
            look: "compare with a record of the new machine: a ghost of the gear cutting is there from the beginning",
            when: "it can wait",
            urgency: 0,
        },
    ),
    (
        "mains",
        Advice {
            look: "check earthing and shielding of the sensor's cable",
            when: "before the next measurement",
            urgency: 1,
        },
    ),
    (
        "clipping",
        Advice {
            look: "lower the gain or take a less sensitive sensor, and measure again",
            when: "now: what was clipped hides the rest",
            urgency: 6,
        },
    ),
    (
        "fluctuation",
        Advice {
            look: "hold load and speed steadier, or record the torque beside the vibration",
            when: "with the next measurement",
            urgency: 1,
        },
    ),
    (
        "resonance",
        Advice {
            look: "measure at one more speed, or with the sensor at another place",
            when: "with the next measurement",
            urgency: 1,
        },
    ),
];

/// Where nothing more is known than an order or a frequency.
const DEFAULT_ADVICE: Advice = Advice {
    look: "find what turns at this order or hums at this frequency: bearings, cages, other stages, fans, the drive",
    when: "measure again at another speed: what keeps its order turns with the shaft, what keeps its frequency does \
     not",
    urgency: 3,
};

/// Where a part of a declared bearing has a name.
const BEARING_PART: Advice = Advice {
    look: "inspect this bearing: its order is the one declared",
    when: "measure again within a week; if its lines have risen by 6 dB, plan the stop",
    urgency: 4,
};

/// The advice for a finding by its library name or names.
pub fn for_name(name: &str) -> Advice {
    if name.contains(" of bearing ") {
        return BEARING_PART;
    }
    let known = NAME_ADVICE.iter().filter_map(|(part, advice)| Some((name.find(part)?, *advice)));
    known.min_by_key(|(at, _)| *at).map_or(DEFAULT_ADVICE, |(_, advice)| advice)
}

#[cfg(test)]
mod tests {
    use super::{BEARING_PART, DEFAULT_ADVICE, for_name};

    #[test]
    fn ref_every_finding_has_an_advice_and_a_bearing_its_own() {
        assert!(for_name("bearing-impacts").look.contains("BPFO"));
        assert_eq!(for_name("bearing-impacts, outer ring of bearing drive end"), BEARING_PART);
        assert!(for_name("gear-pitch-error or gear-profile-error").look.contains("profile errors"));
        let several = for_name("pinion-imbalance or coupling-misalignment or pinion-eccentricity");
        assert!(several.look.contains("balance"), "the first name leads");
        assert!(for_name("bearing-impacts").urgency > several.urgency);
        assert_eq!(for_name("unexplained order 3.5800"), DEFAULT_ADVICE);
        assert!(for_name("pinion of stage 2: runout or pitch error").look.contains("runout"));
        assert!(for_name("gear of stage 1: local tooth fault").look.contains("teeth"));
    }
}
