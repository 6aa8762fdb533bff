//! Generator and diagnosis agree on records of machines drawn at random.

use crate::drawn::{layout, machine};
use crate::generate;
use crate::generate::Scenario;
use crate::model_based::base_fit::{Base, TOLERANCES};
use crate::model_based::least_squares::{normal, solve, subtract};
use crate::model_based::tach_delay;
use crate::observation::input::Record;
use meshband_host::check::Kind;
use rand::RngExt;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Generator and loop must agree far below the noise that records get, or every record has something in it: true
/// parameters, no noise, the runs' own angles and speeds fitted (the tachometer's jitter is in the record). The
/// second machine has modes at 9 kHz.
#[test]
fn ref_generated_records_of_drawn_machines_are_what_harmonic_balance_predicts() {
    for seed in 1000..1012 {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let declared = machine(&mut random).unwrap();
        let mut scenario = Scenario::null(&declared.shafts, random.random());
        scenario.duration_s = 1.0;
        layout(&declared, &mut scenario, &mut random);
        scenario.noise_rms = 0.0;
        let record = generate::record(&declared.pair, &declared.shafts, &declared.curve, &scenario).unwrap();
        let base = Base::new(&record);
        let runs: Vec<usize> = (0..record.runs.len()).collect();
        let own = base.columns().split_off(TOLERANCES.len());
        let mut rest = base.data();
        let x: Vec<f64> = solve(&normal(&rest, &runs, &own)).x.iter().copied().collect();
        subtract(&mut rest, &own, &x);
        for (run, residual) in base.runs.iter().zip(&rest.residual) {
            for (measured, residual) in run.measured.iter().zip(residual) {
                let power =
                    |bins: &[rustfft::num_complex::Complex64]| bins.iter().skip(8).map(|x| x.norm_sqr()).sum::<f64>();
                let error = (power(residual) / power(measured)).sqrt();
                assert!(error < 3e-4, "{}, {:.1} turns/s: {error:.1e}", declared.title, run.angle.shaft_hz);
            }
        }
    }
}

/// A record of a drawn machine whose parameters are off within tolerance, with the tach later by `late_s`.
fn detuned(seed: u64, late_s: f64) -> Record {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let declared = machine(&mut random).unwrap();
    let mut scenario = Scenario::null(&declared.shafts, random.random());
    scenario.duration_s = 1.0;
    layout(&declared, &mut scenario, &mut random);
    super::off(&mut scenario, &mut random, None, 1.0);
    let mut record = generate::record(&declared.pair, &declared.shafts, &declared.curve, &scenario).unwrap();
    record.runs.iter_mut().flat_map(|run| &mut run.edges_s).for_each(|t| *t += late_s);
    record
}

/// Both, since modes that are off pass for a part of the lag.
#[test]
fn loop_measures_a_lag_of_the_tach_beside_detuned_modes() {
    let late_s = 40e-6;
    let checked = tach_delay::checked(&detuned(1100, late_s));
    let lag = checked.findings.list.iter().find(|f| f.kind == Kind::TachDelay).expect("a lag of 40 us");
    assert!((lag.figure + late_s).abs() < 1e-6, "{:.2e} s", lag.figure);
}
