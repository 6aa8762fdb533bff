//! The facts of a record as a report names them: file and its day, machine, speed, load, sampling, sensors.

use super::Record;
use jiff::Timestamp;
use meshband_common::report::facts::Facts;
use meshband_common::report::letter::About;

/// Channels named before the rest is counted.
const MAX_NAMED_CHANNELS: usize = 8;

/// Pinion speeds of the runs, Hz: slowest and fastest mean.
pub fn speeds_hz(record: &Record) -> Option<[f64; 2]> {
    let tach = record.declaration.tach.as_ref()?;
    let per_pinion = tach.turns_per_pinion_turn(record.declaration.teeth()).unwrap_or(1.0);
    let speeds = record.runs.iter().filter_map(|run| run.mean_speed_hz(tach.pulses_per_rev));
    let speeds: Vec<f64> = speeds.map(|hz| hz / per_pinion).collect();
    let slowest = speeds.iter().copied().reduce(f64::min)?;
    Some([slowest, speeds.iter().copied().fold(slowest, f64::max)])
}

/// A speed or two, in both units.
pub fn speed_text([slowest, fastest]: [f64; 2]) -> String {
    if fastest / slowest < 1.005 {
        return format!("{slowest:.2} Hz ({:.0} rpm)", 60.0 * slowest);
    }
    format!("{slowest:.2} to {fastest:.2} Hz ({:.0} to {:.0} rpm)", 60.0 * slowest, 60.0 * fastest)
}

/// Day on which the record's signal was written, where the system tells it: that of the import, no file states that of
/// the recording.
pub fn day(record: &Record) -> Option<String> {
    let signal = record.folder.join(&record.runs.first()?.declaration.signal);
    let modified = std::fs::metadata(signal).ok()?.modified().ok()?;
    let time = Timestamp::try_from(modified).ok()?;
    Some(format!("{time:.0}"))
}

/// All of them.
pub fn facts(record: &Record) -> Facts {
    let declaration = &record.declaration;
    let mut facts = Facts::new();
    let mut add = |name: &str, value: String| facts.push((name.to_owned(), value));
    add("record", crate::text::name(&record.folder.display().to_string()));
    if let Some(day) = day(record) {
        add("record written", day);
    }
    if let Some(stages) = stages(record) {
        add("teeth of the stages", stages);
    } else if let Some([pinion, gear]) = declaration.teeth() {
        add("teeth, pinion and gear", format!("{pinion} and {gear}"));
    }
    if let Some(speeds) = speeds_hz(record) {
        add(&format!("speed of the {}", turns_of(record)), speed_text(speeds));
    }
    add("load", load(record));
    let seconds: f64 = record.runs.iter().map(|run| run.duration_s()).sum();
    let runs = record.runs.len();
    let rate = declaration.acquisition.sample_rate_hz;
    add("sampling", format!("{rate} Hz, {runs} run{}, {seconds:.1} s in all", if runs == 1 { "" } else { "s" }));
    if let Some(part) = declaration.runs.first().and_then(|run| run.part()) {
        add("part of a longer recording", crate::text::name(part));
    }
    let names = &declaration.acquisition.channels;
    let shown: Vec<String> = names.iter().take(MAX_NAMED_CHANNELS).map(|name| crate::text::name(name)).collect();
    let rest = if names.len() > MAX_NAMED_CHANNELS {
        format!(" and {} more", names.len() - MAX_NAMED_CHANNELS)
    } else {
        String::new()
    };
    let unit = declaration.acquisition.unit.as_deref().unwrap_or("m/s2");
    add("sensors", format!("{}{rest}, in {unit}", shown.join(", ")));
    if let Some(tach) = &declaration.tach {
        let kind = if tach.is_virtual() { ", computed from the mesh line" } else { "" };
        let shaft = match tach.train_shaft() {
            Some(shaft) => format!("shaft {shaft}"),
            None => format!("the {}", crate::text::name(&tach.shaft)),
        };
        add("tachometer", format!("{} per turn of {shaft}{kind}", tach.pulses_per_rev));
    }
    facts
}

/// What orders of a record are multiples of.
fn turns_of(record: &Record) -> &'static str {
    match (record.declaration.has_train(), record.declaration.teeth()) {
        (true, None) => "input",
        (_, Some(_)) => "pinion",
        (false, None) => "shaft",
    }
}

/// Tooth counts of a declared train, stage by stage.
fn stages(record: &Record) -> Option<String> {
    let train = record.declaration.train().ok()??;
    let teeth = |stage: usize| {
        let own = train.gears.iter().filter(|gear| gear.stage == stage);
        own.map(|gear| gear.teeth.to_string()).collect::<Vec<_>>().join("/")
    };
    let mut stages: Vec<usize> = train.gears.iter().map(|gear| gear.stage).collect();
    stages.dedup();
    Some(stages.iter().map(|&stage| teeth(stage)).collect::<Vec<_>>().join(", "))
}

fn load(record: &Record) -> String {
    let loads: Vec<f64> = record.runs.iter().filter_map(|run| run.declaration.load()).collect();
    let Some(lowest) = loads.iter().copied().reduce(f64::min) else { return "not declared".into() };
    let highest = loads.iter().copied().fold(lowest, f64::max);
    if lowest == highest {
        format!("{lowest} N m at the pinion")
    } else {
        format!("{lowest} to {highest} N m at the pinion")
    }
}

/// The record as a letter names it.
pub fn about(record: &Record) -> About {
    let declaration = &record.declaration;
    let speeds = speeds_hz(record);
    let seconds: f64 = record.runs.iter().map(|run| run.duration_s()).sum();
    let sensors = declaration.acquisition.channels.len();
    let when =
        day(record).map_or(String::new(), |day| format!(", record written {}", day.split('T').next().unwrap_or(&day)));
    let teeth = declaration.teeth().map_or(String::new(), |[pinion, gear]| format!(" ({pinion}/{gear} teeth)"));
    let of = turns_of(record);
    let speed = speeds.map_or(String::new(), |speeds| format!(" with the {of} at {}", speed_text(speeds)));
    let how = format!(
        "{}{teeth}{when}: {seconds:.1} s from {sensors} sensor{}{speed}.",
        declaration.title(),
        if sensors == 1 { "" } else { "s" }
    );
    let tach = declaration.tach.as_ref();
    let per_pinion = tach.and_then(|tach| tach.turns_per_pinion_turn(declaration.teeth())).unwrap_or(1.0);
    let first = tach.and_then(|tach| record.runs.first()?.mean_speed_hz(tach.pulses_per_rev));
    About {
        how,
        speed_hz: first.map(|hz| hz / per_pinion),
        pinion_teeth: declaration.teeth().map(|[pinion, _]| pinion),
        turns_of: Some(of),
        facts: facts(record),
    }
}
