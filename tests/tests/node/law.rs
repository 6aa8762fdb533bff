//! Bandwidth law: values, domain, refusal, transport.

use meshband::law::{Law, LawError, LawForm};
use meshband::units::Hertz;

#[test]
fn claim_the_provisional_law_gives_the_papers_one_bandwidth() {
    let at = Law::PROVISIONAL.bandwidth(Hertz(14.5));
    assert!((at.bandwidth.0 - 42_070.0).abs() < 0.01);
    assert!(at.provisional && !at.clamped);
}

#[test]
fn theory_physical_form_is_the_quadrature_of_ramp_and_mode() {
    let mut law = Law::PROVISIONAL;
    law.form = LawForm::Physical { ramp_turns: 1.2e-4, mode_rise_s: 8.0e-6 };
    let expected = 0.35 / f64::sqrt((1.2e-4f64 / 10.0).powi(2) + 8.0e-6f64.powi(2));
    assert!((f64::from(law.bandwidth(Hertz(10.0)).bandwidth.0) / expected - 1.0).abs() < 3.0e-7);
}

#[test]
fn fault_speeds_outside_the_domain_are_clamped_and_say_so() {
    let law = Law::PROVISIONAL;
    for (speed, as_if) in [(0.1, law.lowest), (99.0, law.highest), (f32::NAN, law.highest)] {
        let at = law.bandwidth(Hertz(speed));
        assert!(at.clamped);
        assert_eq!(at.bandwidth, law.bandwidth(as_if).bandwidth);
    }
}

#[test]
fn fault_impossible_laws_are_refused() {
    let mut law = Law::PROVISIONAL;
    assert_eq!(law.validate(), Ok(()));
    for [a_per_hz, b, c_hz] in [[f32::NAN, 1.0, 0.0], [1.0, f32::INFINITY, 0.0], [1.0, 1.0, f32::NAN]] {
        law.form = LawForm::Quadratic { a_per_hz, b, c_hz };
        assert_eq!(law.validate(), Err(LawError::NotFinite));
    }
    for [ramp_turns, mode_rise_s] in [[f32::NAN, 1e-6], [1e-4, f32::INFINITY]] {
        law.form = LawForm::Physical { ramp_turns, mode_rise_s };
        assert_eq!(law.validate(), Err(LawError::NotFinite));
    }
    law.form = LawForm::Quadratic { a_per_hz: 1.0, b: -26.0, c_hz: 30.0 };
    assert_eq!(law.validate(), Err(LawError::Bandwidth));
    law = Law::PROVISIONAL;
    law.highest = law.lowest;
    assert_eq!(law.validate(), Err(LawError::Domain));
}
