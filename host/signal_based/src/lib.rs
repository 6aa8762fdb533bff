//! The loop on measured records: what tooth counts and a speed reference say, without a machine's equations.
//!
//! 1. [`preflight`]: which inference a record allows, and what is missing for the next.
//! 2. [`scene`], [`crate::analysis::jitter`], [`crate::analysis::mesh_phase`], [`split`]: every channel at equal angles
//!    without the tach's jitter, those of the mesh lines where the tach does not follow; a quarter of the turns held
//!    out, and every second of many channels.
//! 3. [`baseline`]: mesh harmonics behind an unknown path, constant (declared) or moving with the speed (calibrated),
//!    each line as [`basis_selection`] has it, through the [`pole_search`] of a run-up.
//! 4. [`families`], [`search`], [`secondary_lines`]: structured families of lines in what is left (in a run-up less
//!    mesh lines as they move, [`mesh_line_tracking`]), each scored by its evidence ([`evidence`]) and let pass by one
//!    gate ([`accept`]), then looked at for a simpler reading ([`plausibility`]), what is slow on all turns at once
//!    ([`full_record_check`]); what they have besides ([`remaining_shaft_orders`]); what no other family may claim
//!    ([`excluded_lines`]). Impacts that follow no shaft, in squared envelopes ([`impacts`]). A slow swing of the load
//!    is looked for in the [`mesh_amplitude_demodulation`] of all lines.
//! 5. [`errors`], [`holdout_test`]: what the families predict on the turns not used, as a waveform where phases follow
//!    a shaft, as power where they slip ([`predicted_power`]), a bearing's base read anew ([`bearing_slip`]); a veto.
//!    [`explained_power_bound`]: what their lines hold at most.
//! 6. [`motor_slip`]: the speed against a declared load, and the supply that it slips against.
//! 7. [`limits`]: what of the library would have been found here, at [`injection_sites`] drawn and against the
//!    [`screening`] that the search has before it. [`naming`], [`outcome`], [`view`], [`report`]: words, JSON, page.
//!
//! Angle, spectra, floors, line search and averages are the analysis'. Cost: a 20 s record of three channels takes
//! some ten seconds.

pub mod accept;
pub mod amplitudes;
pub mod baseline;
pub mod basis;
pub mod basis_selection;
pub mod bearing_slip;
pub mod candidate;
pub mod clipping_detector;
pub mod errors;
pub mod evidence;
pub mod excluded_lines;
pub mod explained_power_bound;
pub mod families;
pub mod full_record_check;
pub mod gearing;
pub mod holdout_test;
pub mod impacts;
pub mod injection_sites;
pub mod letter;
pub mod limits;
pub mod line_axis;
pub mod mesh_amplitude_demodulation;
pub mod mesh_line_tracking;
pub mod mesh_order_check;
pub mod motor_slip;
pub mod naming;
pub mod nonsynchronous;
pub mod outcome;
pub mod outcome_builder;
pub mod path_angle;
pub mod plausibility;
pub mod pole_fit;
pub mod pole_search;
pub mod predicted_power;
pub mod preflight;
pub mod remaining_shaft_orders;
pub mod report;
pub mod residual_spectra;
pub mod scene;
pub mod screening;
pub mod search;
pub mod second_pass;
pub mod secondary_lines;
pub mod shaft;
pub mod spectra;
pub mod speed_sweep;
pub mod split;
pub mod swept_mode;
pub mod view;

use crate::record::Record;
use outcome::Outcome;
use preflight::Preflight;
use scene::Scene;
use search::Adopted;

/// A rig of one shaft is a pair of one tooth: its "mesh harmonics" are the shaft's own orders.
const NO_GEARS: [u32; 2] = [1, 1];

/// How often the search is made again without what the held-out turns veto.
const VETO_ROUNDS: usize = 2;

/// Runs signal-based inference on a record.
///
/// # Errors
/// A record without tooth counts, tach or enough turns; more points than the budget.
pub fn run(record: &Record, preflight: &Preflight) -> Result<Outcome> {
    let place = record.folder.join("record.toml");
    let missing = || Error::invalid(place.display(), "has no tooth counts");
    let declaration = &record.declaration;
    let tach = record.require_tach()?;
    let mut scene = match declaration.train()? {
        Some(train) => Scene::of_train(record, tach, &train)?,
        None if declaration.has_no_gears() => Scene::of(record, tach, NO_GEARS)?,
        None => Scene::of(record, tach, declaration.teeth().ok_or_else(missing)?)?,
    };
    let baseline = path_angle::fitted(&mut scene);
    let declared = impacts::declared::of_record(record, &scene)?;
    let fit = residual_spectra::views(&scene, &baseline.calibrated, |split| &split.fit, None);
    let own = mesh_order_check::spectra(&scene, |split| &split.fit);
    let misplaced = if declaration.has_no_gears() { None } else { mesh_order_check::finding(&scene, &own) };
    let mut impacts =
        if misplaced.is_some() { Vec::new() } else { impacts::find(&scene, &baseline.calibrated, &declared) };
    let mut found = if misplaced.is_some() { search::nothing(&scene, &fit) } else { search::search(&scene, &fit) };
    let rest = secondary_lines::carry(&mut found, &scene, &fit);
    let held_out = scene.runs.iter().all(|run| !run.split.held_out.is_empty());
    let held = if held_out {
        residual_spectra::views(&scene, &baseline.calibrated, |split| &split.held_out, Some(&fit))
    } else {
        residual_spectra::views(&scene, &baseline.calibrated, |split| &split.fit, Some(&fit))
    };
    let views = [&fit, &held];
    let passed: Vec<&Adopted> = rest.iter().filter(|own| own.verdict.refused.is_none()).collect();
    let judges = held_out && misplaced.is_none();
    if judges {
        second_pass::search_marginal(&mut found, &passed, &scene, views);
        bearing_slip::read(&mut found.adopted, &passed, &scene, views);
    }
    let worths_of = |adopted: &[Adopted]| {
        let all: Vec<&Adopted> = adopted.iter().chain(passed.iter().copied()).collect();
        holdout_test::worths(&scene, &baseline, views, &all)
    };
    let mut worths = worths_of(&found.adopted);
    let mut vetoed_before: Vec<(Adopted, holdout_test::HoldoutResult)> = Vec::new();
    for _ in 0..VETO_ROUNDS * usize::from(judges) {
        let judged = found.adopted.iter().cloned().zip(worths.iter().copied());
        let (kept, vetoed): (Vec<_>, Vec<_>) = judged.partition(|(own, worth)| holdout_test::passes(own, worth));
        if vetoed.is_empty() {
            break;
        }
        let families = [&kept, &vetoed].map(|of| of.iter().map(|(own, _)| own.clone()).collect());
        vetoed_before.extend(vetoed);
        let finds = second_pass::search_after_veto(&mut found, families, &passed, &scene, views);
        if finds {
            bearing_slip::read(&mut found.adopted, &passed, &scene, views);
        }
        worths = worths_of(&found.adopted);
        if !finds {
            break;
        }
    }
    let all: Vec<&Adopted> = found.adopted.iter().chain(passed.iter().copied()).collect();
    let (mut kept, mut vetoed): (Vec<_>, Vec<_>) =
        all.into_iter().zip(worths).partition(|(a, worth)| !held_out || holdout_test::passes(a, worth));
    vetoed.extend(vetoed_before.iter().map(|(own, worth)| (own, *worth)));
    let families = remaining_shaft_orders::families(&kept, &rest);
    kept.retain(|(own, _)| remaining_shaft_orders::is_wanted(own, &rest, &families));
    let is_image =
        |own: &impacts::Impacts| kept.iter().chain(&vetoed).any(|(a, _)| outcome_builder::modulates_the_mesh(a, own));
    impacts.retain(|own| own.bearing.is_some() || !is_image(own));
    let adopted: Vec<&Adopted> = kept.iter().map(|(a, _)| *a).collect();
    let predicts = |(own, worth): &&(&Adopted, holdout_test::HoldoutResult)| {
        let pays = !remaining_shaft_orders::is_among(&rest, own) || worth.gain > 0.0;
        !held_out || !own.candidate.locked || holdout_test::predicts_waveform(own, worth) && pays
    };
    let predicting: Vec<&Adopted> = kept.iter().filter(predicts).map(|(a, _)| *a).collect();
    let corrected = errors::correct(&scene, &baseline, &fit, &predicting);
    let mut errors = errors::errors(&scene, &baseline, &corrected, (views, &own), &adopted);
    let own_held = mesh_order_check::spectra(&scene, |split| if held_out { &split.held_out } else { &split.fit });
    let named = explained_power_bound::of(&scene, &own_held, views, &adopted);
    errors.per_channel.iter_mut().zip(named).for_each(|(channel, named)| channel.named_lines = named);
    let named: Vec<&Adopted> = families.iter().map(|(a, _)| *a).collect();
    let limits = limits::limits(&scene, &baseline, &fit, &found, &named);
    let parts = outcome_builder::Parts {
        scene: &scene,
        baseline: &baseline,
        views: &fit,
        corrected: &corrected,
        search: &found,
        rest: &rest,
        impacts: &impacts,
    };
    let mut outcome = outcome_builder::outcome(&parts, &families, &vetoed, errors, limits, preflight);
    outcome.slip = motor_slip::law(record, &scene);
    Ok(match misplaced {
        Some(finding) => outcome.abstaining(finding),
        None => outcome,
    })
}

use meshband_analysis::analysis;
use meshband_common::{Error, Result, budget, terminal, text};
use meshband_mechanics::machine;
use meshband_record::record;
use meshband_signal::spectral;
use meshband_train as train;
