//! Rolling bearings: what the diagnosis says of labelled records, undeclared and declared, and what a textbook peer
//! says of the same.
//!
//! *Right*: an effect stands within 2 % of the passage of the damaged part, or of twice it. *Ring*: that part is
//! named or alone in question. *Wrong*: another part is named, another number of elements read, or any bearing named
//! on a sound one.

pub mod generated;
pub mod measured;
pub mod peer;

use crate::machine::bearing::{Bearing, BearingOrders};
use crate::record::Record;
use crate::signal_based::outcome::{Effect, Outcome};
use crate::signal_based::preflight::Preflight;
use crate::{Result, signal_based};

/// Share of a passage within which an effect stands at it.
const PASSAGE_TOLERANCE_SHARE: f64 = 0.02;
/// Words of the parts.
const PARTS: [&str; 4] = ["outer ring", "inner ring", "rolling element", "cage"];

/// What is damaged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Damage {
    /// Nothing.
    Sound,
    /// Ring that stands.
    Outer,
    /// Ring that turns.
    Inner,
    /// Element.
    Element,
}

impl Damage {
    /// Its word in a name; none of a sound bearing.
    pub fn word(self) -> Option<&'static str> {
        match self {
            Damage::Sound => None,
            Damage::Outer => Some(PARTS[0]),
            Damage::Inner => Some(PARTS[1]),
            Damage::Element => Some(PARTS[2]),
        }
    }

    /// Order of its passage.
    pub fn order(self, orders: &BearingOrders) -> Option<f64> {
        match self {
            Damage::Sound => None,
            Damage::Outer => Some(orders.outer),
            Damage::Inner => Some(orders.inner),
            Damage::Element => Some(2.0 * orders.element),
        }
    }
}

/// A labelled record.
pub struct Labelled {
    /// Name.
    pub name: String,
    /// The record, without a declared bearing.
    pub record: Record,
    /// The bearing.
    pub bearing: Bearing,
    /// The label.
    pub damage: Damage,
}

/// What was said of a record.
#[derive(Debug, Clone, Default)]
pub struct Score {
    /// The passage was found.
    pub right: bool,
    /// The part was named or alone in question.
    pub ring: bool,
    /// A wrong name was given.
    pub wrong: bool,
    /// In words.
    pub said: String,
}

/// Looks at a record with or without its bearing declared.
///
/// # Errors
/// A record that the loop refuses.
pub fn look(labelled: &Labelled, declared: bool) -> Result<Score> {
    let mut record = labelled.record.clone();
    if declared {
        record.declaration.declare_bearings(std::slice::from_ref(&labelled.bearing))?;
    }
    let outcome = signal_based::run(&record, &Preflight::of(&record))?;
    Ok(score(&outcome, labelled.damage, &labelled.bearing.orders()?))
}

/// Scores an answer.
pub fn score(outcome: &Outcome, damage: Damage, orders: &BearingOrders) -> Score {
    let is_at =
        |order: f64, own: f64| [1.0, 2.0].iter().any(|m| (order / (m * own) - 1.0).abs() < PASSAGE_TOLERANCE_SHARE);
    let found = |own: f64| outcome.effects.iter().filter_map(|e| e.order_of_pinion).any(|order| is_at(order, own));
    let parts_of = |name: &str| PARTS.into_iter().filter(|part| name.contains(part)).collect::<Vec<_>>();
    let named = || outcome.effects.iter().filter(|e| e.verdict == "named");
    let wrong_part = named().flat_map(|e| parts_of(&e.name)).any(|part| Some(part) != damage.word());
    let wrong_elements =
        outcome.bearing.as_ref().is_some_and(|own| f64::from(own.elements) != orders.elements().round());
    let any = named().any(|e| e.name.contains("bearing") || e.name.contains("impacts"));
    let said: Vec<String> = outcome.effects.iter().filter_map(|e| Some(words(e, e.order_of_pinion?))).collect();
    Score {
        right: damage.order(orders).is_some_and(found),
        ring: damage.word().is_some_and(|word| outcome.effects.iter().any(|e| parts_of(&e.name) == [word])),
        wrong: wrong_part || wrong_elements || damage == Damage::Sound && any,
        said: said.join("; "),
    }
}

/// An effect's name, order, and of impacts nats and depth.
fn words(effect: &Effect, order: f64) -> String {
    let name = effect.name.replace("bearing-impacts, ", "");
    let name = if effect.verdict == "generic" { "unexplained".into() } else { name };
    match effect.parameters.get("depth") {
        Some(depth) => format!("{name} {order:.4} ({:.0} nats, depth {:.2})", effect.evidence.ln_bayes, depth.value),
        None => format!("{name} {order:.4}"),
    }
}
