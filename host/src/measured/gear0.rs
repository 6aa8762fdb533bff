//! Gear0: one 23/46 pair at 2000 rpm, synchronous accelerometers; what its lines say beyond the mesh.
//!
//! Everything is found on the first half of the fitting channels, in the order domain of the pinion (virtual tach from the mesh line of the fitting
//! channels): spacings of combs around the mesh harmonics, one after the other, and which of their lines stand above the local floor. The
//! measure is the share of variance outside the named lines (+-0.27 Hz) on the *second* half, for channels that
//! took part and for channels that did not. The same procedure with every spacing shifted is the control.
//! Limit: amplitudes are not predicted; a physical model would remove less than what the lines hold.

use super::comb::{Power, Search, mean_excess, refine, standing};
use crate::import::virtual_tach::{Options, virtual_tach};
use crate::spectral::{AngleMap, resample_by_angle};
use crate::{Error, Result};
use serde::Serialize;
use std::path::Path;

const RATE_HZ: f64 = 25_600.0;
const TEETH: [u32; 2] = [23, 46];
const MESH_GUESS_HZ: f64 = 766.0;
const HALF_WIDTH_HZ: f64 = 0.27;
const PER_TURN: usize = 1024;
const MESH_HARMONICS: i32 = 16;
/// Least power over the local floor of a named line, mean over the fitting channels.
const LEAST_EXCESS: f64 = 10.0;
/// Least multiples of a spacing around a carrier; small spacings reach half way to the next mesh harmonic.
const MULTIPLES: i32 = 12;

/// Channels that the line list is found on.
const FIT: [u32; 4] = [1, 4, 5, 12];
/// Channels that it is tested on.
const HELD_OUT: [u32; 4] = [2, 3, 13, 23];

/// A comb found.
#[derive(Debug, Clone, Serialize)]
pub struct Comb {
    /// Spacing, orders of the pinion.
    pub spacing_order: f64,
    /// Spacing, Hz.
    pub spacing_hz: f64,
    /// Height of its score over all spacings tried, standard deviations.
    pub sigma: f64,
    /// Largest such height in 20 spectra with the same lines at shuffled places.
    pub chance: f64,
    /// Lines it names.
    pub lines: usize,
    /// What it is, as far as the record can say.
    pub reading: String,
}

/// Share of variance left on the second half.
#[derive(Debug, Clone, Serialize)]
pub struct Left {
    /// Channel.
    pub channel: u32,
    /// Whether the line list was found without it.
    pub held_out_channel: bool,
    /// Outside the mesh harmonics, %.
    pub mesh_only_percent: f64,
    /// After each comb, %.
    pub after_percent: Vec<f64>,
    /// What the shifted combs take instead of the real ones beyond the mesh, median and largest of all trials, %.
    pub control_percent: [f64; 2],
}

/// Result.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// Mean mesh frequency, Hz.
    pub mesh_hz: f64,
    /// Standard deviation of the speed, rpm.
    pub speed_std_rpm: f64,
    /// Pinion turns in each half.
    pub turns_per_half: usize,
    /// Combs, in the order found.
    pub combs: Vec<Comb>,
    /// The next spacing, not taken: orders, height, what chance gives.
    pub refused: Option<[f64; 3]>,
    /// Continuous values fitted (spacings).
    pub fitted_values: usize,
    /// Lines chosen beyond the mesh harmonics: yes-or-no choices made on the first half.
    pub chosen_lines: usize,
    /// Share of bins that the chosen lines cover, %.
    pub covered_percent: f64,
    /// Variance left, per channel.
    pub left: Vec<Left>,
    /// Median change of a named line's amplitude from the first half to the second, dB, held-out channels.
    pub median_line_change_db: f64,
    /// The effect's name.
    pub effect: &'static str,
    /// What must not be concluded.
    pub caution: &'static str,
}

struct Half {
    power: Vec<Power>,
}

/// Runs the analysis on `data/gear0`.
///
/// # Errors
/// Absent or unreadable files, or a mesh line too weak for a virtual tach.
pub fn run(data: &Path) -> Result<Outcome> {
    let channels: Vec<u32> = FIT.iter().chain(&HELD_OUT).copied().collect();
    let mut signals = Vec::new();
    for c in &channels {
        let columns = super::file(data, "gear0", &format!("3027_217_Data_Chan{c}.mat"))?;
        signals.push(columns.channels.into_iter().next().unwrap_or_default());
    }
    let options = Options { teeth: TEETH, mesh_guess_hz: Some(MESH_GUESS_HZ) };
    let tach = virtual_tach("gear0", &signals[..FIT.len()], RATE_HZ, &options)?;
    let map = AngleMap::new(&tach.edges_s, 1, 0.0).ok_or_else(|| Error::impossible("gear0", "no turns"))?;
    // The tach's ends are extrapolated; halves of whole wheel turns.
    let margin = tach.quality.extrapolated_pulses as f64;
    let turns = ((map.range().1 - 2.0 * margin) / 4.0).floor() as usize * 2;
    let half = |from: f64| Half {
        power: signals
            .iter()
            .map(|s| Power::new(&resample_by_angle(s, RATE_HZ, &map, from, turns, PER_TURN), PER_TURN as f64))
            .collect(),
    };
    let (first, second) = (half(margin), half(margin + turns as f64));
    Ok(analyse(&first, &second, &channels, tach.quality.speed_hz, tach.quality.speed_std_rpm, turns))
}

fn mesh_lines() -> Vec<f64> {
    (1..=MESH_HARMONICS).map(|h| f64::from(h * TEETH[0] as i32)).collect()
}

/// Candidate lines of a spacing: around every mesh harmonic and alone, and each of those modulated by the spacings before it.
fn candidates(spacings: &[f64], index: usize) -> Vec<f64> {
    let carriers: Vec<f64> = (0..=MESH_HARMONICS).map(|h| f64::from(h * TEETH[0] as i32)).collect();
    let reach = MULTIPLES.max((0.5 * f64::from(TEETH[0]) / spacings[index]) as i32);
    let mut lines = Vec::new();
    for carrier in carriers {
        for j in (-reach..=reach).filter(|j| *j != 0) {
            let at = carrier + f64::from(j) * spacings[index];
            lines.push(at);
            for earlier in &spacings[..index] {
                lines.extend([-2.0, -1.0, 1.0, 2.0].map(|i| at + i * earlier));
            }
        }
    }
    lines
}

/// Names lines of all spacings on the excess of the first half; returns the lines per spacing.
fn name(bin: f64, excess: &[f64], spacings: &[f64]) -> Vec<Vec<f64>> {
    (0..spacings.len()).map(|i| standing(bin, excess, &candidates(spacings, i), LEAST_EXCESS)).collect()
}

fn analyse(first: &Half, second: &Half, channels: &[u32], speed_hz: f64, speed_std_rpm: f64, turns: usize) -> Outcome {
    let bin = first.power[0].bin;
    let half_width = HALF_WIDTH_HZ / speed_hz;
    let excess = mean_excess(&first.power[..FIT.len()]);
    let mut named = first.power[0].mask(&mesh_lines(), half_width);
    let carriers: Vec<f64> = (0..=5).map(|h| f64::from(h * TEETH[0] as i32)).collect();
    let search = Search { spacing: [0.2, 8.0], multiples: 6, carriers: carriers.clone(), top: 200.0 };
    let mut found = Vec::new();
    let mut refused = None;
    let mut spacings: Vec<f64> = Vec::new();
    while spacings.len() < 5 {
        let Some(best) = search.best(bin, &excess, &named) else { break };
        let chance = search.chance(bin, &excess, &named);
        // A whole multiple of a spacing already named is no new effect.
        let again = spacings.iter().any(|s| (best.spacing / s - (best.spacing / s).round()).abs() < 0.01);
        if best.sigma < chance || again {
            refused = Some([best.spacing, best.sigma, chance]);
            break;
        }
        spacings.push(refine(bin, &excess, &carriers, best.spacing, 6));
        found.push([best.sigma, chance]);
        for line in name(bin, &excess, &spacings).concat() {
            first.power[0].mark(&mut named, line, half_width);
        }
    }
    let lines = name(bin, &excess, &spacings);
    let mut taken = first.power[0].mask(&mesh_lines(), half_width);
    let mesh = taken.clone();
    let masks: Vec<Vec<bool>> = lines
        .iter()
        .map(|lines| {
            lines.iter().for_each(|&at| first.power[0].mark(&mut taken, at, half_width));
            taken.clone()
        })
        .collect();
    let controls = shifted(bin, &excess, &spacings, &taken, &first.power[0], half_width);
    let left =
        (0..channels.len()).map(|c| left(&second.power[c], channels[c], c >= FIT.len(), &mesh, &masks, &controls));
    let mut changes: Vec<f64> = (FIT.len()..channels.len())
        .flat_map(|c| {
            let (first, second) = (&first.power[c], &second.power[c]);
            lines.concat().into_iter().map(move |at| {
                let mask = first.mask(&[at], half_width);
                (10.0 * (second.within(&mask) / first.within(&mask).max(f64::MIN_POSITIVE)).log10()).abs()
            })
        })
        .filter(|db| db.is_finite())
        .collect();
    changes.sort_by(f64::total_cmp);
    let combs = combs(&spacings, &found, &lines, &first.power[0], half_width, speed_hz);
    let count = |mask: &[bool]| mask.iter().filter(|m| **m).count() as f64;
    Outcome {
        mesh_hz: speed_hz * f64::from(TEETH[0]),
        speed_std_rpm,
        turns_per_half: turns,
        fitted_values: spacings.len(),
        chosen_lines: combs.iter().map(|c| c.lines).sum(),
        covered_percent: 100.0 * (count(&taken) - count(&mesh)) / (RATE_HZ / speed_hz / 2.0 / bin),
        combs,
        refused,
        left: left.collect(),
        median_line_change_db: changes.get(changes.len() / 2).copied().unwrap_or(0.0),
        effect: "outer-ring passage stiffness or force modulation",
        caution: "a healthy bearing's varying compliance under load gives the same lines as a damaged ring; the record cannot tell them apart",
    }
}

/// Masks of the same procedure with every spacing that is not the shafts' moved by 1 to 6 %, without what the real lines take.
fn shifted(
    bin: f64,
    excess: &[f64],
    spacings: &[f64],
    taken: &[bool],
    power: &Power,
    half_width: f64,
) -> Vec<Vec<bool>> {
    (0..40)
        .map(|trial| {
            let share = (0.01 + 0.05 * f64::from(trial / 2) / 19.0) * if trial % 2 == 0 { 1.0 } else { -1.0 };
            let moved: Vec<f64> = spacings.iter().map(|s| if of_shafts(*s) { *s } else { s * (1.0 + share) }).collect();
            let mut mask = power.mask(&name(bin, excess, &moved).concat(), half_width);
            mask.iter_mut().zip(taken).for_each(|(m, t)| *m &= !*t);
            mask
        })
        .collect()
}

fn left(
    power: &Power,
    channel: u32,
    held_out_channel: bool,
    mesh: &[bool],
    masks: &[Vec<bool>],
    controls: &[Vec<bool>],
) -> Left {
    let total = power.total();
    let share = |mask: &[bool]| 100.0 * power.within(mask) / total;
    let mut control: Vec<f64> = controls.iter().map(|m| share(m)).collect();
    control.sort_by(f64::total_cmp);
    Left {
        channel,
        held_out_channel,
        mesh_only_percent: 100.0 - share(mesh),
        after_percent: masks.iter().map(|m| 100.0 - share(m)).collect(),
        control_percent: [control[control.len() / 2], control[control.len() - 1]],
    }
}

/// Whether a spacing is a whole number of wheel turns (and so of either shaft).
fn of_shafts(spacing: f64) -> bool {
    let turns = spacing * f64::from(TEETH[1]) / f64::from(TEETH[0]);
    turns > 0.5 && (turns - turns.round()).abs() < 0.02
}

/// Reads spacings: whole shaft rates by the tooth counts, a passage and its cage by their ratio.
fn combs(
    spacings: &[f64],
    sigma: &[[f64; 2]],
    lines: &[Vec<f64>],
    power: &Power,
    half_width: f64,
    hz: f64,
) -> Vec<Comb> {
    let wheel = f64::from(TEETH[0]) / f64::from(TEETH[1]);
    let mut before = power.mask(&mesh_lines(), half_width);
    spacings
        .iter()
        .enumerate()
        .map(|(i, &s)| {
            let partner = spacings.iter().find(|&&t| {
                let n = (t / s).max(s / t);
                t != s && (n - n.round()).abs() < 0.01 && (6.0..30.0).contains(&n.round()) && !of_shafts(t)
            });
            let reading = match partner {
                _ if of_shafts(s) => format!("shaft rates: {:.0} x the wheel's", s / wheel),
                Some(&t) if t < s => {
                    let n = s / t;
                    // A fixed outer ring is passed by n elements per cage turn; the cage turns below half the shaft's rate.
                    let ratio = 1.0 - 2.0 * t;
                    format!("outer-ring passage of {n:.3} elements on the pinion shaft, (d/D) cos a = {ratio:.3}")
                }
                Some(&t) => format!("cage of the same bearing: 1/{:.3} of the passage", t / s),
                None => "not of the shafts; no partner".into(),
            };
            let own = lines[i]
                .iter()
                .filter(|&&at| {
                    let mask = power.mask(&[at], half_width);
                    let new = mask.iter().zip(&before).any(|(m, b)| *m && !*b);
                    power.mark(&mut before, at, half_width);
                    new
                })
                .count();
            Comb { spacing_order: s, spacing_hz: s * hz, sigma: sigma[i][0], chance: sigma[i][1], lines: own, reading }
        })
        .collect()
}

impl Outcome {
    /// Table for the terminal.
    pub fn summary(&self) -> String {
        let mut text = format!(
            "mesh {:.3} Hz, speed std {:.2} rpm, {} pinion turns per half\n",
            self.mesh_hz, self.speed_std_rpm, self.turns_per_half
        );
        for c in &self.combs {
            text += &format!(
                "comb of {:.4} orders ({:.3} Hz), {:.1} sigma (chance {:.1}), {} lines: {}\n",
                c.spacing_order, c.spacing_hz, c.sigma, c.chance, c.lines, c.reading
            );
        }
        if let Some([spacing, sigma, chance]) = self.refused {
            text += &format!("next, refused: {spacing:.4} orders, {sigma:.1} sigma (chance {chance:.1})\n");
        }
        let rows: Vec<Vec<String>> = self
            .left
            .iter()
            .map(|l| {
                let mut row = vec![format!("ch{}{}", l.channel, if l.held_out_channel { " (held out)" } else { "" })];
                row.push(format!("{:.1}", l.mesh_only_percent));
                row.push(l.after_percent.iter().map(|p| format!("{p:.1}")).collect::<Vec<_>>().join(" > "));
                row.push(format!("{:.2} / {:.2}", l.control_percent[0], l.control_percent[1]));
                row
            })
            .collect();
        text += "variance outside the named lines on the second half, %\n";
        text += &crate::terminal::table(&["channel", "mesh only", "after each comb", "control median / max"], &rows);
        text += &format!(
            "{} fitted values, {} chosen lines covering {:.2} % of the bins; a line changes by {:.1} dB (median) between the halves\n{}\ncaution: {}\n",
            self.fitted_values,
            self.chosen_lines,
            self.covered_percent,
            self.median_line_change_db,
            self.effect,
            self.caution
        );
        text
    }
}
