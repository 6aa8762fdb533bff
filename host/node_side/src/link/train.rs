//! What a node is told of a gear train: the gears it follows, their exact turns, and what it cannot be told.
//!
//! The first stage's first gear stands where a pair's pinion does, and its rate is the node's speed; the others follow
//! it in turns. Of a planetary set the ring comes first, whose turns against the carrier are the carrier's where the
//! ring stands still. A node follows six gears: one of each stage, then the rest in their order. Behind a belt nothing
//! is exact, so nothing there is followed.

use crate::{Error, Result};
use meshband::config::{Configuration, GearPair, MAX_FURTHER_STAGES, MAX_TRAIN_GEARS, TrainGear};
use meshband::tach::turn_marks::Ratio;
use meshband_train::{Fraction, Gear, Role, Train};

/// Fewest teeth of a gear that a node follows.
const MIN_TEETH: u32 = 12;

/// The gears that a node follows.
#[derive(Clone, Debug, PartialEq)]
pub struct FollowedGears {
    /// Teeth of the gear in the pinion's place, and of its mate.
    pub pair: GearPair,
    /// Turns of that gear per turn of the train's input.
    pub pair_rate: Fraction,
    /// The others, stages ascending.
    pub further: Vec<TrainGear>,
    /// Names of all, the pinion's first.
    pub names: Vec<String>,
    /// Names of gears that are not followed, with the reason.
    pub left_out: Vec<String>,
}

/// A gear with its mate's teeth.
struct Candidate<'t> {
    gear: &'t Gear,
    mate_teeth: u32,
    /// Place within its stage.
    place: usize,
}

impl FollowedGears {
    /// Of a train.
    ///
    /// # Errors
    /// A train whose first stage has no gear of twelve teeth, or ratios beyond 128 bits.
    pub fn of(train: &Train) -> Result<Self> {
        let mut left_out = Vec::new();
        let mut all = Vec::new();
        for mesh in &train.meshes {
            let gears: Vec<&Gear> = mesh.gears.iter().map(|index| &train.gears[*index]).collect();
            for candidate in candidates(&gears) {
                let words = candidate.gear.words();
                match refusal(&candidate, mesh.exact) {
                    Some(reason) => left_out.push(format!("{words} ({reason})")),
                    None => all.push(candidate),
                }
            }
        }
        let base = all.iter().position(|candidate| candidate.gear.stage == 0);
        let base = all.remove(base.ok_or_else(|| {
            Error::invalid("[[stage]] 1", "has no gear with exact turns and 12 to 800 teeth for a node to follow")
        })?);
        // One of each stage before any second one.
        all.sort_by_key(|candidate| (candidate.place > 0 || candidate.gear.stage == 0, candidate.gear.stage));
        let beyond = all.split_off(all.len().min(MAX_TRAIN_GEARS));
        left_out.extend(beyond.iter().map(|of| format!("{} (a node follows six gears)", of.gear.words())));
        all.sort_by_key(|candidate| (candidate.gear.stage, candidate.place));
        let mut followed = Self {
            pair: GearPair { pinion_teeth: base.gear.teeth as u16, gear_teeth: base.mate_teeth as u16 },
            pair_rate: base.gear.rate.magnitude(),
            further: Vec::new(),
            names: vec![base.gear.words()],
            left_out,
        };
        for candidate in &all {
            let ratio = candidate.gear.rate.magnitude().over(followed.pair_rate)?;
            followed.push(candidate, ratio);
        }
        Ok(followed)
    }

    fn push(&mut self, candidate: &Candidate<'_>, ratio: Fraction) {
        let name = candidate.gear.words();
        match (u32::try_from(ratio.numerator()), u32::try_from(ratio.denominator())) {
            (Ok(turns), Ok(pinion_turns)) => {
                let stage = candidate.gear.stage as u8 + 1;
                let (teeth, mate_teeth) = (candidate.gear.teeth as u16, candidate.mate_teeth as u16);
                self.further.push(TrainGear { stage, teeth, mate_teeth, turns, pinion_turns });
                self.names.push(name);
            }
            _ => self.left_out.push(format!("{name} (its ratio has too many digits)")),
        }
    }

    /// Turns of the gear in the pinion's place per turn of a tach's shaft.
    ///
    /// # Errors
    /// A ratio that a node's single-precision number does not stand for exactly, or beyond 128 bits.
    pub fn per_tach(&self, train: &Train, shaft: usize) -> Result<f32> {
        let ratio = self.pair_rate.over(train.shaft_order(shaft))?;
        let (numerator, denominator) = (ratio.numerator(), ratio.denominator());
        let number = ratio.value() as f32;
        let read = Ratio::of(number);
        if i128::from(read.pinion) != numerator || i128::from(read.tach) != denominator {
            let what = format!(
                "the {} makes {numerator}/{denominator} turns per turn of shaft {shaft}: more digits than a node's \
                 ratio has, and the marks would drift; take a tach on another shaft",
                self.names[0]
            );
            return Err(Error::invalid("[tach] shaft", what));
        }
        Ok(number)
    }

    /// Writes the gears into a configuration, and the first declared tach where there is one.
    ///
    /// # Errors
    /// As [`FollowedGears::per_tach`]; pulses beyond a node's range.
    pub fn apply(&self, train: &Train, config: &mut Configuration) -> Result<()> {
        config.gears = self.pair;
        config.train = self.further.iter().copied().collect();
        if let Some(tach) = train.declaration.tachs.first() {
            let pulses = u16::try_from(tach.pulses_per_turn);
            config.tach.pulses_per_turn = pulses.map_err(|_| {
                Error::invalid("[tach] pulses_per_turn", format!("{} is beyond a node", tach.pulses_per_turn))
            })?;
            config.tach.pinion_per_tach = self.per_tach(train, tach.shaft)?;
        }
        Ok(())
    }
}

/// The gears of a stage with their mates, those first that speak for the stage: the driver of a pair, the ring of a
/// set.
fn candidates<'t>(gears: &[&'t Gear]) -> Vec<Candidate<'t>> {
    let teeth_of = |role: Role| gears.iter().find(|gear| gear.role == role).map_or(0, |gear| gear.teeth);
    let mate = |index: usize, gear: &Gear| match gear.role {
        Role::Ring => teeth_of(Role::Sun),
        Role::Sun | Role::Planet => teeth_of(Role::Ring),
        Role::Pinion => gears.get(index + 1).map_or(0, |next| next.teeth),
        Role::Gear | Role::Idler(_) => gears[index.saturating_sub(1)].teeth,
    };
    let mut all: Vec<Candidate<'t>> = gears
        .iter()
        .enumerate()
        .map(|(index, gear)| Candidate { gear, mate_teeth: mate(index, gear), place: 0 })
        .collect();
    all.sort_by_key(|candidate| candidate.gear.role != Role::Ring);
    all.iter_mut().enumerate().for_each(|(place, candidate)| candidate.place = place);
    all
}

/// Why a gear cannot be followed.
fn refusal(candidate: &Candidate<'_>, exact: bool) -> Option<&'static str> {
    let gear = candidate.gear;
    let held = |teeth: u32, most: u32| teeth <= most;
    if !exact {
        Some("behind a belt no turns are exact")
    } else if gear.stage > MAX_FURTHER_STAGES {
        Some("a node knows four stages")
    } else if gear.teeth < MIN_TEETH {
        Some("fewer than 12 teeth; its mate shows its mesh and sidebands")
    } else if !(held(gear.teeth, 800) && held(candidate.mate_teeth, 1000)) {
        Some("more than 800 teeth, or its mate more than 1000")
    } else if gear.rate == Fraction::ZERO {
        Some("it does not turn")
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use meshband::board::Timing;
    use meshband_train::Declaration;

    fn train(text: &str) -> Train {
        Train::of(Declaration::parse(text, "train.toml").expect("a declaration")).expect("a train")
    }

    fn pair(teeth: [u32; 2]) -> String {
        format!("[[stage]]\nkind = \"pair\"\nteeth = [{}, {}]\n", teeth[0], teeth[1])
    }

    const SET: &str = "[[stage]]\nkind = \"planetary\"\nsun = 24\nplanet = 30\nring = 84\nplanets = 4\nfixed \
        = \"ring\"\ninput = \"sun\"\n";

    #[test]
    fn theory_three_pairs_are_followed_whole_and_of_four_stages_one_gear_of_each() {
        let three = train(&(pair([21, 83]) + &pair([19, 77]) + &pair([18, 69])));
        let followed = FollowedGears::of(&three).expect("gears");
        assert_eq!((followed.further.len(), followed.left_out.len()), (5, 0));
        let last = followed.further[4];
        assert_eq!((last.stage, last.teeth, last.mate_teeth), (3, 69, 18));
        let exact = 21.0 * 19.0 * 18.0 / (83.0 * 77.0 * 69.0);
        assert!((f64::from(last.turns) / f64::from(last.pinion_turns) / exact - 1.0).abs() < 1e-12);
        let four = train(&(pair([29, 74]) + SET + &pair([18, 83]) + &pair([17, 91])));
        let followed = FollowedGears::of(&four).expect("gears");
        let stages: Vec<u8> = followed.further.iter().map(|gear| gear.stage).collect();
        assert_eq!(stages, [1, 2, 2, 3, 4], "{:?}", followed.names);
        assert!(followed.names.contains(&"ring of stage 2".to_owned()));
        assert_eq!(followed.left_out.len(), 3, "{:?}", followed.left_out);
        let mut config = Configuration::default();
        followed.apply(&four, &mut config).expect("applies");
        assert_eq!(config.validate(Timing::STM32F405), Ok(()));
    }

    #[test]
    fn theory_a_planetary_first_stage_is_told_by_its_carrier() {
        let set = train(&format!("{SET}[tach]\nshaft = 0\npulses_per_turn = 60\n"));
        let followed = FollowedGears::of(&set).expect("gears");
        assert_eq!(followed.pair, GearPair { pinion_teeth: 84, gear_teeth: 24 });
        let mut config = Configuration::default();
        followed.apply(&set, &mut config).expect("applies");
        assert_eq!(config.tach.pulses_per_turn, 60);
        assert!((config.tach.pinion_per_tach - 2.0 / 9.0).abs() < 1e-7);
    }

    #[test]
    fn fault_what_cannot_be_followed_is_said() {
        let belt = "[[stage]]\nkind = \"belt\"\npulleys_mm = [100, 250]\n";
        let behind = train(&(pair([20, 40]) + belt + &pair([20, 50])));
        let followed = FollowedGears::of(&behind).expect("gears");
        assert!(followed.left_out.iter().all(|name| name.contains("belt")), "{:?}", followed.left_out);
        assert_eq!(followed.left_out.len(), 2);
        let first = train(&(belt.to_owned() + &pair([20, 50])));
        assert!(FollowedGears::of(&first).is_err());
        // Two stages of large primes between tach and pinion: no single-precision number stands for it.
        let far = train(&(pair([397, 991]) + &pair([389, 983]) + "[tach]\nshaft = 2\npulses_per_turn = 1\n"));
        let error = FollowedGears::of(&far).expect("gears").apply(&far, &mut Configuration::default());
        assert!(error.expect_err("refused").to_string().contains("another shaft"));
    }
}
