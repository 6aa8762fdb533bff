//! Who owns which order: what a sound train shows, in exact fractions of the input's turns.
//!
//! Orders of shafts, mesh harmonics, hunting periods, passage of planets, what the motor, a coupling and blades bring
//! along. A line's owner is a part of the train; lines of a fault are in [`super::families`].

use super::fraction::Fraction;
use super::kinematics::{Carrier, Mesh, Role, Train};
use super::phasing;
use crate::Result;
use serde::Serialize;

/// Harmonics of a shaft, and of a mesh, in the table.
const SHAFT_HARMONICS: i64 = 3;
const MESH_HARMONICS: i64 = 3;
/// Carrier orders on each side of a mesh harmonic within which a sound set's lines are owned, times the number of
/// planets.
const PASSES: i64 = 3;

/// One line that a sound train may have.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Line {
    /// Order, exact.
    pub order: Fraction,
    /// Nearest double.
    pub value: f64,
    /// What it is: "mesh of stage 1, harmonic 2".
    pub what: String,
    /// Part of the train that it belongs to.
    pub owner: String,
    /// Whether no belt lies before it.
    pub exact: bool,
}

/// Carrier orders on each side of a mesh harmonic within which a sound set owns what its phasing lets stand.
pub fn passes(carrier: &Carrier) -> i64 {
    PASSES * i64::from(carrier.planets)
}

fn line(order: Fraction, what: String, owner: &str, exact: bool) -> Line {
    Line { value: order.value(), order, what, owner: owner.to_owned(), exact }
}

/// Every line of the table, owner by owner.
///
/// # Errors
/// Orders beyond 128 bits.
pub fn table(train: &Train) -> Result<Vec<Line>> {
    let mut lines = Vec::new();
    for shaft in 0..train.shafts.len() {
        let (order, owner) = (train.shaft_order(shaft), train.shaft_words(shaft));
        for n in 1..=SHAFT_HARMONICS {
            lines.push(line(order.multiple(n)?, format!("{n} x shaft {shaft}"), &owner, train.exact[shaft]));
        }
    }
    for mesh in &train.meshes {
        of_mesh(train, mesh, &mut lines)?;
    }
    beside(train, &mut lines)?;
    Ok(lines)
}

fn of_mesh(train: &Train, mesh: &Mesh, lines: &mut Vec<Line>) -> Result<()> {
    let stage = mesh.stage + 1;
    let owner = format!("mesh of stage {stage}");
    for k in 1..=MESH_HARMONICS {
        lines.push(line(mesh.order.multiple(k)?, format!("{k} x mesh of stage {stage}"), &owner, mesh.exact));
    }
    for (turns, order, words) in hunting(train, mesh)? {
        let what = format!("hunting tooth of {words}, once in {turns} turns");
        lines.push(line(order, what, &owner, mesh.exact));
    }
    let Some(carrier) = &mesh.carrier else { return Ok(()) };
    for (order, what) in passages(train, mesh, carrier)? {
        lines.push(line(order, format!("{what} of stage {stage}"), &owner, mesh.exact));
    }
    Ok(())
}

/// Turns of the first gear after which the same teeth meet, the order of that, and the two gears, for each pair in
/// mesh.
///
/// # Errors
/// Orders beyond 128 bits.
pub fn hunting(train: &Train, mesh: &Mesh) -> Result<Vec<(u32, Fraction, String)>> {
    let gears: Vec<_> = mesh.gears.iter().map(|g| &train.gears[*g]).collect();
    let pair = |w: &[&super::kinematics::Gear]| -> Result<(u32, Fraction, String)> {
        let turns = w[1].teeth / common(w[0].teeth, w[1].teeth);
        let order = w[0].rate.magnitude().over(Fraction::whole(turns.into()))?;
        Ok((turns, order, format!("{} and {}", w[0].role.word(), w[1].words())))
    };
    gears.windows(2).map(pair).collect()
}

/// Greatest common divisor.
pub fn common(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { common(b, a % b) }
}

/// Orders at which members of a set pass each other, with words.
///
/// # Errors
/// Orders beyond 128 bits.
pub fn passages(train: &Train, mesh: &Mesh, carrier: &Carrier) -> Result<Vec<(Fraction, &'static str)>> {
    let rate = |role: Role| {
        let own = mesh.gears.iter().map(|g| &train.gears[*g]).find(|gear| gear.role == role);
        own.map_or(Fraction::ZERO, |gear| gear.rate.magnitude())
    };
    let planets = i64::from(carrier.planets);
    let all = [
        (carrier.speed.magnitude(), "carrier"),
        (carrier.speed.magnitude().multiple(planets)?, "planet pass"),
        (rate(Role::Planet), "planet against its carrier"),
        (rate(Role::Planet).multiple(2)?, "passage of one tooth of a planet (sun and ring)"),
        (rate(Role::Sun).multiple(planets)?, "passage of one tooth of the sun (all planets)"),
        (rate(Role::Ring).multiple(planets)?, "passage of one tooth of the ring (all planets)"),
    ];
    Ok(all.into_iter().filter(|(order, _)| *order != Fraction::ZERO).collect())
}

/// Orders of what a motor, couplings, blades and belts bring along.
pub fn of_parts(train: &Train) -> Vec<f64> {
    let mut lines = Vec::new();
    // Orders beyond 128 bits are refused where the table is printed.
    let _ = beside(train, &mut lines);
    lines.into_iter().map(|line| line.value).collect()
}

/// Lines of motor, couplings, blades, belts.
fn beside(train: &Train, lines: &mut Vec<Line>) -> Result<()> {
    let declaration = &train.declaration;
    if let Some(motor) = &declaration.motor {
        let order = train.shaft_order(motor.shaft);
        for (count, what) in [(motor.rotor_bars, "rotor bars"), (motor.pole_pairs, "pole pairs")] {
            if let Some(count) = count {
                lines.push(line(
                    order.multiple(count.into())?,
                    format!("{count} {what}"),
                    "motor",
                    train.exact[motor.shaft],
                ));
            }
        }
    }
    for coupling in &declaration.couplings {
        if let Some(count) = coupling.elements {
            let order = train.shaft_order(coupling.shaft).multiple(count.into())?;
            let owner = format!("coupling on shaft {}", coupling.shaft);
            lines.push(line(order, format!("{count} elements"), &owner, train.exact[coupling.shaft]));
        }
    }
    if let Some(driven) = &declaration.driven
        && let Some(blades) = driven.blades
    {
        let shaft = driven.shaft.unwrap_or(train.shafts.len() - 1);
        let order = train.shaft_order(shaft).multiple(blades.into())?;
        lines.push(line(order, format!("{blades} blades"), "driven part", train.exact[shaft]));
    }
    for (stage, declared) in declaration.stages.iter().enumerate() {
        let super::declaration::Stage::Belt { pulleys_mm, length_mm: Some(length), .. } = declared else { continue };
        let shaft = declared.driven_from(stage);
        let per_turn = std::f64::consts::PI * pulleys_mm[0] / length;
        let order = train.shaft_order(shaft).times(Fraction::new((1e6 * per_turn).round() as i64, 1_000_000))?;
        lines.push(line(order, "1 x belt".into(), &format!("belt of stage {}", stage + 1), false));
    }
    Ok(())
}

/// Orders that a sound train has about its meshes, up to `highest`: harmonics of every mesh; of a set, what the
/// planets' passing makes of them.
pub fn of_sound_meshes(train: &Train, highest: f64) -> Vec<f64> {
    about_meshes(train, highest, |carrier, k, n| n == 0 || phasing::stands(carrier, k, n))
}

/// The same with every carrier order as far as planets passing are owned: no set shares its load evenly, and then the
/// lines stand, too, that equal planets cancel.
pub fn of_uneven_meshes(train: &Train, highest: f64) -> Vec<f64> {
    about_meshes(train, highest, |_, _, _| true)
}

fn about_meshes(train: &Train, highest: f64, stands: impl Fn(&Carrier, i64, i64) -> bool) -> Vec<f64> {
    let mut orders = Vec::new();
    for mesh in &train.meshes {
        let own = mesh.order.value();
        let Some(carrier) = mesh.carrier.as_ref().filter(|carrier| carrier.speed != Fraction::ZERO) else {
            orders.extend((1..=(highest / own) as i64).map(|k| k as f64 * own));
            continue;
        };
        let reach = passes(carrier);
        let pass = carrier.speed.magnitude().value();
        let way = (carrier.speed.sign() * carrier.against_ring.sign()) as f64;
        for k in 1..=(highest / own) as i64 {
            let standing = (-reach..=reach).filter(|n| stands(carrier, k, *n));
            orders.extend(standing.map(|n| k as f64 * own + way * n as f64 * pass));
        }
    }
    orders.retain(|order| *order > 0.0 && *order <= highest);
    orders.sort_by(f64::total_cmp);
    orders.dedup_by(|a, b| (*a - *b).abs() < 1e-9);
    orders
}

#[cfg(test)]
mod tests {
    use super::super::kinematics::tests::{set, train};
    use super::*;

    #[test]
    fn theory_hunting_periods_and_passages_are_the_textbook_ones() {
        let two = train("[[stage]]\nkind = \"pair\"\nteeth = [32, 80]\n[[stage]]\nkind = \"pair\"\nteeth = [23, 61]\n");
        let first = hunting(&two, &two.meshes[0]).unwrap();
        assert_eq!((first[0].0, first[0].1), (5, Fraction::new(1, 5)), "32 and 80 have 16 in common");
        let second = hunting(&two, &two.meshes[1]).unwrap();
        assert_eq!((second[0].0, second[0].1), (61, Fraction::new(2, 5 * 61)));
        let set = set("ring", "sun");
        let mesh = &set.meshes[0];
        let all = passages(&set, mesh, mesh.carrier.as_ref().unwrap()).unwrap();
        let of = |words: &str| all.iter().find(|(_, what)| what.starts_with(words)).expect("a passage").0;
        assert_eq!(of("planet pass"), Fraction::new(3 * 31, 126));
        assert_eq!(of("planet against"), Fraction::new(95 * 31, 126 * 32));
        assert_eq!(of("passage of one tooth of the sun"), Fraction::new(3 * 95, 126));
        assert_eq!(of("passage of one tooth of the ring"), Fraction::new(3 * 31, 126));
        assert_eq!(mesh.order, Fraction::new(95 * 31, 126));
    }

    #[test]
    fn lines_of_a_sound_set_are_those_that_the_phasing_lets_stand() {
        let set = set("ring", "sun");
        let orders = of_sound_meshes(&set, 60.0);
        let pass = 31.0 / 126.0;
        let has = |order: f64| orders.iter().any(|own| (own - order).abs() < 1e-9);
        assert!(has(96.0 * pass) && has(93.0 * pass) && has(95.0 * pass), "harmonic and its standing sidebands");
        assert!(!has(94.0 * pass) && !has(97.0 * pass));
        assert!(!has(60.0 * pass), "farther than planets pass");
        let uneven = of_uneven_meshes(&set, 60.0);
        let has = |order: f64| uneven.iter().any(|own| (own - order).abs() < 1e-9);
        assert!(orders.iter().all(|order| has(*order)) && has(94.0 * pass) && !has(60.0 * pass));
    }
}
