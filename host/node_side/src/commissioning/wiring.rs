//! Second step, first half: sensor and converter, whether the machine turns or not.
//!
//! The bias is the mean of a waveform, as a code and, where the converter's reference is 3.3 V, as a voltage: a
//! sensor without supply, a broken wire or a short moves it to a rail. What a waveform of a fraction of a second
//! cannot show (a drift over hours) is not seen.

use super::ear::{Ear, Operator, Waveform};
use super::step::{Finding, Outcome};
use crate::Result;
use crate::spectral::{Window, amplitude_spectrum};
use meshband::config::{Configuration, SecondSensor};
use meshband::events::{EventKind, OF_SECOND};
use meshband::message::{ChannelValues, Indicators, Message};
use meshband::self_test::{MATHEMATICS, NOISE, RAILS, SAMPLE_COUNT};

/// How long sensor and converter are watched, s of the node: two stretches of the self-test and five values.
const WATCHED_S: f64 = 7.0;
/// Codes of the converter.
const CODES: f64 = 65_536.0;
/// Reference that a code's voltage is told for, V.
const REFERENCE_V: f64 = 3.3;
/// Distance of the bias from the declared zero, shares of the range: beyond the first it is worth a look, beyond the
/// second no sensor is there.
const BIAS: [f64; 2] = [0.1, 0.3];
/// Least vibration worth measuring, codes RMS: below it the converter hears itself.
const LEAST_CODES: f64 = 2.0;

/// Looks at sensor and converter.
///
/// # Errors
/// Of the link.
pub fn signal(ear: &mut Ear<'_>, config: &Configuration, operator: &mut dyn Operator) -> Result<Vec<Finding>> {
    let test = ear.self_test(WATCHED_S, operator)?;
    let (mut values, mut clipped_per_mille): (Vec<Indicators>, u32) = (Vec::new(), 0);
    ear.listen(WATCHED_S, operator, |message, _, _| {
        match message {
            Message::Indicators(indicators) => values.push(*indicators),
            Message::Event(event) if event.kind == EventKind::Saturated && event.detail & OF_SECOND == 0 => {
                clipped_per_mille = clipped_per_mille.max(event.detail);
            }
            _ => {}
        }
        Ok(false)
    })?;
    let mut findings = vec![items(test.run, test.failed)];
    findings.push(rails(&values, test.failed & RAILS != 0, clipped_per_mille));
    findings.push(moves(&values, test.failed & NOISE != 0));
    if let Some(second) = &config.second {
        let heard: Vec<ChannelValues> = values.iter().filter_map(|values| values.second).collect();
        findings.push(second_sensor(&heard, second));
    }
    if findings.iter().all(|finding| finding.outcome != Outcome::Refused) {
        match ear.waveform(operator)? {
            Some(waveform) => findings.extend(of_waveform(&waveform, config)),
            None => findings.push(Finding::warned("bias", "no waveform came whole", "look for losses on the line")),
        }
    }
    Ok(findings)
}

/// The items of the self-test that concern neither rails nor tach.
fn items(run: u8, failed: u8) -> Finding {
    let seen = format!("{} of 4 items run", (run & (SAMPLE_COUNT | RAILS | NOISE | MATHEMATICS)).count_ones());
    if failed & SAMPLE_COUNT != 0 {
        let advice = "the converter does not run at its timer's rate: board or image";
        return Finding::refused("self-test", "sample count differs from the timer's", advice);
    }
    if failed & MATHEMATICS != 0 {
        return Finding::refused("self-test", "results differ from the recorded ones", "image or processor is damaged");
    }
    Finding::passed("self-test", seen)
}

fn rails(values: &[Indicators], failed: bool, per_mille: u32) -> Finding {
    let clipped = values.iter().filter(|value| value.quality.overload).count();
    let seen = format!("{clipped} of {} records clipped, {per_mille} per mille of a block at most", values.len());
    let advice = "the signal reaches the converter's rails: bias, sensor supply, or less gain ([front_end] gain)";
    match clipped {
        _ if failed || (clipped == values.len() && clipped > 0) => Finding::refused("rails", seen, advice),
        0 => Finding::passed("rails", seen),
        _ => Finding::warned("rails", seen, advice),
    }
}

fn moves(values: &[Indicators], failed: bool) -> Finding {
    let stuck = values.iter().filter(|value| value.quality.stuck).count();
    if failed || (stuck == values.len() && stuck > 0) {
        let advice = "the sensor is dead: its supply, its wire, the input";
        return Finding::refused("sensor", "codes that never move", advice);
    }
    match values.last() {
        None => Finding::refused("sensor", "no values", "the node sends no values: is it stopped?"),
        Some(value) => Finding::passed("sensor", format!("RMS {:.4} m/s2, peak {:.4} m/s2", value.rms, value.peak)),
    }
}

/// The second sensor by its values alone: no waveform is taken of it.
fn second_sensor(values: &[ChannelValues], declared: &SecondSensor) -> Finding {
    let name = "second sensor";
    let Some(last) = values.last() else {
        let advice = "the node sends none: a board with one converter, or an image older than this setting";
        return Finding::refused(name, "no values", advice);
    };
    let bias = f64::from(last.mean_code);
    let away = (bias - f64::from(declared.zero_code)).abs() / CODES;
    let volts = bias / CODES * REFERENCE_V;
    let seen = format!("RMS {:.4} m/s2, peak {:.4} m/s2, bias {volts:.3} V of {REFERENCE_V} V", last.rms, last.peak);
    if values.iter().all(|values| values.quality.stuck) {
        return Finding::refused(name, "codes that never move", "it is dead: its supply, its wire, the input");
    }
    if values.iter().any(|values| values.quality.overload) {
        return Finding::warned(name, seen, "it reaches the converter's rails: bias, supply, or a less sensitive one");
    }
    match away {
        _ if away > BIAS[1] => Finding::refused(name, seen, "its bias is at a rail: supply, wire, or short"),
        _ if away > BIAS[0] => {
            Finding::warned(name, seen, "its bias lies beside [second] zero_code: coupling or midpoint")
        }
        _ => Finding::passed(name, seen),
    }
}

fn of_waveform(waveform: &Waveform, config: &Configuration) -> Vec<Finding> {
    let per_code = f64::from(config.sensor.acceleration_per_code.0) / f64::from(config.front_end.gain.factor());
    let count = waveform.samples.len() as f64;
    let mean = waveform.samples.iter().sum::<f64>() / count;
    let rms = (waveform.samples.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / count).sqrt();
    let code = f64::from(config.sensor.zero_code) + mean / per_code;
    let seen = format!("code {code:.0}, {:.3} V of {REFERENCE_V} V", code / CODES * REFERENCE_V);
    let away = (code - f64::from(config.sensor.zero_code)).abs() / CODES;
    let advice = "the bias lies beside the declared zero: coupling, midpoint, sensor supply, or [sensor] zero_code";
    let bias = match away {
        _ if away > BIAS[1] => Finding::refused("bias", seen, advice),
        _ if away > BIAS[0] => Finding::warned("bias", seen, advice),
        _ => Finding::passed("bias", seen),
    };

    let spectrum = amplitude_spectrum(&waveform.samples, waveform.rate_hz, Window::Hann);
    let floor = spectrum.median_between(0.0, waveform.rate_hz / 2.0);
    let seen = format!(
        "{floor:.5} m/s2 per line of {:.1} Hz, RMS of {:.1} codes",
        waveform.rate_hz / count,
        rms / per_code.abs()
    );
    let noise = if rms < LEAST_CODES * per_code.abs() {
        let advice = "the converter hears little but itself: more gain, a nearer mounting, or [sensor] \
            acceleration_per_code is wrong";
        Finding::warned("noise level", seen, advice)
    } else {
        Finding::passed("noise level", seen)
    };
    vec![bias, noise]
}
