//! Virtual tachometer: pinion pulses from the phase of a mesh line, for records without a tach channel.
//!
//! 1. The mesh frequency: the best comb (five mesh harmonics, pinion and gear sidebands, less what lies
//!    halfway between) near the user's guess or over the whole band, then a least-squares line estimate.
//! 2. For every channel and harmonic, the line is mixed down to zero and low-passed by a Blackman-Harris
//!    window four turns of the slower shaft long: shaft sidebands fall on the window's zeros, so the phase
//!    that remains is that of the mesh alone. Speed changes faster than about a third of that shaft's rate are lost.
//! 3. The phase noise of each candidate follows from the noise between the sidebands; the candidate with the least
//!    jitter in time wins. Its unwrapped phase / (2 pi harmonic teeth) is the pinion's angle.
//! 4. All lines that stand out are mixed down anew along that angle. Where their phase still moves, the line has
//!    slipped: a comb locks to where a wandering frequency dwells, and a filter about that loses it elsewhere.
//!
//! Where the speed wanders too far for that (its mesh is then looked for about the guess, or the comb), or a range is
//! given, the frequency is followed first (`follow`), and the same is done on the signal read at equal angles of that
//! course, with all lines together (`lines`) instead of the best: each is turned and weakened as it moves through
//! resonances.
//!
//! What it cannot know: which tooth is which, and angle 0 (turn numbers start at an arbitrary angle). The pulses
//! follow the mesh line, so they are blind to anything that shifts its phase (torque, resonance crossing).
//! The first and last half window are extrapolated. Cost: about a second per channel and ten seconds of signal.

use crate::spectral::{Window, power_density};
use crate::{Error, Result};
use rayon::prelude::*;
use rustfft::num_complex::Complex;
use std::f64::consts::{PI, TAU};

pub use super::quality::{Options, Quality, VirtualTach};

use super::follow::follow;
use super::lines::{Line, together};
use crate::data_quality::comb::{self, Comb};

/// Harmonics tried.
const HARMONICS: u32 = 5;
/// Window length in turns of the slower shaft.
const WINDOW_TURNS: f64 = 4.0;
/// Phase points per window length.
const POINTS_PER_WINDOW: f64 = 32.0;
/// Least ratio of line power to the noise that shares its filter, dB: 0.22 rad of phase noise, far from slipping.
const LEAST_LINE_SNR_DB: f64 = 10.0;
/// Least comb excess, dB per line, that counts as a mesh comb: found near a guess, and by search over the band.
const LEAST_COMB_DB: [f64; 2] = [3.0, 6.0];

/// What a mesh frequency that is known to 3 % may do in a record, share of it, before it needs a range.
const WANDER: f64 = 0.08;
/// Most that the phase of all lines may move beside the angle that one of them gave, mesh periods: the filter's lag
/// at a speed that it passes makes 0.04, a line that has slipped 0.8 and more.
const MAX_PHASE_PERIODS: f64 = 0.2;

/// One channel's line at one harmonic, mixed down.
struct Candidate {
    channel: usize,
    harmonic: u32,
    snr: f64,
    jitter_s: f64,
    /// Unwrapped mesh cycles (not of the harmonic) at `first_s + i step_s`.
    cycles: Vec<f64>,
}

/// Pulses of a mesh line about one frequency, or where and why the line has slipped.
enum Pass {
    Holds(VirtualTach),
    Slips { mesh_hz: f64, refusal: Error },
}

/// Makes pinion pulses from the mesh line of `channels` sampled at `rate_hz`.
///
/// A speed that wanders is followed, about the guess where one is given.
///
/// # Errors
/// No comb at these teeth, or none near the guess, a line too weak to carry a phase or one that slips, or a record
/// shorter than three filter windows.
pub fn virtual_tach(place: &str, channels: &[Vec<f64>], rate_hz: f64, options: &Options) -> Result<VirtualTach> {
    let about = |mesh_hz: f64, refusal: Error| {
        let range_hz = [(1.0 - WANDER) * mesh_hz, (1.0 + WANDER) * mesh_hz];
        followed(place, channels, rate_hz, options.teeth, range_hz).map_err(|_| refusal)
    };
    let made = match (steady(place, channels, rate_hz, options, false), options.mesh_guess_hz) {
        (Ok(Pass::Holds(made)), _) => made,
        (Ok(Pass::Slips { mesh_hz, refusal }), guess_hz) => about(guess_hz.unwrap_or(mesh_hz), refusal)?,
        (Err(refusal @ Error::Impossible { .. }), Some(guess_hz)) => about(guess_hz, refusal)?,
        (Err(refusal), _) => return Err(refusal),
    };
    match options.mesh_guess_hz {
        Some(guess_hz) if (made.quality.mesh_hz / guess_hz - 1.0).abs() > comb::GUESS_TOLERANCE => {
            let elsewhere = comb::strongest(place, channels, rate_hz, options.teeth);
            let what = match elsewhere.ok().filter(|(_, db)| *db >= LEAST_COMB_DB[1]) {
                Some((hz, _)) => format!("the strongest comb is at {hz:.1} Hz; give that with --mesh"),
                None => "no comb stands out elsewhere; give another --mesh".into(),
            };
            let share = 100.0 * comb::GUESS_TOLERANCE;
            let what = format!("no mesh line within {share:.0} % of {guess_hz} Hz: {what}, or leave it out");
            Err(Error::impossible(place, what))
        }
        _ => Ok(made),
    }
}

/// [`virtual_tach`] of a mesh frequency that changes within `range_hz` (a run-up, a strong wander).
///
/// # Errors
/// As [`virtual_tach`]; a range that is none or cannot be seen at this rate.
pub fn followed(
    place: &str,
    channels: &[Vec<f64>],
    rate_hz: f64,
    teeth: [u32; 2],
    range_hz: [f64; 2],
) -> Result<VirtualTach> {
    let [low, high] = range_hz;
    if !(low > 0.0 && high > low && high < 0.4 * rate_hz) {
        let what = format!("a mesh line from {low:.1} to {high:.1} Hz cannot be followed at {rate_hz} Hz");
        return Err(Error::invalid(place, what));
    }
    let course = follow(place, channels, rate_hz, teeth[0], range_hz)?;
    let options = Options { teeth, mesh_guess_hz: Some(course.mesh_hz) };
    let mut made = match steady(place, &course.channels, course.rate_hz, &options, true)? {
        Pass::Holds(made) => made,
        Pass::Slips { refusal, .. } => return Err(refusal),
    };
    made.edges_s.iter_mut().for_each(|t| *t = course.time_s(*t));
    let end_s = channels[0].len() as f64 / rate_hz;
    made.edges_s.retain(|t| (0.0..end_s).contains(t));
    let intervals = made.edges_s.windows(2).map(|w| 60.0 / (w[1] - w[0])).collect::<Vec<_>>();
    if intervals.len() < 2 || intervals.iter().any(|speed| !(speed.is_finite() && *speed > 0.0)) {
        return Err(Error::impossible(place, "no trustworthy mesh line: the angle it gives turns back"));
    }
    made.quality.speed_std_rpm = standard_deviation(&intervals);
    made.quality.speed_hz = intervals.len() as f64 / (made.edges_s[intervals.len()] - made.edges_s[0]);
    made.quality.mesh_hz = made.quality.speed_hz * f64::from(teeth[0]);
    Ok(made)
}

/// Pulses of a mesh line that keeps within the filter; from all lines together where `fused`.
fn steady(place: &str, channels: &[Vec<f64>], rate_hz: f64, options: &Options, fused: bool) -> Result<Pass> {
    let comb = comb::find(place, channels, rate_hz, options.teeth, options.mesh_guess_hz)?;
    let least_comb_db = LEAST_COMB_DB[usize::from(options.mesh_guess_hz.is_none())];
    if comb.excess_db < least_comb_db {
        let what = format!(
            "no trustworthy mesh line: the best comb for {}/{} teeth, at {:.2} Hz, stands {:.1} dB over its \
             surroundings (needs {least_comb_db})",
            options.teeth[0], options.teeth[1], comb.mesh_hz, comb.excess_db
        );
        return Err(Error::impossible(place, what));
    }
    let geometry = Geometry::new(place, channels, rate_hz, &comb, options.teeth)?;
    let lines: Vec<Line> = (0..channels.len())
        .flat_map(|channel| (1..=HARMONICS).map(move |harmonic| (channel, harmonic)))
        .collect::<Vec<_>>()
        .into_par_iter()
        .filter_map(|(channel, harmonic)| geometry.line(channel, harmonic, &channels[channel]))
        .collect();
    if fused {
        return geometry.fused(place, &lines, &comb).map(Pass::Holds);
    }
    let mut candidates: Vec<Candidate> = lines.iter().filter_map(|line| geometry.candidate(line)).collect();
    candidates.sort_by(|a, b| a.jitter_s.total_cmp(&b.jitter_s));
    let Some(best) = candidates.first() else {
        let what = format!(
            "no trustworthy mesh line: nothing at {:.2} Hz keeps a steady phase; --mesh FROM,TO follows a range",
            comb.mesh_hz
        );
        return Ok(Pass::Slips { mesh_hz: comb.mesh_hz, refusal: Error::impossible(place, what) });
    };
    geometry.check_snr(place, best)?;
    let second = candidates.get(1);
    let beside = geometry.beside(channels, &lines, best).or_else(|| second.map(|second| parted(best, second)));
    match beside.filter(|beside| *beside > MAX_PHASE_PERIODS) {
        Some(beside) => Ok(Pass::Slips { mesh_hz: comb.mesh_hz, refusal: geometry.slipped(place, best, beside) }),
        None => Ok(Pass::Holds(geometry.pulses(best, second, &comb))),
    }
}

/// How far two lines' angles part over the record, mesh periods.
fn parted(a: &Candidate, b: &Candidate) -> f64 {
    reach(&a.cycles.iter().zip(&b.cycles).map(|(a, b)| a - b).collect::<Vec<_>>())
}

/// From the least to the most of the values.
fn reach(values: &[f64]) -> f64 {
    let (least, most) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), x| (l.min(*x), m.max(*x)));
    most - least
}

/// Filter and time grid shared by all candidates.
struct Geometry {
    rate_hz: f64,
    mesh_hz: f64,
    teeth: [u32; 2],
    samples: usize,
    window: Vec<f64>,
    hop: usize,
}

impl Geometry {
    fn new(place: &str, channels: &[Vec<f64>], rate_hz: f64, comb: &Comb, teeth: [u32; 2]) -> Result<Self> {
        let samples = channels.first().map_or(0, Vec::len);
        let slower_hz = comb.mesh_hz / f64::from(teeth[0].max(teeth[1]));
        let length = (WINDOW_TURNS / slower_hz * rate_hz).round() as usize;
        if samples < 3 * length {
            let what = format!(
                "{:.2} s are too short for a virtual tach at {:.1} Hz mesh; {:.2} s are needed",
                samples as f64 / rate_hz,
                comb.mesh_hz,
                3.0 * length as f64 / rate_hz
            );
            return Err(Error::impossible(place, what));
        }
        let weights = Window::BlackmanHarris.weights(length);
        let gain: f64 = weights.iter().sum();
        let window = weights.into_iter().map(|w| w / gain).collect();
        let hop = ((length as f64 / POINTS_PER_WINDOW) as usize).max(1);
        Ok(Self { rate_hz, mesh_hz: comb.mesh_hz, teeth, samples, window, hop })
    }

    fn points(&self) -> usize {
        (self.samples - self.window.len()) / self.hop + 1
    }

    /// Time of point `i`: the centre of its window (periodic form, so half a window exactly).
    fn time(&self, i: f64) -> f64 {
        (0.5 * self.window.len() as f64 + i * self.hop as f64) / self.rate_hz
    }

    /// Mixes one harmonic down; `None` above the band.
    fn line(&self, channel: usize, harmonic: u32, signal: &[f64]) -> Option<Line> {
        let line_hz = f64::from(harmonic) * self.mesh_hz;
        if line_hz > 0.45 * self.rate_hz {
            return None;
        }
        let per_sample = line_hz / self.rate_hz;
        let baseband = self.mixed_down(signal, |n| per_sample * n as f64);
        // Baseband amplitude is half the line's; noise of density N (one-sided) gives N/2 times the window's
        // noise bandwidth, half of it in quadrature.
        let bandwidth_hz = self.window.iter().map(|w| w * w).sum::<f64>() * self.rate_hz;
        let noise = 0.5 * self.noise_density(signal, line_hz) * bandwidth_hz;
        Some(Line::new(channel, harmonic, baseband, noise))
    }

    /// What one line alone gives; `None` where its phase cannot be followed.
    fn candidate(&self, line: &Line) -> Option<Candidate> {
        let Line { channel, harmonic, baseband, .. } = line;
        let (channel, harmonic) = (*channel, *harmonic);
        let line_hz = f64::from(harmonic) * self.mesh_hz;
        let mut phases: Vec<f64> = Vec::with_capacity(baseband.len());
        for z in baseband {
            let phase = z.arg();
            let before = phases.last().copied().unwrap_or(phase);
            let step = (phase - before + PI).rem_euclid(TAU) - PI;
            // More than a quarter turn per point is faster than the filter passes: the phase has slipped.
            if step.abs() > 0.5 * PI {
                return None;
            }
            phases.push(before + step);
        }
        let mut sizes: Vec<f64> = baseband.iter().map(|z| z.norm()).collect();
        sizes.sort_by(f64::total_cmp);
        if sizes[0] < 0.1 * sizes[sizes.len() / 2] {
            return None;
        }
        let snr = line.snr();
        let phase_noise = (0.5 / snr).sqrt();
        let cycles = phases
            .iter()
            .enumerate()
            .map(|(i, phase)| (line_hz * self.time(i as f64) + phase / TAU) / f64::from(harmonic))
            .collect();
        Some(Candidate { channel, harmonic, snr, jitter_s: phase_noise / (TAU * line_hz), cycles })
    }

    /// Refuses a line whose noise would make its phase slip.
    fn check_snr(&self, place: &str, best: &Candidate) -> Result<()> {
        let snr_db = 10.0 * best.snr.log10();
        if snr_db >= LEAST_LINE_SNR_DB {
            return Ok(());
        }
        let what = format!(
            "no trustworthy mesh line: the best one, harmonic {} of {:.2} Hz, is {snr_db:.1} dB over its noise \
             (needs {LEAST_LINE_SNR_DB})",
            best.harmonic, self.mesh_hz
        );
        Err(Error::impossible(place, what))
    }

    /// Pulses of all lines together; the figures are those of the strongest one.
    fn fused(&self, place: &str, lines: &[Line], comb: &Comb) -> Result<VirtualTach> {
        let strongest = lines.iter().max_by(|a, b| a.snr().total_cmp(&b.snr()));
        let (Some(strongest), Some((beside, _))) = (strongest, together(lines)) else {
            let what = format!(
                "no trustworthy mesh line: for more than a twentieth of the time nothing at {:.2} Hz or its \
                 harmonics stands over the noise",
                comb.mesh_hz
            );
            return Err(Error::impossible(place, what));
        };
        let cycles = beside.iter().enumerate().map(|(i, b)| self.mesh_hz * self.time(i as f64) + b).collect();
        let (channel, harmonic, snr) = (strongest.channel, strongest.harmonic, strongest.snr());
        let jitter_s = (0.5 / snr).sqrt() / (TAU * self.mesh_hz * f64::from(harmonic));
        let made = Candidate { channel, harmonic, snr, jitter_s, cycles };
        self.check_snr(place, &made)?;
        let mut tach = self.pulses(&made, None, comb);
        tach.quality.followed_lines = Some(lines.len());
        Ok(tach)
    }

    /// How far the phase of all lines that stand out moves beside the angle of `best`, along which they are mixed down
    /// anew, mesh periods; `None` where they are too weak to say.
    fn beside(&self, channels: &[Vec<f64>], lines: &[Line], best: &Candidate) -> Option<f64> {
        let course = self.course(&best.cycles);
        let least_snr = 10.0_f64.powf(0.1 * LEAST_LINE_SNR_DB);
        let strong: Vec<&Line> = lines.iter().filter(|line| line.snr() >= least_snr).collect();
        let along = |line: &&Line| {
            let harmonic = f64::from(line.harmonic);
            let baseband = self.mixed_down(&channels[line.channel], |n| harmonic * course[n]);
            Line::new(line.channel, line.harmonic, baseband, line.noise)
        };
        let again: Vec<Line> = strong.par_iter().map(along).collect();
        together(&again).map(|(beside, _)| reach(&beside))
    }

    /// Mesh cycles at every sample: straight between the points, beyond them at the mean speed over the nearest window.
    fn course(&self, cycles: &[f64]) -> Vec<f64> {
        let last = cycles.len() - 1;
        let reach = (POINTS_PER_WINDOW as usize).min(last);
        let slopes = [(cycles[reach] - cycles[0]) / reach as f64, (cycles[last] - cycles[last - reach]) / reach as f64];
        let at = |n: usize| {
            let x = (n as f64 - 0.5 * self.window.len() as f64) / self.hop as f64;
            if x <= 0.0 {
                return cycles[0] + slopes[0] * x;
            }
            if x >= last as f64 {
                return cycles[last] + slopes[1] * (x - last as f64);
            }
            let i = (x as usize).min(last - 1);
            cycles[i] + (x - i as f64) * (cycles[i + 1] - cycles[i])
        };
        (0..self.samples).map(at).collect()
    }

    /// Why the line of `best` is not trusted.
    fn slipped(&self, place: &str, best: &Candidate, beside: f64) -> Error {
        let what = format!(
            "no trustworthy mesh line: along harmonic {} of {:.2} Hz the phase of all lines moves by {beside:.2} mesh \
             periods (at most {MAX_PHASE_PERIODS}): the speed wanders too far for one line; --mesh {:.0},{:.0}, or the \
             range in which the mesh is, follows it",
            best.harmonic,
            self.mesh_hz,
            (1.0 - WANDER) * self.mesh_hz,
            (1.0 + WANDER) * self.mesh_hz
        );
        Error::impossible(place, what)
    }

    /// Window-weighted mean of `signal exp(-i phase)` at every point; `cycles` is the phase at a sample.
    fn mixed_down(&self, signal: &[f64], cycles: impl Fn(usize) -> f64) -> Vec<Complex<f64>> {
        let mixed: Vec<Complex<f64>> =
            signal.iter().enumerate().map(|(n, x)| Complex::from_polar(*x, -TAU * cycles(n).fract())).collect();
        (0..self.points())
            .map(|i| {
                let part = &mixed[i * self.hop..][..self.window.len()];
                part.iter().zip(&self.window).map(|(z, w)| z * w).sum()
            })
            .collect()
    }

    /// Noise density under the line: the median density within three sideband spacings of it.
    fn noise_density(&self, signal: &[f64], line_hz: f64) -> f64 {
        // Four window lengths resolve what lies between the sidebands.
        let density = power_density(signal, self.rate_hz, 4 * self.window.len(), Window::BlackmanHarris);
        let reach = 3.0 * self.mesh_hz / f64::from(self.teeth[0].max(self.teeth[1]));
        // The median of an exponential variable is ln 2 of its mean.
        density.median_between(line_hz - reach, line_hz + reach) / std::f64::consts::LN_2
    }

    fn pulses(&self, best: &Candidate, second: Option<&Candidate>, comb: &Comb) -> VirtualTach {
        let edges_s = self.edges(&best.cycles);
        let cross_check_s = second.map(|second| {
            let difference: Vec<f64> =
                best.cycles.iter().zip(&second.cycles).map(|(a, b)| (a - b) / self.mesh_hz).collect();
            standard_deviation(&difference) / 2.0_f64.sqrt()
        });
        let turns = (edges_s.len() - 1) as f64;
        let speed_hz = turns / (edges_s[edges_s.len() - 1] - edges_s[0]);
        let inside = |t: &f64| (self.time(0.0)..=self.time((self.points() - 1) as f64)).contains(t);
        let measured: Vec<f64> = edges_s.iter().copied().filter(inside).collect();
        let speeds: Vec<f64> = measured.windows(2).map(|w| 60.0 / (w[1] - w[0])).collect();
        let quality = Quality {
            mesh_hz: speed_hz * f64::from(self.teeth[0]),
            mesh_line_hz: comb.mesh_hz,
            channel: best.channel,
            harmonic: best.harmonic,
            line_snr_db: 10.0 * best.snr.log10(),
            phase_noise_rad: best.jitter_s * TAU * self.mesh_hz * f64::from(best.harmonic),
            jitter_s: best.jitter_s,
            cross_check_s,
            speed_hz,
            speed_std_rpm: standard_deviation(&speeds),
            mesh_over_pinion_line: comb.pinion_line_hz.map(|hz| comb.mesh_hz / hz),
            comb_db: comb.excess_db,
            extrapolated_pulses: edges_s.len() - measured.len(),
            followed_lines: None,
        };
        VirtualTach { edges_s, quality }
    }

    /// Times of whole pinion turns inside the record.
    fn edges(&self, cycles: &[f64]) -> Vec<f64> {
        let turns: Vec<f64> = cycles.iter().map(|c| c / f64::from(self.teeth[0])).collect();
        let last = turns.len() - 1;
        // Beyond the windows: the mean speed over the nearest window length.
        let reach = (POINTS_PER_WINDOW as usize).min(last);
        let slopes = [(turns[reach] - turns[0]) / reach as f64, (turns[last] - turns[last - reach]) / reach as f64];
        let curve = crate::spectral::natural_spline(&turns);
        let at = |x: f64| {
            if x <= 0.0 {
                return turns[0] + slopes[0] * x;
            }
            if x >= last as f64 {
                return turns[last] + slopes[1] * (x - last as f64);
            }
            let i = (x as usize).min(last - 1);
            let (u, v) = (x - i as f64, 1.0 - (x - i as f64));
            v * turns[i] + u * turns[i + 1] + ((v * v * v - v) * curve[i] + (u * u * u - u) * curve[i + 1]) / 6.0
        };
        let start = -0.5 * self.window.len() as f64 / self.hop as f64;
        let end = start + (self.samples - 1) as f64 / self.hop as f64;
        let (first_turn, last_turn) = (at(start).ceil() as i64, at(end).floor() as i64);
        let mut low = start;
        (first_turn..=last_turn)
            .map(|turn| {
                let (mut a, mut b) = (low, end);
                for _ in 0..60 {
                    let middle = 0.5 * (a + b);
                    if at(middle) < turn as f64 { a = middle } else { b = middle }
                }
                low = a;
                self.time(0.5 * (a + b))
            })
            .collect()
    }
}

fn standard_deviation(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    if n < 2.0 {
        return 0.0;
    }
    let mean = values.iter().sum::<f64>() / n;
    (values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / (n - 1.0)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 6400.0;

    /// Three mesh harmonics of 20 teeth at a mean of 25 turns/s with sidebands of both shafts and noise; the speed
    /// swings by a share of it at 0.5 Hz.
    fn signal(swing: f64) -> Vec<f64> {
        let mut state = 7_u64;
        (0..25_600)
            .map(|n| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                let noise = (state >> 33) as f64 / f64::from(1_u32 << 31) - 0.5;
                let t = f64::from(n) / RATE_HZ;
                let turns = 25.0 * (t + swing * (1.0 - (PI * t).cos()) / PI);
                let shafts = 1.0 + 0.2 * (TAU * turns).cos() + 0.1 * (PI * turns).cos();
                let line = |h: f64| 4.0 / h * (TAU * h * 20.0 * turns + h).cos();
                shafts * (line(1.0) + line(2.0) + line(3.0)) + noise
            })
            .collect()
    }

    fn mesh_hz(swing: f64, mesh_guess_hz: Option<f64>) -> Result<f64> {
        let options = Options { teeth: [20, 40], mesh_guess_hz };
        virtual_tach("x", &[signal(swing)], RATE_HZ, &options).map(|made| made.quality.mesh_hz)
    }

    #[test]
    fn fault_a_line_that_slips_where_the_speed_wanders_is_followed_instead() {
        for swing in [0.0, 0.004, 0.006, 0.01] {
            for guess in [Some(500.0), None] {
                let found = mesh_hz(swing, guess).expect("a mesh line");
                // One turn of a hundred would be 5 Hz.
                assert!((found - 500.0).abs() < 0.5, "{found} Hz at {swing}, {guess:?}");
            }
        }
    }

    #[test]
    fn fault_a_guess_without_a_mesh_near_it_is_refused() {
        for guess in [460.0, 550.0, 700.0, 800.0] {
            let why = mesh_hz(0.0, Some(guess)).expect_err("no mesh there").to_string();
            assert!(why.contains("mesh line"), "{guess}: {why}");
        }
    }
}
