//! Lines of a fault at every gear and shaft of a train.
//!
//! | fault | lines |
//! | --- | --- |
//! | runout, pitch error of a pair's gear | `k fm +- n f`, its own mesh only |
//! | one tooth of a pair's gear | the same, far out, and `n f` below its mesh |
//! | runout of sun or planet | `k fm +- n f +- m fc`: the rate against the carrier, past a carrier that turns |
//! | one tooth of sun, planet or ring | the same, far out, at `f` or at the rate of all contacts alike, and below |
//! | shaft | `n f`, low |
//!
//! Sources: McFadden 1986; Feng and Zuo 2012 (planets). Limit: amplitudes are not predicted, a path is unknown.

use super::kinematics::{Gear, Mesh, Role, Train};
use super::lines;

/// Sidebands of the rate in nested shapes of a modulation.
pub const MODULATIONS: [usize; 3] = [1, 2, 4];
/// Sidebands of one tooth on each side of every harmonic.
const TOOTH_SIDEBANDS: usize = 16;
/// The same of a planetary set, whose carrier multiplies them.
const SET_TOOTH_SIDEBANDS: usize = 8;
/// Carrier orders beyond a sound set's in which one tooth of the ring is looked for.
const RING_TOOTH_ORDERS: i64 = 30;
/// Carrier orders on each side of these.
const CARRIER: i64 = 2;
/// First multiple of a rate in the comb below the mesh that the push of one bad tooth makes: those below are a shaft's.
const COMB_FROM: usize = SHAFT_ORDERS + 1;
/// Most multiples of that comb at a set's gear.
const COMB_OF_SET: usize = 40;
/// Orders of its shaft about another gear's mesh harmonics that are that gear's: a runout's, once and twice per turn.
const NEIGHBOUR_ORDERS: f64 = MODULATIONS[1] as f64 + 0.5;
/// Harmonics of a motor's, a coupling's or blades' line that are no tooth's.
const PART_HARMONICS: u32 = 4;
/// Orders that are one.
const SAME_ORDER_DISTANCE: f64 = 1e-9;
/// Low orders of a shaft.
const SHAFT_ORDERS: usize = 4;
/// Share of the lowest mesh order up to which an order is low.
const LOW_ORDER_SHARE: f64 = 0.4;

/// What happens there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum What {
    /// The mesh swells and fades, or leads and lags, once or a few times per turn.
    Modulation,
    /// Once per turn something short.
    Local,
    /// Low orders of a shaft.
    Shaft,
}

/// Where it happens.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Seat {
    /// A gear, by index.
    Gear(usize),
    /// A shaft.
    Shaft(usize),
}

/// One line of a family.
#[derive(Debug, Clone, PartialEq)]
pub struct FaultLine {
    /// Order.
    pub order: f64,
    /// Signed distance from what it stands beside; its order where beside nothing.
    pub spacing: f64,
    /// In words.
    pub label: String,
}

/// A family of lines of one fault.
#[derive(Debug, Clone, PartialEq)]
pub struct Family {
    /// What.
    pub what: What,
    /// Where.
    pub seat: Seat,
    /// Rate, order.
    pub base: f64,
    /// Its lines.
    pub lines: Vec<FaultLine>,
    /// Lines that the fault has as well where another part is the likelier owner: it is not found by them.
    pub shared: Vec<FaultLine>,
}

impl Family {
    /// "pinion of stage 2: runout or pitch error".
    pub fn words(&self, train: &Train) -> String {
        let seat = seat_words(train, self.seat);
        match self.what {
            What::Modulation => format!("{seat}: runout or pitch error"),
            What::Local => format!("{seat}: local tooth fault"),
            What::Shaft => format!("{seat}: imbalance or misalignment"),
        }
    }
}

/// "pinion of stage 2", "shaft 1 (...)".
pub fn seat_words(train: &Train, seat: Seat) -> String {
    match seat {
        Seat::Gear(gear) => train.gears[gear].words(),
        Seat::Shaft(shaft) => train.shaft_words(shaft),
    }
}

/// Every family in every shape, lines up to `highest`; none of what no exact order leads to.
pub fn all(train: &Train, highest: f64) -> Vec<Family> {
    let mut families = Vec::new();
    for mesh in train.meshes.iter().filter(|mesh| mesh.exact) {
        for &index in &mesh.gears {
            let gear = &train.gears[index];
            // The ring's own turn against the carrier is the planets' passing, which a sound set shows.
            if gear.role != Role::Ring && gear.rate.sign() != 0 {
                families.extend(MODULATIONS.map(|most| modulation(train, mesh, index, most, highest)));
            }
            families.extend(local(train, mesh, index, highest));
        }
    }
    for shaft in (0..train.shafts.len()).filter(|s| train.exact[*s]) {
        families.extend([1, SHAFT_ORDERS].map(|most| of_shaft(train, shaft, most)));
    }
    let parts = lines::of_parts(train);
    let harmonics = |own: &f64| (1..=PART_HARMONICS).map(|n| f64::from(n) * own).collect::<Vec<_>>();
    let parts: Vec<f64> = parts.iter().flat_map(harmonics).collect();
    for family in families.iter_mut().filter(|family| family.what == What::Local) {
        family.lines.retain(|line| parts.iter().all(|own| (line.order - own).abs() > SAME_ORDER_DISTANCE));
    }
    families.retain(|family| !family.lines.is_empty());
    families
}

fn modulation(train: &Train, mesh: &Mesh, index: usize, most: usize, highest: f64) -> Family {
    let gear = &train.gears[index];
    let rate = gear.rate.magnitude().value();
    let lines = beside(mesh, rate, most, highest, gear);
    Family { what: What::Modulation, seat: Seat::Gear(index), base: rate, lines, shared: Vec::new() }
}

/// One tooth, at its own rate and, where every contact is alike, at that of all contacts.
fn local(train: &Train, mesh: &Mesh, index: usize, highest: f64) -> Vec<Family> {
    let gear = &train.gears[index];
    let rate = gear.rate.magnitude().value();
    let family = |rate: f64| {
        let most = if mesh.carrier.is_some() { SET_TOOTH_SIDEBANDS } else { TOOTH_SIDEBANDS };
        let most = most.min((0.5 * mesh.order.value() / rate) as usize).max(1);
        let [low, high] = below(mesh, gear, rate, most);
        let mut all = beside(mesh, rate, most, highest, gear);
        all.extend(high);
        let (mut shared, mut lines): (Vec<_>, Vec<_>) =
            all.into_iter().partition(|line| is_of_neighbour(train, mesh, index, line.order));
        shared.extend(low);
        for lines in [&mut lines, &mut shared] {
            lines.retain(|line| line.order > 0.0 && line.order <= highest);
            lines.sort_by(|a, b| a.order.total_cmp(&b.order));
            lines.dedup_by(|a, b| (a.order - b.order).abs() < 1e-9);
        }
        Family { what: What::Local, seat: Seat::Gear(index), base: rate, lines, shared }
    };
    if rate == 0.0 {
        return Vec::new();
    }
    match gear.role {
        Role::Ring => vec![of_ring(train, mesh, index, highest)],
        _ if gear.contacts > 1 => vec![family(rate), family(f64::from(gear.contacts) * rate)],
        _ => vec![family(rate)],
    }
}

/// The comb below the sidebands of the first mesh harmonic: a push as long as a pitch reaches up to it. Of a gear that
/// several planets meet in turn, equal planets leave one carrier order at each multiple. Low multiples, which a shaft
/// may have, come first, by themselves; none of a gear that turns with a shaft: they are that shaft's.
fn below(mesh: &Mesh, gear: &Gear, rate: f64, most: usize) -> [Vec<FaultLine>; 2] {
    let carrier = mesh.carrier.as_ref().filter(|carrier| carrier.speed.sign() != 0);
    let last = ((mesh.order.value() / rate).round() as usize).saturating_sub(most + 1);
    let last = if mesh.carrier.is_some() { last.min(COMB_OF_SET) } else { last };
    let word = gear.role.word();
    let contacts = (rate / gear.rate.magnitude().value()).round() as i64;
    let mut both = [Vec::new(), Vec::new()];
    let first = if gear.shaft.is_none() { 1 } else { COMB_FROM };
    for n in first..=last {
        let lines = &mut both[usize::from(n >= COMB_FROM)];
        let order = n as f64 * rate;
        lines.push(FaultLine { order, spacing: order, label: format!("{n} {word}") });
        let Some(carrier) = carrier else { continue };
        let planets = i64::from(carrier.planets);
        for m in (-CARRIER..=CARRIER).filter(|m| *m != 0) {
            if gear.role == Role::Sun && (n as i64 * contacts - m).rem_euclid(planets) != 0 {
                continue;
            }
            let order = order + m as f64 * carrier.speed.magnitude().value();
            let sign = if m < 0 { '-' } else { '+' };
            lines.push(FaultLine { order, spacing: order, label: format!("{n} {word} {sign} {} carrier", m.abs()) });
        }
    }
    both
}

/// Whether an order stands beside a mesh harmonic of another gear on the same shaft, where that gear is the likelier
/// owner: what is left of two gears' lines tells them apart.
fn is_of_neighbour(train: &Train, mesh: &Mesh, index: usize, order: f64) -> bool {
    let Some(shaft) = train.gears[index].shaft else { return false };
    let near = NEIGHBOUR_ORDERS * train.shaft_order(shaft).value();
    let is_other = |other: &&Mesh| {
        other.stage != mesh.stage && other.gears.iter().any(|g| *g != index && train.gears[*g].shaft == Some(shaft))
    };
    train.meshes.iter().filter(is_other).any(|other| {
        let own = other.order.value();
        (order - (order / own).round().max(1.0) * own).abs() < near
    })
}

/// One tooth of the ring: carrier orders about the mesh, farther out than a sound set's planets pass, and the planets'
/// passing below it.
fn of_ring(train: &Train, mesh: &Mesh, index: usize, highest: f64) -> Family {
    let (own, stage) = (mesh.order.value(), mesh.stage + 1);
    let rate = train.gears[index].rate.magnitude().value();
    let sound = mesh.carrier.as_ref().map_or(0, lines::passes);
    let last = (sound + RING_TOOTH_ORDERS).min((0.5 * own / rate) as i64);
    let mut lines = Vec::new();
    for k in 1..=(highest / own) as usize {
        for n in (-last..=last).filter(|n| n.abs() > sound) {
            let (spacing, sign) = (n as f64 * rate, if n < 0 { '-' } else { '+' });
            let label = format!("{k} mesh {stage} {sign} {} ring", n.abs());
            lines.push(FaultLine { order: k as f64 * own + spacing, spacing, label });
        }
    }
    let planets = mesh.carrier.as_ref().map_or(1, |carrier| i64::from(carrier.planets));
    let passes = (COMB_FROM as i64..((own / rate) as i64 - last)).filter(|n| n % planets == 0);
    lines.extend(passes.map(|n| {
        let order = n as f64 * rate;
        FaultLine { order, spacing: order, label: format!("{n} ring") }
    }));
    lines.retain(|line| line.order > 0.0 && line.order <= highest);
    lines.sort_by(|a, b| a.order.total_cmp(&b.order));
    lines.dedup_by(|a, b| (a.order - b.order).abs() < 1e-9);
    Family { what: What::Local, seat: Seat::Gear(index), base: rate, lines, shared: Vec::new() }
}

/// `k fm +- n rate`, of a turning carrier `+- m fc` as well, but for what a sound mesh has.
fn beside(mesh: &Mesh, rate: f64, most: usize, highest: f64, gear: &Gear) -> Vec<FaultLine> {
    let (own, stage) = (mesh.order.value(), mesh.stage + 1);
    let carrier = mesh.carrier.as_ref().map_or(0.0, |c| c.speed.magnitude().value());
    let reach = if carrier > 0.0 && gear.role != Role::Ring { CARRIER } else { 0 };
    let word = gear.role.word();
    let mut lines = Vec::new();
    for k in 1..=(highest / own) as usize {
        for n in 1..=most {
            for side in [-1.0, 1.0] {
                for m in -reach..=reach {
                    let spacing = side * n as f64 * rate + m as f64 * carrier;
                    let sign = if side < 0.0 { '-' } else { '+' };
                    let of_carrier = match m {
                        0 => String::new(),
                        m => format!(" {} {} carrier", if m < 0 { '-' } else { '+' }, m.abs()),
                    };
                    let label = format!("{k} mesh {stage} {sign} {n} {word}{of_carrier}");
                    lines.push(FaultLine { order: k as f64 * own + spacing, spacing, label });
                }
            }
        }
    }
    lines.retain(|line| line.order > 0.0 && line.order <= highest && !is_sound(mesh, line.order));
    lines.sort_by(|a, b| a.order.total_cmp(&b.order));
    lines.dedup_by(|a, b| (a.order - b.order).abs() < 1e-9);
    lines
}

/// Whether an order is a sound mesh's: its harmonics, and every carrier order as far as planets passing are owned,
/// those too that only unequal load shares show.
fn is_sound(mesh: &Mesh, order: f64) -> bool {
    let own = mesh.order.value();
    let k = (order / own).round().max(1.0);
    let Some(carrier) = mesh.carrier.as_ref().filter(|c| c.speed.sign() != 0) else {
        return (order - k * own).abs() < 1e-9;
    };
    let pass = carrier.speed.magnitude().value();
    let n = (order - k * own) / pass;
    let is_whole = (n - n.round()).abs() < 1e-6;
    is_whole && n.round().abs() as i64 <= lines::passes(carrier)
}

fn of_shaft(train: &Train, shaft: usize, most: usize) -> Family {
    let own = train.shaft_order(shaft).value();
    let lowest_mesh = train.meshes.iter().map(|mesh| mesh.order.value()).fold(f64::INFINITY, f64::min);
    // Planets pass at multiples of their number.
    let of_it = |mesh: &&Mesh| {
        mesh.carrier.as_ref().is_some_and(|c| c.speed.sign() != 0 && c.speed.magnitude() == train.shaft_order(shaft))
    };
    let planets: Vec<usize> = train
        .meshes
        .iter()
        .filter(of_it)
        .filter_map(|mesh| mesh.carrier.as_ref().map(|carrier| carrier.planets as usize))
        .collect();
    let orders = (1..=most)
        .filter(|n| planets.iter().all(|planets| !n.is_multiple_of(*planets)))
        .map(|n| (n, n as f64 * own))
        .filter(|(_, order)| *order < LOW_ORDER_SHARE * lowest_mesh.max(own / LOW_ORDER_SHARE + own));
    let lines =
        orders.map(|(n, order)| FaultLine { order, spacing: order, label: format!("{n} shaft {shaft}") }).collect();
    Family { what: What::Shaft, seat: Seat::Shaft(shaft), base: own, lines, shared: Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::super::kinematics::tests::{set, train};
    use super::*;

    fn find<'a>(families: &'a [Family], train: &Train, words: &str) -> Vec<&'a Family> {
        families.iter().filter(|f| f.words(train) == words).collect()
    }

    #[test]
    fn theory_sidebands_of_each_gear_stand_about_its_own_mesh() {
        let train =
            train("[[stage]]\nkind = \"pair\"\nteeth = [23, 61]\n[[stage]]\nkind = \"pair\"\nteeth = [19, 77]\n");
        let all = all(&train, 100.0);
        let pinion = find(&all, &train, "pinion of stage 2: runout or pitch error");
        assert_eq!(pinion.len(), MODULATIONS.len());
        let (mesh, own) = (19.0 * 23.0 / 61.0, 23.0 / 61.0);
        let has = |family: &Family, order: f64| family.lines.iter().any(|line| (line.order - order).abs() < 1e-9);
        assert!(has(pinion[0], mesh - own) && has(pinion[0], 2.0 * mesh + own) && !has(pinion[0], 23.0 + own));
        let gear = find(&all, &train, "gear of stage 1: local tooth fault");
        assert!(has(gear[0], 23.0 + 12.0 * own) && !has(gear[0], 23.0));
        assert!(!has(gear[0], 23.0 + 14.0 * own), "beside the fourth harmonic of stage 2");
        let shaft = find(&all, &train, "shaft 1 (gear of stage 1, pinion of stage 2): imbalance or misalignment");
        assert!(has(shaft[0], own));
    }

    #[test]
    fn theory_the_push_of_a_tooth_reaches_up_to_its_mesh_and_leaves_what_others_own() {
        let text = "[[stage]]\nkind = \"pair\"\nteeth = [32, 59]\n[[stage]]\nkind = \"pair\"\nteeth = [17, 32]\n\
            [[coupling]]\nshaft = 1\nelements = 6\n";
        let train = train(text);
        let all = all(&train, 100.0);
        let (rate, has) = (32.0 / 59.0, |family: &Family, order: f64| {
            family.lines.iter().any(|line| (line.order - order).abs() < 1e-9)
        });
        let gear = find(&all, &train, "gear of stage 1: local tooth fault")[0];
        let pinion = find(&all, &train, "pinion of stage 2: local tooth fault")[0];
        for n in [8.0, 13.0, 38.0] {
            assert!(has(gear, n * rate), "{n}");
        }
        assert!(!has(gear, 3.0 * rate), "the shaft's");
        assert!(!has(gear, 16.0 * rate) && has(pinion, 16.0 * rate), "beside the mesh of stage 2");
        let shares = |n: f64| gear.shared.iter().any(|line| (line.order - n * rate).abs() < 1e-9);
        assert!(shares(16.0) && !shares(3.0) && !shares(13.0), "the pinion's line may be the gear's");
        assert!(!has(gear, 12.0 * rate) && !has(pinion, 12.0 * rate), "the coupling's second harmonic");
    }

    #[test]
    fn theory_a_planet_has_sidebands_at_its_rate_and_the_carriers_and_none_of_a_sound_sets_lines() {
        let train = set("ring", "sun");
        let all = all(&train, 60.0);
        let planet = find(&all, &train, "planet of stage 1: local tooth fault");
        let (pass, rate, mesh) = (31.0 / 126.0, 95.0 * 31.0 / (126.0 * 32.0), 95.0 * 31.0 / 126.0);
        assert_eq!(planet.len(), 2, "one contact and both");
        let has = |order: f64| planet[0].lines.iter().any(|line| (line.order - order).abs() < 1e-9);
        assert!(has(mesh + rate) && has(mesh - 2.0 * rate + pass));
        let shares = |order: f64| planet[0].shared.iter().any(|line| (line.order - order).abs() < 1e-9);
        assert!(!has(4.0 * rate) && shares(4.0 * rate), "no shaft turns at a planet's rate, another part may");
        for family in &all {
            for line in &family.lines {
                assert!((line.order - 96.0 * pass).abs() > 1e-9, "{} owns a sound line", family.words(&train));
            }
        }
        assert!(find(&all, &train, "ring of stage 1: runout or pitch error").is_empty());
    }
}
