//! Half-band cascade: pass band, stop band and delay from the impulse response.

use meshband::decimate::Cascade;
use rustfft::{FftPlanner, num_complex::Complex};

/// Response of a cascade at the input rate: the impulse responses of all input phases, interleaved.
fn response(stages: u8, length: usize) -> Vec<Complex<f64>> {
    let factor = 1usize << stages;
    let mut impulse = vec![Complex::new(0.0, 0.0); length];
    for phase in 0..factor {
        let mut samples = vec![0.0f32; length];
        samples[phase] = 1.0;
        let count = Cascade::new(stages).process(&mut samples);
        for (n, &y) in samples[..count].iter().enumerate() {
            // Output n weighs the input at `phase`; lag = newest input of output n - phase.
            impulse[(n + 1) * factor - 1 - phase] = Complex::new(f64::from(y), 0.0);
        }
    }
    FftPlanner::new().plan_fft_forward(length).process(&mut impulse);
    impulse
}

#[test]
fn theory_nothing_folds_into_the_usable_band() {
    for stages in 1..=7u8 {
        let length = 1 << (7 + stages).max(12);
        let spectrum = response(stages, length);
        let output = 1.0 / f64::from(1u32 << stages);
        let usable = output / 2.56;
        let (mut ripple, mut leak) = (0.0f64, 0.0f64);
        for (k, bin) in spectrum.iter().enumerate().take(length / 2 + 1) {
            let frequency = k as f64 / length as f64;
            let folded = (frequency / output - (frequency / output).round()).abs() * output;
            if frequency <= usable {
                ripple = ripple.max((20.0 * bin.norm().log10()).abs());
            } else if folded <= usable {
                leak = leak.max(bin.norm());
            }
        }
        let leak = 20.0 * leak.log10();
        println!("{stages} stages: ripple {ripple:.5} dB, aliases {leak:.1} dB");
        assert!(ripple < 0.001, "{stages} stages: ripple {ripple} dB");
        assert!(leak < -90.0, "{stages} stages: aliases {leak} dB");
    }
}

#[test]
fn theory_group_delay_is_the_stated_number_of_samples() {
    for stages in 0..=6u8 {
        let length = 1 << 12;
        let spectrum = response(stages, length);
        let phase = (spectrum[1] * spectrum[0].conj()).arg();
        let delay = -phase / std::f64::consts::TAU * length as f64;
        let stated = f64::from(Cascade::new(stages).delay_samples());
        assert!((delay - stated).abs() < 1.0e-3, "{stages} stages: {delay}, stated {stated}");
    }
}

#[test]
fn theory_blocks_of_any_length_give_the_same_samples() {
    let input: Vec<f32> = (0..4096u32).map(|n| (n.wrapping_mul(2_654_435_761) >> 8) as f32).collect();
    let mut whole = input.clone();
    let count = Cascade::new(4).process(&mut whole);
    let mut pieces = Vec::new();
    let mut cascade = Cascade::new(4);
    for chunk in input.chunks(37) {
        let mut chunk = chunk.to_vec();
        let count = cascade.process(&mut chunk);
        pieces.extend_from_slice(&chunk[..count]);
    }
    assert_eq!(pieces, whole[..count]);
}
