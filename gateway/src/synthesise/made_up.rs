//! Made-up values of plausible size and scatter: what a node sends at a second, by seed, machine and node alone.
//!
//! Three speeds of eight hours, orders that fall off, one machine in fifty that drifts, an alarm on one node and day in
//! a hundred. No physics: sizes of files and times of queries depend on scatter and number, not on gears.

use meshband::config::{MAX_HARMONICS, MAX_SIDEBANDS};
use meshband::events::{Event, EventKind};
use meshband::message::{
    AlarmState, Bound, GearIndicators, Indicators, LineOrigin, MAX_PEAKS, MeshBand, Message, Peaks, Quality,
    SensorStatus, SpectralLine, Spectrum, Status, Tag,
};
use meshband::node::State;
use meshband::shaft_lines::{OrderLine, ShaftOrders};
use meshband::tach::Validity;
use meshband::waveform::CapturePhase;

/// Ticks per second of the made-up nodes.
const CLOCK: u64 = 84_000_000;
/// Share by which the levels of a drifting machine grow over all days.
const DRIFT: f32 = 0.3;

/// What is made up.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// Seed.
    pub seed: u64,
    /// Length of all, s: one machine in fifty drifts by [`DRIFT`] over it.
    pub seconds: u64,
    /// Seconds between the values of a node.
    pub interval: u64,
    /// Spectrum and strongest lines as well.
    pub spectra: bool,
}

/// What a node sends at a second: status, indicators, with `spectra` spectrum and strongest lines, and rarely an event.
pub fn messages(plan: &Plan, machine: u32, node: u32, second: u64) -> Vec<Message> {
    let (status, indicators) = values(plan, machine, node, second);
    let mut messages = vec![Message::Status(status)];
    if plan.spectra {
        let scatter = |salt: u64| unit_scatter(plan.seed ^ (u64::from(node) << 40) ^ (second << 8) ^ salt);
        messages.push(Message::Spectrum(spectrum(&indicators, scatter)));
        messages.push(Message::Peaks(peaks(&indicators, scatter)));
    }
    messages.push(Message::Indicators(indicators));
    messages.extend(alarm(plan, node, second).map(Message::Event));
    messages
}

/// An alarm on one node and day in a hundred, raised at some time of it and cleared at the next values.
fn alarm(plan: &Plan, node: u32, second: u64) -> Option<Event> {
    let day = second / 86_400;
    let scatter = |salt: u64| f64::from(unit_scatter(plan.seed ^ (u64::from(node) << 40) ^ (day << 8) ^ salt));
    let raised = day * 86_400 + ((0.5 + 0.5 * scatter(0xa1)) * (86_400 - 2 * plan.interval) as f64) as u64;
    let since = second.checked_sub(raised)? / plan.interval;
    let kind = [EventKind::AlarmRaised, EventKind::AlarmCleared].get(since as usize).copied()?;
    let tick = second * CLOCK;
    (scatter(0xa2) > 0.98).then_some(Event { kind, detail: 3, first_tick: tick, last_tick: tick, count: 1 })
}

fn spectrum(indicators: &Indicators, scatter: impl Fn(u64) -> f32) -> Spectrum {
    let mut spectrum = Spectrum { tag: indicators.tag, turns: 48, ..Spectrum::default() };
    let speed_hz = indicators.tag.speed_hz;
    for harmonic in 1..=MAX_HARMONICS as u8 {
        let salt = 100 + 20 * u64::from(harmonic);
        let line = |place: u64, share: f32| SpectralLine {
            frequency_hz: speed_hz * (23.0 * f32::from(harmonic) + place as f32),
            amplitude: share * indicators.rms / f32::from(harmonic) * (1.0 + 0.1 * scatter(salt + place)),
        };
        let sides = |first: u64| (first..first + 2 * MAX_SIDEBANDS as u64).map(|place| line(place, 0.05)).collect();
        let band = MeshBand { harmonic, line: line(0, 0.7), sidebands: sides(1), gear_sidebands: sides(9) };
        // There is room for so many.
        let _ = spectrum.bands.push(band);
    }
    spectrum
}

fn peaks(indicators: &Indicators, scatter: impl Fn(u64) -> f32) -> Peaks {
    let line = |place: u64| SpectralLine {
        frequency_hz: indicators.tag.speed_hz * 23.0 * (place + 1) as f32 * (1.0 + 0.01 * scatter(300 + place)),
        amplitude: 0.7 * indicators.rms / (place + 1) as f32 * (1.0 + 0.1 * scatter(320 + place)),
    };
    let origin = |place: u16| match place % 3 {
        0 => LineOrigin::Mesh { harmonic: place / 3 + 1 },
        1 => LineOrigin::Folded { harmonic: place + 20 },
        _ => LineOrigin::Unexplained,
    };
    Peaks {
        tag: indicators.tag,
        lines: (0..MAX_PEAKS as u64).map(line).collect(),
        rms: indicators.rms * (1.0 + 0.02 * scatter(340)),
        origins: (0..MAX_PEAKS as u16).map(origin).collect(),
        ..Peaks::default()
    }
}

/// Status and indicators of a node at a second.
fn values(plan: &Plan, machine: u32, node: u32, second: u64) -> (Status, Indicators) {
    let seed = plan.seed;
    let scatter = |salt: u64| unit_scatter(seed ^ (u64::from(node) << 40) ^ (second << 8) ^ salt);
    // Eight hours at each of three speeds; the load follows.
    let speed = [8.0, 12.0, 16.0][(second / 28_800 % 3) as usize] * (1.0 + 0.002 * scatter(1));
    let drift = if machine % 50 == 7 { 1.0 + DRIFT * second as f32 / plan.seconds as f32 } else { 1.0 };
    let rms = (0.5 + 0.1 * speed) * (1.0 + 0.05 * scatter(2)) * drift;
    let tick = second * CLOCK;
    let tag = Tag {
        first_tick: tick,
        speed_hz: speed,
        speed_uncertainty: 1e-4,
        validity: Validity::Locked,
        period_ticks: 420,
        stages: 3,
        rate_hz: 25_000.0,
        resolution_hz: 0.5,
        aliasing: false,
    };
    let gear = GearIndicators {
        tick,
        speed_hz: speed,
        turns: 48,
        rms: 0.8 * rms,
        crest: 3.0 + 0.3 * scatter(3),
        kurtosis: 2.8 + 0.2 * scatter(4),
        regular_rms: 0.7 * rms,
        residual_rms: 0.1 * rms,
        difference_rms: 0.09 * rms,
        fm0: 4.0 + 0.2 * scatter(5),
        fm4: 3.0 + 0.15 * scatter(6),
        m6a: 15.0 + 2.0 * scatter(7),
        na4: 1.0 + 0.1 * scatter(8),
        ..GearIndicators::default()
    };
    let kurtosis = 3.0 + 0.1 * scatter(9);
    let peak = 4.0 * rms * (1.0 + 0.1 * scatter(10));
    let indicators = Indicators {
        tag,
        rms,
        peak,
        crest: peak / rms,
        kurtosis,
        sideband_energy_ratio: 0.2,
        gear: Some(gear),
        bandwidth: None,
        quality: Quality { turns: 48, duration_s: 48.0 / speed, ..Quality::default() },
        velocity_rms: rms / (core::f32::consts::TAU * 20.0 * speed),
        velocity_band_hz: [10.0, 1000.0],
        pinion: orders(48, 0.02 * rms, scatter),
        wheel: orders(24, 0.015 * rms, |salt| scatter(salt + 6)),
        ..Indicators::default()
    };
    (status(tick, speed), indicators)
}

/// Orders of a shaft that fall off with their number.
fn orders(turns: u16, first: f32, scatter: impl Fn(u64) -> f32) -> Option<ShaftOrders> {
    let line = |order: u64| OrderLine {
        amplitude: first / (order + 1) as f32 * (1.0 + 0.1 * scatter(11 + order)),
        phase_deg: 180.0 * scatter(14 + order),
    };
    Some(ShaftOrders { lines: [line(0), line(1), line(2)], turns })
}

/// A plausible status of a measuring node.
pub fn status(tick: u64, speed_hz: f32) -> Status {
    Status {
        state: State::Measuring,
        validity: Validity::Locked,
        tick,
        speed_hz,
        speed_uncertainty: 1e-4,
        age_s: 0.05,
        bandwidth_hz: 700.0 * speed_hz,
        law_clamped: false,
        law_provisional: false,
        requested_hz: 1800.0 * speed_hz,
        granted_hz: 1810.0 * speed_hz,
        adc_hz: 200_000.0,
        period_ticks: 420,
        stages: 3,
        residual_ppm: 5000.0,
        limited: false,
        safe_rate: false,
        block: (tick / 1_000_000) as u32,
        available_hz: 650.0 * speed_hz,
        bound: Bound::AnalogueFilter,
        alarms: AlarmState::default(),
        capture: CapturePhase::default(),
        alerts: 0,
        sensor: SensorStatus::default(),
    }
}

/// A number between -1 and 1 that depends on nothing but its key (SplitMix64).
fn unit_scatter(key: u64) -> f32 {
    let mut z = key.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^= z >> 31;
    (z >> 40) as f32 / (1u64 << 23) as f32 - 1.0
}
