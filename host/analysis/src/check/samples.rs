//! Rules on the samples alone: units, dead and doubled channels and runs, dropouts, spikes, limits.

use super::Checked;
use super::finding::{Finding, Kind, Severity, channel_name};
use crate::observation::input::Run;
use rayon::prelude::*;

/// Largest acceleration taken for one, m/s2: a hundred thousand g.
const LARGEST_M_S2: f64 = 1e6;
/// Distinct values up to which a channel does not move: the last digit's flicker.
const FEWEST_VALUES: usize = 4;
/// Share of a signal's power that is its own beside another signal's, below which the two are one. Channels and runs
/// with noise of their own differ by its share of the power, which is above 1e-3 on anything measured.
const LEAST_OWN_SHARE: f64 = 1e-4;
/// Change of level up to which two runs carry the same signal; a linear machine without noise gives scaled runs at
/// other torques.
const SAME_LEVEL: f64 = 1e-3;
/// Stand-still that is no limit's flat top, s.
const LONGEST_FLAT_S: f64 = 4e-3;
/// Second difference of a spike over the robust spread of all.
const SPIKE_OVER_SPREAD: f64 = 12.0;
/// Samples at the very extreme from which they pile up.
const MIN_PILE_SAMPLES: usize = 8;

/// Applies all rules on samples.
pub fn check(checked: &mut Checked) {
    unit(checked);
    let rules: [fn(&mut Checked); 5] = [absurd, dead, same_channels, same_runs, dropouts];
    for rule in rules {
        if checked.findings.refused() {
            return;
        }
        rule(checked);
        checked.set_aside();
    }
    if !checked.findings.refused() {
        limited(checked);
        spikes(checked);
    }
}

fn unit(checked: &mut Checked) {
    let unit = checked.record.unit.clone();
    if !["m/s2", "m/s^2", "m/s\u{b2}", "g"].contains(&unit.as_str()) {
        let text = format!(
            "the channels' unit is declared as '{unit}': the declared machine predicts accelerations, so the loop \
             needs m/s2 or g"
        );
        checked.findings.add(Finding::new(Severity::Refuse, Kind::Unit, f64::NAN, f64::NAN, "", text));
    }
}

fn absurd(checked: &mut Checked) {
    for channel in 0..2 {
        let peaks: Vec<f64> = checked.record.runs.iter().map(|run| peak(&run.channels[channel])).collect();
        let places = places(&peaks, |p| p.is_nan() || *p > LARGEST_M_S2);
        let figure = peaks.iter().fold(0.0_f64, |a, b| if b.is_nan() { *b } else { a.max(*b) });
        let text = format!(
            "{} reaches {figure:.3e} m/s2 {}: no acceleration of a machine; full scale or unit?",
            channel_name(channel),
            checked.in_runs(&places)
        );
        let finding = Finding::new(Severity::Refuse, Kind::Absurd, figure, LARGEST_M_S2, "m/s2", text);
        checked.add_for_runs(&places, Severity::Refuse, Severity::Refuse, finding.in_channel(channel));
    }
}

fn dead(checked: &mut Checked) {
    for channel in 0..2 {
        let values: Vec<usize> = checked.record.runs.iter().map(|run| distinct(&run.channels[channel])).collect();
        let places = places(&values, |n| *n <= FEWEST_VALUES);
        let fewest = values.iter().copied().min().unwrap_or(0);
        let zero = places.iter().all(|&r| peak(&checked.record.runs[r].channels[channel]) == 0.0);
        let what = if zero { "is zero" } else { "does not move" };
        let text = format!("{} is dead: it {what} {}", channel_name(channel), checked.in_runs(&places));
        let finding = Finding::new(Severity::Refuse, Kind::Dead, fewest as f64, FEWEST_VALUES as f64, "values", text);
        checked.add_for_runs(&places, Severity::SetAside, Severity::Refuse, finding.in_channel(channel));
    }
}

fn same_channels(checked: &mut Checked) {
    let pairs: Vec<(f64, f64)> =
        checked.record.runs.par_iter().map(|run| own_share(&run.channels[0], &run.channels[1])).collect();
    let places = places(&pairs, |(own, _)| *own < LEAST_OWN_SHARE);
    let Some(&first) = places.first() else { return };
    let text = format!(
        "both channels carry one signal (channel 2 is {:.4} times channel 1) {}",
        pairs[first].1,
        checked.in_runs(&places)
    );
    let finding = Finding::new(Severity::Refuse, Kind::SameChannels, pairs[first].0, LEAST_OWN_SHARE, "of power", text);
    checked.add_for_runs(&places, Severity::SetAside, Severity::Refuse, finding);
}

fn same_runs(checked: &mut Checked) {
    let runs = &checked.record.runs;
    let pairs: Vec<(usize, usize)> = (0..runs.len()).flat_map(|b| (0..b).map(move |a| (a, b))).collect();
    let same: Vec<(usize, usize)> = pairs.into_par_iter().filter(|&(a, b)| same(&runs[a], &runs[b])).collect();
    // Which of two is the copy, its own tach says: the run whose mesh stands at its speed stays.
    let mut out: Vec<usize> = Vec::new();
    let mut words = Vec::new();
    for &(a, b) in &same {
        if out.contains(&a) || out.contains(&b) {
            continue;
        }
        let level = |r: usize| super::mesh::level_as_declared(&checked.record, r);
        let (copy, kept) = if level(b) > level(a) + 0.5 { (a, b) } else { (b, a) };
        let file = if runs[a].name == runs[b].name { " (one file)" } else { "" };
        words.push(format!("run {} is run {}{file}", checked.runs[copy], checked.runs[kept]));
        out.push(copy);
    }
    out.sort_unstable();
    let text = format!("signals stored twice: {}; errors and probabilities assume independent runs", words.join(", "));
    let finding = Finding::new(Severity::SetAside, Kind::SameRuns, out.len() as f64, 0.0, "runs", text);
    checked.add_for_runs(&out, Severity::SetAside, Severity::Refuse, finding);
}

fn same(a: &Run, b: &Run) -> bool {
    let level = |x: &[f64]| power(x).1.sqrt();
    (0..2).all(|c| {
        let (x, y) = (&a.channels[c], &b.channels[c]);
        let n = x.len().min(y.len());
        (level(&x[..n]) / level(&y[..n]).max(1e-300) - 1.0).abs() < SAME_LEVEL
            && own_share(&x[..n], &y[..n]).0 < LEAST_OWN_SHARE
            && own_share(&x[..n], &y[..n]).1 > 0.0
    })
}

fn dropouts(checked: &mut Checked) {
    let longest = (LONGEST_FLAT_S * checked.record.sample_rate_hz) as usize;
    for channel in 0..2 {
        let flats: Vec<(usize, usize)> =
            checked.record.runs.par_iter().map(|run| flattest(&run.channels[channel])).collect();
        let places = places(&flats, |(_, length)| *length > longest);
        let Some(&worst) = places.iter().max_by_key(|&&r| flats[r].1) else { continue };
        let rate = checked.record.sample_rate_hz;
        let (at, length) = (flats[worst].0 as f64 / rate, flats[worst].1 as f64 / rate);
        let text = format!(
            "{} drops out {}: it stands still for up to {:.1} ms (run {} at {at:.3} s)",
            channel_name(channel),
            checked.in_runs(&places),
            1e3 * length,
            checked.runs[worst]
        );
        let finding = Finding::new(Severity::Refuse, Kind::Dropout, length, LONGEST_FLAT_S, "s", text);
        checked.add_for_runs(&places, Severity::SetAside, Severity::Refuse, finding.in_channel(channel));
        checked.set_aside();
    }
}

fn limited(checked: &mut Checked) {
    for channel in 0..2 {
        let runs = &checked.record.runs;
        let all = || runs.iter().flat_map(|run| &run.channels[channel]);
        let top = all().fold(0.0_f64, |m, x| m.max(x.abs()));
        let at = all().filter(|x| x.abs() >= (1.0 - 1e-9) * top).count();
        let below = all().filter(|x| (0.98 * top..(1.0 - 1e-9) * top).contains(&x.abs())).count();
        let rails = runs.iter().map(|run| run.clipped_share).fold(0.0, f64::max);
        if at >= MIN_PILE_SAMPLES && 2 * at > below {
            let rail = if rails > 0.0 { ", the end of the code range" } else { "" };
            let text = format!(
                "{} is limited at {top:.4} m/s2{rail}: {at} samples stand exactly there",
                channel_name(channel)
            );
            let limit = MIN_PILE_SAMPLES as f64;
            let finding = Finding::new(Severity::Say, Kind::Limited, at as f64, limit, "samples", text);
            let places: Vec<usize> = (0..runs.len()).filter(|&r| peak(&runs[r].channels[channel]) == top).collect();
            checked.add_for_runs(&places, Severity::Say, Severity::Say, finding.in_channel(channel));
        }
    }
}

fn spikes(checked: &mut Checked) {
    for channel in 0..2 {
        let found: Vec<Vec<usize>> =
            checked.record.runs.par_iter().map(|run| spikes_of(&run.channels[channel])).collect();
        let places = places(&found, |spikes| !spikes.is_empty());
        let count: usize = found.iter().map(Vec::len).sum();
        for &r in &places {
            let x = &mut checked.record.runs[r].channels[channel];
            found[r].iter().for_each(|&n| x[n] = (4.0 * (x[n - 1] + x[n + 1]) - x[n - 2] - x[n + 2]) / 6.0);
        }
        let text = format!(
            "{} has {count} single samples far from their neighbours {}: replaced by interpolation",
            channel_name(channel),
            checked.in_runs(&places)
        );
        let finding = Finding::new(Severity::Say, Kind::Spikes, count as f64, 0.0, "samples", text);
        checked.add_for_runs(&places, Severity::Say, Severity::Say, finding.in_channel(channel));
    }
}

/// Samples that stand alone: a second difference far out, with half of it on either side.
fn spikes_of(x: &[f64]) -> Vec<usize> {
    let bend = |n: usize| x[n] - 0.5 * (x[n - 1] + x[n + 1]);
    if x.len() < 8 {
        return Vec::new();
    }
    let mut sizes: Vec<f64> = (1..x.len() - 1).map(|n| bend(n).abs()).collect();
    let middle = sizes.len() / 2;
    let spread = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 / 0.6745;
    let alone = |n: usize| {
        let d = bend(n);
        let side = |m: usize| (bend(m) + 0.5 * d).abs() < 0.25 * d.abs();
        d.abs() > SPIKE_OVER_SPREAD * spread && side(n - 1) && side(n + 1)
    };
    (3..x.len() - 3).filter(|&n| alone(n)).collect()
}

/// Start and length of the longest stretch of equal samples.
fn flattest(x: &[f64]) -> (usize, usize) {
    let (mut from, mut best) = (0, (0, 0));
    for n in 1..=x.len() {
        if n == x.len() || x[n] != x[from] {
            if n - from > best.1 {
                best = (from, n - from);
            }
            from = n;
        }
    }
    best
}

fn places<T>(values: &[T], wrong: impl Fn(&T) -> bool) -> Vec<usize> {
    (0..values.len()).filter(|&r| wrong(&values[r])).collect()
}

fn peak(x: &[f64]) -> f64 {
    x.iter().fold(0.0_f64, |peak, v| if v.is_nan() || peak.is_nan() { f64::NAN } else { peak.max(v.abs()) })
}

/// Number of distinct values, counted no further than needed.
fn distinct(x: &[f64]) -> usize {
    let mut seen: Vec<f64> = Vec::new();
    for &value in x {
        if !seen.contains(&value) {
            seen.push(value);
            if seen.len() > FEWEST_VALUES {
                break;
            }
        }
    }
    seen.len()
}

/// Mean and mean square about it.
fn power(x: &[f64]) -> (f64, f64) {
    let n = x.len().max(1) as f64;
    let mean = x.iter().sum::<f64>() / n;
    (mean, x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n)
}

/// Share of the power of `y` that is not `x` times a factor, and that factor.
fn own_share(x: &[f64], y: &[f64]) -> (f64, f64) {
    let ((mx, px), (my, py)) = (power(x), power(y));
    let both = x.iter().zip(y).map(|(a, b)| (a - mx) * (b - my)).sum::<f64>() / x.len().max(1) as f64;
    (1.0 - both * both / (px * py).max(1e-300), both / px.max(1e-300))
}
