//! How strongly the gears mesh over a run: where a swing of the load shows, and an angle that is off does not.
//!
//! An error of the angle turns the mesh lines and leaves their amplitudes; a load that swings swells all of them
//! alike. So the amplitudes are read over whole turns of the slower shaft, in which that shaft's sidebands vanish,
//! each relative to its mean, and their mean over a channel's lines, weighted by what noise leaves open of each, is
//! that channel's course of strength. What the path makes of a speed that wanders is taken off: powers of the speed
//! and its rate of change, by least squares. What is left is a spectrum of noise, over which a swing stands as one
//! line. All turns take part in the spectrum, held-out ones too: a quarter of the turns cannot tell a swing from its
//! mesh line. The swing must then be in step: fitted on the fitted turns, it must predict the held-out ones.
//!
//! In a run-up the path swells the lines. There each is read over whole turns of the pinion, relative to what the
//! calibrated model makes of it, which knows the path; what stands in step with it counts, weighted moment by moment
//! with what the line has over what is left of it there. Windows are equally far apart in time, "orders" are
//! frequencies over the mean speed: a load swings at a rate of its own, which no shaft gives. Only where pulses give
//! the angle: one that is taken from mesh lines turns with the path. Limit: a swing that moves the speed more than
//! all else does is taken off with the speed.

use super::baseline::Grids;
use super::scene::{Scene, SceneRun};
use super::spectra::{Spectra, follow_everywhere};
use super::split::Stretch;
use crate::analysis::lines::WINDOW;
use crate::analysis::mesh_phase::{running_power, running_sums};
use crate::analysis::search::Level;
use crate::spectral::{Spectrum, interpolated};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use realfft::RealFftPlanner;
use rustfft::num_complex::Complex64;
use std::f64::consts::{LN_2, PI, TAU};
use std::ops::Range;

/// Windows begun per turn of the shaft whose turn each lasts.
const PER_TURN: usize = 8;
/// Fewest windows of a course.
const MIN_WINDOWS: usize = 12 * PER_TURN;
/// Largest noise, of relative amplitudes, with which a line takes part.
const MAX_RELATIVE_NOISE: f64 = 0.1;
/// Turns on either side over which what is left of a line in a run-up is its noise.
const NOISE_TURNS: usize = 6;
/// Powers of the speed that are taken off.
const POWERS: i32 = 5;
/// Lowest bin read, and highest order, share of the slower shaft's: there the window has a tenth of its response.
const LOWEST_BIN: f64 = 4.0;
const MAX_ORDER_SHARE: f64 = 0.9;
/// Steps of a bin, each way, in which a swing's order is refined.
const STEPS_PER_BIN: i32 = 20;
/// Singular values below it are none.
const MIN_SINGULAR_VALUE: f64 = 1e-9;
/// Most by which held-out and fitted turns may differ in a swing's strength, and in its phase (set on generated
/// records: swings were within a factor of 1.6 and 23 degrees, the two remainders of a wander that passed all else 36
/// and 59 degrees off).
const MAX_STRENGTH_RATIO: f64 = 1.75;
const MAX_PHASE_DIFFERENCE_RAD: f64 = PI / 6.0;

/// The course of one channel of a run.
#[derive(Debug, Clone)]
struct Course {
    /// Relative strength less what the speed makes of it, window by window.
    values: Vec<f64>,
    /// Weights of the windows: what the speed makes of the strength is not known at the ends of the run.
    weights: Vec<f64>,
    /// Power of the noise in it, of one window were it without length.
    noise: f64,
}

/// Courses of strength with their spectra.
#[derive(Debug, Clone)]
pub struct Strength {
    /// Spectra over orders of the pinion; nothing stands in them where a run has no course.
    pub spectra: Spectra,
    courses: Vec<Vec<Option<Course>>>,
}

impl Strength {
    /// Of all turns; `left` is what the calibrated model leaves.
    pub fn of(scene: &Scene, left: &Grids) -> Self {
        let z = scene.mesh_order();
        let orders: Vec<f64> = (1..=(scene.highest_order / z) as usize).map(|k| k as f64 * z).collect();
        let of_run = |(run, left): (&SceneRun, &Vec<Vec<f64>>)| -> Vec<Option<Course>> {
            if !run.runs_up() {
                return run.samples.par_iter().map(|samples| course(run, samples, &orders)).collect();
            }
            let mut courses = vec![None; left.len()];
            courses[0] = swept_course(run, &left[..scene.searched], &orders);
            courses
        };
        let courses: Vec<Vec<Option<Course>>> = scene.runs.iter().zip(left).map(of_run).collect();
        let slower = scene.gear_order.min(1.0);
        let levels = scene
            .runs
            .iter()
            .zip(&courses)
            .map(|(run, courses)| courses.iter().map(|course| vec![level(run, course.as_ref())]).collect());
        let levels: Vec<Vec<Vec<Level>>> = levels.collect();
        let lowest = LOWEST_BIN * scene.runs.iter().map(bin).fold(0.0, f64::max);
        Self { spectra: Spectra { levels, lowest, highest: MAX_ORDER_SHARE * slower }, courses }
    }

    /// The order within a bin at which a swing takes most off the courses of all turns.
    pub fn refined(&self, scene: &Scene, channels: Range<usize>, order: f64) -> f64 {
        let step = self.spectra.bin(0) / f64::from(STEPS_PER_BIN);
        let taken = |order: f64| -> f64 {
            let of = |run: &SceneRun, course: &Course| {
                let all: Vec<usize> = (0..course.values.len()).collect();
                let wave = Wave { hop: hop(run), order };
                wave.gain(course, &all, wave.fitted(course, &all))
            };
            self.over(scene, channels.clone(), of).into_iter().sum()
        };
        let tried =
            (-STEPS_PER_BIN..=STEPS_PER_BIN).map(|i| order + f64::from(i) * step).map(|order| (taken(order), order));
        tried.max_by(|a, b| a.0.total_cmp(&b.0)).map_or(order, |(_, order)| order)
    }

    /// What the held-out turns say of a swing of this order.
    pub fn held_out(&self, scene: &Scene, channels: Range<usize>, order: f64) -> HeldOut {
        let of = |run: &SceneRun, course: &Course| {
            let [fit, held] = [&run.split.fit, &run.split.held_out].map(|stretches| inside(run, stretches));
            let wave = Wave { hop: hop(run), order };
            let [fitted, own] = [wave.fitted(course, &fit), wave.fitted(course, &held)];
            (wave.gain(course, &held, fitted), own * fitted.conj() / course.noise, fitted.norm_sqr() / course.noise)
        };
        let of_courses = self.over(scene, channels, of);
        let sum = |of: fn(&(f64, Complex64, f64)) -> Complex64| of_courses.iter().map(of).sum::<Complex64>();
        let size = sum(|own| own.2.into()).re;
        HeldOut { ln_bayes: sum(|own| own.0.into()).re, ratio: sum(|own| own.1) / size.max(f64::MIN_POSITIVE) }
    }

    /// Something of every course of some channels.
    fn over<T>(&self, scene: &Scene, channels: Range<usize>, of: impl Fn(&SceneRun, &Course) -> T) -> Vec<T> {
        let runs = scene.runs.iter().zip(&self.courses);
        let courses = runs.flat_map(|(run, courses)| courses[channels.clone()].iter().flatten().map(move |c| (run, c)));
        courses.map(|(run, course)| of(run, course)).collect()
    }
}

/// What the held-out turns say of a swing.
#[derive(Debug, Clone, Copy)]
pub struct HeldOut {
    /// Logarithm of their likelihood ratio with the swing as the fitted turns have it against none.
    pub ln_bayes: f64,
    /// The swing there over that on the fitted turns, meaned over channels.
    pub ratio: Complex64,
}

impl HeldOut {
    /// Whether it is about as strong there, and in step within a twelfth of a turn: what a wander's remainder now and
    /// then predicts is not.
    pub fn agrees(&self) -> bool {
        (1.0 / MAX_STRENGTH_RATIO..MAX_STRENGTH_RATIO).contains(&self.ratio.norm())
            && self.ratio.arg().abs() < MAX_PHASE_DIFFERENCE_RAD
    }
}

/// A swing of one order, over windows so far apart.
struct Wave {
    hop: f64,
    order: f64,
}

impl Wave {
    fn at(&self, window: usize) -> Complex64 {
        Complex64::from_polar(1.0, TAU * self.order * self.hop * window as f64)
    }

    /// Its complex amplitude by least squares over some windows, beside a constant.
    fn fitted(&self, course: &Course, windows: &[usize]) -> Complex64 {
        let row = |&i: &usize| [self.at(i).re, -self.at(i).im, 1.0];
        let rows: Vec<[f64; 3]> = windows.iter().map(row).collect();
        let values: Vec<f64> = windows.iter().map(|&i| course.values[i]).collect();
        let weights: Vec<f64> = windows.iter().map(|&i| course.weights[i]).collect();
        let fit = least_squares(&rows, &values, &weights);
        if fit.is_empty() { Complex64::default() } else { Complex64::new(fit[0], fit[1]) }
    }

    /// Logarithm of the likelihood ratio of some windows, weighted, with this amplitude against none. They overlap:
    /// each has an eighth of the noise's power, and of eight one is new.
    fn gain(&self, course: &Course, windows: &[usize], amplitude: Complex64) -> f64 {
        let gain = |&i: &usize| {
            let (value, wave) = (course.values[i], (amplitude * self.at(i)).re);
            course.weights[i] * (value * value - (value - wave).powi(2))
        };
        windows.iter().map(gain).sum::<f64>() / (2.0 * course.noise)
    }
}

/// Windows that lie within stretches.
fn inside(run: &SceneRun, stretches: &[Stretch]) -> Vec<usize> {
    let lies = |(_, from): &(usize, f64)| {
        let to = from + window(run);
        stretches.iter().any(|s| *from >= s.from as f64 && to <= (s.from + s.turns) as f64)
    };
    starts(run).into_iter().enumerate().filter(lies).map(|(i, _)| i).collect()
}

/// Length of a window, turns of the pinion.
fn window(run: &SceneRun) -> f64 {
    if run.runs_up() { 1.0 } else { 1.0 / run.angle.slower_order() }
}

/// Where the windows begin, turns of the pinion from the first of the grid: equally far apart, in a run-up in time.
fn starts(run: &SceneRun) -> Vec<f64> {
    let count = windows(run);
    if !run.runs_up() {
        return (0..count).map(|i| i as f64 * hop(run)).collect();
    }
    let (angle, turns) = (&run.angle, run.angle.turns as f64);
    let [first, last] = [0.0, turns].map(|turn| angle.map.time_at(angle.from_turn + turn));
    let begins = |i: usize| {
        let middle = (i as f64 * hop(run) + 0.5 * window(run)) / turns;
        let turn = angle.map.turns_at(first + middle * (last - first)) - angle.from_turn;
        (turn - 0.5 * window(run)).clamp(0.0, turns - window(run))
    };
    (0..count).map(begins).collect()
}

/// Turns of the pinion from one window to the next; in a run-up at its mean speed.
fn hop(run: &SceneRun) -> f64 {
    window(run) / PER_TURN as f64
}

/// Spacing of the spectrum, orders of the pinion.
fn bin(run: &SceneRun) -> f64 {
    1.0 / (windows(run).max(1) as f64 * hop(run))
}

/// Windows that fit into a run.
fn windows(run: &SceneRun) -> usize {
    ((run.angle.turns as f64 / hop(run)).floor() as usize + 1).saturating_sub(PER_TURN)
}

/// The course of a channel; nothing in a short run and where no line is clear.
fn course(run: &SceneRun, samples: &[f64], orders: &[f64]) -> Option<Course> {
    let count = windows(run);
    if count < MIN_WINDOWS {
        return None;
    }
    let weights = WINDOW.weights(count);
    let (mut sum, mut total) = (vec![0.0; count], 0.0);
    for order in orders {
        let relative = amplitudes(run, samples, *order);
        let noise = noise(&powers(run, &relative, &weights));
        if noise > 0.0 && noise < MAX_RELATIVE_NOISE {
            sum.iter_mut().zip(&relative).for_each(|(s, x)| *s += x / noise);
            total += 1.0 / noise;
        }
    }
    if total == 0.0 {
        return None;
    }
    sum.iter_mut().for_each(|s| *s /= total);
    Course::of(run, &sum, weights)
}

/// The course of all channels of a run-up together, of which the calibrated model leaves `left`: a swing is in step
/// in all of them. Nothing in a short run, where no line is clear, and without pulses.
fn swept_course(run: &SceneRun, left: &[Vec<f64>], orders: &[f64]) -> Option<Course> {
    let count = windows(run);
    if count < MIN_WINDOWS || !run.has_pulses {
        return None;
    }
    let lines: Vec<(&Vec<f64>, &Vec<f64>, f64)> =
        run.samples.iter().zip(left).flat_map(|(x, left)| orders.iter().map(move |order| (x, left, *order))).collect();
    let of_line = |(samples, left, order): &(&Vec<f64>, &Vec<f64>, f64)| {
        let [all, left] = [samples, left].map(|samples| over_windows(run, samples, *order));
        let own: Vec<Complex64> = all.iter().zip(&left).map(|(all, left)| all - left).collect();
        in_step(&own, &left)
    };
    let (mut sums, mut totals) = (vec![0.0; count], vec![0.0; count]);
    for line in lines.par_iter().map(of_line).collect::<Vec<_>>() {
        for (i, [sum, total]) in line.into_iter().enumerate() {
            sums[i] += sum;
            totals[i] += total;
        }
    }
    let mut sorted = totals.clone();
    sorted.sort_by(f64::total_cmp);
    let usual = sorted[count / 2];
    if usual * MAX_RELATIVE_NOISE < 1.0 {
        return None;
    }
    let relative: Vec<f64> = sums.iter().zip(&totals).map(|(sum, total)| sum / total.max(f64::MIN_POSITIVE)).collect();
    let weights = WINDOW.weights(count).iter().zip(&totals).map(|(w, total)| w * (total / usual).min(1.0)).collect();
    Course::of(run, &relative, weights)
}

/// What is left of a line in step with it, and its own power, over the noise about each window.
fn in_step(own: &[Complex64], left: &[Complex64]) -> Vec<[f64; 2]> {
    let of = |((own, left), power): ((&Complex64, &Complex64), f64)| {
        let noise = power.max(f64::MIN_POSITIVE);
        [(own.conj() * left).re / noise, own.norm_sqr() / noise]
    };
    own.iter().zip(left).zip(running_power(left, NOISE_TURNS * PER_TURN)).map(of).collect()
}

impl Course {
    /// Of relative strengths; nothing where there is no noise to compare with.
    fn of(run: &SceneRun, relative: &[f64], weights: Vec<f64>) -> Option<Self> {
        let values = without_the_speed(run, relative, &weights);
        let noise = noise(&powers(run, &values, &weights));
        (noise > 0.0).then_some(Self { values, weights, noise })
    }
}

/// A line's sums over the windows.
fn over_windows(run: &SceneRun, samples: &[f64], order: f64) -> Vec<Complex64> {
    let per_turn = run.angle.per_turn[0] as f64;
    let sums = running_sums(samples, order / per_turn);
    // A window is no whole number of samples; what it were too long, the other lines would leave in it.
    let upto = |turn: f64| {
        let place = turn * per_turn;
        let before = (place as usize).min(samples.len() - 1);
        sums[before] + (sums[before + 1] - sums[before]) * (place - before as f64).min(1.0)
    };
    starts(run).into_iter().map(|start| upto(start + window(run)) - upto(start)).collect()
}

/// A line's amplitude window by window, relative to its mean, less one.
fn amplitudes(run: &SceneRun, samples: &[f64], order: f64) -> Vec<f64> {
    let amplitudes: Vec<f64> = over_windows(run, samples, order).iter().map(|sum| sum.norm()).collect();
    let mean = (amplitudes.iter().sum::<f64>() / amplitudes.len() as f64).max(f64::MIN_POSITIVE);
    amplitudes.iter().map(|a| a / mean - 1.0).collect()
}

/// Bins of a run's spectrum.
fn bins(run: &SceneRun) -> usize {
    (MAX_ORDER_SHARE * run.angle.slower_order() / bin(run)).ceil() as usize + 1
}

/// Power of a course over orders, as of windows without length, up to the highest order read.
fn powers(run: &SceneRun, values: &[f64], weights: &[f64]) -> Vec<f64> {
    let squares: f64 = weights.iter().map(|w| w * w).sum();
    let mut windowed: Vec<f64> = values.iter().zip(weights).map(|(x, w)| x * w).collect();
    let forward = RealFftPlanner::<f64>::new().plan_fft_forward(windowed.len());
    let mut spectrum = forward.make_output_vec();
    forward.process(&mut windowed, &mut spectrum).expect("matching lengths");
    let response = |i: usize| {
        let x = PI * i as f64 * bin(run) * window(run);
        if i == 0 { 1.0 } else { x.sin() / x }
    };
    let power = |(i, value): (usize, &Complex64)| value.norm_sqr() / (squares * response(i).powi(2));
    spectrum.iter().take(bins(run)).enumerate().map(power).collect()
}

/// Power of the noise: the median's of all bins read.
fn noise(powers: &[f64]) -> f64 {
    let mut sorted: Vec<f64> = powers.iter().skip(LOWEST_BIN as usize).copied().collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0) / LN_2
}

/// A course less its least-squares fit by powers of the speed and by its rate of change, which a path answers late,
/// under the spectrum's window.
fn without_the_speed(run: &SceneRun, course: &[f64], weights: &[f64]) -> Vec<f64> {
    let (speeds, rates): (Vec<f64>, Vec<f64>) = run.states.iter().map(|state| (state.speed_hz, state.swing)).unzip();
    let starts = starts(run);
    let middle = |start: &f64| start + 0.5 * window(run) - 0.5;
    let read = |values: &[f64]| -> Vec<f64> { starts.iter().map(|i| interpolated(values, middle(i))).collect() };
    let speeds = standardised(read(&speeds));
    let rates = standardised(read(&rates));
    let row = |(u, rate): (&f64, &f64)| {
        let powers = (0..=POWERS).map(|power| u.powi(power));
        powers.chain([*rate, rate * u, rate * rate]).collect::<Vec<f64>>()
    };
    let rows: Vec<Vec<f64>> = speeds.iter().zip(&rates).map(row).collect();
    let fit = least_squares(&rows, course, weights);
    let left = |(row, y): (&Vec<f64>, &f64)| y - row.iter().zip(&fit).map(|(x, c)| x * c).sum::<f64>();
    rows.iter().zip(course).map(left).collect()
}

/// Values less their mean, over their standard deviation.
fn standardised(mut values: Vec<f64>) -> Vec<f64> {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    values.iter_mut().for_each(|x| *x -= mean);
    let deviation = (values.iter().map(|x| x * x).sum::<f64>() / count).sqrt().max(1e-12 * mean.abs());
    values.iter_mut().for_each(|x| *x /= deviation.max(f64::MIN_POSITIVE));
    values
}

/// Coefficients of weighted least squares.
fn least_squares<Row: AsRef<[f64]>>(rows: &[Row], values: &[f64], weights: &[f64]) -> Vec<f64> {
    let n = rows.first().map_or(0, |row| row.as_ref().len());
    if n == 0 {
        return Vec::new();
    }
    let matrix = DMatrix::from_fn(rows.len(), n, |i, j| weights[i].sqrt() * rows[i].as_ref()[j]);
    let right = DVector::from_fn(rows.len(), |i, _| weights[i].sqrt() * values[i]);
    let solved = matrix.svd(true, true).solve(&right, MIN_SINGULAR_VALUE);
    solved.map_or_else(|_| vec![0.0; n], |x| x.iter().copied().collect())
}

/// Spectrum of a course, as of a window without length; noise alone of one where there is no course.
fn level(run: &SceneRun, course: Option<&Course>) -> Level {
    let none = vec![1.0; bins(run)];
    let with = |values: Vec<f64>, floor: Vec<f64>, floor_error| Level {
        density: Spectrum { bin: bin(run), values },
        averages: 1,
        floor,
        floor_error,
    };
    let Some(course) = course else { return with(none.clone(), none, 0.0) };
    let values = powers(run, &course.values, &course.weights);
    let floor = vec![course.noise; values.len()];
    let floor_error = (values.len() as f64).sqrt().recip();
    let mut level = with(values, floor, floor_error);
    follow_everywhere(&mut level);
    level
}
