//! The interpolation that turns a record into an "analogue" signal, and the image that carries it.

use meshband::replay::{Header, Replay, ReplayError, image_bytes, write};
use meshband_host::spectral::Window;
use meshband_host::virtual_node::analogue::Interpolator;
use proptest::prelude::*;
use std::f64::consts::TAU;

fn tone(share_of_rate: f64, count: usize) -> Vec<f64> {
    (0..count).map(|n| (TAU * share_of_rate * n as f64 + 0.3).sin()).collect()
}

#[test]
fn theory_interpolated_tones_keep_amplitude_and_phase_up_to_0_45_of_the_rate() {
    let interpolator = Interpolator::new();
    for share in [0.001, 0.05, 0.2, 0.35, 0.45] {
        let samples = tone(share, 400);
        let worst = (0..4000)
            .map(|n| 100.0 + f64::from(n) * 0.0493)
            .map(|x| (interpolator.value(&samples, x) - (TAU * share * x + 0.3).sin()).abs())
            .fold(0.0, f64::max);
        // 0.001 dB is 1.15e-4.
        assert!(worst < 1.15e-4, "error {worst:.2e} at {share} of the rate");
    }
}

/// Amplitude of a line, at cycles per interpolated sample, under a Blackman-Harris window.
fn line(samples: &[f64], frequency: f64) -> f64 {
    let (mut re, mut im, mut sum) = (0.0, 0.0, 0.0);
    for (n, x) in samples.iter().enumerate() {
        let weight = Window::BlackmanHarris.weight(n as f64 / samples.len() as f64);
        let (s, c) = (TAU * frequency * n as f64).sin_cos();
        re += weight * x * c;
        im += weight * x * s;
        sum += weight;
    }
    2.0 * f64::hypot(re, im) / sum
}

#[test]
fn theory_images_of_interpolated_tones_lie_95_db_down_from_0_55_of_the_rate_on() {
    let interpolator = Interpolator::new();
    let (steps, count) = (16, 16 * 2000);
    for share in [0.03, 0.21, 0.35, 0.45] {
        let samples = tone(share, 2200);
        let values: Vec<f64> =
            (0..count).map(|n| interpolator.value(&samples, 100.0 + n as f64 / steps as f64)).collect();
        assert!((line(&values, share / steps as f64) - 1.0).abs() < 2e-4);
        for image in [1.0 - share, 1.0 + share, 2.0 - share, 3.0 + share] {
            let decibels = 20.0 * line(&values, image / steps as f64).log10();
            assert!(decibels < -95.0, "image of {share} at {image} of the rate: {decibels:.1} dB");
        }
    }
}

#[test]
fn theory_interpolation_is_exact_at_samples_and_on_constants() {
    let interpolator = Interpolator::new();
    let samples = vec![3.0; 200];
    assert!((interpolator.value(&samples, 100.37) - 3.0).abs() < 1e-12);
    let samples = tone(0.3, 200);
    assert!((interpolator.value(&samples, 77.0) - samples[77]).abs() < 1e-12);
}

#[test]
fn theory_a_replayed_code_lies_on_the_line_between_its_neighbours() {
    let header = Header::new(25_000_000, 10, 100.0);
    let mut bytes = vec![0; image_bytes(3, 2, 3)];
    write(&header, &[1, 2, 3], &[5, 9], &[-100, 100, 32767], &mut bytes).expect("sound");
    let replay = Replay::parse(&bytes).expect("sound");
    assert_eq!(replay.configuration(), [1, 2, 3]);
    assert_eq!((replay.edge(0), replay.edge(1), replay.edge(2)), (Some(5), Some(9), None));
    assert_eq!(replay.code_at(0), Some(32768 - 100));
    assert_eq!(replay.code_at(5), Some(32768));
    assert_eq!(replay.code_at(10), Some(32768 + 100));
    assert_eq!(replay.end_tick(), 20);
    assert_eq!(replay.code_at(20), None);
}

#[test]
fn theory_a_coarser_converter_rounds_and_saturates() {
    let header = Header { converter_bits: 12, ..Header::new(25_000_000, 1, 100.0) };
    let mut bytes = vec![0; image_bytes(0, 0, 4)];
    write(&header, &[], &[], &[7, 8, 32767, 0], &mut bytes).expect("sound");
    let replay = Replay::parse(&bytes).expect("sound");
    assert_eq!((0..3).map(|t| replay.code_at(t)).collect::<Vec<_>>(), [Some(0x8000), Some(0x8010), Some(0xfff0)]);
}

#[test]
fn fault_senseless_images_are_not_written() {
    let mut out = vec![0; 4096];
    let header = Header::new(25_000_000, 10, 100.0);
    assert_eq!(write(&header, &[], &[9, 9], &[0; 4], &mut out), Err(ReplayError::Edges));
    assert_eq!(write(&header, &[], &[], &[0; 4096], &mut out), Err(ReplayError::Length));
    let scale = Header { full_scale_m_s2: f32::NAN, ..header };
    assert_eq!(write(&scale, &[], &[], &[0; 4], &mut out), Err(ReplayError::Header));
    let period = Header { ticks_per_sample: 0, ..header };
    assert_eq!(write(&period, &[], &[], &[0; 4], &mut out), Err(ReplayError::Header));
}

proptest! {
    #[test]
    fn fault_any_single_damaged_bit_is_noticed(byte in 0usize..120, bit in 0u8..8) {
        let mut bytes = vec![0; image_bytes(5, 3, 18)];
        let samples: Vec<i16> = (0..18).collect();
        write(&Header::new(25_000_000, 10, 100.0), &[1; 5], &[1, 2, 3], &samples, &mut bytes).expect("sound");
        prop_assert_eq!(bytes.len(), 120);
        bytes[byte] ^= 1 << bit;
        // Bytes 6 and 7 pad the header; they are under its checksum, too.
        prop_assert!(Replay::parse(&bytes).is_err());
    }

    #[test]
    fn fault_random_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        let mut bytes = bytes;
        if bytes.len() > 6 {
            bytes[..4].copy_from_slice(b"MBRP");
        }
        prop_assert!(Replay::parse(&bytes).is_err());
    }
}
