//! What 16 bits leave of a signal: its typical level against the step of the codes.
//!
//! The full scale follows the highest peak, the quality of the record the level that the signal has most of the time.
//! One spike of a billion would turn the rest into zeros, and a mean square, which the spike rules, would not show
//! it: hence the typical level ([`steps::level`]).

use crate::data_quality::steps::{self, POOR_DB, over_quantisation};
use crate::{Error, Result};

/// Typical level over quantisation noise below which nothing useful is left, dB: the level is then about one step.
const USELESS_DB: f64 = 10.0;
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
    let level = steps::level(channel);
    let peak_at = (0..channel.len()).max_by(|&a, &b| channel[a].abs().total_cmp(&channel[b].abs())).unwrap_or(0);
    Resolution { snr_db: over_quantisation(level, step), level, peak_at, peak: channel[peak_at] }
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
