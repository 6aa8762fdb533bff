//! Rules against the declared machine's prediction: order, sign and delay of the channels, lag of the tach, level,
//! torques, pass band.
//!
//! The complex amplitudes of the mesh harmonics are compared with those of the harmonic balance, over all runs.
//! Agreement is the cosine between the two, so that a wrong level does not count; a lag turns every harmonic in
//! proportion to its frequency, and runs at several speeds tell a lag in time from one in angle. What the declaration
//! leaves uncertain (tolerances, undeclared effects) lowers the agreement a little and is no reason for a finding:
//! something else must agree much better.

use super::Checked;
use super::compared::{Compared, Lag, pooled};
use super::finding::{Finding, Kind, Severity, channel_name};
use super::levels;

/// Cost of a wrong ratio of the channels' levels, per unit of its logarithm.
const LEVEL_COST: f64 = 0.2;
/// Fall of cost from which the channels are swapped.
const SWAP_GAIN: f64 = 0.3;
/// Agreement from which a channel with the other sign is inverted.
const MIN_INVERTED_AGREEMENT: f64 = 0.7;
/// Smallest lag of the tach that is said, s.
const LEAST_LAG_S: f64 = 4e-6;
/// Smallest delay of a channel that is said here, samples; the loop names smaller ones.
const LEAST_DELAY_SAMPLES: f64 = 2.5;
/// Share of the disagreement that a lag must leave at most.
const MAX_DISAGREEMENT_SHARE: f64 = 0.5;
/// Gain of agreement from which a lag is one in angle, or each run's own.
const OTHER_LAG_GAIN: f64 = 0.05;
/// Agreement that each run's own lag must reach to be believed.
const OWN_LAG_AGREEMENT: f64 = 0.8;

/// Applies the rules in turn; what is mended by one is seen by the next.
pub fn check(checked: &mut Checked) {
    let mut runs = Compared::of(&checked.record);
    swapped(checked, &mut runs);
    inverted(checked, &mut runs);
    lagging(checked, &mut runs);
    delayed(checked, &mut runs);
    levels::check(checked, &runs);
}

fn swapped(checked: &mut Checked, runs: &mut [Compared]) {
    let cost = |runs: &[Compared]| {
        let agreement = pooled::strongest(runs, 0) + pooled::strongest(runs, 1);
        let gain = [0, 1].map(|c| pooled::gain(runs, c));
        2.0 - agreement + LEVEL_COST * (gain[0] / gain[1]).ln().abs()
    };
    let straight = cost(runs);
    runs.iter_mut().for_each(Compared::swap);
    let other = cost(runs);
    if straight - other < SWAP_GAIN {
        runs.iter_mut().for_each(Compared::swap);
        return;
    }
    checked.record.runs.iter_mut().for_each(|run| run.channels.swap(0, 1));
    let text = format!(
        "the channels look swapped: the other order disagrees by {other:.3}, the declared one by {straight:.3}; \
         taken in the other order"
    );
    checked.findings.add(Finding::new(Severity::Say, Kind::Swapped, straight - other, SWAP_GAIN, "", text));
}

fn inverted(checked: &mut Checked, runs: &mut [Compared]) {
    for channel in 0..2 {
        let at_once = pooled::agreement(runs, &[channel], Lag::None);
        if at_once > -MIN_INVERTED_AGREEMENT {
            continue;
        }
        runs.iter_mut().for_each(|run| run.invert(channel));
        for run in &mut checked.record.runs {
            run.channels[channel].iter_mut().for_each(|x| *x = -*x);
        }
        let text = format!(
            "{} is inverted: it agrees with the prediction by {at_once:.3}; taken with the other sign",
            channel_name(channel)
        );
        let finding = Finding::new(Severity::Say, Kind::Inverted, at_once, -MIN_INVERTED_AGREEMENT, "", text);
        checked.findings.add(finding.in_channel(channel));
    }
}

/// A lag that both channels share is the tach's.
fn lagging(checked: &mut Checked, runs: &mut [Compared]) {
    let now = pooled::agreement(runs, &[0, 1], Lag::None);
    let time = pooled::best_in_time(runs, &[0, 1]);
    let angle = pooled::best_in_angle(runs, &[0, 1]);
    let own = pooled::best_of_each(runs);
    let helps = |agreement: f64| 1.0 - agreement < MAX_DISAGREEMENT_SHARE * (1.0 - now);
    if own.1 > time.agreement.max(angle.agreement) + OTHER_LAG_GAIN && own.1 > OWN_LAG_AGREEMENT && helps(own.1) {
        let text = format!(
            "the runs' angle 0 is not where tooth 0 is, elsewhere in every run (agreement with the prediction \
             {now:.3}, each turned on its own {:.3}): turned by less than a tooth each",
            own.1
        );
        let lags = own.0;
        return undo_lag(
            checked,
            runs,
            &lags,
            Finding::new(Severity::Say, Kind::IndexMark, own.1 - now, 0.0, "", text),
        );
    }
    let channels = [0, 1].map(|c| pooled::best_in_time(runs, &[c]).value);
    let shared =
        if channels[0].signum() == channels[1].signum() { channels[0].abs().min(channels[1].abs()) } else { 0.0 };
    if angle.agreement > time.agreement + OTHER_LAG_GAIN && helps(angle.agreement) {
        let teeth = angle.value;
        let text = format!(
            "angle 0 of the pinion is not where tooth 0 is: {teeth:+.4} of a tooth (or that and whole teeth), \
             agreement with the prediction {now:.3}, turned {:.3}; the tach is turned by that",
            angle.agreement
        );
        let lags: Vec<f64> = runs.iter().map(|run| teeth / run.mesh_hz).collect();
        undo_lag(checked, runs, &lags, Finding::new(Severity::Say, Kind::IndexMark, teeth, 0.0, "teeth", text));
    } else if helps(time.agreement) && time.value.abs() > LEAST_LAG_S && shared > LEAST_LAG_S {
        // Where only one channel's delay differs, the smaller of both is the tach's.
        let lag = if (channels[0] - channels[1]).abs() < LEAST_DELAY_SAMPLES / checked.record.sample_rate_hz {
            time.value
        } else {
            shared * channels[0].signum()
        };
        let text = format!(
            "the vibration comes {:+.1} us after the tach in all runs (agreement with the prediction {now:.4}, \
             without that lag {:.4}): delay of the tach, or of the channels, or parameters a little off, which the \
             loop tells apart; the tach is moved by that",
            1e6 * lag,
            time.agreement
        );
        let lags = vec![lag; runs.len()];
        checked.tach_lag_s = Some(lag);
        undo_lag(checked, runs, &lags, Finding::new(Severity::Say, Kind::TachDelay, lag, LEAST_LAG_S, "s", text));
    }
}

fn undo_lag(checked: &mut Checked, runs: &mut [Compared], lags_s: &[f64], finding: Finding) {
    for ((run, compared), &lag) in checked.record.runs.iter_mut().zip(runs).zip(lags_s) {
        run.edges_s.iter_mut().for_each(|t| *t += lag);
        compared.earlier(&[0, 1], lag);
    }
    checked.findings.add(finding);
}

/// A lag of one channel alone, by whole samples; what is left of it is the loop's to name.
fn delayed(checked: &mut Checked, runs: &mut [Compared]) {
    let rate = checked.record.sample_rate_hz;
    for channel in 0..2 {
        let now = pooled::agreement(runs, &[channel], Lag::None);
        let best = pooled::best_in_time(runs, &[channel]);
        let samples = (best.value * rate).round();
        if (best.value * rate).abs() < LEAST_DELAY_SAMPLES
            || 1.0 - best.agreement > MAX_DISAGREEMENT_SHARE * (1.0 - now)
        {
            continue;
        }
        for run in &mut checked.record.runs {
            let (late, count) = (samples > 0.0, samples.abs() as usize);
            let (first, second) = if late { (channel, 1 - channel) } else { (1 - channel, channel) };
            let length = run.channels[0].len().saturating_sub(count);
            run.channels[first].drain(..count.min(length));
            run.channels[second].truncate(length);
            run.channels[first].truncate(length);
            if !late {
                run.edges_s.iter_mut().for_each(|t| *t -= count as f64 / rate);
            }
        }
        runs.iter_mut().for_each(|run| run.earlier(&[channel], samples / rate));
        let text = format!(
            "{} is late by {:.1} samples against the prediction (agreement {now:.3}, without that delay {:.3}); \
             moved by {samples} samples",
            channel_name(channel),
            best.value * rate,
            best.agreement
        );
        let limit = LEAST_DELAY_SAMPLES / rate;
        let finding = Finding::new(Severity::Say, Kind::ChannelDelay, best.value, limit, "s", text);
        checked.findings.add(finding.in_channel(channel));
    }
}
