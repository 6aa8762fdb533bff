//! Rules on levels against the prediction: a factor that is a unit, torques of runs exchanged, nothing above a
//! frequency.

use super::Checked;
use super::compared::{Compared, pooled};
use super::finding::{Finding, Kind, Severity, channel_name, in_runs};

/// Factors on both channels that read as m/s2 for g, or the other way round.
const GRAVITY: std::ops::Range<f64> = 7.5..12.5;
/// Logarithm of a run's level over the others' from which its torque is another run's, where one fits.
const TORQUE_OFF: f64 = 0.25;
/// The same where no other run's torque fits: the library's effects move single runs by up to 0.37
/// (`tests/tests/closed_loop/loop_wrong_records.rs`).
const TORQUE_ODD: f64 = 0.5;
/// Logarithm within which a level fits another run's torque.
const TORQUE_FITS: f64 = 0.12;
/// Width of the bands in which levels are pooled, Hz.
const BAND_HZ: f64 = 500.0;
/// Share of the predicted power, and of the noise below, above which something passes.
const MIN_PASSED_POWER_SHARE: f64 = 0.05;
/// Bands with nothing in them that make the end of a pass band.
const LEAST_BANDS: usize = 4;
/// Share of the frequency where nothing passes any more up to which a chain is taken as flat.
const FLAT_SHARE: f64 = 0.5;

/// Applies the rules on levels.
pub fn check(checked: &mut Checked, runs: &[Compared]) {
    unit(checked, runs);
    // A limited channel has no level.
    if checked.findings.of(Kind::Limited).count() == 0 {
        torques(checked, runs);
    }
    pass_band(checked, runs);
}

fn unit(checked: &mut Checked, runs: &[Compared]) {
    let gains = [0, 1].map(|c| pooled::gain(runs, c));
    let mean = (gains[0] * gains[1]).sqrt();
    if gains.iter().all(|g| GRAVITY.contains(g)) || gains.iter().all(|g| GRAVITY.contains(&(1.0 / g))) {
        let text = format!(
            "both channels' levels are {mean:.3} times the prediction's, and one g is 9.81 m/s2: is the full scale \
             in the wrong unit?"
        );
        checked.findings.add(Finding::new(Severity::Refuse, Kind::Level, mean, GRAVITY.start, "times", text));
    }
}

/// Level of a run over the prediction, both channels.
fn level(run: &Compared) -> f64 {
    let [a, b] = [0, 1].map(|c| run.powers(c));
    0.5 * ((a.0 / a.1.max(1e-300)).ln() + (b.0 / b.1.max(1e-300)).ln()) * 0.5
}

fn torques(checked: &mut Checked, runs: &[Compared]) {
    let levels: Vec<f64> = runs.iter().map(level).collect();
    let mut sorted = levels.clone();
    sorted.sort_by(f64::total_cmp);
    // Median of what most runs have: permuted torques lie on either side.
    let middle = 0.5 * (sorted[(sorted.len() - 1) / 2] + sorted[sorted.len() / 2]);
    let off: Vec<usize> = (0..runs.len()).filter(|&r| (levels[r] - middle).abs() > TORQUE_OFF).collect();
    if off.is_empty() {
        return;
    }
    let declared: Vec<f64> = checked.record.runs.iter().map(|run| run.input_torque_n_m).collect();
    let fits: Vec<f64> = off.iter().map(|&r| declared[r] * (levels[r] - middle).exp()).collect();
    let worst = off.iter().map(|&r| (levels[r] - middle).abs()).fold(0.0, f64::max);
    let ascending = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values
    };
    let own = ascending(off.iter().map(|&r| declared[r]).collect());
    let permuted = ascending(fits.clone()).iter().zip(&own).all(|(a, b)| (a / b).ln().abs() < TORQUE_FITS);
    let named = checked.named(&off);
    let place = in_runs(&named, checked.runs.len());
    if permuted {
        for (&r, fit) in off.iter().zip(&fits) {
            let nearest = own.iter().min_by(|a, b| (*a / fit).ln().abs().total_cmp(&(*b / fit).ln().abs()));
            checked.record.runs[r].input_torque_n_m = nearest.copied().unwrap_or(declared[r]);
        }
        let text = format!(
            "the torques look permuted {place}: levels fit {} N m where {} are declared; taken as the levels have it",
            list(&fits),
            list(&off.iter().map(|&r| declared[r]).collect::<Vec<_>>())
        );
        let finding = Finding::new(Severity::Say, Kind::Torque, worst, TORQUE_OFF, "nats", text);
        checked.findings.add(finding.in_runs(named));
    } else if worst > TORQUE_ODD {
        let text = format!(
            "levels do not fit the declared torques {place}: they fit {} N m where {} are declared",
            list(&fits),
            list(&off.iter().map(|&r| declared[r]).collect::<Vec<_>>())
        );
        let finding = Finding::new(Severity::Say, Kind::Torque, worst, TORQUE_ODD, "nats", text);
        checked.findings.add(finding.in_runs(named).withholding_names());
    }
}

fn list(values: &[f64]) -> String {
    values.iter().map(|v| format!("{v:.3}")).collect::<Vec<_>>().join(", ")
}

/// Power of lines measured and predicted, and of noise, in one band.
#[derive(Clone, Copy, Default)]
struct Band {
    measured: f64,
    predicted: f64,
    noise: f64,
    lines: f64,
}

fn pass_band(checked: &mut Checked, runs: &[Compared]) {
    let mut tops: Vec<f64> = Vec::new();
    for channel in 0..2 {
        let mut bands: Vec<Band> = Vec::new();
        for line in runs.iter().flat_map(|run| &run.lines) {
            let at = (line.hz / BAND_HZ) as usize;
            bands.resize(bands.len().max(at + 1), Band::default());
            bands[at].measured += line.measured[channel].norm_sqr();
            bands[at].predicted += line.predicted[channel].norm_sqr();
            bands[at].noise += line.noise[channel];
            bands[at].lines += 1.0;
        }
        let noise = |b: &Band| b.noise / b.lines.max(1.0);
        let loudest = bands.iter().map(noise).fold(0.0, f64::max);
        // A relieved flank weakens the high harmonics; only a filter takes the noise with them.
        let silent =
            |b: &Band| b.measured < MIN_PASSED_POWER_SHARE * b.predicted && noise(b) < MIN_PASSED_POWER_SHARE * loudest;
        let from = bands.iter().rposition(|b| b.lines > 0.0 && !silent(b)).map_or(0, |last| last + 1);
        if from == 0 || bands.len() - from < LEAST_BANDS {
            continue;
        }
        let end_hz = from as f64 * BAND_HZ;
        tops.push(FLAT_SHARE * end_hz);
        let text = format!(
            "{} carries nothing above {end_hz:.0} Hz, neither predicted lines nor noise: a filter of the chain; \
             compared up to {:.0} Hz, names of effects withheld",
            channel_name(channel),
            FLAT_SHARE * end_hz
        );
        let finding = Finding::new(Severity::Say, Kind::PassBand, end_hz, bands.len() as f64 * BAND_HZ, "Hz", text);
        checked.findings.add(finding.in_channel(channel).withholding_names());
    }
    checked.record.top_hz = tops.into_iter().reduce(f64::min);
}
