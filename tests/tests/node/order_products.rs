//! Order products where they went wrong: sidebands that are one, skirts of strong lines, many teeth, NA4 over speed,
//! strobes.

use crate::rig::{Rig, slow_converter, steady};
use meshband::config::{Configuration, GearPair};
use meshband::levels::{ExpectedLevel, LevelPoint};
use meshband::node::values::{ValueRecord, Values};
use meshband::units::Hertz;
use std::f64::consts::TAU;

fn pair(pinion_teeth: u16, gear_teeth: u16) -> Configuration {
    Configuration { gears: GearPair { pinion_teeth, gear_teeth }, ..slow_converter() }
}

/// Mesh of 10 m/s2 of the pinion's teeth at 20 Hz whose amplitude one shaft's order modulates.
fn modulated(teeth: f64, order: f64, depth: f64) -> impl Fn(f64) -> f64 {
    move |t| 10.0 * (1.0 + depth * (TAU * order * 20.0 * t).cos()) * (TAU * teeth * 20.0 * t).cos()
}

#[test]
fn regress_a10_sidebands_that_are_one_are_said_to_be_one() {
    for (pinion, gear) in [(20, 41), (19, 39), (25, 51), (21, 43)] {
        let mut rig = Rig::new(pair(pinion, gear));
        let order = 2.0 * f64::from(pinion) / f64::from(gear);
        rig.run(6.0, modulated(f64::from(pinion), order, 0.2), steady(20.0));
        let spectrum = rig.spectra.last().expect("a spectrum");
        // Of -3..-1, +1..+3: the pinion's first and the gear's second, on both sides.
        assert_eq!(spectrum.inseparable[0] & 0b00_1100, 0b00_1100, "{pinion}/{gear}: {:?}", spectrum.inseparable);
        assert_eq!(spectrum.inseparable[1] & 0b01_0010, 0b01_0010, "{pinion}/{gear}: {:?}", spectrum.inseparable);
        // Two sidebands of 1 m/s2: once, not twice. Read at the pinion's place, 0.4 bins off: Hann's window shows 0.91.
        let band = &spectrum.bands[..1];
        let all = meshband::mesh_band::sideband_amplitude(band, spectrum.inseparable);
        assert!((all / 2f32.sqrt() - 0.95).abs() < 0.06, "{pinion}/{gear}: {all}");
    }
}

#[test]
fn theory_sidebands_of_19_and_48_teeth_are_told_apart() {
    let mut rig = Rig::new(pair(19, 48));
    rig.run(6.0, modulated(19.0, 2.0 * 19.0 / 48.0, 0.2), steady(20.0));
    let spectrum = rig.spectra.last().expect("a spectrum");
    assert_eq!(spectrum.inseparable, [0; 2]);
    assert!(rig.values().sideband_energy_ratio < 0.05, "{}", rig.values().sideband_energy_ratio);
}

#[test]
fn regress_a10_a_sideband_is_read_at_its_place_and_not_on_a_neighbour_s_skirt() {
    for apart in [0.13, 0.16] {
        let (sideband, fixed) = (0.05, 2.0);
        let order = 20.0;
        let signal = move |t: f64| {
            5.0 * (TAU * 19.0 * 20.0 * t).cos()
                + sideband * (TAU * order * 20.0 * t).cos()
                + fixed * (TAU * (order + apart) * 20.0 * t).cos()
        };
        let mut rig = Rig::new(pair(19, 48));
        rig.run(6.0, signal, steady(20.0));
        let first_above = rig.spectra.last().expect("a spectrum").bands[0].sidebands[3];
        assert!((first_above.frequency_hz - 400.0).abs() < 0.1, "{first_above:?}");
        assert!(first_above.amplitude < 0.15, "{apart} orders beside a line of 2: {first_above:?}");
    }
}

#[test]
fn regress_a13_mesh_harmonics_of_many_teeth_do_not_fold_into_the_residual() {
    for teeth in [60u16, 75, 80, 100, 120, 250] {
        let mut config = pair(teeth, 2 * teeth + 1);
        config.limits.analogue_stop = Hertz(60_000.0);
        config.limits.highest_adc = Hertz(240_000.0);
        let hz = 5.0;
        let mesh = move |t: f64| {
            (1..=20).map(|h| 10.0 / f64::from(h) * (TAU * f64::from(h) * f64::from(teeth) * hz * t).cos()).sum()
        };
        let mut rig = Rig::new(config);
        rig.run(16.0, mesh, steady(hz));
        let gear = rig.indicators.iter().rev().find_map(|values| values.gear).expect("an average");
        // The converter's own steps are 0.08 m/s2.
        assert!(gear.residual_rms < 0.02, "{teeth} teeth: residual {}", gear.residual_rms);
    }
}

#[test]
fn regress_a7_na4_tells_damage_and_not_the_speed() {
    let point = |speed: f32, residual_db: f32| LevelPoint {
        speed: Hertz(speed),
        residual_rms: ExpectedLevel { level_db: residual_db, uncertainty_db: 1.5 },
        ..LevelPoint::default()
    };
    // A line at 3.5 orders is the residual: 24 dB more at 20 Hz than at 5 Hz.
    let amplitude = |hz: f64| 0.2 * (hz / 5.0).powf(2.0);
    let level = |hz: f64| (20.0 * (amplitude(hz) / 2f64.sqrt()).log10()) as f32;
    let config = Configuration {
        levels: [point(5.0, level(5.0)), point(20.0, level(20.0))].into_iter().collect(),
        ..pair(19, 38)
    };
    for hz in [5.1, 19.9] {
        let sound = move |t: f64| 3.0 * (TAU * 19.0 * hz * t).cos() + amplitude(hz) * (TAU * 5.0 * hz * t).cos();
        let mut rig = Rig::new(config.clone());
        rig.run(if hz < 10.0 { 24.0 } else { 10.0 }, sound, steady(hz));
        let gear = rig.indicators.iter().rev().find_map(|values| values.gear).expect("an average");
        // A sine's kurtosis.
        assert!((gear.na4 / 1.5 - 1.0).abs() < 0.15, "{hz} Hz: NA4 {}", gear.na4);
        let mut unknown = Rig::new(pair(19, 38));
        unknown.run(if hz < 10.0 { 24.0 } else { 10.0 }, sound, steady(hz));
        let gear = unknown.indicators.iter().rev().find_map(|values| values.gear).expect("an average");
        assert!(gear.na4.is_nan(), "nothing is expected: {}", gear.na4);
    }
}

#[test]
fn regress_a16_what_repeats_with_the_sub_sampling_is_no_constant() {
    use meshband::band_velocity::Edges;
    use meshband::config::CodeRange;
    use meshband::units::TicksPerSecond;
    let clock = TicksPerSecond(84_000_000);
    let edges = Edges { from_hz: 10.0, to_hz: 1000.0 };
    let mut record = ValueRecord::new(clock, edges, [32_768; 2], CodeRange::default().in_force());
    // 420 kHz: one code in eight enters; a sine at an eighth of the rate.
    let mut found: Option<Values> = None;
    for block in 0..1000u64 {
        let code = |n: u64| (32_768.0 + 10_000.0 * (TAU * n as f64 / 8.0).sin()) as u16;
        let codes: Vec<u16> = (0..512).map(|n| code(block * 512 + n)).collect();
        record.push([&codes[..], &[]], block * 512 * 200, 200, false, |values| found = Some(values));
    }
    let rms = found.expect("values").first.codes.rms;
    assert!((rms / 7_071.0 - 1.0).abs() < 0.02, "{rms}");
}

#[test]
fn theory_the_velocity_of_a_slow_shaft_is_from_2_hz_on() {
    for (from, told) in [(0.0, 0.25), (2.0, 1.0)] {
        let config = Configuration { velocity_from: Hertz(from), ..slow_converter() };
        let mut rig = Rig::new(config);
        // 10 mm/s at 5 Hz.
        let velocity = 0.010 * 2f64.sqrt();
        rig.run(12.0, move |t| velocity * TAU * 5.0 * (TAU * 5.0 * t).cos(), steady(20.0));
        let values = rig.values();
        let share = f64::from(values.velocity_rms) / 0.010;
        assert!(share > 0.9 * told && share < 1.1 * told || (told < 1.0 && share < 0.3), "{from} Hz: {share}");
        assert_eq!(values.velocity_band_hz[0], if from > 0.0 { from } else { 10.0 });
    }
}
