//! Second step, second half: the tach, and whether channel and tach belong to the declared machine.
//!
//! The machine turns at any speed that it can keep for a while. Pulses are counted by the node; what the declared
//! wheel makes of them is a speed, and at that speed the declared teeth make a mesh line, which [`super::mesh_fit`]
//! looks for. With one channel an interchange of channels cannot be told from a wrong mounting: all that one channel
//! shows is whether it repeats with this tach.

use super::ear::{Ear, Operator, Waveform};
use super::mesh_fit::{Fit, fit};
use super::step::Finding;
use crate::Result;
use meshband::config::Configuration;
use meshband::message::{Message, Statistics};
use meshband::shaft_lines::OrderLine;
use meshband::tach::Validity;

/// How long a first pulse, and then a speed, is waited for, s of the node.
const PATIENCE_S: f64 = 60.0;
/// How long pulses are counted, s of the node.
const COUNTED_S: f64 = 12.0;
/// Share of pulses missing or beside their place: beyond the first it is worth a look, beyond the second the speed is
/// doubtful.
const BAD_PULSE_SHARES: [f64; 2] = [0.002, 0.05];
/// Waveforms in which the mesh line is looked for.
const WAVEFORMS: usize = 4;
/// Mean of the once-per-turn line over its standard error that counts as there.
const MIN_STANDARD_ERRORS: f64 = 4.0;

/// Looks at the tach and at what repeats with it.
///
/// # Errors
/// Of the link.
pub fn tach(ear: &mut Ear<'_>, config: &Configuration, operator: &mut dyn Operator) -> Result<Vec<Finding>> {
    operator.tell("wiring: turn the machine at a steady speed")?;
    if let Some(refusal) = wait_for_speed(ear, config, operator)? {
        return Ok(vec![refusal]);
    }
    let before = ear.statistics()?;
    let (mut lines, mut speeds, mut uncertainty): (Vec<OrderLine>, Vec<f64>, f32) = (Vec::new(), Vec::new(), 0.0);
    ear.listen(COUNTED_S, operator, |message, _, _| {
        match message {
            Message::Indicators(values) if values.quality.is_good() => {
                lines.extend(values.pinion.map(|pinion| pinion.lines[0]));
            }
            Message::Status(status) if status.validity == Validity::Locked => {
                speeds.push(f64::from(status.speed_hz));
                uncertainty = uncertainty.max(status.speed_uncertainty);
            }
            _ => {}
        }
        Ok(false)
    })?;
    let after = ear.statistics()?;
    let mut findings = vec![speed(&speeds, uncertainty), pulses(&before, &after, config)];
    let mut waveforms = Vec::new();
    for _ in 0..WAVEFORMS {
        waveforms.extend(ear.waveform(operator)?);
    }
    findings.push(mesh(&waveforms, config));
    findings.push(once_per_turn(&lines));
    findings.push(Finding::not_judged("channel", "one: an interchange shows only as a missing mesh line or 1x"));
    Ok(findings)
}

/// Waits for a locked speed; why there is none.
fn wait_for_speed(ear: &mut Ear<'_>, config: &Configuration, operator: &mut dyn Operator) -> Result<Option<Finding>> {
    let first = ear.statistics()?.pulses;
    let (mut locked, mut newest) = (false, Validity::default());
    ear.listen(PATIENCE_S, operator, |message, _, _| {
        if let Message::Status(status) = message {
            newest = status.validity;
            locked = status.validity == Validity::Locked;
        }
        Ok(locked)
    })?;
    if locked {
        return Ok(None);
    }
    let came = ear.statistics()?.pulses.wrapping_sub(first);
    let wheel = format!("{} pulses per turn, {} missing", config.tach.pulses_per_turn, config.tach.missing);
    Ok(Some(match came {
        0 => {
            let advice = "no tach pulse came: does the machine turn? Then the tach's supply, wire, level or edge \
                ([front_end] tach_edge)";
            Finding::refused("tach", format!("no pulse within {PATIENCE_S} s"), advice)
        }
        _ => {
            let seen = format!("{came} pulses within {PATIENCE_S} s and no speed ({newest:?})");
            let advice =
                format!("they do not fit the declared wheel ({wheel}): count its teeth, or keep the speed steadier");
            Finding::refused("tach", seen, advice)
        }
    }))
}

fn speed(speeds: &[f64], uncertainty: f32) -> Finding {
    let mean = speeds.iter().sum::<f64>() / speeds.len().max(1) as f64;
    let seen = format!("{mean:.3} Hz of the pinion, standard uncertainty {:.4} % at most", 100.0 * uncertainty);
    if speeds.is_empty() {
        return Finding::refused(
            "speed",
            "lost again at once",
            "keep the machine at a steady speed; then the tach's wire",
        );
    }
    if uncertainty > 0.01 {
        let advice = "an uneven wheel, a wandering speed, or double edges: look at the tach's signal";
        return Finding::warned("speed", seen, advice);
    }
    Finding::passed("speed", seen)
}

fn pulses(before: &Statistics, after: &Statistics, config: &Configuration) -> Finding {
    let since = |of: fn(&Statistics) -> u32| f64::from(of(after).wrapping_sub(of(before)));
    let (good, missed, spurious) = (since(|s| s.pulses), since(|s| s.pulses_missed), since(|s| s.pulses_spurious));
    let relocks = since(|s| s.relocks);
    let wheel = &config.tach;
    let seen = format!(
        "{good} accepted, {missed} missing, {spurious} beside their place, {relocks} times locked anew; declared {} \
         per turn",
        wheel.pulses_per_turn
    );
    let share = (missed + spurious) / (good + missed).max(1.0);
    let advice = "double edges: hysteresis or shield; missing ones: gap to the wheel, or teeth missing that were not \
        declared (--missing)";
    match share {
        _ if share > BAD_PULSE_SHARES[1] => Finding::refused("tach pulses", seen, advice),
        _ if share > BAD_PULSE_SHARES[0] || relocks > 0.0 => Finding::warned("tach pulses", seen, advice),
        _ => Finding::passed("tach pulses", seen),
    }
}

/// Whether the mesh line lies where wheel and teeth put it.
fn mesh(waveforms: &[Waveform], config: &Configuration) -> Finding {
    let (pulses, pinion, gear) = (config.tach.pulses_per_turn, config.gears.pinion_teeth, config.gears.gear_teeth);
    let what = "mesh line";
    match fit(waveforms, [pinion, gear], pulses) {
        Fit::Declared { line_hz, explained } => {
            let seen = format!("at {line_hz:.1} Hz with its harmonics, {:.0} % of the vibration", 100.0 * explained);
            Finding::passed(what, seen)
        }
        Fit::Nothing => {
            let advice =
                "no family of lines stands out at this speed: more load or speed, or the sensor sits elsewhere";
            Finding::warned(what, "none found", advice)
        }
        Fit::Pulses { fits, line_hz } => {
            let advice =
                format!("pulses per turn are wrong: {pulses} declared, {fits} fit the mesh line (--pulses {fits})");
            Finding::refused(what, format!("found at {line_hz:.1} Hz"), advice)
        }
        Fit::Interchanged { line_hz } => {
            let advice = format!(
                "teeth are interchanged, or the tach sits on the gear's shaft: {pinion} declared on the pinion, \
                 {gear} fit (the machine file, or --ratio)"
            );
            Finding::refused(what, format!("found at {line_hz:.1} Hz"), advice)
        }
    }
}

/// Whether the channel has something that repeats once per turn with this tach: the mean of the line against its
/// scatter.
fn once_per_turn(lines: &[OrderLine]) -> Finding {
    let what = "once per turn";
    let points: Vec<[f64; 2]> = lines
        .iter()
        .map(|line| {
            let (sine, cosine) = f64::from(line.phase_deg).to_radians().sin_cos();
            [f64::from(line.amplitude) * cosine, f64::from(line.amplitude) * sine]
        })
        .collect();
    let count = points.len() as f64;
    let advice = "nothing of the channel repeats with the tach: the machine is well balanced, or channel and tach \
        belong to different shafts";
    if points.len() < 3 {
        return Finding::warned(what, format!("{} records", points.len()), advice);
    }
    let mean = [0, 1].map(|axis| points.iter().map(|point| point[axis]).sum::<f64>() / count);
    let square = |point: &[f64; 2]| (point[0] - mean[0]).powi(2) + (point[1] - mean[1]).powi(2);
    let error = (points.iter().map(square).sum::<f64>() / (count * (count - 1.0))).sqrt();
    let amplitude = mean[0].hypot(mean[1]);
    let seen = format!("{amplitude:.5} m/s2, standard error {error:.5}, {} records", points.len());
    if amplitude > MIN_STANDARD_ERRORS * error {
        Finding::passed(what, seen)
    } else {
        Finding::warned(what, seen, advice)
    }
}
