//! The shafts that families are named after: those of a pair, or those of a train by number.

/// A shaft.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shaft {
    /// Of the pinion.
    Pinion,
    /// Of the gear.
    Gear,
    /// Shafts of a train, the input first.
    #[serde(rename = "shaft-0")]
    Shaft0,
    /// See [`Shaft::Shaft0`].
    #[serde(rename = "shaft-1")]
    Shaft1,
    /// See [`Shaft::Shaft0`].
    #[serde(rename = "shaft-2")]
    Shaft2,
    /// See [`Shaft::Shaft0`].
    #[serde(rename = "shaft-3")]
    Shaft3,
    /// See [`Shaft::Shaft0`].
    #[serde(rename = "shaft-4")]
    Shaft4,
    /// See [`Shaft::Shaft0`].
    #[serde(rename = "shaft-5")]
    Shaft5,
    /// See [`Shaft::Shaft0`].
    #[serde(rename = "shaft-6")]
    Shaft6,
    /// See [`Shaft::Shaft0`].
    #[serde(rename = "shaft-7")]
    Shaft7,
    /// See [`Shaft::Shaft0`].
    #[serde(rename = "shaft-8")]
    Shaft8,
}

impl Shaft {
    /// Both.
    pub const PAIR_SHAFTS: [Shaft; 2] = [Shaft::Pinion, Shaft::Gear];
    /// Those of a train.
    pub const TRAIN_SHAFTS: [Shaft; 9] = [
        Shaft::Shaft0,
        Shaft::Shaft1,
        Shaft::Shaft2,
        Shaft::Shaft3,
        Shaft::Shaft4,
        Shaft::Shaft5,
        Shaft::Shaft6,
        Shaft::Shaft7,
        Shaft::Shaft8,
    ];

    /// "pinion", "gear", "shaft 2".
    pub fn word(self) -> &'static str {
        const WORDS: [&str; 11] = [
            "pinion", "gear", "shaft 0", "shaft 1", "shaft 2", "shaft 3", "shaft 4", "shaft 5", "shaft 6", "shaft 7",
            "shaft 8",
        ];
        WORDS[self as usize]
    }

    /// "the pinion's shaft", "shaft 2".
    pub fn phrase(self) -> String {
        if Self::PAIR_SHAFTS.contains(&self) { format!("the {}'s shaft", self.word()) } else { self.word().into() }
    }
}
