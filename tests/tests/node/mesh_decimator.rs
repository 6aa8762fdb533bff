//! Decimator of the mesh bands: droop, aliases into the wanted band and delay from the impulse response; any block
//! length.

use meshband::mesh_decimator::{BAND_SHARE, BATCH, Decimation, MeshDecimator};
use rustfft::{FftPlanner, num_complex::Complex};

const HEIGHT: u16 = 16_384;

/// All outputs of a decimator for codes in chunks; the middle code follows until the last burst is out.
fn filter(decimation: Decimation, codes: &[u16], per_code: f32, zero: u16, chunk: usize) -> Vec<f32> {
    let mut decimator = MeshDecimator::new(decimation);
    let mut outputs = Vec::new();
    let tail = vec![32_768u16; 2 * BATCH * decimation.ratio() as usize];
    for codes in codes.chunks(chunk).chain(tail.chunks(BATCH)) {
        outputs.extend_from_slice(decimator.process(codes, per_code, zero));
    }
    outputs.truncate(codes.len() / decimation.ratio() as usize);
    outputs
}

/// Response at the ADC rate: the impulse responses of all input phases, interleaved.
fn response(decimation: Decimation, length: usize) -> Vec<Complex<f64>> {
    let ratio = decimation.ratio() as usize;
    let mut impulse = vec![Complex::new(0.0, 0.0); length];
    for phase in 0..ratio {
        let mut codes = vec![32_768u16; length];
        codes[phase] += HEIGHT;
        for (n, &y) in filter(decimation, &codes, 1.0 / f32::from(HEIGHT), 32_768, BATCH).iter().enumerate() {
            impulse[(n + 1) * ratio - 1 - phase] = Complex::new(f64::from(y), 0.0);
        }
    }
    FftPlanner::new().plan_fft_forward(length).process(&mut impulse);
    impulse
}

fn cases() -> Vec<Decimation> {
    let mut cases = vec![Decimation { comb: 1, stages: 1 }, Decimation { comb: 1, stages: 2 }];
    cases.extend((6..=16).map(|comb| Decimation { comb, stages: 2 }));
    cases.extend([2, 3, 5, 9].map(|comb| Decimation { comb, stages: 3 }));
    cases.push(Decimation { comb: 9, stages: 4 });
    cases
}

#[test]
fn theory_nothing_folds_into_the_band_and_the_band_is_flat() {
    for decimation in cases() {
        let length = 128 * decimation.ratio() as usize;
        let spectrum = response(decimation, length);
        let output = 1.0 / f64::from(decimation.ratio());
        let band = f64::from(BAND_SHARE) * output;
        let (mut ripple, mut leak) = (0.0f64, 0.0f64);
        for (k, bin) in spectrum.iter().enumerate().take(length / 2 + 1) {
            let frequency = k as f64 / length as f64;
            let folded = (frequency / output - (frequency / output).round()).abs() * output;
            if frequency <= band {
                ripple = ripple.max((20.0 * bin.norm().log10()).abs());
            } else if folded <= band && frequency > 0.5 * output {
                leak = leak.max(bin.norm());
            }
        }
        let leak = 20.0 * leak.log10();
        println!("{decimation:?}: ripple {ripple:.5} dB, aliases {leak:.1} dB");
        assert!(ripple < 0.005, "{decimation:?}: ripple {ripple} dB");
        assert!(leak < -90.0, "{decimation:?}: aliases {leak} dB");
    }
}

#[test]
fn theory_group_delay_is_the_stated_number_of_samples() {
    for decimation in cases() {
        let length = 128 * decimation.ratio() as usize;
        let spectrum = response(decimation, length);
        let phase = (spectrum[1] * spectrum[0].conj()).arg();
        let turns = length as f64 / std::f64::consts::TAU;
        let stated = f64::from(MeshDecimator::new(decimation).delay_samples());
        let delay = -phase * turns;
        // The phase is known up to whole turns.
        let difference = (delay - stated) - ((delay - stated) / length as f64).round() * length as f64;
        assert!(difference.abs() < 1.0e-2, "{decimation:?}: {difference} off {stated}");
    }
}

#[test]
fn theory_blocks_of_any_length_give_the_same_samples_and_wrapping_sums_leave_no_trace() {
    let decimation = Decimation { comb: 16, stages: 2 };
    let codes: Vec<u16> = (0..1 << 16).map(|n: u32| (n.wrapping_mul(2_654_435_761) >> 16) as u16).collect();
    let whole = filter(decimation, &codes, 0.01, 30_000, BATCH);
    assert_eq!(whole.len(), codes.len() / 64);
    for chunk in [1, 37, 100] {
        assert_eq!(filter(decimation, &codes, 0.01, 30_000, chunk), whole);
    }
    // A constant for long: the fourth sum wraps often, the mean stays exact.
    for code in [0u16, 12_345, 65_535] {
        let found = filter(decimation, &vec![code; 1 << 16], 0.01, 30_000, BATCH);
        let last = found[found.len() - 1];
        let wanted = (f32::from(code) - 30_000.0) * 0.01;
        assert!((last - wanted).abs() < 1e-4 * wanted.abs(), "{last} instead of {wanted}");
    }
}

#[test]
fn theory_the_ratio_found_is_the_largest_with_short_half_bands() {
    let found = [
        (1.3, 1, 0),
        (3.9, 1, 1),
        (4.0, 1, 2),
        (15.0, 1, 3),
        (20.0, 2, 3),
        (24.0, 6, 2),
        (39.0, 9, 2),
        (67.9, 16, 2),
        (72.0, 9, 3),
    ];
    for (wanted, comb, stages) in found {
        assert_eq!(Decimation::up_to(wanted), Decimation { comb, stages }, "{wanted}");
    }
    assert_eq!(Decimation::up_to(1.0e9), Decimation::MAXIMUM);
}
