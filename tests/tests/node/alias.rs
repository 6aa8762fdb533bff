//! Folded mesh harmonics against the lines read off the paper's 10 kHz spectra.

use meshband::alias::{Origin, explain, fold};

fn spectra() -> Vec<serde_json::Value> {
    let paper: serde_json::Value = serde_json::from_str(include_str!("../../vectors/paper.json")).unwrap();
    paper["alias_lines_at_10_khz"].as_array().unwrap().clone()
}

/// Asserts that every line of a spectrum is explained by the harmonic the vectors name.
fn assert_explained(spectrum: &serde_json::Value, mesh_hz: f32, tolerance_hz: f32) {
    for line in spectrum["lines"].as_array().unwrap() {
        let line_hz = line["hz"].as_f64().unwrap() as f32;
        match explain(line_hz, mesh_hz, 10_000.0, tolerance_hz, 60) {
            Origin::Folded(found) => {
                assert_eq!(u64::from(found.harmonic), line["harmonic"].as_u64().unwrap(), "{line_hz} Hz");
                assert!((found.appears_hz - line_hz).abs() <= tolerance_hz, "{line_hz} Hz: {found:?}");
                assert!((found.true_hz - mesh_hz * found.harmonic as f32).abs() < 0.01);
            }
            other => panic!("{line_hz} Hz: {other:?}"),
        }
    }
}

#[test]
fn claim_low_lines_at_10_khz_are_folded_mesh_harmonics() {
    let mut checked = 0;
    for spectrum in spectra() {
        // The simulated cases have a mesh frequency of six digits: lines within 0.15 Hz.
        if let Some(mesh_hz) = spectrum["mesh_hz"].as_f64() {
            assert_explained(&spectrum, mesh_hz as f32, 0.15);
            checked += 1;
        }
    }
    assert_eq!(checked, 2);
}

#[test]
fn claim_the_measured_lines_fold_from_the_measured_mesh() {
    let mut checked = 0;
    for spectrum in spectra().iter().filter(|spectrum| spectrum["mesh_hz"].is_null()) {
        // Rounded to 0.1 and 1 Hz, the quoted mesh cannot place a 35th harmonic; the first line itself can.
        let first = &spectrum["lines"][0];
        let (hz, harmonic) = (first["hz"].as_f64().unwrap(), first["harmonic"].as_f64().unwrap());
        let quoted = spectrum["quoted_mesh_hz"][0].as_f64().unwrap();
        let folds = (harmonic * quoted / 10_000.0).round();
        let mesh_hz = (10_000.0 * folds + hz) / harmonic;
        assert!((mesh_hz / quoted - 1.0).abs() < 2e-3, "{mesh_hz} from the fold, {quoted} quoted");
        assert_explained(spectrum, mesh_hz as f32, 4.0);
        checked += 1;
    }
    assert_eq!(checked, 2);
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
