//! What a declared train changes at import: which channel its tachometer is, where virtual pulses come from, what
//! further tachometers say.

use super::grouped::Group;
use super::tach::{self, Shaft, TachOptions};
use super::{ImportOptions, TachChoice};
use crate::record::Tach;
use crate::train::{Role, Train};
use crate::{Error, Result, text};

/// Share by which the ratio of two tachometers may depart from the train's before it is said.
const RATIO_OFF: f64 = 1e-3;

/// The options with the tachometer's channel found, where a train declares one and names no channel.
///
/// # Errors
/// No channel that looks like a tachometer's, or several.
pub(super) fn with_channel(options: &ImportOptions, runs: &[Group]) -> Result<ImportOptions> {
    let TachChoice::Measured(measured) = &options.tach else { return Ok(options.clone()) };
    let several = options.train.as_ref().is_some_and(|train| train.declaration.tachs.len() > 1);
    if !measured.sources.is_empty() {
        let tach = if several { named(measured, runs) } else { measured.clone() };
        return Ok(ImportOptions { tach: TachChoice::Measured(tach), ..options.clone() });
    }
    let Some(run) = runs.first() else { return Ok(options.clone()) };
    let found: Vec<usize> = (0..run.channels.len()).filter(|c| tach::looks_like_a_tach(&run.channels[*c])).collect();
    let [channel] = found.as_slice() else {
        let list: Vec<String> = found.iter().map(|c| text::quoted(&run.names[*c])).collect();
        let what = if list.is_empty() {
            "the train declares a tachometer and no channel looks like one; name it with --tach, or give --no-tach"
                .into()
        } else {
            format!("the train declares a tachometer and {} look like one; name it with --tach", list.join(", "))
        };
        return Err(Error::invalid(&run.label, what));
    };
    let found = TachOptions { sources: vec![(channel + 1).to_string()], ..measured.clone() };
    let tach = TachChoice::Measured(if several { named(&found, runs) } else { found });
    Ok(ImportOptions { tach, ..options.clone() })
}

/// The `[tach]` of a record on the shaft that the train says.
pub(super) fn on_shaft(tach: Tach, options: &ImportOptions) -> Tach {
    let Some(train) = options.train.as_ref().filter(|train| train.declaration.as_pair().is_none()) else { return tach };
    let shaft = match &options.tach {
        TachChoice::Measured(_) => train.declaration.tachs.first().map(|declared| declared.shaft),
        TachChoice::Virtual => virtual_teeth(train).map(|(_, shaft)| shaft),
        TachChoice::None | TachChoice::Nominal(_) => Some(0),
    };
    let Some(shaft) = shaft else { return tach };
    tach.on_train_shaft(shaft, train.shaft_order(shaft).value())
}

/// Tooth counts by which the first mesh line makes a virtual tachometer, and its shaft: of a set those of the gear
/// against which the carrier turns; none where nothing that meshes there has a shaft.
pub(super) fn virtual_teeth(train: &Train) -> Option<([u32; 2], usize)> {
    let mesh = train.meshes.first()?;
    let gears: Vec<_> = mesh.gears.iter().map(|g| &train.gears[*g]).collect();
    let other = |own: u32| gears.iter().map(|gear| gear.teeth).find(|z| *z != own).unwrap_or(own);
    if mesh.carrier.is_none() {
        let (first, last) = (gears.first()?, gears.last()?);
        return Some(([first.teeth, last.teeth], first.shaft?));
    }
    let turns_alone = gears.iter().find(|gear| gear.shaft.is_some() && gear.rate == gear.speed);
    if let Some(gear) = turns_alone {
        return Some(([gear.teeth, other(gear.teeth)], gear.shaft?));
    }
    // The carrier turns against what stands still.
    let still = gears.iter().find(|gear| gear.role != Role::Planet && gear.speed.sign() == 0)?;
    let is_carrier = |shaft: &usize| {
        train.shafts[*shaft].magnitude() == still.rate.magnitude()
            && train.gears_on(*shaft).all(|g| train.gears[g].stage != mesh.stage)
    };
    let stage = &train.declaration.stages[mesh.stage];
    let carrier = [stage.driven_from(mesh.stage), mesh.stage + 1].into_iter().find(is_carrier)?;
    Some(([still.teeth, other(still.teeth)], carrier))
}

/// Takes the channels of further tachometers out of the runs, and says how their ratio to the first compares with the
/// train's.
///
/// # Errors
/// A further tachometer without a channel, and those of [`tach::measured`].
pub(super) fn other_tachs(options: &ImportOptions, runs: &mut [Group], rate_hz: f64) -> Result<Vec<String>> {
    let (Some(train), TachChoice::Measured(first)) = (&options.train, &options.tach) else { return Ok(Vec::new()) };
    let declared = &train.declaration.tachs;
    if declared.len() < 2 {
        return Ok(Vec::new());
    }
    // The reference is read on a copy: its channel is taken out by whoever makes the record.
    let speeds = |options: &TachOptions, runs: &mut [Group]| -> Result<Vec<f64>> {
        let made = tach::measured(options, runs, rate_hz, None, None, &super::Reading::default())?;
        Ok(made.iter().map(|tach| tach.figures.shaft_speed_hz.mean).collect())
    };
    let reference = speeds(first, &mut runs.to_vec())?;
    let mut remarks = Vec::new();
    for (i, own) in declared.iter().enumerate().skip(1) {
        let Some(source) = &own.source else {
            let what = "a further tachometer needs source = \"channel\"";
            return Err(Error::invalid(format!("[[tach]] {i} source"), what));
        };
        let further = TachOptions {
            sources: vec![source.clone()],
            pulses: own.pulses_per_turn,
            shaft: Shaft::Pinion,
            falling: None,
            threshold: None,
        };
        let found = speeds(&further, runs)?;
        let expected = train.shaft_order(own.shaft).over(train.shaft_order(declared[0].shaft))?;
        for (run, (own_hz, first_hz)) in found.iter().zip(&reference).enumerate() {
            let off = own_hz / first_hz / expected.value() - 1.0;
            let verdict = if off.abs() < RATIO_OFF { "agrees" } else { "CONTRADICTS the declared train or pulses" };
            remarks.push(format!(
                "run {run}: tachometer on shaft {} turns {:.6} times the first, declared {expected}: {verdict} \
                 ({:+.0} ppm)",
                own.shaft,
                own_hz / first_hz,
                1e6 * off
            ));
        }
    }
    Ok(remarks)
}

/// The options with channels by name: numbers change as channels are taken out.
fn named(options: &TachOptions, runs: &[Group]) -> TachOptions {
    let name = |source: &String| {
        let index = source.parse::<usize>().ok().and_then(|number| number.checked_sub(1));
        let own = index.and_then(|index| runs.first().and_then(|run| run.names.get(index)));
        own.cloned().unwrap_or_else(|| source.clone())
    };
    TachOptions { sources: options.sources.iter().map(name).collect(), ..options.clone() }
}
