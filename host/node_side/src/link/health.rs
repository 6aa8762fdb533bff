//! The node as a device, for people: supply, temperature, bias, its clock, the time of day; and how a host tells it
//! the time.
//!
//! The time told is that of the middle of a round trip, and the whole round trip is told as its uncertainty: the
//! shortest of a few, because a busy node answers the later.

use super::Client;
use crate::{Error, Result};
use jiff::Timestamp;
use meshband::health::Health;
use meshband::message::Identification;
use meshband::node::wall_time::ToldTime;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// First schema of the link whose nodes can be asked.
pub const FIRST_SCHEMA: u8 = 11;
/// Round trips of which the shortest is believed.
const TRIPS: usize = 5;

/// Whether a node can be asked.
pub fn is_known_to(node: &Identification) -> bool {
    node.wire_schema >= FIRST_SCHEMA
}

/// Tells the node the time of this host, and gives what it then says.
///
/// # Errors
/// As [`Client::request`]; a clock of this host that stands before 1970.
pub fn tell_time(client: &mut Client) -> Result<Health> {
    let mut shortest = Duration::MAX;
    for _ in 0..TRIPS {
        let asked = Instant::now();
        client.health()?;
        shortest = shortest.min(asked.elapsed());
    }
    let now = unix_us(SystemTime::now())? + (shortest / 2).as_micros() as u64;
    let uncertainty_us = shortest.as_micros().min(u128::from(u32::MAX)) as u32;
    client.set_wall_time(ToldTime { unix_us: now, uncertainty_us })
}

/// Microseconds since 1970-01-01 00:00:00 UTC.
///
/// # Errors
/// A clock that stands before.
pub fn unix_us(time: SystemTime) -> Result<u64> {
    let since = time.duration_since(UNIX_EPOCH);
    let since = since.map_err(|_| Error::invalid("this host's clock", "stands before 1970"))?;
    Ok(since.as_micros() as u64)
}

/// A time of day in words, to the millisecond.
pub(super) fn date(unix_us: u64) -> String {
    let timestamp = i64::try_from(unix_us / 1000).ok().and_then(|ms| Timestamp::from_millisecond(ms).ok());
    timestamp.map_or_else(|| format!("{unix_us} us since 1970"), |time| format!("{time:.3}"))
}

/// Every figure with its unit; what this node does not know is named in one row at the end.
pub fn rows(health: &Health) -> Vec<Vec<String>> {
    let row = |name: &'static str, value: Option<String>| (name, value);
    let mut rows = vec![
        row("since the start", Some(format!("{} s", health.uptime_s))),
        row("started by", Some(super::words::words(&health.started))),
        row("supply", health.supply_v.map(|volts| format!("{volts:.3} V"))),
        row("temperature of the chip", health.temperature_c.map(|celsius| format!("{celsius:.1} degrees Celsius"))),
        row("bias of the sensor", health.bias_v.map(|volts| format!("{volts:.3} V"))),
        row("bias of the second sensor", health.second_bias_v.map(|volts| format!("{volts:.3} V"))),
        row(
            "clock against the pulse per second",
            health.second_pulse.map(|pulse| {
                format!(
                    "{:+.3} ppm (standard uncertainty {:.3}, over {} s; {} pulses, {} refused)",
                    pulse.fast_ppm, pulse.uncertainty_ppm, pulse.baseline_s, pulse.pulses, pulse.refused
                )
            }),
        ),
    ];
    rows.push(row(
        "time of day",
        health.wall_time.map(|time| {
            format!(
                "{} within {:.3} s (told {} s before, {:.1} ppm of drift counted)",
                date(time.unix_us),
                time.uncertainty_us as f64 * 1e-6,
                time.told_before_s,
                time.drift_ppm
            )
        }),
    ));
    let unknown: Vec<&str> = rows.iter().filter(|(_, value)| value.is_none()).map(|(name, _)| *name).collect();
    let mut shown: Vec<Vec<String>> =
        rows.iter().filter_map(|(name, value)| Some(vec![(*name).to_owned(), value.clone()?])).collect();
    if !unknown.is_empty() {
        shown.push(vec!["not known to this node".into(), unknown.join(", ")]);
    }
    shown
}

/// What a plant wants to see at a glance: supply, temperature, bias; empty where none is known.
pub fn short(health: &Health) -> String {
    let parts = [
        health.supply_v.map(|volts| format!("{volts:.2} V")),
        health.temperature_c.map(|celsius| format!("{celsius:.0} deg C")),
        health.bias_v.map(|volts| format!("bias {volts:.2} V")),
        health.second_bias_v.map(|volts| format!("2nd bias {volts:.2} V")),
    ];
    parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::date;

    #[test]
    fn ref_a_time_of_day_is_written_as_rfc_3339() {
        assert_eq!(date(1_700_000_000_123_456), "2023-11-14T22:13:20.123Z");
        assert!(date(u64::MAX).ends_with("us since 1970"));
    }
}
