//! What a node said, as a letter: alarms first, then its state and what is to be done.

use super::Losses;
use super::alarms::Alarms;
use super::text::{figure, identity, status_notes};
use super::view::View;
use super::words::words;
use crate::report::facts::Facts;
use meshband::node::State;
use meshband::tach::Validity;

/// Alarms, then what the node does, then what to do next.
pub fn of_view(view: &View, losses: Losses, source: &str) -> Vec<String> {
    let alarms = Alarms::of(view);
    let mut letter = alarms.lines();
    letter.push(state(view, source));
    letter.push(next(view, &alarms, losses));
    letter
}

fn state(view: &View, source: &str) -> String {
    let Some(status) = &view.status else { return format!("The node at {source} has sent no status.") };
    let mut sentence = format!("The node at {source}: {}", words(&status.state));
    if status.validity == Validity::Locked {
        let hz = f64::from(status.speed_hz);
        sentence += &format!(", pinion at {hz:.2} Hz ({:.0} rpm)", 60.0 * hz);
    } else {
        sentence += &format!(", speed {}", words(&status.validity));
    }
    if let Some(values) = &view.indicators {
        let velocity = figure(1e3 * values.velocity_rms, 2);
        sentence += &format!(", RMS {:.3} m/s2, velocity {velocity} mm/s RMS", values.rms);
    }
    let notes = status_notes(status);
    if !notes.is_empty() {
        sentence += &format!("; {}", notes.join("; "));
    }
    sentence + "."
}

fn next(view: &View, alarms: &Alarms, losses: Losses) -> String {
    let Some(status) = &view.status else {
        return "Next: see that the node is started and its line whole: no verdict can be given.".into();
    };
    if alarms.signal_bad {
        return "Next: see to the sensor, its supply and gain: what the other values say of the machine counts for \
         little."
            .into();
    }
    if !alarms.standing.is_empty() {
        return "Next: look at the machine; fetch the waveform of the alarm (`meshband capture`) or record it and \
         have it analysed (`meshband analyse`, `meshband diagnose`); acknowledge when seen."
            .into();
    }
    match status.state {
        State::Stopped => "Next: start it (`meshband configure PORT --start`): it does not watch.".into(),
        State::WaitingForTach => "Next: see to the tachometer, or wait for the machine to turn: without a speed \
         mesh bands and expected levels are not watched."
            .into(),
        _ if losses.lost + losses.refused > 0 => "Next: nothing at the machine; the line loses frames: look at its \
         cable and bit rate."
            .into(),
        _ => match alarms.configured {
            Some(0) => "Next: give it alarms (`meshband commission`): none is configured, so none can stand.".into(),
            _ => "Next: nothing; the node watches.".into(),
        },
    }
}

/// For the page's foot.
pub fn facts(view: &View, source: &str) -> Facts {
    let mut facts = vec![("source".to_owned(), source.to_owned())];
    if let Some(unix_us) = view.health.and_then(|health| health.wall_time).map(|time| time.unix_us) {
        facts.push(("time of the node".into(), super::health::date(unix_us)));
    }
    if let Some(status) = &view.status {
        facts.push((
            "sampling".into(),
            format!("{:.0} Hz granted, converter {:.0} Hz", status.granted_hz, status.adc_hz),
        ));
    }
    if let Some(node) = &view.identity {
        facts.push(("node".into(), identity(node)));
    }
    facts
}
