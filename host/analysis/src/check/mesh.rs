//! Rules on where the mesh line stands: at teeth x speed, at another factor, at another run's, or nowhere.
//!
//! Measure: the mean logarithm of power over local noise at the first harmonics of a supposed mesh frequency, over
//! both channels. Noise alone gives about one, whatever its colour; a gear pair's mesh several more; one strong line
//! of something else hardly moves it.

use super::Checked;
use super::finding::{Finding, Kind, Severity, channel_name};
use crate::observation::angle::Angle;
use crate::observation::input::Record;
use crate::observation::spectrum::Analyser;
use crate::spectral::noise_power;
use rayon::prelude::*;

/// Harmonics of the mesh that are looked at.
const HARMONICS: usize = 8;
/// Level below which there is no mesh: noise alone gives 1.0, its best of a thousand places stays below this.
const LEAST_LEVEL: f64 = 2.0;
/// Level of one channel at a known place below which that channel carries no mesh.
const MIN_CHANNEL_LEVEL: f64 = 1.5;
/// Gain of level, mean nats per line, from which another place of the mesh is better.
const MIN_LEVEL_GAIN_NATS: f64 = 1.2;
/// Clock ratios that are tried, either way.
const WIDEST_CLOCK: f64 = 0.0125;
/// Factors of the pulses per turn that are tried.
const MOST_PULSES: u32 = 8;
/// Most teeth by which the declaration may be off.
const MOST_TEETH: i32 = 3;
/// Spread of a factor that runs share.
const SAME_FACTOR: f64 = 1e-3;
/// Share of the runs that must agree for a fault of the whole record.
const MIN_RUN_SHARE: f64 = 0.7;

/// A run's power over local noise, bin by bin.
struct Seen {
    over_noise: [Vec<f64>; 2],
    duration_s: f64,
    shaft_hz: f64,
    teeth: f64,
}

/// What another factor of the mesh frequency would mean.
#[derive(Clone, Copy, PartialEq)]
enum Place {
    Clock,
    Teeth(i32),
    OtherRun(usize),
}

impl Seen {
    fn new(record: &Record, r: usize) -> Self {
        let run = &record.runs[r];
        let analyser = Analyser::new(run.channels[0].len(), record.sample_rate_hz);
        let over_noise = [0, 1].map(|c| {
            let bins = analyser.bins_of(&run.channels[c]);
            let noise = noise_power(&bins);
            bins.iter().zip(noise).map(|(x, n)| x.norm_sqr() / n).collect()
        });
        let shaft_hz = Angle::fit(run, record.pulses_per_rev, record.jitter_s).shaft_hz;
        Self { over_noise, duration_s: analyser.duration_s(), shaft_hz, teeth: f64::from(record.pair.teeth[0]) }
    }

    fn line(&self, channel: usize, hz: f64) -> Option<f64> {
        let b = (hz * self.duration_s).round() as usize;
        let bins = self.over_noise[channel].get(b.saturating_sub(1)..b + 2)?;
        Some((1.0 + bins.iter().copied().fold(0.0, f64::max)).ln())
    }

    fn mean(&self, channels: &[usize], hz: f64, harmonics: impl Iterator<Item = usize> + Clone) -> f64 {
        let lines =
            || channels.iter().flat_map(|&c| harmonics.clone().filter_map(move |h| self.line(c, h as f64 * hz)));
        lines().sum::<f64>() / (lines().count() as f64).max(1.0)
    }

    /// Level of a mesh at `factor` times teeth x speed.
    fn level(&self, factor: f64) -> f64 {
        self.mean(&[0, 1], factor * self.mesh_hz(), 1..=HARMONICS)
    }

    fn level_of_channel(&self, channel: usize, factor: f64) -> f64 {
        self.mean(&[channel], factor * self.mesh_hz(), 1..=HARMONICS)
    }

    fn mesh_hz(&self) -> f64 {
        self.teeth * self.shaft_hz
    }

    /// Change of factor that moves the last harmonic by a bin.
    fn per_bin(&self) -> f64 {
        1.0 / (HARMONICS as f64 * self.mesh_hz() * self.duration_s)
    }

    /// Best level near a factor, and where.
    fn best(&self, near: f64, within: f64) -> (f64, f64) {
        let step = 0.4 * self.per_bin();
        let count = (within / step).ceil() as i32;
        (-count..=count)
            .map(|i| near + f64::from(i) * step)
            .map(|factor| (self.level(factor), factor))
            // Of places as good the nearest.
            .fold((f64::NEG_INFINITY, near), |a, b| {
                let nearer = (b.1 - near).abs() < (a.1 - near).abs();
                if b.0 > a.0 + 0.02 || (b.0 > a.0 - 0.02 && nearer) { b } else { a }
            })
    }

    /// Whether another speed is a multiple of the own one whose mesh leaves out harmonics that stand: its lines are
    /// all there at the own speed, too.
    fn has_harmonics_between(&self, other_shaft_hz: f64) -> bool {
        let multiple = (other_shaft_hz / self.shaft_hz).round();
        let is_multiple = multiple >= 2.0 && (other_shaft_hz / self.shaft_hz / multiple - 1.0).abs() < SAME_FACTOR;
        let between = (1..=2 * HARMONICS).filter(move |h| !h.is_multiple_of(multiple as usize));
        is_multiple && self.mean(&[0, 1], self.mesh_hz(), between) > MIN_CHANNEL_LEVEL
    }

    /// Number by which the declared pulses per turn are wrong, as a factor on the speed.
    fn pulses_factor(&self) -> Option<f64> {
        let split = |fundamental: f64, k: usize| {
            let of = |whole: bool| {
                self.mean(&[0, 1], fundamental, (1..=2 * HARMONICS).filter(move |h| (h % k == 0) == whole))
            };
            (of(true), of(false))
        };
        let faster = (2..=MOST_PULSES).rev().find(|&k| {
            // Only every k-th of the supposed harmonics is there.
            let (whole, others) = split(self.mesh_hz(), k as usize);
            others < MIN_CHANNEL_LEVEL && whole > others + 2.0 * MIN_LEVEL_GAIN_NATS
        });
        let slower = (2..=MOST_PULSES).rev().find(|&k| {
            // Between the supposed harmonics stand as many, as strong.
            let (whole, others) = split(self.mesh_hz() / f64::from(k), k as usize);
            others > 2.0 * LEAST_LEVEL && others > whole - MIN_LEVEL_GAIN_NATS
        });
        faster.map(f64::from).or(slower.map(|k| 1.0 / f64::from(k)))
    }
}

/// Level of the mesh of run `r` where the declaration puts it.
pub fn level_as_declared(record: &Record, r: usize) -> f64 {
    Seen::new(record, r).best(1.0, 1e-3).0
}

/// Applies the rules on the mesh line; a clock ratio that all runs share is undone.
pub fn check(checked: &mut Checked) {
    let record = &checked.record;
    let seen: Vec<Seen> = (0..record.runs.len()).into_par_iter().map(|r| Seen::new(record, r)).collect();
    if pulses(checked, &seen) {
        return;
    }
    let found: Vec<(f64, f64, f64, Place)> = (0..seen.len()).into_par_iter().map(|r| place(&seen, r)).collect();
    let nowhere: Vec<usize> = (0..seen.len()).filter(|&r| found[r].1 < LEAST_LEVEL).collect();
    let elsewhere: Vec<usize> = (0..seen.len())
        .filter(|r| !nowhere.contains(r))
        .filter(|&r| {
            found[r].1 > found[r].0 + MIN_LEVEL_GAIN_NATS && (found[r].2 - 1.0).abs() > 1.5 * seen[r].per_bin()
        })
        .collect();
    no_mesh(checked, &seen, &found, &nowhere);
    if checked.findings.refused() || mesh_elsewhere(checked, &seen, &found, &elsewhere) {
        return;
    }
    channels_without_mesh(checked, &seen, &found, &nowhere);
}

/// Level as declared, the best level, its factor, and what that would mean.
fn place(seen: &[Seen], r: usize) -> (f64, f64, f64, Place) {
    let own = &seen[r];
    let (level, factor) = own.best(1.0, WIDEST_CLOCK);
    let declared = own.best(1.0, own.per_bin()).0;
    let mut best = (level, factor, Place::Clock);
    let near = 2e-3;
    let teeth = (-MOST_TEETH..=MOST_TEETH).filter(|d| *d != 0).map(|d| {
        let (level, factor) = own.best(1.0 + f64::from(d) / own.teeth, near);
        (level, factor, Place::Teeth(d))
    });
    let others = (0..seen.len()).filter(|&o| o != r && !own.has_harmonics_between(seen[o].shaft_hz)).map(|o| {
        let (level, factor) = own.best(seen[o].shaft_hz / own.shaft_hz, own.per_bin());
        (level, factor, Place::OtherRun(o))
    });
    for other in others.chain(teeth) {
        if (other.1 - 1.0).abs() > WIDEST_CLOCK && other.0 > best.0 + 0.5 * MIN_LEVEL_GAIN_NATS {
            best = other;
        }
    }
    (declared, best.0, best.1, best.2)
}

fn pulses(checked: &mut Checked, seen: &[Seen]) -> bool {
    let factors: Vec<Option<f64>> = seen.par_iter().map(Seen::pulses_factor).collect();
    let Some(factor) = factors.iter().flatten().copied().next() else { return false };
    let agree = factors.iter().filter(|f| **f == Some(factor)).count();
    if (agree as f64) < MIN_RUN_SHARE * seen.len() as f64 {
        return false;
    }
    let declared = checked.record.pulses_per_rev;
    let text = format!(
        "the mesh lines stand at {factor:.4} times teeth x speed in {agree} of {} runs: pulses per turn are declared \
         as {declared}, the vibration fits {:.3}",
        seen.len(),
        f64::from(declared) / factor
    );
    checked.findings.add(Finding::new(Severity::Refuse, Kind::PulsesPerTurn, factor, 1.0, "times", text));
    true
}

fn no_mesh(checked: &mut Checked, seen: &[Seen], found: &[(f64, f64, f64, Place)], nowhere: &[usize]) {
    let worst = nowhere.iter().map(|&r| found[r].1).fold(f64::INFINITY, f64::min);
    let text = format!(
        "no mesh line {}: mean log power over noise at {HARMONICS} harmonics of teeth x speed is {worst:.2} (noise \
         alone gives 1.0)",
        checked.in_runs(nowhere)
    );
    debug_assert_eq!(seen.len(), found.len());
    let finding = Finding::new(Severity::SetAside, Kind::NoMesh, worst, LEAST_LEVEL, "nats", text);
    checked.add_for_runs(nowhere, Severity::SetAside, Severity::Refuse, finding);
}

/// Says where the mesh stands instead; true where the record or its runs changed.
fn mesh_elsewhere(checked: &mut Checked, seen: &[Seen], found: &[(f64, f64, f64, Place)], elsewhere: &[usize]) -> bool {
    if elsewhere.is_empty() {
        return false;
    }
    let mut factors: Vec<f64> = elsewhere.iter().map(|&r| found[r].2).collect();
    factors.sort_by(f64::total_cmp);
    let middle = factors[factors.len() / 2];
    // Slow runs do not show a small departure by themselves, but share the factor.
    let shares = |r: &usize| (found[*r].2 / middle - 1.0).abs() < SAME_FACTOR.max(seen[*r].per_bin());
    let same = (0..seen.len()).filter(shares).count();
    if same as f64 >= MIN_RUN_SHARE * seen.len() as f64 {
        return match found[elsewhere[0]].3 {
            Place::Clock => undo_clock(checked, middle),
            _ => teeth(checked, seen, middle),
        };
    }
    for &r in elsewhere {
        let (_, _, factor, place) = found[r];
        let (kind, why) = match place {
            Place::OtherRun(o) => (Kind::OtherRunsSpeed, format!("as run {}'s speed has it", checked.runs[o])),
            _ => (Kind::MeshElsewhere, "its tach is another's, or wrong".into()),
        };
        let run = checked.runs[r];
        let text = format!("run {run}'s mesh lines stand at {factor:.5} times teeth x speed: {why}");
        let finding = Finding::new(Severity::SetAside, kind, factor, 1.0, "times", text).in_runs(vec![run]);
        checked.findings.add(finding);
    }
    if checked.runs.len() - elsewhere.len() < super::LEAST_RUNS {
        let text = format!("the mesh lines of {} of {} runs do not fit their speed", elsewhere.len(), seen.len());
        let finding = Finding::new(Severity::Refuse, Kind::MeshElsewhere, elsewhere.len() as f64, 0.0, "runs", text);
        checked.findings.add(finding.in_runs(checked.named(elsewhere)));
    }
    false
}

fn teeth(checked: &mut Checked, seen: &[Seen], factor: f64) -> bool {
    let declared = checked.record.pair.teeth[0];
    let text = format!(
        "the mesh lines stand at {factor:.5} times teeth x speed in all {} runs: the pinion has {:.2} teeth where \
         {declared} are declared, or the speed is off by that",
        seen.len(),
        factor * f64::from(declared)
    );
    checked.findings.add(Finding::new(Severity::Refuse, Kind::PinionTeeth, factor, 1.0, "times", text));
    true
}

/// Scales the tach to the vibration's clock. The finer part is [`lag`](super::lag)'s.
fn undo_clock(checked: &mut Checked, factor: f64) -> bool {
    scale_tach(checked, factor);
    let text = format!(
        "tach and vibration disagree by {:+.4} %: the mesh lines stand at {factor:.6} times teeth x speed in all \
         runs; the tach is scaled to the vibration",
        100.0 * (factor - 1.0)
    );
    checked.findings.add(Finding::new(Severity::Say, Kind::Clock, factor - 1.0, 0.0, "relative", text));
    true
}

/// Makes the tach's speeds `factor` times what they were.
pub fn scale_tach(checked: &mut Checked, factor: f64) {
    for run in &mut checked.record.runs {
        run.edges_s.iter_mut().for_each(|t| *t /= factor);
    }
}

fn channels_without_mesh(checked: &mut Checked, seen: &[Seen], found: &[(f64, f64, f64, Place)], nowhere: &[usize]) {
    for channel in 0..2 {
        let level = |r: usize| seen[r].level_of_channel(channel, found[r].2);
        let places: Vec<usize> =
            (0..seen.len()).filter(|r| !nowhere.contains(r) && level(*r) < MIN_CHANNEL_LEVEL).collect();
        if places.is_empty() {
            continue;
        }
        let worst = places.iter().map(|&r| level(r)).fold(f64::INFINITY, f64::min);
        let text = format!(
            "{} carries no mesh {}: mean log power over noise at {HARMONICS} harmonics is {worst:.2} (noise alone \
             gives 1.0)",
            channel_name(channel),
            checked.in_runs(&places)
        );
        let finding = Finding::new(Severity::SetAside, Kind::NoMesh, worst, MIN_CHANNEL_LEVEL, "nats", text);
        checked.add_for_runs(&places, Severity::SetAside, Severity::Refuse, finding.in_channel(channel));
    }
}
