//! The loop's report, band levels and corrected machine, on a generated record with a known effect.

use meshband_host::generate::{self, Scenario};
use meshband_host::machine::Machine;
use meshband_host::model_based::{Options, apply, bands, close_loop, replay, report};
use meshband_host::observation::input;
use meshband_host::output::Outputs;
use meshband_host::record::Record;
use std::path::Path;

#[test]
fn loop_report_and_corrected_machine_agree_with_the_outcome() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("vectors/check-19-48");
    let declared = input::read(&folder).unwrap();
    let mut scenario = Scenario::null(&declared.shafts, 11);
    scenario.effects = vec!["torque-ripple:depth=0.02,order=5,phase=0.7".into()];
    scenario.duration_s = 1.0;
    let record = generate::record(&declared.pair, &declared.shafts, &declared.curve, &scenario).unwrap();
    let outcome = close_loop(&record, &Options { limits: true, ..Options::default() }).unwrap();
    print!("{}", outcome.summary());
    assert!(!outcome.effects.is_empty());
    let replayed = replay::replay(&record, &outcome);
    let power = |residual: &[[Vec<rustfft::num_complex::Complex64>; 2]]| -> f64 {
        outcome.split[2].iter().flat_map(|&r| &residual[r]).flatten().map(|x| x.norm_sqr()).sum()
    };
    let (before, after) = (power(&replayed.declared_residual), power(&replayed.corrected_residual));
    println!("held-out residual power {before:.4e} -> {after:.4e}");
    assert!(after < before, "the rebuilt effects lower the residual: {before} -> {after}");
    for band in bands::bands(&replayed, &outcome) {
        println!("{band:?}");
        assert!(band.record_db.is_finite() && band.corrected_error_db < band.declared_error_db + 0.3, "{band:?}");
    }
    let html = report::report(&outcome, &replayed, &Default::default()).unwrap().html();
    for section in [
        "Error in three stages",
        "Residual spectrum",
        "What would have been found",
        "Considered and refused",
        "stays unexplained",
    ] {
        assert!(html.contains(section), "{section}");
    }
    let copy = tempfile::tempdir().unwrap();
    let machine = copy.path().join("bench.toml");
    for (from, to) in [("check-19-48.toml", "bench.toml"), ("check-19-48.csv", "check-19-48.csv")] {
        let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines").join(from);
        std::fs::copy(from, copy.path().join(to)).unwrap();
    }
    let files = Record::read(&folder).unwrap();
    let announced = apply::Correction::announce(&machine, &files, &mut Outputs::default()).unwrap();
    let applied = announced.write(&outcome).unwrap();
    println!("{applied:?}");
    let corrected = Machine::read(&applied.machine).unwrap();
    let plain = Machine::read(&machine).unwrap();
    let change = 1.0 + outcome.corrected_parameter_changes["pinion mass"];
    assert!((corrected.shafts.mass_kg[0] / plain.shafts.mass_kg[0] - change).abs() < 1e-9);
    for effect in &applied.written {
        meshband_host::effects::parse(effect).unwrap();
    }
}
