//! The steps of the numbers that a file held, and how many of them a channel used.
//!
//! The typical level is taken from the range that 98 % of the samples keep to: a few spikes do not touch it, while for
//! a sine and for noise it gives the standard deviation. Steps are looked for among the first values only.

/// Typical level over quantisation noise below which a channel is worth a remark, dB.
pub const POOR_DB: f64 = 30.0;
/// Range of 98 % of a normal variable, in standard deviations.
const RANGE: f64 = 4.653;
/// Values that steps are looked for among, and the share of them that may differ where there are steps.
const MAX_PROBED_VALUES: usize = 100_000;
const DISTINCT_SHARE: f64 = 0.25;

/// Standard deviation of what 98 % of the samples keep to.
pub fn level(channel: &[f64]) -> f64 {
    let mut values = channel.to_vec();
    if values.is_empty() {
        return 0.0;
    }
    let place = |share: f64| ((channel.len() - 1) as f64 * share).round() as usize;
    let (below, &mut high, _) = values.select_nth_unstable_by(place(0.99), f64::total_cmp);
    let low = match below {
        [] => high,
        below => *below.select_nth_unstable_by(place(0.01), f64::total_cmp).1,
    };
    (high - low) / RANGE
}

/// The step of the numbers that a file held; none where hardly any two are alike.
pub fn of_source(channel: &[f64]) -> Option<f64> {
    let mut values = channel.get(..MAX_PROBED_VALUES.min(channel.len()))?.to_vec();
    values.sort_by(f64::total_cmp);
    values.dedup();
    let few = values.len() > 2 && (values.len() as f64) < DISTINCT_SHARE * channel.len().min(MAX_PROBED_VALUES) as f64;
    few.then(|| values.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min))
}

/// What to say of a channel that used few of the steps of its own file.
pub fn judge(name: &str, level: f64, step: f64) -> Option<String> {
    let snr_db = over_quantisation(level, step);
    (level > 0.0 && snr_db < POOR_DB).then(|| {
        format!(
            "channel {name}: its typical level takes {:.1} steps of the file's own numbers ({snr_db:.0} dB over \
             quantisation): a higher gain or a more sensitive sensor measures more of it",
            level / step
        )
    })
}

/// Typical level over the noise of codes of a step, dB.
pub fn over_quantisation(level: f64, step: f64) -> f64 {
    20.0 * (level / step * 12.0_f64.sqrt()).log10()
}
