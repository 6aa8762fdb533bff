//! A train as signal-based inference sees it: which orders its sound meshes have, which are owned by any of its parts,
//! and the families of its faults.
//!
//! Worked out once per record, up to its highest order, in orders of the train's input. Parts that turn too seldom in
//! the record for their sidebands to be told apart have no family; lines of theirs are owned all the same. Amplitudes
//! of mesh lines are fitted up to a harmonic, beyond it they are only spoken for: a slow stage has hundreds.

use super::shaft::Shaft;
use crate::analysis::explained::Owned;
use crate::train::families::{self, Family, Seat, What};
use crate::train::{Train, lines};
use std::sync::Arc;

/// Harmonics of a pair's mesh, and of a set's with what the planets' passing makes of them, whose amplitudes are
/// fitted.
const FITTED_HARMONICS: f64 = 24.5;
const FITTED_SET_HARMONICS: f64 = 8.5;
/// The same by which a mesh is found to stand.
const DETECTION_HARMONICS: f64 = 5.5;
/// Orders of a shaft that are its own where its low orders are found.
const SHAFT_ORDERS: usize = 10;

/// What follows from a train for one record.
#[derive(Debug, Clone)]
pub struct Gearing {
    /// The train.
    pub train: Train,
    /// Order of the mesh by which speeds and pictures go: the first pair's, else the first.
    pub leading: f64,
    /// Orders of all meshes that are exact.
    pub meshes: Vec<f64>,
    /// Orders of all shafts.
    pub shafts: Vec<f64>,
    /// Lines of all sound meshes, ascending.
    pub sound: Vec<f64>,
    /// The same with those that a set's unequal load shares leave: no family is read there.
    pub uneven: Vec<f64>,
    /// Those of them whose amplitudes are fitted.
    pub fitted: Vec<f64>,
    /// Everything that any part owns.
    pub owned: Arc<Owned>,
    families: Vec<Family>,
    seldom: Vec<String>,
}

impl Gearing {
    /// Of a train in a record that holds orders up to `highest` and whose slowest shaft that turns often enough has
    /// order `slower`.
    pub fn of(train: &Train, highest: f64, slower: f64) -> Self {
        let sound = lines::of_sound_meshes(train, highest);
        let all = families::all(train, highest);
        let (families, seldom): (Vec<Family>, Vec<Family>) =
            all.iter().cloned().partition(|family| family.base > (1.0 - 1e-9) * slower);
        let mut seldom: Vec<String> = seldom.iter().map(|family| families::seat_words(train, family.seat)).collect();
        seldom.dedup();
        Self {
            leading: Self::leading_mesh(train),
            meshes: train.meshes.iter().filter(|mesh| mesh.exact).map(|mesh| mesh.order.value()).collect(),
            shafts: (0..train.shafts.len()).map(|shaft| train.shaft_order(shaft).value()).collect(),
            fitted: fitted(train, &sound),
            owned: Arc::new(Owned::of_train(train, highest)),
            train: train.clone(),
            sound,
            uneven: lines::of_uneven_meshes(train, highest),
            families,
            seldom,
        }
    }

    /// Order of the mesh by which the angle is sharpened.
    pub fn leading_mesh(train: &Train) -> f64 {
        let pair = train.meshes.iter().find(|mesh| mesh.exact && mesh.carrier.is_none());
        pair.or(train.meshes.first()).map_or(1.0, |mesh| mesh.order.value())
    }

    /// Teeth of the first mesh.
    pub fn leading_teeth(train: &Train) -> [u32; 2] {
        let teeth = |g: usize| train.gears.get(g).map_or(2, |gear| gear.teeth);
        [teeth(0), teeth(1)]
    }

    /// What is not looked at, in sentences.
    pub fn notes(&self, turns: f64) -> Vec<String> {
        let mut notes = Vec::new();
        if !self.seldom.is_empty() {
            let list = self.seldom.join("; ");
            notes.push(format!("turns too seldom in {turns:.0} turns of the input to be judged: {list}"));
        }
        if self.train.exact.iter().any(|exact| !exact) {
            notes.push("what lies behind a belt has no exact order and is not judged".into());
        }
        notes
    }

    /// All families.
    pub fn families(&self) -> &[Family] {
        &self.families
    }

    /// One of them.
    ///
    /// # Panics
    /// If there is no such one.
    pub fn family(&self, own: u16) -> &Family {
        &self.families[usize::from(own)]
    }

    /// Rates of everything that turns or passes.
    pub fn rates(&self) -> Vec<f64> {
        let passes = self.train.meshes.iter().filter_map(|mesh| mesh.carrier.as_ref());
        let passes = passes.map(|own| f64::from(own.planets) * own.speed.magnitude().value());
        let mut rates: Vec<f64> = self.families.iter().map(|family| family.base).chain(passes).collect();
        rates.extend(self.shafts.iter().chain(&self.meshes));
        rates.sort_by(f64::total_cmp);
        rates.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
        rates
    }

    /// "pinion of stage 2: runout or pitch error".
    pub fn words(&self, own: u16) -> String {
        self.family(own).words(&self.train)
    }

    /// "pinion of stage 2".
    pub fn seat_words(&self, own: u16) -> String {
        families::seat_words(&self.train, self.family(own).seat)
    }

    /// Whether the gear of a family is a pair's.
    pub fn is_of_pair(&self, own: u16) -> bool {
        match self.family(own).seat {
            Seat::Gear(gear) => {
                self.train.mesh(self.train.gears[gear].stage).is_some_and(|mesh| mesh.carrier.is_none())
            }
            Seat::Shaft(_) => false,
        }
    }

    /// The shaft of a family.
    pub fn shaft_of(&self, own: u16) -> Option<Shaft> {
        let shaft = match self.family(own).seat {
            Seat::Gear(gear) => self.train.gears[gear].shaft,
            Seat::Shaft(shaft) => Some(shaft),
        };
        shaft.and_then(|shaft| Shaft::TRAIN_SHAFTS.get(shaft).copied())
    }

    /// Order of the mesh that a family stands about.
    pub fn mesh_of(&self, own: u16) -> f64 {
        match self.family(own).seat {
            Seat::Gear(gear) => self.train.mesh(self.train.gears[gear].stage).map_or(1.0, |mesh| mesh.order.value()),
            Seat::Shaft(_) => 1.0,
        }
    }

    /// Whether a family, once adopted, explains another.
    pub fn covers(&self, own: u16, other: u16) -> bool {
        let (own, other) = (self.family(own), self.family(other));
        own.seat == other.seat && (own.what == other.what || own.what == What::Local)
    }

    /// Orders that belong to a family's seat once it is adopted.
    pub fn of_seat(&self, own: u16) -> Vec<f64> {
        let found = self.family(own);
        if found.what == What::Shaft {
            return (1..=SHAFT_ORDERS).map(|n| n as f64 * found.base).collect();
        }
        let of_it = |family: &&Family| {
            family.seat == found.seat && (family.what == What::Modulation || found.what == What::Local)
        };
        self.families.iter().filter(of_it).flat_map(|family| family.lines.iter().map(|line| line.order)).collect()
    }

    /// Whether an order stands within `near` of a line of a sound mesh.
    pub fn is_beside(&self, order: f64, near: f64) -> bool {
        let after = self.sound.partition_point(|own| *own <= order - near);
        self.sound.get(after).is_some_and(|own| *own < order + near)
    }

    /// The first lines of each sound mesh.
    pub fn first_lines(&self) -> Vec<Vec<f64>> {
        let of = |mesh: &crate::train::Mesh| {
            let one = Train { meshes: vec![mesh.clone()], ..self.train.clone() };
            let highest = self.sound.last().copied().unwrap_or(0.0);
            lines::of_sound_meshes(&one, highest.min(DETECTION_HARMONICS * mesh.order.value()))
        };
        self.train.meshes.iter().filter(|mesh| mesh.exact).map(of).collect()
    }
}

/// Lines of sound meshes whose amplitudes are fitted.
fn fitted(train: &Train, sound: &[f64]) -> Vec<f64> {
    let highest = sound.last().copied().unwrap_or(0.0);
    let mut orders: Vec<f64> = Vec::new();
    for mesh in train.meshes.iter().filter(|mesh| mesh.exact) {
        let most = if mesh.carrier.is_some() { FITTED_SET_HARMONICS } else { FITTED_HARMONICS };
        let one = Train { meshes: vec![mesh.clone()], ..train.clone() };
        orders.extend(lines::of_sound_meshes(&one, highest.min(most * mesh.order.value())));
    }
    orders.sort_by(f64::total_cmp);
    orders.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
    orders
}
