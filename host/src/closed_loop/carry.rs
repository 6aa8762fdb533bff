//! From a named effect of the loop to the simulator's own: keys, orders, phases, teeth.
//!
//! Both count angles from the same zero: pulse 0 of the record (`first_pulse_index` counts from it), where pair 0 enters the path. The loop
//! writes every order-locked effect as `cos(order angle + phase)`, the angle being the pinion's; the simulator's effects have
//! conventions of their own (an eccentricity lies `phase` ahead of the line of centres, an imbalance pulls across the line of action first, a
//! load brakes), which the turns in [`MAPPING`] undo. What a record cannot tell is said with [`Carried::remark`]: a phase that is free in every
//! run, and the hunting period's zero (a tachometer on the pinion gives the gear's angle only up to whole turns of the pinion,
//! which are carried over as found, run by run).

use super::candidate::{Parameter, Tuning};
use super::outcome::{Effect, Term};
use super::start::Start;
use crate::machine::Geometry;
use crate::machine::Machine;
use crate::{Result, effects};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Which gear an effect of the simulator sits on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Body {
    /// The pinion.
    Pinion,
    /// The gear.
    Gear,
    /// The shaft that the loop names.
    Named,
    /// None: the effect has no `gear` key.
    Neither,
}

/// What the simulator's `order` counts per turn of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PerTurn {
    /// The effect has no `order` key.
    None,
    /// The pinion.
    Pinion,
    /// The gear.
    Gear,
    /// The shaft the effect sits on.
    Own,
}

/// One effect of the loop in terms of the simulator's.
#[derive(Debug, Clone, Copy)]
pub struct Mapping {
    /// The loop's name.
    pub found: &'static str,
    /// The simulator's name.
    pub name: &'static str,
    /// Gear.
    pub body: Body,
    /// Beginning of the loop's parameter, and the simulator's key.
    pub keys: &'static [(&'static str, &'static str)],
    /// The simulator's phase less the loop's, rad, on pinion and gear; `None` without phase.
    pub turn_rad: Option<[f64; 2]>,
    /// The simulator's phase counts from the line of centres: the pressure angle goes off, too.
    pub from_line_of_centres: bool,
    /// Order.
    pub per_turn: PerTurn,
}

const fn plain(
    found: &'static str,
    name: &'static str,
    body: Body,
    keys: &'static [(&'static str, &'static str)],
) -> Mapping {
    Mapping { found, name, body, keys, turn_rad: None, from_line_of_centres: false, per_turn: PerTurn::None }
}

const SAME: Option<[f64; 2]> = Some([0.0, 0.0]);
const ECCENTRIC: Mapping = Mapping {
    // -sin on the pinion, +sin on the gear.
    turn_rad: Some([-FRAC_PI_2, FRAC_PI_2]),
    from_line_of_centres: true,
    ..plain("pinion-eccentricity", "eccentricity", Body::Pinion, &[("amplitude", "amplitude")])
};
const UNBALANCED: Mapping = Mapping {
    // Along the line of action: +sin on the pinion, -sin on the gear, which turns against it.
    turn_rad: Some([FRAC_PI_2, -FRAC_PI_2]),
    ..plain("pinion-imbalance", "imbalance", Body::Pinion, &[("unbalance", "moment")])
};

/// Effects with a counterpart of a few keys; the others are in [`carry`].
pub const MAPPING: &[Mapping] = &[
    ECCENTRIC,
    Mapping { found: "gear-eccentricity", body: Body::Gear, ..ECCENTRIC },
    UNBALANCED,
    Mapping { found: "gear-imbalance", body: Body::Gear, ..UNBALANCED },
    plain("pinion-tooth-crack", "tooth-crack", Body::Pinion, &[("stiffness_loss", "loss")]),
    plain("gear-tooth-crack", "tooth-crack", Body::Gear, &[("stiffness_loss", "loss")]),
    plain("wear", "wear", Body::Neither, &[("depth", "depth")]),
    plain("friction", "friction", Body::Neither, &[("coefficient", "coefficient")]),
    Mapping {
        turn_rad: SAME,
        per_turn: PerTurn::Own,
        ..plain("ghost-order", "ghost-order", Body::Named, &[("amplitude", "amplitude")])
    },
    Mapping {
        turn_rad: SAME,
        per_turn: PerTurn::Pinion,
        ..plain("torque-ripple", "torque-ripple", Body::Neither, &[("share_of_torque", "depth")])
    },
    Mapping {
        // The load brakes.
        turn_rad: Some([PI, PI]),
        per_turn: PerTurn::Gear,
        ..plain("load-fluctuation", "load-fluctuation", Body::Neither, &[("share_of_torque", "depth")])
    },
    Mapping {
        turn_rad: SAME,
        ..plain("coupling-misalignment", "coupling-misalignment", Body::Named, &[("radial_force", "force")])
    },
    Mapping {
        turn_rad: SAME,
        per_turn: PerTurn::Own,
        ..plain(
            "bearing-stiffness-modulation",
            "bearing-stiffness-modulation",
            Body::Named,
            &[("share_of_stiffness", "share")],
        )
    },
];

/// Simulator's effects that stand for one of the loop's.
#[derive(Debug, Clone)]
pub struct Carried {
    /// Names and keys, to be added together.
    pub tables: Vec<(&'static str, toml::Table)>,
    /// What does not carry over.
    pub remark: Option<String>,
    /// Turns of the pinion by which every run starts later than its pulse 0 says.
    pub pinion_turns: Option<Vec<u32>>,
}

/// Remark of effects whose phase is another in every run.
pub const PHASE_FREE: &str = "phase free in every run: compare levels, not waveforms";
/// Remark of effects that sit on the gear.
pub const HUNTING: &str = "teeth and phase of the gear count from the pinion turn of the first run's pulse 0, which a tachometer on the pinion cannot tell from another";

fn one(name: &'static str, keys: &[(&str, f64)]) -> Carried {
    Carried { tables: vec![(name, table(keys))], remark: None, pinion_turns: None }
}

fn table(keys: &[(&str, f64)]) -> toml::Table {
    keys.iter().map(|(key, value)| ((*key).to_string(), toml::Value::Float(*value))).collect()
}

/// The angle within a half turn of zero.
fn wrapped(rad: f64) -> f64 {
    rad - TAU * (rad / TAU).round()
}

/// The reported value whose name begins so.
fn value<'a>(effect: &'a Effect, prefix: &str) -> Option<(&'a str, f64)> {
    let found = effect.parameters.iter().find(|(name, _)| name.starts_with(prefix) && !name.ends_with("_phase"));
    found.map(|(name, value)| (name.as_str(), value.value))
}

/// Cosine and sine parts of a term's parameter.
fn parts(term: &Term, parameter: &Parameter) -> Option<[f64; 2]> {
    let x = &term.unknowns;
    Some([*x.get(parameter.first)?, if parameter.complex { *x.get(parameter.first + 1)? } else { 0.0 }])
}

/// The channel a term of the measuring path acts on: 0, 1, or 2 for both.
fn channel(term: &Term) -> f64 {
    match term.channel_share {
        [_, b] if b < 1e-3 => 0.0,
        [a, _] if a < 1e-3 => 1.0,
        _ => 2.0,
    }
}

/// The simulator's effects for a named one of the loop with the term behind it; `None` without a counterpart.
///
/// # Errors
/// A machine without geometry, values beyond the simulator's range.
pub fn carry(effect: &Effect, term: Option<&Term>, machine: &Machine) -> Result<Option<Carried>> {
    let mut carried = match MAPPING.iter().find(|m| m.found == effect.name) {
        Some(mapping) => mapped(mapping, effect, term, machine)?,
        None => special(effect, term, machine),
    };
    if let Some(carried) = &mut carried {
        carried.pinion_turns = term.and_then(|t| t.start.turns()).map(<[u32]>::to_vec);
    }
    for (name, table) in carried.iter().flat_map(|c| &c.tables) {
        effects::from_table(name, table)?;
    }
    Ok(carried)
}

fn mapped(mapping: &Mapping, effect: &Effect, term: Option<&Term>, machine: &Machine) -> Result<Option<Carried>> {
    let gear = match mapping.body {
        Body::Gear => true,
        Body::Named => effect.shaft == "gear",
        Body::Pinion | Body::Neither => false,
    };
    let mut keys: Vec<(&str, f64)> = Vec::new();
    for (prefix, key) in mapping.keys {
        let Some((label, value)) = value(effect, prefix) else { continue };
        keys.push((key, value));
        if let Some(tooth) = label.rsplit("tooth ").next().and_then(|t| t.parse::<f64>().ok()) {
            keys.push(("tooth", tooth));
        }
    }
    if keys.is_empty() {
        return Ok(None);
    }
    if mapping.body != Body::Neither {
        keys.push(("gear", f64::from(u8::from(gear))));
    }
    let ratio = f64::from(machine.pair.teeth[0]) / f64::from(machine.pair.teeth[1]);
    if let Some(order) = effect.order_of_pinion {
        match mapping.per_turn {
            PerTurn::None => {}
            PerTurn::Gear => keys.push(("order", order / ratio)),
            PerTurn::Own if gear => keys.push(("order", order / ratio)),
            PerTurn::Own | PerTurn::Pinion => keys.push(("order", order)),
        }
    } else if let Some(hz) = effect.frequency_hz
        && mapping.per_turn != PerTurn::None
    {
        keys.push(("frequency", hz));
    }
    let phase = effect.parameters.iter().find(|(name, _)| name.ends_with("_phase"));
    if let (Some(turn), Some((_, phase))) = (mapping.turn_rad, phase) {
        let centres =
            if mapping.from_line_of_centres { Geometry::new(&machine.pair)?.working_pressure_angle } else { 0.0 };
        keys.push(("phase", wrapped(phase.value + turn[usize::from(gear)] - centres)));
    }
    let mut carried = one(mapping.name, &keys);
    if term.is_some_and(|t| t.phase_free || matches!(t.start, Start::Phases(_))) {
        carried.remark = Some(PHASE_FREE.into());
    } else if gear || mapping.per_turn == PerTurn::Gear {
        carried.remark = Some(HUNTING.into());
    }
    Ok(Some(carried))
}

/// Effects that need more than keys of their own.
fn special(effect: &Effect, term: Option<&Term>, machine: &Machine) -> Option<Carried> {
    if effect.name == "clipping" {
        let limits = ["limit_of_the_pinion", "limit_of_the_gear"].map(|name| value(effect, name));
        let tables = limits.iter().enumerate().filter_map(|(c, limit)| {
            limit.map(|(_, value)| ("clipping", table(&[("limit", value), ("channel", c as f64)])))
        });
        return Some(Carried { tables: tables.collect(), remark: None, pinion_turns: None });
    }
    let term = term?;
    let on = ("channel", channel(term));
    match effect.name.as_str() {
        "pinion-pitch-error" | "gear-pitch-error" => pitch_error(effect, term, machine),
        "profile-error" => profile_error(term),
        "tip-relief" => {
            let Some(Tuning::Relief { share, exponent }) = term.tuning else { return None };
            let keys = [("amount", value(effect, "amount")?.1), ("length", share), ("exponent", f64::from(exponent))];
            Some(one("tip-relief", &keys))
        }
        "mains-hum" => mains_hum(effect, term),
        "thermal-drift" => Some(one("thermal-drift", &[("share", value(effect, "gain_change")?.1), on])),
        "sensor-nonlinearity" => Some(match (value(effect, "quadratic"), value(effect, "cubic")) {
            (Some((_, square)), _) => one("sensor-nonlinearity", &[("quadratic", square), on]),
            (None, Some((_, cube))) => one("sensor-nonlinearity", &[("quadratic", 0.0), ("cubic", cube), on]),
            _ => return None,
        }),
        "transfer-path-resonance" => {
            let Some(Tuning::Mode { f0, zeta, .. }) = term.tuning else { return None };
            // The simulator's mode has a real gain; the quadrature part has no counterpart.
            let [gain, quadrature] = parts(term, term.parameters.first()?)?;
            let mut carried =
                one("transfer-path-resonance", &[("gain", gain), ("frequency", f0), ("damping", zeta), on]);
            let share = quadrature / gain.hypot(quadrature);
            carried.remark = (share.abs() > 0.1)
                .then(|| format!("{:.0} % of the gain in quadrature, left out", 100.0 * share.abs()));
            Some(carried)
        }
        "channel-delay" => {
            let (label, share) = value(effect, "share_of_a_delay_of_")?;
            let delay_us: f64 = label.strip_prefix("share_of_a_delay_of_")?.strip_suffix("_us")?.parse().ok()?;
            Some(one("transfer-path", &[("delay", 1e-6 * delay_us * share), on]))
        }
        _ => None,
    }
}

/// One tooth, or every tooth of a table given by its harmonics over the gear's turn.
fn pitch_error(effect: &Effect, term: &Term, machine: &Machine) -> Option<Carried> {
    let gear = effect.shaft == "gear";
    let body = ("gear", f64::from(u8::from(gear)));
    let remark = gear.then(|| HUNTING.to_string());
    if let Some((label, single)) = value(effect, "single_tooth_offset") {
        let tooth = label.rsplit("tooth ").next()?.parse::<f64>().ok()?;
        return Some(Carried { remark, ..one("pitch-error", &[("single", single), ("tooth", tooth), body]) });
    }
    let z = f64::from(machine.pair.teeth[usize::from(gear)]);
    let harmonics: Vec<[f64; 2]> = term.parameters.iter().map(|p| parts(term, p)).collect::<Option<_>>()?;
    let offset = |tooth: f64| -> f64 {
        let part = |(m, [a, b]): (f64, &[f64; 2])| {
            let (sin, cos) = (TAU * m * tooth / z).sin_cos();
            // Both signs of a harmonic count, but for the one at half the teeth.
            if 2.0 * m == z { a * cos } else { 2.0 * (a * cos - b * sin) }
        };
        (1..).map(f64::from).zip(&harmonics).map(part).sum::<f64>() / z
    };
    let teeth = (0..machine.pair.teeth[usize::from(gear)]).map(f64::from);
    let tables = teeth.map(|t| ("pitch-error", table(&[("single", offset(t)), ("tooth", t), body]))).collect();
    Some(Carried { tables, remark, pinion_turns: None })
}

/// One table per mesh order, as each has its own phase.
fn profile_error(term: &Term) -> Option<Carried> {
    let names = ["first", "second", "third", "fourth"];
    let tables = term.parameters.iter().zip(names).filter_map(|(parameter, name)| {
        let [a, b] = parts(term, parameter)?;
        // The first order's default is not zero.
        let mut keys = vec![("first", 0.0), ("phase", b.atan2(a))];
        keys.retain(|(key, _)| *key != name);
        keys.push((name, a.hypot(b)));
        Some(("profile-error", table(&keys)))
    });
    Some(Carried { tables: tables.collect(), remark: None, pinion_turns: None })
}

/// One tone per channel where they differ.
fn mains_hum(effect: &Effect, term: &Term) -> Option<Carried> {
    let (hz, larger) = (effect.frequency_hz?, value(effect, "acceleration")?.1);
    // Line frequencies only, in the simulator; harmonics are tones.
    let (name, key) = if hz <= 400.0 { ("mains-hum", "first") } else { ("fixed-tone", "amplitude") };
    let tone = |share: f64, on: f64| (name, table(&[(key, share * larger), ("frequency", hz), ("channel", on)]));
    let tables = match term.channel_share {
        [a, b] if (a - b).abs() < 0.05 => vec![tone(0.5 * (a + b), 2.0)],
        [a, b] => vec![tone(a, 0.0), tone(b, 1.0)],
    };
    Some(Carried { tables, remark: Some(PHASE_FREE.into()), pinion_turns: None })
}
