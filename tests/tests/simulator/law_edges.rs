//! Rise time of engagement edges from polynomials, on edges whose answer is known in closed form.

use meshband_host::law::edges::{Step, edge_in_window};
use std::f64::consts::{PI, TAU};

/// Taylor steps of `f` given by its derivatives at any point; `pieces` are ascending borders.
fn steps(borders: &[f64], series: impl Fn(f64) -> Vec<f64>) -> Vec<Step> {
    borders
        .windows(2)
        .map(|w| Step { start_s: w[0], length_s: w[1] - w[0], coefficients: series(0.5 * (w[0] + w[1])) })
        .map(|s| {
            let shifted = meshband_host::piecewise::shift_scale(&s.coefficients, -0.5 * s.length_s, 1.0);
            Step { coefficients: shifted, ..s }
        })
        .collect()
}

fn sine_series(amplitude: f64, omega: f64, at: f64) -> Vec<f64> {
    let mut factorial = 1.0;
    (0..24)
        .map(|n| {
            if n > 0 {
                factorial *= f64::from(n);
            }
            amplitude * omega.powi(n) * (omega * at + 0.5 * PI * f64::from(n)).sin() / factorial
        })
        .collect()
}

#[test]
fn theory_linear_ramp_on_a_ring_gives_0_8_of_its_width() {
    let (width, height) = (10e-6, 70.0);
    let ring = TAU * 5000.0;
    for phase in [0.0, 1.0, 2.0, 3.0, 4.0, 5.0] {
        let all = steps(&[-60e-6, -30e-6, 0.0, width, 40e-6, 70e-6], |at| {
            let mut c = sine_series(30.0, ring, at + phase / ring);
            if (0.0..width).contains(&at) {
                c[0] += height * at / width;
                c[1] += height / width;
            } else if at > width {
                c[0] += height;
            }
            c
        });
        let edge = edge_in_window(&all, [0.0, width]).unwrap();
        assert!((edge.rise_time_s / (0.8 * width) - 1.0).abs() < 0.01, "phase {phase}: {}", edge.rise_time_s);
    }
}

#[test]
fn theory_quarter_sine_between_the_one_third_slopes() {
    let omega = TAU * 1000.0;
    let all = steps(&[-3e-4, -2e-4, -1e-4, 0.0, 1e-4, 2e-4, 3e-4], |at| sine_series(5.0, omega, at));
    let edge = edge_in_window(&all, [-0.5e-4, 0.5e-4]).unwrap();
    let end = (1.0_f64 / 3.0).acos();
    let expected = 2.0 * (0.8 * end.sin()).asin() / omega;
    assert!((edge.rise_time_s / expected - 1.0).abs() < 1e-9, "{} for {expected}", edge.rise_time_s);
    assert!((edge.ends_s[1] - end / omega).abs() < 1e-12 && edge.steepest_s.abs() < 1e-7);
}

#[test]
fn theory_a_window_without_slope_or_outside_the_steps_gives_nothing() {
    let flat = [Step { start_s: 0.0, length_s: 1.0, coefficients: vec![3.0] }];
    assert_eq!(edge_in_window(&flat, [0.2, 0.4]), None);
    assert_eq!(edge_in_window(&flat, [2.0, 3.0]), None);
    let endless = [Step { start_s: 0.0, length_s: 1.0, coefficients: vec![0.0, 1.0] }];
    assert_eq!(edge_in_window(&endless, [0.2, 0.4]), None, "an edge that does not end is not an edge");
}
