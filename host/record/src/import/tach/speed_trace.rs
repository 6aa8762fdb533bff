//! A speed over time as the speed reference: its integral is the angle, and pulses are put where that is whole.
//!
//! What says that a channel is a speed is its unit (rpm, turns/s, rad/s), or a name that says rpm on values that
//! never come near zero, as pulses would. Limit: the angle drifts by what the trace is wrong; angle 0 is the first
//! sample's.

use super::TachOptions;
use crate::import::units::{self, Quantity};
use crate::{Error, Result};

/// Revolutions per minute of a turn per second.
const RPM: f64 = 60.0;
/// Lowest value over the highest one above which numbers called rpm are no pulses.
const NO_PULSES: f64 = 0.2;

/// Turns per second of one of the channel's numbers; `None` where it is no speed trace.
pub(super) fn turns_per_second(
    name: &str,
    unit: Option<&str>,
    quantity: Option<Quantity>,
    values: &[f64],
) -> Option<f64> {
    let measure = unit.filter(|unit| !units::is_empty(unit)).and_then(units::measure);
    if let Some(measure) = measure {
        return (measure.quantity == Quantity::Speed).then_some(measure.factor / RPM);
    }
    let named = quantity == Some(Quantity::Speed) && units::words(name).iter().any(|word| word == "rpm");
    let (least, most) = values.iter().fold((f64::INFINITY, 0.0_f64), |(least, most), x| (least.min(*x), most.max(*x)));
    (named && least > NO_PULSES * most).then_some(1.0 / RPM)
}

/// Pulses at the whole parts of a turn of a trace of `factor` turns/s per number.
///
/// # Errors
/// A speed below zero, or one that never makes two pulses.
pub(super) fn pulses(
    place: &str,
    source: &str,
    values: &[f64],
    factor: f64,
    rate_hz: f64,
    options: &TachOptions,
) -> Result<Vec<f64>> {
    let most = values.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    if let Some(at) = values.iter().position(|x| *x < -1e-3 * most) {
        let what = format!(
            "{source} is a speed and is {} at {:.4} s; a shaft that turns back has no pulses here",
            values[at],
            at as f64 / rate_hz
        );
        return Err(Error::invalid(place, what));
    }
    let marks = f64::from(options.pulses);
    let (mut angle, mut next, mut edges_s) = (0.0, 1.0, Vec::new());
    for (i, pair) in values.windows(2).enumerate() {
        let step = 0.5 * (pair[0] + pair[1]).max(0.0) * factor * marks / rate_hz;
        while step > 0.0 && angle + step >= next {
            edges_s.push((i as f64 + (next - angle) / step) / rate_hz);
            next += 1.0;
        }
        angle += step;
    }
    if edges_s.len() < 2 {
        let what = format!("{source} is a speed of {angle:.2} pulses in the run; two are needed");
        return Err(Error::invalid(place, what));
    }
    Ok(edges_s)
}

#[cfg(test)]
mod tests {
    use super::super::Shaft;
    use super::*;

    #[test]
    fn theory_a_trace_in_rpm_is_integrated_to_pulses() {
        let options =
            TachOptions { sources: vec!["n".into()], pulses: 1, shaft: Shaft::Pinion, falling: None, threshold: None };
        // From 600 rpm up by 60 rpm per second: 10 t + t^2 / 2 turns.
        let trace: Vec<f64> = (0..=4000).map(|i| 600.0 + 0.06 * f64::from(i)).collect();
        let factor = turns_per_second("n", Some("rpm"), None, &trace).expect("a speed");
        let edges_s = pulses("here", "channel 2", &trace, factor, 1000.0, &options).expect("pulses");
        assert_eq!(edges_s.len(), 48);
        for (k, edge) in edges_s.iter().enumerate() {
            assert!((10.0 * edge + 0.5 * edge * edge - (k + 1) as f64).abs() < 1e-4, "{k}: {edge}");
        }
        assert_eq!(turns_per_second("speed", None, Some(Quantity::Speed), &[0.0, 5.0]), None);
        assert_eq!(turns_per_second("rpm", None, Some(Quantity::Speed), &[0.0, 5.0]), None);
        assert_eq!(turns_per_second("rpm", None, Some(Quantity::Speed), &[1499.0, 1501.0]), Some(1.0 / 60.0));
    }
}
