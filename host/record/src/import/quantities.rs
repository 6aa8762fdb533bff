//! Which channels are accelerations, in which unit they come, and what is kept beside them.
//!
//! A file's own unit counts. Where it states none, a name that says torque or temperature keeps a channel out, and
//! `--unit` says the rest; nothing said is unknown. A record's channels are its accelerations, in m/s2; without one,
//! what states no unit, or what all share (volts, pascals). Everything else is kept beside: analysis and loop do not
//! see it.

use super::ImportOptions;
use super::grouped::Group;
use super::units::{self, GRAVITY, Measure, Quantity};
use crate::record::{Beside, BesideDeclaration};
use crate::{Error, Result, text};
use rayon::prelude::*;

/// Unit of the source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Unit {
    /// m/s2.
    MetrePerSecondSquared,
    /// Multiples of standard gravity; converted.
    Gravity,
    /// Volts; converted where the sensitivity, V per g, is known, otherwise kept and named in the record.
    Volt(Option<f64>),
    /// Not stated by the source; kept and named in the record.
    Unknown,
    /// Any other unit of the table.
    Other(Measure),
}

impl Unit {
    /// A unit as people write it; `unknown` for a source that states none.
    ///
    /// # Errors
    /// What is no unit of the table.
    pub fn parse(text: &str) -> std::result::Result<Self, String> {
        if text == "unknown" {
            return Ok(Unit::Unknown);
        }
        let measure = units::measure(text).ok_or_else(|| {
            format!(
                "'{text}' is no unit that is known; for example m/s2, g, mg, mm/s2, in/s2, V, mV, N m, Pa, rpm, \
                degC, or unknown"
            )
        })?;
        Ok(match measure {
            Measure { quantity: Quantity::Acceleration, factor: 1.0, .. } => Unit::MetrePerSecondSquared,
            Measure { quantity: Quantity::Acceleration, factor: GRAVITY, .. } => Unit::Gravity,
            Measure { quantity: Quantity::Voltage, factor: 1.0, .. } => Unit::Volt(None),
            other => Unit::Other(other),
        })
    }
}

/// What a channel becomes in the record.
#[derive(Debug, Clone, PartialEq)]
struct Role {
    quantity: Option<Quantity>,
    factor: f64,
    offset: f64,
    /// Unit in the record.
    symbol: String,
}

impl Role {
    fn of(measure: Measure) -> Self {
        let Measure { quantity, factor, offset, symbol } = measure;
        Self { quantity: Some(quantity), factor, offset, symbol: symbol.into() }
    }

    fn unknown(quantity: Option<Quantity>) -> Self {
        Self { quantity, factor: 1.0, offset: 0.0, symbol: "unknown".into() }
    }

    fn acceleration(factor: f64) -> Self {
        Self { quantity: Some(Quantity::Acceleration), factor, offset: 0.0, symbol: "m/s2".into() }
    }

    fn is(&self, quantity: Quantity) -> bool {
        self.quantity == Some(quantity) && self.symbol != "unknown"
    }
}

/// What the channels of all runs have in common.
pub(super) struct Sorted {
    /// Unit of the record's channels where it is not m/s2.
    pub unit: Option<String>,
    /// What is kept beside, one list per run.
    pub beside: Vec<Vec<(BesideDeclaration, Beside)>>,
    pub remarks: Vec<String>,
}

/// Turns the accelerations into the record's unit, and takes everything else out of the runs.
///
/// # Errors
/// Units that contradict each other, no channel that could be the record's, or a number of `--unit` that is none.
pub(super) fn sort(runs: &mut [Group], rate_hz: f64, options: &ImportOptions) -> Result<Sorted> {
    let mut remarks = Vec::new();
    let roles = roles(&runs[0], options)?;
    for run in &runs[1..] {
        if run.units != runs[0].units {
            let what = format!(
                "{} states other units than {}; --unit for every channel says which hold",
                run.label, runs[0].label
            );
            if options.units.len() != roles.len() {
                return Err(Error::invalid("--unit", what));
            }
        }
    }
    let main = main(&runs[0], &roles)?;
    let unit = (main != "m/s2").then(|| main.clone());
    if main == "unknown" && options.units.is_empty() {
        let names = named(&runs[0], &roles, |role| role.symbol == main && may_be_main(role));
        remarks.push(format!(
            "no unit is stated for {names}: the numbers are kept as they are; --unit says it, and of \
             volts --volt-per-g (of integers with the recorder's range as --source-full-scale)"
        ));
    }
    let is_main: Vec<bool> = roles.iter().map(|role| role.symbol == main && may_be_main(role)).collect();
    for (c, role) in roles.iter().enumerate().filter(|(c, _)| !is_main[*c]) {
        let what = match role.quantity {
            Some(quantity) => format!("{quantity:?} in {}", role.symbol)
                .to_lowercase()
                .replace("in n m", "in N m")
                .replace("in pa", "in Pa"),
            None => "of an unknown unit".into(),
        };
        let name = text::quoted(&runs[0].names[c]);
        remarks.push(format!(
            "channel {name} is {what}, kept beside the channels; units for all channels (--unit) put it among them"
        ));
    }
    let odd = |unit: &&Unit| matches!(unit, Unit::Volt(Some(own)) if !PLAUSIBLE_VOLT_PER_G.contains(own));
    if let Some(Unit::Volt(Some(own))) = options.units.iter().find(odd) {
        remarks.push(format!("--volt-per-g {own}: sensors have 0.001 to 10 V per g; 100 mV/g is 0.1"));
    }
    let mut beside = Vec::new();
    for run in runs.iter_mut() {
        beside.push(taken(run, &roles, &is_main, rate_hz));
        let own: Vec<&Role> = roles.iter().zip(&is_main).filter(|(_, main)| **main).map(|(role, _)| role).collect();
        run.channels.par_iter_mut().zip(own).for_each(|(channel, role)| {
            let mean = if options.remove_mean { channel.iter().sum::<f64>() / channel.len() as f64 } else { 0.0 };
            channel.iter_mut().for_each(|x| *x = role.factor * (*x - mean) + role.offset);
        });
    }
    Ok(Sorted { unit, beside, remarks })
}

/// Sensitivities that accelerometers have, V per g.
const PLAUSIBLE_VOLT_PER_G: std::ops::RangeInclusive<f64> = 1e-3..=10.0;

/// Whether a channel may be one of the record's: everything but what only its name keeps out.
fn may_be_main(role: &Role) -> bool {
    role.symbol != "unknown" || role.quantity.is_none_or(|quantity| quantity == Quantity::Acceleration)
}

fn named(run: &Group, roles: &[Role], is: impl Fn(&Role) -> bool) -> String {
    let names = run.names.iter().zip(roles).filter(|(_, role)| is(role)).map(|(name, _)| name.as_str());
    names.take(6).collect::<Vec<_>>().join(", ")
}

fn roles(run: &Group, options: &ImportOptions) -> Result<Vec<Role>> {
    let count = run.channels.len();
    if options.units.len() > 1 && options.units.len() != count {
        let what = format!(
            "names {} values for {count} channels (without the tachometer: {})",
            options.units.len(),
            run.names.join(", ")
        );
        let option = if options.units.iter().all(|unit| matches!(unit, Unit::Volt(Some(_)))) {
            "--unit or --volt-per-g"
        } else {
            "--unit"
        };
        return Err(Error::invalid(option, what));
    }
    let listed = options.units.len() > 1 || (count == 1 && options.units.len() == 1);
    let stated: Vec<Option<Measure>> = run
        .units
        .iter()
        .map(|unit| unit.as_deref().filter(|unit| !units::is_empty(unit)).and_then(units::measure))
        .collect();
    let some = |quantity| stated.iter().flatten().any(|measure| measure.quantity == quantity);
    let beside = Others { accelerate: some(Quantity::Acceleration), volts: some(Quantity::Voltage) };
    let mut roles = Vec::new();
    for c in 0..count {
        let given = (!options.units.is_empty()).then(|| options.units[c % options.units.len()]);
        let stated = stated[c].filter(|_| !options.override_unit);
        let role = match (given, stated) {
            (None | Some(Unit::Unknown), Some(measure)) => Role::of(measure),
            (None, None) => Role::unknown(run.quantities[c]),
            (Some(unit), None) => match run.quantities[c] {
                Some(quantity) if quantity != Quantity::Acceleration && !listed => Role::unknown(Some(quantity)),
                _ => as_given(unit)?,
            },
            (Some(unit), Some(measure)) => agreed(run, c, unit, measure, listed, beside)?,
        };
        roles.push(role);
    }
    Ok(roles)
}

fn as_given(unit: Unit) -> Result<Role> {
    let factor = match unit {
        Unit::MetrePerSecondSquared => 1.0,
        Unit::Gravity => GRAVITY,
        Unit::Volt(Some(volt_per_g)) => GRAVITY / volt_per_g,
        Unit::Volt(None) => {
            return Ok(Role { quantity: Some(Quantity::Voltage), factor: 1.0, offset: 0.0, symbol: "V".into() });
        }
        Unit::Unknown => return Ok(Role::unknown(None)),
        Unit::Other(measure) => return Ok(Role::of(measure)),
    };
    if !(factor.is_finite() && factor > 0.0) {
        return Err(Error::invalid("--volt-per-g", "must be a positive number"));
    }
    Ok(Role::acceleration(factor))
}

/// What the file states among all its channels.
#[derive(Clone, Copy)]
struct Others {
    accelerate: bool,
    volts: bool,
}

/// A channel of which file and user state a unit.
fn agreed(run: &Group, c: usize, unit: Unit, stated: Measure, listed: bool, others: Others) -> Result<Role> {
    if let (Unit::Volt(Some(_)), Quantity::Voltage) = (unit, stated.quantity) {
        let per_volt = as_given(unit)?;
        return Ok(Role { factor: per_volt.factor * stated.factor, ..per_volt });
    }
    let given = as_given(unit)?;
    let own = Role::of(stated);
    if given.symbol == own.symbol && (given.factor / own.factor - 1.0).abs() < 1e-6 {
        return Ok(own);
    }
    let vibrates = [Quantity::Acceleration, Quantity::Voltage].contains(&stated.quantity);
    let apart = !vibrates || (stated.quantity == Quantity::Voltage && others.accelerate);
    // A sensitivity is said of the channels in volts; those in g beside them keep their unit.
    let of_the_volts = matches!(unit, Unit::Volt(Some(_))) && others.volts;
    if !listed && (apart || of_the_volts) {
        return Ok(own);
    }
    let what = format!(
        "contradicts {}, which states {} for channel {}; leave --unit out, or give --override-unit if the file is \
         wrong",
        run.label,
        text::quoted(run.units[c].as_deref().unwrap_or_default()),
        text::quoted(&run.names[c])
    );
    Err(Error::invalid("--unit", what))
}

/// Unit of the record's channels.
fn main(run: &Group, roles: &[Role]) -> Result<String> {
    if roles.iter().any(|role| role.is(Quantity::Acceleration)) {
        return Ok("m/s2".into());
    }
    if roles.iter().any(|role| role.symbol == "unknown" && may_be_main(role)) {
        return Ok("unknown".into());
    }
    if roles.iter().any(|role| role.is(Quantity::Voltage)) {
        return Ok("V".into());
    }
    let first = roles.iter().find(|role| role.symbol != "unknown");
    match first {
        Some(first) if roles.iter().all(|role| role.symbol == first.symbol) => Ok(first.symbol.clone()),
        _ => {
            let list: Vec<String> = run
                .names
                .iter()
                .zip(roles)
                .map(|(name, role)| {
                    format!(
                        "{} {}",
                        text::quoted(name),
                        role.quantity.map_or("?".into(), |q| format!("{q:?}").to_lowercase())
                    )
                })
                .collect();
            let what = format!(
                "holds no acceleration ({}); --columns chooses the one to take as it is, --unit with one unit per \
                 channel says otherwise",
                list.join(", ")
            );
            Err(Error::invalid(&run.label, what))
        }
    }
}

/// Takes what is not the record's out of a run, with the signals that stood apart.
fn taken(run: &mut Group, roles: &[Role], is_main: &[bool], rate_hz: f64) -> Vec<(BesideDeclaration, Beside)> {
    let mut beside = Vec::new();
    for c in (0..roles.len()).rev().filter(|c| !is_main[*c]) {
        let (name, values) = (run.names.remove(c), run.channels.remove(c));
        beside.push(made(name, &values, &roles[c], Some(rate_hz), None));
    }
    beside.reverse();
    for signal in std::mem::take(&mut run.apart) {
        let unit = signal.unit.as_deref().and_then(units::measure);
        let role = unit.map_or_else(|| Role::unknown(signal.quantity()), Role::of);
        let start = signal.start_s.map(|start| start - run.start_s.unwrap_or(0.0));
        if signal.values.iter().all(|x| x.is_finite()) {
            beside.push(made(signal.name, &signal.values, &role, signal.rate_hz, start));
        }
    }
    beside
}

fn made(
    name: String,
    values: &[f64],
    role: &Role,
    rate_hz: Option<f64>,
    start_s: Option<f64>,
) -> (BesideDeclaration, Beside) {
    let declaration = BesideDeclaration {
        file: String::new(),
        name,
        quantity: role.quantity.map(|quantity| format!("{quantity:?}").to_lowercase()),
        unit: role.symbol.clone(),
        sample_rate_hz: rate_hz,
        start_s: start_s.filter(|start| *start != 0.0),
    };
    (declaration, values.iter().map(|x| (role.factor * x + role.offset) as f32).collect())
}
