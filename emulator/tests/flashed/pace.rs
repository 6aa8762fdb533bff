//! The flashed image keeps up at two cycles per instruction: no block is lost at the highest rate that a
//! configuration may ask for, nor with the default one. How far it could go is in `cargo xtask pace`.

use super::compared::configuration;
use super::compared::load::{Outcome, SPEEDS_HZ, configured_for, run};
use super::image::image;
use meshband::board::Timing;
use meshband::config::{CaptureConfig, CaptureRate, Configuration};
use meshband::units::Hertz;

/// Cycles per instruction: the core's manual gives 1 to 2.5, most of them nearer to one.
const CYCLES: f64 = 2.0;

/// Share of the block buffers that must stay free at worst: 29 % do at 60 turns/s and the highest rate.
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
