//! The flashed image keeps up at two cycles per instruction: no block is lost at the highest rate that a
//! configuration may ask for, nor with the default one. How far it could go is in `cargo xtask pace`.

use super::compared::configuration;
use super::compared::load::{Outcome, SPEEDS_HZ, configured_for, run, run_for};
use super::image::image;
use meshband::board::Timing;
use meshband::config::{CaptureConfig, CaptureRate, Configuration, TrainGear};
use meshband::units::Hertz;

/// Cycles per instruction: the core's manual gives 1 to 2.5, most of them nearer to one.
const CYCLES: f64 = 2.0;

/// Share of the block buffers that must stay free at worst: 26 % do at 60 turns/s and the highest rate.
const MIN_FREE_BUFFER_SHARE: f64 = 0.25;

/// Asserts that nothing is lost, that buffers stay free, and that mesh bands were measured; gives the rate.
fn assert_kept_up(test: &str, config: &Configuration) -> Option<f64> {
    let image = image(test)?;
    let mut highest_hz = 0.0_f64;
    for speed_hz in SPEEDS_HZ {
        let outcome = run(&image, config, CYCLES, speed_hz);
        let (Outcome { lost, spectra, rate_hz, load, .. }, free) = (outcome, outcome.buffers_free());
        println!(
            "{speed_hz} turns/s, {:.1} kHz: load {:.0} %, {lost} blocks lost, {:.0} % of the buffers free at worst",
            rate_hz / 1e3,
            100.0 * load,
            100.0 * free
        );
        assert!(free >= MIN_FREE_BUFFER_SHARE, "{speed_hz} turns/s: {} blocks waited", outcome.most_waiting);
        assert_eq!(lost, 0, "{speed_hz} turns/s");
        assert!(spectra >= 3, "{spectra} spectra at {speed_hz} turns/s");
        highest_hz = highest_hz.max(rate_hz);
    }
    Some(highest_hz)
}

#[test]
fn regress_the_default_configuration_loses_no_block() {
    assert_kept_up("default configuration", &configuration());
}

#[test]
fn regress_the_highest_rate_that_is_accepted_loses_no_block() {
    let accepted_hz = f64::from(Timing::STM32F405.highest_adc.0);
    let mut config = configured_for(accepted_hz);
    config.limits.highest_adc = Timing::STM32F405.highest_adc;
    let Some(rate_hz) = assert_kept_up("highest rate", &config) else { return };
    assert!((rate_hz / accepted_hz - 1.0).abs() < 0.01, "{rate_hz} Hz");
}

/// Share of the cycles that a train of four stages must leave.
const MIN_FREE_CYCLE_SHARE: f64 = 0.2;

#[test]
fn regress_a_train_of_four_stages_leaves_a_fifth_of_the_cycles() {
    let Some(image) = image("train") else { return };
    let mut config = configuration();
    let [pinion, gear] = [config.gears.pinion_teeth, config.gears.gear_teeth];
    let [z1, z2] = [u32::from(pinion), u32::from(gear)];
    let of = |stage, [teeth, mate_teeth]: [u16; 2], [turns, pinion_turns]: [u32; 2]| TrainGear {
        stage,
        teeth,
        mate_teeth,
        turns,
        pinion_turns,
    };
    config.train.extend([
        of(1, [gear, pinion], [z1, z2]),
        of(2, [21, 65], [z1, z2]),
        of(2, [65, 21], [z1 * 21, z2 * 65]),
        of(3, [84, 24], [z1 * 42, z2 * 585]),
        of(4, [18, 54], [z1 * 42, z2 * 585]),
    ]);
    // A whole round takes some 50 s.
    let outcome = run_for(&image, &config, CYCLES, (SPEEDS_HZ[0], 60.0));
    let (load, free) = (outcome.load, outcome.buffers_free());
    println!(
        "train at {} turns/s: load {:.0} %, {:.0} % of the buffers free",
        SPEEDS_HZ[0],
        100.0 * load,
        100.0 * free
    );
    assert_eq!(outcome.lost, 0);
    assert!(load <= 1.0 - MIN_FREE_CYCLE_SHARE && free >= MIN_FREE_BUFFER_SHARE, "load {load}, {free} free");
}

/// Waveforms at the standard rate.
fn with_waveforms(config: Configuration) -> Configuration {
    Configuration { capture: CaptureConfig { keep: CaptureRate::Fixed, rate: Hertz(0.0) }, ..config }
}

#[test]
fn regress_waveforms_at_the_standard_rate_lose_no_block_up_to_half_the_highest_rate() {
    let half_hz = 0.5 * f64::from(Timing::STM32F405.highest_adc.0);
    assert_kept_up("waveforms at half the highest rate", &with_waveforms(configured_for(half_hz)));
}

#[test]
fn regress_waveforms_at_the_standard_rate_lose_no_block_at_the_highest_rate_and_a_usual_speed() {
    let Some(image) = image("waveforms at the highest rate") else { return };
    let mut config = with_waveforms(configured_for(f64::from(Timing::STM32F405.highest_adc.0)));
    config.limits.highest_adc = Timing::STM32F405.highest_adc;
    let Outcome { lost, spectra, load, .. } = run(&image, &config, CYCLES, SPEEDS_HZ[0]);
    println!("{} turns/s with waveforms: load {:.0} %, {lost} blocks lost", SPEEDS_HZ[0], 100.0 * load);
    assert!(lost == 0 && spectra >= 3, "{lost} blocks lost, {spectra} spectra");
}
