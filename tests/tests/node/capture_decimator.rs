//! The filter of waveforms: its ratios, its band, what folds into it, and its delay.

use meshband::capture_decimator::{BATCH, CaptureDecimator, FLAT_SHARE};
use std::f64::consts::TAU;

const AMPLITUDE: f64 = 20_000.0;

/// Outputs of a cosine at `frequency` turns per code, without those that see the beginning.
fn response(over: f32, frequency: f64) -> (CaptureDecimator, Vec<f64>) {
    let mut decimator = CaptureDecimator::new();
    decimator.restart(over);
    let ratio = decimator.ratio() as usize;
    let wanted = decimator.settling_outputs() as usize + 400;
    let code = |n: usize| (32_768.0 + AMPLITUDE * (TAU * frequency * n as f64).cos()).round() as u16;
    let codes: Vec<u16> = (0..wanted * ratio).map(code).collect();
    let mut outputs = Vec::new();
    for part in codes.chunks(BATCH - 27) {
        decimator.process(part, 32_768, |sample| outputs.push(f64::from(sample)));
    }
    let settled = outputs.split_off(decimator.settling_outputs() as usize);
    (decimator, settled)
}

fn amplitude(outputs: &[f64]) -> f64 {
    (2.0 * outputs.iter().map(|x| x * x).sum::<f64>() / outputs.len() as f64).sqrt() / AMPLITUDE
}

/// Ratios with a comb and without, the pair with the highest aliases (11 twice) and the longest filter among them.
const DECIMATION_RATIOS: [f32; 8] = [2.0, 3.3, 5.0, 7.0, 22.0, 27.0, 40.5, 112.0];

#[test]
fn claim_between_200_and_420_khz_the_rate_asked_for_is_exceeded_by_a_tenth_at_most() {
    for adc_khz in 200..=420 {
        let over = adc_khz as f32 / 10.0;
        let mut decimator = CaptureDecimator::new();
        decimator.restart(over);
        let excess = over / decimator.ratio() as f32;
        assert!((1.0..=1.0913).contains(&excess), "{adc_khz} kHz: {excess}");
    }
}

#[test]
fn theory_the_band_is_flat_to_a_tenth_of_a_decibel_and_in_its_place_in_time() {
    for over in DECIMATION_RATIOS {
        for share in [0.01, 0.1, 0.2, 0.3, f64::from(FLAT_SHARE)] {
            let ratio = {
                let mut decimator = CaptureDecimator::new();
                decimator.restart(over);
                f64::from(decimator.ratio())
            };
            let frequency = share / ratio;
            let (decimator, outputs) = response(over, frequency);
            let first = f64::from(decimator.settling_outputs());
            let largest = outputs.iter().enumerate().fold(0.0f64, |largest, (n, output)| {
                let newest = (first + n as f64 + 1.0) * ratio - 1.0;
                let instant = newest - f64::from(decimator.delay_samples());
                largest.max((output / AMPLITUDE - (TAU * frequency * instant).cos()).abs())
            });
            println!("over {over}, ratio {ratio}, {share} of the rate: {largest:.5}");
            assert!(largest < 0.0115, "over {over}, {share}: {largest}");
        }
    }
}

#[test]
fn theory_what_folds_into_the_band_lies_53_db_down() {
    let mut worst = (0.0f64, 0.0f32, 0.0);
    for over in DECIMATION_RATIOS {
        let mut decimator = CaptureDecimator::new();
        decimator.restart(over);
        let ratio = f64::from(decimator.ratio());
        for multiple in 1..=(ratio / 2.0) as u32 {
            for share in [-0.349, -0.2, -0.05, 0.05, 0.2, 0.349] {
                let frequency = (f64::from(multiple) + share) / ratio;
                if frequency < 0.5 {
                    let level = amplitude(&response(over, frequency).1);
                    worst = if level > worst.0 { (level, over, frequency * ratio) } else { worst };
                }
            }
        }
    }
    let decibels = 20.0 * worst.0.log10();
    println!("{decibels:.1} dB at {} of the rate, over {}", worst.2, worst.1);
    assert!(decibels < -53.0);
}

#[test]
fn theory_portions_of_any_length_give_the_same_samples() {
    let codes: Vec<u16> = (0..5000u32).map(|n| (n.wrapping_mul(2_654_435_761) >> 16) as u16).collect();
    let run = |length: usize| {
        let mut decimator = CaptureDecimator::new();
        decimator.restart(22.5);
        let mut bits = Vec::new();
        for part in codes.chunks(length) {
            decimator.process(part, 32_768, |sample| bits.push(sample.to_bits()));
        }
        bits
    };
    let expected = run(BATCH);
    assert!(!expected.is_empty());
    for length in [1, 7, 64, 127] {
        assert_eq!(run(length), expected, "{length}");
    }
}
