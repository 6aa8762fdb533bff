//! Overall values of measured and simulated machines against references in double precision.
//!
//! What the sensor hears between two samples of the record is a straight line, for the node and for the reference
//! alike.

use crate::node_trials::{imported, measured, paper_rig};
use crate::node_values::{Run, Tolerance, assert_values_of, configuration, listen};
use meshband_host::import::Unit as SourceUnit;
use meshband_host::virtual_node::signal::Signal;
use rustfft::num_complex::Complex;
use std::f64::consts::TAU;

/// Largest acceleration, m/s2: within the range of the node's codes.
const MAX_ACCELERATION_M_S2: f64 = 40.0;

/// Mesh lines of a fast machine lie behind the velocity's band: 80 dB below what they would be in it do not count.
const SHARP_TOLERANCE: Tolerance = Tolerance { peaks: 1e-2, skirts: 1e-4 };

/// What the sensor hears at a time, within the range of the codes.
fn heard(signal: &Signal) -> impl Fn(f64, f64) -> f64 + Copy {
    let (samples, rate_hz) = (&signal.samples, signal.rate_hz);
    let (mean, count) = (samples.iter().sum::<f64>() / samples.len() as f64, samples.len());
    let largest = samples.iter().map(|x| (x - mean).abs()).fold(0.0, f64::max);
    move |t, _| {
        let place = (t * rate_hz).min((count - 2) as f64);
        let (before, share) = (place as usize, place.fract());
        let between = samples[before] + share * (samples[before + 1] - samples[before]);
        (between - mean) * MAX_ACCELERATION_M_S2 / largest
    }
}

/// Its own mean speed, and how long it lasts, s.
fn run_of(signal: &Signal) -> (Run, f64) {
    let marks = signal.edges_s.len() - 1;
    let turns = marks as f64 / f64::from(signal.pulses_per_turn) * signal.pinion_per_tach;
    let speed = turns / (signal.edges_s[marks] - signal.edges_s[0]);
    (Run { speed, growth: 0.0 }, (signal.samples.len() - 2) as f64 / signal.rate_hz - 1.0)
}

/// Judges the values of a signal at its own speed.
fn assert_values(signal: &Signal) {
    let (run, seconds) = run_of(signal);
    let least = assert_values_of(configuration(), run, seconds, SHARP_TOLERANCE, heard(signal));
    println!("{}: {:.2} Hz, peaks of {least:.1} m/s2 at least", signal.channel, run.speed);
}

/// Steps of the reference in a tooth pitch.
const STEPS: usize = 210;
const TEETH: usize = 19;
/// Half the length of the node's window, steps: three pitches.
const HALF: i64 = 3 * STEPS as i64;

/// Blackman-Harris window of six pitches at a step from its middle.
fn window(step: i64) -> f64 {
    let angle = TAU * (step + HALF) as f64 / (2 * HALF) as f64;
    0.35875 - 0.48829 * angle.cos() + 0.14128 * (2.0 * angle).cos() - 0.01168 * (3.0 * angle).cos()
}

/// Once per turn by the node's own definition, in double precision: means of six pitches under the window, one for
/// every pitch, as running sums of the line; a record is the difference of two.
fn smoothed_sums(signal: &[f64]) -> Vec<Complex<f64>> {
    let weights: Vec<f64> = (-HALF..=HALF).map(window).collect();
    let weight: f64 = weights.iter().sum();
    let droop: f64 = (-HALF..=HALF)
        .zip(&weights)
        .map(|(step, w)| w * (TAU * step as f64 / (STEPS * TEETH) as f64).cos())
        .sum::<f64>()
        / weight;
    let mut sums = vec![Complex::new(0.0, 0.0)];
    for (pitch, around) in (3usize..).zip(signal.windows(weights.len()).step_by(STEPS)) {
        let value = around.iter().zip(&weights).map(|(x, w)| x * w).sum::<f64>() / weight;
        let line = Complex::from_polar(2.0 * value / droop / TEETH as f64, TAU * pitch as f64 / TEETH as f64);
        sums.push(sums[sums.len() - 1] + line);
    }
    sums
}

/// Once per turn by sums over the very turns, without a window, as running sums at every pitch.
fn plain_sums(signal: &[f64]) -> Vec<Complex<f64>> {
    let mut sums = vec![Complex::new(0.0, 0.0)];
    let mut sum = Complex::new(0.0, 0.0);
    for (step, value) in signal.iter().enumerate() {
        let turns = step as f64 / (STEPS * TEETH) as f64;
        sum += Complex::from_polar(2.0 * value / (STEPS * TEETH) as f64, TAU * turns);
        if (step + 1) % STEPS == 0 {
            sums.push(sum);
        }
    }
    sums
}

/// Largest departure from running sums in degrees, a hundredth of the amplitude counting as a quarter of one. Records
/// follow on each other, so where the first one begins is all that has to be found.
fn departure(found: &[(usize, Complex<f64>)], sums: &[Complex<f64>]) -> f64 {
    let off = |first: usize| -> Option<f64> {
        let mut from = first;
        let mut worst = 0.0f64;
        for (turns, line) in found {
            let to = from + turns * TEETH;
            let ratio = line / ((sums.get(to)? - sums[from]) / *turns as f64);
            worst = worst.max(ratio.arg().to_degrees().abs()).max((ratio.norm() - 1.0).abs() * 25.0);
            from = to;
        }
        Some(worst)
    };
    (0..).map_while(off).fold(f64::INFINITY, f64::min)
}

/// Once per turn of the pinion, record by record, a line of a two-hundredth of the signal in its noise: within a
/// twentieth of a degree of its own definition in double precision. A record's window reaches three pitches beyond
/// its turns and weighs their ends less; against sums over the very turns that noise at the ends is up to a degree.
fn assert_once_per_turn(signal: &Signal) {
    let (run, seconds) = run_of(signal);
    let at = heard(signal);
    let values = listen(configuration(), run, seconds, true, at);
    let found: Vec<(usize, Complex<f64>)> = values
        .iter()
        .filter_map(|value| value.pinion)
        .map(|orders| {
            let line = orders.lines[0];
            let phase = f64::from(line.phase_deg).to_radians();
            (usize::from(orders.turns), Complex::from_polar(f64::from(line.amplitude), phase))
        })
        .collect();
    assert!(found.len() >= 4, "{} records", found.len());
    let steps = (STEPS * TEETH) as f64;
    let heard: Vec<f64> = (0..(seconds * run.speed * steps) as usize)
        .map(|step| at(step as f64 / steps / run.speed, step as f64 / steps))
        .collect();
    let (own, plain) = (departure(&found, &smoothed_sums(&heard)), departure(&found, &plain_sums(&heard)));
    println!(
        "{}: {} records of {:.3} m/s2, {own:.3} degrees by their definition, {plain:.3} by plain sums",
        signal.channel,
        found.len(),
        found[0].1.norm()
    );
    assert!(own < 0.05 && plain < 1.0, "{}: {own} and {plain} degrees", signal.channel);
}

#[test]
fn ref_values_of_gear0_are_those_of_the_record() {
    let names = ["1", "2", "3", "4"].map(|n| format!("gear0/3027_217_Data_Chan{n}.mat"));
    let Some(files) = measured("values of gear0", &names.each_ref().map(String::as_str)) else { return };
    let record = imported(&files, [23, 46], 25_600.0, SourceUnit::MetrePerSecondSquared);
    for channel in ["0", "1", "2", "3"] {
        let signal = Signal::of_record(&record, 0, (channel, None), 1.0, Some(8.0)).expect("a channel");
        assert_values(&signal);
        assert_once_per_turn(&signal);
    }
}

#[test]
fn ref_values_of_a_simulated_rig_are_those_of_the_simulation() {
    // At 60 Hz nothing but aliases 70 dB down is left of this rig in the velocity's band.
    for speed in [5.0, 14.5, 25.0] {
        assert_values(&paper_rig(speed, None, 6.0));
    }
}
