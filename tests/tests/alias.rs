//! Folded mesh harmonics against the lines read off the paper's 10 kHz spectra.

use meshband::alias::{Origin, explain, fold};

#[test]
fn claim_low_lines_at_10_khz_are_folded_mesh_harmonics() {
    // Line, mesh frequency, harmonic: the paper's simulated spectra, healthy and cracked.
    for (line_hz, mesh_hz, harmonic) in
        [(265.6, 293.303, 35), (558.9, 293.303, 36), (733.7, 797.446, 26), (1531.0, 797.446, 27)]
    {
        match explain(line_hz, mesh_hz, 10_000.0, 0.15, 60) {
            Origin::Folded(found) => {
                assert_eq!(found.harmonic, harmonic, "{line_hz}");
                assert!((found.appears_hz - line_hz).abs() < 0.15, "{line_hz}: {found:?}");
                assert!((found.true_hz - mesh_hz * harmonic as f32).abs() < 0.01);
            }
            other => panic!("{line_hz}: {other:?}"),
        }
    }
}

#[test]
fn claim_the_measured_lines_fold_from_the_measured_mesh() {
    // Mesh frequencies from the measured line pairs: 36 f - 35 f of each spectrum.
    for (line_hz, mesh_hz, harmonic) in
        [(263.7f32, 293.25, 35), (560.4, 293.35, 36), (733.4, 797.44, 26), (1530.0, 797.41, 27)]
    {
        assert!(
            matches!(explain(line_hz, mesh_hz, 10_000.0, 2.0, 60),
            Origin::Folded(found) if found.harmonic == harmonic),
            "{line_hz}"
        );
    }
}

#[test]
fn theory_at_a_rate_above_twice_the_highest_harmonic_nothing_folds() {
    for harmonic in 1..=60u32 {
        let line = 293.303 * harmonic as f32;
        let origin = explain(line, 293.303, 100_000.0, 0.1, 60);
        assert!(matches!(origin, Origin::Genuine(found) if found.harmonic == harmonic), "{harmonic}: {origin:?}");
    }
    assert_eq!(explain(265.6, 293.303, 100_000.0, 0.15, 60), Origin::Unexplained);
}

#[test]
fn theory_folding_against_integer_arithmetic() {
    for rate in [8_000u32, 10_000, 25_600] {
        for frequency in (0..200_000u32).step_by(37) {
            let rest = frequency % rate;
            assert_eq!(fold(frequency as f32, rate as f32), rest.min(rate - rest) as f32);
        }
    }
}

#[test]
fn fault_meaningless_inputs_explain_nothing() {
    for (mesh, rate, line, tolerance) in [
        (0.0, 1e4, 10.0, 1.0),
        (f32::NAN, 1e4, 10.0, 1.0),
        (300.0, -1.0, 10.0, 1.0),
        (300.0, 1e4, f32::INFINITY, 1.0),
        (300.0, 1e4, 300.0, f32::NAN),
    ] {
        assert_eq!(explain(line, mesh, rate, tolerance, 50), Origin::Unexplained);
    }
}
