//! What 16 bits leave of a signal: its typical level against the step of the codes.
//!
//! The full scale follows the highest peak, the quality of the record the level that the signal has most of the time.
//! One spike of a billion would turn the rest into zeros, and a mean square, which the spike rules, would not show
//! it. The typical level is therefore taken from the range that 98 % of the samples keep to: a few spikes do not
//! touch it, while for a sine and for noise it gives the standard deviation.

use crate::{Error, Result};

/// Typical level over quantisation noise below which nothing useful is left, dB: the level is then about one step.
const USELESS_DB: f64 = 10.0;
/// And below which it is worth a remark, dB.
const POOR_DB: f64 = 30.0;
/// Range of 98 % of a normal variable, in standard deviations.
const RANGE: f64 = 4.653;
/// Peaks this many typical levels high are spikes: impacts of damaged bearings stay below it.
const SPIKE: f64 = 1e3;

/// One channel beside the codes it will have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Resolution {
    /// Typical level over quantisation noise, dB; minus infinity for a constant.
    pub snr_db: f64,
    /// Typical level: standard deviation of what 98 % of the samples keep to.
    pub level: f64,
    /// Sample that lies farthest from zero.
    peak_at: usize,
    peak: f64,
}

/// Measures a channel for codes of this step.
pub(super) fn resolution(channel: &[f64], step: f64) -> Resolution {
    let mut values = channel.to_vec();
    let place = |share: f64| ((channel.len() - 1) as f64 * share).round() as usize;
    let (below, &mut high, _) = values.select_nth_unstable_by(place(0.99), f64::total_cmp);
    let low = match below {
        [] => high,
        below => *below.select_nth_unstable_by(place(0.01), f64::total_cmp).1,
    };
    let level = (high - low) / RANGE;
    let peak_at = (0..channel.len()).max_by(|&a, &b| channel[a].abs().total_cmp(&channel[b].abs())).unwrap_or(0);
    Resolution { snr_db: over_quantisation(level, step), level, peak_at, peak: channel[peak_at] }
}

/// Values that steps of the file are looked for among, and the share of them that may differ where it has steps.
const LOOKED_AT: usize = 100_000;
const DISTINCT_SHARE: f64 = 0.25;

/// The step of the numbers that a file holds; none where hardly any two are alike.
pub(super) fn source_step(channel: &[f64]) -> Option<f64> {
    let mut values = channel.get(..LOOKED_AT.min(channel.len()))?.to_vec();
    values.sort_by(f64::total_cmp);
    values.dedup();
    let few = values.len() > 2 && (values.len() as f64) < DISTINCT_SHARE * channel.len().min(LOOKED_AT) as f64;
    few.then(|| values.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min))
}

/// What to say of a channel that used few of the steps of its own file.
pub(super) fn judge_source(label: &str, name: &str, level: f64, step: f64) -> Option<String> {
    let snr_db = over_quantisation(level, step);
    (level > 0.0 && snr_db < POOR_DB).then(|| {
        format!(
            "{label}: channel {name}: its typical level takes {:.1} steps of the file's own numbers ({snr_db:.0} dB \
             over quantisation): a higher gain or a more sensitive sensor measures more of it",
            level / step
        )
    })
}

/// Typical level over the noise of codes of a step, dB.
pub(super) fn over_quantisation(level: f64, step: f64) -> f64 {
    20.0 * (level / step * 12.0_f64.sqrt()).log10()
}

/// What the user should know of a channel; nothing for a well resolved one.
///
/// # Errors
/// A channel of which the codes hold nothing, with the figures and the reason.
pub(super) fn judge(
    label: &str,
    name: &str,
    found: &Resolution,
    full_scale: f64,
    given: bool,
) -> Result<Option<String>> {
    let Resolution { snr_db, level, peak_at, peak } = *found;
    if level == 0.0 {
        return Ok(Some(format!("{label}: channel {name} is constant in 98 % of its samples")));
    }
    if snr_db >= POOR_DB {
        return Ok(None);
    }
    let steps = level / (full_scale / crate::record::CODE_MAX);
    let why = if given {
        "give a smaller --full-scale".to_string()
    } else if peak.abs() > SPIKE * level {
        format!("sample {peak_at} of {peak:.3e} sets the full scale: repair it in the file")
    } else {
        "another channel sets the full scale: import it by itself".to_string()
    };
    let what = format!(
        "channel {name}: at full scale {full_scale:.3e} its typical level of {level:.3e} takes {steps:.1e} code \
         steps ({snr_db:.0} dB over \
         quantisation); {why}, or keep float samples with --float"
    );
    if snr_db < USELESS_DB { Err(Error::invalid(label, what)) } else { Ok(Some(format!("{label}: {what}"))) }
}
