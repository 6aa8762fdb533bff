//! Overall values of measured and simulated machines against references in double precision.
//!
//! What the sensor hears between two samples of the record is a straight line, for the node and for the reference alike.

use crate::node_trials::{imported, measured, paper_rig};
use crate::node_values::{Run, Tolerance, assert_values_of, configuration};
use meshband_host::import::Unit as SourceUnit;
use meshband_host::virtual_node::signal::Signal;

/// Largest acceleration, m/s2: within the range of the node's codes.
const LARGEST: f64 = 40.0;

/// Mesh lines of a fast machine lie behind the velocity's band: 80 dB below what they would be in it do not count.
const SHARP: Tolerance = Tolerance { peaks: 1e-2, skirts: 1e-4 };

/// Judges the values of a signal at its own speed.
fn assert_values(signal: &Signal) {
    let samples = &signal.samples;
    let (mean, count) = (samples.iter().sum::<f64>() / samples.len() as f64, samples.len());
    let largest = samples.iter().map(|x| (x - mean).abs()).fold(0.0, f64::max);
    let at = |t: f64, _: f64| {
        let place = (t * signal.rate_hz).min((count - 2) as f64);
        let (before, share) = (place as usize, place.fract());
        let between = samples[before] + share * (samples[before + 1] - samples[before]);
        (between - mean) * LARGEST / largest
    };
    let marks = signal.edges_s.len() - 1;
    let turns = marks as f64 / f64::from(signal.pulses_per_turn) * signal.pinion_per_tach;
    let speed = turns / (signal.edges_s[marks] - signal.edges_s[0]);
    let seconds = (count - 2) as f64 / signal.rate_hz - 1.0;
    let least = assert_values_of(configuration(), Run { speed, growth: 0.0 }, seconds, SHARP, at);
    println!("{}: {speed:.2} Hz, peaks of {least:.1} m/s2 at least", signal.channel);
}

#[test]
fn ref_values_of_gear0_are_those_of_the_record() {
    let names = ["1", "2", "3", "4"].map(|n| format!("gear0/3027_217_Data_Chan{n}.mat"));
    let Some(files) = measured("values of gear0", &names.each_ref().map(String::as_str)) else { return };
    let record = imported(&files, [23, 46], 25_600.0, SourceUnit::MetrePerSecondSquared);
    for channel in ["0", "1", "2", "3"] {
        assert_values(&Signal::of_record(&record, 0, (channel, None), 1.0, Some(8.0)).expect("a channel"));
    }
}

#[test]
fn ref_values_of_a_simulated_rig_are_those_of_the_simulation() {
    // At 60 Hz nothing but aliases 70 dB down is left of this rig in the velocity's band.
    for speed in [5.0, 14.5, 25.0] {
        assert_values(&paper_rig(speed, None, 6.0));
    }
}
