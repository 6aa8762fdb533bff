//! What the owner declares beside the files: what a source's largest number stands for, torques, the machine.

use super::grouped::Group;
use super::{Columns, ImportOptions};
use crate::machine::Machine;
use crate::record::{Acquisition, Declaration, Tach};
use crate::{Error, Result, budget, text};
use std::path::{Path, PathBuf};

/// Reads full scales from a csv file: one row per channel, the value in the last cell; a first row without a number
/// is a header.
///
/// # Errors
/// An unreadable file, a cell that is no positive number, no row at all.
pub fn read_full_scales(path: &Path) -> Result<Vec<f64>> {
    let content = budget::read_text(path)?;
    let mut scales = Vec::new();
    for (i, line) in content.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let cell = line.rsplit([',', ';', '\t']).next().unwrap_or_default().trim();
        match cell.parse::<f64>() {
            Ok(scale) if scale.is_finite() && scale > 0.0 => scales.push(scale),
            Err(_) if i == 0 => {}
            _ => {
                let what = format!("{} is no positive full scale", text::quoted(cell));
                return Err(Error::invalid(format!("{}:{}", path.display(), i + 1), what));
            }
        }
    }
    if scales.is_empty() {
        return Err(Error::invalid(path.display(), "holds no full scale"));
    }
    Ok(scales)
}

/// Turns integers into shares of their largest number, where full scales are declared.
///
/// # Errors
/// A source of floats, which states its own values.
pub(super) fn shares(files: &[PathBuf], sources: &mut [Columns], options: &ImportOptions) -> Result<()> {
    if options.source_full_scale.is_empty() {
        return Ok(());
    }
    for (file, source) in files.iter().zip(sources) {
        let Some(largest) = source.largest else {
            let what = format!("{} holds no integers of a known range, its numbers are values", file.display());
            return Err(Error::invalid("--source-full-scale", what));
        };
        source.channels.iter_mut().flatten().for_each(|x| *x /= largest);
    }
    Ok(())
}

/// Turns shares into the source's unit, every channel by its own full scale.
///
/// # Errors
/// Neither one full scale nor one for each channel.
pub(super) fn scaled(runs: &mut [Group], options: &ImportOptions) -> Result<()> {
    let (scales, channels) = (&options.source_full_scale, runs[0].channels.len());
    if scales.is_empty() {
        return Ok(());
    }
    if ![1, channels].contains(&scales.len()) {
        let what = format!("{} values for {channels} channels (without the tachometer)", scales.len());
        return Err(Error::invalid("--source-full-scale", what));
    }
    if let Some(scale) = scales.iter().find(|scale| !(scale.is_finite() && **scale > 0.0)) {
        return Err(Error::invalid("--source-full-scale", format!("{scale} is not a positive number")));
    }
    for (c, channel) in runs.iter_mut().flat_map(|run| run.channels.iter_mut().enumerate()) {
        channel.iter_mut().for_each(|x| *x *= scales[c % scales.len()]);
    }
    Ok(())
}

/// Torque of run `run` of `runs`.
///
/// # Errors
/// Neither one torque nor one for each run, and one that is no number.
pub(super) fn torque(options: &ImportOptions, run: usize, runs: usize) -> Result<Option<f64>> {
    let torques = &options.torques_n_m;
    if torques.is_empty() {
        return Ok(None);
    }
    if ![1, runs].contains(&torques.len()) {
        return Err(Error::invalid("--torque", format!("{} values for {runs} runs", torques.len())));
    }
    let torque = torques[run % torques.len()];
    if !torque.is_finite() {
        return Err(Error::invalid("--torque", format!("{torque} N m is not a finite number")));
    }
    Ok(Some(torque))
}

/// Load of run `run` of `runs`.
///
/// # Errors
/// Not one load for each run, and one that is no number.
pub(super) fn load(options: &ImportOptions, run: usize, runs: usize) -> Result<Option<f64>> {
    let loads = &options.loads;
    if loads.is_empty() {
        return Ok(None);
    }
    if loads.len() != runs {
        return Err(Error::invalid("--load", format!("{} values for {runs} runs", loads.len())));
    }
    if !loads[run].is_finite() {
        return Err(Error::invalid("--load", format!("{} is not a finite number", loads[run])));
    }
    Ok(Some(loads[run]))
}

/// Times of a pulse per turn at a constant speed, from the first sample to the last.
///
/// # Errors
/// A speed that is no positive number, or fewer than two turns.
pub(super) fn nominal_edges(speed_hz: f64, length_s: f64) -> Result<Vec<f64>> {
    let turns = length_s * speed_hz;
    if !(speed_hz.is_finite() && speed_hz > 0.0 && (2.0..1e7).contains(&turns)) {
        let what = format!("{} rpm is no speed of a shaft recorded for {length_s} s", 60.0 * speed_hz);
        return Err(Error::invalid("--speed", what));
    }
    Ok((0..=turns as usize).map(|i| i as f64 / speed_hz).collect())
}

/// The record's declaration: the whole machine where it is declared, else the tooth counts.
///
/// # Errors
/// As [`Declaration::of_machine`].
pub(super) fn declaration(
    options: &ImportOptions,
    acquisition: Acquisition,
    tach: Option<Tach>,
) -> Result<(Declaration, PathBuf)> {
    let (mut declaration, folder) = match &options.machine {
        Some(machine) => {
            let mut declaration = Declaration::of_machine(machine, acquisition, tach)?;
            declaration.rest.insert("title".into(), options.title.clone().into());
            (declaration, machine.folder.clone())
        }
        None => {
            let mut declaration = Declaration::of_import(&options.title, options.teeth, acquisition, tach);
            if options.no_gears {
                declaration.declare_no_gears();
            }
            if let Some(train) = &options.train {
                declaration.rest.extend(train.declaration.tables()?);
            }
            (declaration, PathBuf::from("."))
        }
    };
    declaration.declare_bearings(&options.bearings)?;
    Ok((declaration, folder))
}

/// Tooth counts: those of the machine, which must not contradict those given.
///
/// # Errors
/// Two pairs of counts that differ.
pub fn teeth(machine: Option<&Machine>, given: Option<[u32; 2]>) -> Result<Option<[u32; 2]>> {
    match (machine.map(|machine| machine.pair.teeth), given) {
        (Some(own), Some(given)) if own != given => {
            let what = format!("{},{} are not those of the machine, {},{}", given[0], given[1], own[0], own[1]);
            Err(Error::invalid("--teeth", what))
        }
        (own, given) => Ok(own.or(given)),
    }
}
