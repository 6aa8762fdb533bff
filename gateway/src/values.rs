//! Which figures a message carries, under which names and units: one table for the broker's metrics and the history's
//! columns.

use meshband::config::MAX_TRAIN_GEARS;
use meshband::message::{GearCondition, Indicators, LineOrigin, Message, Peaks, Spectrum, Tag};

/// A figure.
#[derive(Clone, Copy, Debug)]
pub struct Quantity {
    /// Column of the history.
    pub column: &'static str,
    /// Sparkplug metric.
    pub metric: &'static str,
    /// Unit; empty for pure numbers.
    pub unit: &'static str,
}

const fn quantity(column: &'static str, metric: &'static str, unit: &'static str) -> Quantity {
    Quantity { column, metric, unit }
}

/// All figures. Only append: the history's columns and the broker's aliases count on the order.
pub const QUANTITIES: [Quantity; 68] = [
    quantity("speed_hz", "Speed", "Hz"),
    quantity("speed_uncertainty", "Speed/Uncertainty", ""),
    quantity("speed_age_s", "Speed/Age", "s"),
    quantity("bandwidth_hz", "Law/Bandwidth", "Hz"),
    quantity("requested_hz", "Rate/Requested", "Hz"),
    quantity("granted_hz", "Rate/Granted", "Hz"),
    quantity("adc_hz", "Rate/Converter", "Hz"),
    quantity("residual_ppm", "Rate/Residual", "ppm"),
    quantity("rate_hz", "Result/Rate", "Hz"),
    quantity("resolution_hz", "Result/Resolution", "Hz"),
    quantity("rms", "Vibration/RMS", "m/s2"),
    quantity("peak", "Vibration/Peak", "m/s2"),
    quantity("crest", "Vibration/Crest", ""),
    quantity("kurtosis", "Vibration/Kurtosis", ""),
    quantity("sideband_energy_ratio", "Vibration/SidebandEnergyRatio", ""),
    quantity("gear_rms", "Gear/RMS", "m/s2"),
    quantity("gear_crest", "Gear/Crest", ""),
    quantity("gear_kurtosis", "Gear/Kurtosis", ""),
    quantity("regular_rms", "Gear/RegularRMS", "m/s2"),
    quantity("residual_rms", "Gear/ResidualRMS", "m/s2"),
    quantity("difference_rms", "Gear/DifferenceRMS", "m/s2"),
    quantity("fm0", "Gear/FM0", ""),
    quantity("fm4", "Gear/FM4", ""),
    quantity("m6a", "Gear/M6A", ""),
    quantity("na4", "Gear/NA4", ""),
    quantity("gear_sideband_energy_ratio", "Gear/SidebandEnergyRatio", ""),
    quantity("rise_s", "Bandwidth/RiseTime", "s"),
    quantity("measured_bandwidth_hz", "Bandwidth/Measured", "Hz"),
    quantity("mesh_1", "Mesh/1", "m/s2"),
    quantity("mesh_2", "Mesh/2", "m/s2"),
    quantity("mesh_3", "Mesh/3", "m/s2"),
    quantity("mesh_4", "Mesh/4", "m/s2"),
    quantity("mesh_5", "Mesh/5", "m/s2"),
    quantity("mesh_6", "Mesh/6", "m/s2"),
    quantity("wideband_rms", "Wideband/RMS", "m/s2"),
    quantity("available_hz", "Law/Available", "Hz"),
    quantity("velocity_rms", "Vibration/VelocityRMS", "m/s"),
    quantity("pinion_1", "Shaft/Pinion/1", "m/s2"),
    quantity("pinion_2", "Shaft/Pinion/2", "m/s2"),
    quantity("pinion_3", "Shaft/Pinion/3", "m/s2"),
    quantity("gear_1", "Shaft/Gear/1", "m/s2"),
    quantity("gear_2", "Shaft/Gear/2", "m/s2"),
    quantity("gear_3", "Shaft/Gear/3", "m/s2"),
    quantity("second_rms", "Second/RMS", "m/s2"),
    quantity("second_peak", "Second/Peak", "m/s2"),
    quantity("second_crest", "Second/Crest", ""),
    quantity("second_kurtosis", "Second/Kurtosis", ""),
    quantity("second_velocity_rms", "Second/VelocityRMS", "m/s"),
    quantity("train_1_mesh", "Train/1/Mesh", "m/s2"),
    quantity("train_1_residual_rms", "Train/1/ResidualRMS", "m/s2"),
    quantity("train_1_fm0", "Train/1/FM0", ""),
    quantity("train_1_fm4", "Train/1/FM4", ""),
    quantity("train_2_mesh", "Train/2/Mesh", "m/s2"),
    quantity("train_2_residual_rms", "Train/2/ResidualRMS", "m/s2"),
    quantity("train_2_fm0", "Train/2/FM0", ""),
    quantity("train_2_fm4", "Train/2/FM4", ""),
    quantity("train_3_mesh", "Train/3/Mesh", "m/s2"),
    quantity("train_3_residual_rms", "Train/3/ResidualRMS", "m/s2"),
    quantity("train_3_fm0", "Train/3/FM0", ""),
    quantity("train_3_fm4", "Train/3/FM4", ""),
    quantity("train_4_mesh", "Train/4/Mesh", "m/s2"),
    quantity("train_4_residual_rms", "Train/4/ResidualRMS", "m/s2"),
    quantity("train_4_fm0", "Train/4/FM0", ""),
    quantity("train_4_fm4", "Train/4/FM4", ""),
    quantity("train_5_mesh", "Train/5/Mesh", "m/s2"),
    quantity("train_5_residual_rms", "Train/5/ResidualRMS", "m/s2"),
    quantity("train_5_fm0", "Train/5/FM0", ""),
    quantity("train_5_fm4", "Train/5/FM4", ""),
];

/// Column of the first mesh harmonic.
const MESH: usize = 28;
/// Column of the bandwidth that the whole way carries.
const AVAILABLE: usize = 35;
/// Column of the velocity.
const VELOCITY: usize = 36;
/// Columns of each shaft's first order.
const SHAFTS: [usize; 2] = [37, 40];

/// First column of the second sensor.
const SECOND: usize = 43;
/// First column of the further gears of a train, and columns of each.
const TRAIN: usize = 48;
const TRAIN_COLUMNS: usize = 4;

/// The figures of a message, each with its place in [`QUANTITIES`]. One that is no number (NA4 where nothing is
/// expected) is not there: programs disagree on whether it is the largest value, or equal to itself.
pub fn figures(message: &Message) -> Vec<(usize, f32)> {
    let mut figures = all_figures(message);
    figures.retain(|(_, value)| !value.is_nan());
    figures
}

fn all_figures(message: &Message) -> Vec<(usize, f32)> {
    match message {
        Message::Status(s) => {
            let figures = [
                s.speed_hz,
                s.speed_uncertainty,
                s.age_s,
                s.bandwidth_hz,
                s.requested_hz,
                s.granted_hz,
                s.adc_hz,
                s.residual_ppm,
            ];
            figures.into_iter().enumerate().chain([(AVAILABLE, s.available_hz)]).collect()
        }
        Message::Spectrum(spectrum) => {
            let bands = spectrum
                .bands
                .iter()
                .map(|band| (MESH + usize::from(band.harmonic.clamp(1, 6)) - 1, band.line.amplitude));
            circumstances(&spectrum.tag).into_iter().chain(bands).collect()
        }
        Message::Peaks(peaks) => circumstances(&peaks.tag).into_iter().chain([(34, peaks.rms)]).collect(),
        Message::Snapshot(snapshot) => circumstances(&snapshot.tag).into(),
        Message::Indicators(i) => {
            let mut figures = circumstances(&i.tag).to_vec();
            figures.extend((10..).zip([i.rms, i.peak, i.crest, i.kurtosis, i.sideband_energy_ratio]));
            if let Some(g) = &i.gear {
                let gear = [
                    g.rms,
                    g.crest,
                    g.kurtosis,
                    g.regular_rms,
                    g.residual_rms,
                    g.difference_rms,
                    g.fm0,
                    g.fm4,
                    g.m6a,
                    g.na4,
                ];
                figures.extend((15..).zip(gear).chain([(25, g.gear_sideband_energy_ratio)]));
            }
            if let Some(bandwidth) = &i.bandwidth {
                figures.extend([(26, bandwidth.rise_s), (27, bandwidth.bandwidth_hz)]);
            }
            figures.push((VELOCITY, i.velocity_rms));
            for (first, orders) in SHAFTS.into_iter().zip([i.pinion, i.wheel]) {
                figures.extend((first..).zip(orders.iter().flat_map(|shaft| shaft.lines).map(|line| line.amplitude)));
            }
            if let Some(s) = &i.second {
                figures.extend((SECOND..).zip([s.rms, s.peak, s.crest, s.kurtosis, s.velocity_rms]));
            }
            figures
        }
        Message::GearSpectrum(of) => {
            let mesh = of.spectrum.bands.first().map(|band| band.line.amplitude);
            train_columns(of.gear).zip(mesh).collect()
        }
        Message::GearCondition(GearCondition { gear, indicators: of }) => {
            train_columns(*gear).skip(1).zip([of.residual_rms, of.fm0, of.fm4]).collect()
        }
        Message::Event(_) | Message::Statistics(_) | Message::SelfTest(_) => Vec::new(),
    }
}

/// Columns of a further gear of a train, by its number from 1; none of a number that no node has.
fn train_columns(gear: u8) -> std::ops::Range<usize> {
    let first = TRAIN + TRAIN_COLUMNS * usize::from(gear.saturating_sub(1));
    if (1..=MAX_TRAIN_GEARS as u8).contains(&gear) { first..first + TRAIN_COLUMNS } else { 0..0 }
}

fn circumstances(tag: &Tag) -> [(usize, f32); 4] {
    [(0, tag.speed_hz), (1, tag.speed_uncertainty), (8, tag.rate_hz), (9, tag.resolution_hz)]
}

/// What a message's values lack, in words (`overload gap settling stuck`); `None` where they say something of the
/// machine.
pub fn defects(message: &Message) -> Option<String> {
    let Message::Indicators(Indicators { quality, .. }) = message else { return None };
    let named = [
        ("overload", quality.overload),
        ("gap", quality.gap),
        ("settling", quality.settling),
        ("stuck", quality.stuck),
    ];
    let words: Vec<&str> = named.into_iter().filter_map(|(word, holds)| holds.then_some(word)).collect();
    (!words.is_empty()).then(|| words.join(" "))
}

/// What kind of message it is, as the history's column `kind` says it.
pub fn kind(message: &Message) -> &'static str {
    match message {
        Message::Status(_) => "status",
        Message::Spectrum(_) => "spectrum",
        Message::Peaks(_) => "peaks",
        Message::Snapshot(_) => "snapshot",
        Message::Indicators(_) => "indicators",
        Message::Event(_) => "event",
        Message::Statistics(_) => "statistics",
        Message::SelfTest(_) => "self_test",
        Message::GearSpectrum(_) => "gear_spectrum",
        Message::GearCondition(_) => "gear_condition",
    }
}

/// One spectral line with its name.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// `mesh 2`, `mesh 2 pinion -1`, `mesh 2 gear +1`, `folded 7`, `unexplained`, or empty where the speed is not
    /// known.
    pub origin: String,
    /// Hz.
    pub frequency_hz: f32,
    /// m/s2, peak.
    pub amplitude: f32,
}

/// The lines of a message: mesh bands with their sidebands, or the strongest lines of the whole band.
pub fn lines(message: &Message) -> Vec<Line> {
    match message {
        Message::Spectrum(spectrum) => bands(spectrum),
        Message::GearSpectrum(of) => bands(&of.spectrum),
        Message::Peaks(peaks) => strongest(peaks),
        _ => Vec::new(),
    }
}

fn bands(spectrum: &Spectrum) -> Vec<Line> {
    let mut lines = Vec::new();
    for band in &spectrum.bands {
        let mut push = |origin: String, line: &meshband::message::SpectralLine| {
            lines.push(Line { origin, frequency_hz: line.frequency_hz, amplitude: line.amplitude });
        };
        push(format!("mesh {}", band.harmonic), &band.line);
        for (shaft, sidebands) in [("pinion", &band.sidebands), ("gear", &band.gear_sidebands)] {
            let half = (sidebands.len() / 2) as i32;
            for (place, line) in (-half..).zip(sidebands) {
                let number = if place < 0 { place } else { place + 1 };
                push(format!("mesh {} {shaft} {number:+}", band.harmonic), line);
            }
        }
    }
    lines
}

fn strongest(peaks: &Peaks) -> Vec<Line> {
    let of_gear = |place: usize| match peaks.origin_gears.get(place) {
        None | Some(0) => String::new(),
        Some(gear) => format!(" of gear {gear}"),
    };
    let origin = |place: usize| match peaks.origins.get(place) {
        Some(LineOrigin::Mesh { harmonic }) => format!("mesh {harmonic}{}", of_gear(place)),
        Some(LineOrigin::Folded { harmonic }) => format!("folded {harmonic}{}", of_gear(place)),
        Some(LineOrigin::Unexplained) => "unexplained".to_owned(),
        None => String::new(),
    };
    let lines = peaks.lines.iter().enumerate();
    lines
        .map(|(place, line)| Line { origin: origin(place), frequency_hz: line.frequency_hz, amplitude: line.amplitude })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use meshband::message::{AlarmState, Bound, GearIndicators, MeasuredBandwidth, Quality, Status};
    use meshband::node::State;
    use meshband::shaft_lines::{OrderLine, ShaftOrders};
    use meshband::tach::Validity;

    #[test]
    fn claim_figures_stand_under_their_own_names() {
        let gear = GearIndicators { fm4: 4.5, gear_sideband_energy_ratio: 0.25, ..GearIndicators::default() };
        let bandwidth = MeasuredBandwidth { bandwidth_hz: 900.0, ..MeasuredBandwidth::default() };
        let line = |amplitude| OrderLine { amplitude, phase_deg: 0.0 };
        let orders =
            |first: f32| Some(ShaftOrders { lines: [line(first), line(first + 1.0), line(first + 2.0)], turns: 1 });
        let indicators = Indicators {
            kurtosis: 3.5,
            gear: Some(gear),
            bandwidth: Some(bandwidth),
            velocity_rms: 0.002,
            pinion: orders(1.0),
            wheel: orders(4.0),
            ..Indicators::default()
        };
        let held = figures(&Message::Indicators(indicators));
        let of =
            |column: &str| held.iter().find(|(place, _)| QUANTITIES[*place].column == column).map(|(_, value)| *value);
        assert_eq!(of("kurtosis"), Some(3.5));
        assert_eq!(of("fm4"), Some(4.5));
        assert_eq!(of("gear_sideband_energy_ratio"), Some(0.25));
        assert_eq!(of("measured_bandwidth_hz"), Some(900.0));
        assert_eq!(of("mesh_1"), None);
        assert_eq!(of("velocity_rms"), Some(0.002));
        assert_eq!([of("pinion_1"), of("pinion_3"), of("gear_1"), of("gear_3")], [1.0, 3.0, 4.0, 6.0].map(Some));
        let status = Message::Status(status());
        let ppm = figures(&status).into_iter().find(|(place, _)| QUANTITIES[*place].column == "residual_ppm");
        assert_eq!(ppm.map(|(_, value)| value), Some(7.0));
        let available = figures(&status).into_iter().find(|(place, _)| QUANTITIES[*place].column == "available_hz");
        assert_eq!(available.map(|(_, value)| value), Some(450.0));
    }

    #[test]
    fn claim_what_values_lack_is_said_and_nothing_where_they_lack_nothing() {
        let of = |quality| defects(&Message::Indicators(Indicators { quality, ..Indicators::default() }));
        assert_eq!(
            of(Quality { overload: true, settling: true, ..Quality::default() }).as_deref(),
            Some("overload settling")
        );
        assert_eq!(of(Quality::default()), None);
        assert_eq!(defects(&Message::Status(status())), None);
    }

    #[test]
    fn fault_a_figure_that_is_no_number_is_left_out() {
        let gear = meshband::message::GearIndicators { na4: f32::NAN, fm4: 3.0, ..Default::default() };
        let held = figures(&Message::Indicators(Indicators { gear: Some(gear), ..Indicators::default() }));
        let named = |name| held.iter().find(|(place, _)| QUANTITIES[*place].column == name);
        assert_eq!((named("na4"), named("fm4").map(|(_, value)| *value)), (None, Some(3.0)));
    }

    fn status() -> Status {
        Status {
            state: State::Measuring,
            validity: Validity::Locked,
            tick: 1,
            speed_hz: 0.0,
            speed_uncertainty: 0.0,
            age_s: 0.0,
            bandwidth_hz: 0.0,
            law_clamped: false,
            law_provisional: false,
            requested_hz: 0.0,
            granted_hz: 0.0,
            adc_hz: 0.0,
            period_ticks: 1,
            stages: 0,
            residual_ppm: 7.0,
            limited: false,
            safe_rate: false,
            block: 0,
            available_hz: 450.0,
            bound: Bound::Sensor,
            alarms: AlarmState::default(),
            capture: Default::default(),
            alerts: 0,
            sensor: Default::default(),
        }
    }
}
