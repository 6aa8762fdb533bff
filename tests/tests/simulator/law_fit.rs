//! Law forms and their fit on points whose law is known.

use meshband_host::law::fit::{fit, fit_quadratic_absolute, fit_table, relative_errors, start_values};
use meshband_host::law::forms::Law;
use meshband_host::law::point::Point;

fn points(law: &Law) -> Vec<Point> {
    (1..=25).map(|f| Point { shaft_hz: f64::from(f), bandwidth_hz: law.bandwidth_hz(f64::from(f)) }).collect()
}

#[test]
fn theory_each_form_is_recovered_from_its_own_points() {
    let truths = [
        Law::Quadratic { a: 2.0, b: 2900.0, c: 120.0 },
        Law::RootSumSquare { a_turns: 1.2e-4, t_mode_s: 2e-6 },
        Law::RampThroughMode { ramp_rad: 0.95e-3, mode_hz: 5200.0 },
    ];
    for truth in truths {
        let points = points(&truth);
        let start = start_values(&points).into_iter().find(|s| s.name() == truth.name()).unwrap();
        let fitted = fit(start, &points).unwrap();
        for (got, want) in fitted.law.coefficients().iter().zip(truth.coefficients()) {
            assert!((got / want - 1.0).abs() < 1e-6, "{}: {got} instead of {want}", truth.name());
        }
    }
}

#[test]
fn theory_short_ramp_gives_0_8_of_the_ramp_and_long_ramp_the_mode() {
    let law = Law::RampThroughMode { ramp_rad: 1e-3, mode_hz: 5000.0 };
    let short = law.rise_time_s(1000.0) / (0.8 * 1e-3 / (std::f64::consts::TAU * 1000.0));
    assert!((short - 1.0).abs() < 1e-4, "{short}");
    assert!((law.rise_time_s(0.1) / law.rise_time_s(0.5) - 1.0).abs() < 1e-12);
    let mode_edge = (0.9_f64.asin() - 0.1_f64.asin()) / (std::f64::consts::TAU * 5000.0);
    assert!((law.rise_time_s(0.1) / mode_edge - 1.0).abs() < 1e-12);
}

#[test]
fn theory_intervals_cover_the_truth_under_scatter() {
    use rand::{RngExt, SeedableRng};
    let truth = Law::Quadratic { a: 2.0, b: 2900.0, c: 400.0 };
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    let (mut covered, trials) = (0, 300);
    for _ in 0..trials {
        let mut points = points(&truth);
        for p in &mut points {
            let gauss: f64 = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            p.bandwidth_hz *= 1.0 + 0.005 * gauss;
        }
        let fitted = fit(truth.clone(), &points).unwrap();
        let off = (fitted.law.coefficients()[1] - 2900.0).abs();
        covered += u32::from(off <= fitted.half_width_95[1]);
    }
    let share = f64::from(covered) / f64::from(trials);
    assert!((0.91..=0.985).contains(&share), "95 % intervals cover {share}");
}

#[test]
fn theory_parabola_on_ramp_points_fails_outside_its_domain() {
    let truth = Law::RampThroughMode { ramp_rad: 2e-3, mode_hz: 5000.0 };
    let fitted = fit_quadratic_absolute(&points(&truth)).unwrap();
    let far = [Point { shaft_hz: 50.0, bandwidth_hz: truth.bandwidth_hz(50.0) }];
    assert!(relative_errors(&fitted.law, &far)[0].abs() > fitted.worst_relative.min(0.02));
    assert!(fit_quadratic_absolute(&points(&truth)[..4]).is_err());
}

#[test]
fn theory_table_follows_a_knee_and_continues_in_proportion() {
    let truth = Law::RampThroughMode { ramp_rad: 2e-3, mode_hz: 5000.0 };
    let dense: Vec<Point> = (0..=192)
        .map(|i| 1.0 + 0.125 * f64::from(i))
        .map(|f| Point { shaft_hz: f, bandwidth_hz: truth.bandwidth_hz(f) })
        .collect();
    let fitted = fit_table(&dense, 24, 1e-3).unwrap();
    let between: Vec<Point> = (0..150)
        .map(|i| 1.05 + 0.1597 * f64::from(i))
        .map(|f| Point { shaft_hz: f, bandwidth_hz: truth.bandwidth_hz(f) })
        .collect();
    let worst = relative_errors(&fitted.law, &between).iter().fold(0.0_f64, |w, e| w.max(e.abs()));
    assert!(worst < 0.005, "{worst}");
    assert!((fitted.law.bandwidth_hz(50.0) / truth.bandwidth_hz(50.0) - 1.0).abs() < 0.01);
    assert_eq!(fitted.law.bandwidth_hz(0.5), fitted.law.bandwidth_hz(1.0));
}
